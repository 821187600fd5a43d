"""Solids over any simple outline: a stack of outlines with straight walls between neighbours, as few convex pieces."""

from collections import Counter
from collections.abc import Iterator, Sequence
from fractions import Fraction
from itertools import pairwise
from typing import TypeAlias

import numpy as np
from shapely import Polygon

from fmopt.errors import GeometryError
from fmopt.geometry.csg import Hull, Moved, Prism, Ring, Solid, Stack
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
    for below, above in pairwise(levels):
        low, high = below[0], above[0]
        if not high >= low:
            raise GeometryError(f"a section at {1e3 * high:g} mm follows one at {1e3 * low:g} mm", "list them upwards")
        if high > low:
            _require_walls(below, above)
            lofts.append((below, above))
    if not lofts:
        raise GeometryError("the stack has no height", "give sections at two heights")
    parts = tuple(_part(run) for run in _runs(lofts))
    if len(parts) == 1:
        return parts[0]
    return Stack(parts, tuple((_corners(below), _corners(above)) for below, above in lofts))


_Ring: TypeAlias = tuple[float, Outline]


def _corners(*rings: _Ring) -> Ring:
    return tuple((x, y, at) for at, outline in rings for x, y in outline)


def _require_walls(below: _Ring, above: _Ring) -> None:
    (low, lower), (high, upper) = below, above
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


def _runs(lofts: Sequence[tuple[_Ring, _Ring]]) -> Iterator[tuple[_Ring, ...]]:
    """Convex pieces of all lofts as rings one above the other, those that are convex together joined."""
    open_: dict[tuple[int | None, ...], tuple[_Ring, ...]] = {}
    for (low, lower), (high, upper) in lofts:
        ahead: dict[tuple[int | None, ...], tuple[_Ring, ...]] = {}
        for key, below, above in _lofted(lower, upper):
            run, loft = open_.pop(key, ()), ((low, below), (high, above))
            if run and run[-1] == loft[0] and _is_one((*run, loft[1])):
                ahead[key] = (*run, loft[1])
            else:
                if run:
                    yield run
                ahead[key] = loft
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
    found = convex_pieces(lower)
    if len(found) == 1:
        yield found[0].sides, lower, upper
        return
    pieces = [(piece.outline, _between(upper, piece.sides)) for piece in found]
    # Below it holds by construction; half-way as well as above, since walls may cross in between.
    for share in (0.5, 1.0):
        shape, *parts = (
            Polygon((1.0 - share) * np.array(below) + share * np.array(above))
            for below, above in ((lower, upper), *pieces)
            if above
        )
        if len(parts) < len(found) or united(parts).symmetric_difference(shape).area > _AMISS * shape.area:
            raise GeometryError(
                "the outline changes its shape on the way from one section to the next",
                "give sections in between, or unite several stacks",
            )
    for piece, (below, above) in zip(found, pieces, strict=True):
        yield piece.sides, below, above


def _between(outline: Outline, sides: Sequence[int | None]) -> Outline:
    """The convex polygon behind some sides of an outline; no corners where that is none, or has other corners."""
    points = [(Fraction(x), Fraction(y)) for x, y in outline]
    far = 4 * max(abs(value) for point in points for value in point)
    box = Convex(((-far, -far), (far, -far), (far, far), (-far, far)), (None,) * 4)
    cut = box.before((points[side], points[(side + 1) % len(points)], side) for side in sides if side is not None)
    if None in sides or cut is None or Counter(cut.sides) != Counter(sides):
        return ()
    first = cut.sides.index(sides[0])
    return cut.outline[first:] + cut.outline[:first]


def _is_one(rings: Sequence[_Ring]) -> bool:
    """Whether rings one above the other bound one convex solid."""
    from scipy.spatial import ConvexHull

    def hull(rings: Sequence[_Ring]) -> float:
        return float(ConvexHull(_corners(*rings)).volume)

    return hull(rings) <= (1.0 + _NOISE) * sum(map(hull, pairwise(rings)))


def _part(rings: tuple[_Ring, ...]) -> Prism | Hull | Moved:
    (low, lower), (high, upper) = rings[0], rings[-1]
    if len(rings) == 2 and lower == upper:
        prism = Prism(lower, high - low)
        # Placed by `low`, the top must not come out a rounding off the height that was asked for.
        exact = low + (high - low) == high
        if low == 0.0:
            return prism
        if exact:
            return Moved(prism, Pose(np.array([0.0, 0.0, low]), np.eye(3)))
    return Hull(_corners(*rings))
