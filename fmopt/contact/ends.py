"""Where faces and edges end: the faces across the edges of a face, and how edges pass the faces beside each other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fmopt.contact.primitive import Kind, PrimitiveContact
from fmopt.geometry.polyhedron import Polyhedron
from fmopt.memory import remembered
from fmopt.se3 import Pose, cross
from fmopt.values import Array

_MEMORY = 1024


@remembered(_MEMORY)
def face_clauses(polyhedron: Polyhedron, face: int) -> tuple[tuple[tuple[int, ...], ...], ...]:
    """The region of a face as clauses of alternatives, each naming the faces across edges that bound together.

    Edges that meet in a reflex corner are alternatives, others hold together: along the outer loop each run of edges
    joined by reflex corners is a clause; round a hole the runs joined by convex corners are one clause's alternatives.
    """
    across = {
        (f, *(edge.vertices if side == 0 else edge.vertices[::-1])): (edge.faces[1 - side] if edge.convex else None)
        for edge in polyhedron.edges
        for side, f in enumerate(edge.faces)
    }
    outer, *holes = polyhedron.faces[face].loops
    clauses: list[list[tuple[int | None, ...]]] = [
        [(across[face, a, b],) for a, b in run] for run in _runs(polyhedron, face, outer, reflex=True)
    ]
    clauses += [
        [tuple(across[face, a, b] for a, b in run) for run in _runs(polyhedron, face, hole, reflex=False)]
        for hole in holes
    ]
    bounded = [[tuple(g for g in group if g is not None) for group in clause] for clause in clauses]
    return tuple(tuple(dict.fromkeys(clause)) for clause in dict.fromkeys(map(tuple, bounded)) if all(clause))


def _runs(polyhedron: Polyhedron, face: int, loop: tuple[int, ...], reflex: bool) -> list[list[tuple[int, int]]]:
    """Maximal runs of the loop's edges joined at reflex (or else at convex) corners."""
    points = polyhedron.vertices[list(loop)]
    ahead = np.roll(points, -1, axis=0) - points
    bend = cross(np.roll(ahead, 1, axis=0), ahead) @ polyhedron.faces[face].normal
    joins = (bend < 0.0) if reflex else (bend > 0.0)
    edges = list(zip(loop, loop[1:] + loop[:1], strict=True))
    start = int(np.argmin(joins))
    runs: list[list[tuple[int, int]]] = []
    for i in range(len(loop)):
        k = (start + i) % len(loop)
        if i > 0 and joins[k]:
            runs[-1].append(edges[k])
        else:
            runs.append([edges[k]])
    return runs


@dataclass(frozen=True, eq=False)
class Crossings:
    """The m edge–edge contacts among some of two parts, and what tells at a pose how their edges pass each other.

    Attributes:
        parts: the moving part and the fixed one.
        contacts: all of the contacts.
        moving: ends (m, 2, 3) of the moving edges, m.
        beside: normals (m, 2, 3) of the faces beside them.
        along: vectors (m, 3) along the fixed edges, m.
        across: normals (m, 2, 3) of the faces beside these.
    """

    parts: tuple[Polyhedron, Polyhedron]
    contacts: tuple[PrimitiveContact, ...]
    moving: Array
    beside: Array
    along: Array
    across: Array

    @staticmethod
    def of(contacts: Sequence[PrimitiveContact], moving: Polyhedron, fixed: Polyhedron) -> Crossings:
        """Those of the contacts between these parts."""
        return _crossings(moving, fixed, tuple(contacts))

    def sides(self, pose: Pose) -> bytes:
        """Which of the faces beside the other one each edge passes most steeply at a pose, and which way.

        Two numbers for each of the m contacts, the moving edge's and the fixed one's: 3 times the number of the face,
        and 0, 1 or 2 for a slope below, at or above zero.
        """
        if not len(self.moving):
            return b""
        ends = self.moving @ pose.R.T
        # Turned one by one: rounding must not depend on how many there are.
        beside = (self.beside[..., None, :] @ pose.R.T)[..., 0, :]
        passing = np.vecdot(self.across, (ends[:, 1] - ends[:, 0])[:, None]), np.vecdot(beside, self.along[:, None])
        slopes = np.stack(passing, axis=1)
        steep = np.argmax(np.abs(slopes), axis=2)
        slope = np.take_along_axis(slopes, steep[..., None], axis=2)[..., 0]
        return bytes((3 * steep + 1 + np.sign(slope)).astype(np.uint8))


@remembered(_MEMORY)
def _crossings(moving: Polyhedron, fixed: Polyhedron, contacts: tuple[PrimitiveContact, ...]) -> Crossings:
    edges = [contact for contact in contacts if contact.kind is Kind.EDGE_EDGE]
    own, other = ([c.moving_feature for c in edges], [c.fixed_feature for c in edges])
    ends = moving.vertices[np.reshape([c.moving for c in edges], (-1, 2)).astype(np.intp)]
    still = fixed.vertices[np.reshape([c.fixed for c in edges], (-1, 2)).astype(np.intp)]
    beside = moving.normals[np.reshape([moving.edges[e].faces for e in own], (-1, 2)).astype(np.intp)]
    across = fixed.normals[np.reshape([fixed.edges[e].faces for e in other], (-1, 2)).astype(np.intp)]
    return Crossings((moving, fixed), contacts, ends, beside, still[:, 1] - still[:, 0], across)
