"""Boundaries of planar sets {x : gap(x) ≤ r} out of arcs and segments that may lie on them.

Every boundary point of such a set lies on the offset, by r, of one feature of its core: a vertex, an edge, an arc.
These offset curves are cut where they meet, the parts that lie inside the set are dropped, and the rest is chained.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import StrEnum
from itertools import combinations, pairwise

import numpy as np

from fmopt.errors import GeometryError
from fmopt.geometry.plane.boolean import joined, linked
from fmopt.geometry.plane.curve import Arc, LineSegment
from fmopt.geometry.plane.meet import meet
from fmopt.spatial.values import Array

# Of the size: a point closer than this to a curve lies on it. Where that leaves curves open, as two of them are just
# about that close, the next one is tried.
MEETS = (2e-14, 3e-13, 5e-12)
JOIN = 32.0  # times as much: points closer than this are one
INSIDE = 0.2  # times as much: a curve deeper than this is inside
PROBE = 5.0  # times as much: step beside a curve of a set that was not widened by a disc
TURN = 2.0 * math.pi


class Carrier(StrEnum):
    """The circle or line that a part of a boundary lies on, by the names of [BasanezSuarez].

    FAR and NEAR are Cr_M and Cr_m (CCr_M, CCr_m), about the centre of rotation; PLUS and MINUS are Cg_M and Cg_m
    (CCg_M, CCg_m), about a vertex turned by ±ε_φ; FOOT is the additional arc, eqs. (36) and (41); LINE a tangent line.
    """

    FAR = "r_M"
    NEAR = "r_m"
    PLUS = "g_M"
    MINUS = "g_m"
    FOOT = "n"
    LINE = "line"


@dataclass(frozen=True)
class BoundaryPiece:
    """A part of a boundary, the set on its left, and what it lies on."""

    curve: LineSegment | Arc
    on: Carrier


Loop = tuple[BoundaryPiece, ...]


@dataclass(frozen=True)
class _Part:
    """A piece between two nodes of the arrangement."""

    piece: BoundaryPiece
    first: int
    last: int


def moved(loops: tuple[Loop, ...], by: Array) -> tuple[Loop, ...]:
    """The loops, displaced by a vector (2,) in m."""
    return tuple(tuple(BoundaryPiece(piece.curve.moved(np.eye(2), by), piece.on) for piece in loop) for loop in loops)


def outline(
    candidates: Sequence[BoundaryPiece], gap: Callable[[Array], Array], radius: float, size: float
) -> tuple[Loop, ...]:
    """The boundary of {x : gap(x) ≤ radius} as closed loops, the set on their left.

    A set without interior is run round along both its sides. A single point has no boundary curve, hence no loop. `gap`
    is the distance (k,) of points (k, 2) from the core of the set, m; tolerances are relative to the set's size, m.

    Raises:
        GeometryError: the curves do not close, because features are closer than the tolerance without being one.
    """
    # Coarser from try to try: where two curves are just about that far apart either answer may leave a loop open.
    for share in MEETS:
        loops = _outline(candidates, gap, radius, share * size)
        if loops is not None:
            return loops
    message = f"the boundary of an uncertainty set of {size:.6g} m with ε = {radius:.6g} m does not close"
    raise GeometryError(message, "change a deviation by a millionth of it, or set it to zero")


def _outline(
    candidates: Sequence[BoundaryPiece], gap: Callable[[Array], Array], radius: float, tolerance: float
) -> tuple[Loop, ...] | None:
    parts = _split([piece for piece in candidates if piece.curve.length > JOIN * tolerance], tolerance)
    if not parts:
        return ()
    middle = np.array([part.piece.curve.point(0.5) for part in parts])
    step = PROBE * tolerance
    if radius > step:
        # A disc is wide: the middle of a piece is on the boundary, or inside by more than the tolerance.
        kept = gap(middle) >= radius - INSIDE * tolerance
    else:
        # Hardly any disc: beside the curve is asked, as on it distances are all rounding.
        normals = np.array([part.piece.curve.tangent(0.5) for part in parts])[:, ::-1] * (1.0, -1.0)
        kept = gap(middle + step * normals) >= radius + 0.5 * step
    return _chain([part for part, keep in zip(parts, kept, strict=True) if keep], JOIN * tolerance)


def _split(pieces: list[BoundaryPiece], tolerance: float) -> list[_Part]:
    """The pieces cut at all nodes that lie on them; a node is a cluster of points where pieces end or meet."""
    if not pieces:
        return []
    curves = [piece.curve for piece in pieces]
    # All ends and all meetings as nodes; every curve is cut at those that it runs through.
    met = [one.point(t) for one, other in combinations(curves, 2) for t, _ in meet(one, other, tolerance)]
    points = np.array([curve.point(t) for curve in curves for t in (0.0, 1.0)] + met)
    nodes = linked(points, JOIN * tolerance)
    parts = []
    for i, piece in enumerate(pieces):
        t, apart = _nearest(piece.curve, points)
        on = np.flatnonzero((apart <= tolerance) & (nodes != nodes[2 * i]) & (nodes != nodes[2 * i + 1]))
        stops = [(0.0, int(nodes[2 * i]))]
        for k in on[np.argsort(t[on], kind="stable")]:
            if nodes[k] != stops[-1][1]:
                stops.append((float(t[k]), int(nodes[k])))
        stops.append((1.0, int(nodes[2 * i + 1])))
        for (a, first), (b, last) in pairwise(stops):
            if first != last or len(stops) == 2:
                parts.append(_Part(BoundaryPiece(piece.curve.part(a, b), piece.on), first, last))
    return parts


def _chain(parts: list[_Part], tolerance: float) -> tuple[Loop, ...] | None:
    """The parts as closed loops, of two that coincide one; None when they do not close."""
    leaving: dict[int, list[_Part]] = {}
    for part in parts:
        others = leaving.get(part.first, [])
        # Two curves that coincide are one: the other would leave the loop twice.
        if not any(other.last == part.last and _twins(other, part, tolerance) for other in others):
            leaving.setdefault(part.first, []).append(part)
    loops = []
    while leaving:
        start = next(iter(leaving))
        run = [_taken(leaving, start, leaving[start][0])]
        while run[-1].last != start:
            here, arriving = run[-1].last, run[-1].piece.curve
            if here not in leaving:
                return None
            # The sharpest turn to the left, so that loops that share a vertex part there.
            onward = max(leaving[here], key=lambda part: _left_turn(arriving, part.piece.curve))
            run.append(_taken(leaving, here, onward))
        loops.append(joined([part.piece for part in run], lambda one, other: _joined(one, other, tolerance)))
    return tuple(loops)


def _twins(one: _Part, other: _Part, tolerance: float) -> bool:
    a, b = one.piece.curve, other.piece.curve
    along = float(a.tangent(0.5) @ b.tangent(0.5))
    return along > 0.0 and math.hypot(*(a.point(0.5) - b.point(0.5))) <= tolerance


def _taken(leaving: dict[int, list[_Part]], node: int, part: _Part) -> _Part:
    leaving[node].remove(part)
    if not leaving[node]:
        del leaving[node]
    return part


def _left_turn(arriving: LineSegment | Arc, going: LineSegment | Arc) -> float:
    """Turn from one curve into the next, rad, left positive; straight back is the last choice."""
    a, b = arriving.tangent(1.0), going.tangent(0.0)
    turn = math.atan2(a[0] * b[1] - a[1] * b[0], float(a @ b))
    # Straight back counts as the sharpest turn to the right: a tip is gone round only if nothing else goes on.
    return turn if turn < math.pi - 1e-9 else -math.pi


def _joined(one: BoundaryPiece, other: BoundaryPiece, tolerance: float) -> BoundaryPiece | None:
    a, b = one.curve, other.curve
    if one.on is not other.on:
        # Only pieces of one carrier are joined: what bounds the set is part of the answer.
        return None
    if isinstance(a, LineSegment) and isinstance(b, LineSegment):
        if (a.end - a.start) @ (b.end - b.start) <= 0.0:
            return None
        whole = LineSegment(a.start, b.end)
        _, bend = _nearest(whole, a.end[None])
        return BoundaryPiece(whole, one.on) if bend[0] <= tolerance else None
    if isinstance(a, Arc) and isinstance(b, Arc):
        same = math.hypot(*(a.centre - b.centre)) + abs(a.radius - b.radius) <= tolerance
        if same and a.sweep * b.sweep > 0.0 and abs(a.sweep + b.sweep) <= TURN + 1e-9:
            return BoundaryPiece(Arc(a.centre, a.radius, a.start, a.sweep + b.sweep), one.on)
    return None


def _nearest(curve: LineSegment | Arc, points: Array) -> tuple[Array, Array]:
    """Parameters (k,) of the curve's points nearest to the points (k, 2), and their distances in m."""
    t = curve.nearest(points)
    return t, np.hypot(*(points - curve.point(t)).T)
