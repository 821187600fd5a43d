"""Planes through the edges of fixed pieces, between the two faces of each, that keep a moving piece at most margin."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fmopt.certificate.course import Course
from fmopt.certificate.pair import BEHIND, free_plane
from fmopt.certificate.separation import Separation
from fmopt.geometry.polyhedron import Polyhedron
from fmopt.memory import remembered
from fmopt.placement.arcs import SHARES, Edges, best
from fmopt.se3 import lengths
from fmopt.values import Array

_SPREAD = np.linspace(0.0, 1.0, SHARES)
_MEMORY = 256


@dataclass(frozen=True, eq=False)
class FreePlanes:
    """The best planes between a moving piece and fixed ones (m) over pieces of motion (n).

    Args:
        normals: unit normals (n, m, 3).
        offsets: how far out the fixed pieces reach along them (n, m), m.
        margins: certified margins (n, m), m.
        clearances: nominal clearances (n, m), m.
    """

    normals: Array
    offsets: Array
    margins: Array
    clearances: Array

    def separation(self, n: int, m: int) -> Separation:
        """What keeps one pair apart over one piece of motion."""
        plane = free_plane(self.normals[n, m].tolist(), float(self.offsets[n, m]))
        return Separation(plane, float(self.margins[n, m]), float(self.clearances[n, m]))


@dataclass(frozen=True, eq=False)
class Fans:
    """The planes through all edges of some fixed pieces against one moving piece with vertices `body` (v, 3).

    What the errors cost a plane depends on its normal alone, and pieces share many.
    """

    body: Array
    edges: Edges

    def best(self, course: Course) -> FreePlanes:
        """For each fixed piece the plane with the largest certified margin over pieces of motion."""
        p, R, columns, cuts, twist, half, coupling = course.motion
        motion = p, R, columns, cuts, twist, half, coupling
        normals, offsets, margins, clearances = best(self.edges, self.body, motion)
        return FreePlanes(normals, offsets, margins - BEHIND, clearances - BEHIND)


@remembered(_MEMORY)
def fans(moving: Polyhedron, pieces: tuple[Polyhedron, ...]) -> Fans:
    """The planes between a moving piece and fixed ones that no contact touches."""
    most = max(len(piece.vertices) for piece in pieces)
    corners = np.array([np.resize(piece.vertices, (most, 3)) for piece in pieces])
    sides = [np.array([edge.faces for edge in piece.edges]) for piece in pieces]
    arcs = np.concatenate([piece.normals[faces] for piece, faces in zip(pieces, sides, strict=True)])
    owner = np.repeat(np.arange(len(pieces)), [len(faces) for faces in sides])
    w = _SPREAD[:, None]
    fan = (1.0 - w) * arcs[:, None, 0] + w * arcs[:, None, 1]
    fan = fan / lengths(fan)[..., None]
    offsets = (fan @ np.swapaxes(corners[owner], -1, -2)).max(axis=-1)
    numbers: dict[bytes, int] = {}
    which = np.array([numbers.setdefault(normal.tobytes(), len(numbers)) for normal in fan.reshape(-1, 3) + 0.0])
    normals = np.frombuffer(b"".join(numbers)).reshape(-1, 3).copy()
    cuts = np.cumsum([0, *(len(faces) for faces in sides)])
    edges = Edges(arcs, cuts, normals, which.reshape(fan.shape[:2]), offsets, corners)
    return Fans(np.array(moving.vertices), edges)
