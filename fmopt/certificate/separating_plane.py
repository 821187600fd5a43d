"""Separating planes of convex pieces, kept over a whole piece of motion with its errors.

Two convex pieces are apart when a face plane of one, or a plane along an edge of each, has them on opposite sides.

Several witnesses for each of several pairs: which of them keeps its pair apart at most margin.

Which rows of a witness plane count: those that the contacts do not settle.

That depends on the contacts alone, not on poses, and is worked out once for each contact state.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from fmopt.certificate.assembly import NEAR, Assembly, hinge
from fmopt.certificate.contact_implications import Wall, coming_off, facts
from fmopt.certificate.edge_planes import Counted, contacts_of, edge_rows
from fmopt.certificate.kernels_rows import Table
from fmopt.certificate.level_rims import faced, level_rims
from fmopt.certificate.piece_pairs import Pair, PlaneWitness
from fmopt.certificate.remainder import AtEnd, Ends, EndsBatch
from fmopt.certificate.row_bounds import Witnesses, best
from fmopt.certificate.rows import Forms, balls_above, faces_above, points_above, stacked
from fmopt.contact.primitive import Kind
from fmopt.geometry.polyhedron import Polyhedron
from fmopt.spatial.se3 import lengths
from fmopt.spatial.values import Array, Bits, Indices, remembered

_MEMORY = 4096


@dataclass(frozen=True, eq=False)
class Separation:
    """A witness with its certified margin and its nominal clearance (m) over a piece of motion."""

    witness: PlaneWitness
    margin: float
    clearance: float


@dataclass(frozen=True, eq=False)
class RowBounds:
    """The counted rows of a witness at both ends, their certified lower bounds (k,), and the divisor of the margin."""

    start: AtEnd
    goal: AtEnd
    lower: Array
    scale: float


def row_bounds(assembly: Assembly, pair: Pair, witness: PlaneWitness, ends: Ends) -> RowBounds:
    """All rows of one witness over a piece of motion, for placements that want to move them."""
    counted = counted_rows(assembly, pair, witness)
    rows = EndsBatch.of((ends,)).over(counted.forms)
    lower = rows.lower[0]
    which = counted.counts(lower)
    start, goal = (AtEnd(rows.f[end, 0, which], rows.N[end, 0, which]) for end in (0, 1))
    return RowBounds(start, goal, lower[which], counted.scale(ends.start, ends.goal, ends.extent))


def separation(assembly: Assembly, pair: Pair, witness: PlaneWitness, ends: Ends) -> Separation:
    """Margin and clearance of one witness over a piece of motion."""
    rows = row_bounds(assembly, pair, witness, ends)
    clearance = float(np.minimum(rows.start.f, rows.goal.f).min()) / rows.scale
    return Separation(witness, float(rows.lower.min()) / rows.scale, clearance)


@dataclass(frozen=True, eq=False)
class Block:
    """Witnesses of one pair with their counted rows; one whose rows are all settled is not listed."""

    witnesses: tuple[PlaneWitness, ...]
    counted: tuple[Counted, ...]

    @staticmethod
    def of(assembly: Assembly, pair: Pair, witnesses: tuple[PlaneWitness, ...]) -> "Block":
        """Those of a pair's witnesses that say something."""
        rows = rows_along(assembly, pair, witnesses)
        said = [(witness, own) for witness, own in zip(witnesses, rows, strict=True) if len(own.forms)]
        return Block(tuple(witness for witness, _ in said), tuple(own for _, own in said))


@dataclass(frozen=True, eq=False)
class Candidates:
    """The witnesses of several pairs (m), one after the other, and their rows."""

    witnesses: tuple[PlaneWitness, ...]
    rows: Table
    listed: Witnesses

    @staticmethod
    def of(blocks: Sequence[Block]) -> "Candidates":
        """The witnesses of several pairs."""
        if not all(block.counted for block in blocks):
            raise ValueError("a pair of pieces has no plane that could keep it apart")
        counted = [rows for block in blocks for rows in block.counted]
        begins = np.cumsum([0, *(len(rows.forms) for rows in counted)])
        ends = np.cumsum([0, *(len(block.counted) for block in blocks)]).tolist()
        most = max(len(block.counted) for block in blocks)
        places = np.array([[*range(i, j), *[j - 1] * (most - j + i)] for i, j in pairwise(ends)])
        surely, edges = np.ones(begins[-1], dtype=np.bool_), np.zeros((len(counted), 2, 3))
        walls = [(n, wall) for n, rows in enumerate(counted) for wall in rows.onto]
        behind = np.zeros((len(walls), np.diff(begins).max()), dtype=np.bool_)
        for n, rows in enumerate(counted):
            if rows.edges is not None:
                edges[n], surely[begins[n] : begins[n + 1]] = rows.edges, rows.surely
        for mask, (_, wall) in zip(behind, walls, strict=True):
            mask[: len(wall.behind)] = wall.behind
        onto = np.array([(n, wall.outside, wall.inside) for n, wall in walls], dtype=np.intp).reshape(-1, 3)
        always = np.array([rows.always for rows in counted])
        forms = stacked(*(rows.forms for rows in counted))
        listed = Witnesses(begins, places, always, surely, edges, onto, behind)
        witnesses = tuple(witness for block in blocks for witness in block.witnesses)
        return Candidates(witnesses, forms.table, listed)

    def best(self, course: EndsBatch, least: Array, grazing: float) -> tuple[Indices, Array, Array]:
        """The witness of each pair with the largest margin, at least `least` (n, m), m, whose plane holds nominally.

        Nominal distances may be `grazing` below zero, m.

        Returns:
            numbers (n, m) of the witnesses, −1 where none holds with that margin, their margins and clearances, m.
        """
        return best(self.rows, self.listed, course.motion, np.ascontiguousarray(least), grazing)


def counted_rows(assembly: Assembly, pair: Pair, witness: PlaneWitness) -> Counted:
    """The rows of a witness that contacts do not settle."""
    if witness.plane is not None:
        return _all(_bodies_above(pair.moving, np.array(witness.plane[:3]), witness.plane[3]))
    return rows_along(assembly, pair, (witness,))[0]


@remembered(_MEMORY)
def rows_along(assembly: Assembly, pair: Pair, witnesses: tuple[PlaneWitness, ...]) -> tuple[Counted, ...]:
    """The counted rows of several witnesses along faces or edges of a pair."""
    known, found = facts(assembly, pair.state), []
    for witness in witnesses:
        if witness.kind == "fixed-face":
            n, offset = face_planes(pair.fixed)[witness.fixed]
            if pair.moving.balls and _pressed(assembly, pair, n, offset):
                # The contact settles the ball's row; what is left to say is that its centre is on this side.
                found.append(_all(points_above(pair.moving.vertices, n, offset)))
                continue
            forms = _over(pair.moving, pair.fixed, witness.fixed)
            found.append(_all(Forms(forms.table[~settled(assembly, pair, n, offset)])))
        elif witness.kind == "moving-face":
            n, offset = face_planes(pair.moving)[witness.moving]
            forms = _beneath(pair.moving, pair.fixed, witness.moving)
            found.append(_all(Forms(forms.table[~_touched(assembly, pair, n, offset)])))
        else:
            found.append(edge_rows(assembly, pair, witness, known))
    return tuple(found)


def settled(assembly: Assembly, pair: Pair, normal: Array, offset: float) -> Bits:
    """Which vertices (v) of the moving piece contacts keep from crossing a plane (unit normal (3,), offset in m)."""
    known, walls = facts(assembly, pair.state), coming_off(assembly, pair.state, pair.left)
    above = _above(assembly, pair, walls, normal, offset)
    return np.asarray(known.not_below(normal, offset, pair.moving.vertices, above) & (pair.moving.radii == 0.0))


@remembered(1)
def face_planes(piece: Polyhedron) -> dict[tuple[int, ...], tuple[Array, float]]:
    """By the outline of each face of a piece, in order, its unit normal (3,) and how far out the piece reaches, m."""
    return {face.loops[0]: (face.normal, float((piece.vertices @ face.normal).max())) for face in piece.faces}


@remembered(_MEMORY)
def _over(moving: Polyhedron, fixed: Polyhedron, outline: tuple[int, ...]) -> Forms:
    """Vertices of a moving piece over a face of a fixed one."""
    return _bodies_above(moving, *face_planes(fixed)[outline])


@remembered(_MEMORY)
def _beneath(moving: Polyhedron, fixed: Polyhedron, outline: tuple[int, ...]) -> Forms:
    """Vertices of a fixed piece over a face of a moving one."""
    return faces_above(*face_planes(moving)[outline], fixed.vertices)


def _bodies_above(body: Polyhedron, normal: Array, offset: float) -> Forms:
    """Vertices and balls of a moving piece over a fixed plane."""
    if body.balls:
        return balls_above(body.vertices, normal, offset, body.radii)
    return points_above(body.vertices, normal, offset)


def _pressed(assembly: Assembly, pair: Pair, normal: Array, offset: float) -> bool:
    """Whether a contact keeps the ball that the moving piece is on a fixed plane, or from crossing it."""
    faces, own = assembly.fixed.polyhedron.faces, assembly.carried(pair.moving)
    balls = (c for c in contacts_of(pair) if c.kind is Kind.BALL_FACE and ("ball", c.moving_feature) in own)
    touched = (faces[c.fixed_feature] for c in balls)
    return any(assembly.agree(face.normal, face.offset, normal, offset) for face in touched)


def _all(forms: Forms) -> Counted:
    return Counted(forms, len(forms))


def _above(assembly: Assembly, pair: Pair, walls: Sequence[Wall], normal: Array, offset: float) -> Array:
    """Body points (m, 3) that do not cross a fixed plane: of contacts not yet made, or given up, or flat with these."""
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


def _touched(assembly: Assembly, pair: Pair, normal: Array, offset: float) -> Bits:
    """Vertices of the fixed piece that contacts put on a moving face: by themselves, or with the rim that they end."""
    F = pair.fixed.vertices
    done = np.zeros(len(F), dtype=np.bool_)
    for rim in level_rims(assembly, pair.state, pair.beside) if assembly.several else ():
        if rim.held and faced(assembly, normal, offset):
            done |= rim.before(F, normal, offset)
    for contact in contacts_of(pair):
        if contact.kind is Kind.FACE_VERTEX:
            face = assembly.moving.polyhedron.faces[contact.moving_feature]
            if assembly.agree(face.normal, face.offset, normal, offset):
                done |= lengths(F - assembly.fixed.polyhedron.vertices[contact.fixed[0]]) <= NEAR
    return done
