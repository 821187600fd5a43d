"""Planes along an edge of a moving and of a fixed piece: which of their rows count.

The rows of a plane along two edges in touch are heights relative to these, and what contacts say settles many.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import chain

import numpy as np

from fmopt.certificate.assembly import NEAR, Assembly, hinge, level, on_line
from fmopt.certificate.contact_implications import Facts, rising
from fmopt.certificate.level_rims import LevelRim, beside, level_rims
from fmopt.certificate.piece_pairs import Pair, PlaneWitness
from fmopt.certificate.remainder import Extent
from fmopt.certificate.rows import Forms, directions_along, edges_apart, points_above, stacked
from fmopt.contact.primitive import Kind, PrimitiveContact
from fmopt.geometry.polyhedron import Polyhedron
from fmopt.spatial.se3 import Pose, cross, length, lengths
from fmopt.spatial.values import Array, Bits, remembered

_MEMORY = 4096


@dataclass(frozen=True, eq=False)
class Onto:
    """An end of the moving edge that comes to lie on a wall along the fixed edge.

    Where the witness plane's normal keeps a positive part along the wall's (row `outside`) and the end stays inside
    the rim (row `inside`), the wall is behind the plane, and its vertices `behind` (k,) need no rows of their own.
    """

    outside: int
    inside: int
    behind: Bits


@dataclass(frozen=True, eq=False)
class Counted:
    """The rows of a witness that contacts do not settle: distances that must stay positive."""

    forms: Forms
    always: int  # how many of them, the first ones, count always; the others as `onto` says
    onto: tuple[Onto, ...] = ()
    edges: tuple[Array, Array] | None = None  # unit directions of the moving and of the fixed edge, for kind "edges"

    def scale(self, start: Pose, goal: Pose, extent: Extent) -> float:
        """What margins are divided by: an upper bound, at most 1, of the length of the rows' normal."""
        if self.edges is None:
            return 1.0
        e_m, e_f = self.edges
        sines = [length(cross(pose.R @ e_m, e_f)) for pose in (start, goal)]
        return min(1.0, max(sines) + extent.theta + extent.turn)

    @property
    def surely(self) -> Bits:
        """Which rows (k,) count whatever the errors are."""
        which = np.arange(len(self.forms)) < self.always
        for onto in self.onto:
            which &= ~onto.behind
        return which

    def counts(self, lower: Array) -> Bits:
        """Which rows count, given the lower bounds (k,) of all."""
        which = np.arange(len(lower)) < self.always
        for onto in self.onto:
            if lower[onto.outside] > 0.0:
                which[onto.inside] = True
                which &= ~onto.behind
        return which


def contacts_of(pair: Pair) -> tuple[PrimitiveContact, ...]:
    """The contacts held, the one being made that counts, and those given up."""
    return (*pair.state, *pair.beside)


@dataclass(frozen=True, eq=False)
class _Edge:
    """An edge of a piece, run from one end to the other."""

    ends: Array  # both ends (2, 3), m
    along: Array  # unit direction (3,)
    arms: Array  # (v − a) × e for all vertices v of the piece (k, 3), a the first end and e the direction, m
    on: Bits  # which vertices (k,) lie on its line
    points: frozenset[int]


@remembered(_MEMORY)
def _edge(piece: Polyhedron, part: Polyhedron, ends: tuple[int, ...]) -> _Edge:
    a, b = piece.vertices[list(ends)]
    along = (b - a) / length(b - a)
    arms = cross(piece.vertices - a, along)
    points = frozenset(np.flatnonzero(on_line(part.vertices, a, along)).tolist())
    return _Edge(np.array([a, b]), along, arms, lengths(arms) <= NEAR, points)


def _meet(contact: PrimitiveContact, moving: _Edge, fixed: _Edge) -> bool:
    """Whether a contact is one of just these two edges."""
    of_edges = contact.kind is Kind.EDGE_EDGE
    return of_edges and moving.points.issuperset(contact.moving) and fixed.points.issuperset(contact.fixed)


def edge_rows(assembly: Assembly, pair: Pair, witness: PlaneWitness, known: Facts) -> Counted:
    """The rows of a plane along an edge of each of two pieces that contacts do not settle, m."""
    M, F = pair.moving.vertices, pair.fixed.vertices
    moving = _edge(pair.moving, assembly.moving.polyhedron, witness.moving)
    fixed = _edge(pair.fixed, assembly.fixed.polyhedron, witness.fixed)
    (a, b), e_m, c, e_f = moving.ends, moving.along, fixed.ends[0], fixed.along
    held, made = _anchored(assembly, pair, moving, fixed, known)
    rims = () if held or made or not assembly.several else _level(assembly, pair, moving, fixed)
    if held or made or rims:
        # Heights are relative to the moving edge, which is on the plane or not below it.
        settled = moving.on | known.beside(M - a, e_f) | known.beside(M - b, e_f)
        settled |= _levelled(assembly, pair, moving, fixed)
        settled |= rising(known.turns, e_f, moving.arms)
        for rim in rims:
            settled |= np.abs((M - a) @ rim.normal) <= NEAR
        upper = directions_along(e_f, moving.arms[~settled])
    else:
        upper = edges_apart(e_m, e_f, c, M)
    off = F[~fixed.on]
    parts = [upper, directions_along(fixed.arms[~fixed.on], e_m)]
    always = count = len(upper) + len(off)
    behind = []

    def on_edge(v: Array) -> bool:
        """Whether a point is on the moving edge, or beside it along the fixed one."""
        off = v - a
        off = off - e_m * float(e_m @ off)
        return length(off) <= NEAR or bool(known.beside(off[None], e_f)[0])

    turned = [_turned_onto(assembly, pair, (c, e_f), on_edge)] if held else []
    turned += [_turned_onto(assembly, pair, (rim.at, rim.along), rim.has) for rim in rims if rim.held]
    for vertex, inward, at, n in chain.from_iterable(turned):
        parts += [directions_along(cross(e_f, n)[None], e_m), points_above(vertex[None], inward, at)]
        behind.append((np.abs((off - c) @ n) <= NEAR) & ((off - c) @ inward >= -NEAR))
    count += 2 * len(behind)
    places = zip(range(always, count, 2), behind, strict=True)
    onto = tuple(Onto(k, k + 1, np.pad(mask, (len(upper), count - len(upper) - len(mask)))) for k, mask in places)
    return Counted(stacked(*parts), always, onto, (e_m, e_f))


def _level(assembly: Assembly, pair: Pair, moving: _Edge, fixed: _Edge) -> tuple[LevelRim, ...]:
    """The level rims that keep the fixed edge from going behind a plane through the moving one."""
    found = []
    for rim in level_rims(assembly, pair.state, pair.beside):
        parallel = length(moving.along - rim.way) <= NEAR and length(fixed.along - rim.along) <= NEAR
        if parallel and rim.before(fixed.ends, rim.normal, float(rim.normal @ moving.ends[0])).all():
            found.append(rim)
    return tuple(found)


def _beside(assembly: Assembly, known: Facts, contact: PrimitiveContact, moving: _Edge, fixed: _Edge) -> bool:
    """Whether a contact is of the fixed edge and an edge beside the moving one, see `beside`."""
    if contact.kind is not Kind.EDGE_EDGE or not fixed.points.issuperset(contact.fixed):
        return False
    return beside(known, assembly.moving.polyhedron.vertices[list(contact.moving)], moving.ends, fixed.along)


def _anchored(assembly: Assembly, pair: Pair, moving: _Edge, fixed: _Edge, known: Facts) -> tuple[bool, bool]:
    """Whether a contact of just these two edges is held, and whether one is made or given up on the plane's side.

    So does one of an edge beside the moving one, which what is known of turns puts along the fixed edge from it.
    """
    body, world = assembly.moving.polyhedron.vertices, assembly.fixed.polyhedron.vertices
    held = made = False
    for contact in contacts_of(pair):
        both = _meet(contact, moving, fixed) or (assembly.several and _beside(assembly, known, contact, moving, fixed))
        if not both:
            continue
        if contact in pair.state:
            held = True
        elif hinge(assembly, contact, pair.state) is None:
            own, other = body[list(contact.moving)], world[list(contact.fixed)]
            made |= float((own[1] - own[0]) @ moving.along) * float((other[1] - other[0]) @ fixed.along) > 0.0
    return held, made


def _levelled(assembly: Assembly, pair: Pair, moving: _Edge, fixed: _Edge) -> Bits:
    """Vertices (n,) of the moving piece on a face that a second edge holds level with the fixed edge, or will.

    In the plane of both edges the face's heights are those of the fixed edge over the face, seen from the moving edge.
    """
    body, M = assembly.moving.polyhedron.vertices, pair.moving.vertices
    done = np.zeros(len(M), dtype=np.bool_)
    for held in pair.state:
        if not _meet(held, moving, fixed):
            continue
        for contact in contacts_of(pair):
            found = level(assembly, contact, (held,))
            if found is not None:
                far = length(found[1])
                normal, away = found[1] / far, cross(moving.along, found[1] / far)
                at = body[held.moving[0]]
                off = M - at
                reach = (body[list(contact.moving)] - at) @ away
                side = float(reach[int(np.argmax(np.abs(reach)))])
                done |= (np.abs(off @ normal) <= NEAR) & (np.sign(side) * (off @ away) >= -NEAR)
    return done


def _turned_onto(
    assembly: Assembly, pair: Pair, rim: tuple[Array, Array], lies: Callable[[Array], bool]
) -> Iterator[tuple[Array, Array, float, Array]]:
    """Vertices in the plane of both edges, in which a body point `lies`, that are on a wall along the fixed one.

    The rim of the wall is given by a point of it and its unit direction (3,), in the plane.

    Returns:
        (body vertex, direction inward in the wall, how far the rim is along it in m, the wall's normal) of each.
    """
    body, fixed, (at, along) = assembly.moving.polyhedron.vertices, assembly.fixed.polyhedron, rim
    for contact in contacts_of(pair):
        if contact.kind is Kind.VERTEX_FACE and lies(vertex := body[contact.moving[0]]):
            wall = fixed.faces[contact.fixed_feature]
            if abs(float(wall.normal @ along)) <= NEAR and abs(float(wall.normal @ at) - wall.offset) <= NEAR:
                inward = _inward(fixed.vertices[list(contact.fixed)], at, along, wall.normal)
                yield vertex, inward, float(inward @ at), wall.normal


def _inward(corners: Array, at: Array, along: Array, normal: Array) -> Array:
    """The unit direction into a face with corners (k, 3) from the rim through a point of it, across that."""
    inward = corners.mean(axis=0) - at
    for axis in (along, normal):
        inward = inward - axis * float(axis @ inward)
    return np.asarray(inward / length(inward))
