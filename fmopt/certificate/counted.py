"""Which rows of a witness plane count: those that the contacts do not settle.

That depends on the contacts alone, not on poses, and is worked out once for each contact state.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fmopt.certificate.assembly import NEAR, Assembly, hinge, level, on_line
from fmopt.certificate.curvature import Extent
from fmopt.certificate.knowledge import Facts, coming_off, facts, rising
from fmopt.certificate.pair import Pair, Witness
from fmopt.certificate.rows import Forms, Mask, directions_along, edges_apart, faces_above, points_above, stacked
from fmopt.contact.primitive import Kind, PrimitiveContact
from fmopt.geometry.polyhedron import Polyhedron
from fmopt.memory import remembered
from fmopt.se3 import Pose, cross, length, lengths
from fmopt.values import Array

_MEMORY = 4096

Line = tuple[Array, Array]
"""A point and a unit direction."""


@dataclass(frozen=True, eq=False)
class Onto:
    """An end of the moving edge that comes to lie on a wall along the fixed edge.

    Where the witness plane's normal keeps a positive part along the wall's (row `outside`) and the end stays inside
    the rim (row `inside`), the wall is behind the plane, and its vertices `behind` (k,) need no rows of their own.
    """

    outside: int
    inside: int
    behind: Mask


@dataclass(frozen=True, eq=False)
class Counted:
    """The rows of a witness that contacts do not settle: distances that must stay positive.

    Args:
        forms: the rows.
        always: how many of them, the first ones, count always; the others as `onto` says.
        onto: walls that the moving edge turns onto.
        edges: unit directions of the moving and of the fixed edge, for kind "edges".
    """

    forms: Forms
    always: int
    onto: tuple[Onto, ...] = ()
    edges: tuple[Array, Array] | None = None

    def scale(self, start: Pose, goal: Pose, extent: Extent) -> float:
        """What margins are divided by: an upper bound, at most 1, of the length of the rows' normal."""
        if self.edges is None:
            return 1.0
        e_m, e_f = self.edges
        sines = [length(cross(pose.R @ e_m, e_f)) for pose in (start, goal)]
        return min(1.0, max(sines) + extent.theta + extent.turn)

    def counts(self, lower: Array) -> Mask:
        """Which rows count, given the lower bounds (k,) of all."""
        which = np.arange(len(lower)) < self.always
        for onto in self.onto:
            if lower[onto.outside] > 0.0:
                which[onto.inside] = True
                which &= ~onto.behind
        return which


def counted_rows(assembly: Assembly, pair: Pair, witness: Witness) -> Counted:
    """The rows of a witness that contacts do not settle."""
    if witness.plane is not None:
        return _all(points_above(pair.moving.vertices, np.array(witness.plane[:3]), witness.plane[3]))
    return _of_pieces(assembly, pair, witness)


@remembered(_MEMORY)
def _of_pieces(assembly: Assembly, pair: Pair, witness: Witness) -> Counted:
    M, F = pair.moving.vertices, pair.fixed.vertices
    if witness.kind == "fixed-face":
        n = _normal(pair.fixed, witness.fixed)
        offset = float((F @ n).max())
        settled = facts(assembly, pair.state).not_below(n, offset, M, _above(assembly, pair, n, offset))
        return _all(points_above(M[~settled], n, offset))
    if witness.kind == "moving-face":
        n = _normal(pair.moving, witness.moving)
        offset = float((M @ n).max())
        return _all(faces_above(n, offset, F[~_touched(assembly, pair, n, offset)]))
    return _edge_rows(assembly, pair, witness, facts(assembly, pair.state))


def _all(forms: Forms) -> Counted:
    return Counted(forms, len(forms))


def _normal(piece: Polyhedron, loop: tuple[int, ...]) -> Array:
    for face in piece.faces:
        if face.loops[0] == loop:
            return face.normal
    raise KeyError(loop)


def _contacts(pair: Pair) -> tuple[PrimitiveContact, ...]:
    """The contacts held, the one being made that counts, and those given up."""
    return (*pair.state, *pair.beside)


def _above(assembly: Assembly, pair: Pair, normal: Array, offset: float) -> Array:
    """Body points (m, 3) that do not cross a fixed plane: of contacts not yet made, or given up, or flat with these."""
    walls = coming_off(assembly, pair.state, pair.left)
    kept = [i for wall in walls if assembly.agree(wall.normal, wall.offset, normal, offset) for i in wall.points]
    for contact in pair.beside:
        if contact.kind is Kind.VERTEX_FACE:
            number, vertex = contact.fixed_feature, contact.moving[0]
        else:
            found = hinge(assembly, contact, pair.state)
            if found is None:
                continue
            number, _, vertex = found
        face = assembly.fixed.polyhedron.faces[number]
        if assembly.agree(face.normal, face.offset, normal, offset):
            kept.append(vertex)
    return assembly.body_points[kept]


def _touched(assembly: Assembly, pair: Pair, normal: Array, offset: float) -> Mask:
    """Vertices of the fixed piece that face–vertex contacts put on a moving face."""
    F = pair.fixed.vertices
    done = np.zeros(len(F), dtype=np.bool_)
    for contact in _contacts(pair):
        if contact.kind is Kind.FACE_VERTEX:
            face = assembly.moving.polyhedron.faces[contact.moving_feature]
            if assembly.agree(face.normal, face.offset, normal, offset):
                done |= lengths(F - assembly.fixed.polyhedron.vertices[contact.fixed[0]]) <= NEAR
    return done


def _edge_rows(assembly: Assembly, pair: Pair, witness: Witness, known: Facts) -> Counted:
    M, F = pair.moving.vertices, pair.fixed.vertices
    (a, b), (c, d) = M[list(witness.moving)], F[list(witness.fixed)]
    e_m, e_f = (b - a) / length(b - a), (d - c) / length(d - c)
    held, made = _anchored(assembly, pair, (a, e_m), (c, e_f))
    if held or made:
        # Heights are relative to the moving edge, which is on the plane or not below it.
        settled = on_line(M, a, e_m) | known.beside(M - a, e_f) | known.beside(M - b, e_f)
        settled |= _levelled(assembly, pair, (a, e_m), (c, e_f))
        settled |= rising(known.turns, e_f, cross(M - a, e_m))
        upper = directions_along(e_f, cross(M[~settled] - a, e_m))
    else:
        upper = edges_apart(e_m, e_f, c, M)
    off = F[~on_line(F, c, e_f)]
    parts = [upper, directions_along(-cross(e_f, off - c), e_m)]
    always = count = len(upper) + len(off)
    behind = []
    for vertex, inward, n, offset in _turned_onto(assembly, pair, (a, e_m), (c, e_f)) if held else ():
        parts += [directions_along(cross(e_f, n)[None], e_m), points_above(vertex[None], inward, float(inward @ c))]
        behind.append((np.abs(off @ n - offset) <= NEAR) & ((off - c) @ inward >= -NEAR))
    count += 2 * len(behind)
    onto = tuple(
        Onto(always + 2 * k, always + 2 * k + 1, _within(mask, len(upper), count)) for k, mask in enumerate(behind)
    )
    return Counted(stacked(*parts), always, onto, (e_m, e_f))


def _within(mask: Mask, at: int, count: int) -> Mask:
    wide = np.zeros(count, dtype=np.bool_)
    wide[at : at + len(mask)] = mask
    return wide


def _anchored(assembly: Assembly, pair: Pair, moving: Line, fixed: Line) -> tuple[bool, bool]:
    """Whether a contact of just these two edges is held, and whether one is made or given up on the plane's side."""
    body, world = assembly.moving.polyhedron.vertices, assembly.fixed.polyhedron.vertices
    held = made = False
    for contact in _contacts(pair):
        if contact.kind is not Kind.EDGE_EDGE:
            continue
        own, other = body[list(contact.moving)], world[list(contact.fixed)]
        if not (on_line(own, *moving).all() and on_line(other, *fixed).all()):
            continue
        if contact in pair.state:
            held = True
        elif hinge(assembly, contact, pair.state) is None:
            made |= float((own[1] - own[0]) @ moving[1]) * float((other[1] - other[0]) @ fixed[1]) > 0.0
    return held, made


def _levelled(assembly: Assembly, pair: Pair, moving: Line, fixed: Line) -> Mask:
    """Vertices (n,) of the moving piece on a face that a second edge holds level with the fixed edge, or will.

    In the plane of both edges the face's heights are those of the fixed edge over the face, seen from the moving edge.
    """
    body, world = assembly.moving.polyhedron.vertices, assembly.fixed.polyhedron.vertices
    M = pair.moving.vertices
    done = np.zeros(len(M), dtype=np.bool_)
    for held in pair.state:
        if held.kind is not Kind.EDGE_EDGE:
            continue
        own, other = body[list(held.moving)], world[list(held.fixed)]
        if not (on_line(own, *moving).all() and on_line(other, *fixed).all()):
            continue
        for contact in _contacts(pair):
            found = level(assembly, contact, (held,))
            if found is not None:
                far = length(found[1])
                normal, away = found[1] / far, cross(moving[1], found[1] / far)
                off = M - own[0]
                reach = (body[list(contact.moving)] - own[0]) @ away
                side = float(reach[int(np.argmax(np.abs(reach)))])
                done |= (np.abs(off @ normal) <= NEAR) & (np.sign(side) * (off @ away) >= -NEAR)
    return done


def _turned_onto(assembly: Assembly, pair: Pair, moving: Line, fixed: Line) -> list[tuple[Array, Array, Array, float]]:
    """Ends of the moving edge that lie on a wall along the fixed edge: (body vertex, inward in the wall, its plane)."""
    body, world = assembly.moving.polyhedron.vertices, assembly.fixed.polyhedron.vertices
    c, e_f = fixed
    found = []
    for contact in _contacts(pair):
        if contact.kind is not Kind.VERTEX_FACE:
            continue
        vertex = body[contact.moving[0]]
        wall = assembly.fixed.polyhedron.faces[contact.fixed_feature]
        along = abs(float(wall.normal @ e_f)) <= NEAR and abs(float(wall.normal @ c) - wall.offset) <= NEAR
        if along and on_line(vertex[None], *moving)[0]:
            inward = world[list(contact.fixed)].mean(axis=0) - c
            for axis in (e_f, wall.normal):
                inward = inward - axis * float(axis @ inward)
            found.append((vertex, inward / length(inward), wall.normal, wall.offset))
    return found
