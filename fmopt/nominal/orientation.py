"""GE where operand 1 is turned: at one orientation, and over all those that it takes on its way to the goal's.

While operand 1 still turns, GE belongs to an orientation: one expansion at the goal's does not cover the first leg of
P(t), [LeeHuang1985] section 4.1.1 with errata.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Literal

import numpy as np

from fmopt.geometry import section
from fmopt.geometry.csg import Placed, Solid
from fmopt.geometry.pieces import pieces
from fmopt.geometry.polyhedron import Polyhedron, placed
from fmopt.nominal.cut_diagram import cut_diagram, section_limit
from fmopt.nominal.enclosing import enclosing
from fmopt.nominal.shrink_expand import expanded, expanded_turning
from fmopt.nominal.uncertainty_zone import Plane
from fmopt.plane.boolean import union
from fmopt.plane.region import Region, polygon_region
from fmopt.se3 import Pose, exp
from fmopt.values import Array

_STEP = 0.05  # rad, between orientations of a turn out of the plane
_IN_PLANE = 1e-12  # rad
_SIDES: tuple[Literal[1, -1], ...] = (1, -1)


def frame(plane: Plane) -> Pose:
    """The frame of a plane in the B-frame: its x along u, its y along v."""
    u, v = np.eye(3)[plane.u], np.eye(3)[plane.v]
    return Pose(np.zeros(3), np.column_stack([u, v, np.cross(u, v)]))


def section_at(moving: Solid, plane: Plane, turn: Array) -> Region:
    """The section of operand 1, turned by a rotation vector (3,), by the plane through its nominal centre.

    Where the plane runs in a face of it, the section is that on the side of the body.
    """
    turned = Placed(moving, Pose(np.zeros(3), exp(turn)))
    found = cut_diagram(turned, frame(plane))
    return found if not found.empty else union([section_limit(turned, frame(plane), side) for side in _SIDES])


def expanded_over(G: Region, moving: Solid, plane: Plane, first: Array, last: Array) -> Region:
    """GE over every orientation between two, the rotation vector running straight from one to the other.

    A turn in the plane is swept exactly. Of any other, sections of the convex pieces at orientations at most 0.05 rad
    apart are taken, round ones enclosed by polygons, each with the next in one hull. What is left out between two of
    them, under 1 % of the size where sampled, is found in space, like what moves off the plane.

    Args:
        G: cut-diagram of operand 2 on the plane.
        moving: operand 1 in its own frame, whose origin is the nominal centre.
        plane: of the B-frame.
        first, last: rotation vectors (3,) of one branch, rad.
    """
    normal = np.eye(3)[plane.turn - 3]
    across = np.array([turn - (turn @ normal) * normal for turn in (first, last)])
    if np.abs(across).max() <= _IN_PLANE:
        interval = sorted([0.0, plane.sense * float((first - last) @ normal)])
        return expanded_turning(G, [section_at(moving, plane, last)], (interval[0], interval[1]))
    count = max(1, math.ceil(float(np.linalg.norm(last - first)) / _STEP))
    turns = [Pose(np.zeros(3), exp(first + share * (last - first))) for share in np.linspace(0.0, 1.0, count + 1)]
    swept = [_swept(body, plane, turns) for body in pieces(enclosing(moving))]
    return expanded(G, [union([part for hulls in swept for part in hulls])])


def _swept(body: Polyhedron, plane: Plane, turns: Sequence[Pose]) -> Iterator[Region]:
    """The hulls of neighbouring sections of a convex body."""
    from scipy.spatial import ConvexHull

    for one, other in pairwise([_corners(placed(body, turn), plane) for turn in turns]):
        points = np.vstack([one, other])
        if len(points):
            yield polygon_region(points[ConvexHull(points).vertices])


def _corners(body: Polyhedron, plane: Plane) -> Array:
    """Corners (n, 2) of the section of a convex body; where the plane runs in a face, of that on the body's side."""
    sides = [section.section_limit([body], frame(plane), side) for side in _SIDES]
    found = [np.asarray(part.exterior.coords) for side in sides for part in side.geoms]
    return np.vstack(found) if found else np.zeros((0, 2))
