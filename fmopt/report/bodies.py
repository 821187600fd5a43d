"""The parts of a plan as polyhedra, where they stand, and their sections through the mating axis."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from fmopt.geometry.polyhedron import Polyhedron, from_faces, placed
from fmopt.geometry.section import section
from fmopt.se3 import Pose
from fmopt.values import Array

if TYPE_CHECKING:
    from shapely import MultiPolygon

_SLIT = 1e-10  # m: rounding leaves slits between the sections of neighbouring pieces
# Section planes: first axis to the right, z upward, seen against the third column.
CUTS = {
    "x–z": Pose(np.zeros(3), np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])),
    "y–z": Pose(np.zeros(3), np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])),
}


def body_of(record: Mapping[str, Any]) -> Polyhedron:
    """The polyhedron of a part or piece of a plan."""
    return from_faces(record["vertices"], record["faces"])


def pieces_of(part: Mapping[str, Any]) -> tuple[Polyhedron, ...]:
    """The convex pieces of a part of a plan; the part itself where none are listed."""
    return tuple(body_of(piece) for piece in part.get("pieces") or (part,))


def cut(bodies: tuple[Polyhedron, ...], pose: Pose, plane: str) -> MultiPolygon:
    """The section of a part at a pose by one of `CUTS`, in that plane's coordinates, m; slits between pieces closed."""
    from shapely import MultiPolygon, get_parts

    shape = section([placed(body, pose) for body in bodies], CUTS[plane])
    closed = shape.buffer(_SLIT, join_style="mitre").buffer(-_SLIT, join_style="mitre")
    return MultiPolygon([part for part in get_parts(closed) if part.geom_type == "Polygon"])


def extent(shape: MultiPolygon, height: float) -> Array:
    """Where the line at a height crosses a section: intervals (n, 2) from left to right, m."""
    from shapely import LineString, get_parts

    left, _, right, _ = shape.bounds
    line = LineString([(left - 1.0, height), (right + 1.0, height)])
    runs = [run.bounds for run in get_parts(shape.intersection(line)) if run.length > 0.0]
    return np.array(sorted((run[0], run[2]) for run in runs)).reshape(-1, 2)
