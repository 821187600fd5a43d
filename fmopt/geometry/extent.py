"""How large a part is, and whether a part can be that large: most often it is the unit that is wrong."""

from __future__ import annotations

from typing import assert_never

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
from fmopt.se3 import Pose
from fmopt.values import Array

LARGEST = 4.0  # m: what the check of a plan takes
SMALLEST = 1e-4  # m


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
