"""Position nodes of P(t): visible on the expanded cut-diagrams, three where that is enough, [LeeHuang1985] step 3.

A node is in place when none of its projections lies in GE; two nodes see one another when their straight line runs
through GE on none of the planes. On x-z and y-z that is asked of the projections. On the plane of the mouth, x-y, it is
asked of what lies below the mouth: asked of everything, as the paper writes it, no start beside the hole would be in
place, since its projection lies in the block's.

GE belongs to an orientation, and to three planes. Where operand 1 has not the goal's orientation yet another GE holds,
and what the planes do not show is found by `swept`.
"""

import heapq
import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from fmopt.errors import GeometryError
from fmopt.geometry.plane.curve import LineSegment
from fmopt.geometry.plane.region import Region
from fmopt.papers.lee_huang.diagram import of_region
from fmopt.papers.lee_huang.uncertainty_zone import PLANES, BasePlane, PlaneName
from fmopt.spatial.values import Array

_APART = 1e-9  # m: crossings this close to one another are one
RULE = "N_i is not in GE, and N_i is visible to N_(i-1) and N_(i+1)"


@dataclass(frozen=True)
class Sight:
    """Visibility on the three planes' GE, of positions of the nominal centre in the frame of operand 2."""

    expanded: Mapping[PlaneName, Region]

    def blocked_at(self, point: ArrayLike) -> PlaneName | None:
        """A plane on which the projection of a position (3,) lies inside GE; None where it is in place."""
        p = np.asarray(point, dtype=np.float64)
        return self.between(p, p)

    def between(self, one: ArrayLike, other: ArrayLike) -> PlaneName | None:
        """A plane on which the line between two positions (3,), m, runs through GE; None when they are visible."""
        a, b = np.asarray(one, dtype=np.float64), np.asarray(other, dtype=np.float64)
        for plane in PLANES:
            if plane.name in self.expanded:
                # On x-y, the plane of the mouth, only what of the line is below it can be in the way.
                ends = _below(a, b) if plane.v != 2 else (a, b)
                if ends is not None and self._crosses(plane, *ends):
                    return plane.name
        return None

    def clear(self, point: ArrayLike, room: float) -> bool:
        """Whether a position (3,), m, is in place, on x-z and y-z with room (m) around it."""
        p = np.asarray(point, dtype=np.float64)
        upright = [(q, self.expanded[q.name]) for q in PLANES if q.v == 2 and q.name in self.expanded]
        near = [region.distance(p[[plane.u, plane.v]])[0] for plane, region in upright if not region.empty]
        return self.blocked_at(p) is None and min(near, default=math.inf) >= room

    def _crosses(self, plane: BasePlane, a: Array, b: Array) -> bool:
        """Whether the projection has a point inside GE: a middle between neighbouring meetings with its boundary."""
        region = self.expanded[plane.name]
        start, end = a[[plane.u, plane.v]], b[[plane.u, plane.v]]
        length = float(np.linalg.norm(end - start))
        # A point: inside or not, with no line to cut.
        if length <= _APART:
            return bool(region.depth(start)[0] > _APART)
        cuts = np.unique(np.concatenate([[0.0, 1.0], np.clip(region.crossings(LineSegment(start, end)), 0.0, 1.0)]))
        # Between neighbouring crossings the line is inside or outside altogether.
        wide = np.diff(cuts) * length > _APART
        middle = (0.5 * (cuts[1:] + cuts[:-1]))[wide]
        return bool(np.any(region.depth(start + middle[:, None] * (end - start)) > _APART))


@dataclass(frozen=True)
class TurningSight:
    """GE on the planes for the orientation at the start, for all those on the way to the goal's, and for the goal's."""

    starting: Sight
    turning: Sight
    goal: Sight


def _below(a: Array, b: Array) -> tuple[Array, Array] | None:
    """The part of a line that lies below the plane of the mouth."""
    if min(a[2], b[2]) >= 0.0:
        return None
    if max(a[2], b[2]) <= 0.0:
        return a, b
    crossing = a + a[2] / (a[2] - b[2]) * (b - a)
    return (crossing, b) if b[2] < 0.0 else (a, crossing)


def position_nodes(start: ArrayLike, goal: ArrayLike, sight: Sight, room: float = 0.0) -> tuple[Array, ...]:
    """N₁, N₂ on the axis at the mouth, N_T; or, where these do not see one another, the shortest visible path.

    The shortest path leads to N₂, with `room` above the mouth, and from there straight to N_T where it can. It runs
    over positions beside the corners of GE on x-z and y-z, each with the other coordinate of the start, of the axis, or
    of a corner on the other plane, and over the axis at their heights. It is the shortest of these, not of all paths.

    Args:
        start: N₁ (3,) in the B-frame, m.
        goal: N_T (3,).
        sight: GE on the planes, for the goal's orientation.
        room: m, how much the uncertain part needs: the height of N₂ above the mouth, but no more than that of N₁, and
            how far nodes keep from the corners that they lead round.

    Raises:
        GeometryError: N₁ or N_T lies in GE, or no path is visible; names the plane.
    """
    first, last = np.asarray(start, dtype=np.float64), np.asarray(goal, dtype=np.float64)
    _in_place(first, last, sight, sight)
    # N₂ no higher than the start, as nothing is gained above it.
    mouth = np.array([0.0, 0.0, min(room, max(float(first[2]), 0.0))])
    blocked = sight.between(first, mouth) or sight.between(mouth, last)
    if blocked is None:
        return (first, last) if np.array_equal(first, mouth) else (first, mouth, last)
    path = _round_about(first, last, sight, room)
    if path is None:
        raise _no_path(f"plane {blocked} blocks")
    return path


def turning_nodes(
    start: ArrayLike, goal: ArrayLike, sights: TurningSight, room: float = 0.0
) -> tuple[tuple[Array, ...], int]:
    """Nodes of a way from N₁ (3,) to N_T (3,), m, on which operand 1 turns in one place, and the leg of that turn.

    It keeps the orientation of the start up to a place where all orientations on the way to the goal's have room, and
    has the goal's from there to N₂ and along the axis. The shortest over places as for `position_nodes`. The leg has no
    length.

    Raises:
        GeometryError: N₁ or N_T lies in GE, or there is no such way.
    """
    first, last = np.asarray(start, dtype=np.float64), np.asarray(goal, dtype=np.float64)
    _in_place(first, last, sights.starting, sights.goal)
    mouth = np.array([0.0, 0.0, room])
    places = [first]
    for sight in (sights.starting, sights.turning, sights.goal):
        # Places where any of the three diagrams lets a path bend, all of them seen in each.
        places += _candidates(first, last, sight, room)
    free = [sights.turning.clear(place, room) for place in places]
    points, count = [*places, *places, mouth], len(places)

    def visible(one: int, other: int) -> bool:
        if one < count and other < count:
            return sights.starting.between(points[one], points[other]) is None
        if one >= count and other >= count:
            return sights.goal.between(points[one], points[other]) is None
        # Start to goal orientation in one place: the only way from the first copy of the places to the second.
        return other == one + count and free[one]

    path = _shortest(points, visible) if sights.goal.between(mouth, last) is None else None
    if path is None:
        raise _no_path("operand 1 has to turn, and no place on the way leaves room for that")
    leg = next(k for k, (a, b) in enumerate(itertools.pairwise(path)) if np.array_equal(a, b))
    return (*path, last), leg


def _in_place(first: Array, last: Array, before: Sight, after: Sight) -> None:
    """Refuses a start or a goal in GE."""
    for name, node, sight in (("N_1, the start,", first, before), ("N_T, the goal,", last, after)):
        plane = sight.blocked_at(node)
        if plane is not None:
            where = ", ".join(f"{1e3 * value:.6g}" for value in node)
            message = f"{name} at ({where}) mm lies inside GE on the plane {plane}"
            message += ": operand 1 would overlap operand 2 there"
            raise GeometryError(f"{message} (rule: {RULE})", "move it out of the material")


def _no_path(why: str) -> GeometryError:
    message = f"no path over nodes beside the corners of GE leads from the start to the goal; {why}"
    return GeometryError(f"{message} (rule: {RULE})", "start elsewhere, or check the goal against the hole")


def _round_about(first: Array, last: Array, sight: Sight, room: float) -> tuple[Array, ...] | None:
    """The shortest path to N₂, with `room` above the mouth, and along the axis from there where that is free."""
    between = _candidates(first, last, sight, room)
    mouth = np.array([0.0, 0.0, room])
    if sight.between(mouth, last) is None:
        outside = _visible_path([first, *between, mouth], sight)
        if outside is not None:
            return (*outside, last)
    return _visible_path([first, *between, last], sight)


def _visible_path(points: Sequence[Array], sight: Sight) -> tuple[Array, ...] | None:
    return _shortest(points, lambda one, other: sight.between(points[one], points[other]) is None)


def _candidates(first: Array, last: Array, sight: Sight, room: float) -> list[Array]:
    """Positions that a path may bend at, those in place, each once."""
    xz, yz = (bends(sight.expanded[n], room) if n in sight.expanded else np.zeros((0, 2)) for n in ("xz", "yz"))
    heights = (room, first[2], *xz[:, 1], *yz[:, 1])
    # On the axis only below the mouth, or above the room that N₂ keeps.
    axis = [(0.0, 0.0, z) for z in heights if not 0.0 <= z < room]
    beside = [(x, y, z) for x, z in xz for y in (first[1], 0.0, last[1])]
    beside += [(x, y, z) for y, z in yz for x in (first[0], 0.0, last[0])]
    beside += [(x, y, max(a, b)) for (x, a), (y, b) in itertools.product(xz, yz)]
    points = np.unique(np.round(np.array(axis + beside), 12), axis=0)
    return [point for point in points if sight.blocked_at(point) is None]


def bends(region: Region, room: float = 0.0) -> Array:
    """Points (k, 2) beside a region's convex corners, off by `room`, m, and 1e-6 of its size; arcs as polylines."""
    found = of_region(region, 1e-3 * region.size)
    middle, half = found.fans[:, 0] + 0.5 * found.fans[:, 1], 0.5 * found.fans[:, 1]
    # Along the bisector, so that both sides of the corner are kept at a distance of `room`.
    away = (room + 1e-6 * region.size) / np.cos(half)
    return np.asarray(found.points + away[:, None] * np.column_stack([np.cos(middle), np.sin(middle)]))


def _shortest(points: Sequence[Array], visible: Callable[[int, int], bool]) -> tuple[Array, ...] | None:
    """The shortest way from the first to the last point over visible ones, by A*; ties go to fewer nodes."""
    goal = len(points) - 1
    best: dict[int, float] = {0: 0.0}
    before: dict[int, int] = {}
    queue = [(float(np.linalg.norm(points[goal] - points[0])), 0, 0)]
    done: set[int] = set()
    while queue:
        _, count, k = heapq.heappop(queue)
        if k == goal:
            order = [goal]
            while order[-1] in before:
                order.append(before[order[-1]])
            return tuple(points[k] for k in reversed(order))
        if k in done:
            continue
        done.add(k)
        for j in range(1, len(points)):
            length = best[k] + float(np.linalg.norm(points[j] - points[k]))
            # Shorter by more than rounding, so that equal ways keep the first.
            shorter = length < best.get(j, np.inf) - _APART
            if j not in done and shorter and visible(k, j):
                best[j], before[j] = length, k
                heapq.heappush(queue, (length + float(np.linalg.norm(points[goal] - points[j])), count + 1, j))
    return None
