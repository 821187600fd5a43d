"""The fit of two solids: which end of one goes into which opening of the other, where, how deep, with what clearance.

The fit is the candidate with the largest area of walls within 2 % of the width of the other's, then 5, 10, 25.
One that interferes gives way to one that goes in and has half of that. Of equals the one with the least clearance is
taken, of these the deeper one, then the one whose smaller end leads, then the one with the wider mouth, then the one
that turns the solid the least.
"""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import chain, pairwise

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry
from shapely.geometry.polygon import orient

from fmopt.errors import GeometryError
from fmopt.geometry.centre import axis, centre, is_round
from fmopt.geometry.fit import search
from fmopt.geometry.fit.layers import INSIDE, Layers, common
from fmopt.geometry.fit.placing import moved
from fmopt.geometry.fit.search import SHARES, Candidate, largest, opening_around
from fmopt.geometry.fit.seat import Led, Way, most_room
from fmopt.geometry.mating_features import DESCRIBE
from fmopt.geometry.polyhedron import Polyhedron, manifold_of, placed, triangulated
from fmopt.spatial.se3 import Pose, exp
from fmopt.spatial.values import Array

_FITS = 0.1  # of the width: a closed opening with less room than that is one that the solid fits
_EQUAL = 0.02  # of the wall area
_HALF, _CLOSE = 0.5, 0.05  # of the wall area, and of the width: what goes in and is taken before what does not
_SAME, _EQUALLY = 1e-6, 1e-7  # m: of depths, and of clearances
_ANGLE = 1e-6  # rad
_MOST_OF = 0.25  # of the walls that are within the largest share: a smaller share that finds so many of them tells
_OTHER_END = 0.4  # of the wall area, which the other end of a solid has at least
_MOSTLY = 0.75  # of the walls of the best end in an opening, which another end has that is taken for its room
_INTERFERING, _TRIES = 3, 4  # turns
_NANO = 9  # decimals of coordinates in m
_LITTLE = 1e-3  # of an area
_NEAR = 1e-4  # rad
_EXACT, _FINE = 1e-9, 1e-10  # m
_NOISE = 5e-4  # of the height of material: slabs that are thinner tell nothing of its openings
_BESIDE = 1e-7  # m: how far above and below a mouth it is cut
_ROUNDS = 3  # of depth and place, which depend on each other


@dataclass(frozen=True)
class Stated:
    """What is stated of how a solid mates: whether it goes in or is gone into, and by which frames in its model."""

    kind: str | None = None
    frames: tuple[Pose, ...] = ()


@dataclass(frozen=True)
class FoundFit:
    """A solid in an opening of another one."""

    exchanged: bool  # whether the part that moves is the one with the opening
    solid: Pose  # frame of what goes in, in its model: the origin in its tip, z back into the part
    hollow: Pose  # frame of the opening in its model: the origin in its mouth, z out of it, x along its longest side
    clearance: float  # on each side, m; negative by how much what goes in would have to shrink
    depth: float  # of the tip below the mouth, m, the axes of the two frames on each other
    hole: float  # depth of the opening, m
    peg: float  # how long what goes in is, m
    through: bool  # whether the opening goes through
    alike: int = 1  # how many openings fit alike

    @property
    def pose(self) -> Pose:
        """The pose of the solid's model in that of the other one, seated."""
        return self.hollow.compose(Pose(np.array([0.0, 0.0, -self.depth]), np.eye(3))).compose(self.solid.inverse())


def find(
    moving: Polyhedron,
    fixed: Polyhedron,
    stated: Sequence[Stated] = (Stated(), Stated()),
    depth: float | None = None,
    seated: Pose | None = None,
) -> FoundFit:
    """The fit of two solids in any frames.

    Args:
        stated: of the moving and the fixed one.
        depth: of the goal below the mouth, m; the first stop of the straight way in if None.
        seated: pose of the moving solid in the frame of the fixed one, which counts where it can be reached straight.

    Raises:
        GeometryError: nothing goes into anything, or sections of the solids are no regions.
    """
    try:
        return _find((moving, fixed), stated, depth, seated)
    except shapely.errors.GEOSException as error:
        message = f"sections of the parts are no regions: {error}"
        raise GeometryError(message, f"mend the files; or {DESCRIBE}") from error


def _find(
    bodies: tuple[Polyhedron, Polyhedron], stated: Sequence[Stated], depth: float | None, seated: Pose | None
) -> FoundFit:
    roles = [(a, b) for a, b in ((0, 1), (1, 0)) if stated[a].kind != "hollow" and stated[b].kind != "solid"]
    if seated is not None:
        poses = seated, seated.inverse()
        there = [(one, a) for a, b in roles for one in _standing(bodies[a], bodies[b], poses[a])]
        if there:
            one, a = min(there, key=lambda one: (-round(one[0].walls[-1], 12), one[0].depth))
            return _fit(_Seat(one, depth, one.material.high - one.depth), a == 1, 1)
        if _is_locked(*bodies, seated):
            message = "it is clear in its seat, but no straight way leads there: an undercut (thread, snap or bayonet)"
            raise GeometryError(message, "name files of one part each, to have another fit found")
    # A solid is led against z of its frame, and z of an opening looks out of it.
    solids = [[Led(Layers(bodies[a], search.upright(z))) for z in _ways(bodies[a], stated[a])] for a, _ in roles]
    others = [[Layers(bodies[b], search.upright(z)) for z in _ways(bodies[b], stated[b])] for _, b in roles]
    ways = list(zip(solids, others, strict=True))
    found = list[tuple[Candidate, int]]()
    for closed in (True, False):
        for (a, b), way in zip(roles, ways, strict=True):
            frames = stated[b].frames
            found += [(one, a) for one in search.candidates(*way, closed, bool(frames)) if _is_stated(one, frames)]
        if any(abs(one.clearance) < _FITS * one.width and one.walls[-1] > 0.0 for one, _ in found):
            break
    every = [one for one, _ in found]
    best = _best([one for one in every if one.twin is None])
    if not best:
        raise _no_fit(every)
    seats = [_Seat(one, depth) for one in _places(best)]
    chosen = _first(seats, depth)
    side = next(a for one, a in found if one.led is chosen.candidate.led)
    like = [seat for seat in seats if abs(seat.clearance - chosen.clearance) <= _EQUALLY]
    feet = list[Array]()
    for foot in chain.from_iterable(seat.all_feet(every) for seat in like if seat.other is chosen.other):
        if all(float(np.linalg.norm(foot - other)) > _FITS * chosen.candidate.width for other in feet):
            feet.append(foot)
    return _fit(chosen, side == 1, max(len(feet), 1))


def _is_stated(one: Candidate, frames: Sequence[Pose]) -> bool:
    """Whether an opening is in the frame of a hollow feature that is stated, if any is."""
    at = [one.material.turn @ frame.p for frame in frames if one.material.turn[2] @ frame.R[:, 2] > 1.0 - _LITTLE]
    return not frames or any(one.opening.distance(shapely.Point(point[:2])) <= _SAME for point in at)


def _standing(solid: Polyhedron, other: Polyhedron, pose: Pose) -> Iterator[Candidate]:
    """A solid as it stands in another one, by each direction in which it can be drawn out straight.

    The pose is that of the solid in the frame of the other one.
    """
    for way, at, depth in _ways_out(solid, other, pose):
        led, material, pivot = way.led, way.material, way.pivot
        if depth <= _SAME or way.is_blocked(depth, at, _SAME):
            continue
        for height in reversed(material.middles):
            swept = way.swept(max(height - material.high + depth, INSIDE))
            around = opening_around(material.section(height), moved(swept.shape, pivot, at))
            if around is not None:  # the highest one will do
                where = (led, len(led.swept) - 1, material, height, *around, pivot, at)
                found = Candidate(*where, 0.0, search.width_of(led.swept[-1].shape), depth, ())
                if (area := search.walls(found))[-1] > 0.0:
                    yield replace(found, walls=area)
                break


def _ways_out(solid: Polyhedron, other: Polyhedron, pose: Pose) -> Iterator[tuple[Way, Array, float]]:
    """Straight ways by which a solid may leave another one, its place there (3,), and how deep it stands, m."""
    for out in [*search.directions(other), *(pose.R @ way for way in search.directions(solid))]:
        material = Layers(other, search.upright(out))
        led, shift = Led(Layers(solid, material.turn @ pose.R)), material.turn @ pose.p
        depth = material.high - (led.layers.low + float(shift[2]))
        yield Way(led, material, np.zeros(2)), np.array([shift[0], shift[1], 0.0]), depth


def _is_locked(solid: Polyhedron, other: Polyhedron, pose: Pose) -> bool:
    """Whether two solids are clear of each other but inside of each other's hulls, and no straight way parts them."""
    one, two = (manifold_of(body.vertices, triangulated(body)) for body in (placed(solid, pose), other))
    if (one ^ two).volume() > _LITTLE * _LITTLE * solid.volume or (one.hull() ^ two.hull()).volume() <= 0.0:
        return False
    return all(way.is_blocked(depth, at, _SAME) for way, at, depth in _ways_out(solid, other, pose) if depth > _SAME)


def _ways(body: Polyhedron, stated: Stated) -> list[Array]:
    return [frame.R[:, 2] for frame in stated.frames] or search.directions(body)


def _no_fit(found: Sequence[Candidate]) -> GeometryError:
    """Nothing goes in, with what comes the nearest."""
    message = "nothing of the one goes into an opening of the other"
    if thick := [-one.clearance for one in found if one.clearance < -_SAME]:
        message += f": the nearest is too thick by {1e3 * min(thick):.4g} mm a side"
    return GeometryError(message, f"check the units of both, and that one has an opening for the other; or {DESCRIBE}")


def _best(found: Sequence[Candidate]) -> list[Candidate]:
    """The candidates with the largest area of walls along walls, or as good as that, and their other ends."""
    area = np.array([one.walls for one in found]).reshape(len(found), len(SHARES))
    most = area.max(axis=0, initial=0.0)
    if most[-1] == 0.0:
        return []
    share = int(np.argmax(most > _MOST_OF * most[-1]))
    tied = [one for one in found if one.walls[share] >= (1.0 - _EQUAL) * most[share]]
    free = [one for one in found if one.walls[-1] > _HALF * most[share] and 0.0 < one.clearance < _CLOSE * one.width]
    if free and all(one.clearance <= 0.0 for one in tied):
        tied = [one for one in free if one.walls[-1] >= (1.0 - _EQUAL) * max(one.walls[-1] for one in free)]
    others = [one for one in found if one.walls[share] > _OTHER_END * most[share] and one not in tied]
    ends = [one for one in others if any(one.led is not two.led and _same_opening(one, two) for two in tied)]
    return [*tied, *ends]


def _places(found: Sequence[Candidate]) -> list[Candidate]:
    """Of each pair of directions and place the candidate with the most room; of one that interferes, three."""
    kept = list[Candidate]()
    for one in sorted(found, key=lambda one: -round(one.clearance, 9)):
        alike = [other for other in kept if one.led is other.led and one.material is other.material]
        there = [other for other in alike if _same_opening(one, other)]
        if len(there) < (1 if one.clearance > 0.0 or (there and there[0].clearance > 0.0) else _INTERFERING):
            kept.append(one)
    return kept


def _same_opening(one: Candidate, other: Candidate) -> bool:
    """Whether two candidates are on one line through the material, and one line of the solid, whatever end leads."""
    across = abs(float(one.material.turn[2] @ other.material.turn[2]))
    own = abs(float(one.led.layers.turn[2] @ other.led.layers.turn[2]))
    apart = (float(np.linalg.norm(a - b)) for a, b in zip(one.feet, other.feet, strict=True))
    return min(own, across) > 1.0 - _LITTLE and max(apart) < _FITS * one.width


class _Seat:
    """A candidate at its seat: as deep as the straight way goes, or as a goal states, where it has the most room."""

    def __init__(self, candidate: Candidate, depth: float | None = None, tip: float | None = None) -> None:
        """Seat it with its tip at a depth below the mouth, m, else at the height `tip`, m, else at the first stop."""
        self.candidate, self.own, self.other = candidate, candidate.led.layers, candidate.material
        self.way = Way(candidate.led, candidate.material, candidate.pivot)
        self.at, self.clearance = candidate.at, candidate.clearance
        before = math.inf
        for _ in range(_ROUNDS):
            self._go_down(depth, tip)
            if abs(self.tip - before) <= _EXACT:
                break
            before, pairs = self.tip, self.way.pairs(self.other.high - self.tip)
            if not pairs:  # stuck before it is in
                self.clearance = -candidate.width
                break
            self.clearance, self.at = most_room(
                pairs, self.way.pivot, self.at, candidate.width, candidate.closed, _FINE
            )

    def _go_down(self, stated: float | None, tip: float | None) -> None:
        """Height of the tip, of the mouth and of the far end of the opening, m, and whether it is open there."""
        depth, self.stopped = self.way.stop(self.at, max(-self.clearance, 0.0)) if tip is None else (0.0, True)
        self.tip = self.other.high - depth if tip is None else tip
        self.mouth, self.bottom, self.through = self._run()
        long = self.own.high - self.own.low
        if tip is None and self.through and self.tip < self.bottom - _SAME and not (self.stopped and self._has_head()):
            self.tip = self.bottom if self.stopped else max(self.bottom, self.mouth - long)
            self.stopped = False
        if stated is not None:
            self.tip = self.mouth - stated

    def _has_head(self) -> bool:
        """Whether what stops it rests on the rim of the mouth."""
        over = self._put(self.own.section(self.own.low + self.mouth - self.tip + _BESIDE).shape)
        under = self.other.section(self.mouth - _BESIDE).shape
        return bool(common(under, over) > _SAME * under.length)

    def _put(self, shape: BaseGeometry) -> BaseGeometry:
        return moved(shape, self.way.pivot, self.at)

    def _run(self) -> tuple[float, float, bool]:
        thin = _NOISE * (self.other.high - self.other.low)
        slabs = [(float(a), float(b)) for a, b in pairwise(self.other.bounds) if b - a > thin]
        top = bottom = next(k for k, (a, b) in enumerate(slabs) if a <= self.candidate.height <= b)
        while top + 1 < len(slabs) and self.opening(0.5 * sum(slabs[top + 1])) is not None:
            top += 1
        while bottom > 0 and self.opening(0.5 * sum(slabs[bottom - 1])) is not None:
            bottom -= 1
        if bottom == 0:
            return slabs[top][1], slabs[0][0], True
        first = self._put(self.way.swept(INSIDE).shape)
        below = self.other.section(0.5 * sum(slabs[bottom - 1])).shape
        return slabs[top][1], slabs[bottom][0], bool(common(below, first) < _LITTLE * first.area)

    @cached_property
    def seated(self) -> Candidate:
        """The candidate where it is seated."""
        return replace(self.candidate, at=self.at, clearance=self.clearance, depth=self.other.high - self.tip)

    def all_feet(self, found: Iterable[Candidate]) -> Iterator[Array]:
        """Where it passes the origin of the material's model (3,), m, and where its shifted copies do."""
        yield self.seated.feet[0]
        for one in found:
            if one.twin is self.candidate:
                yield self.seated.feet[0] + self.other.turn[:2].T @ (one.at - self.candidate.at)[:2]

    @cached_property
    def walls(self) -> tuple[float, ...]:
        """Area of its walls that run along walls, m²."""
        return search.walls(self.seated)

    def opening(self, height: float) -> shapely.Polygon | None:
        """The opening at a height, m, that holds what sweeps by there; None where it is wide, or there is none."""
        swept = self.way.swept(max(height - self.tip, INSIDE)).shape
        around = opening_around(self.other.section(height), self._put(swept))
        return None if around is None else around[0]

    def angle_at(self, at: Array) -> float:
        """How far the solid's model would be turned against the other one's, rad."""
        cosine = 0.5 * (float(np.trace(self.other.turn.T @ exp([0.0, 0.0, at[2]]) @ self.own.turn)) - 1.0)
        return math.acos(min(max(cosine, -1.0), 1.0))

    @property
    def rank(self) -> tuple[float, ...]:
        """How the solid's model is turned, and where the opening looks."""
        return (round(self.angle_at(self.at), 6), *(-np.round(self.other.turn[2][::-1], 6)).tolist())

    @cached_property
    def rim(self) -> float:
        """Area of the opening in its mouth, m²."""
        opening = self.opening(self.mouth - INSIDE)
        return self.candidate.opening.area if opening is None else float(opening.area)

    @cached_property
    def end(self) -> float:
        """Area of the end that leads, m²."""
        return float(self.own.section(self.own.low + INSIDE).shape.area)


def _first(seats: Sequence[_Seat], depth: float | None) -> _Seat:
    """The seat in the opening with the least room, of those with the most walls, at the end with the most room there.

    Of equals the deepest, then that with the smaller end first, then into the wider mouth, then the least turned one.
    """
    most = max(seat.walls[-1] for seat in seats)
    groups = list[list[_Seat]]()
    for seat in seats:
        if seat.walls[-1] > _OTHER_END * most or not most:
            there = [group for group in groups if _same_opening(group[0].candidate, seat.candidate)]
            groups += [] if there else [[]]
            (there or groups[-1:])[0].append(seat)
    # Sections across an oblique way may leave less room by accident, along fewer walls.
    walled = [group for group in groups if max(seat.walls[-1] for seat in group) >= (1.0 - _EQUAL) * most]
    goes_in = any(seat.clearance > 0.0 for group in walled for seat in group)
    roomy = [_roomiest(group) for group in (walled if goes_in else groups)]
    free = [seat for seat in roomy if seat.clearance > 0.0]
    best = min(free, key=lambda seat: seat.clearance) if free else max(roomy, key=lambda seat: seat.clearance)
    near = sorted((seat for group in groups for seat in group), key=lambda seat: seat.clearance)
    roomiest = {(id(seat.own), id(seat.other)): seat for seat in near if abs(seat.clearance - best.clearance) <= _SAME}
    left = [*roomiest.values()]
    deepest = max(seat.mouth - seat.tip for seat in left)
    left = [seat for seat in left if seat.mouth - seat.tip >= deepest - _SAME]
    smallest = min(seat.end for seat in left)
    left = [seat for seat in left if seat.end <= smallest * (1.0 + _LITTLE)]
    widest = max(seat.rim for seat in left)
    left = [seat for seat in left if seat.rim >= widest * (1.0 - _LITTLE)]
    return min((_best_turned(seat, depth) for seat in left), key=lambda seat: seat.rank)


def _roomiest(group: Sequence[_Seat]) -> _Seat:
    """The seat with the most room among those of one opening that have most of the walls, and go in if any does."""
    free = [seat for seat in group if seat.clearance > 0.0] or group
    most = max(seat.walls[-1] for seat in free)
    return max((seat for seat in free if seat.walls[-1] >= _MOSTLY * most), key=lambda seat: seat.clearance)


def _best_turned(seat: _Seat, depth: float | None) -> _Seat:
    """A seat at the turn with the most room, of those that leave as much the one that turns the solid the least."""
    one = seat.candidate
    swept, material = one.led.swept[one.slab], one.material.section(one.height)
    placed = [*search.placements(swept, material, one.opening, one.pivot, _EXACT, every=True)]
    most = max((clearance for clearance, _ in placed), default=one.clearance)
    roomy = [other for other in placed if other[0] > max(most, one.clearance) - _EQUALLY]
    for clearance, at in sorted(roomy, key=lambda other: seat.angle_at(other[1]))[:_TRIES]:
        if most <= one.clearance + _EQUALLY and seat.angle_at(at) > seat.angle_at(seat.at) - _NEAR:
            break
        tried = _Seat(replace(one, at=at, clearance=clearance), depth)
        alike = np.allclose(tried.walls, seat.walls, rtol=_EQUAL, atol=0.0) and abs(tried.tip - seat.tip) <= _SAME
        if alike and tried.clearance >= seat.clearance - _EQUALLY:
            return tried
    return seat


def _fit(seat: _Seat, exchanged: bool, alike: int) -> FoundFit:
    own, other, one = seat.own, seat.other, seat.candidate
    depth = seat.mouth - seat.tip
    opening = seat.opening(0.5 * (seat.mouth + max(seat.bottom, seat.tip)) + INSIDE) or one.opening
    corners = np.array(orient(opening).exterior.coords)[:-1]
    swept = moved(largest(one.led.swept[one.slab].shape), one.pivot, seat.at)
    middle = centre(corners)
    if not swept.convex_hull.contains(shapely.Point(middle)):  # of an opening that is longer than what goes in
        middle = centre(np.array(orient(swept).exterior.coords)[:-1])
    if is_round(corners):  # along the model's axis that lies the most across
        across = other.turn[:2].T
        far = np.hypot(*across.T)
        x = max(across[far > 0.5] / far[far > 0.5, None], key=lambda d: np.round(other.turn[:2].T @ d, 6).tolist())
    else:
        x = axis(corners, other.turn[:2])
    R = other.turn.T @ np.array([[x[0], -x[1], 0.0], [x[1], x[0], 0.0], [0.0, 0.0, 1.0]])
    hollow = _clean(other.turn.T @ np.append(middle, seat.mouth), R)
    turn = exp([0.0, 0.0, seat.at[2]])
    shift = np.append(seat.at[:2] - turn[:2, :2] @ one.pivot, seat.tip - own.low)
    seated = Pose(other.turn.T @ shift, other.turn.T @ turn @ own.turn).inverse().compose(hollow)
    tip = seated.compose(Pose(np.array([0.0, 0.0, -depth]), np.eye(3)))
    hole = max(seat.mouth - seat.bottom, 0.0 if seat.through else depth)
    peg = depth if seat.stopped and depth < hole - _SAME else max(own.high - own.low, depth)
    return FoundFit(exchanged, _clean(tip.p, tip.R), hollow, seat.clearance, depth, hole, peg, seat.through, alike)


def _clean(point: Array, R: Array) -> Pose:
    """A pose with whole nanometres, and entries of its rotation that are 0 or ±1 but for rounding just that."""
    kept = np.where(np.abs(R) < _ANGLE, 0.0, R)
    x = kept[:, 0] / np.linalg.norm(kept[:, 0])
    z = kept[:, 2] - (kept[:, 2] @ x) * x
    z /= np.linalg.norm(z)
    return Pose(np.round(point, _NANO) + 0.0, np.column_stack([x, np.cross(z, x), z]) + 0.0)
