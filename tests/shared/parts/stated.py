"""Parts as a plan states them."""

from fmopt.geometry.part import Part
from fmopt.verify.reading.document import Body
from fmopt.verify.reading.document import StatedPart as Stated


def as_stated(part: Part) -> Stated:
    """A part as a plan states it."""
    own, *shapes = (
        Body(tuple((x, y, z) for x, y, z in body.vertices.tolist()), tuple(face.loops for face in body.faces))
        for body in (part.polyhedron, *part.pieces)
    )
    return Stated(own, tuple(shapes), part.name, (0.0, 0.0), 0.0)
