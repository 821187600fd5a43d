"""Regularised union, intersection and difference of regions of exact curves.

Curves are cut where they meet, in closed form. shapely then combines their chords, and the answer is the pieces whose
middles lie on the boundary that shapely finds: straight ones as its corners give them, curved ones as they are. Holes
and islands thinner than the chords tell are left out, and a piece whose chords another one's cross stays chords there.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple, TypeVar

import numpy as np

from fmopt.geometry.plane.chords import CHORD, ROUNDING, chords, enclosed, filled, grid_of
from fmopt.geometry.plane.curve import Arc, Curve, LineSegment, boxes_of
from fmopt.geometry.plane.meet import meet
from fmopt.geometry.plane.region import Region
from fmopt.spatial.values import Array, Indices

if TYPE_CHECKING:
    from shapely.geometry.base import BaseGeometry

T = TypeVar("T")


def union(regions: Sequence[Region]) -> Region:
    """The regularised union of any number of regions."""
    import shapely

    full = [region for region in regions if not region.empty]
    if len(full) < 2:
        return full[0] if full else Region(())
    return _combined(full, lambda shapes, grid: shapely.union_all(shapes, grid_size=grid))


def intersection(first: Region, second: Region) -> Region:
    """The regularised intersection of two regions."""
    if first.empty or second.empty:
        return Region(())
    return _combined([first, second], lambda shapes, grid: shapes[0].intersection(shapes[1], grid_size=grid))


def difference(first: Region, second: Region) -> Region:
    """The regularised difference: the closure of what lies inside `first` and outside `second`."""
    if first.empty or second.empty:
        return first
    return _combined([first, second], lambda shapes, grid: shapes[0].difference(shapes[1], grid_size=grid))


def positive(curves: Sequence[Curve]) -> Region:
    """The regularised set of the points round which curves, in any order, wind at least once."""
    if not curves:
        return Region(())
    scale = _scale(curves)
    (pieces,) = _cut([curves], scale)
    return _region(enclosed([piece.chords for piece in pieces]), pieces, scale)


class _Piece(NamedTuple):
    """A part of a curve between two meetings, and points (k, 2) on it."""

    curve: Curve
    chords: Array


def _combined(regions: Sequence[Region], operator: Callable[[list[BaseGeometry], float], BaseGeometry]) -> Region:
    """What shapely makes of the regions, with a grid to round to, m."""
    scale = _scale([curve for region in regions for curve in region.curves])
    chains = _cut([loop for region in regions for loop in region.loops], scale)
    rings = iter([np.vstack([*(piece.chords[:-1] for piece in chain), chain[0].chords[:1]]) for chain in chains])
    shapes = [filled([next(rings) for _ in region.loops]) for region in regions]
    return _region(operator(shapes, grid_of(scale)), [piece for chain in chains for piece in chain], scale)


def _scale(curves: Sequence[Curve]) -> float:
    return float(np.max(np.abs(boxes_of(curves))))


def _cut(chains: Sequence[Sequence[Curve]], scale: float) -> list[list[_Piece]]:
    """Each chain in pieces, cut where curves meet of which one is curved; straight ones shapely cuts."""
    owned = [(k, part) for k, chain in enumerate(chains) for curve in chain for part in _quarters(curve)]
    stops = _stops([curve for _, curve in owned], ROUNDING * scale)
    parts = [
        (k, curve.part(a, b) if (a, b) != (0.0, 1.0) else curve)
        for (k, curve), at in zip(owned, stops, strict=True)
        for a, b in pairwise(at)
    ]
    found: list[list[_Piece]] = [[] for _ in chains]
    for (k, part), line in zip(parts, _lines([part for _, part in parts], scale), strict=True):
        found[k].append(_Piece(part, line))
    return found


def _region(shape: BaseGeometry, pieces: Sequence[_Piece], scale: float) -> Region:
    """The region whose chords bound a shape."""
    curved = [piece for piece in pieces if not isinstance(piece.curve, LineSegment)]
    rings = _with_corners(_rings(shape, CHORD * scale), pieces, ROUNDING * scale)
    return Region(tuple(joined(_traced(ring, curved, ROUNDING * scale), _join) for ring in rings))


def _quarters(curve: Curve) -> list[Curve]:
    """The curve, an arc in pieces of at most 90°."""
    count = math.ceil(abs(curve.sweep) / (0.5 * math.pi) - 1e-9) if isinstance(curve, Arc) else 1
    return [curve] if count < 2 else [curve.part(k / count, (k + 1) / count) for k in range(count)]


def _stops(curves: Sequence[Curve], tolerance: float) -> list[list[float]]:
    """Parameters from 0 to 1 at which each curve is cut."""
    import shapely

    straight = np.array([isinstance(curve, LineSegment) for curve in curves])
    boxes = shapely.box(*(boxes_of(curves) + 2.0 * tolerance * np.array([-1.0, -1.0, 1.0, 1.0])).T)
    bent = np.flatnonzero(~straight)
    cuts: dict[int, list[float]] = defaultdict(list)
    for i, j in zip(*shapely.STRtree(boxes).query(boxes[bent]).tolist(), strict=True):
        one, other = int(bent[i]), int(j)
        # Of two curved ones each pair comes twice.
        if straight[other] or one < other:
            for s, t in meet(curves[one], curves[other], tolerance):
                cuts[one].append(s)
                cuts[other].append(t)
    found = []
    for k, curve in enumerate(curves):
        slack = 2.0 * tolerance / max(curve.length, tolerance) if cuts[k] else 0.0
        stops = [0.0]
        for t in sorted(cuts[k]):
            if t - stops[-1] > slack and t < 1.0 - slack:
                stops.append(t)
        found.append([*stops, 1.0])
    return found


def _lines(pieces: Sequence[Curve], scale: float) -> list[Array]:
    """Chords (k, 2) of pieces, with one end for all that end together and one line for all that coincide."""
    points = np.array([end for piece in pieces for end in (piece.first, piece.last)])
    label = linked(points, 2.0 * ROUNDING * scale)
    first = np.unique(label, return_index=True)[1]
    known: dict[tuple[int, int], list[Array]] = defaultdict(list)
    found = []
    for piece, (a, b) in zip(pieces, label.reshape(-1, 2).tolist(), strict=True):
        ends = points[first[[a, b]]]
        if isinstance(piece, LineSegment):
            found.append(ends)
            continue
        middle = piece.point(0.5)
        same = known[min(a, b), max(a, b)]
        line = next((one for one in same if math.dist(one[len(one) // 2], middle) <= 4.0 * ROUNDING * scale), None)
        if line is None:
            line = chords(piece, CHORD * scale)
            line[[0, -1]] = ends
            # All in one direction, so that the middle one of an even number of chords is at the same place.
            line = line if a <= b else line[::-1]
            same.append(line)
        found.append(line if a <= b else line[::-1])
    return found


def linked(points: Array, distance: float) -> Indices:
    """A number for each point (n, 2), the same for those that a chain of steps within a distance (m) connects."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    i, j = np.reshape(cKDTree(points).query_pairs(distance, output_type="ndarray"), (-1, 2)).T
    near = coo_array((np.ones(len(i), dtype=bool), (i, j)), shape=(len(points), len(points)))
    return np.asarray(connected_components(near, directed=False)[1], dtype=np.intp)


def _rings(shape: BaseGeometry, thin: float) -> list[Array]:
    """Corners (k, 2) of the rings of a shape, the inside on the left; none of those narrower than `thin`, m."""
    import shapely
    from shapely.geometry.polygon import orient

    found = []
    for part in shapely.get_parts(shape):
        # A line is left where operands touch; it bounds nothing.
        if part.geom_type != "Polygon" or part.is_empty:
            continue
        whole = orient(part)
        for ring in (whole.exterior, *whole.interiors):
            points = shapely.get_coordinates(ring)[:-1]
            x, y = (points - points[0]).T
            area = 0.5 * abs(float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y)))
            if area > 0.5 * thin * ring.length:
                found.append(points)
            elif ring is whole.exterior:
                break
    return found


def _with_corners(rings: Sequence[Array], pieces: Sequence[_Piece], tolerance: float) -> list[Array]:
    """Rings (k, 2) that were rounded to a grid, with chords' ends and crossings of straight pieces as corners again."""
    import shapely
    from scipy.spatial import cKDTree

    if not rings:
        return []
    corners, known = np.vstack(rings), np.vstack([piece.chords for piece in pieces])
    straight = [piece.chords for piece in pieces if isinstance(piece.curve, LineSegment)]
    far, at = cKDTree(known).query(corners, distance_upper_bound=tolerance)
    if straight and np.isinf(far).any():
        known = np.vstack([known, shapely.get_coordinates(shapely.union_all(shapely.linestrings(straight)))])
        far, at = cKDTree(known).query(corners, distance_upper_bound=tolerance)
    corners = np.where(np.isinf(far)[:, None], corners, known[np.minimum(at, len(known) - 1)])
    return np.split(corners, np.cumsum([len(ring) for ring in rings])[:-1])


def _traced(ring: Array, curved: Sequence[_Piece], tolerance: float) -> list[Curve]:
    """The exact curves along a ring (k, 2): those whose ends and middles are corners of it, segments in between."""
    from scipy.spatial import cKDTree

    marks = np.array([line[[0, len(line) // 2, -1]] for _, line in curved]).reshape(-1, 2)
    at = cKDTree(ring).query(marks, distance_upper_bound=tolerance)[1].reshape(-1, 3) if len(marks) else marks
    n = len(ring)
    spans: dict[int, tuple[int, Curve]] = {}
    for (curve, _), row in zip(curved, at, strict=True):
        first, middle, last = row.tolist()
        # A piece that is not on the ring, or no longer than a point.
        if n in (first, middle, last) or first == last:
            continue
        ahead = (middle - first) % n < (last - first) % n
        start, end = (first, last) if ahead else (last, first)
        spans.setdefault(start, (end, curve if ahead else curve.reversed()))
    loop: list[Curve] = []
    origin = min(spans, default=0)
    k = 0
    while k < n:
        here = (origin + k) % n
        if here in spans:
            end, curve = spans[here]
            loop.append(curve)
            k += (end - here) % n or n
            continue
        a, b = ring[here], ring[(here + 1) % n]
        if math.dist(a, b) > tolerance:
            loop.append(LineSegment(a, b))
        k += 1
    return loop


def joined(loop: Sequence[T], join: Callable[[T, T], T | None]) -> tuple[T, ...]:
    """A closed loop with neighbours made one that `join` makes one, beginning at a corner where there is one."""
    made: list[T] = []
    for part in loop:
        merged = join(made[-1], part) if made else None
        if merged is None:
            made.append(part)
        else:
            made[-1] = merged
    # The loop may have begun in the middle of a side.
    if len(made) > 1 and (merged := join(made[-1], made[0])) is not None:
        made = [merged, *made[1:-1]]
    return tuple(made)


def _join(a: Curve, b: Curve) -> Curve | None:
    """One curve for two that continue each other, None when they do not."""
    if isinstance(a, LineSegment) and isinstance(b, LineSegment):
        u, v = b.start - a.start, b.end - b.start
        whole = b.end - a.start
        length = float(np.hypot(*whole))
        off = abs(float(whole[0] * u[1] - whole[1] * u[0]))
        # Also required to go on in the same sense: of two collinear segments one may run back along the other.
        if float(u @ v) > 0.0 and length > 0.0 and off <= 1e-14 * length * length:
            return LineSegment(a.start, b.end)
    if isinstance(a, Arc) and isinstance(b, Arc) and a.sweep * b.sweep > 0.0:
        same = float(np.hypot(*(a.centre - b.centre))) + abs(a.radius - b.radius) <= 1e-14 * a.radius
        sweep = a.sweep + b.sweep
        gap = abs(math.remainder(b.start - a.start - a.sweep, math.tau))
        if same and gap <= 1e-9 and abs(sweep) <= math.tau + 1e-9:
            # A full turn is the most an arc can have; rounding may add to it.
            return Arc(a.centre, a.radius, a.start, math.copysign(min(abs(sweep), math.tau), sweep))
    return None
