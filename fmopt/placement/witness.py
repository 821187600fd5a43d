"""The choice of separating planes: for each pair of convex pieces the plane with the largest certified margin."""

from __future__ import annotations

from fmopt.certificate.assembly import Assembly
from fmopt.certificate.pair import Facing, Pair, Witness
from fmopt.certificate.separation import Candidates, Course, Separation
from fmopt.contact.primitive import Kind
from fmopt.geometry.polyhedron import Polyhedron
from fmopt.memory import remembered
from fmopt.placement.fan import Fans
from fmopt.se3 import cross, length, lengths
from fmopt.values import Array

_GRAZING = 2e-6
_MEMORY = 2048


def choose_separations(assembly: Assembly, facing: Facing, course: Course) -> list[list[Separation | None]]:
    """The best plane between each two pieces over pieces of motion, None where they are not apart nominally.

    Pieces in touch are kept apart by a plane that the contacts themselves lie in; others by any plane through an edge
    of the fixed piece, or by a face of the moving one.
    """
    found = _tables(assembly, facing).best(course, _GRAZING)
    for moving, places in facing.apart:
        for row, planes in zip(found, _fans(facing, places).best(moving, course), strict=True):
            for n, plane in zip(places, planes, strict=True):
                other = row[n]
                if plane.clearance >= -_GRAZING and (other is None or other.margin < plane.margin):
                    row[n] = plane
    return found


@remembered(_MEMORY)
def _tables(assembly: Assembly, facing: Facing) -> Candidates:
    return Candidates.of(assembly, ((pair, _candidates(assembly, pair)) for _, _, pair in facing.listed))


@remembered(_MEMORY)
def _fans(facing: Facing, places: tuple[int, ...]) -> Fans:
    return Fans.of([facing.listed[n][2] for n in places])


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
            moving = _edge_along(pair.moving, *assembly.moving.polyhedron.vertices[list(contact.moving)])
            fixed = _edge_along(pair.fixed, *assembly.fixed.polyhedron.vertices[list(contact.fixed)])
            found.append(Witness("edges", moving, fixed))
    return list(dict.fromkeys(found))


def _edge_along(piece: Polyhedron, a: Array, b: Array) -> tuple[int, int]:
    """The piece's edge on the line through a and b, run from a towards b."""
    direction = (b - a) / length(b - a)
    off = lengths(cross(piece.vertices - a, direction))
    for edge in piece.edges:
        i, j = edge.vertices
        if max(off[i], off[j]) <= 1e-9:
            forward = float((piece.vertices[j] - piece.vertices[i]) @ direction) > 0.0
            return (i, j) if forward else (j, i)
    raise KeyError("no edge of the piece lies along the contact's edge")
