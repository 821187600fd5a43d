"""Parts as the scene in three dimensions takes them, and a part alone on a turntable."""

from __future__ import annotations

from typing import Any

import numpy as np

from fmopt.geometry.part import Part
from fmopt.geometry.polyhedron import Polyhedron


def part_data(part: Part) -> dict[str, Any]:
    """A part as a plan holds it: vertices (m) and faces, and those of its convex pieces."""
    return {"name": part.name, **body_data(part.polyhedron), "pieces": [body_data(piece) for piece in part.pieces]}


def body_data(body: Polyhedron) -> dict[str, Any]:
    """A polyhedron as a plan holds it: vertices in m, faces as loops of indices, the outer one first."""
    return {"vertices": body.vertices.tolist(), "faces": [[list(loop) for loop in face.loops] for face in body.faces]}


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

    return part_scene(part_data(part))
