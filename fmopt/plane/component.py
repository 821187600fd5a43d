"""Connected components of regions."""

from __future__ import annotations

import numpy as np

from fmopt.plane.arrangement import touching_boxes
from fmopt.plane.region import Region

_INNER = 0.4142135623730951  # a parameter at which hardly any curve touches another


def components(region: Region) -> list[Region]:
    """The parts of a region with one outer loop each: a hole belongs to the smallest loop round it."""
    if len(region.loops) < 2:
        return [] if region.empty else [region]
    areas = np.array([sum(curve.moment() for curve in loop) for loop in region.loops])
    outer, holes = np.flatnonzero(areas > 0.0), np.flatnonzero(areas <= 0.0)
    parts = {k: [region.loops[k]] for k in outer.tolist()}
    if len(outer) == 1:
        return [region]
    if len(holes):
        bounds = [Region((region.loops[k],)) for k in outer.tolist()]
        longest = [max(region.loops[k], key=lambda curve: curve.length) for k in holes.tolist()]
        points = np.array([curve.point(_INNER) for curve in longest])
        owner = np.full(len(holes), -1, dtype=np.intp)
        boxes = np.array([np.concatenate(bound.box) for bound in bounds])
        pairs = touching_boxes(np.hstack([points, points]), boxes, 0.0)
        order = np.argsort(-areas[outer][pairs[1]], kind="stable")
        for hole, bound in pairs[:, order].T.tolist():
            if bounds[bound].contains(points[hole])[0]:
                owner[hole] = outer[bound]
        for hole, k in zip(holes.tolist(), owner.tolist(), strict=True):
            parts[k].append(region.loops[hole])
    return [Region(tuple(loops)) for loops in parts.values()]
