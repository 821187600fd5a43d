"""Plane sections of solids given as convex pieces: the union of the pieces' sections, never a slice of a mesh.

How large a part is, and whether a part can be that large: most often it is the unit that is wrong.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Literal, assert_never

import numpy as np

from fmopt.errors import SizeError
from fmopt.geometry.csg import (
    Box,
    Cone,
    Cylinder,
    Difference,
    Hull,
    Placed,
    Prism,
    Solid,
    Sphere,
    Union,
    Wedge,
    corners,
    exact_pose,
)
from fmopt.geometry.polyhedron import Polyhedron
from fmopt.spatial.se3 import Pose
from fmopt.spatial.values import Array

if TYPE_CHECKING:
    from shapely import MultiPolygon
    from shapely.geometry.base import BaseGeometry


_ON_PLANE = 1e-12  # m
_GAP = 1e-11  # m: as wide may a crack be
_CRACK = 1e-9  # m: what an outline is shorter by where there is a crack less
_QUARTER = 128  # sides of the polygon that stands for a quarter of a ball's section

LARGEST = 4.0  # m: what the check of a plan takes
SMALLEST = 1e-4  # m


def section(bodies: Sequence[Polyhedron], frame: Pose) -> MultiPolygon:
    """The regularised section of a union of convex bodies by the plane z = 0 of `frame`, in the frame's x and y (m).

    Where the plane runs in a face the answer is what both sides share: the seam of two stacked bodies is full, the top
    of a body empty.

    Args:
        bodies: convex polyhedra whose union is the solid.
        frame: pose of the section plane.
    """
    return _polygons(section_limit(bodies, frame, 1).intersection(section_limit(bodies, frame, -1)))


def section_limit(bodies: Sequence[Polyhedron], frame: Pose, side: Literal[-1, 1]) -> MultiPolygon:
    """The limit of the sections of a union of convex bodies when the plane comes from above (1) or below (−1)."""
    from shapely import MultiPoint, Point, union_all

    to_frame = exact_pose(frame).inverse()
    parts = []
    for body in bodies:
        points = to_frame.apply(body.vertices)
        for (x, y, z), radius in zip(points, body.radii, strict=True) if body.balls else ():
            if abs(z) < radius:
                parts.append(Point(x, y).buffer(float(np.sqrt(radius**2 - z**2)), quad_segs=_QUARTER))
        if not body.faces:
            continue
        if np.any(side * points[:, 2] > _ON_PLANE):
            outline = MultiPoint(_crossings(body, points)).convex_hull
            if outline.geom_type == "Polygon":
                parts.append(outline)
    return _polygons(sealed(union_all(parts)).simplify(0.0))


def sealed(shape: BaseGeometry) -> BaseGeometry:
    """A plane shape without the cracks and skins that rounding leaves where polygons share a side."""
    from shapely import set_precision, union_all

    closed = set_precision(union_all([shape], grid_size=_GAP), _GAP)
    return closed if closed.length < shape.length - _CRACK else shape


def _crossings(body: Polyhedron, points: Array) -> Array:
    """Where the body's edges meet z = 0, shape (k, 2); vertices on the plane as they are."""
    height = np.where(np.abs(points[:, 2]) <= _ON_PLANE, 0.0, points[:, 2])
    a, b = np.array([edge.vertices for edge in body.edges]).T
    cut = height[a] * height[b] < 0.0
    a, b = a[cut], b[cut]
    share = height[a] / (height[a] - height[b])
    return np.vstack([points[height == 0.0, :2], points[a, :2] + share[:, None] * (points[b, :2] - points[a, :2])])


def _polygons(geometry: BaseGeometry) -> MultiPolygon:
    from shapely import MultiPolygon, Polygon, get_parts

    return MultiPolygon([part for part in get_parts(geometry) if isinstance(part, Polygon) and part.area > 0.0])


def reach(solid: Solid, pose: Pose | None = None) -> Array:
    """Points (n, 3) in m whose bounding box holds the solid: what is taken away from it does not count."""
    where = Pose.identity() if pose is None else pose
    match solid:
        case Placed(inner, own):
            return reach(inner, where.compose(exact_pose(own)))
        case Union(parts):
            return np.vstack([reach(part, where) for part in parts])
        case Difference(base, _):
            return reach(base, where)
        case Box() | Cylinder() | Cone() | Sphere() | Prism() | Wedge() | Hull():
            return where.apply(corners(solid))
        case _:
            assert_never(solid)


def require_plausible(points: Array) -> None:
    """Refuses parts that no robot has in its hand.

    Args:
        points: (n, 3), m.

    Raises:
        SizeError: they extend over more than 4 m along an axis, or over less than 0.1 mm along all of them.
    """
    size = float(np.max(np.ptp(points, axis=0)))
    if not SMALLEST <= size <= LARGEST:
        bound = f"more than {told(LARGEST)}" if size > LARGEST else f"less than {told(SMALLEST)}"
        raise SizeError(f"the part is {told(size)} long, {bound}", size, "check the unit of its numbers")


def told(size: float) -> str:
    """A length (m) in the unit in which one says it."""
    for least, factor, name in ((1.0, 1.0, "m"), (1e-3, 1e3, "mm"), (0.0, 1e6, "µm")):
        if size >= least:
            return f"{factor * size:.4g} {name}"
    return f"{size:.4g} m"
