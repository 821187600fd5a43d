"""Planar parts as solids: a motion in the x, z plane, turning about y, taken to space without changing its contacts.

A fixed part is extruded along y. A moving part is a ridge: its profile at y = 0, drawn in towards both ends, so that in
planar motion it touches with the profile alone. A planar contact of a vertex with an edge is then one contact of a
vertex with a face, or of two crossing edges, not of two vertices at once; and as every point that touches lies at
y = 0, drift out of the plane moves no contact to first order. Two profiles overlap exactly when the solids do.
Lengths are in m.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from fmopt.errors import GeometryError
from fmopt.geometry.csg import Hull, Solid, Union
from fmopt.values import Array, Value, frozen

_DRAWN_IN = 0.25


@dataclass(frozen=True, eq=False)
class Profiles(Value):
    """The planar parts of a problem in their mating frames, x across and z out of the hole, m.

    Args:
        moving: corners (n, 2) of the convex moving part, counter-clockwise.
        fixed: loops (k, 2) of the fixed part, outlines counter-clockwise, holes clockwise.
    """

    moving: Array
    fixed: tuple[Array, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "moving", frozen(self.moving, None, 2, name="moving profile"))
        object.__setattr__(self, "fixed", tuple(frozen(loop, None, 2, name="loop") for loop in self.fixed))


def slab(polygons: Sequence[ArrayLike]) -> Solid:
    """The union of convex polygons (k, 2) in x and z, extruded along y as far as they are wide, centred."""
    corners = [convex(polygon) for polygon in polygons]
    y = 0.5 * float(np.ptp(np.vstack(corners), axis=0).max())
    hulls = [Hull(tuple((float(x), side, float(z)) for side in (-y, y) for x, z in polygon)) for polygon in corners]
    return hulls[0] if len(hulls) == 1 else Union(tuple(hulls))


def ridge(polygon: ArrayLike) -> Solid:
    """A convex polygon (n, 2) in x and z at y = 0, drawn in by a quarter towards its centroid at both ends.

    It is as thick as the polygon is wide where it is narrowest.
    """
    corners = convex(polygon)
    y = 0.5 * width(corners)
    ends = (1.0 - _DRAWN_IN) * corners + _DRAWN_IN * corners.mean(axis=0)
    points = [(x, 0.0, z) for x, z in corners.tolist()]
    return Hull(tuple(points + [(x, side, z) for side in (-y, y) for x, z in ends.tolist()]))


def outline(polygons: Sequence[ArrayLike]) -> tuple[Array, ...]:
    """The loops (k, 2) of the union of convex polygons, outlines counter-clockwise, holes clockwise."""
    from shapely import MultiPolygon, Polygon, get_parts, union_all
    from shapely.geometry.polygon import orient

    whole = union_all([Polygon(convex(polygon)) for polygon in polygons])
    loops = []
    for part in get_parts(MultiPolygon([*get_parts(whole)])):
        turned = orient(part)
        loops += [frozen(ring.coords[:-1], None, 2) for ring in (turned.exterior, *turned.interiors)]
    return tuple(loops)


def convex(polygon: ArrayLike) -> Array:
    """The corners (n, 2) of a convex polygon.

    Raises:
        GeometryError: fewer than three corners, or not convex and counter-clockwise.
    """
    corners = frozen(polygon, None, 2, name="polygon")
    if len(corners) < 3:
        raise GeometryError(f"a polygon with {len(corners)} corners", "give at least three")
    e = np.roll(corners, -1, axis=0) - corners
    before = np.roll(e, 1, axis=0)
    turns = before[:, 0] * e[:, 1] - before[:, 1] * e[:, 0]
    lengths = np.hypot(*e.T) * np.hypot(*before.T)
    around = np.arctan2(turns, np.sum(before * e, axis=1)).sum()
    if not np.all(turns > 1e-9 * lengths) or around > 7.0:
        k = int(np.argmin(turns - 1e-9 * lengths))
        raise GeometryError(
            f"a polygon of a profile does not turn left at corner {k}",
            "list the corners of a convex polygon counter-clockwise, x to the right and z up; cut others into several",
        )
    return corners


def width(corners: Array) -> float:
    """The least width (m) of a convex polygon (n, 2)."""
    e = np.roll(corners, -1, axis=0) - corners
    n = np.column_stack([-e[:, 1], e[:, 0]]) / np.hypot(*e.T)[:, None]
    return float(np.ptp(n @ corners.T, axis=1).min())
