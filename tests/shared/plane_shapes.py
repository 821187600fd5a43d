"""Plane regions as tests build and measure them: discs, boxes, arcs of an ellipse, and polygons that shapely takes."""

import math
from itertools import groupby

import numpy as np
from numpy.typing import ArrayLike
from shapely import MultiPolygon, Polygon, get_parts, unary_union

from fmopt.geometry.plane.conic import ConicArc
from fmopt.geometry.plane.curve import Arc
from fmopt.geometry.plane.region import Region, polygon_region


def disc(x: float, y: float, radius: float) -> Region:
    return Region(((Arc(np.array([x, y]), radius, 0.0, math.tau),),))


def box(x: float, y: float, width: float, height: float) -> Region:
    return polygon_region([(x, y), (x + width, y), (x + width, y + height), (x, y + height)])


def ellipse_arcs(centre: ArrayLike, major: ArrayLike, minor: ArrayLike) -> tuple[ConicArc, ...]:
    """The ellipse centre + cos φ major + sin φ minor, in four arcs whose shoulders are where their tangents meet."""
    angles = 0.25 * math.pi * np.arange(9)
    radii = np.where(np.arange(9) % 2 == 1, math.sqrt(2.0), 1.0)
    points = centre + (radii[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=-1)) @ np.stack([major, minor])
    return tuple(ConicArc(points[k], points[k + 1], points[k + 2], math.sqrt(0.5)) for k in range(0, 8, 2))


def polygon(region: Region, tolerance: float) -> MultiPolygon:
    """The region with curves replaced by polylines within `tolerance` (m)."""
    rings = [np.vstack([curve.polyline(tolerance)[:-1] for curve in loop]) for loop in region.loops]
    turning = [sum(curve.moment() for curve in loop) for loop in region.loops]
    solid = Polygon()
    # The largest first: what lies within another one is smaller, also an outline within a hole.
    inwards = sorted(zip(turning, rings, strict=True), key=lambda pair: -abs(pair[0]))
    for filled, alike in groupby(inwards, lambda pair: pair[0] > 0.0):
        shapes = unary_union([Polygon(ring) for _, ring in alike])
        solid = solid.union(shapes) if filled else solid.difference(shapes)
    return MultiPolygon([part for part in get_parts(solid) if isinstance(part, Polygon) and not part.is_empty])
