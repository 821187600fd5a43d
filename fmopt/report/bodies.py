"""The parts of a plan as polyhedra, where they stand, and their sections through the mating axis."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from fmopt.geometry.polyhedron import Edge, Polyhedron, from_faces, placed
from fmopt.geometry.section import section
from fmopt.plan import Body, StatedPart
from fmopt.plan.contact_geometry import Parts, contacts
from fmopt.spatial.se3 import Pose
from fmopt.spatial.values import Array

if TYPE_CHECKING:
    from shapely import MultiPolygon

    from fmopt.geometry.part import Part as Solid

_CREASE = math.cos(math.radians(30.0))  # edges flatter than this belong to a curved face and are not drawn
_SLIT = 1e-10  # m: rounding leaves slits between the sections of neighbouring pieces


def body_of(body: Body) -> Polyhedron:
    """The polyhedron of a part or piece of a plan."""
    return from_faces(body.vertices, body.faces, balls=body.balls)


def stated_part(part: Solid) -> StatedPart:
    """A part as a plan would state it, without clearances."""
    pieces = tuple(_body(piece) for piece in part.pieces)
    balls = tuple(_body(ball) for ball in part.balls)
    return StatedPart(_body(part.polyhedron), pieces, part.name, (0.0, 0.0), 0.0, balls=balls)


def _body(body: Polyhedron) -> Body:
    vertices = tuple(map(tuple, body.vertices.tolist()))
    return Body(vertices, tuple(tuple(tuple(loop) for loop in face.loops) for face in body.faces), balls=body.balls)


def pieces_of(part: StatedPart) -> tuple[Polyhedron, ...]:
    """The convex pieces of a part of a plan, and its balls."""
    return tuple(body_of(piece) for piece in (*part.pieces, *part.balls))


def upright_plane(azimuth: float) -> Pose:
    """The plane through the axis at an angle from x, rad: first axis to the right, z upward, seen against the third.

    The frame is exact where the angle is 0 or π/2.
    """
    # Rounding takes away the 6e-17 that cos(π/2) is, adding 0.0 the sign of a zero.
    c, s = (round(value, 15) + 0.0 for value in (math.cos(azimuth), math.sin(azimuth)))
    return Pose(np.zeros(3), np.array([[c, 0.0, s], [s, 0.0, -c], [0.0, 1.0, 0.0]]))


CUTS = {"x–z": upright_plane(0.0), "y–z": upright_plane(0.5 * math.pi)}


def contact_place(plan: Parts, contact: str, pose: Pose) -> Array:
    """Where a contact touches (3,), m; of parallel edges, which fix no point, the middle of the moving one."""
    found = contacts(plan)[contact]
    return pose.apply(found.moving.mean(axis=0)) if found.level(pose) else found.touch(pose)[0]


def creases(body: Polyhedron) -> list[Edge]:
    """The edges that are worth a line."""
    return [edge for edge in body.edges if np.dot(*(body.faces[k].normal for k in edge.faces)) < _CREASE]


def loops_of(shape: MultiPolygon) -> list[Array]:
    """The loops (n, 2) around a section and its holes, their first corner again at the end, m."""
    return [np.asarray(loop.coords) for polygon in shape.geoms for loop in (polygon.exterior, *polygon.interiors)]


def section_of(bodies: tuple[Polyhedron, ...], pose: Pose, plane: Pose) -> MultiPolygon:
    """The section of a part in convex pieces at a pose by a plane's x and y, in its coordinates, m; slits closed."""
    from shapely import MultiPolygon, get_parts

    shape = section([placed(body, pose) for body in bodies], plane)
    # Mitred joins leave a corner one corner, round ones would put arcs of many points there.
    closed = shape.buffer(_SLIT, join_style="mitre").buffer(-_SLIT, join_style="mitre")
    return MultiPolygon([part for part in get_parts(closed) if part.geom_type == "Polygon"])


def extent(shape: MultiPolygon, height: float) -> Array:
    """Where the line at a height, m, the second coordinate of a plane, crosses a section: intervals (n, 2), m."""
    from shapely import LineString, get_parts

    left, _, right, _ = shape.bounds
    line = LineString([(left - 1.0, height), (right + 1.0, height)])
    # A line that grazes a corner meets it in a point, which is no interval.
    runs = [run.bounds for run in get_parts(shape.intersection(line)) if run.length > 0.0]
    return np.array(sorted((run[0], run[2]) for run in runs)).reshape(-1, 2)
