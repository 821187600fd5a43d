"""Where start errors come from, and the box that they make together, after [BasanezSuarez] eqs. (1)-(11)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from fmopt.verify.parts.reach import dot
from fmopt.verify.problem.quantities import ANGLE, LENGTH
from fmopt.verify.problem.tables import Table

HOLE, HAND, WORLD = "hole", "hand", "world"
Point = tuple[float, ...]
_ORIGIN = (0.0, 0.0, 0.0)
_QUARTER, TILT = 0.5 * math.pi, 0.25 * math.pi


@dataclass(frozen=True)
class Share:
    """What one source adds to a position (m) and to an orientation (rad), and the frame in which it is fixed."""

    frame: str
    position: float
    angle: float = 0.0


@dataclass(frozen=True)
class Boxed:
    """Half-widths (6,) that one source adds to the start box, m and rad, and the frame in which it is fixed."""

    frame: str
    box: tuple[float, ...]


@dataclass(frozen=True)
class Pose:
    """Where the part may start: its leading face's height, its distance from the axis (m), its lean (rad), at most."""

    height: float
    aside: float
    lean: float


@dataclass(frozen=True)
class Sources:
    """The table [uncertainty.sources] with the corners of the two parts, on which some sources depend."""

    table: Table
    moving: Sequence[Point]
    fixed: Sequence[Point]

    def boxes(self, at: Pose) -> list[Boxed]:
        """What each source adds to the start box.

        Position: ε_a + ε_pr + ε_pg + ε_v, eq. (10); orientation: ε_φ = ε_φr + ε_φg, eq. (11), to which those of both
        configurations come. What turns also moves: the held part about its grasp, the fixed one about its mouth.
        """
        self.table.only("shape", "measurement", "configuration", "feeder", "robot", "grasp")
        grasp = self.table.table("grasp").only("position", "angle", "height")
        h = grasp.number("height", LENGTH)
        fixed, held = self._fixed(), self._held(grasp, h)
        # No more than a quarter: beyond it sines fall, and bounds with them.
        turn, tilted = (min(math.fsum(s.angle for s in shares), _QUARTER) for shares in (fixed, held))
        across, along = h * math.sin(tilted), h * (1.0 - math.cos(tilted))
        sideways, down = across + along * math.sin(at.lean), along + across * math.sin(at.lean)
        by_grasp = (sideways + down * math.sin(turn), down + sideways * math.sin(turn), tilted)
        short = 1.0 - math.cos(turn)
        by_fixed = (
            (at.height + at.aside) * math.sin(turn) + at.aside * short,
            at.aside * math.sin(turn) + at.height * short,
            turn,
        )
        return [*_levers(fixed, by_fixed), *_levers(held, by_grasp)]

    def _fixed(self) -> list[Share]:
        measured = self.table.maybe("measurement", LENGTH)
        if measured is not None:
            return [Share(HOLE, measured)]
        shape = Share(HOLE, self.table.maybe("shape", LENGTH) or 0.0)
        return [shape, *self._configured("configuration", self.fixed, _ORIGIN, HOLE)]

    def _held(self, grasp: Table, height: float) -> list[Share]:
        before = self._configured("feeder", self.moving, (0.0, 0.0, height), HAND)
        # The robot counts as it grasps, which stays in the hand, and again as it inserts.
        position, angle = deviation(self.table.table("robot"))
        return [
            *before,
            Share(HAND, position, angle),
            Share(HAND, grasp.maybe("position", LENGTH) or 0.0, grasp.maybe("angle", ANGLE, 0.0, TILT) or 0.0),
            Share(WORLD, position, angle),
            Share(HAND, self.table.maybe("shape", LENGTH) or 0.0),
        ]

    def _configured(self, key: str, corners: Sequence[Point], at: Point, frame: str) -> list[Share]:
        """How far a configuration moves the point `at`, and turns the part."""
        if not self.table.has(key):
            return [Share(frame, 0.0)]
        table = self.table.table(key).only("position", "angle", "about", "known", "observed", "placed")
        stated = [name for name in ("position", "known", "observed") if table.has(name)]
        if len(stated) > 1 or not (stated or table.has("placed")):
            raise table.error(stated[-1] if stated else "position", "give one of position, known, observed")
        handlings = [_Handling.of(item) for item in table.tables("placed", 64)] if table.has("placed") else []
        first = handlings[0].at if handlings else at
        if "known" in stated:
            off = table.number("known", LENGTH)
            shares = [Share(frame, off, _turn(off, _width(corners)))]
        elif "observed" in stated:
            shares = [_observed(table.table("observed").only("points", "deviation"), first, frame)]
        else:
            position, angle = table.maybe("position", LENGTH) or 0.0, table.maybe("angle", ANGLE, 0.0, TILT) or 0.0
            lever = _chord(table.vector("about", default=first), first, angle)
            shares = [Share(frame, position, angle), Share(frame, lever)]
        for k, handling in enumerate(handlings):
            shares += [replace(share, frame=frame) for share in handling.shares]
            then = handlings[k + 1].at if k + 1 < len(handlings) else at
            shares.append(Share(frame, _chord(handling.at, then, math.fsum(share.angle for share in shares))))
        return shares


@dataclass(frozen=True)
class _Handling:
    """A robot that grasped the part at a point and put it down: what it adds to position and orientation."""

    at: Point
    shares: tuple[Share, Share]

    @staticmethod
    def of(table: Table) -> _Handling:
        table.only("robot", "slide", "at")
        position, angle = deviation(table.table("robot"))
        slide = deviation(table.table("slide")) if table.has("slide") else (0.0, 0.0)
        # Twice: as the robot takes the part, and as it puts it down.
        shares = Share(HOLE, 2.0 * position, 2.0 * angle), Share(HOLE, *slide)
        return _Handling(table.vector("at", default=_ORIGIN), shares)


def deviation(table: Table) -> tuple[float, float]:
    """Greatest deviation of a position (m) and of an orientation (rad)."""
    table.only("position", "angle")
    return table.number("position", LENGTH), table.maybe("angle", ANGLE, 0.0, TILT) or 0.0


def by_frame(boxes: Sequence[Boxed]) -> dict[str, tuple[float, ...]]:
    """The boxes (6,) that these add up to in each of the three frames."""
    return {frame: total([boxed for boxed in boxes if boxed.frame == frame]) for frame in (HOLE, HAND, WORLD)}


def total(boxes: Sequence[Boxed]) -> tuple[float, ...]:
    """The box (6,) that all of these add up to."""
    return tuple(math.fsum(boxed.box[axis] for boxed in boxes) for axis in range(6))


def _levers(shares: Sequence[Share], levers: tuple[float, float, float]) -> list[Boxed]:
    """The boxes of shares: their positions, and their parts of what all of them turn across, along, and in angle."""
    angle = math.fsum(share.angle for share in shares)
    found = []
    for share in shares:
        part = share.angle / angle if angle else 0.0
        x, z, turn = (lever * part for lever in levers)
        found.append(Boxed(share.frame, (share.position + x, share.position + x, share.position + z, *[turn] * 3)))
    return found


def _chord(about: Point, at: Point, angle: float) -> float:
    return 2.0 * math.dist(about, at) * math.sin(0.5 * min(angle, math.pi))


def _turn(off: float, width: float) -> float:
    """The greatest turn of a body whose points, this width apart, each move by so much."""
    return 2.0 * math.asin(off / width) if off < width else math.pi


def _observed(table: Table, at: Point, frame: str) -> Share:
    """Three points whose places were observed: how far they let `at` move, by the better of two bounds."""
    items, off = table.items("points", 3, 3), table.number("deviation", LENGTH)
    points = [table.row(f"points[{i}]", item) for i, item in enumerate(items)]
    width = _altitude(*points)
    if width < 1e-6:
        raise table.error("points", "lie on a line")
    angle = _turn(off, width)
    a, b, c = points
    u, v, w = _arm(a, b), _arm(a, c), _arm(a, at)
    uu, uv, vv, uw, vw = dot(u, u), dot(u, v), dot(v, v), dot(u, w), dot(v, w)
    s, t = ((vv * uw - uv * vw) / (uu * vv - uv * uv), (uu * vw - uv * uw) / (uu * vv - uv * uv))
    # The foot of the point in the plane of the three, of which it has the shares 1 − s − t, s and t.
    foot = tuple(p + s * x + t * y for p, x, y in zip(a, u, v, strict=True))
    direct = (abs(1.0 - s - t) + abs(s) + abs(t)) * off + _chord(foot, at, angle)
    centre = tuple(sum(axis) / 3.0 for axis in zip(a, b, c, strict=True))
    return Share(frame, min(direct, off + _chord(centre, at, angle)), angle)


def _width(corners: Sequence[Point]) -> float:
    """The least altitude of a wide triangle of a body's corners: across any axis two of them are so far apart."""
    centre = tuple(math.fsum(axis) / len(corners) for axis in zip(*corners, strict=True))
    first = max(corners, key=lambda p: math.dist(p, centre))
    second = max(corners, key=lambda p: math.dist(p, first))
    third = max(corners, key=lambda p: _area(first, second, p))
    return _altitude(first, second, third)


def _altitude(a: Point, b: Point, c: Point) -> float:
    longest = max(math.dist(a, b), math.dist(b, c), math.dist(a, c))
    return _area(a, b, c) / longest if longest else 0.0


def _area(a: Point, b: Point, c: Point) -> float:
    (x, y, z), (u, v, w) = _arm(a, b), _arm(a, c)
    return math.hypot(y * w - z * v, z * u - x * w, x * v - y * u)


def _arm(a: Point, b: Point) -> tuple[float, ...]:
    return tuple(q - p for p, q in zip(a, b, strict=True))
