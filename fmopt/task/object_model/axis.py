"""Solids along the z axis, by the operators on their instances, [LeeHuang1985] assertion 2."""

from itertools import pairwise
from typing import TypeAlias

import numpy as np

from fmopt.geometry.csg import Difference, Moved, Primitive, Solid, Union, convex_polyhedron
from fmopt.spatial.se3 import Pose

Intervals: TypeAlias = tuple[tuple[float, float], ...]


def on_axis(solid: Solid, pose: Pose | None = None) -> Intervals:
    """Stretches (from, to) in m of the z axis inside the solid, ascending and apart."""
    pose = pose or Pose.identity()
    match solid:
        case Moved(inner, move):
            return on_axis(inner, pose.compose(move))
        case Union(parts):
            return _combined([on_axis(part, pose) for part in parts], [])
        case Difference(base, tools):
            return _combined([on_axis(base, pose)], [on_axis(tool, pose) for tool in tools])
        case _:
            return _through(solid, pose)


def length(intervals: Intervals, low: float, high: float) -> float:
    """Total length of the intervals between two heights, m."""
    return sum(max(0.0, min(b, high) - max(a, low)) for a, b in intervals)


def _combined(added: list[Intervals], taken: list[Intervals]) -> Intervals:
    levels = np.unique([level for some in (*added, *taken) for interval in some for level in interval])
    kept: list[tuple[float, float]] = []
    for a, b in pairwise(levels.tolist()):
        # Between neighbouring levels nothing begins or ends: the middle stands for the stretch.
        middle = 0.5 * (a + b)
        if any(_holds(some, middle) for some in added) and not any(_holds(some, middle) for some in taken):
            joins = bool(kept) and kept[-1][1] == a
            kept[-1:] = [(kept[-1][0], b)] if joins else [*kept[-1:], (a, b)]
    return tuple(kept)


def _holds(intervals: Intervals, height: float) -> bool:
    return any(a < height < b for a, b in intervals)


def _through(primitive: Primitive, pose: Pose) -> Intervals:
    """The z axis between the half-spaces n·x ≤ d of a convex primitive."""
    hull = convex_polyhedron(primitive, pose)
    slope, offset = hull.normals[:, 2], hull.offsets
    flat = np.abs(slope) < 1e-12
    # A face along the axis does not bound it, but may have all of it outside.
    if np.any(offset[flat] < 0.0):
        return ()
    bounds = offset[~flat] / slope[~flat]
    up = slope[~flat] > 0.0
    enter, leave = float(np.max(bounds[~up])), float(np.min(bounds[up]))
    return ((enter, leave),) if enter < leave else ()
