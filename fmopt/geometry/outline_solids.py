"""Solids over any simple outline: a stack of outlines with straight walls between neighbours, as few convex pieces.

A polygon that is not convex is its convex hull less its pockets, each of which is its own hull less pockets of its own.
Taking the hull of a pocket away from a convex piece leaves, for each of its sides but the lid, what of the piece lies
beyond that side. Such pieces overlap on purpose: each reaches as far as it can, so that one plane keeps another body
off it. All of it is exact, in fractions, so that the sides of pieces lie in those of the outline; corners that are
none of the outline's are rounded once, at the end.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache
from itertools import pairwise
from typing import TypeAlias

import numpy as np

from fmopt.errors import GeometryError
from fmopt.geometry.csg import Hull, Placed, Prism, Solid, Stack
from fmopt.geometry.facets import place
from fmopt.geometry.section import united
from fmopt.spatial.se3 import Pose

Point: TypeAlias = tuple[Fraction, Fraction]
Outline: TypeAlias = tuple[tuple[float, float], ...]

_PARALLEL = 1e-9  # sine of the angle between sides of neighbouring outlines that are one wall
_SLIVER = 1e-9  # of a piece: less is not worth a piece
_NOISE = 1e-12  # of an area or a volume
_MANY = 64  # pieces, from which on those that add nothing are dropped while others are cut
_LID = -1  # what the side of a pocket is called that lies in the hull


@dataclass(frozen=True)
class Convex:
    """A convex polygon: corners, counter-clockwise, and which side of the outline each side lies in, None for none."""

    corners: tuple[Point, ...]
    sides: tuple[int | None, ...]

    @property
    def outline(self) -> Outline:
        """The corners, rounded to floats."""
        return tuple((float(x), float(y)) for x, y in self.corners)

    @property
    def area(self) -> Fraction:
        """Its area."""
        return _area(self.corners)

    def beyond(self, a: Point, b: Point, side: int | None) -> Convex | None:
        """What of it lies left of the line from a to b, whose part becomes a side of that number; None if nothing."""
        heights = [_left(a, b, p) for p in self.corners]
        if min(heights) >= 0:
            return self
        corners: list[Point] = []
        sides: list[int | None] = []
        count = len(heights)
        for k, (p, h) in enumerate(zip(self.corners, heights, strict=True)):
            q, g = self.corners[(k + 1) % count], heights[(k + 1) % count]
            if h >= 0 and (h > 0 or g > 0):
                corners.append(p)
                sides.append(self.sides[k])
            elif h == 0:  # the line leaves here
                corners.append(p)
                sides.append(side)
            if h * g < 0:
                share = h / (h - g)
                corners.append((p[0] + share * (q[0] - p[0]), p[1] + share * (q[1] - p[1])))
                sides.append(side if g < 0 else self.sides[k])
        return Convex(tuple(corners), tuple(sides)) if len(corners) > 2 else None


@lru_cache(maxsize=8)
def convex_pieces(outline: Outline) -> tuple[Convex, ...]:
    """Few convex polygons whose union a simple polygon is, counter-clockwise.

    >>> corners = ((0, 0), (3, 0), (3, 1), (1, 1), (1, 2), (0, 2))
    >>> [piece.outline for piece in convex_pieces(corners)]
    [((0.0, 0.0), (3.0, 0.0), (3.0, 1.0), (0.0, 1.0)), ((0.0, 0.0), (1.0, 0.0), (1.0, 2.0), (0.0, 2.0))]

    Raises:
        GeometryError: it crosses or touches itself, or is clockwise.
    """
    points = tuple((Fraction(x), Fraction(y)) for x, y in simple(outline))
    return _pieces(points)


def simple(outline: Outline) -> Outline:
    """The corners of a simple polygon, counter-clockwise, without those where it goes straight on.

    Raises:
        GeometryError: it crosses or touches itself, goes back on itself, or is clockwise.
    """
    from shapely import Polygon, is_valid_reason

    made = tuple((float(x), float(y)) for x, y in outline)
    if len(made) < 3 or not all(math.isfinite(value) for corner in made for value in corner):
        raise GeometryError(f"an outline has {len(made)} usable corners", "give at least three finite ones")
    shape = Polygon(made)
    if not shape.is_valid or shape.area == 0.0:
        reason = str(is_valid_reason(shape))
        at = reason[reason.find("[") + 1 : -1].split() if "[" in reason else [str(value) for value in made[0]]
        where = place((float(at[0]), float(at[1]), 0.0))
        raise GeometryError(f"the outline crosses or touches itself at {where}", "list the corners in order around it")
    if not shape.exterior.is_ccw:
        raise GeometryError("the outline runs clockwise", "list its corners counter-clockwise, seen from above")
    points = [(Fraction(x), Fraction(y)) for x, y in made]
    turns = zip(points[-1:] + points[:-1], points, points[1:] + points[:1], made, strict=True)
    return tuple(corner for before, point, after, corner in turns if _left(before, point, after) != 0)


def is_convex(outline: Outline) -> bool:
    """Whether a simple polygon, counter-clockwise, is convex."""
    points = [(Fraction(x), Fraction(y)) for x, y in outline]
    return all(
        _left(a, b, c) > 0 for a, b, c in zip(points[-1:] + points[:-1], points, points[1:] + points[:1], strict=True)
    )


def stack(sections: Sequence[tuple[float, Outline]]) -> Solid:
    """The solid of outlines at heights (m), from below upwards, walls straight from each outline to the next.

    Neighbours at different heights have equally many corners and parallel sides, as a prism, a taper or a chamfer has;
    two outlines at one height are a step. Where the solid is convex it is a single primitive.

    Raises:
        GeometryError: an outline is not simple, heights fall, or neighbours do not belong together.
    """
    levels = [(float(at), simple(outline)) for at, outline in sections]
    lofts = []
    for (low, lower), (high, upper) in pairwise(levels):
        if not high >= low:
            raise GeometryError(f"a section at {1e3 * high:g} mm follows one at {1e3 * low:g} mm", "list them upwards")
        if high > low:
            _require_walls(low, lower, high, upper)
            lofts.append((low, lower, high, upper))
    if not lofts:
        raise GeometryError("the stack has no height", "give sections at two heights")
    parts = tuple(_part(run) for run in _runs(lofts))
    if len(parts) == 1:
        return parts[0]
    rings = tuple(
        tuple(tuple((x, y, at) for x, y in outline) for at, outline in ((low, lower), (high, upper)))
        for low, lower, high, upper in lofts
    )
    return Stack(parts, tuple((below, above) for below, above in rings))


_Loft: TypeAlias = tuple[float, Outline, float, Outline]
_Ring: TypeAlias = tuple[float, Outline]


def _require_walls(low: float, lower: Outline, high: float, upper: Outline) -> None:
    where = f"the sections at {1e3 * low:g} and {1e3 * high:g} mm"
    advice = (
        "between two heights an outline keeps its corners and the directions of its sides; put two sections at one "
    )
    advice += "height where it steps"
    if len(lower) != len(upper):
        raise GeometryError(f"{where} have {len(lower)} and {len(upper)} corners", advice)
    one, other = (np.roll(outline, -1, axis=0) - np.array(outline) for outline in (lower, upper))
    size = np.linalg.norm(one, axis=1) * np.linalg.norm(other, axis=1)
    sine = (one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0]) / size
    if np.any(np.abs(sine) > _PARALLEL) or np.any(np.sum(one * other, axis=1) <= 0.0):
        worst = int(np.argmax(np.where(np.sum(one * other, axis=1) > 0.0, np.abs(sine), np.inf)))
        raise GeometryError(f"{where} are not parallel from corner {worst} on, {place((*lower[worst], low))}", advice)


def _runs(lofts: Sequence[_Loft]) -> Iterator[tuple[_Ring, ...]]:
    """Convex pieces of all lofts as rings one above the other, those that are convex together joined."""
    open_: dict[tuple[int | None, ...], tuple[_Ring, ...]] = {}
    for low, lower, high, upper in lofts:
        ahead: dict[tuple[int | None, ...], tuple[_Ring, ...]] = {}
        for key, below, above in _lofted(lower, upper):
            ring = (high, above)
            before = open_.pop(key, None)
            if before is not None and before[-1] == (low, below) and _is_one((*before, ring)):
                ahead[key] = (*before, ring)
                continue
            if before is not None:
                yield before
            ahead[key] = ((low, below), ring)
        yield from open_.values()
        open_ = ahead
    yield from open_.values()


def _lofted(lower: Outline, upper: Outline) -> Iterator[tuple[tuple[int | None, ...], Outline, Outline]]:
    """Convex pieces between two outlines: the sides that they lie behind, and their corners below and above."""
    from shapely import Polygon

    found = convex_pieces(lower)
    if lower == upper:
        yield from ((piece.sides, piece.outline, piece.outline) for piece in found)
        return
    if len(found) == 1:
        yield found[0].sides, lower, upper
        return
    tops = [_between(upper, piece.sides) for piece in found]
    middle = [
        [tuple(0.5 * (a + b) for a, b in zip(p, q, strict=True)) for p, q in zip(one, other, strict=True)]
        for one, other in ((lower, upper), *((p.outline, top) for p, top in zip(found, tops, strict=True) if top))
        if len(one) == len(other)
    ]
    for whole, pieces in ((upper, tops), (middle[0], middle[1:])):
        made = united([Polygon(piece) for piece in pieces if piece])
        shape = Polygon(whole)
        if len(pieces) < len(found) or made.symmetric_difference(shape).area > _SLIVER * shape.area:
            raise GeometryError(
                "the outline changes its shape on the way from one section to the next",
                "give sections in between, or unite several stacks",
            )
    for piece, top in zip(found, tops, strict=True):
        yield piece.sides, piece.outline, top


def _between(outline: Outline, sides: Sequence[int | None]) -> Outline:
    """The convex polygon behind some sides of an outline; no corners where that is none, or has other corners."""
    points = [(Fraction(x), Fraction(y)) for x, y in outline]
    far = 4 * max(abs(value) for point in points for value in point)
    box = Convex(((-far, -far), (far, -far), (far, far), (-far, far)), (None,) * 4)
    for side in sides:
        if side is None:
            return ()
        cut = box.beyond(points[side], points[(side + 1) % len(points)], side)
        if cut is None:
            return ()
        box = cut
    if sorted(map(str, box.sides)) != sorted(map(str, sides)):
        return ()
    first = box.sides.index(sides[0])
    return Convex(box.corners[first:] + box.corners[:first], tuple(sides)).outline


def _is_one(rings: Sequence[_Ring]) -> bool:
    """Whether rings one above the other bound one convex solid."""
    from scipy.spatial import ConvexHull

    apart = sum(_volume(one, other) for one, other in pairwise(rings))
    hull = ConvexHull(np.array([(x, y, at) for at, outline in rings for x, y in outline]))
    return float(hull.volume) <= (1.0 + _NOISE) * apart


def _volume(one: _Ring, other: _Ring) -> float:
    """The volume between two rings of parallel sides, by Simpson's rule, which is exact here."""
    middle = [(0.5 * (a + c), 0.5 * (b + d)) for (a, b), (c, d) in zip(one[1], other[1], strict=True)]
    low, between, high = (_float_area(outline) for outline in (one[1], middle, other[1]))
    return (other[0] - one[0]) * (low + 4.0 * between + high) / 6.0


def _float_area(outline: Sequence[tuple[float, float]]) -> float:
    x, y = np.array(outline).T
    return 0.5 * float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))


def _part(rings: tuple[_Ring, ...]) -> Prism | Hull | Placed:
    (low, lower), (high, upper) = rings[0], rings[-1]
    if len(rings) == 2 and lower == upper:
        prism = Prism(lower, high - low)
        exact = low + (high - low) == high
        if low == 0.0:
            return prism
        if exact:
            return Placed(prism, Pose(np.array([0.0, 0.0, low]), np.eye(3)))
    return Hull(tuple((x, y, at) for at, outline in rings for x, y in outline))


def _pieces(points: tuple[Point, ...]) -> tuple[Convex, ...]:
    """Convex pieces of a simple polygon."""
    hull, pockets = _pockets(points)
    tools = [tool for pocket in pockets for tool in _parted(pocket)]
    found: tuple[Convex, ...] = (hull,)
    whole = hull.area
    for tool in tools:
        whole -= tool.area
        found = _largest([slab for piece in found for slab in _slabs(piece, tool)])
        if len(found) > _MANY:
            found = _few(found, float(whole))
    kept = _few(found, float(whole))
    return _few(_largest([_grown(piece, hull, tools) for piece in kept]), float(whole)) if tools else kept


def _grown(piece: Convex, hull: Convex, tools: Sequence[Convex]) -> Convex:
    """A convex piece as far as it can reach without one of its sides, and so on, clear of all that is taken away."""
    ends = list(zip(piece.corners, piece.corners[1:] + piece.corners[:1], piece.sides, strict=True))
    for number in range(len(ends)):
        body: Convex | None = hull
        for a, b, side in ends[:number] + ends[number + 1 :]:
            body = None if body is None else body.beyond(a, b, side)
        for tool in tools:
            body = None if body is None else _clear(body, tool, piece)
        if body is not None and body.area * 10**9 > piece.area * (10**9 + 1):
            return _grown(body, hull, tools)
    return piece


def _clear(body: Convex, tool: Convex, kept: Convex) -> Convex | None:
    """The most of a convex polygon that a side of a tool leaves of it, with a part that is to be kept."""
    slabs = list(_slabs(body, tool))
    if slabs == [body]:
        return body
    holding = [slab for slab in slabs if _holds(slab, kept)]
    return max(holding, key=lambda slab: slab.area, default=None)


def _pockets(points: tuple[Point, ...]) -> tuple[Convex, list[Convex]]:
    """The convex hull of a polygon, with the corners that lie in its sides, and what it has too much.

    The latter are simple polygons, counter-clockwise, which need not be convex.
    """
    count = len(points)
    order = sorted(range(count), key=lambda k: points[k])
    halves = []
    for run in (order, order[::-1]):
        chain: list[int] = []
        for k in run:
            while len(chain) > 1 and _left(points[chain[-2]], points[chain[-1]], points[k]) <= 0:
                chain.pop()
            chain.append(k)
        halves.append(chain[:-1])
    corners = sorted(halves[0] + halves[1])
    numbers: list[int | None] = []
    pockets: list[Convex] = []
    for a, b in zip(corners, [*corners[1:], corners[0] + count], strict=True):
        start, end = points[a], points[b % count]
        on = [a, *(k for k in range(a + 1, b) if _left(start, end, points[k % count]) == 0), b]
        numbers.append(next((one % count for one, other in pairwise(on) if other == one + 1), None))
        for one, other in pairwise(on):
            if other > one + 1:
                back = [k % count for k in range(other, one - 1, -1)]
                pockets.append(Convex(tuple(points[k] for k in back), (*back[1:], _LID)))
    return Convex(tuple(points[k] for k in corners), tuple(numbers)), pockets


def _parted(polygon: Convex) -> Iterator[Convex]:
    """A simple polygon cut into convex ones, each cut along a side that it prolongs, those first that settle most."""
    corners, count = polygon.corners, len(polygon.corners)
    reflex = [k for k in range(count) if _left(corners[k - 1], corners[k], corners[(k + 1) % count]) < 0]
    if not reflex:
        yield polygon
        return
    best: tuple[tuple[int, Fraction], int, tuple[Point, int], int | None] | None = None
    for k in reflex:
        for back, side in ((corners[k - 1], polygon.sides[k - 1]), (corners[(k + 1) % count], polygon.sides[k])):
            hit = _ahead(corners, k, back)
            settled = sum(_left(back, corners[k], corners[n]) == 0 for n in reflex)
            rank = (-settled, _square(corners[k], hit[0]))
            if best is None or rank < best[0]:
                best = rank, k, hit, side
    assert best is not None
    _, k, (at, edge), side = best
    for one, other in ((k, edge), (edge, k)):
        yield from _parted(_cut_off(polygon, one, other, at, side, k))


def _ahead(corners: tuple[Point, ...], k: int, back: Point) -> tuple[Point, int]:
    """Where the line from a point through corner k meets the boundary next, and the number of the side that it meets.

    The side is the one that starts in the point where that is a corner.
    """
    start, count = corners[k], len(corners)
    run = (start[0] - back[0], start[1] - back[1])
    found: list[tuple[Fraction, int, Point]] = []
    for n in range(count):
        a, b = corners[n], corners[(n + 1) % count]
        if n == k or (n + 1) % count == k:
            continue
        one, other = _left(back, start, a), _left(back, start, b)
        if one * other > 0 or one == other or other == 0:
            continue
        share = one / (one - other)
        at = (a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1]))
        ahead = (at[0] - start[0]) * run[0] + (at[1] - start[1]) * run[1]
        if ahead > 0:
            found.append((ahead, n, at))
    _, edge, at = min(found)
    return at, edge


def _cut_off(polygon: Convex, one: int, other: int, at: Point, side: int | None, k: int) -> Convex:
    """The part of a polygon on one side of a cut from corner k to a point `at` in another side, both in order."""
    count = len(polygon.corners)
    corners: list[Point] = []
    sides: list[int | None] = []
    if one == k:  # from the corner along the boundary to the point, and back
        n = one
        while True:
            corners.append(polygon.corners[n])
            sides.append(polygon.sides[n])
            if n == other:
                break
            n = (n + 1) % count
        if corners[-1] == at:
            sides[-1] = side
        else:
            corners.append(at)
            sides.append(side)
    else:  # from the point along the boundary to the corner, and back
        corners.append(at)
        sides.append(polygon.sides[one])
        n = (one + 1) % count
        while n != k:
            corners.append(polygon.corners[n])
            sides.append(polygon.sides[n])
            n = (n + 1) % count
        corners.append(polygon.corners[k])
        sides.append(side)
    return _straight(Convex(tuple(corners), tuple(sides)))


def _straight(polygon: Convex) -> Convex:
    """A polygon without the corners in which it goes straight on."""
    corners, count = polygon.corners, len(polygon.corners)
    kept = [k for k in range(count) if _left(corners[k - 1], corners[k], corners[(k + 1) % count]) != 0]
    return Convex(tuple(corners[k] for k in kept), tuple(polygon.sides[k] for k in kept))


def _slabs(piece: Convex, tool: Convex) -> Iterator[Convex]:
    """What is left of a convex piece without a convex tool: one polygon for each side of the tool that bounds both."""
    ends = list(zip(tool.corners, tool.corners[1:] + tool.corners[:1], tool.sides, strict=True))
    common: Convex | None = piece
    for number, (a, b, _) in enumerate(ends):
        common = None if common is None else common.beyond(a, b, _LID - 1 - number)
    if common is None or common.area == 0:
        yield piece
        return
    for number, (a, b, side) in enumerate(ends):
        if side != _LID and _LID - 1 - number in common.sides:
            slab = piece.beyond(b, a, side)
            if slab is not None and slab.area > 0:
                yield slab


def _largest(bodies: Sequence[Convex]) -> tuple[Convex, ...]:
    """The polygons that lie in no other one."""
    kept: list[Convex] = []
    for body in sorted(bodies, key=lambda body: -body.area):
        if not any(_holds(other, body) for other in kept):
            kept.append(body)
    return tuple(kept)


def _holds(outer: Convex, inner: Convex) -> bool:
    ends = zip(outer.corners, outer.corners[1:] + outer.corners[:1], strict=True)
    return all(_left(a, b, p) >= 0 for a, b in ends for p in inner.corners)


def _few(bodies: Sequence[Convex], whole: float) -> tuple[Convex, ...]:
    """Few of the polygons whose union has an area, chosen by what they add, then by their size; in the order given."""
    from shapely import Polygon

    shapes = [Polygon(body.outline) for body in bodies]
    kept: list[int] = []
    union = Polygon()
    while union.area < (1.0 - _NOISE) * whole:
        gains = [shape.difference(union).area for shape in shapes]
        best = max(range(len(shapes)), key=lambda k: (round(gains[k] / whole, 9), round(shapes[k].area / whole, 9)))
        if best in kept or gains[best] <= _SLIVER * shapes[best].area:
            break
        kept.append(best)
        union = union.union(shapes[best])
    return tuple(bodies[k] for k in sorted(kept))


def _left(a: Point, b: Point, p: Point) -> Fraction:
    """Positive for a point left of the line from a to b."""
    return (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0])


def _square(a: Point, b: Point) -> Fraction:
    """The square of their distance."""
    return (a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2


def _area(corners: Sequence[Point]) -> Fraction:
    ahead = (*corners[1:], corners[0])
    return sum((a * d - c * b for (a, b), (c, d) in zip(corners, ahead, strict=True)), Fraction(0)) / 2
