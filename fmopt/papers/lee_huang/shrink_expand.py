"""SHR_EXP: the moving operand shrinks to its nominal centre while the cut-diagrams of the fixed one expand.

The expansion over the moving operand's instances is the union of the expansions by each ([LeeHuang1985] Assertion 1).
The fixed operand's tree has to be evaluated first: the expansion of a difference is not the difference of expansions,
as what is taken away shrinks where the rest grows.

GE where operand 1 is turned: at one orientation, and over all those that it takes on its way to the goal's.

While operand 1 still turns, GE belongs to an orientation: one expansion at the goal's does not cover the first leg of
P(t), [LeeHuang1985] section 4.1.1 with errata.

Polyhedral stand-ins that contain a solid, so that what is free of them is free of its true round surfaces.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Literal

import numpy as np

from fmopt.geometry import csg, section
from fmopt.geometry.convex_pieces import pieces
from fmopt.geometry.csg import Moved, Primitive, Solid
from fmopt.geometry.plane.boolean import union
from fmopt.geometry.plane.convolution import minkowski_sum
from fmopt.geometry.plane.region import Region, polygon_region
from fmopt.geometry.plane.turning import turn_swept
from fmopt.geometry.polyhedron import Polyhedron, placed
from fmopt.papers.lee_huang.cut_diagram import cut_diagram, section_limit
from fmopt.papers.lee_huang.uncertainty_zone import BasePlane
from fmopt.spatial.se3 import Pose, exp
from fmopt.spatial.values import Array

_RELATIVE = 1e-6  # of the larger size, where no tolerance is given
_STEP = 0.05  # rad, between orientations of a turn out of the plane
_IN_PLANE = 1e-12  # rad
_SIDES: tuple[Literal[1, -1], ...] = (1, -1)


def expanded(G: Region, sections: Sequence[Region], tolerance: float | None = None) -> Region:
    """GE = ∪ G ⊕ (−section): where the nominal centre cannot be without the moving operand overlapping G.

    GE is regularised: a centre on its boundary touches, and a slit or a point that leaves no play is part of GE.
    Segments and circular arcs are exact, and so are the conic arcs of one operand where the other one is a polygon.
    Sections are cut-diagrams of the moving operand's instances, about the nominal centre as origin. Empty ones add
    nothing; without any other the operand is its centre alone, and G comes back as it is. By the tolerance (m) GE may
    be too large where conic arcs meet curves, 1e-6 of the larger size if None.
    """
    solid = [section for section in sections if not section.empty]
    if G.empty or not solid:
        return G
    room = _RELATIVE * max(G.size, *(section.size for section in solid)) if tolerance is None else tolerance
    # −section: the nominal centre shrinks to a point as G grows by the mirror image of what is around it.
    return union([minkowski_sum(G, section.moved(-np.eye(2), (0.0, 0.0)), room) for section in solid])


def frame(plane: BasePlane) -> Pose:
    """The frame of a plane in the B-frame: its x along u, its y along v."""
    u, v = np.eye(3)[plane.u], np.eye(3)[plane.v]
    return Pose(np.zeros(3), np.column_stack([u, v, np.cross(u, v)]))


def section_at(moving: Solid, plane: BasePlane, turn: Array) -> Region:
    """The section of operand 1, turned by a rotation vector (3,), rad, by the plane through its nominal centre.

    Where the plane runs in a face of it, the section is that on the side of the body.
    """
    turned = Moved(moving, Pose(np.zeros(3), exp(turn)))
    found = cut_diagram(turned, frame(plane))
    # In a face of operand 1 the section is that of the side where its body is.
    return found if not found.empty else union([section_limit(turned, frame(plane), side) for side in _SIDES])


def expanded_over(G: Region, moving: Solid, plane: BasePlane, first: Array, last: Array) -> Region:
    """GE over every orientation between two, the rotation vector (3,), rad, running straight from one to the other.

    A turn in the plane is swept exactly. Of any other, sections of the convex pieces at orientations at most 0.05 rad
    apart are taken, round ones enclosed by polygons, each with the next in one hull. What is left out between two of
    them, under 1 % of the size where sampled, is found in space, like what moves off the plane. The origin of operand 1
    is the nominal centre.
    """
    normal = np.eye(3)[plane.turn - 3]
    across = np.array([turn - (turn @ normal) * normal for turn in (first, last)])
    # A turn about the plane's own normal leaves the section as it is, turned in the plane: exact.
    if np.abs(across).max() <= _IN_PLANE:
        interval = sorted([0.0, plane.sense * float((first - last) @ normal)])
        # Turning and expanding commute with unions: GE is expanded by what the section sweeps about its centre.
        return expanded(G, [turn_swept(section_at(moving, plane, last), *interval)])
    # Other turns change the section: hulls between neighbouring orientations hold it, nearly.
    count = max(1, math.ceil(float(np.linalg.norm(last - first)) / _STEP))
    turns = [Pose(np.zeros(3), exp(first + share * (last - first))) for share in np.linspace(0.0, 1.0, count + 1)]
    swept = [_swept_over(body, plane, turns) for body in pieces(enclosing(moving))]
    return expanded(G, [union([part for hulls in swept for part in hulls])])


def _swept_over(body: Polyhedron, plane: BasePlane, turns: Sequence[Pose]) -> Iterator[Region]:
    """The hulls of neighbouring sections of a convex body."""
    from scipy.spatial import ConvexHull

    for one, other in pairwise([_corners(placed(body, turn), plane) for turn in turns]):
        points = np.vstack([one, other])
        if len(points):
            yield polygon_region(points[ConvexHull(points).vertices])


def _corners(body: Polyhedron, plane: BasePlane) -> Array:
    """Corners (n, 2) of the section of a convex body; where the plane runs in a face, of that on the body's side."""
    sides = [section.section_limit([body], frame(plane), side) for side in _SIDES]
    found = [np.asarray(part.exterior.coords) for side in sides for part in side.geoms]
    return np.vstack(found) if found else np.zeros((0, 2))


def enclosing(solid: Solid) -> Solid:
    """The solid with polygons that contain its round instances; those that are taken away lie inside theirs.

    Where nothing is round, that is the solid itself, whose pieces may be known.
    """
    return csg.changed(solid, lambda instance, taken: instance if taken % 2 else _circumscribed(instance))


def _circumscribed(instance: Primitive) -> Primitive:
    match instance:
        case csg.Cylinder(radius, _, sides):
            # The polygon's inner radius is the true radius: what moves is enclosed.
            return replace(instance, radius=radius / math.cos(math.pi / sides))
        case csg.Cone(bottom, top, _, sides):
            grown = 1.0 / math.cos(math.pi / sides)
            return replace(instance, radius_bottom=bottom * grown, radius_top=top * grown)
        case csg.Sphere(radius, _):
            inner = float(np.min(csg.convex_polyhedron(instance, Pose.identity()).offsets))
            # Scaled so that the nearest facet is at the radius.
            return replace(instance, radius=radius * radius / inner)
        case _:
            return instance


def finer(solid: Solid, sides: int) -> Solid:
    """The solid with at least so many sides for each cylinder and cone; spheres, whose faces are many, as they are."""

    def change(instance: Primitive, _: int) -> Primitive:
        if isinstance(instance, csg.Cylinder | csg.Cone):
            return replace(instance, sides=max(instance.sides, sides))
        return instance

    return csg.changed(solid, change)
