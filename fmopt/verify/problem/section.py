"""The characteristic length of a mating: half the diagonal of the peg's section where it passes the hole closest."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations, pairwise

from fmopt.verify.document import Body

_ON, _APART, _TIE = 1e-12, 1e-9, 1e-11  # m: on a plane; two heights; two gaps that are the same

Flat = tuple[float, float]
Outline = tuple[Flat, ...]


@dataclass(frozen=True)
class _Slice:
    height: float
    side: int
    outlines: tuple[Outline, ...]


def half_diagonals(moving: Sequence[Body], fixed: Sequence[Body], depth: float) -> tuple[float, ...]:
    """Half the diagonals of the peg's sections that pass a section of the hole closest, m; most often all the same.

    Sections are taken at both ends and the middle of each stretch between levels of vertices.

    Args:
        moving: the convex pieces of the part with the peg.
        fixed: those of the part with the hole.
        depth: of the insertion, m.
    """
    pegs, holes = _slices(moving, 0.0, depth), _slices(fixed, -depth, 0.0)
    gaps: dict[tuple[tuple[Outline, ...], tuple[Outline, ...]], float] = {}
    found: list[tuple[float, float]] = []
    for peg in pegs:
        half = 0.5 * max((math.dist(p, q) for p, q in combinations(_hull_points(peg.outlines), 2)), default=0.0)
        for hole in holes:
            ahead = hole.height - (peg.height - depth)
            if ahead > _APART or (abs(ahead) <= _APART and not peg.side > hole.side):
                key = peg.outlines, hole.outlines
                if key not in gaps:
                    gaps[key] = _least_gap(*key)
                found.append((gaps[key], half))
    least = min((gap for gap, _ in found), default=0.0)
    return tuple(half for gap, half in found if gap <= least + _TIE)


def _slices(pieces: Sequence[Body], low: float, high: float) -> list[_Slice]:
    levels = sorted({min(max(p[2], low), high) for piece in pieces for p in piece.vertices} | {low, high})
    heights = levels[:1] + [b for a, b in pairwise(levels) if b - a > _APART]
    found = []
    for bottom, top in pairwise(heights):
        for z, side in ((bottom, 1), (0.5 * (bottom + top), 1), (top, -1)):
            outlines = tuple(outline for piece in pieces if len(outline := _outline(piece, z, side)) >= 3)
            if outlines:
                found.append(_Slice(z, side, outlines))
    return found


def _outline(piece: Body, z: float, side: int) -> Outline:
    """The section of a convex piece at a height, as its limit from above (1) or below (−1): corners in order."""
    heights = [0.0 if abs(p[2] - z) <= _ON else p[2] - z for p in piece.vertices]
    if not any(side * h > 0.0 for h in heights):
        return ()
    points = {(p[0], p[1]) for p, h in zip(piece.vertices, heights, strict=True) if h == 0.0}
    for (loop,) in piece.faces:
        for a, b in zip(loop, loop[1:] + loop[:1], strict=True):
            if a < b and heights[a] * heights[b] < 0.0:
                s = heights[a] / (heights[a] - heights[b])
                p, q = piece.vertices[a], piece.vertices[b]
                points.add((round(p[0] + s * (q[0] - p[0]), 16), round(p[1] + s * (q[1] - p[1]), 16)))
    return _hull(points)


def _hull(points: set[Flat]) -> Outline:
    """The corners of the convex hull, counter-clockwise."""
    ordered = sorted(points)
    halves = []
    for run in (ordered, ordered[::-1]):
        chain: list[Flat] = []
        for p in run:
            while len(chain) > 1 and _turn(chain[-2], chain[-1], p) <= 0.0:
                chain.pop()
            chain.append(p)
        halves.append(chain[:-1])
    return tuple(halves[0] + halves[1])


def _hull_points(outlines: Sequence[Outline]) -> Outline:
    return _hull({p for outline in outlines for p in outline})


def _turn(a: Flat, b: Flat, c: Flat) -> float:
    return (b[0] - a[0]) * (c[1] - b[1]) - (b[1] - a[1]) * (c[0] - b[0])


def _least_gap(peg: Sequence[Outline], hole: Sequence[Outline]) -> float:
    """The distance of two sections; pairs of outlines whose boxes are farther apart than that are passed over."""
    least = math.inf
    pairs = sorted(((_box_gap(one, two), one, two) for one in peg for two in hole), key=lambda pair: pair[0])
    for apart, one, two in pairs:
        if apart >= least:
            break
        least = min(least, _gap(one, two))
    return least


def _box_gap(one: Outline, two: Outline) -> float:
    (a, b), (c, d), (e, f), (g, h) = (
        (pick(p[0] for p in outline), pick(p[1] for p in outline)) for outline in (one, two) for pick in (min, max)
    )
    return math.hypot(max(e - c, a - g, 0.0), max(f - d, b - h, 0.0))


def _gap(one: Outline, two: Outline) -> float:
    """The distance of two convex polygons; 0 where they overlap."""
    if _overlap(one, two):
        return 0.0
    return min(_nearest(one, two), _nearest(two, one))


def _nearest(points: Outline, sides: Outline) -> float:
    return min(_distance(p, a, b) for a, b in zip(sides, sides[1:] + sides[:1], strict=True) for p in points)


def _distance(p: Flat, a: Flat, b: Flat) -> float:
    ux, uy, wx, wy = b[0] - a[0], b[1] - a[1], p[0] - a[0], p[1] - a[1]
    size = ux * ux + uy * uy
    s = min(max((wx * ux + wy * uy) / size, 0.0), 1.0) if size else 0.0
    return math.hypot(wx - s * ux, wy - s * uy)


def _overlap(one: Outline, two: Outline) -> bool:
    """Whether no side of either polygon has all of the other one beyond it."""
    for outline, other in ((one, two), (two, one)):
        for a, b in zip(outline, outline[1:] + outline[:1], strict=True):
            if all(_turn(a, b, p) <= 0.0 for p in other):
                return False
    return True
