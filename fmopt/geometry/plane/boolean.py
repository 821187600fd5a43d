"""Regularised union, intersection and difference of regions, from the arrangement of their boundaries."""

import math
from collections import defaultdict
from collections.abc import Callable, Sequence
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from fmopt.errors import GeometryError
from fmopt.geometry.plane.arrangement import Arrangement, Integers, arrange, linked, tolerance_of, touching_boxes
from fmopt.geometry.plane.curve import Arc, Curve, Segment, boxes_of
from fmopt.geometry.plane.region import Region
from fmopt.spatial.values import Array

_FEW = 8  # as many are united at once: fewer pieces to sort than halves of halves would make

Inside: TypeAlias = Callable[[Integers], NDArray[np.bool_]]


def union(regions: Sequence[Region]) -> Region:
    """The regularised union of any number of regions, by divide and conquer over groups that touch."""
    full = [region for region in regions if not region.empty]
    if len(full) < 2:
        return full[0] if full else Region(())
    boxes = np.array([np.concatenate(region.box) for region in full])
    merged = [_divided([full[k] for k in group], boxes[group]) for group in _groups(boxes)]
    return Region(tuple(loop for region in merged for loop in region.loops))


def intersection(first: Region, second: Region) -> Region:
    """The regularised intersection of two regions."""
    if first.empty or second.empty:
        return Region(())
    # Winding numbers, not parity: regions that overlap themselves stay what they are.
    return _combined([first, second], lambda winding: np.asarray(np.all(winding >= 1, axis=1)))


def difference(first: Region, second: Region) -> Region:
    """The regularised difference: the closure of what lies inside `first` and outside `second`."""
    if first.empty or second.empty:
        return first
    # Less than 1 outside the second, so that loops run clockwise, holes of it, give back what they leave.
    return _combined([first, second], lambda winding: (winding[:, 0] >= 1) & (winding[:, 1] < 1))


def positive(curves: Sequence[Curve]) -> Region:
    """The regularised set of the points that closed loops wind round at least once.

    Args:
        curves: the loops' curves, in any order.
    """
    boxes = boxes_of(curves)
    met = arrange(curves, [0] * len(curves), tolerance_of(boxes.reshape(-1, 2)))
    return Region(_loops(met, lambda winding: winding[:, 0] >= 1))


def _groups(boxes: Array) -> list[Integers]:
    """Rows whose boxes touch, directly or through others, in groups."""
    # A hundred times the tolerance: a box too many costs time, one too few would leave an overlap.
    i, j = touching_boxes(boxes, boxes, 1e-9 * float(np.max(np.abs(boxes))))
    label, _ = linked(i, j, len(boxes))
    order = np.argsort(label, kind="stable")
    return [np.asarray(rows, dtype=np.intp) for rows in np.split(order, np.cumsum(np.bincount(label))[:-1])]


def _divided(regions: list[Region], boxes: Array) -> Region:
    if len(regions) == 1:
        return regions[0]
    if len(regions) <= _FEW:
        return _united(regions)
    # Halves by place, along the longer way: what is apart is united apart, and few pieces meet in the end.
    middle = boxes[:, :2] + boxes[:, 2:]
    order = np.argsort(middle[:, int(np.argmax(np.ptp(middle, axis=0)))], kind="stable")
    halves = order[: len(order) // 2], order[len(order) // 2 :]
    return _united([_divided([regions[k] for k in half], boxes[half]) for half in halves])


def _united(regions: list[Region]) -> Region:
    """The union of a few regions; loops that no other region's box touches take no part in the arrangement."""
    loops = [(k, loop) for k, region in enumerate(regions) for loop in region.loops]
    boxes = np.array([_loop_box(loop) for _, loop in loops])
    owner = np.array([k for k, _ in loops])
    region_boxes = np.array([np.concatenate(region.box) for region in regions])
    i, j = touching_boxes(boxes, region_boxes, 1e-9 * float(np.max(np.abs(boxes))))
    apart = np.ones(len(loops), dtype=bool)
    # Only boxes of other regions matter: loops of one region do not cross each other.
    apart[i[owner[i] != j]] = False
    kept = tuple(loop for (_, loop), alone in zip(loops, apart, strict=True) if alone)
    busy = tuple(loop for (_, loop), alone in zip(loops, apart, strict=True) if not alone)
    if not busy:
        return Region(kept)
    return Region(kept + positive([curve for loop in busy for curve in loop]).loops)


def _loop_box(loop: Sequence[Curve]) -> Array:
    boxes = boxes_of(loop)
    return np.concatenate([boxes[:, :2].min(axis=0), boxes[:, 2:].max(axis=0)])


def _combined(regions: Sequence[Region], inside: Inside) -> Region:
    curves = [curve for region in regions for curve in region.curves]
    operands = [k for k, region in enumerate(regions) for _ in region.curves]
    corners = np.array([corner for region in regions for corner in region.box])
    return Region(_loops(arrange(curves, operands, tolerance_of(corners)), inside))


def _loops(met: Arrangement, inside: Inside) -> tuple[tuple[Curve, ...], ...]:
    """Boundary loops of the points whose winding numbers pass `inside`."""
    left, right = inside(met.left), inside(met.right)
    # Boundary is where just one side is inside; the inside is to be on the left, so that others are run backward.
    ahead, back = np.flatnonzero(left & ~right), np.flatnonzero(right & ~left)
    curves = [met.curves[k] for k in ahead] + [met.curves[k].reversed() for k in back]
    ends = np.vstack([met.ends[ahead], met.ends[back][:, ::-1]])
    leaving: dict[int, list[int]] = defaultdict(list)
    for k, vertex in enumerate(ends[:, 0].tolist()):
        leaving[vertex].append(k)
    # At each vertex as many curves arrive as leave, as winding numbers change by what passes: else one was lost to
    # rounding.
    arriving = np.bincount(ends[:, 1], minlength=len(met.vertices))
    for vertex in np.flatnonzero(arriving != np.bincount(ends[:, 0], minlength=len(met.vertices))).tolist():
        x, y = met.vertices[vertex]
        raise GeometryError(
            f"the boundary of a region does not close at ({x:g}, {y:g}) m", "give the curves there more distance"
        )
    following = _following(curves, ends, met.vertices, leaving)
    loops, seen = [], np.zeros(len(curves), dtype=bool)
    for k in range(len(curves)):
        loop = []
        while not seen[k]:
            seen[k] = True
            loop.append(curves[k])
            k = following[k]
        if loop:
            loops.append(_plain(loop))
    return tuple(loops)


def _following(curves: list[Curve], ends: Integers, vertices: Array, leaving: dict[int, list[int]]) -> list[int]:
    """The curve after each one: where several leave a vertex the sharpest turn to the left, so that loops part there.

    Directions are taken on a small circle round the vertex, where curves with a common tangent have come apart.
    """
    after = []
    radii: dict[int, float] = {}
    for vertex, out in leaving.items():
        if len(out) > 1:
            chords = np.linalg.norm(vertices[ends[:, 1]] - vertices[ends[:, 0]], axis=1)
            here = (ends[:, 0] == vertex) | (ends[:, 1] == vertex)
            # Half the shortest chord: within that circle no curve has yet come to its other end, so that the order
            # around the vertex is that of the curves, also where tangents agree.
            radii[vertex] = 0.5 * float(chords[here].min())
    for k, curve in enumerate(curves):
        vertex = int(ends[k, 1])
        out = leaving[vertex]
        if len(out) == 1:
            after.append(out[0])
            continue
        origin = vertices[vertex]
        back = bearing(curve.reversed(), origin, radii[vertex])
        # From the way back counter-clockwise to the next: the smallest is the sharpest turn to the left.
        turns = [math.fmod(back - bearing(curves[m], origin, radii[vertex]) + 2 * math.tau, math.tau) for m in out]
        after.append(out[int(np.argmin(turns))])
    return after


def bearing(curve: Curve, origin: Array, radius: float) -> float:
    """Polar angle (rad) of the point where a simple curve from `origin` (2,) leaves the circle of `radius` round it.

    Args:
        origin: (2,), m.
        radius: m.
    """
    low, high = 0.0, 1.0
    if isinstance(curve, Segment):
        low = high = 1.0
    # 60 halvings come down to the last bit of a parameter between 0 and 1.
    for _ in range(60):
        middle = 0.5 * (low + high)
        if low == high:
            break
        if float(np.hypot(*(curve.point(middle) - origin))) < radius:
            low = middle
        else:
            high = middle
    x, y = curve.point(high) - origin
    return math.atan2(y, x)


def _plain(loop: list[Curve]) -> tuple[Curve, ...]:
    """The loop with collinear segments and arcs of one circle joined, beginning at a corner where there is one."""
    joined: list[Curve] = []
    for curve in loop:
        merged = _join(joined[-1], curve) if joined else None
        if merged is None:
            joined.append(curve)
        else:
            joined[-1] = merged
    # The loop may have begun in the middle of a side.
    if len(joined) > 1:
        merged = _join(joined[-1], joined[0])
        if merged is not None:
            joined = [merged, *joined[1:-1]]
    return tuple(joined)


def _join(a: Curve, b: Curve) -> Curve | None:
    """One curve for two that continue each other, None when they do not."""
    if isinstance(a, Segment) and isinstance(b, Segment):
        u, v = b.start - a.start, b.end - b.start
        whole = b.end - a.start
        length = float(np.hypot(*whole))
        off = abs(float(whole[0] * u[1] - whole[1] * u[0]))
        # Also required to go on in the same sense: of two collinear segments one may run back along the other.
        if float(u @ v) > 0.0 and length > 0.0 and off <= 1e-14 * length * length:
            return Segment(a.start, b.end)
    if isinstance(a, Arc) and isinstance(b, Arc) and a.sweep * b.sweep > 0.0:
        same = float(np.hypot(*(a.centre - b.centre))) + abs(a.radius - b.radius) <= 1e-14 * a.radius
        sweep = a.sweep + b.sweep
        gap = abs(math.remainder(b.start - a.start - a.sweep, math.tau))
        if same and gap <= 1e-9 and abs(sweep) <= math.tau + 1e-9:
            # A full turn is the most an arc can have; rounding may add to it.
            return Arc(a.centre, a.radius, a.start, math.copysign(min(abs(sweep), math.tau), sweep))
    return None
