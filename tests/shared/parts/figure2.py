"""Figure 2's parts, errors and speed, and relatives of them."""

import numpy as np

from fmopt.geometry.csg import Box, Cylinder, Difference, Moved, Prism, Union, ring
from fmopt.spatial.se3 import Pose, exp

SPEED, RHO = 0.02, 0.014
START, GOAL = np.array([0.015, 0.004, 0.012, 0, 0, 0]), np.array([0, 0, -0.03, 0, 0, 0])
BOX = np.array([1e-4, 1e-4, 1e-4, 0.005, 0.005, 0.005])


def at(solid, x=0.0, y=0.0, z=0.0, r=(0.0, 0.0, 0.0)):
    return Moved(solid, Pose(np.array([x, y, z]), exp(r)))


def block(tool, depth):
    """A block 60 mm wide and 40 mm high with its mouth at z = 0; a depth of 40 mm is through."""
    body = at(Box((0.06, 0.06, 0.04)), 0, 0, -0.04)
    return Difference(body, (at(tool, 0, 0, -depth - (0.001 if depth >= 0.04 else 0.0)),))


PEG, BORE = Cylinder(0.01, 0.05, 32), Cylinder(0.0102, 0.06, 32)


def radius(solid):
    """Of the one cylinder in a tree."""
    match solid:
        case Cylinder(size, _, _):
            return size
        case Moved(inner, _):
            return radius(inner)
        case Union(parts):
            return next(filter(None, map(radius, parts)), None)
        case Difference(base, tools):
            return next(filter(None, map(radius, (base, *tools))), None)
    return None


def hexagon(radius, height):
    return Prism(tuple(map(tuple, ring(radius, 6))), height)


def steps(intervals, path):
    """S with the heights of the tip at both ends."""
    return [(one.s, path.at(one.start)[2], path.at(one.end)[2]) for one in intervals]


def agree(found, expected):
    assert [s for s, _, _ in found] == [s for s, _, _ in expected]
    heights = np.array([one[1:] for one in found]) - np.array([one[1:] for one in expected])
    assert np.abs(heights).max() < 1e-9 * 0.035
