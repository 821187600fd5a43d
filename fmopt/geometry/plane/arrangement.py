"""The arrangement of directed curves: split where they meet, equal pieces merged, winding numbers on both sides.

Coincident edges are the normal case: pieces within the tolerance of each other become one edge that remembers how
often each operand runs along it in either direction. Nothing is jittered.

Winding numbers of exact curves: the angles that chords subtend, corrected by caps between chord and arc.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from fmopt.geometry.plane.conic import ConicArc
from fmopt.geometry.plane.curve import Arc, Curve, Segment, boxes_of
from fmopt.geometry.plane.meet import meet
from fmopt.spatial.values import Array

Integers = NDArray[np.intp]
RELATIVE_TOLERANCE = 1e-11

_END = 1e-9  # of a curve's parameter: an extremum so near an end is that end
_BLOCK = 200_000  # points times rows that are looked at in one go, which bounds the memory


@dataclass(frozen=True, eq=False)
class Arrangement:
    """Edges between shared vertices.

    Args:
        vertices: points (n, 2) in m.
        ends: first and last vertex of each edge, (m, 2).
        right: winding number of each operand on the right of each edge, (m, k).
    """

    curves: tuple[Curve, ...]
    vertices: Array
    ends: Integers
    right: Integers
    left: Integers


def tolerance_of(points: Array) -> float:
    """1e-11 of the larger side of the box round `points` (n, 2) and the origin, in m: closer points are one."""
    return RELATIVE_TOLERANCE * float(np.max(np.abs(points), initial=0.0)) if len(points) else 0.0


def arrange(curves: Sequence[Curve], operands: Sequence[int], tolerance: float) -> Arrangement:
    """The arrangement of `curves`.

    Args:
        curves: in any order; each operand's curves form closed loops.
        operands: the operand, 0, 1, …, of each curve.
        tolerance: distance in m below which points are one.
    """
    pieces, owners = [], []
    for curve, operand in zip(curves, operands, strict=True):
        for piece in simple(curve):
            pieces.append(piece)
            owners.append(operand)
    parts, part_owners = _split(pieces, owners, tolerance)
    vertices, ends = _joined(parts, tolerance)
    kept = [k for k in range(len(parts)) if ends[k, 0] != ends[k, 1]]  # no simple piece is closed: others are points
    parts = [Segment(*vertices[ends[k]]) if isinstance(parts[k], Segment) else parts[k] for k in kept]
    count = max(operands, default=0) + 1
    edges, edge_ends, passes = _merged(parts, ends[kept], np.array(part_owners)[kept], count, 4.0 * tolerance)
    right = _windings(edges, vertices, edge_ends, passes)
    return Arrangement(tuple(edges), vertices, edge_ends, right, right + passes)


def touching_boxes(boxes: Array, others: Array, margin: float) -> Integers:
    """Pairs (2, k) of rows of `boxes` and `others` whose boxes come within `margin` of each other, by an R-tree.

    Args:
        boxes, others: (n, 4) and (m, 4), least x and y, greatest x and y, m.
        margin: m, on every side.
    """
    import shapely

    tree = shapely.STRtree(shapely.box(*others.T))
    return np.asarray(tree.query(shapely.box(*(boxes + margin * np.array([-1.0, -1.0, 1.0, 1.0])).T)), dtype=np.intp)


def linked(i: Integers, j: Integers, size: int) -> tuple[Integers, Integers]:
    """Groups of the numbers 0 to `size` − 1 that pairs (k,) link: the group of each number, the first of each group.

    Groups are in the order of their first numbers.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    links = coo_array((np.ones(len(i), dtype=bool), (i, j)), shape=(size, size))
    label = connected_components(links, directed=False)[1].astype(np.intp)
    return label, np.unique(label, return_index=True)[1]


def _split(pieces: list[Curve], owners: list[int], tolerance: float) -> tuple[list[Curve], list[int]]:
    cuts: dict[int, list[float]] = defaultdict(list)
    if pieces:
        boxes = boxes_of(pieces)
        i, j = touching_boxes(boxes, boxes, 2.0 * tolerance)
        once = i < j
        for a, b, s, t in _meetings(pieces, i[once], j[once], tolerance):
            cuts[a].append(s)
            cuts[b].append(t)
    parts: list[Curve] = []
    part_owners: list[int] = []
    for k, piece in enumerate(pieces):
        size = piece.length
        if size <= tolerance:
            continue
        slack = 0.5 * tolerance / size
        stops = [0.0]
        for t in sorted(cuts[k]):
            if t - stops[-1] > slack and t < 1.0 - slack:
                stops.append(t)
        stops.append(1.0)
        for low, high in pairwise(stops):
            parts.append(piece if (low, high) == (0.0, 1.0) else piece.part(low, high))
            part_owners.append(owners[k])
    return parts, part_owners


def _meetings(pieces: list[Curve], i: Integers, j: Integers, tolerance: float) -> list[tuple[int, int, float, float]]:
    straight = np.array([isinstance(piece, Segment) for piece in pieces])
    both = straight[i] & straight[j]
    found = _line_meetings(pieces, i[both], j[both], tolerance)
    for a, b in zip(i[~both].tolist(), j[~both].tolist(), strict=True):
        found += [(a, b, s, t) for s, t in meet(pieces[a], pieces[b], tolerance)]
    return found


def _line_meetings(
    pieces: list[Curve], i: Integers, j: Integers, tolerance: float
) -> list[tuple[int, int, float, float]]:
    """The same as `meet` for many pairs of segments at once."""
    first = np.array([piece.first for piece in pieces])
    along = np.array([piece.last for piece in pieces]) - first
    length = np.hypot(*along.T)
    p, u, lu, q, v, lv = first[i], along[i], length[i], first[j], along[j], length[j]
    found = []
    cross = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]
    skew = np.flatnonzero(np.abs(cross) > 1e-14 * lu * lv)
    d, c = (q - p)[skew], cross[skew]
    s = (d[:, 0] * v[skew, 1] - d[:, 1] * v[skew, 0]) / c
    t = (d[:, 0] * u[skew, 1] - d[:, 1] * u[skew, 0]) / c
    near = (np.abs(s - 0.5) <= 0.5 + tolerance / lu[skew]) & (np.abs(t - 0.5) <= 0.5 + tolerance / lv[skew])
    found.append((i[skew][near], j[skew][near], np.clip(s[near], 0, 1), np.clip(t[near], 0, 1)))
    # The feet of all ends are taken, too: a crossing that rounding moved past an end is found by that end.
    for end in (0.0, 1.0):
        s, close = _foot(p, u, q + end * v, tolerance)
        found.append((i[close], j[close], s[close], np.full(close.sum(), end)))
        t, close = _foot(q, v, p + end * u, tolerance)
        found.append((i[close], j[close], np.full(close.sum(), end), t[close]))
    return [row for rows in found for row in zip(*(column.tolist() for column in rows), strict=True)]


def _foot(start: Array, along: Array, points: Array, tolerance: float) -> tuple[Array, NDArray[np.bool_]]:
    square = np.sum(along**2, axis=1)
    # A segment of no length has its foot at its start, whatever is put in place of the zero.
    t = np.clip(np.sum((points - start) * along, axis=1) / np.where(square > 0.0, square, 1.0), 0.0, 1.0)
    return t, np.linalg.norm(start + t[:, None] * along - points, axis=1) <= tolerance


def _joined(parts: list[Curve], tolerance: float) -> tuple[Array, Integers]:
    """Vertices (n, 2), clusters of end points, and the vertices (m, 2) of each part's ends."""
    from scipy.spatial import cKDTree

    points = np.array([end for part in parts for end in (part.first, part.last)]).reshape(-1, 2)
    pairs = cKDTree(points).query_pairs(2.0 * tolerance, output_type="ndarray") if len(points) else np.zeros((0, 2))
    i, j = np.ascontiguousarray(pairs.T, dtype=np.intp)
    label, first = linked(i, j, len(points))
    return points[first], label.reshape(-1, 2)


def _merged(
    parts: list[Curve], ends: Integers, owners: Integers, count: int, tolerance: float
) -> tuple[list[Curve], Integers, Integers]:
    """Edges without repetition, their ends, and the net passes (m, count) of each operand along each."""
    edges: list[Curve] = []
    edge_ends: list[tuple[int, int]] = []
    passes: list[list[int]] = []
    known: dict[tuple[int, int], list[int]] = defaultdict(list)
    for part, (a, b), owner in zip(parts, ends.tolist(), owners.tolist(), strict=True):
        same = known[min(a, b), max(a, b)]
        # Straight pieces between the same vertices are one; curved ones need a look at their middles.
        middle = None if isinstance(part, Segment) and not same else part.point(0.5)[None]
        for k in same:
            straight = isinstance(part, Segment) and isinstance(edges[k], Segment)
            if straight or (middle is not None and float(edges[k].distance(middle)[0]) <= tolerance):
                # Opposite passes cancel: a wall between two parts that touch is left with none and falls away.
                passes[k][owner] += 1 if edge_ends[k] == (a, b) else -1
                break
        else:
            same.append(len(edges))
            edges.append(part)
            edge_ends.append((a, b))
            passes.append([0] * count)
            passes[-1][owner] = 1
    # What nothing passes bounds nothing; without it no ray meets it either.
    alive = [k for k in range(len(edges)) if any(passes[k])]
    return (
        [edges[k] for k in alive],
        np.array([edge_ends[k] for k in alive], dtype=np.intp).reshape(-1, 2),
        np.array([passes[k] for k in alive], dtype=np.intp).reshape(-1, count),
    )


def _windings(edges: list[Curve], vertices: Array, ends: Integers, passes: Integers) -> Integers:
    """Winding numbers (m, k) on the right of each edge, asked once for every chain of edges."""
    if not edges:
        return passes
    chain, asked = _chains(edges, vertices, ends)
    table = Table.of(edges, vertices[ends[:, 0]], vertices[ends[:, 1]])
    found = table.winding(np.array([edges[k].point(0.5) for k in asked]), passes, np.array(asked))
    return found[chain]  # along a chain nothing branches off, so that winding numbers stay the same


def _chains(edges: list[Curve], vertices: Array, ends: Integers) -> tuple[Integers, list[int]]:
    """The chain of each edge, linked head to tail where just two edges meet, and the longest edge of each chain."""
    size, n = len(edges), len(vertices)
    arriving, leaving = np.bincount(ends[:, 1], minlength=n), np.bincount(ends[:, 0], minlength=n)
    through = (arriving == 1) & (leaving == 1)
    into, out = np.full(n, -1), np.full(n, -1)
    # Later ones overwrite earlier ones: ascending by chord, the longest of each chain is what stays.
    into[ends[:, 1]], out[ends[:, 0]] = np.arange(size), np.arange(size)
    chain, first = linked(into[through], out[through], size)
    longest = np.full(len(first), -1, dtype=np.intp)
    chords = np.linalg.norm(vertices[ends[:, 1]] - vertices[ends[:, 0]], axis=1)
    longest[chain[np.argsort(chords, kind="stable")]] = np.argsort(chords, kind="stable")
    return chain, longest.tolist()


def simple(curve: Curve) -> list[Curve]:
    """The curve in pieces along which x and y both run one way, so that none turns by more than 90°."""
    match curve:
        case Segment():
            return [curve]
        case Arc():
            quarter = 0.5 * math.pi
            low, high = sorted((curve.start, curve.start + curve.sweep))
            turns = range(math.ceil(low / quarter), math.floor(high / quarter) + 1)
            stops = [(k * quarter - curve.start) / curve.sweep for k in turns] if curve.sweep != 0.0 else []
        case ConicArc():
            stops = [*curve.extremum((1.0, 0.0)), *curve.extremum((0.0, 1.0))]
    cuts = [0.0, *sorted(t for t in stops if _END < t < 1.0 - _END), 1.0]
    return [curve] if len(cuts) == 2 else [curve.part(a, b) for a, b in pairwise(cuts) if b > a]


@dataclass(frozen=True, eq=False)
class Table:
    """Simple curves as rational quadratics, one row each: corners (n, 2) in m, weights (n,), no turn for segments."""

    first: Array
    shoulder: Array
    last: Array
    weight: Array
    curved: NDArray[np.bool_]

    @staticmethod
    def of(curves: Sequence[Curve], first: Array | None = None, last: Array | None = None) -> Table:
        """The table of `curves`, with end points (n, 2) that neighbours share when given."""
        rows = [curve.quadratics()[0][2] if not isinstance(curve, Segment) else None for curve in curves]
        if first is None or last is None:
            first = np.array([curve.first for curve in curves]).reshape(-1, 2)
            last = np.array([curve.last for curve in curves]).reshape(-1, 2)
        # A segment gets its own middle as shoulder, with which the same formula runs through it evenly.
        shoulder = np.array(
            [0.5 * (a + b) if row is None else row.shoulder for row, a, b in zip(rows, first, last, strict=True)]
        ).reshape(-1, 2)
        weight = np.array([1.0 if row is None else row.weight for row in rows])
        return Table(first, shoulder, last, weight, np.array([row is not None for row in rows], dtype=bool))

    def winding(self, points: Array, passes: Integers, on: Integers | None = None) -> Integers:
        """Winding numbers (n, k) round `points` (n, 2), each row counted as often as `passes` (m, k) say.

        Args:
            points: m; where rounding decides on which side of a row a point lies, it decides the answer.
            on: (n,), a row on which each point lies, just to the right of which the answer is; None for no such row.
        """
        step = max(1, _BLOCK // max(len(self.weight), 1))
        found = np.zeros((len(points), passes.shape[1]), dtype=np.intp)
        for k in range(0, len(points), step):
            angles = self._angles(points[k : k + step])
            if on is not None:
                row = np.arange(len(angles)), on[k : k + step]
                # From the right every curve subtends a negative angle; a point on it may seem to be on either side.
                angles[row] = np.mod(angles[row], math.tau) - math.tau
            found[k : k + step] = np.rint(angles @ passes / math.tau)
        return found

    def _angles(self, points: Array) -> Array:
        """The angles (n, m) through which one turns to the left who looks along each row from each point, rad."""
        a, b = self.first - points[:, None], self.last - points[:, None]
        angles = np.arctan2(_cross(a, b), np.vecdot(a, b))
        bent = np.flatnonzero(self.curved)
        if bent.size:
            # The chord's angle, once more round in the cap between chord and curve.
            turn = np.sign(_cross(self.shoulder[bent] - self.first[bent], self.last[bent] - self.first[bent]))
            middle, a, b = self.shoulder[bent] - points[:, None], a[:, bent], b[:, bent]
            t0, t2 = turn * _cross(middle, b), turn * _cross(a, middle)
            # The implicit form of the conic, 4 w² τ₀ τ₂ ≥ τ₁², in barycentric coordinates of the control triangle.
            within = (t0 >= 0.0) & (t2 >= 0.0) & (4.0 * self.weight[bent] ** 2 * t0 * t2 >= _cross(a, b) ** 2)
            angles[:, bent] += np.where(within & (turn * angles[:, bent] < 0.0), math.tau * turn, 0.0)
        return np.asarray(angles)


def _cross(a: Array, b: Array) -> Array:
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])
