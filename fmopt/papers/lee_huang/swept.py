"""The whole motion against the true solids: three sections are not enough, [LeeHuang1985] section 4.1.1 with errata.

Every convex piece of what moves is swept along P(t) and held against every convex piece of what stands. A leg that does
not turn is exact: the sweep is the convex hull of the piece at both ends. A leg that turns is bisected: over a stretch
that turns by Δr, a point at distance ρ from the nominal centre strays from its chord by at most 3/16 |Δr|² ρ, so that
the hull of both ends, apart from the other body by more, is proof.

Round surfaces are enclosed: of what moves and of what stands every solid instance is circumscribed and every hollow one
inscribed, so that what is free here is free for the true surfaces. The guarantee is for all times, not for samples: no
two points of the bodies come closer than touching to 1e-9 m.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from fmopt.errors import InterferenceError, SolverError
from fmopt.geometry.clearance import axes_across, directions, overlap, penetration, towards
from fmopt.geometry.convex_pieces import pieces
from fmopt.geometry.csg import Moved, Solid, Sphere, Union, exact_pose, sagitta
from fmopt.geometry.polyhedron import Polyhedron, from_faces, placed
from fmopt.papers.lee_huang.nominal_trajectory import NominalTrajectory
from fmopt.papers.lee_huang.shrink_expand import enclosing, finer
from fmopt.runtime.clock import heed
from fmopt.spatial.se3 import Pose
from fmopt.spatial.values import Array, Value

Body: TypeAlias = tuple[str, Solid]

_TOUCH = 1e-9  # m, overlap up to this is touching
_CLOSE = 1e-7  # m, bodies that pass this close while they turn count as meeting
_ON_PLANE = 1e-9  # m
_FINER = (48, 96, 192, 384)  # sides of polygons around round surfaces, when fewer do not decide


@dataclass(frozen=True, eq=False)
class SweptMeeting(Value, pose=(6,), point=(3,)):
    """Where the nominal motion runs into something.

    Args:
        time: s, when they first meet, to 1e-9 of the leg.
        pose: P (6,) then, m and rad.
        point: (3,) in the B-frame, m, inside both bodies shortly after.
        depth: how deep the two pieces that meet first overlap later on that leg, m; the largest at seven times.
        planes: which of the planes xz, yz, xy of the B-frame run through both bodies' common part; none of them when a
            cut-diagram cannot show the meeting.
    """

    moving: str
    fixed: str
    time: float
    pose: Array
    point: Array
    depth: float
    planes: tuple[str, ...]

    def __str__(self) -> str:
        x, y, z = 1e3 * self.point
        seen = f"seen on the plane {' and '.join(self.planes)}" if self.planes else "off the planes xz, yz and xy"
        place = f"near ({x:.4g}, {y:.4g}, {z:.4g}) mm of the B-frame, {seen}"
        return f"{self.moving!r} meets {self.fixed!r} at {self.time:.6g} s by up to {1e3 * self.depth:.4g} mm, {place}"


def meetings(moving: Sequence[Body], fixed: Sequence[Body], path: NominalTrajectory) -> tuple[SweptMeeting, ...]:
    """Every pair of bodies that overlaps on the way, where it first does so, in the order of time.

    Names and solids that move are in the moving operand's frame, all others, operand 2 and obstacles, in the B-frame.
    """
    movers = [(name, _bodies(solid)) for name, solid in moving]
    standing = [(name, pieces(enclosing(solid))) for name, solid in fixed]
    found = []
    for mover, bodies in movers:
        for name, others in standing:
            legs = (_on_leg(bodies, others, path, k) for k in range(len(path.times) - 1))
            first = next((hit for hit in legs if hit is not None), None)
            # Legs are looked at in order: the first meeting is what is told.
            if first is not None:
                found.append(_meeting(mover, name, first, path))
    return tuple(sorted(found, key=lambda meeting: (meeting.time, meeting.moving, meeting.fixed)))


def checked(moving: Sequence[Body], fixed: Sequence[Body], path: NominalTrajectory) -> None:
    """Refuses a nominal motion that runs into something.

    Polygons around round surfaces may meet where the surfaces themselves pass: such a meeting, not deeper than the
    polygons are proud, is looked at again with more sides, up to 384; arguments as for `meetings`.

    Raises:
        InterferenceError: it does; names the bodies, the time, the place, and whether a cut-diagram shows it.
    """
    found = meetings(moving, fixed, path)
    for sides in _FINER:
        met = (moving, {one.moving for one in found}), (fixed, {one.fixed for one in found})
        proud = sum(max((2.0 * sagitta(s) for name, s in side if name in named), default=0.0) for side, named in met)
        # Deeper than polygons are proud of the true surfaces, by less than two sagittas: more sides would not undo it.
        if not found or found[0].depth > proud or proud <= 0.0:
            break
        moving, fixed = ([(name, finer(s, sides) if name in named else s) for name, s in side] for side, named in met)
        found = meetings(moving, fixed, path)
    if found:
        message = "; ".join(f"the nominal motion is not free: {meeting}" for meeting in found)
        advice = "move the obstacle, or give nodes that lead round it"
        raise InterferenceError(message, max(0.0, *(one.depth for one in found)), found[0].fixed, advice)


def free_until(moving: Sequence[Body], fixed: Sequence[Body], path: NominalTrajectory, margin: float) -> float:
    """Up to when every point of what moves keeps more than `margin` from what stands: a node of P(t), s.

    The answer is the last node up to which all legs are shown to; 0 when the first leg is not. The margin, m, positive,
    is how far a point of the uncertain operand 1 strays.
    """
    movers = [body for _, solid in moving for body in _bodies(solid)]
    standing = [piece for _, solid in fixed for piece in pieces(enclosing(solid))]
    for k, start in enumerate(path.times[:-1].tolist()):
        span = (start, float(path.times[k + 1]))
        for body in movers:
            ends = _Stretch(body, path, span, _radius(body))
            if not all(_keeps(ends, other, margin) for other in standing):
                return float(start)
    return path.duration


def _keeps(stretch: "_Stretch", other: Polyhedron, margin: float) -> bool:
    """Whether a stretch is shown to keep its distance, halved until its stray is small against it."""
    stray = stretch.stray
    # Every point of the piece is within its stray of the hull of both ends.
    if stretch.overlap(other, margin + stray) <= -(margin + stray):
        return True
    # Small stray and still not clear: halving further would not show more.
    return stray > 0.1 * margin and all(_keeps(half, other, margin) for half in stretch.halves())


def _bodies(solid: Solid) -> list[Polyhedron]:
    """The convex pieces of a solid that moves: polygons around what is round, but for balls, which stay what they are.

    A ball that is cut is none.
    """
    balls, rest = list[tuple[Array, float]](), list[Solid]()
    _parted(solid, Pose.identity(), balls, rest)
    if not balls:
        return list(pieces(enclosing(solid)))
    own = list(pieces(enclosing(Union(tuple(rest))))) if rest else []
    return own + [from_faces([centre], (), balls=((0, radius),)) for centre, radius in balls]


def _parted(solid: Solid, at: Pose, balls: list[tuple[Array, float]], rest: list[Solid]) -> None:
    """Sorts what a solid, put in a place, is the union of into balls, by centre and radius, and the rest."""
    match solid:
        case Sphere(radius, _):
            balls.append((at.p, radius))
        case Moved(inner, own):
            _parted(inner, at.compose(exact_pose(own)), balls, rest)
        case Union(parts):
            for part in parts:
                _parted(part, at, balls, rest)
        case _:
            rest.append(Moved(solid, at))


def _radius(body: Polyhedron) -> float:
    """How far a body reaches from the origin, m."""
    return float((np.linalg.norm(body.vertices, axis=1) + body.radii).max())


@dataclass(frozen=True, eq=False)
class _Hit(Value):
    """When two pieces first meet."""

    time: float
    body: Polyhedron
    other: Polyhedron


def _on_leg(bodies: Sequence[Polyhedron], others: Sequence[Polyhedron], path: NominalTrajectory, k: int) -> _Hit | None:
    """The earliest meeting of any two pieces on leg k."""
    span = (float(path.times[k]), float(path.times[k + 1]))
    hits: list[_Hit | None] = []
    for body in bodies:
        heed()
        ends = _Stretch(body, path, span, _radius(body))
        hits += [_first(ends, other) for other in _reached(ends, others)]
    return min(filter(None, hits), key=lambda hit: hit.time, default=None)


@dataclass(frozen=True, eq=False)
class _Stretch(Value):
    """A piece over a stretch of time within one leg."""

    piece: Polyhedron
    path: NominalTrajectory
    span: tuple[float, float]
    radius: float

    @property
    def stray(self) -> float:
        """How far a point of the piece leaves its chord, m: an eighth of the square of the time times |x''|.

        With ω = J(r) r', |ω| ≤ |r'| and |ω'| ≤ ½|r'|², hence |x''| ≤ (|ω|² + |ω'|) ρ ≤ 3/2 |r'|² ρ.
        """
        turn = self.path.at(self.span[1])[3:] - self.path.at(self.span[0])[3:]
        return 3.0 / 16.0 * float(turn @ turn) * self.radius

    @property
    def hull(self) -> Array:
        """Vertices (2n, 3) of the piece at both ends; of a ball its centre."""
        return np.vstack([self.path.pose(t).apply(self.piece.vertices) for t in self.span])

    def overlap(self, other: Polyhedron, enough: float) -> float:
        """Bound from above of how much the hull of both ends overlaps the other piece, m; negative when they are apart.

        Exactly so where the two ends are not turned against one another: the axes are then those of the hull. A bound
        of −`enough` (m) or less, from the faces alone, is not made smaller.
        """
        points, still, round_ = self.hull, other.vertices, float(self.piece.radii.max())
        turned = [self.path.pose(t).R.T for t in dict.fromkeys(self.span)]
        normals = np.vstack([*(self.piece.normals @ R for R in turned), -other.normals])
        if round_:
            normals = np.vstack([normals, *(towards(other, centre) for centre in points)])
        least = overlap(points, still, normals, round_)
        # Apart along a face's normal: no cross products needed.
        if least <= -enough:
            return least
        travel = self.path.at(self.span[1])[:3] - self.path.at(self.span[0])[:3]
        travel = travel / (np.linalg.norm(travel) or 1.0)
        along = np.vstack([*(directions(self.piece) @ R for R in turned), travel])
        # Minkowski's theorem: faces of the sum of two polytopes are faces of either, or spanned by an edge of each.
        return min(least, overlap(points, still, axes_across(along, np.vstack([directions(other), travel])), round_))

    def halves(self) -> "tuple[_Stretch, _Stretch]":
        middle = 0.5 * (self.span[0] + self.span[1])
        return replace(self, span=(self.span[0], middle)), replace(self, span=(middle, self.span[1]))


def _reached(stretch: _Stretch, others: Sequence[Polyhedron]) -> Iterator[Polyhedron]:
    """The pieces whose boxes the box of the stretch overlaps."""
    points, beyond = stretch.hull, stretch.stray + float(stretch.piece.radii.max())
    low, high = points.min(axis=0) - beyond, points.max(axis=0) + beyond
    for other in others:
        points = other.vertices
        if np.all(low <= points.max(axis=0)) and np.all(points.min(axis=0) <= high):
            yield other


def _first(stretch: _Stretch, other: Polyhedron) -> _Hit | None:
    """The first meeting within a stretch, by proof or by halving; None when it is free."""
    stray = stretch.stray
    free = stray if stray > 0.0 else -_TOUCH
    if stretch.overlap(other, free) <= -free:
        return None
    # Still overlapping, with nothing left to halve: it counts as a meeting.
    if stray <= _CLOSE:
        return _Hit(_begin(stretch, other), stretch.piece, other)
    early, late = stretch.halves()
    return _first(early, other) or _first(late, other)


def _begin(stretch: _Stretch, other: Polyhedron) -> float:
    """When the overlap begins, to 1e-9 of the leg: the sweep from the start on overlaps from then on."""
    free, met = stretch.span
    while met - free > 1e-9 * (stretch.span[1] - stretch.span[0]):
        middle = 0.5 * (free + met)
        # From the start on: the swept hull grows, so that meeting is monotonic in its end.
        part = replace(stretch, span=(stretch.span[0], middle))
        enough = part.stray if part.stray > 0.0 else -_TOUCH
        free, met = (free, middle) if part.overlap(other, enough) > -enough else (middle, met)
    return met


def _meeting(mover: str, name: str, hit: _Hit, path: NominalTrajectory) -> SweptMeeting:
    """The record of a first meeting, with a point in the middle of the common part when it is deepest on that leg."""
    k = int(np.clip(np.searchsorted(path.times, hit.time, side="right") - 1, 0, len(path.times) - 2))
    end = float(path.times[k + 1])
    # Just after the meeting as well as later: the deepest place may come soon or late.
    times = [hit.time + share * (end - hit.time) for share in (1e-3, 1e-2, 0.1, 0.25, 0.5, 0.75, 1.0)]
    bodies = [placed(hit.body, path.pose(t)) for t in times]
    depths = [penetration(body, hit.other) for body in bodies]
    point = _inside(bodies[int(np.argmax(depths))], hit.other)
    planes: set[str] = set()
    for body in (body for body, depth in zip(bodies, depths, strict=True) if depth > _TOUCH):
        planes |= set(_planes(body, hit.other))
    shown = tuple(plane for plane in ("xz", "yz", "xy") if plane in planes)
    return SweptMeeting(mover, name, hit.time, path.at(hit.time), point, max(0.0, *depths), shown)


def _common(body: Polyhedron, other: Polyhedron) -> tuple[Array, Array]:
    """The planes of faces of both; of a ball those of the cube around it."""
    normals, offsets = body.normals, body.offsets
    if body.balls:
        normals = np.vstack([np.eye(3), -np.eye(3)])
        offsets = normals @ body.vertices[0] + body.radii[0]
    return np.vstack([normals, other.normals]), np.concatenate([offsets, other.offsets])


def _inside(body: Polyhedron, other: Polyhedron) -> Array:
    """The point (3,) deepest inside both bodies, or nearest to both.

    Raises:
        SolverError: the linear program stopped without an answer.
    """
    normals, offsets = _common(body, other)
    found = _lowest(np.array([0.0, 0.0, 0.0, -1.0]), np.column_stack([normals, np.ones(len(normals))]), offsets)
    if found is None:
        raise SolverError("no point in the common part of two bodies was found", "check that both have volume")
    return found[:3]


def _planes(body: Polyhedron, other: Polyhedron) -> Iterator[str]:
    """The planes of the B-frame that run through the common part of two bodies."""
    for name, axis in (("xz", 1), ("yz", 0), ("xy", 2)):
        ends = [_lowest(sign * np.eye(3)[axis], *_common(body, other)) for sign in (1.0, -1.0)]
        if all(end is not None and sign * end[axis] > _ON_PLANE for end, sign in zip(ends, (-1.0, 1.0), strict=True)):
            yield name


def _lowest(cost: Array, rows: Array, offsets: Array) -> Array | None:
    """x with the least cost·x among rows x ≤ offsets; None when there is none."""
    from scipy.optimize import linprog

    found = linprog(cost, A_ub=rows, b_ub=offsets, bounds=[(None, None)] * rows.shape[1])
    return None if found.x is None else np.asarray(found.x)
