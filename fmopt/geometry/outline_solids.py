"""Solids over any simple outline: a stack of outlines with straight walls between neighbours, as few convex pieces."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from fractions import Fraction
from itertools import pairwise
from typing import TypeAlias

import numpy as np

from fmopt.errors import GeometryError
from fmopt.geometry.csg import Hull, Placed, Prism, Solid, Stack
from fmopt.geometry.facets import place
from fmopt.geometry.plane.convex_polygons import Convex, Outline, convex_pieces, simple
from fmopt.geometry.section import united
from fmopt.spatial.se3 import Pose

_PARALLEL = 1e-9  # sine of the angle between sides of neighbouring outlines that are one wall
_AMISS = 1e-9  # of its area: what the pieces of an outline may leave out
_NOISE = 1e-12  # of a volume


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


_Piece: TypeAlias = tuple[tuple[int | None, ...], Outline, Outline]


def _lofted(lower: Outline, upper: Outline) -> Iterator[_Piece]:
    """Convex pieces between two outlines: the sides that they lie behind, and their corners below and above.

    Raises:
        GeometryError: those of neither outline go on as those of the other.
    """
    if lower == upper:
        yield from ((piece.sides, piece.outline, piece.outline) for piece in convex_pieces(lower))
        return
    try:
        made = list(_followed(lower, upper))
    except GeometryError:  # where sides come to lie in one line, only the other outline says how they part
        made = [(sides, below, above) for sides, above, below in _followed(upper, lower)]
    yield from made


def _followed(lower: Outline, upper: Outline) -> Iterator[_Piece]:
    """Convex pieces of one outline, each with what it becomes in the other."""
    from shapely import Polygon

    found = convex_pieces(lower)
    if len(found) == 1:
        yield found[0].sides, lower, upper
        return
    tops = [_between(upper, piece.sides) for piece in found]
    middle = [
        [tuple(0.5 * (a + b) for a, b in zip(p, q, strict=True)) for p, q in zip(one, other, strict=True)]
        for one, other in ((lower, upper), *((p.outline, top) for p, top in zip(found, tops, strict=True) if top))
        if len(one) == len(other)
    ]
    # Below it holds by construction; half-way as well as above, since walls may cross in between.
    for whole, pieces in ((upper, tops), (middle[0], middle[1:])):
        made = united([Polygon(piece) for piece in pieces if piece])
        shape = Polygon(whole)
        if len(pieces) < len(found) or made.symmetric_difference(shape).area > _AMISS * shape.area:
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
    # As words, since None and numbers have no order.
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
        # Placed by `low`, the top must not come out a rounding off the height that was asked for.
        exact = low + (high - low) == high
        if low == 0.0:
            return prism
        if exact:
            return Placed(prism, Pose(np.array([0.0, 0.0, low]), np.eye(3)))
    return Hull(tuple((x, y, at) for at, outline in rings for x, y in outline))
