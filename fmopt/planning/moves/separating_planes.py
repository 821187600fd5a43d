"""The choice of separating planes: for each pair of convex pieces the plane with the largest certified margin.

Planes through the edges of fixed pieces, between the two faces of each, that keep a moving piece at most margin.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from fmopt.certificate.assembly import Assembly, edge_along
from fmopt.certificate.kernels_rows import ROW
from fmopt.certificate.level_rims import edges_beside, edges_level, level_rims
from fmopt.certificate.piece_pairs import BEHIND, FacingPairs, Pair, PlaneWitness, free_plane
from fmopt.certificate.remainder import EndsBatch
from fmopt.certificate.row_bounds import Sides, best_sides
from fmopt.certificate.separating_plane import Block, Candidates, Separation, face_planes, settled
from fmopt.contact.primitive import Kind
from fmopt.geometry.polyhedron import Polyhedron
from fmopt.planning.moves.plane_arcs import SHARES, Edges, best
from fmopt.spatial.se3 import lengths
from fmopt.spatial.values import Array, Bits, Indices, remembered

_GRAZING = 2e-6  # m by which pieces may overlap nominally and still have a plane, of negative margin
_MEMORY = 2048

_SPREAD = np.linspace(0.0, 1.0, SHARES)
_FANS = 256


def choose_separations(assembly: Assembly, facing: FacingPairs, course: EndsBatch) -> list[list[Separation | None]]:
    """The best plane between each two pieces over pieces of motion, None where they are not apart nominally.

    Pieces in touch are kept apart by a plane that the contacts themselves lie in; others by any plane through an edge
    of the fixed piece, or by a face of the moving one.
    """
    return _choice(assembly, facing, course, math.nan).chosen


def choose_tightest(assembly: Assembly, facing: FacingPairs, course: EndsBatch) -> list[list[Separation | None]]:
    """Planes of which the tightest pair's is the best one, and those of other pairs good enough for that to be so.

    For a search that asks for the least margin alone, which is the same as of `choose_separations`; arguments likewise.
    """
    choice = _choice(assembly, facing, course, math.inf)
    # A face of the moving piece may keep the pair that was the tightest so far apart at more margin than others have.
    return choice.chosen if choice.best[choice.tightest] else choose_separations(assembly, facing, course)


@dataclass(frozen=True, eq=False)
class _Choice:
    """Planes chosen for pairs (m) over pieces of motion (n)."""

    chosen: list[list[Separation | None]]  # the planes; None where there is none
    least: Array  # their margins (n, m), m; −∞ where there is none
    best: Bits  # whether no other plane of a pair (m) keeps more

    @property
    def tightest(self) -> int:
        """Which pair has the least margin."""
        return int(np.argmin(self.least.min(axis=0)))

    def take(self, n: int, m: int, found: Separation) -> None:
        """Has a pair kept apart by this plane over a piece of motion."""
        self.chosen[n][m], self.least[n, m] = found, found.margin


def _choice(assembly: Assembly, facing: FacingPairs, course: EndsBatch, enough: float) -> _Choice:
    """The planes of all pairs, the best ones of those with no margin above `enough`, m, or of all if that is nan."""
    shape = len(course.motion.twist), len(facing.listed)
    choice = _Choice([[None] * shape[1] for _ in range(shape[0])], np.full(shape, -np.inf), np.ones(shape[1], np.bool_))
    touched, least = _touched(assembly, facing), choice.least
    for walls in touched.walls:
        for n, m, found in _listed(*walls.best(course, least[:, walls.places], _GRAZING)):
            choice.take(n, walls.places[m], found.of(walls.witnesses))
    if touched.table is not None:
        places = list(touched.places)
        for n, m, found in _listed(*touched.table.best(course, least[:, places], _GRAZING)):
            if found.margin > least[n, places[m]]:
                choice.take(n, places[m], found.of(touched.table.witnesses))
    known = least[:, [m for m, (_, _, pair) in enumerate(facing.listed) if pair.touched]]
    # No pair that keeps more than one in touch is the tightest. Where all are asked for, nan stays nan.
    enough = float(known.min(initial=enough, where=known > -np.inf))
    for _, free in facing.apart:
        planes = _fans(facing, free).best(course, enough)
        for n, m in np.argwhere((planes.clearances >= -_GRAZING) & (planes.margins > least[:, free])).tolist():
            choice.take(n, free[m], planes.separation(n, m))
        choice.best[list(free)] = planes.best
    for faces in _facing_faces(assembly, facing):
        for n, m, found in _listed(*faces.best(course, least[:, faces.places], _GRAZING)):
            before = choice.chosen[n][faces.places[m]]
            # Of two that keep as much the first in the order of kinds counts: fixed faces, moving ones, edges.
            if before is None or found.margin > before.margin or before.witness.kind in ("edges", "plane"):
                choice.take(n, faces.places[m], found.of(faces.witnesses))
    return choice


class _Found(NamedTuple):
    """The number of a witness with its margin and its clearance, m."""

    number: int
    margin: float
    clearance: float

    def of(self, witnesses: Sequence[PlaneWitness]) -> Separation:
        """What it stands for among witnesses."""
        return Separation(witnesses[self.number], self.margin, self.clearance)


def _listed(numbers: Indices, margins: Array, clearances: Array) -> Iterator[tuple[int, int, _Found]]:
    """What was found for pairs (m) over pieces of motion (n), each with both places."""
    for k, m in np.argwhere(numbers >= 0).tolist():
        yield k, m, _Found(int(numbers[k, m]), float(margins[k, m]), float(clearances[k, m]))


@dataclass(frozen=True, eq=False)
class _Touched:
    """What may keep each pair of pieces that contacts bear on apart.

    Where no contact is on a face of the moving piece, its faces are no part of it. Walls are faces of the fixed pieces
    of which contacts say nothing, for each moving piece's pairs.
    """

    walls: tuple[Faces, ...]
    places: tuple[int, ...]
    table: Candidates | None


@remembered(_MEMORY)
def _touched(assembly: Assembly, facing: FacingPairs) -> _Touched:
    told = [(m, pair) for m, (_, _, pair) in enumerate(facing.listed) if pair.told]
    silent = _silent(assembly, [pair for _, pair in told])
    walls: dict[Polyhedron, list[tuple[int, Pair, Indices]]] = {}
    for (m, pair), faces in zip(told, silent, strict=True):
        if len(faces):
            walls.setdefault(pair.moving, []).append((m, pair, faces))
    said = []
    for (m, pair), faces in zip(told, silent, strict=True):
        block = Block.of(assembly, pair, _candidates(assembly, pair, frozenset(faces.tolist())))
        said += [(m, block)] if block.counted else []
    table = Candidates.of([block for _, block in said]) if said else None
    return _Touched(tuple(Faces.walls(piece, own) for piece, own in walls.items()), tuple(m for m, _ in said), table)


def _silent(assembly: Assembly, pairs: Sequence[Pair]) -> list[Indices]:
    """The faces of the fixed piece of each of some pairs under the same contacts of which these say nothing."""
    known: dict[tuple[Polyhedron, bytes, float], bool] = {}
    found = []
    for pair in pairs:
        silent = list[int]()
        for k, (normal, offset) in enumerate(face_planes(pair.fixed).values()):
            plane = pair.moving, normal.tobytes(), offset
            if plane not in known:  # pieces of one part share many planes
                known[plane] = bool(pair.moving.balls) or bool(settled(assembly, pair, normal, offset).any())
            silent += [] if known[plane] else [k]
        found.append(np.array(silent, dtype=np.intp))
    return found


def _reach(piece: Polyhedron) -> Array:
    """How far out a piece reaches along the normals of its faces (f,), m."""
    return np.array([offset for _, offset in face_planes(piece).values()])


def _faces_count(assembly: Assembly, pair: Pair) -> bool:
    """Whether all rows of the moving piece's faces count: no contact puts a vertex of the fixed piece on one."""
    if any(contact.kind is Kind.FACE_VERTEX for contact in (*pair.state, *pair.beside)):
        return False
    return not (assembly.several and level_rims(assembly, pair.state, pair.beside))


@remembered(_MEMORY)
def _fans(facing: FacingPairs, places: tuple[int, ...]) -> Fans:
    pairs = [facing.listed[n][2] for n in places]
    return fans(pairs[0].moving, tuple(pair.fixed for pair in pairs))


@remembered(1)
def _facing_faces(assembly: Assembly, facing: FacingPairs) -> tuple[Faces, ...]:
    """The faces of each moving piece with the pairs of it for which all of their rows count."""
    found: dict[Polyhedron, list[int]] = {}
    for n, (_, _, pair) in enumerate(facing.listed):
        if _faces_count(assembly, pair) and pair.moving.faces:
            found.setdefault(pair.moving, []).append(n)
    return tuple(Faces.of(facing, piece, places) for piece, places in found.items())


@dataclass(frozen=True, eq=False)
class Faces:
    """Faces of pieces of the one part as planes that may keep off pieces of the other, by the places of these pairs."""

    places: list[int]
    witnesses: tuple[PlaneWitness, ...]
    sides: Sides

    @staticmethod
    def of(facing: FacingPairs, moving: Polyhedron, places: list[int]) -> Faces:
        """The faces of a moving piece in some pairs."""
        pieces = [facing.listed[n][2].fixed for n in places]
        offsets, corners = _reach(moving), np.concatenate([piece.vertices for piece in pieces])
        witnesses = tuple(PlaneWitness("moving-face", face.loops[0], ()) for face in moving.faces)
        faces, levers = np.tile((0, len(offsets)), (len(pieces), 1)), (np.zeros(len(offsets)), np.zeros(len(corners)))
        points = _spans([len(piece.vertices) for piece in pieces])
        sides = Sides(np.array(moving.normals), offsets, corners, levers, faces, points, moving=True)
        return Faces(places, witnesses, sides)

    @staticmethod
    def walls(moving: Polyhedron, own: Sequence[tuple[int, Pair, Indices]]) -> Faces:
        """Faces of fixed pieces that may keep off a moving one."""
        normals = np.concatenate([pair.fixed.normals[which] for _, pair, which in own])
        offsets = np.concatenate([_reach(pair.fixed)[which] for _, pair, which in own])
        loops = [pair.fixed.faces[k].loops[0] for _, pair, which in own for k in which.tolist()]
        corners, points = np.array(moving.vertices), np.tile((0, len(moving.vertices)), (len(own), 1))
        faces = _spans([len(which) for _, _, which in own])
        sides = Sides(normals, offsets, corners, (lengths(normals), lengths(corners)), faces, points, moving=False)
        return Faces([m for m, _, _ in own], tuple(PlaneWitness("fixed-face", (), loop) for loop in loops), sides)

    def best(self, course: EndsBatch, least: Array, grazing: float) -> tuple[Indices, Array, Array]:
        """For each piece the face with the largest margin over pieces of motion; see `best_sides`."""
        return best_sides(self.sides, np.zeros(1, ROW), course.motion, np.ascontiguousarray(least), grazing)


def _candidates(assembly: Assembly, pair: Pair, silent: frozenset[int]) -> tuple[PlaneWitness, ...]:
    """Planes of faces, those of the fixed piece but for some, and those along both edges of the pair's crossings."""
    moving = () if _faces_count(assembly, pair) else pair.moving.faces
    own = [PlaneWitness("moving-face", face.loops[0], ()) for face in moving]
    faces = [PlaneWitness("fixed-face", (), f.loops[0]) for k, f in enumerate(pair.fixed.faces) if k not in silent]
    return (*faces, *own, *_contact_edges(assembly, pair))


def _contact_edges(assembly: Assembly, pair: Pair) -> list[PlaneWitness]:
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
        found += edges_level(assembly, pair.moving, pair.fixed, level_rims(assembly, pair.state, pair.beside))
    return [PlaneWitness("edges", *both) for both in dict.fromkeys(found)]


def _spans(counts: Sequence[int]) -> Indices:
    """Where each of several lists begins and ends (m, 2) when they are one after the other."""
    ends = np.cumsum([0, *counts])
    return np.column_stack([ends[:-1], ends[1:]])


@dataclass(frozen=True, eq=False)
class FreePlanes:
    """The best planes between a moving piece and fixed ones (m) over pieces of motion (n).

    They are unit normals (n, m, 3), how far out the fixed pieces reach along these, certified margins and nominal
    clearances (n, m), m; and which pairs (m) they are the best of.
    """

    normals: Array
    offsets: Array
    margins: Array
    clearances: Array
    best: Bits

    def separation(self, n: int, m: int) -> Separation:
        """What keeps one pair apart over one piece of motion."""
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

    def best(self, course: EndsBatch, enough: float = math.nan) -> FreePlanes:
        """For each fixed piece the plane with the largest certified margin over pieces of motion.

        Above `enough`, m, no pair is the tightest; best are the planes of those that may be, or all.
        """
        p, R, columns, cuts, twist, half, coupling, form = course.motion
        motion = p, R, columns, cuts, twist, half, coupling
        # Kernels know of no radii, gaps and tolerances of form: what is asked is raised, what is found lowered by them.
        near = self.radius + BEHIND
        asked = _GRAZING - near, enough + near + form
        normals, offsets, margins, clearances, final = best(self.edges, self.body, motion, *asked)
        margins, clearances = margins - self.radius - BEHIND - form, clearances - self.radius - BEHIND
        return FreePlanes(normals, offsets, margins, clearances, final)


@remembered(_FANS)
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
    # Normals that pieces share are told by their bytes, so that −0 has to become 0.
    numbers: dict[bytes, int] = {}
    which = np.array([numbers.setdefault(normal.tobytes(), len(numbers)) for normal in fan.reshape(-1, 3) + 0.0])
    normals = np.frombuffer(b"".join(numbers)).reshape(-1, 3).copy()
    cuts = np.cumsum([0, *(len(faces) for faces in sides)])
    edges = Edges(arcs, cuts, normals, which.reshape(fan.shape[:2]), offsets, corners)
    return Fans(np.array(moving.vertices), edges, float(moving.radii.max()))
