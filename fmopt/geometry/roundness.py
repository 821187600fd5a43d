"""How far a mesh may lie from the curved surface that it stands for, read off its strips of narrow facets."""

from __future__ import annotations

import math
from collections import Counter

import numpy as np

from fmopt.geometry.polyhedron import Face, Polyhedron
from fmopt.values import Array

_SMOOTH = math.radians(30.5)  # facets that meet at less than this may stand for one curved surface: 12 to a circle


def chord_error(body: Polyhedron) -> float:
    """The sagitta (m) of the arcs that chains of facets stand for, 0 where there are none.

    Facets of width c that turn by φ from one to the next are chords of an arc with the sagitta c/2 · tan(φ/4). A facet
    counts when it has such neighbours across two or more of its edges: one alone is a chamfer or a draft.
    """
    turns = []
    for edge in body.edges:
        one, other = (body.faces[number].normal for number in edge.faces)
        turn = math.atan2(float(np.linalg.norm(np.cross(one, other))), float(one @ other))
        if turn <= _SMOOTH:
            turns.append((edge, turn))
    neighbours = Counter(number for edge, _ in turns for number in edge.faces)
    largest = 0.0
    for edge, turn in turns:
        if max(neighbours[number] for number in edge.faces) > 1:
            start, end = body.vertices[list(edge.vertices)]
            along = (end - start) / np.linalg.norm(end - start)
            width = min(_width(body, body.faces[number], along) for number in edge.faces)
            largest = max(largest, 0.5 * width * math.tan(0.25 * turn))
    return largest


def _width(body: Polyhedron, face: Face, along: Array) -> float:
    """Extent of a face across a direction in its plane, m."""
    return float(np.ptp(body.vertices[list(face.vertices)] @ np.cross(face.normal, along)))
