"""Corners of convex pieces as convex pieces of their own, for engines that find one contact a pair of pieces.

A piece shrunk about one of its vertices lies in the piece, and so does the hull of two such copies: beside the piece
they leave the solid as it is.
"""

from __future__ import annotations

from itertools import combinations
from typing import Any

import numpy as np
from scipy.spatial import ConvexHull

from fmopt.values import Array

_SIZE = 0.001  # m across a corner
_LARGEST = 0.5  # of the piece
_LENGTHWISE = 0.9  # |z| of the unit direction from which an edge runs along the insertion
_ON = 1e-9  # m from a plane up to which a vertex lies on it


def with_corners(vertices: Array) -> list[Array]:
    """The vertices (v, 3), m, of a piece, of its corners, and of strips along its edges in the direction of z.

    A part that goes in along z lies flush on a wall from its leading corners to the mouth, which its lengthwise edges
    cross: those are the ends of the patch of contact.
    """
    hull = ConvexHull(vertices)
    corners = {int(k): _corner(vertices, int(k)) for k in hull.vertices}
    return [vertices, *corners.values(), *(np.vstack([corners[i], corners[j]]) for i, j in _lengthwise(hull))]


def _corner(vertices: Array, k: int) -> Array:
    """The piece shrunk about its vertex k to the size of a corner."""
    arms = vertices - vertices[k]
    return np.asarray(vertices[k] + min(_LARGEST, _SIZE / float(np.linalg.norm(arms, axis=1).max())) * arms)


def _lengthwise(hull: Any) -> list[tuple[int, int]]:
    """Pairs of vertices that an edge along z joins: those on two planes of faces at once."""
    points, planes = hull.points, hull.equations
    on = np.abs(points @ planes[:, :3].T + planes[:, 3]) <= _ON
    pairs = []
    for i, j in combinations(sorted(int(k) for k in hull.vertices), 2):
        along = points[j] - points[i]
        shared = planes[on[i] & on[j], :3]
        if abs(along[2]) >= _LENGTHWISE * np.linalg.norm(along) and np.linalg.matrix_rank(shared, tol=1e-6) > 1:
            pairs.append((i, j))
    return pairs
