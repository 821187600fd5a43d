"""How far convex polyhedra overlap or stand apart, by the separating axes of their faces and edges."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fmopt.geometry.polyhedron import Polyhedron
from fmopt.values import Array

_TOUCH = 1e-9  # m, overlaps up to this count as touching


def deepest(bodies: Sequence[Polyhedron], others: Sequence[Polyhedron]) -> float:
    """The largest `penetration` over all pairs, m; negative when every pair is apart, −∞ when there is no pair."""
    return max((penetration(body, other) for body in bodies for other in others), default=-np.inf)


def penetration(body: Polyhedron, other: Polyhedron) -> float:
    """Length in m of the shortest shift that takes two convex polyhedra apart.

    Negative when they are apart: then its size is the gap between two parallel planes that separate them, which is at
    most their distance.
    """
    faces = np.vstack([body.normals, -other.normals])
    shallow = _overlaps(body, other, faces)
    if shallow <= _TOUCH:
        return shallow
    crossed = np.cross(_directions(body)[:, None], _directions(other)[None]).reshape(-1, 3)
    length = np.linalg.norm(crossed, axis=1)
    axes = crossed[length > 1e-9] / length[length > 1e-9, None]
    return min(shallow, _overlaps(body, other, np.vstack([axes, -axes])))


def _overlaps(body: Polyhedron, other: Polyhedron, axes: Array) -> float:
    """Smallest over the axes n (k, 3) of max n·body − min n·other."""
    return float(np.min(np.max(axes @ body.vertices.T, axis=1) - np.min(axes @ other.vertices.T, axis=1)))


def _directions(body: Polyhedron) -> Array:
    """Unit directions (k, 3) of the edges, parallel ones once."""
    start, end = body.vertices[np.array([edge.vertices for edge in body.edges]).T]
    along = (end - start) / np.linalg.norm(end - start, axis=1)[:, None]
    leading = np.argmax(np.abs(along) > 1e-9, axis=1)
    along *= np.sign(along[np.arange(len(along)), leading])[:, None]
    return np.asarray(along[np.unique(np.round(along, 9), axis=0, return_index=True)[1]])
