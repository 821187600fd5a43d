"""What contacts say of edges and rims beside those that touch: of parts that are not convex, and of their pieces.

A face that two of its edges hold on a rim has all of that rim in its plane, where other pieces of the part may end in
it. A rim that lies farther out by no more than a parallel face of the part lies farther in is not behind that face.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import permutations

import numpy as np

from fmopt.certificate.assembly import NEAR, Assembly, edge_along, hinge, on_line, run_like
from fmopt.certificate.contact_implications import Facts, facts, rising
from fmopt.contact.primitive import Kind, PrimitiveContact
from fmopt.geometry.polyhedron import Polyhedron
from fmopt.spatial.se3 import cross, length, lengths
from fmopt.spatial.values import Array, Bits, remembered

_MEMORY = 2048

Edges = tuple[tuple[tuple[int, int], tuple[int, int]], ...]
"""Edges of a moving and of a fixed piece, as vertex indices of the two."""


@dataclass(frozen=True, eq=False)
class LevelRim:
    """A rim of the fixed part that is level with the plane of a face of the moving one, and not behind it."""

    at: Array  # a point of the rim (3,)
    along: Array  # its unit direction (3,), as the contact's edge runs
    way: Array  # unit direction (3,) of the face's edge that touches it, in the body
    normal: Array  # of the face in the body (3,)
    offset: float  # of the face, m
    held: bool

    def before(self, points: Array, normal: Array, offset: float) -> Bits:
        """Which fixed points (k, 3) are not behind a body plane, as they are no farther from the rim than it is.

        In the body it lies at least as far behind the face's plane as the points are away from the rim. The plane's
        offset is in m.
        """
        if length(normal - self.normal) > NEAR:
            return np.zeros(len(points), dtype=np.bool_)
        return np.asarray(lengths(cross(points - self.at, self.along)) <= self.offset - offset + NEAR)

    def has(self, point: Array) -> bool:
        """Whether a body point (3,), m, is in the face's plane."""
        return abs(float(self.normal @ point) - self.offset) <= NEAR


@remembered(_MEMORY)
def level_rims(
    assembly: Assembly, held: tuple[PrimitiveContact, ...], opening: tuple[PrimitiveContact, ...]
) -> tuple[LevelRim, ...]:
    """The rims that contacts keep level with faces of the moving part, and from going behind them.

    Two edges of a face on one rim put that into the face's plane. One edge does where what is known of turns keeps the
    face level with the rim, and keeps it from going behind where that contact is being made or given up.
    """
    body, fixed, found = assembly.moving.polyhedron, assembly.fixed.polyhedron, list[LevelRim]()
    edges = [contact for contact in (*held, *opening) if contact.kind is Kind.EDGE_EDGE]
    faces = {contact: set(body.edges[contact.moving_feature].faces) for contact in edges}
    level = {
        (one, *faces[one] & faces[other])
        for one, other in permutations([contact for contact in edges if contact in held], 2)
        if one.fixed_feature == other.fixed_feature and one.moving_feature != other.moving_feature
        if len(faces[one] & faces[other]) == 1
    }
    turns = facts(assembly, held).turns
    for contact in edges:
        (a, b), (c, d) = body.vertices[list(contact.moving)], fixed.vertices[list(contact.fixed)]
        way, along = (b - a) / length(b - a), (d - c) / length(d - c)
        for number in sorted(faces[contact]):
            face = body.faces[number]
            both = np.array([face.normal, -face.normal])
            told = bool(turns) and rising(turns, along, both).all() and hinge(assembly, contact, held) is None
            if told or (contact, number) in level:
                found.append(LevelRim(c, along, way, face.normal, face.offset, contact in held))
    return tuple(found)


def edges_level(assembly: Assembly, moving: Polyhedron, fixed: Polyhedron, rims: Sequence[LevelRim]) -> Edges:
    """Edges of two pieces, of which a level rim says that the fixed one is not behind a face at the moving one.

    They run like the contact's edges.
    """
    found = []
    for rim in rims:
        offset = float((moving.vertices @ rim.normal).max())
        if not faced(assembly, rim.normal, offset):
            continue
        before = rim.before(fixed.vertices, rim.normal, offset)
        own = [edge.vertices for edge in moving.edges if _runs(moving.vertices[[*edge.vertices]], rim.way)]
        on = [ends for ends in own if (moving.vertices[[*ends]] @ rim.normal >= offset - NEAR).all()]
        for other in fixed.edges:
            if before[[*other.vertices]].all() and _runs(fixed.vertices[[*other.vertices]], rim.along):
                run = run_like(fixed.vertices, other.vertices, rim.along)
                found += [(run_like(moving.vertices, ends, rim.way), run) for ends in on]
    return tuple(dict.fromkeys(found))


def faced(assembly: Assembly, normal: Array, offset: float) -> bool:
    """Whether a body plane, its normal (3,) out of the part and its offset in m, is of a face and not of a cut."""
    return any(assembly.agree(face.normal, face.offset, normal, offset) for face in assembly.moving.polyhedron.faces)


def _runs(ends: Array, way: Array) -> bool:
    """Whether an edge (2, 3) is parallel to a unit direction."""
    return length(cross(ends[1] - ends[0], way)) <= NEAR


@remembered(_MEMORY)
def edges_beside(
    assembly: Assembly,
    moving: Polyhedron,
    fixed: Polyhedron,
    held: tuple[PrimitiveContact, ...],
    opening: tuple[PrimitiveContact, ...],
) -> Edges:
    """Edges of a moving piece beside one in touch, that are known to lie along the fixed edge from it, with that one.

    They run like the contacts' edges.
    """
    known, body, found = facts(assembly, held), assembly.moving.polyhedron.vertices, []
    if not known.turns:
        return ()
    for contact in (*held, *opening):
        rim = edge_along(fixed, assembly.fixed.polyhedron, contact.fixed) if contact.kind is Kind.EDGE_EDGE else None
        if rim is None:
            continue
        own, (c, d) = body[list(contact.moving)], fixed.vertices[list(rim)]
        for edge in moving.edges:
            if beside(known, own, moving.vertices[[*edge.vertices]], (d - c) / length(d - c)):
                found.append((run_like(moving.vertices, edge.vertices, own[1] - own[0]), rim))
    return tuple(dict.fromkeys(found))


def beside(known: Facts, one: Array, other: Array, along: Array) -> bool:
    """Whether an edge of the body is parallel to one (2, 3), and known to lie along a unit direction (3,) from it."""
    way = (one[1] - one[0]) / length(one[1] - one[0])
    if not on_line(other, other[0], way).all():
        return False
    off = other[0] - one[0]
    off = off - way * float(way @ off)
    return length(off) > NEAR and bool(known.beside(off[None], along)[0])
