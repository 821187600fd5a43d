"""Bodies with faces level with one axis or upright on it, as a convex prism less convex prisms.

From each level to the next there is one outline. What the convex hull of all of them has too much there comes apart
exactly, see `convex_polygons`, where cuts through a body would each leave their rounding.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from fractions import Fraction
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from fmopt.errors import GeometryError
from fmopt.geometry.plane.convex_polygons import Convex, convex_pieces, slabs
from fmopt.geometry.polyhedron import Polyhedron, extruded
from fmopt.spatial.values import Array

if TYPE_CHECKING:
    from shapely import Polygon
    from shapely.geometry.base import BaseGeometry

_UPRIGHT = 1e-9  # rad: walls lean less

_Point = tuple[float, float]


class Prisms(NamedTuple):
    """A body as a prism less others."""

    base: Polyhedron  # convex
    # Convex, floor and roof the first of their faces; those at one height overlap, those of neighbouring levels share
    # faces
    tools: list[Polyhedron]


def upright_prisms(body: Polyhedron, thin: float = 0.0) -> Prisms | None:
    """A body as the fewest prisms; None where its faces have no axis in common along which no section is nested.

    Its corners above each other or on one level agree to the bit. What it lacks no thicker than `thin` (m) it has.
    """
    found = []
    for axis in upright_axes(body.normals):
        with suppress(GeometryError):  # a body with such a section comes apart along another axis, or by cuts
            found.append(_as_prisms(body, axis, thin))
    return min(found, key=lambda prisms: len(prisms.tools), default=None)


def upright_axes(normals: Array) -> list[int]:
    """The axes of coordinates that faces with unit normals (n, 3) are all level with, or upright on."""
    along = np.abs(normals)
    return np.flatnonzero(np.all((along <= _UPRIGHT) | (along >= 1.0 - _UPRIGHT), axis=0)).tolist()


def _as_prisms(body: Polyhedron, axis: int, thin: float) -> Prisms:
    """See `upright_prisms`; refuses sections that touch themselves, or have one piece within another."""
    from shapely import MultiPoint

    levels = np.unique(body.vertices[:, axis]).tolist()
    # Rolled to the front and dropped, the axis leaves the two that follow it, seen from its positive side.
    whole = _convex(MultiPoint(np.delete(np.roll(body.vertices, -axis, axis=1), 0, axis=1)).convex_hull)
    tools = [
        extruded([piece.outline], low, high, axis)
        for low, high in pairwise(levels)
        for piece in _lacking(whole, _section(body, axis, 0.5 * (low + high)), thin)
    ]
    return Prisms(extruded([whole.outline], levels[0], levels[-1], axis), tools)


def _lacking(whole: Convex, section: BaseGeometry, thin: float) -> Iterator[Convex]:
    """Convex polygons that make up what a convex polygon has more than a section without pieces within others."""
    from shapely import Polygon, get_parts

    def is_thick(polygon: Polygon) -> bool:
        # A strip has two long sides: its area is half of its outline times its width.
        return bool(2.0 * polygon.area > thin * polygon.length)

    if section.is_empty:  # between two walls that nothing joins
        yield whole
        return
    yield from (slab for slab in slabs(whole, _convex(section.convex_hull)) if is_thick(Polygon(slab.outline)))
    # No sides cross, so that corners are those there are.
    for polygon in get_parts(section.convex_hull.difference(section)):
        if is_thick(polygon):
            if polygon.interiors:
                raise GeometryError("a section has one piece within another")
            yield from convex_pieces(_ring(polygon))


def _ring(polygon: Polygon) -> tuple[_Point, ...]:
    """The corners of its boundary, counter-clockwise."""
    from shapely.geometry.polygon import orient

    return tuple((float(x), float(y)) for x, y in orient(polygon).exterior.coords[:-1])


def _convex(polygon: Polygon) -> Convex:
    corners = tuple((Fraction(x), Fraction(y)) for x, y in _ring(polygon))
    return Convex(corners, (None,) * len(corners))


def _section(body: Polyhedron, axis: int, height: float) -> BaseGeometry:
    """The section at a height, of the coordinates that follow the axis."""
    from shapely import MultiLineString, build_area

    u, v = (axis + 1) % 3, (axis + 2) % 3
    sides: list[tuple[_Point, _Point]] = []
    crossed: list[list[_Point]] = [[] for _ in body.faces]
    for edge in body.edges:
        p, q = body.vertices[list(edge.vertices)]
        # Between levels edges of walls are upright: they cross where their corners are, nothing is interpolated.
        if (p[axis] > height) != (q[axis] > height):
            for number in edge.faces:
                crossed[number].append((float(p[u]), float(p[v])))
    for face, found in zip(body.faces, crossed, strict=True):
        found.sort(key=lambda at: at[1] * face.normal[u] - at[0] * face.normal[v])
        # Between the first crossing and the second there is wall, between the second and the third none.
        sides += zip(found[::2], found[1::2], strict=True)
    return build_area(MultiLineString(sides))
