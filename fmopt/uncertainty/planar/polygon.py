"""Polygons on a chosen side of boundaries of arcs and segments."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Literal

import numpy as np

from fmopt.plane.curve import Side as CurveSide
from fmopt.uncertainty.planar.boundary import Loop
from fmopt.uncertainty.planar.gap import wrapped
from fmopt.values import Array

if TYPE_CHECKING:
    from shapely import MultiPolygon

Side = Literal["inside", "outside"]
SIDES: dict[Side, CurveSide] = {"inside": "left", "outside": "right"}


def polygon(loops: Sequence[Loop], tolerance: float, side: Side) -> MultiPolygon:
    """The polygon of loops that have their set on the left; see `PlanarSet.polygon`.

    Chords where an arc bulges away from the chosen side, tangents where it bulges to it. Each arc is moved within the
    set, or within its complement, so that every point that a thin place lets the polygon run round wrongly has winding
    number zero.
    """
    from shapely import MultiPolygon, Polygon

    rings = [ring(loop, tolerance, side) for loop in loops]
    if len(rings) == 1 and len(rings[0]) > 3:
        simple = Polygon(rings[0])
        if simple.is_valid and simple.exterior.is_ccw:
            return MultiPolygon([simple])
    return _wound(rings)


def ring(loop: Loop, tolerance: float, side: Side) -> Array:
    """The closed polyline (k, 2) in m of a loop, the first point not repeated."""
    return np.vstack([piece.curve.polyline(tolerance, SIDES[side])[:-1] for piece in loop])


def _wound(rings: Sequence[Array]) -> MultiPolygon:
    """What the rings wind round, a set without interior left out."""
    from shapely import LinearRing, MultiPolygon, get_parts, node, polygonize, union_all

    lines = [LinearRing(points) for points in rings if len(points) > 2]
    if not lines:
        return MultiPolygon()
    faces = get_parts(polygonize([*get_parts(node(union_all(lines)))]))
    inside = [face for face in faces if sum(_winding(points, face.representative_point()) for points in rings) > 0]
    return MultiPolygon([part for part in get_parts(union_all(inside)) if part.area > 0.0])


def _winding(points: Array, at: object) -> int:
    from shapely import get_coordinates

    to = points - get_coordinates(at)[0]
    theta = np.arctan2(to[:, 1], to[:, 0])
    return round(float(np.sum(wrapped(np.roll(theta, -1) - theta))) / (2.0 * np.pi))
