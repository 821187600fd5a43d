"""Pairs of convex pieces, the contacts between them, and the planes that may keep them apart."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import permutations
from typing import Literal, NamedTuple

import numpy as np

from fmopt.certificate.assembly import NEAR, Assembly, hinge, on_line
from fmopt.certificate.contact_implications import Facts, coming_off, facts, rising
from fmopt.certificate.rows import Mask
from fmopt.certificate.segment_linearisation import Piece
from fmopt.contact.primitive import Kind, PrimitiveContact
from fmopt.geometry.polyhedron import Polyhedron
from fmopt.spatial.se3 import cross, length, lengths
from fmopt.spatial.values import Array, remembered

BEHIND = 1e-15  # m; how far in front of the fixed piece a free plane is put, against rounding
_MEMORY = 2048
_FEATURES = {
    Kind.VERTEX_FACE: ("vertex", "face"),
    Kind.FACE_VERTEX: ("face", "vertex"),
    Kind.EDGE_EDGE: ("edge", "edge"),
    Kind.BALL_FACE: ("ball", "face"),
}

Features = frozenset[tuple[str, int]]


@dataclass(frozen=True)
class Witness:
    """A plane between two pieces: along a face or edges, as vertex indices of the pieces, or any plane of the B-frame.

    Args:
        kind: what the plane runs along.
        moving: vertices of the moving piece's face or edge.
        fixed: vertices of the fixed piece's face or edge.
        plane: for kind "plane" the unit normal (3) and the offset; the fixed piece lies behind it.
    """

    kind: Literal["fixed-face", "moving-face", "edges", "plane"]
    moving: tuple[int, ...]
    fixed: tuple[int, ...]
    plane: tuple[float, float, float, float] | None = None


class Pair(NamedTuple):
    """A moving piece against a fixed one, with the contacts that bear on the two.

    Args:
        moving: the moving piece.
        fixed: the fixed piece.
        held: contacts held between the two.
        opening: contacts being made or given up between the two.
        state: all contacts held, for a pair of which contacts say something; else none.
        left: all contacts given up, for such a pair; else none.
        beside: the contact being made that counts and those given up, wherever, for such a pair; else none.
    """

    moving: Polyhedron
    fixed: Polyhedron
    held: tuple[PrimitiveContact, ...]
    opening: tuple[PrimitiveContact, ...]
    state: tuple[PrimitiveContact, ...]
    left: tuple[PrimitiveContact, ...]
    beside: tuple[PrimitiveContact, ...]

    @property
    def touched(self) -> bool:
        """Whether a contact bears on the two."""
        return bool(self.held or self.opening)

    @property
    def told(self) -> bool:
        """Whether contacts say something of the two, which may be about features in the planes of those that touch."""
        return bool(self.state or self.left or self.beside)


@dataclass(frozen=True, eq=False)
class Facing:
    """All pairs of a moving piece and a fixed one under the same contacts, by the numbers of both pieces.

    One for each contact state and what opens or closes: what is worked out of it once can be kept by its identity.
    """

    listed: tuple[tuple[int, int, Pair], ...]

    @cached_property
    def apart(self) -> tuple[tuple[Polyhedron, tuple[int, ...]], ...]:
        """For each moving piece the places in the list of its pairs that no contact touches."""
        found: dict[Polyhedron, list[int]] = {}
        for n, (_, _, pair) in enumerate(self.listed):
            if not pair.touched:
                found.setdefault(pair.moving, []).append(n)
        return tuple((piece, tuple(places)) for piece, places in found.items())


def facing(assembly: Assembly, piece: Piece) -> Facing:
    """All pairs of convex pieces, moving and fixed, in order, with the contacts of a piece of motion."""
    return _facing(assembly, piece.held, (*piece.making, *piece.left), piece.left, piece.opening)


@remembered(_MEMORY)
def _facing(
    assembly: Assembly,
    held: tuple[PrimitiveContact, ...],
    opening: tuple[PrimitiveContact, ...],
    left: tuple[PrimitiveContact, ...],
    shown: tuple[PrimitiveContact, ...],
) -> Facing:
    found, several = [], len(assembly.moving.bodies) > 1
    for i, M in enumerate(assembly.moving.bodies):
        for j, F in enumerate(assembly.fixed.pieces):
            own, new = (touching(assembly, M, F, contacts) for contacts in (held, opening))
            told = bool(own or new) or (several and _in_walls(assembly, M, F, held, left, shown))
            known = (held, left, shown) if told else ((), (), ())
            found.append((i, j, Pair(M, F, own, new, *known)))
    return Facing(tuple(found))


def _in_walls(
    assembly: Assembly,
    moving: Polyhedron,
    fixed: Polyhedron,
    held: tuple[PrimitiveContact, ...],
    left: tuple[PrimitiveContact, ...],
    opening: tuple[PrimitiveContact, ...],
) -> bool:
    """Whether contacts say something of two pieces that they do not touch themselves.

    A part that is not convex may touch a wall with one of its pieces and have others flush with it, or on its rim.
    """
    known, off = facts(assembly, held), coming_off(assembly, held, left)
    for normal, offset in zip(fixed.normals, fixed.offsets, strict=True):
        points = set(known.level_with(normal, offset).points)
        points.update(
            i for wall in off if assembly.agree(wall.normal, wall.offset, normal, offset) for i in wall.points
        )
        if points and _shares(moving.vertices, assembly.body_points[sorted(points)]):
            return True
    if edges_beside(assembly, moving, fixed, held, opening):
        return True
    rims = level_rims(assembly, held, opening)
    return any(
        rim.before(fixed.vertices, normal, offset).any()
        for rim in rims
        for normal, offset in zip(moving.normals, moving.offsets, strict=True)
    )


def _shares(points: Array, others: Array) -> bool:
    """Whether one of some points (n, 3) is one of some others (m, 3)."""
    return bool((np.abs(points[:, None] - others).max(axis=2) <= NEAR).any())


@dataclass(frozen=True, eq=False)
class LevelRim:
    """A rim of the fixed part that is level with the plane of a face of the moving one, and not behind it.

    Args:
        at: a point of the rim (3,).
        along: its unit direction (3,), as the contact's edge runs.
        way: unit direction (3,) of the face's edge that touches it, in the body.
        normal: of the face in the body (3,).
        offset: of the face, m.
        held: whether the rim lies in the plane.
    """

    at: Array
    along: Array
    way: Array
    normal: Array
    offset: float
    held: bool

    def before(self, points: Array, normal: Array, offset: float) -> Mask:
        """Which fixed points (k, 3) are not behind a body plane, as they are no farther from the rim than it is.

        In the body it lies at least as far behind the face's plane as the points are away from the rim.

        Args:
            points: in the world.
            normal: of the plane, in the body.
            offset: of it, m.
        """
        if length(normal - self.normal) > NEAR:
            return np.zeros(len(points), dtype=np.bool_)
        return np.asarray(lengths(cross(points - self.at, self.along)) <= self.offset - offset + NEAR)


@remembered(_MEMORY)
def level_rims(
    assembly: Assembly, held: tuple[PrimitiveContact, ...], opening: tuple[PrimitiveContact, ...]
) -> tuple[LevelRim, ...]:
    """The rims that contacts keep level with faces of the moving part, and from going behind them.

    Two edges of a face on one rim put that into the face's plane. One edge does where what is known of turns keeps the
    face level with the rim, and keeps it from going behind where that contact is being made or given up.

    Args:
        assembly: the two parts.
        held: all contacts held.
        opening: the contact being made that counts and those given up.
    """
    body, fixed, found = assembly.moving.polyhedron, assembly.fixed.polyhedron, list[LevelRim]()
    if len(assembly.moving.bodies) == 1:
        return ()  # what touches is the piece itself
    edges = [contact for contact in (*held, *opening) if contact.kind is Kind.EDGE_EDGE]
    faces = {contact: set(body.edges[contact.moving_feature].faces) for contact in edges}
    level = {
        (contact, *faces[contact] & faces[other])
        for contact, other in permutations(edges, 2)
        if contact.fixed_feature == other.fixed_feature
        and contact.moving_feature != other.moving_feature
        and contact in held
        and other in held
        and len(faces[contact] & faces[other]) == 1
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


@remembered(_MEMORY)
def edges_level(
    assembly: Assembly,
    moving: Polyhedron,
    fixed: Polyhedron,
    held: tuple[PrimitiveContact, ...],
    opening: tuple[PrimitiveContact, ...],
) -> tuple[tuple[tuple[int, int], tuple[int, int]], ...]:
    """Edges of two pieces, of which a level rim says that the fixed one is not behind a face at the moving one.

    As vertex indices of the two pieces, run like the contact's edges; arguments as of `edges_beside`.
    """
    found = []
    for rim in level_rims(assembly, held, opening):
        offset = float((moving.vertices @ rim.normal).max())
        before = rim.before(fixed.vertices, rim.normal, offset)
        own = [edge.vertices for edge in moving.edges if _runs(moving.vertices[[*edge.vertices]], rim.way)]
        on = [ends for ends in own if (moving.vertices[[*ends]] @ rim.normal >= offset - NEAR).all()]
        for other in fixed.edges:
            if before[[*other.vertices]].all() and _runs(fixed.vertices[[*other.vertices]], rim.along):
                run = _run_like(fixed.vertices, other.vertices, rim.along)
                found += [(_run_like(moving.vertices, ends, rim.way), run) for ends in on]
    return tuple(dict.fromkeys(found))


def _runs(ends: Array, way: Array) -> bool:
    """Whether an edge (2, 3) is parallel to a unit direction."""
    return length(cross(ends[1] - ends[0], way)) <= NEAR


def _run_like(vertices: Array, ends: tuple[int, int], way: Array) -> tuple[int, int]:
    i, j = ends
    return (i, j) if float((vertices[j] - vertices[i]) @ way) > 0.0 else (j, i)


def pairs(assembly: Assembly, piece: Piece) -> tuple[tuple[int, int, Pair], ...]:
    """The pairs of `facing`."""
    return facing(assembly, piece).listed


def touching(
    assembly: Assembly, moving: Polyhedron, fixed: Polyhedron, contacts: Iterable[PrimitiveContact]
) -> tuple[PrimitiveContact, ...]:
    """The contacts that two pieces can have with each other: on a face plane or along an edge of each."""
    own, other = assembly.carried(moving), assembly.carried(fixed)
    return tuple(c for c in contacts if _between(c, own, other))


def _between(contact: PrimitiveContact, moving: Features, fixed: Features) -> bool:
    one, other = _FEATURES[contact.kind]
    return (one, contact.moving_feature) in moving and (other, contact.fixed_feature) in fixed


@remembered(_MEMORY)
def edge_along(piece: Polyhedron, part: Polyhedron, ends: tuple[int, ...]) -> tuple[int, int] | None:
    """The piece's edge on the line through two vertices of its part, run from the first towards the second, if any."""
    a, b = part.vertices[list(ends)]
    direction = (b - a) / length(b - a)
    off = lengths(cross(piece.vertices - a, direction))
    for edge in piece.edges:
        i, j = edge.vertices
        if max(off[i], off[j]) <= 1e-9:
            forward = float((piece.vertices[j] - piece.vertices[i]) @ direction) > 0.0
            return (i, j) if forward else (j, i)
    return None


@remembered(_MEMORY)
def edges_beside(
    assembly: Assembly,
    moving: Polyhedron,
    fixed: Polyhedron,
    held: tuple[PrimitiveContact, ...],
    opening: tuple[PrimitiveContact, ...],
) -> tuple[tuple[tuple[int, int], tuple[int, int]], ...]:
    """Edges of a moving piece beside one in touch, that are known to lie along the fixed edge from it, with that one.

    As vertex indices of the two pieces, run like the contacts' edges.

    Args:
        assembly: the two parts.
        moving: the moving piece.
        fixed: the fixed piece.
        held: all contacts held.
        opening: contacts being made or given up.
    """
    known, body, found = facts(assembly, held), assembly.moving.polyhedron.vertices, []
    if not known.turns or len(assembly.moving.bodies) == 1:
        return ()
    for contact in (*held, *opening):
        rim = edge_along(fixed, assembly.fixed.polyhedron, contact.fixed) if contact.kind is Kind.EDGE_EDGE else None
        if rim is None:
            continue
        c, d = fixed.vertices[list(rim)]
        for edge in moving.edges:
            i, j = edge.vertices
            if beside(known, body[list(contact.moving)], moving.vertices[[i, j]], (d - c) / length(d - c)):
                a, b = body[list(contact.moving)]
                forward = float((moving.vertices[j] - moving.vertices[i]) @ (b - a)) > 0.0
                found.append(((i, j) if forward else (j, i), rim))
    return tuple(dict.fromkeys(found))


def beside(known: Facts, one: Array, other: Array, along: Array) -> bool:
    """Whether a second edge of the body is parallel to one, and known to lie along a unit direction (3,) from it.

    Args:
        known: what contacts say.
        one: ends (2, 3) of an edge.
        other: of the second one, not on the same line.
        along: in the world.
    """
    way = (one[1] - one[0]) / length(one[1] - one[0])
    if not on_line(other, other[0], way).all():
        return False
    off = other[0] - one[0]
    off = off - way * float(way @ off)
    return length(off) > NEAR and bool(known.beside(off[None], along)[0])


def free_plane(normal: Sequence[float], offset: float) -> Witness:
    """The plane of a unit normal (3) just in front of a fixed piece that reaches out to an offset, m."""
    return Witness("plane", (), (), (normal[0], normal[1], normal[2], offset + BEHIND))
