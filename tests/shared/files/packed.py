"""Meshes as bytes of STL files, and parts of the planner as the check reads them."""

from __future__ import annotations

import struct

import numpy as np

from fmopt.geometry.part import Part as PlannersPart
from fmopt.geometry.polyhedron import Polyhedron
from fmopt.verify.reading.document import Body, Part


def body(polyhedron: Polyhedron) -> Body:
    return Body(
        tuple(tuple(row) for row in polyhedron.vertices.tolist()), tuple(face.loops for face in polyhedron.faces)
    )


def part(found: PlannersPart) -> Part:
    pieces = tuple(map(body, found.pieces))
    return Part(body(found.polyhedron), pieces, found.name, (0.0, 0.0), 0.0, form=found.form)


def packed_stl(points: np.ndarray, faces: np.ndarray) -> bytes:
    rows = [struct.pack("<12fH", 0.0, 0.0, 0.0, *points[f].ravel().tolist(), 0) for f in faces]
    return b"solid by name alone".ljust(80) + struct.pack("<I", len(rows)) + b"".join(rows)
