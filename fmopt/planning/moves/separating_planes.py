"""The choice of separating planes: for each pair of convex pieces the plane with the largest certified margin.

Planes through the edges of fixed pieces, between the two faces of each, that keep a moving piece at most margin.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from fmopt.certificate.assembly import Assembly, edge_along
from fmopt.certificate.kernels_rows import ROW
from fmopt.certificate.level_rims import edges_beside, edges_level, level_rims
from fmopt.certificate.piece_pairs import BEHIND, Facing, Pair, Witness, free_plane
from fmopt.certificate.remainder import Course
from fmopt.certificate.row_bounds import Places, Sides, best_sides
from fmopt.certificate.separating_plane import Block, Candidates, Separation
from fmopt.contact.primitive import Kind
from fmopt.geometry.polyhedron import Polyhedron
from fmopt.planning.moves.plane_arcs import SHARES, Edges, best
from fmopt.spatial.se3 import lengths
from fmopt.spatial.values import Array, remembered

_GRAZING = 2e-6
_MEMORY = 2048

_SPREAD = np.linspace(0.0, 1.0, SHARES)
_FANS = 256


def choose_separations(assembly: Assembly, facing: Facing, course: Course) -> list[list[Separation | None]]:
    """The best plane between each two pieces over pieces of motion, None where they are not apart nominally.

    Pieces in touch are kept apart by a plane that the contacts themselves lie in; others by any plane through an edge
    of the fixed piece, or by a face of the moving one.

    Args:
        assembly: the parts.
        facing: pairs of pieces.
        course: pieces of motion with their errors.
    """
    pieces, pairs = len(course.motion.twist), len(facing.listed)
    chosen: list[list[Separation | None]] = [[None] * pairs for _ in range(pieces)]
    least, before = np.full((pieces, pairs), -np.inf), np.zeros((pieces, pairs), dtype=np.bool_)
    touched = _touched(assembly, facing)
    if touched is not None:
        places = list(touched.places)
        for k, m, found in _listed(*touched.table.best(course, least[:, places], _GRAZING)):
            witness = touched.table.witnesses[found.number]
            chosen[k][places[m]] = Separation(witness, found.margin, found.clearance)
            least[k, places[m]], before[k, places[m]] = found.margin, witness.kind != "edges"
    for _, free in facing.apart:
        planes = _fans(facing, free).best(course)
        for k, m in np.argwhere((planes.clearances >= -_GRAZING) & (planes.margins > least[:, free])).tolist():
            chosen[k][free[m]], least[k, free[m]] = planes.separation(k, m), planes.margins[k, m]
            before[k, free[m]] = False
    for own in _facing_faces(assembly, facing):
        for k, m, found in _listed(*own.best(course, least[:, own.places], _GRAZING)):
            place = own.places[m]
            # Of two that keep as much the first in the order of kinds counts: fixed faces, moving ones, edges.
            if found.margin > least[k, place] or not before[k, place]:
                chosen[k][place] = Separation(own.witnesses[found.number], found.margin, found.clearance)
    return chosen


class _Found(NamedTuple):
    """The number of a witness with its margin and its clearance, m."""

    number: int
    margin: float
    clearance: float


def _listed(numbers: Places, margins: Array, clearances: Array) -> Iterator[tuple[int, int, _Found]]:
    """What was found for pairs (m) over pieces of motion (n), each with both places."""
    for k, m in np.argwhere(numbers >= 0).tolist():
        yield k, m, _Found(int(numbers[k, m]), float(margins[k, m]), float(clearances[k, m]))


@dataclass(frozen=True, eq=False)
class _Touched:
    """The pairs of pieces that contacts bear on, by their places in the list, and what may keep each apart.

    Where no contact is on a face of the moving piece, its faces are no part of it.
    """

    places: tuple[int, ...]
    table: Candidates


@remembered(_MEMORY)
def _touched(assembly: Assembly, facing: Facing) -> _Touched | None:
    touched = [(n, pair) for n, (_, _, pair) in enumerate(facing.listed) if pair.told]
    blocks = [(n, _block(assembly, pair)) for n, pair in touched]
    told = [(n, block) for n, block in blocks if block.counted]
    return _Touched(tuple(n for n, _ in told), Candidates.of([block for _, block in told])) if told else None


@remembered(_MEMORY)
def _block(assembly: Assembly, pair: Pair) -> Block:
    return Block.of(assembly, pair, _candidates(assembly, pair))


def _faces_count(assembly: Assembly, pair: Pair) -> bool:
    """Whether all rows of the moving piece's faces count: no contact puts a vertex of the fixed piece on one."""
    if any(contact.kind is Kind.FACE_VERTEX for contact in (*pair.state, *pair.beside)):
        return False
    return not (assembly.several and level_rims(assembly, pair.state, pair.beside))


@remembered(_MEMORY)
def _fans(facing: Facing, places: tuple[int, ...]) -> Fans:
    pairs = [facing.listed[n][2] for n in places]
    return fans(pairs[0].moving, tuple(pair.fixed for pair in pairs))


@remembered(1)
def _facing_faces(assembly: Assembly, facing: Facing) -> tuple[Faces, ...]:
    """The faces of each moving piece with the pairs of it for which all of their rows count."""
    found: dict[Polyhedron, list[int]] = {}
    for n, (_, _, pair) in enumerate(facing.listed):
        if _faces_count(assembly, pair) and pair.moving.faces:
            found.setdefault(pair.moving, []).append(n)
    return tuple(Faces.of(facing, piece, places) for piece, places in found.items())


@dataclass(frozen=True, eq=False)
class Faces:
    """The faces of a moving piece as planes that may keep it off fixed ones, by the places of these pairs."""

    places: list[int]
    witnesses: tuple[Witness, ...]
    sides: Sides

    @staticmethod
    def of(facing: Facing, moving: Polyhedron, places: list[int]) -> Faces:
        """The faces of a moving piece in some pairs."""
        pieces = [facing.listed[n][2].fixed for n in places]
        normals = np.array([face.normal for face in moving.faces])
        offsets = np.array([float((moving.vertices @ face.normal).max()) for face in moving.faces])
        cuts = np.cumsum([0, *(len(piece.vertices) for piece in pieces)])
        corners = np.concatenate([piece.vertices for piece in pieces])
        witnesses = tuple(Witness("moving-face", face.loops[0], ()) for face in moving.faces)
        return Faces(places, witnesses, Sides(normals, offsets, corners, cuts))

    def best(self, course: Course, least: Array, grazing: float) -> tuple[Places, Array, Array]:
        """For each piece the face with the largest margin over pieces of motion; see `best_sides`."""
        return best_sides(self.sides, np.zeros(1, ROW), course.motion, np.ascontiguousarray(least), grazing)


def _candidates(assembly: Assembly, pair: Pair) -> tuple[Witness, ...]:
    """Planes of faces, and those along the two edges of the pair's edge–edge contacts."""
    moving = () if _faces_count(assembly, pair) else pair.moving.faces
    own = [Witness("moving-face", face.loops[0], ()) for face in moving]
    faces = [Witness("fixed-face", (), face.loops[0]) for face in pair.fixed.faces]
    return (*faces, *own, *_contact_edges(assembly, pair))


def _contact_edges(assembly: Assembly, pair: Pair) -> list[Witness]:
    found = []
    for contact in (*pair.held, *pair.opening):
        if contact.kind is Kind.EDGE_EDGE:
            moving = edge_along(pair.moving, assembly.moving.polyhedron, contact.moving)
            fixed = edge_along(pair.fixed, assembly.fixed.polyhedron, contact.fixed)
            assert moving is not None  # they touch
            assert fixed is not None
            found.append((moving, fixed))
    if assembly.several:
        found += edges_beside(assembly, pair.moving, pair.fixed, pair.state, pair.beside)
        rims = level_rims(assembly, pair.state, pair.beside)
        found += edges_level(assembly, pair.moving, pair.fixed, rims)
    return [Witness("edges", *both) for both in dict.fromkeys(found)]


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
        """What keeps one pair apart over one piece of motion.

        Args:
            n: index of the piece of motion.
            m: index of the pair.
        """
        plane = free_plane(self.normals[n, m].tolist(), float(self.offsets[n, m]))
        return Separation(plane, float(self.margins[n, m]), float(self.clearances[n, m]))


@dataclass(frozen=True, eq=False)
class Fans:
    """The planes through all edges of some fixed pieces against one moving piece with vertices `body` (v, 3).

    A ball has its centre for a vertex, and is a radius (m) nearer.

    What the errors cost a plane depends on its normal alone, and pieces share many.
    """

    body: Array
    edges: Edges
    radius: float = 0.0

    def best(self, course: Course) -> FreePlanes:
        """For each fixed piece the plane with the largest certified margin over pieces of motion."""
        p, R, columns, cuts, twist, half, coupling, form = course.motion
        motion = p, R, columns, cuts, twist, half, coupling
        normals, offsets, margins, clearances = best(self.edges, self.body, motion)
        return FreePlanes(normals, offsets, margins - self.radius - BEHIND - form, clearances - self.radius - BEHIND)


@remembered(_FANS)
def fans(moving: Polyhedron, pieces: tuple[Polyhedron, ...]) -> Fans:
    """The planes between a moving piece and fixed ones that no contact touches.

    Args:
        moving: a convex piece.
        pieces: convex, of the fixed part.
    """
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
    return Fans(np.array(moving.vertices), edges, float(moving.radii.max()))
