"""The choice of separating planes: for each pair of convex pieces the plane with the largest certified margin.

Planes through the edges of fixed pieces, between the two faces of each, that keep a moving piece at most margin.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fmopt.certificate.assembly import Assembly
from fmopt.certificate.curvature import Course
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
    table = _tables(assembly, facing)
    least = np.full((len(course.motion.twist), len(facing.listed)), -np.inf)
    free = [(places, _fans(facing, places).best(course)) for _, places in facing.apart]
    for places, planes in free:
        least[:, places] = np.where(planes.clearances >= -_GRAZING, planes.margins, -np.inf)
    found = table.best(course, least, _GRAZING)
    chosen = [
        [
            Separation(table.witnesses[n], margin, clearance) if n >= 0 else None
            for n, margin, clearance in zip(*row, strict=True)
        ]
        for row in zip(*(each.tolist() for each in found), strict=True)
    ]
    for places, planes in free:
        for k, row in enumerate(chosen):
            for m, n in enumerate(places):
                if row[n] is None and least[k, n] > -np.inf:
                    row[n] = planes.separation(k, m)
    return chosen


@remembered(_MEMORY)
def _tables(assembly: Assembly, facing: Facing) -> Candidates:
    return Candidates.of([_block(assembly, pair) for _, _, pair in facing.listed])


@remembered(_MEMORY)
def _block(assembly: Assembly, pair: Pair) -> Block:
    return Block.of(assembly, pair, _candidates(assembly, pair))


@remembered(_MEMORY)
def _fans(facing: Facing, places: tuple[int, ...]) -> Fans:
    pairs = [facing.listed[n][2] for n in places]
    return fans(pairs[0].moving, tuple(pair.fixed for pair in pairs))


def _candidates(assembly: Assembly, pair: Pair) -> tuple[Witness, ...]:
    """Planes of faces, and those along the two edges of the pair's edge–edge contacts."""
    own = [Witness("moving-face", face.loops[0], ()) for face in pair.moving.faces]
    if own and not pair.touched:
        return tuple(own)
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

    A ball has its centre for a vertex, and is a radius (m) nearer.

    What the errors cost a plane depends on its normal alone, and pieces share many.
    """

    body: Array
    edges: Edges
    radius: float = 0.0

    def best(self, course: Course) -> FreePlanes:
        """For each fixed piece the plane with the largest certified margin over pieces of motion."""
        p, R, columns, cuts, twist, half, coupling = course.motion
        motion = p, R, columns, cuts, twist, half, coupling
        normals, offsets, margins, clearances = best(self.edges, self.body, motion)
        return FreePlanes(normals, offsets, margins - self.radius - BEHIND, clearances - self.radius - BEHIND)


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
    return Fans(np.array(moving.vertices), edges, float(moving.radii.max()))
