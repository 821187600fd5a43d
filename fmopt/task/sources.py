"""Sources of uncertainty and the start box that they make, after [BasanezSuarez] eqs. (1)-(11)."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from fmopt.spatial.values import Array, Framing, Value

if TYPE_CHECKING:
    from fmopt.geometry.part import Part
    from fmopt.task.model import Model
    from fmopt.task.toml import problem_file as files

Point: TypeAlias = tuple[float, float, float]
Frame: TypeAlias = Literal["world", "hole", "hand"]
"""Where an error is fixed: in the world, or turning with the fixed part or with the moving one."""
OF_ALL = {"x": "position", "y": "position", "z": "position", "rx": "angle", "ry": "angle", "rz": "angle"}
_SIDES: dict[str, Frame] = {"moving": "hand", "fixed": "hole"}
_LEAST = 1e-9  # m and rad: the least start error where velocity adds none, which rounding is small beside
_QUARTER = 0.5 * math.pi  # rad: the sine falls beyond; sums as large are refused anyway


@dataclass(frozen=True)
class Share:
    """What one source adds to a position (m) and to an orientation (rad), and where it is fixed."""

    source: str
    symbol: str
    position: float
    angle: float = 0.0
    frame: Frame = "world"


@dataclass(frozen=True, eq=False)
class Contribution(Value, box=(6,)):
    """What one source adds to the half-widths (6,) of the start box, m and rad, and where it is fixed.

    What is not `stated` comes with the parts, and stays where stated errors are lowered.
    """

    source: str
    symbol: str
    box: Array
    frame: Frame = "world"
    stated: bool = True

    def exchanged(self) -> Contribution:
        """The same as the parts see it with the hole in the hand: then it is the peg that stands in the world."""
        return replace(self, frame="hole" if self.frame == "hand" else "hand")

    def in_plane(self) -> Contribution:
        """What it adds in the plane of x and z, and about y."""
        return replace(self, box=self.box * (1.0, 0.0, 1.0, 0.0, 1.0, 0.0))

    def record(self) -> dict[str, Any]:
        """The contribution as tables and lists, for who asks what a problem states."""
        said = {"source": self.source, "symbol": self.symbol, "contribution": self.box.tolist()}
        return {**said, "frame": self.frame}


def framing(contributions: Sequence[Contribution]) -> Framing:
    """Which shares of the start box that contributions make are fixed where."""
    box = total(contributions)
    safe = np.where(box > 0.0, box, 1.0)  # of no error any share is as good
    parts = ([c for c in contributions if c.frame == frame] for frame in ("hole", "hand"))
    hole, hand = (np.minimum(total(part) / safe, 1.0) for part in parts)
    return Framing(hole, np.minimum(hand, 1.0 - hole))  # rounding puts no share above what is left


def total(contributions: Sequence[Contribution]) -> Array:
    """The box (6,) that contributions add up to, m and rad."""
    # Rounded once, so that it is the same in whatever order sources are listed.
    return np.array([math.fsum(c.box[axis] for c in contributions) for axis in range(6)])


def budget(
    sources: files.Sources, widths: tuple[float, float], height: float, aside: float = 0.0, lean: float = 0.0
) -> tuple[Contribution, ...]:
    """Which source contributes how much to a box that holds every start error the sources can make together.

    Position, eq. (10): ε_a + ε_pr + ε_pg + ε_v with ε_pg = ε_pr + ε_pp + ε_td, and ε_a = ε_v + ε_pp of the fixed part,
    or ε_m. Orientation, eq. (11): ε_φ = ε_φr + ε_φg with ε_φg = ε_φr + ε_φd, to which come both ε_φp. Angles of
    rotations about different axes add at most. Rotation about the grasping point, h above the leading face, moves that
    face's centre by up to h sin ε_φ across the part's axis and h (1 − cos ε_φ) along it; rotation of the fixed part
    moves it, seen from there, by its distance from the mouth, and turns the other displacements. Each of these levers
    is shared among the sources by their angles.

    A deviation of shape is taken as a displacement: the box covers where the parts first meet. Two deviating walls do
    not share one displacement later on.

    Args:
        widths: of the moving and of the fixed part, see `body_width`, m.
        height: of the leading face's centre above the mouth at the start, at most, m.
        aside: its distance from the axis of the hole then, at most, m.
        lean: angle between the two axes then, at most, rad.
    """
    h, (moving, standing) = sources.grasp.height, widths
    fixed, held = _fixed_shares(sources, standing), _held_shares(sources, moving)
    tilted = min(math.fsum(share.angle for share in held), _QUARTER)
    turn = min(math.fsum(share.angle for share in fixed), _QUARTER)
    turned, shortened = math.sin(turn), 1.0 - math.cos(turn)
    across, along = h * math.sin(tilted), h * (1.0 - math.cos(tilted))
    # Along the axis of the part, which leans, becomes across that of the hole; cosines, at most 1, are left out.
    sideways, down = across + along * math.sin(lean), along + across * math.sin(lean)
    by_grasp = (sideways + down * turned, down + sideways * turned, tilted)
    # Tilts move the height by their sine, turns about the hole's axis what is aside; either may be.
    by_fixed = ((height + aside) * turned + aside * shortened, aside * turned + height * shortened, turn)
    return (*_levers(fixed, by_fixed), *_levers(held, by_grasp))


def _levers(shares: Sequence[Share], levers: tuple[float, float, float]) -> list[Contribution]:
    """The contributions of shares: their positions, and their parts of what turns do across, along, and in angle."""
    angle, found = math.fsum(share.angle for share in shares), []
    for share in shares:
        x, z, turn = (lever * share.angle / angle if angle else 0.0 for lever in levers)
        box = [share.position + x, share.position + x, share.position + z, turn, turn, turn]
        found.append(Contribution(share.source, share.symbol, np.array(box), share.frame))
    return found


def _fixed_shares(sources: files.Sources, width: float) -> list[Share]:
    if sources.measurement is not None:
        return [Share("fixed part, measured", "ε_m", sources.measurement, frame="hole")]
    placed = configuration_shares(sources.configuration, width, (0.0, 0.0, 0.0))
    return [Share("fixed part, shape", "ε_v", sources.shape, frame="hole"), *_named("fixed part, ", placed, "hole")]


def _held_shares(sources: files.Sources, width: float) -> list[Share]:
    robot, grasp = sources.robot, sources.grasp
    # At the grasping point, about which the turns of what is held are counted.
    before = configuration_shares(sources.feeder, width, (0.0, 0.0, grasp.height))
    return [
        *_named("moving part before the grasp, ", before, "hand"),
        Share("robot, grasping", "ε_pr, ε_φr", robot.position, robot.angle, "hand"),
        Share("slide in the gripper", "ε_td, ε_φd", grasp.position, grasp.angle, "hand"),
        Share("robot, inserting", "ε_pr, ε_φr", robot.position, robot.angle, "world"),
        Share("moving part, shape", "ε_v", sources.shape, frame="hand"),
    ]


def _named(prefix: str, shares: Sequence[Share], frame: Frame) -> list[Share]:
    return [replace(share, source=prefix + share.source, frame=frame) for share in shares]


def configuration_shares(table: files.Configuration | None, width: float, at: Point) -> list[Share]:
    """How far a configuration's deviations move a point (x, y, z) of a part of some `body_width`, m, and turn the part.

    Where points are known a priori, two points that far apart across the axis of a turn by θ part by 2 sin(θ/2) times
    the width, which is at most 2 ε_pp. Deviations of the robots that put the part down accumulate.
    """
    if table is None:
        return [Share("configuration", "ε_pp, ε_φp", 0.0)]
    handlings = table.placed or ()
    begun = handlings[0].at if handlings else at
    if table.known is not None:
        found = [Share("configuration known a priori", "ε_pp", table.known, _turn(table.known, width))]
    elif table.observed is not None:
        points, deviation = table.observed.points, table.observed.deviation
        angle = _turn(deviation, least_altitude(points))
        found = [Share("observed points", "ε_m", _moved(points, deviation, angle, begun), angle)]
    else:
        found = [Share("configuration", "ε_pp, ε_φp", table.position or 0.0, table.angle)]
        if lever := _chord(begun if table.about is None else table.about, begun, table.angle):
            found.append(Share("turn about the observed point", "ε_φp", lever))
    return _handled(found, handlings, at)


def _moved(points: ArrayLike, deviation: float, angle: float, at: Point) -> float:
    """How far `at` moves (m) when three points move by up to the deviation: by either of two bounds.

    The centroid moves by no more than the points, turns go about it. In the plane of the points `at` has affine
    coordinates, whose sizes add up to what multiplies the deviation; only its height over the plane is a lever.
    """
    a, b, c = np.asarray(points, dtype=np.float64)
    two = np.column_stack([b - a, c - a])
    share, *_ = np.linalg.lstsq(two, np.subtract(at, a), rcond=None)
    affine = abs(1.0 - float(share.sum())) + float(np.abs(share).sum())
    direct = affine * deviation + _chord(a + two @ share, at, angle)
    return min(direct, deviation + _chord((a + b + c) / 3.0, at, angle))


def _handled(shares: list[Share], handlings: Sequence[files.Handling], at: Point) -> list[Share]:
    """Shares at a point after each handling: the robot twice, the slide, and turns about the point where it grasped."""
    for number, handling in enumerate(handlings, start=1):
        robot, slide = handling.robot, handling.slide
        slid = (0.0, 0.0) if slide is None else (slide.position, slide.angle)
        # The robot is off as it grasps, and again as it puts the part down.
        shares = [
            *shares,
            Share(f"handling {number}, robot", "ε_pr, ε_φr", 2.0 * robot.position, 2.0 * robot.angle),
            Share(f"handling {number}, slide", "ε_td, ε_φd", *slid),
        ]
        then = handlings[number].at if number < len(handlings) else at
        # Positions hold at the point of the last grasp: to the next one all turns so far are a lever.
        lever = _chord(handling.at, then, math.fsum(share.angle for share in shares))
        if lever:
            shares.append(Share(f"handling {number}, turn about its grasp", "ε_φp", lever))
    return shares


def _chord(about: ArrayLike, at: ArrayLike, angle: float) -> float:
    """How far a turn by up to `angle` about one point moves another, m."""
    # No chord is longer than that of half a turn.
    return 2.0 * float(np.linalg.norm(np.subtract(at, about))) * math.sin(0.5 * min(angle, math.pi))


def _turn(deviation: float, width: float) -> float:
    """The greatest turn (rad) of a body whose points, this width (m) apart, each move by up to the deviation (m)."""
    # Points so near to each other may change places: no turn is ruled out.
    return 2.0 * math.asin(deviation / width) if deviation < width else math.pi


def least_altitude(points: ArrayLike) -> float:
    """The least altitude (m) of a triangle (3, 3): across any axis, two of its corners are at least that far apart."""
    a, b, c = np.asarray(points, dtype=np.float64)
    longest = max(float(np.linalg.norm(v)) for v in (b - a, c - b, a - c))
    return float(np.linalg.norm(np.cross(b - a, c - a))) / longest if longest else 0.0


def body_width(vertices: ArrayLike) -> float:
    """The least altitude (m) of a wide triangle of a body's vertices (n, 3), a lower bound of its width."""
    # Any triangle bounds the width from below, and too little of it only makes the turn larger.
    v = np.asarray(vertices, dtype=np.float64)
    first = v[int(np.argmax(np.linalg.norm(v - v.mean(axis=0), axis=1)))]
    second = v[int(np.argmax(np.linalg.norm(v - first, axis=1)))]
    third = v[int(np.argmax(np.linalg.norm(np.cross(v - first, second - first), axis=1)))]
    return least_altitude([first, second, third])


def as_stated(box: files.ErrorBoxTable | None) -> Contribution:
    """The start error as it is stated, or none: each axis by its own key, or by that of all three."""
    if box is None:
        return Contribution("as stated", "", np.zeros(6))
    given = [(getattr(box, name), getattr(box, of_all)) for name, of_all in OF_ALL.items()]
    widths = np.array([next((value for value in pair if value is not None), 0.0) for pair in given])
    return Contribution("as stated", "", widths, box.frame)


def allowance(velocity: files.Velocity, shares: Sequence[Contribution]) -> Iterator[Contribution]:
    """What the start error lacks of the least one, unless the velocity's error adds to every direction anyway.

    The error set of a plan must reach farther in each direction than rounding does, which its sums repeat.
    """
    lacking = np.maximum(_LEAST - total(shares), 0.0)
    if lacking.any() and not (velocity.translation or velocity.rotation):
        yield Contribution("allowance for rounding", "", lacking)


def faceting(models: Mapping[str, Model], parts: Mapping[str, Part]) -> tuple[Contribution, ...]:
    """What the facets of imported parts add to the position errors: how far the true surfaces lie from them, as ε_v."""
    boxes = {side: np.repeat([part.chord_error, 0.0], 3) for side, part in parts.items()}
    own = [side for side, model in models.items() if model.file.mesh is not None and parts[side].chord_error > 0.0]
    return tuple(Contribution(f"{s} part, facets of its mesh", "ε_v", boxes[s], _SIDES[s], False) for s in own)
