"""Chords of exact curves, by which shapely decides what a set of closed curves encloses.

Chords of neighbouring curves share their ends, so that their order is that of the curves themselves wherever these are
farther apart than the chords' tolerance.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from fmopt.geometry.plane.curve import Curve, LineSegment
from fmopt.spatial.values import Array, Indices

if TYPE_CHECKING:
    from shapely.geometry.base import BaseGeometry

CHORD = 1e-6  # of the size: largest distance of a chord from its curve
ROUNDING = 1e-11  # of the size: points closer than this are one


def grid_of(scale: float) -> float:
    """The grid, m, a power of two, that shapely rounds chords to, so that lines that coincide become one."""
    return math.ldexp(1.0, math.frexp(0.05 * ROUNDING * scale)[1])


def chords(curve: Curve, tolerance: float) -> Array:
    """Points (n, 2) on the curve, the middle one at t = ½, whose chords are within `tolerance` (m) of it."""
    if isinstance(curve, LineSegment):
        return np.stack([curve.start, curve.end])
    halves = [curve.part(0.0, 0.5).polyline(tolerance), curve.part(0.5, 1.0).polyline(tolerance)]
    points = np.vstack([halves[0][:-1], [curve.point(0.5)], halves[1][1:]])
    points[0], points[-1] = curve.first, curve.last
    return points


def winding(lines: Sequence[Array], points: Array) -> Indices:
    """How often (n,) directed polylines (k, 2) that close together run counter-clockwise round points (n, 2)."""
    start, end = (np.vstack([line[part] for line in lines]) for part in (slice(None, -1), slice(1, None)))
    turns = np.zeros(len(points), dtype=np.intp)
    for k, (x, y) in enumerate(points.tolist()):
        below = start[:, 1] <= y
        row = np.flatnonzero(below != (end[:, 1] <= y))
        a, b, upward = start[row], end[row], below[row]
        # Of the edges that pass the height of the point, upward ones with it on their left, and downward on the right.
        side = (b[:, 0] - a[:, 0]) * (y - a[:, 1]) - (x - a[:, 0]) * (b[:, 1] - a[:, 1])
        turns[k] = np.sum(upward & (side > 0.0)) - np.sum(~upward & (side < 0.0))
    return turns


def enclosed(lines: Sequence[Array], rounded: bool = True) -> BaseGeometry:
    """What closed chains of directed polylines (k, 2) wind round at least once; on a grid if `rounded`."""
    import shapely

    corners, rows = np.vstack(lines), np.repeat(np.arange(len(lines)), [len(line) for line in lines])
    grid = grid_of(float(np.max(np.abs(corners)))) if rounded else None
    noded = shapely.union_all(shapely.linestrings(corners, indices=rows), grid_size=grid)
    faces = shapely.get_parts(shapely.polygonize([*shapely.get_parts(noded)]))
    inside = winding(lines, shapely.get_coordinates(shapely.point_on_surface(faces))) >= 1
    return shapely.union_all(faces[inside], grid_size=grid)


def filled(rings: Sequence[Array]) -> BaseGeometry:
    """What closed rings (k, 2), last point equal to the first, wind round at least once."""
    import shapely

    area = sum(0.5 * float(np.sum(r[:-1, 0] * r[1:, 1] - r[1:, 0] * r[:-1, 1])) for r in rings)
    simple = shapely.build_area(shapely.MultiLineString(list(rings))) if rings else shapely.Polygon()
    # Where nothing crosses and no ring lies in one of its own sense, windings are 0 and 1, and areas add up.
    return simple if math.isclose(simple.area, area, rel_tol=1e-9) and simple.is_valid else enclosed(rings)
