"""Bodies with faces level with one axis or upright on it, as a convex prism less convex prisms.

From each level to the next there is one outline. What the convex hull of all of them has too much there comes apart
exactly, see `convex_polygons`, where cuts through a body would each leave their rounding.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from fractions import Fraction
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from fmopt.errors import GeometryError
from fmopt.geometry.plane.convex_polygons import Convex, convex_pieces
from fmopt.geometry.polyhedron import Face, Polyhedron, from_faces
from fmopt.spatial.values import Array

if TYPE_CHECKING:
    from shapely import Polygon

_UPRIGHT = 1e-9  # rad: walls lean less
_LEVEL = 1e-12  # m: corners that differ less are on one level

_Point = tuple[float, float]


class Prisms(NamedTuple):
    """A body as a prism less others.

    Attributes:
        axis: that they are along, 0 to 2.
        base: convex.
        tools: convex; those at one height overlap, those of neighbouring levels share faces.
    """

    axis: int
    base: Polyhedron
    tools: list[Polyhedron]


def upright_prisms(body: Polyhedron, thin: float = 0.0) -> Prisms | None:
    """A body as the fewest prisms; None where its faces have no axis in common along which no section is nested.

    Args:
        body: closed; corners above each other agree to the bit.
        thin: what it lacks no thicker than this, m, it counts as having.
    """
    found = []
    for axis in range(3):
        along = np.abs(body.normals[:, axis])
        if np.all((along <= _UPRIGHT) | (along >= 1.0 - _UPRIGHT)):
            with suppress(GeometryError):  # a body with such a section comes apart along another axis, or by cuts
                found.append(_as_prisms(body, axis, thin))
    return min(found, key=lambda prisms: len(prisms.tools), default=None)


def _as_prisms(body: Polyhedron, axis: int, thin: float) -> Prisms:
    """See `upright_prisms`.

    Raises:
        GeometryError: a section touches itself, or has one piece within another.
    """
    from shapely import MultiPoint

    heights = np.unique(body.vertices[:, axis])
    levels = heights[np.append(True, np.diff(heights) > _LEVEL)].tolist()
    whole = _convex(MultiPoint(np.delete(np.roll(body.vertices, -axis, axis=1), 0, axis=1)).convex_hull)
    tools = [
        _prism(piece, axis, low, high)
        for low, high in pairwise(levels)
        for piece in _lacking(whole, _section(body, axis, 0.5 * (low + high)), thin)
    ]
    return Prisms(axis, _prism(whole, axis, levels[0], levels[-1]), tools)


def _lacking(whole: Convex, section: Sequence[Polygon], thin: float) -> Iterator[Convex]:
    """Convex polygons that make up what a convex polygon has more than a section.

    Raises:
        GeometryError: one piece of the section is within another.
    """
    from shapely import Polygon, union_all

    def is_thick(polygon: Polygon) -> bool:
        return bool(2.0 * polygon.area > thin * polygon.length)

    solid = union_all(section)
    hull = _convex(solid.convex_hull)
    for a, b in zip(hull.corners, (*hull.corners[1:], hull.corners[0]), strict=True):
        beyond = whole.beyond(b, a, None)
        if beyond is not None and is_thick(Polygon(beyond.outline)):
            yield beyond
    rest = solid.convex_hull.difference(solid)  # no sides cross, so that corners are those there are
    for polygon in getattr(rest, "geoms", [rest]):
        if is_thick(polygon):
            if polygon.interiors:
                raise GeometryError("a section has one piece within another", "give them as two parts")
            yield from convex_pieces(_ring(polygon))


def _ring(polygon: Polygon) -> tuple[_Point, ...]:
    """The corners of its boundary, counter-clockwise."""
    from shapely.geometry.polygon import orient

    return tuple((float(x), float(y)) for x, y in orient(polygon).exterior.coords[:-1])


def _convex(polygon: Polygon) -> Convex:
    corners = tuple((Fraction(x), Fraction(y)) for x, y in _ring(polygon))
    return Convex(corners, (None,) * len(corners))


def _section(body: Polyhedron, axis: int, height: float) -> list[Polygon]:
    """The section at a height, of the coordinates that follow the axis.

    Raises:
        GeometryError: it touches itself, or one piece is within another.
    """
    from shapely import Polygon

    ahead: dict[_Point, _Point] = {}
    for face in body.faces:
        if abs(face.normal[axis]) < 0.5:
            for start, end in _crossed(body.vertices, face, axis, height):
                if start in ahead:
                    raise GeometryError("a section touches itself", "cut the body apart there")
                ahead[start] = end
    outer: list[Polygon] = []
    inner: list[Polygon] = []
    while ahead:
        start, at = ahead.popitem()
        ring = [start]
        while at != start:
            ring.append(at)
            if at not in ahead:
                raise GeometryError("a section is open", "let corners above each other agree")
            at = ahead.pop(at)
        first = ring.index(min(ring))
        polygon = Polygon([*ring[first:], *ring[:first]])
        (outer if polygon.exterior.is_ccw else inner).append(polygon)
    outer.sort(key=_ring)
    inner.sort(key=_ring)
    made = [Polygon(one.exterior, [ring.exterior for ring in inner if one.contains(ring)]) for one in outer]
    if sum(len(one.interiors) for one in made) != len(inner) or not all(one.is_valid for one in made):
        raise GeometryError("a section has one piece within another", "give them as two parts")
    return made


def _crossed(
    vertices: Array, face: Face, axis: int, height: float
) -> Iterator[tuple[tuple[float, float], tuple[float, float]]]:
    """Where an upright face crosses a height: from, to, the body on the left."""
    u, v = (axis + 1) % 3, (axis + 2) % 3
    found = []
    for loop in face.loops:
        corners = vertices[list(loop)]
        for p, q in zip(corners, np.roll(corners, -1, axis=0), strict=True):
            if (p[axis] > height) != (q[axis] > height):
                found.append((float(p[u]), float(p[v])))
    found.sort(key=lambda at: at[1] * face.normal[u] - at[0] * face.normal[v])
    yield from zip(found[::2], found[1::2], strict=True)


def _prism(piece: Convex, axis: int, low: float, high: float) -> Polyhedron:
    outline = np.array(piece.outline)
    count = len(outline)
    corners = np.vstack([np.column_stack([np.full(count, at), outline]) for at in (low, high)])
    ring = range(count)
    loops: Sequence[Sequence[Sequence[int]]] = [
        [[*reversed(ring)]],
        [[count + k for k in ring]],
        *([[k, (k + 1) % count, count + (k + 1) % count, count + k]] for k in ring),
    ]
    return from_faces(np.roll(corners, axis, axis=1), loops)
