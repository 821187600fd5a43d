"""Prisms over any simple polygon and stacks of outlines, as unions of convex solids; lengths in m.

A polygon that is not convex is cut by diagonals from corner to corner, so that a piece has the same corners in every
outline of its stack.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from fractions import Fraction
from itertools import pairwise
from typing import Any

from fmopt.verify.problem.quantities import LENGTH
from fmopt.verify.problem.shapes import MOST_CORNERS, Convex, Flat, Point, corners_of
from fmopt.verify.problem.tables import FAR, Table

MOST_SECTIONS, MOST_HOLES, MOST_REFLEX = 64, 64, 200
_PARALLEL = 1e-9  # sine of the angle between sides of neighbouring outlines that are one wall

Outline = tuple[Flat, ...]


def prism(table: Table) -> tuple[tuple[Convex, ...], tuple[Convex, ...]]:
    """The convex solids whose union a prism is, and those of its holes, which stand out of it at both ends.

    Raises:
        ProblemError: a key is missing or wrong.
    """
    outline = simple(table, "polygon", table.items("polygon", 3, MOST_CORNERS))
    height = table.number("height", LENGTH, 1e-9)
    outer = tuple(_lofts(table, "polygon", [(0.0, outline), (height, outline)]))
    cuts: list[Convex] = []
    for i, item in enumerate(table.items("holes", 0, MOST_HOLES) if table.has("holes") else ()):
        hole = simple(table, f"holes[{i}]", item)
        cuts += _lofts(table, f"holes[{i}]", [(-0.5 * height, hole), (1.5 * height, hole)])
    return outer, tuple(cuts)


def stack(table: Table) -> tuple[Convex, ...]:
    """The convex solids whose union a stack of outlines is.

    Raises:
        ProblemError: a key is missing or wrong.
    """
    levels: list[tuple[float, Outline]] = []
    for section in table.tables("sections", MOST_SECTIONS):
        section.only("at", "polygon")
        polygon = simple(section, "polygon", section.items("polygon", 3, MOST_CORNERS))
        levels.append((section.number("at", LENGTH, -FAR), polygon))
    if any(high < low for (low, _), (high, _) in pairwise(levels)) or levels[0][0] == levels[-1][0]:
        raise table.error("sections", "are to be listed from below upwards, at two heights or more")
    return tuple(_lofts(table, "sections", levels))


def simple(table: Table, key: str, items: Any) -> Outline:
    """The corners of a simple polygon, counter-clockwise, without those where it goes straight on.

    Raises:
        ProblemError: it is none.
    """
    corners = corners_of(table, key, items)
    if math.fsum(a * d - b * c for (a, b), (c, d) in zip(corners, corners[1:] + corners[:1], strict=True)) <= 0.0:
        raise table.error(key, "is not counter-clockwise")
    count = len(corners)
    kept = tuple(p for k, p in enumerate(corners) if _left(corners[k - 1], p, corners[(k + 1) % count]) != 0)
    sides = list(zip(kept, kept[1:] + kept[:1], strict=True))
    for i, (a, b) in enumerate(sides):
        for c, d in sides[i + 1 :]:
            if len({a, b, c, d}) == 4 and _cross(a, b, c, d):
                raise table.error(key, "crosses itself")
    return kept


def _lofts(table: Table, key: str, levels: Sequence[tuple[float, Outline]]) -> Iterator[Convex]:
    for (low, lower), (high, upper) in pairwise(levels):
        # Two outlines at one height are a step, with nothing between them.
        if low == high:
            continue
        parallel = len(lower) == len(upper) and all(
            _sine(lower[k - 1], lower[k], upper[k - 1], upper[k]) <= _PARALLEL for k in range(len(lower))
        )
        if not parallel:
            raise table.error(key, "have other corners or sides in other directions one above the other")
        reflex = sum(_left(lower[k - 1], lower[k], lower[(k + 1) % len(lower)]) < 0 for k in range(len(lower)))
        if reflex > MOST_REFLEX:
            raise table.error(key, f"has more than {MOST_REFLEX} reflex corners")
        for piece in _convex(lower, tuple(range(len(lower)))):
            rings: tuple[tuple[Point, ...], ...] = tuple(
                tuple((*outline[k], at) for k in piece) for at, outline in ((low, lower), (high, upper))
            )
            ends = zip(piece[-1:] + piece[:-1], piece, strict=True)
            # Walls are flat by now, those of diagonals need not be: such a piece is hulled.
            flat = all(_sine(lower[a], lower[b], upper[a], upper[b]) <= _PARALLEL for a, b in ends)
            yield Convex(rings if flat else (), rings[0] + rings[1])


def _convex(corners: Outline, piece: tuple[int, ...]) -> Iterator[tuple[int, ...]]:
    """A simple polygon of some corners cut by diagonals into convex ones, by those that settle a corner if any do."""
    count = len(piece)
    points = [corners[k] for k in piece]
    best: tuple[tuple[bool, float], int, int] | None = None
    for v in range(count):
        if _left(points[v - 1], points[v], points[(v + 1) % count]) >= 0:
            continue
        for w in range(count):
            if w in (v, (v + 1) % count, (v - 1) % count) or not _sees(points, v, w):
                continue
            before, after = points[v - 1], points[(v + 1) % count]
            open_ = _left(before, points[v], points[w]) < 0 or _left(points[w], points[v], after) < 0
            rank = (open_, math.dist(points[v], points[w]))
            if best is None or rank < best[0]:
                best = rank, v, w
    if best is None:
        yield piece
        return
    _, v, w = best
    a, b = min(v, w), max(v, w)
    yield from _convex(corners, piece[a : b + 1])
    yield from _convex(corners, piece[b:] + piece[: a + 1])


def _sees(points: Sequence[Flat], v: int, w: int) -> bool:
    """Whether the diagonal from a reflex corner to another one runs inside a polygon."""
    count = len(points)
    a, b = points[v], points[w]
    for k in (v, w):
        before, at, after, other = points[k - 1], points[k], points[(k + 1) % count], b if k == v else a
        ahead, back = _left(at, after, other), _left(before, at, other)
        reflex = _left(before, at, after) < 0
        if not ((ahead > 0 or back > 0) if reflex else (ahead > 0 and back > 0)):
            return False
    for k in range(count):
        ends = {k, (k + 1) % count}
        if not ends & {v, w} and _cross(a, b, points[k], points[(k + 1) % count]):
            return False
    return all(k in (v, w) or not _between(a, b, points[k]) for k in range(count))


def _between(a: Flat, b: Flat, p: Flat) -> bool:
    return _left(a, b, p) == 0 and (p[0] - a[0]) * (p[0] - b[0]) + (p[1] - a[1]) * (p[1] - b[1]) <= 0.0


def _cross(a: Flat, b: Flat, c: Flat, d: Flat) -> bool:
    """Whether two segments share a point."""
    one, two = _sign(_left(a, b, c)), _sign(_left(a, b, d))
    three, four = _sign(_left(c, d, a)), _sign(_left(c, d, b))
    if one * two < 0 and three * four < 0:
        return True
    return _between(a, b, c) or _between(a, b, d) or _between(c, d, a) or _between(c, d, b)


def _sign(x: Fraction) -> int:
    return (x > 0) - (x < 0)


def _left(a: Flat, b: Flat, p: Flat) -> Fraction:
    """Positive for a point left of the line from a to b."""
    # Exactly, as floats are fractions: a corner goes straight on, or it does not.
    (ax, ay), (bx, by), (px, py) = (tuple(map(Fraction, point)) for point in (a, b, p))
    return (bx - ax) * (py - ay) - (by - ay) * (px - ax)


def _sine(a: Flat, b: Flat, c: Flat, d: Flat) -> float:
    """How far a step from a to b is from running the way of one from c to d; 1 or more where it runs the other way."""
    (ux, uy), (vx, vy) = (b[0] - a[0], b[1] - a[1]), (d[0] - c[0], d[1] - c[1])
    size = math.hypot(ux, uy) * math.hypot(vx, vy)
    return abs(ux * vy - uy * vx) / size if ux * vx + uy * vy > 0.0 else 1.0
