"""What contacts say exactly about body points on fixed planes.

Along a segment the held contacts are zero, and the contact being made is not yet negative. The height of a body point
over a plane is affine in the point, so that a few known points settle whole edges and faces: a flush face lies in the
wall altogether, a face hinged in the wall stays on the side on which one of its points is. A flush face also turns a
body direction onto a known one of the world, and beside it an edge that lies in another wall does.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import chain
from weakref import ref

import numpy as np

from fmopt.certificate.assembly import NEAR, Assembly, beyond, in_plane, on_line, same_side
from fmopt.contact.primitive import Kind, PrimitiveContact
from fmopt.runtime.clock import heed
from fmopt.spatial.se3 import cross, length, lengths
from fmopt.spatial.values import Array, Bits, remembered, there

_SHORT = 1e-6  # m: what is nearer to a line than this spans no plane with it
_LEVEL = 3e-14  # of a vector: what arithmetic leaves of its height; the check decides that exactly
_STEEP = 1.0 / 64.0
_APART = 1.0 / 16.0
_MEMORY = 512


@dataclass(frozen=True, eq=False)
class Wall:
    """A fixed plane and the body points (indices) and body planes (unit normal, offset) known to lie in it."""

    normal: Array
    offset: float
    points: frozenset[int]
    between: tuple[tuple[int, int], ...]
    flush: tuple[tuple[Array, float], ...]


@dataclass(frozen=True, eq=False)
class Facts:
    """What held contacts say exactly."""

    owner: ref[Assembly]
    walls: tuple[Wall, ...]
    # Body directions, normals of flush faces first, with the world directions that they are turned onto
    turns: tuple[tuple[Array, Array], ...]

    @property
    def assembly(self) -> Assembly:
        """The two parts."""
        return there(self.owner)

    def on(self, normal: Array, offset: float) -> Wall:
        """What is known of a plane with the outward unit normal (3,) and an offset, m."""
        for wall in self.walls:
            if self.assembly.agree(wall.normal, wall.offset, normal, offset):
                return wall
        return Wall(normal, offset, frozenset(), (), ())

    def level_with(self, normal: Array, offset: float) -> Wall:
        """The same, or what follows for a plane beside a wall: a face in that is as far from it as the wall is."""
        known = self.on(normal, offset)
        for wall in self.walls if self.assembly.several else ():
            if not known.points and wall.flush and self.assembly.agree(wall.normal, offset, normal, offset):
                n, c = wall.flush[0]
                there = c + wall.offset - offset
                points = np.flatnonzero(np.abs(self.assembly.body_points @ n - there) <= NEAR)
                return Wall(normal, offset, frozenset(points.tolist()), (), ((n, there),))
        return known

    def not_below(self, normal: Array, offset: float, vertices: Array, above: Array) -> Bits:
        """Which body points (k, 3) are on or above a plane, given some (m, 3) known not to be below it, in m.

        On a line in the wall every point is zero; on a body plane hinged there all points on the side of one that is
        not below are not below; nor are points beyond such a one, seen from a point in the wall.
        """
        wall, P = self.level_with(normal, offset), self.assembly.body_points
        if not (wall.points or wall.between or len(above)):
            return np.zeros(len(vertices), dtype=np.bool_)
        raised = list(above)
        # What is level with a raised point is as high as that.
        raised += [v for p in above for v in vertices[level(self.turns, normal, vertices - p)]]
        known = np.array([*P[sorted(wall.points)], *raised]).reshape(-1, 3)
        done = np.asarray((np.abs(vertices[:, None] - known).max(axis=2) <= NEAR).any(axis=1))
        for a, direction in _lines(self.assembly, wall.points, wall.between):
            done |= on_line(vertices, a, direction)
            # A plane through a line of the wall rises on one side: what is on the side of a point that is up is up.
            for p in raised:
                done |= same_side(vertices, a, direction, p)
        for n, c in wall.flush:
            done |= np.abs(vertices @ n - c) <= NEAR
        for i in wall.points:
            for p in raised:
                done |= beyond(vertices, P[i], p)
        return done

    def beside(self, vectors: Array, direction: Array) -> Bits:
        """Which body vectors (k, 3) are known to point along a unit direction of the world."""
        if not self.turns:
            return np.zeros(len(vectors), dtype=np.bool_)
        found, fixed = images(self.turns, vectors)
        return np.asarray(fixed & (lengths(cross(found, direction)) <= NEAR))


@remembered(_MEMORY)
def facts(assembly: Assembly, held: tuple[PrimitiveContact, ...]) -> Facts:
    """Everything that follows from contacts being held."""
    walls: list[Wall] = []
    fixed = assembly.fixed.polyhedron
    for contact in held:
        if contact.kind is Kind.VERTEX_FACE:
            _note(assembly, walls, contact.fixed_feature, points=(contact.moving[0],))
        elif contact.kind is Kind.EDGE_EDGE:
            shared = taken_turns(assembly, contact, held)
            if shared is not None:
                _note(assembly, walls, shared, points=contact.moving)
                continue
            for n in fixed.edges[contact.fixed_feature].faces:
                _note(assembly, walls, n, between=(contact.moving,))
    turns: list[tuple[Array, Array]] = []
    # Each conclusion may allow another; sets only grow and are of few points, so that it comes to an end.
    while True:
        grown = [_grown(assembly, wall, turns) for wall in walls]
        if all(new is old for new, old in zip(grown, walls, strict=True)):
            known = Facts(ref(assembly), tuple(walls), tuple(turns))
            beside = _turned_edge(known, held)
            if beside is None:
                return known
            turns.append(beside)
        walls = grown


@remembered(_MEMORY)
def coming_off(
    assembly: Assembly, held: tuple[PrimitiveContact, ...], left: tuple[PrimitiveContact, ...]
) -> tuple[Wall, ...]:
    """Fixed planes with the body points that contacts given up put there as the move starts, and those held do not."""
    if not left:
        return ()
    kept, found = facts(assembly, held), []
    for wall in facts(assembly, left).walls:
        points = wall.points - kept.on(wall.normal, wall.offset).points
        if points:
            found.append(Wall(wall.normal, wall.offset, points, (), ()))
    return tuple(found)


def _turned_edge(known: Facts, held: Sequence[PrimitiveContact]) -> tuple[Array, Array] | None:
    """A body edge in a wall with the world direction that a flush face elsewhere leaves it, None without any.

    The edge is level with the wall and at a known angle to the flush face, which leaves two directions. Its contact
    with a rim says which of them it is: e_m × e_f points out of the fixed part.
    """
    P, fixed = known.assembly.body_points, known.assembly.fixed.polyhedron
    for contact in held:
        if contact.kind is not Kind.EDGE_EDGE:
            continue
        (a, b), (c, d) = P[list(contact.moving)], fixed.vertices[list(contact.fixed)]
        e_m, e_f = (b - a) / length(b - a), (d - c) / length(d - c)
        if aligned(known.turns, e_m) is not None:
            continue
        for number in fixed.edges[contact.fixed_feature].faces:
            face = fixed.faces[number]
            if not set(contact.moving) <= known.on(face.normal, face.offset).points:
                continue
            for n, w in known.turns:
                there = _directed(face.normal, w, float(n @ e_m), cross(e_f, face.normal))
                if there is not None:
                    return e_m, there
    return None


def _directed(normal: Array, w: Array, cosine: float, towards: Array) -> Array | None:
    """The unit direction level with a plane, at a known angle to w, towards a side from which its mirror image points.

    None where the two are too near each other, or none or both point there.
    """
    # Two planes and a cone meet in two lines; where they nearly coincide rounding would choose between them.
    axis = cross(normal, w)
    sine = length(axis)
    rest = 1.0 - (cosine / sine) ** 2 if sine**2 >= _STEEP else 0.0
    if rest < _STEEP:
        return None
    along = cosine / sine**2 * (w - normal * float(normal @ w))
    aside = np.sqrt(rest) / sine * axis
    there, back = sorted((along + aside, along - aside), key=lambda x: -float(x @ towards))
    return there if there @ towards > _APART and back @ towards < -_APART else None


def taken_turns(assembly: Assembly, contact: PrimitiveContact, together: Sequence[PrimitiveContact]) -> int | None:
    """The fixed face along an edge contact's fixed edge that its moving edge lies in, crossing there or not.

    Held on the wall is one end of the moving edge, and either its other end or a crossing of the same edge with
    another rim of the wall. When the end slips over the rim, the crossing there takes over from it, and both have the
    same zeros: the edge's line in the wall. None when there is no such wall.
    """
    for number in assembly.fixed.polyhedron.edges[contact.fixed_feature].faces:
        on = set(contact.moving) & held_on(assembly, number, together)
        if len(on) == 2 or (on and any(other_rim(assembly, contact, other, number) for other in together)):
            return number
    return None


def held_on(assembly: Assembly, face: int, together: Sequence[PrimitiveContact]) -> set[int]:
    """The moving vertices that contacts hold on a fixed face or one in its plane."""
    faces = assembly.fixed.polyhedron.faces
    wall = faces[face]
    return {
        other.moving[0]
        for other in together
        if other.kind is Kind.VERTEX_FACE
        for side in [faces[other.fixed_feature]]
        if assembly.agree(wall.normal, wall.offset, side.normal, side.offset)
    }


def other_rim(assembly: Assembly, contact: PrimitiveContact, other: PrimitiveContact, face: int) -> bool:
    """Whether another contact has the same moving edge against another rim of a fixed face."""
    if other.kind is not Kind.EDGE_EDGE or set(other.moving) != set(contact.moving):
        return False
    fixed = assembly.fixed.polyhedron
    wall = fixed.faces[face]
    sides = [fixed.faces[n] for n in fixed.edges[other.fixed_feature].faces]
    elsewhere = set(other.fixed) != set(contact.fixed)
    return elsewhere and any(assembly.agree(wall.normal, wall.offset, side.normal, side.offset) for side in sides)


def _note(
    assembly: Assembly,
    walls: list[Wall],
    face: int,
    points: Sequence[int] = (),
    between: tuple[tuple[int, ...], ...] = (),
) -> None:
    plane = assembly.fixed.polyhedron.faces[face]
    pairs = tuple((one, two) for one, two in between)
    for n, wall in enumerate(walls):
        if assembly.agree(wall.normal, wall.offset, plane.normal, plane.offset):
            walls[n] = Wall(wall.normal, wall.offset, wall.points | set(points), wall.between + pairs, ())
            return
    walls.append(Wall(plane.normal, plane.offset, frozenset(points), pairs, ()))


@remembered(_MEMORY)
def _lines(
    assembly: Assembly, points: frozenset[int], between: tuple[tuple[int, int], ...]
) -> tuple[tuple[Array, Array], ...]:
    """Body lines (point, unit direction) in a wall: two points, or an end of an edge and a point within the edge."""
    P, ends = assembly.body_points, sorted(points)
    pairs = [(i, j) for n, i in enumerate(ends) for j in ends[:n]]
    pairs += [(a, b) for a, b in between if a in points or b in points]
    distinct: list[tuple[Array, Array]] = []
    known = np.zeros((len(P), len(P)), dtype=np.bool_)
    for i, j in pairs:
        if not known[i, j]:
            direction = (P[j] - P[i]) / length(P[j] - P[i])
            distinct.append((P[i], direction))
            on = np.flatnonzero(on_line(P, P[i], direction))
            known[np.ix_(on, on)] = True
    return tuple(distinct)


def _grown(assembly: Assembly, wall: Wall, turns: list[tuple[Array, Array]]) -> Wall:
    """One round of conclusions about a wall, the same when there are none; new flush faces are added to `turns`."""
    P = assembly.body_points
    flush = list(wall.flush)
    # Lines in a flush face say no more than that face.
    told = any(in_plane(P[[*wall.points, *chain(*wall.between)]], n, c) for n, c in flush)
    lines = () if told else _lines(assembly, wall.points, wall.between)
    on = np.zeros(len(P), dtype=np.bool_)
    for a, direction in lines:
        heed()
        on |= on_line(P, a, direction)
        for n, c in _planes(assembly, wall, a, direction):
            if not any(length(cross(n, known)) <= NEAR for known, _ in flush):
                flush.append((n, c))
                turns.append((n, -wall.normal))
    for n, c in flush:
        on |= np.abs(P @ n - c) <= NEAR
    for i in sorted(wall.points):
        on |= level(turns, wall.normal, P - P[i])
    points = wall.points | {int(i) for i in np.flatnonzero(on)}
    if points == wall.points and len(flush) == len(wall.flush):
        return wall
    return Wall(wall.normal, wall.offset, points, wall.between, tuple(flush))


def _planes(assembly: Assembly, wall: Wall, a: Array, direction: Array) -> list[tuple[Array, float]]:
    """Body planes that a line in the wall spans with something off it; faces of the moving part only."""
    P = assembly.body_points
    candidates = sorted(wall.points)
    for i, j in wall.between:
        # An unknown point between two others is off the line, and in one plane with it, when just one of them is on it.
        first, second = on_line(P[[i, j]], a, direction)
        if first != second:
            candidates.append(j if first else i)
        # So it is when both are off the line on one side of it, as those of the edge across a face are.
        elif same_side(P[[j]], a, direction, P[i])[0]:
            candidates.append(i)
    found = []
    for i in candidates:
        off = P[i] - a
        off = off - direction * float(direction @ off)
        size = length(off)
        if size <= _SHORT:
            continue
        n = cross(direction, off / size)
        n = n / length(n)
        for face in assembly.moving.polyhedron.faces:
            if length(cross(n, face.normal)) <= NEAR and abs(float(face.normal @ P[i]) - face.offset) <= NEAR:
                found.append((face.normal, float(face.normal @ P[i])))
                break
    return found


def images(known: Sequence[tuple[Array, Array]], vectors: Array) -> tuple[Array, Bits]:
    """R·vectors for body vectors (k, 3), and for which of them (k,) flush faces fix the image exactly."""
    found = np.zeros_like(vectors)
    fixed = np.zeros(len(vectors), dtype=np.bool_)
    for body, world in known:
        along = vectors @ body
        now = ~fixed & (lengths(vectors - np.outer(along, body)) <= NEAR)
        found[now] = np.outer(along[now], world)
        fixed |= now
    for n, (b1, w1) in enumerate(known):
        for b2, w2 in known[:n]:
            axis = cross(b1, b2)
            if float(axis @ axis) >= _STEEP and not fixed.all():
                B = np.column_stack([b1, b2, axis])
                W = np.column_stack([w1, w2, cross(w1, w2)])
                found[~fixed] = vectors[~fixed] @ np.linalg.solve(B.T, W.T)
                fixed[:] = True
    return found, fixed


def aligned(known: Sequence[tuple[Array, Array]], vector: Array) -> Array | None:
    """R·vector for a body vector (3,) whose image the flush faces fix exactly, else None."""
    found, fixed = images(known, vector[None])
    return found[0] if fixed[0] else None


def level(known: Sequence[tuple[Array, Array]], normal: Array, vectors: Array) -> Bits:
    """Which body vectors (k, 3) flush faces keep level with a plane of this normal, exactly.

    Sides at an angle whose sine is no round number have vertices that were rounded: what is level but for that is not.
    """
    found, fixed = images(known, vectors)
    return np.asarray(fixed & (np.abs(found @ normal) <= _LEVEL * lengths(vectors)))


def rising(known: Sequence[tuple[Array, Array]], normal: Array, vectors: Array) -> Bits:
    """Which body vectors (k, 3) cannot fall along a unit normal, by one known direction or by all of them.

    A vector keeps its part along the direction, so that its height is at least that part's less all of the rest.
    """
    found = np.zeros(len(vectors), dtype=np.bool_)
    for body, world in known:
        along = vectors @ body
        rest = lengths(vectors - np.outer(along, body)) * length(normal - world * float(world @ normal))
        found |= along * float(world @ normal) - rest >= -NEAR
    there, fixed = images(known, vectors)
    return np.asarray(found | (fixed & (there @ normal >= -NEAR)))


def flushes(assembly: Assembly, held: Sequence[PrimitiveContact]) -> list[tuple[Array, Array]]:
    """Faces of the moving part that the held contacts press flat: (body normal, world normal it is turned to)."""
    return list(facts(assembly, tuple(held)).turns)
