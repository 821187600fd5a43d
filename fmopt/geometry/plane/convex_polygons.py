"""Convex polygons, few of them, whose union a simple polygon is.

A polygon that is not convex is its convex hull less its pockets, each of which is its own hull less pockets of its own.
Taking the hull of a pocket away from a convex piece leaves, for each of its sides but the lid, what of the piece lies
beyond that side. Such pieces overlap on purpose: each reaches as far as it can, so that one plane keeps another body
off it. All of it is exact, in fractions, so that the sides of pieces lie in those of the outline; corners that are
none of the outline's are rounded once, at the end.
"""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property, lru_cache
from itertools import compress, pairwise
from typing import TypeAlias

import numpy as np

from fmopt.errors import GeometryError
from fmopt.spatial.values import Array

Point: TypeAlias = tuple[Fraction, Fraction]
Side: TypeAlias = tuple[Point, Point, int | None]
Outline: TypeAlias = tuple[tuple[float, float], ...]

_SLIVER = 1e-9  # of a piece: less is not worth a piece
_NOISE = 1e-12  # of an area
_MANY = 64  # pieces, from which on those that add nothing are dropped while others are cut
_UNSURE = 1e-14  # of the square of the largest coordinate: heights in floats that are larger have the right sign
_LID = -1  # what the side of a pocket is called that lies in the hull


@dataclass(frozen=True)
class Convex:
    """A convex polygon: corners, counter-clockwise, and which side of the outline each side lies in, None for none."""

    corners: tuple[Point, ...]
    sides: tuple[int | None, ...]

    @cached_property
    def outline(self) -> Outline:
        """The corners, rounded to floats."""
        return tuple((float(x), float(y)) for x, y in self.corners)

    @cached_property
    def ends(self) -> tuple[Side, ...]:
        """Its sides: from, to, number."""
        return tuple(zip(self.corners, self.corners[1:] + self.corners[:1], self.sides, strict=True))

    @cached_property
    def area(self) -> Fraction:
        """Its area."""
        return sum((a * d - c * b for (a, b), (c, d), _ in self.ends), Fraction(0)) / 2

    def before(self, ends: Iterable[Side]) -> "Convex | None":
        """What of it lies left of several lines, see `beyond`."""
        body: Convex | None = self
        for end in ends:
            body = None if body is None else body.beyond(*end)
        return body

    def beyond(self, a: Point, b: Point, side: int | None) -> "Convex | None":
        """What of it lies left of the line from a to b, whose part becomes a side of that number; None if nothing."""
        heights = self.heights(a, b)
        if all(height >= 0 for height in heights):
            return self
        if all(height < 0 for height in heights):
            return None
        corners: list[Point] = []
        sides: list[int | None] = []
        count = len(heights)
        for k, (p, h) in enumerate(zip(self.corners, heights, strict=True)):
            q, g = self.corners[(k + 1) % count], heights[(k + 1) % count]
            if h >= 0:
                corners.append(p)
                sides.append(self.sides[k] if h > 0 or g > 0 else side)  # else the line leaves here
            if h * g < 0:
                # The signs may be known from floats alone; where the cut lies is to be exact.
                h, g = _left(a, b, p), _left(a, b, q)
                share = h / (h - g)
                corners.append((p[0] + share * (q[0] - p[0]), p[1] + share * (q[1] - p[1])))
                # On the way out the cut goes on from here, on the way in the rest of side k does.
                sides.append(side if g < 0 else self.sides[k])
        return Convex(tuple(corners), tuple(sides)) if len(corners) > 2 else None

    def heights(self, a: Point, b: Point) -> list[Fraction | float]:
        """For each corner a number with the sign of its height above the line from a to b, left of it positive.

        It is exact where floats leave the sign open: their errors, of the roundings of six coordinates, three
        differences and two products at most 2 M long and 4 M² large, add up to less than 48 · 2⁻⁵³ M² < 1e-14 M², M
        the largest coordinate.
        """
        (ax, ay), (bx, by) = ((float(x), float(y)) for x, y in (a, b))
        x, y = bx - ax, by - ay
        unsure = _UNSURE * max(self.reach, abs(ax), abs(ay), abs(bx), abs(by)) ** 2
        heights = (x * (py - ay) - y * (px - ax) for px, py in self.outline)
        return [h if abs(h) > unsure else _left(a, b, p) for h, p in zip(heights, self.corners, strict=True)]

    @cached_property
    def reach(self) -> float:
        """The largest coordinate of its corners, by size."""
        return max(abs(value) for corner in self.outline for value in corner)


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
        at = reason[reason.find("[") + 1 : -1].split() if "[" in reason else made[0]
        x, y = (1e3 * float(value) + 0.0 for value in at)
        raise GeometryError(
            f"the outline crosses or touches itself at ({x:.6g}, {y:.6g}) mm", "list the corners in order around it"
        )
    if not shape.exterior.is_ccw:
        raise GeometryError("the outline runs clockwise", "list its corners counter-clockwise, seen from above")
    points = [(Fraction(x), Fraction(y)) for x, y in made]
    return tuple(corner for corner, turn in zip(made, _turns(points), strict=True) if turn != 0)


def _pieces(points: tuple[Point, ...]) -> tuple[Convex, ...]:
    """Convex pieces of a simple polygon."""
    hull, pockets = _pockets(points)
    tools = [tool for pocket in pockets for tool in _parted(pocket)]
    found: tuple[Convex, ...] = (hull,)
    whole = hull.area
    for tool in tools:
        # Parts of pockets have no area in common, so that what is left adds up exactly.
        whole -= tool.area
        found = _largest([slab for piece in found for slab in slabs(piece, tool)])
        if len(found) > _MANY:
            found = _few(found, float(whole))
    kept = _few(found, float(whole))
    return _few(_largest([_grown(piece, hull, tools) for piece in kept]), float(whole)) if tools else kept


def _grown(piece: Convex, hull: Convex, tools: Sequence[Convex]) -> Convex:
    """A convex piece as far as it can reach without one of its sides, and so on, clear of all that is taken away."""
    ends = piece.ends
    for number, (start, end, _) in enumerate(ends):
        # What the side keeps off lies between the lines of its neighbours.
        more = hull.before([(end, start, None), ends[number - 1], ends[(number + 1) % len(ends)]])
        if more is None or more.area * 10**9 <= piece.area:
            continue
        body: Convex | None = _joined(piece, number, more)
        for tool in tools:
            body = body if body is None or _is_apart(more, tool) else _clear(body, tool, piece)
        # Larger by `_SLIVER` at least, in integers as areas are fractions.
        if body is not None and body.area * 10**9 > piece.area * (10**9 + 1):
            return _grown(body, hull, tools)
    return piece


def _joined(piece: Convex, number: int, more: Convex) -> Convex:
    """A convex piece with what lies beyond a side of it between the lines of its neighbours."""
    at = more.corners.index(piece.corners[number])
    # The last corner of the one is the end of the side, from which on the other goes on.
    corners, sides = (more.corners[at:] + more.corners[:at])[:-1], (more.sides[at:] + more.sides[:at])[:-1]
    kept = piece.corners[:number] + corners + piece.corners[number + 1 :]
    return _straight(Convex(kept, piece.sides[:number] + sides + piece.sides[number + 1 :]))


def _clear(body: Convex, tool: Convex, kept: Convex) -> Convex | None:
    """The most of a convex polygon that a side of a tool leaves of it, with a part that is to be kept."""
    if _is_apart(body, tool):
        return body
    sides = (tool.ends[k] for k in _beyond(tool, kept) if tool.sides[k] != _LID)
    left = (body.beyond(b, a, side) for a, b, side in sides)
    return max((slab for slab in left if slab is not None), key=lambda slab: slab.area, default=None)


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
    # A simple polygon passes the corners of its hull in the order of the hull.
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
    corners = polygon.corners
    reflex = [k for k, turn in enumerate(_turns(corners)) if turn < 0]
    if not reflex:
        yield polygon
        return
    cuts = []
    for k in reflex:
        (before, _, one), (_, after, other) = polygon.ends[k - 1], polygon.ends[k]
        for back, side in ((before, one), (after, other)):
            at, edge = _ahead(corners, k, back)
            settled = sum(_left(back, corners[k], corners[n]) == 0 for n in reflex)
            square = sum((p - q) ** 2 for p, q in zip(corners[k], at, strict=True))
            cuts.append(((-settled, square), (k, edge, at, side)))
    for part in _cut(polygon, *min(cuts, key=lambda cut: cut[0])[1]):
        yield from _parted(part)


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


def _cut(polygon: Convex, k: int, edge: int, at: Point, side: int | None) -> tuple[Convex, Convex]:
    """Both parts of a polygon that is cut from corner k to a point `at` in the side number `edge`."""
    corners, sides = polygon.corners[k:] + polygon.corners[:k], polygon.sides[k:] + polygon.sides[:k]
    n = (edge - k) % len(corners)
    start = n if corners[n] == at else n + 1
    ahead = Convex((*corners[:start], at), (*sides[:start], side))
    behind = Convex((at, *corners[n + 1 :], corners[0]), (*sides[n:], side))
    return _straight(ahead), _straight(behind)


def _straight(polygon: Convex) -> Convex:
    """A polygon without the corners in which it goes straight on."""
    turns = _turns(polygon.corners)
    return Convex(tuple(compress(polygon.corners, turns)), tuple(compress(polygon.sides, turns)))


def slabs(piece: Convex, tool: Convex) -> Iterator[Convex]:
    """What is left of a convex piece without a convex tool: one polygon for each side of the tool that bounds both."""
    # Sides that the tool cuts get numbers below `_LID`, which no side of an outline has.
    cuts = ((a, b, _LID - 1 - number) for number, (a, b, _) in enumerate(tool.ends))
    common = None if _is_apart(piece, tool) else piece.before(cuts)
    if common is None or common.area == 0:
        yield piece
        return
    for number, (a, b, side) in enumerate(tool.ends):
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
    heights, unsure = _heights(outer, inner)
    if heights.min() < -unsure:
        return False
    near = np.argwhere(heights <= unsure).tolist()
    return all(_left(*outer.ends[k][:2], inner.corners[n]) >= 0 for k, n in near)


def _is_apart(one: Convex, other: Convex) -> bool:
    """Whether two polygons have no area in common."""
    return bool(_beyond(one, other) or _beyond(other, one))


def _beyond(outer: Convex, inner: Convex) -> list[int]:
    """The numbers of the sides of a polygon outside of which another one lies."""
    heights, unsure = _heights(outer, inner)

    def is_beyond(k: int) -> bool:
        near = np.flatnonzero(heights[k] >= -unsure).tolist()
        return all(_left(*outer.ends[k][:2], inner.corners[n]) <= 0 for n in near)

    return [k for k in np.flatnonzero(heights.max(axis=1) <= unsure).tolist() if is_beyond(k)]


def _heights(outer: Convex, inner: Convex) -> tuple[Array, float]:
    """Numbers (n, m) as of `Convex.heights`, of each corner of a polygon above each side of another one.

    Returns:
        They, and by how much floats may be off.
    """
    start, points = np.array(outer.outline), np.array(inner.outline)
    along, ahead = np.roll(start, -1, axis=0) - start, points - start[:, None]
    heights = along[:, :1] * ahead[..., 1] - along[:, 1:] * ahead[..., 0]
    return heights, _UNSURE * max(outer.reach, inner.reach) ** 2


def _few(bodies: Sequence[Convex], whole: float) -> tuple[Convex, ...]:
    """Few of the polygons whose union has an area, chosen by what they add, then by their size; in the order given."""
    from shapely import Polygon

    shapes = [Polygon(body.outline) for body in bodies]
    kept: list[int] = []
    union = Polygon()
    while union.area < (1.0 - _NOISE) * whole:
        gains = [shape.difference(union).area for shape in shapes]
        # Rounded, so that among equal gains size chooses, not rounding.
        best = max(range(len(shapes)), key=lambda k: (round(gains[k] / whole, 9), round(shapes[k].area / whole, 9)))
        if best in kept or gains[best] <= _SLIVER * shapes[best].area:
            break
        kept.append(best)
        union = union.union(shapes[best])
    return tuple(bodies[k] for k in sorted(kept))


def _turns(corners: Sequence[Point]) -> list[Fraction]:
    """How a polygon turns at each corner: positive to the left, 0 straight on."""
    return [_left(corners[k - 1], p, corners[(k + 1) % len(corners)]) for k, p in enumerate(corners)]


def _left(a: Point, b: Point, p: Point) -> Fraction:
    """Positive for a point left of the line from a to b."""
    return (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0])
