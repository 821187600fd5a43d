"""The choice of separating planes: for each pair of convex pieces the plane with the largest certified margin.

Planes through the edges of fixed pieces, between the two faces of each, that keep a moving piece at most margin.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fmopt.certificate.assembly import Assembly
from fmopt.certificate.curvature import Course
from fmopt.certificate.kernels_rows import ROW
from fmopt.certificate.lower import Places, Sides, best_sides
from fmopt.certificate.pair import BEHIND, Facing, Pair, Witness, free_plane
from fmopt.certificate.separating_plane import Block, Candidates, Separation
from fmopt.contact.primitive import Kind
from fmopt.geometry.polyhedron import Polyhedron
from fmopt.placement.arcs import SHARES, Edges, best
from fmopt.se3 import cross, length, lengths
from fmopt.values import Array, remembered

_GRAZING = 2e-6
_MEMORY = 2048

_SPREAD = np.linspace(0.0, 1.0, SHARES)
_FANS = 256


def choose_separations(assembly: Assembly, facing: Facing, course: Course) -> list[list[Separation | None]]:
    """The best plane between each two pieces over pieces of motion, None where they are not apart nominally.

    Pieces in touch are kept apart by a plane that the contacts themselves lie in; others by any plane through an edge
    of the fixed piece, or by a face of the moving one.
    """
    chosen: list[list[Separation | None]] = [[None] * len(facing.listed) for _ in course.motion.twist]
    touched = _touched(assembly, facing)
    if touched is not None:
        least = np.full((len(chosen), len(touched.places)), -np.inf)
        found = touched.table.best(course, least, _GRAZING)
        for row, each in zip(chosen, zip(*(part.tolist() for part in found), strict=True), strict=True):
            for place, n, margin, clearance in zip(touched.places, *each, strict=True):
                row[place] = Separation(touched.table.witnesses[n], margin, clearance) if n >= 0 else None
    for _, places in facing.apart:
        planes, sides = _fans(facing, places).best(course), _sides(facing, places)
        least = np.where(planes.clearances >= -_GRAZING, planes.margins, -np.inf)
        found = sides.best(course, least, _GRAZING)
        for k, (row, each) in enumerate(zip(chosen, zip(*(part.tolist() for part in found), strict=True), strict=True)):
            for m, (place, n, margin, clearance) in enumerate(zip(places, *each, strict=True)):
                if n >= 0:
                    row[place] = Separation(sides.witnesses[n], margin, clearance)
                elif least[k, m] > -np.inf:
                    row[place] = planes.separation(k, m)
    return chosen


@dataclass(frozen=True, eq=False)
class _Touched:
    """The pairs of pieces that contacts bear on, by their places in the list, and what may keep each apart."""

    places: tuple[int, ...]
    table: Candidates


@remembered(_MEMORY)
def _touched(assembly: Assembly, facing: Facing) -> _Touched | None:
    places = tuple(n for n, (_, _, pair) in enumerate(facing.listed) if pair.touched)
    blocks = [_block(assembly, facing.listed[n][2]) for n in places]
    return _Touched(places, Candidates.of(blocks)) if places else None


@remembered(_MEMORY)
def _block(assembly: Assembly, pair: Pair) -> Block:
    return Block.of(assembly, pair, _candidates(assembly, pair))


@remembered(_MEMORY)
def _fans(facing: Facing, places: tuple[int, ...]) -> Fans:
    pairs = [facing.listed[n][2] for n in places]
    return fans(pairs[0].moving, tuple(pair.fixed for pair in pairs))


@remembered(_MEMORY)
def _sides(facing: Facing, places: tuple[int, ...]) -> FaceSides:
    pairs = [facing.listed[n][2] for n in places]
    return FaceSides.of(pairs[0].moving, [pair.fixed for pair in pairs])


@dataclass(frozen=True, eq=False)
class FaceSides:
    """The faces of a moving piece as planes that may keep fixed pieces (m) off, which no contact touches."""

    witnesses: tuple[Witness, ...]
    sides: Sides

    @staticmethod
    def of(moving: Polyhedron, pieces: Sequence[Polyhedron]) -> FaceSides:
        """The faces of a moving piece over some fixed ones."""
        normals = np.array([face.normal for face in moving.faces])
        offsets = np.array([float((moving.vertices @ face.normal).max()) for face in moving.faces])
        cuts = np.cumsum([0, *(len(piece.vertices) for piece in pieces)])
        corners = np.concatenate([piece.vertices for piece in pieces])
        witnesses = tuple(Witness("moving-face", face.loops[0], ()) for face in moving.faces)
        return FaceSides(witnesses, Sides(normals, offsets, corners, cuts))

    def best(self, course: Course, least: Array, grazing: float) -> tuple[Places, Array, Array]:
        """For each piece the face with the largest margin over pieces of motion; see `best_sides`."""
        return best_sides(self.sides, np.zeros(1, ROW), course.motion, least, grazing)


def _candidates(assembly: Assembly, pair: Pair) -> tuple[Witness, ...]:
    """Planes of faces, and those along the two edges of the pair's edge–edge contacts."""
    own = [Witness("moving-face", face.loops[0], ()) for face in pair.moving.faces]
    faces = [Witness("fixed-face", (), face.loops[0]) for face in pair.fixed.faces]
    return (*faces, *own, *_contact_edges(assembly, pair))


def _contact_edges(assembly: Assembly, pair: Pair) -> list[Witness]:
    found = []
    for contact in (*pair.held, *pair.opening):
        if contact.kind is Kind.EDGE_EDGE:
            moving = _edge_along(pair.moving, assembly.moving.polyhedron, contact.moving)
            fixed = _edge_along(pair.fixed, assembly.fixed.polyhedron, contact.fixed)
            found.append(Witness("edges", moving, fixed))
    return list(dict.fromkeys(found))


@remembered(_MEMORY)
def _edge_along(piece: Polyhedron, part: Polyhedron, ends: tuple[int, ...]) -> tuple[int, int]:
    """The piece's edge on the line through two vertices of its part, run from the first towards the second."""
    a, b = part.vertices[list(ends)]
    direction = (b - a) / length(b - a)
    off = lengths(cross(piece.vertices - a, direction))
    for edge in piece.edges:
        i, j = edge.vertices
        if max(off[i], off[j]) <= 1e-9:
            forward = float((piece.vertices[j] - piece.vertices[i]) @ direction) > 0.0
            return (i, j) if forward else (j, i)
    raise KeyError("no edge of the piece lies along the contact's edge")


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
        """What keeps one pair apart over one piece of motion."""
        plane = free_plane(self.normals[n, m].tolist(), float(self.offsets[n, m]))
        return Separation(plane, float(self.margins[n, m]), float(self.clearances[n, m]))


@dataclass(frozen=True, eq=False)
class Fans:
    """The planes through all edges of some fixed pieces against one moving piece with vertices `body` (v, 3).

    What the errors cost a plane depends on its normal alone, and pieces share many.
    """

    body: Array
    edges: Edges

    def best(self, course: Course) -> FreePlanes:
        """For each fixed piece the plane with the largest certified margin over pieces of motion."""
        p, R, columns, cuts, twist, half, coupling = course.motion
        motion = p, R, columns, cuts, twist, half, coupling
        normals, offsets, margins, clearances = best(self.edges, self.body, motion)
        return FreePlanes(normals, offsets, margins - BEHIND, clearances - BEHIND)


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
    numbers: dict[bytes, int] = {}
    which = np.array([numbers.setdefault(normal.tobytes(), len(numbers)) for normal in fan.reshape(-1, 3) + 0.0])
    normals = np.frombuffer(b"".join(numbers)).reshape(-1, 3).copy()
    cuts = np.cumsum([0, *(len(faces) for faces in sides)])
    edges = Edges(arcs, cuts, normals, which.reshape(fan.shape[:2]), offsets, corners)
    return Fans(np.array(moving.vertices), edges)
