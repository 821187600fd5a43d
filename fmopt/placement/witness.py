"""The choice of separating planes: for each pair of convex pieces the plane with the largest certified margin."""

from __future__ import annotations

import numpy as np

from fmopt.certificate.assembly import Assembly
from fmopt.certificate.candidates import Block, Candidates
from fmopt.certificate.course import Course
from fmopt.certificate.pair import Facing, Pair, Witness
from fmopt.certificate.separation import Separation
from fmopt.contact.primitive import Kind
from fmopt.geometry.polyhedron import Polyhedron
from fmopt.memory import remembered
from fmopt.placement.fan import Fans, fans
from fmopt.se3 import cross, length, lengths

_GRAZING = 2e-6
_MEMORY = 2048


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
    if not pair.touched:
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
