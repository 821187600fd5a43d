"""Bounds of primitive contacts: the neighbouring contacts at which a facet ends. [DakinPopplestone1993] eq. 1.

Where faces and edges end: the faces across the edges of a face, and how edges pass the faces beside each other.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TypeAlias, assert_never

import numpy as np

from fmopt.contact.c_surface import Surfaces
from fmopt.contact.primitive import Kind, PrimitiveContact, convex_vertices, face_vertex, vertex_face
from fmopt.geometry.polyhedron import Polyhedron
from fmopt.spatial.se3 import Pose, cross
from fmopt.spatial.values import Array, Indices, Value, remembered

_MEMORY, _SIDES = 1024, 16

INSIDE = 1e-9  # m; a pose no further than this inside a bound is on it


@dataclass(frozen=True)
class BoundingFunction:
    """A bounding function g = sign × f of a neighbouring contact; g < 0 inside the facet."""

    contact: PrimitiveContact
    sign: int


Clause: TypeAlias = tuple[tuple[BoundingFunction, ...], ...]
"""Alternatives, each a set of bounds that hold together; one of them must."""


def bounds(contact: PrimitiveContact, moving: Polyhedron, fixed: Polyhedron, pose: Pose) -> tuple[Clause, ...]:
    """The bounding functions of a contact: a pose of its surface is on the facet when every clause holds.

    For a face, the same vertex on the neighbour across each convex edge; a convex face gives one alternative a clause,
    a hole or a notch gives several. For edges, their end points against the other edge's faces, the sides of which a
    pose near the contact tells. What ends at a wall (a reflex edge) is not bounded: the wall's own contacts stop it.
    """
    return BoundTable.of((contact,), moving, fixed, pose).clauses[0]


@dataclass(frozen=True, eq=False)
class BoundTable(Value):
    """The bounds of k contacts, tabulated for evaluation.

    Attributes:
        surfaces: C-surface functions of the bounds' contacts.
        places: (k, clauses, alternatives, bounds together), index into `listed`; the number of bounds where a set is
            full, one more where a clause has no further alternative.
    """

    clauses: tuple[tuple[Clause, ...], ...]
    listed: tuple[BoundingFunction, ...]
    surfaces: Surfaces
    places: Indices

    @staticmethod
    def of(contacts: Sequence[PrimitiveContact], moving: Polyhedron, fixed: Polyhedron, pose: Pose) -> BoundTable:
        """The table of the contacts' bounds, in their order, told apart by which way edges cross at a pose."""
        crossings = Crossings.of(contacts, moving, fixed)
        return _table(crossings, crossings.sides(pose))

    @cached_property
    def signs(self) -> Indices:
        """The sign (n,) of each of `listed`."""
        return np.array([bound.sign for bound in self.listed], dtype=np.intp)

    def depths(self, g: Array) -> tuple[Array, Indices]:
        """How far (m) poses are inside each clause of each contact, and by which bound, from values g (…, m) there.

        These are depths (…, k, clauses), inf for a clause that a contact does not have, and indices into `listed`; g is
        of `surfaces`.
        """
        # Two more columns for what `places` has beyond the bounds: never binding within a group, never best among
        # groups.
        ends = np.broadcast_to([np.inf, -np.inf], (*g.shape[:-1], 2))
        depth = np.concatenate([-self.signs * g, ends], axis=-1)[..., self.places]
        if 0 in depth.shape[-3:]:
            none = np.full((*g.shape[:-1], *self.places.shape[:2]), np.inf)
            return none, np.full(none.shape, len(self.listed), dtype=np.intp)
        # Convex faces have one group of one bound in each clause: the usual case, in which nothing is compared.
        if self.places.shape[2:] == (1, 1):
            return depth[..., 0, 0], np.broadcast_to(self.places[..., 0, 0], depth.shape[:-2])
        # Within a group all bounds hold together, so that the least depth counts; among alternatives the greatest.
        together = np.argmin(depth, axis=-1)[..., None]
        least = np.take_along_axis(depth, together, axis=-1)[..., 0]
        best = np.argmax(least, axis=-1)[..., None]
        places = np.broadcast_to(self.places, depth.shape)
        which = np.take_along_axis(np.take_along_axis(places, together, axis=-1)[..., 0], best, axis=-1)[..., 0]
        return np.take_along_axis(least, best, axis=-1)[..., 0], which

    def insides(self, pose: Pose) -> Array:
        """How far (m) the pose is inside each contact's bounds (k,): −g of the binding one, inf when unbounded."""
        depth, _ = self.depths(self.surfaces.values(pose))
        return np.asarray(np.min(depth, axis=-1, initial=np.inf))


def touching(
    contacts: Sequence[PrimitiveContact], moving: Polyhedron, fixed: Polyhedron, pose: Pose, within: float = INSIDE
) -> tuple[PrimitiveContact, ...]:
    """Those of the contacts that touch at a pose: f = 0 to 1e-9 m, and more than `within` (m) inside their bounds.

    A depth `within` below 0 admits contacts that lie outside their bounds by as much.
    """
    # On the surface first: bounds are only asked of what touches.
    level = np.abs(Surfaces.of(contacts, moving, fixed).values(pose)) <= INSIDE
    found = [contact for contact, on in zip(contacts, level, strict=True) if on]
    inside = BoundTable.of(found, moving, fixed, pose).insides(pose)
    return tuple(contact for contact, depth in zip(found, inside, strict=True) if depth > within)


def cell(
    contacts: Sequence[PrimitiveContact], moving: Polyhedron, fixed: Polyhedron, pose: Pose, within: float
) -> tuple[tuple[PrimitiveContact, ...], tuple[BoundingFunction, ...]]:
    """The contacts that are within their bounds at a pose, and the bounds that have to stay as they are there.

    Where parts are open, as at the mouth of a hole, free space is no intersection of half-spaces. In the cell around a
    pose in which no listed bound changes sign it is: the kept contacts' f ≥ 0 and nothing else. A contact that the free
    pose violates is none: in a notch, a face told edge by edge seems to go on over the notch. These are the limits
    g < 0 of the cell; bounds further away than `within` (m) are left out, as they are not reached.
    """
    table = BoundTable.of(contacts, moving, fixed, pose)
    g = dict(zip((bound.contact.id for bound in table.listed), table.surfaces.values(pose), strict=True))
    unviolated = Surfaces.of(contacts, moving, fixed).values(pose) >= -INSIDE

    def depth(bound: BoundingFunction) -> float:
        return -bound.sign * float(g[bound.contact.id])

    kept, limits = [], dict[BoundingFunction, None]()
    for contact, clauses, may_be in zip(contacts, table.clauses, unviolated, strict=True):
        # Of alternatives the one that the pose is deepest in is kept: the cell is convex.
        groups = [max(clause, key=lambda group: min(map(depth, group))) for clause in clauses]
        insides = [min(map(depth, group)) for group in groups]
        if min(insides, default=1.0) > INSIDE:
            if may_be:
                kept.append(contact)
                limits.update(dict.fromkeys(bound for group in groups for bound in group))
        else:
            # Outside it is enough to stay beyond one clause; the one that the pose is farthest beyond is the most
            # robust.
            outside = clauses[int(np.argmin(insides))]
            worst = (min(group, key=depth) for group in outside)
            limits.update(dict.fromkeys(BoundingFunction(bound.contact, -bound.sign) for bound in worst))
    # A bound that is the contact itself, seen from the other side, says nothing new.
    held = {BoundingFunction(contact, -1) for contact in kept}
    return tuple(kept), tuple(bound for bound in limits if depth(bound) <= within and bound not in held)


@remembered(_SIDES)
def _table(crossings: Crossings, sides: bytes) -> BoundTable:
    """The bounds of contacts whose edges pass each other in this way, tabulated."""
    clauses = _clauses(crossings, sides)
    groups = [[group for clause in of_contact for group in clause] for of_contact in clauses]
    listed = tuple(dict.fromkeys(bound for of_contact in groups for group in of_contact for bound in group))
    number = {bound: i for i, bound in enumerate(listed)}
    sizes = (
        max((len(of_contact) for of_contact in clauses), default=0),
        max((len(clause) for of_contact in clauses for clause in of_contact), default=0),
        max((len(group) for of_contact in groups for group in of_contact), default=0),
    )
    # Filled with the number of what never binds; where alternatives run out, of what is never best.
    places = np.full((len(clauses), *sizes), len(listed), dtype=np.intp)
    for i, of_contact in enumerate(clauses):
        for j, clause in enumerate(of_contact):
            places[i, j, len(clause) :] = len(listed) + 1
            for n, group in enumerate(clause):
                places[i, j, n, : len(group)] = [number[bound] for bound in group]
    places.setflags(write=False)
    surfaces = Surfaces.of([bound.contact for bound in listed], *crossings.parts)
    return BoundTable(clauses, listed, surfaces, places)


def _clauses(crossings: Crossings, sides: bytes) -> tuple[tuple[Clause, ...], ...]:
    """The bounds of each of the contacts."""
    (moving, fixed), pairs = crossings.parts, zip(sides[::2], sides[1::2], strict=True)
    found = list[tuple[Clause, ...]]()
    for contact in crossings.contacts:
        match contact.kind:
            case Kind.VERTEX_FACE | Kind.BALL_FACE:
                found.append(_face_bounds(fixed, contact.fixed_feature, contact.moving_feature, False))
            case Kind.FACE_VERTEX:
                found.append(_face_bounds(moving, contact.moving_feature, contact.fixed_feature, True))
            case Kind.EDGE_EDGE:
                found.append(_edge_clauses(contact, moving, fixed, next(pairs)))
            case _:
                assert_never(contact.kind)
    return tuple(found)


@remembered(_MEMORY)
def _face_bounds(body: Polyhedron, face: int, vertex: int, moving: bool) -> tuple[Clause, ...]:
    """The bounds of a vertex, or of a ball's centre over where it touches, on a face of either part."""

    def contact(side: int) -> PrimitiveContact:
        return face_vertex(body, side, vertex) if moving else vertex_face(body, vertex, side)

    clauses = face_clauses(body, face)
    return tuple(
        tuple(tuple(BoundingFunction(contact(side), 1) for side in group) for group in clause) for clause in clauses
    )


def _edge_clauses(
    contact: PrimitiveContact, moving: Polyhedron, fixed: Polyhedron, sides: tuple[int, int]
) -> tuple[Clause, ...]:
    """For each free end of the two edges, the end against that face of the other edge which it passes most steeply."""
    one, other = moving.edges[contact.moving_feature], fixed.edges[contact.fixed_feature]
    # Face and way are packed in one number of a byte, so that the key of what is remembered is short.
    (passed, slope), (passing, turned) = (divmod(side, 3) for side in sides)
    found = [
        BoundingFunction(vertex_face(fixed, vertex, other.faces[passed]), 1 if away * (slope - 1) < 0 else -1)
        for vertex, away in zip(contact.moving, (-1, 1), strict=True)
        if vertex in convex_vertices(moving)
    ]
    found += [
        BoundingFunction(face_vertex(moving, one.faces[passing], vertex), 1 if away * (turned - 1) < 0 else -1)
        for vertex, away in zip(contact.fixed, (-1, 1), strict=True)
        if vertex in convex_vertices(fixed)
    ]
    return tuple(((bound,),) for bound in found)


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
    # A reflex edge bounds nothing, and a clause with an alternative that bounds nothing holds everywhere.
    bounded = [[tuple(g for g in group if g is not None) for group in clause] for clause in clauses]
    return tuple(tuple(dict.fromkeys(clause)) for clause in dict.fromkeys(map(tuple, bounded)) if all(clause))


def _runs(polyhedron: Polyhedron, face: int, loop: tuple[int, ...], reflex: bool) -> list[Array]:
    """Maximal runs (k, 2) of the loop's edges joined at reflex (or else at convex) corners."""
    points = polyhedron.vertices[list(loop)]
    ahead = np.roll(points, -1, axis=0) - points
    # The turn from one edge to the next, with its sign about the face's own normal.
    bend = cross(np.roll(ahead, 1, axis=0), ahead) @ polyhedron.faces[face].normal
    joins = (bend < 0.0) if reflex else (bend > 0.0)
    turn = -int(np.argmin(joins))  # to begin at a break, so that no run is cut in two
    edges, joins = np.roll(np.column_stack([loop, np.roll(loop, -1)]), turn, axis=0), np.roll(joins, turn)
    return np.split(edges, np.flatnonzero(~joins[1:]) + 1)


@dataclass(frozen=True, eq=False)
class Crossings:
    """The m edge–edge contacts among some of two parts, and what tells at a pose how their edges pass each other.

    Attributes:
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
        # Rates of height along each edge over both faces beside the other: moving edge over fixed faces, and the other
        # way.
        passing = np.vecdot(self.across, (ends[:, 1] - ends[:, 0])[:, None]), np.vecdot(beside, self.along[:, None])
        slopes = np.stack(passing, axis=1)
        # The steeper face: an end passes it soonest, while the other one may be level with the way.
        steep = np.argmax(np.abs(slopes), axis=2)
        slope = np.take_along_axis(slopes, steep[..., None], axis=2)[..., 0]
        # Three values of a sign and two faces in a number below 6, as key of what is remembered.
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
