"""Solids as tests build and ask them: raised, the tool of a chamfer, and membership by the definitions of CSG."""

from itertools import product

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fmopt.geometry.csg import Difference, Hull, Moved, Solid, Union, convex_polyhedron, exact_pose
from fmopt.spatial.se3 import Pose
from fmopt.spatial.values import Array


def frustum(bottom: tuple[float, float], top: tuple[float, float], height: float) -> Hull:
    """A rectangular frustum, `bottom` (x, y) at z = 0 and `top` (x, y) at z = height: the tool of a chamfer."""
    rims = ((bottom, 0.0), (top, height))
    return Hull(tuple((0.5 * i * x, 0.5 * j * y, z) for (x, y), z in rims for i, j in product((-1.0, 1.0), repeat=2)))


def raised(solid: Solid, z: float) -> Moved:
    return Moved(solid, Pose(np.array([0.0, 0.0, z]), np.eye(3)))


def depth(solid: Solid, points: ArrayLike) -> Array:
    """Positive inside, negative outside, zero on boundaries (also on inner ones of a union); shape (n,), m."""
    points = np.asarray(points, dtype=np.float64)
    match solid:
        case Moved(inner, pose):
            return depth(inner, exact_pose(pose).inverse().apply(points))
        case Union(parts):
            return np.asarray(np.max([depth(part, points) for part in parts], axis=0))
        case Difference(base, tools):
            return np.asarray(np.min([depth(base, points), *(-depth(tool, points) for tool in tools)], axis=0))
        case _:
            hull = convex_polyhedron(solid, Pose.identity())
            return np.asarray(np.min(hull.offsets - points @ hull.normals.T, axis=1))


def contains(solid: Solid, points: ArrayLike) -> NDArray[np.bool_]:
    """Regularised membership (n,): inside, or within 1 pm of a boundary with interior 1 nm away in 26 directions."""
    points = np.asarray(points, dtype=np.float64)
    value = depth(solid, points)
    inside = value > 1e-12
    doubtful = np.flatnonzero(np.abs(value) <= 1e-12)
    if doubtful.size:
        around = 1e-9 * np.array([step for step in product((-1.0, 0.0, 1.0), repeat=3) if any(step)])
        probes = (points[doubtful, None, :] + around).reshape(-1, 3)
        inside[doubtful] = np.any(depth(solid, probes).reshape(doubtful.size, -1) > 1e-12, axis=1)
    return inside
