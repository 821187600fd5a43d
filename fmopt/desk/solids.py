"""Parts as the scene in three dimensions takes them, and a part alone on a turntable."""

from __future__ import annotations

import numpy as np

from fmopt.geometry.part import Part
from fmopt.geometry.polyhedron import Polyhedron
from fmopt.plan import Body
from fmopt.plan import Part as StatedPart


def stated_part(part: Part) -> StatedPart:
    """A part as a plan would state it, without clearances."""
    pieces = tuple(_body(piece) for piece in part.pieces)
    return StatedPart(_body(part.polyhedron), pieces, part.name, (0.0, 0.0), 0.0)


def _body(body: Polyhedron) -> Body:
    vertices = tuple(map(tuple, body.vertices.tolist()))
    return Body(vertices, tuple(tuple(tuple(loop) for loop in face.loops) for face in body.faces))


def middle(part: Part) -> float:
    """Height, in the part's frame, of the middle of its first feature; of the part without any, m."""
    if part.features:
        feature = part.features[0]
        inward = -0.5 if feature.kind == "hollow" else 0.5
        return float(feature.frame.apply(np.array([0.0, 0.0, inward * feature.length]))[2])
    heights = part.polyhedron.vertices[:, 2]
    return float(0.5 * (heights.min() + heights.max()))


def turning(part: Part) -> str:
    """A part alone in three dimensions, as a fragment of HTML."""
    from fmopt.report.scene import part_scene

    return part_scene(stated_part(part))
