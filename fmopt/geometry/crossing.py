"""Triangles of a mesh that cross each other: a surface that passes through itself bounds no solid."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np

from fmopt.errors import GeometryError
from fmopt.geometry.facets import Indices
from fmopt.values import Array

Crossing: TypeAlias = tuple[int, int, Array]
_AT_ONCE = 100_000  # pairs of triangles looked at together
_ROWS = 200  # triangles whose neighbours are looked for together
_MOST_PAIRS = 10_000_000  # of triangles whose boxes meet: a mesh that is no heap has some dozens for each triangle


def first_crossing(points: Array, triangles: Indices, tol: float) -> Crossing | None:
    """The first two triangles of which one has an edge that passes through the other, and where; None if none do.

    What touches, shares an edge or a corner, or overlaps in one plane does not cross.

    Args:
        points: (n, 3), m.
        triangles: (m, 3) vertex indices.
        tol: what passes by less than this does not cross, m.

    Returns:
        Indices of the triangle and of the one whose edge passes through it, and the place (3,) in m.

    Raises:
        GeometryError: the triangles lie in heaps.
    """
    corners = points[triangles]
    one, other = _near(corners)
    for start in range(0, len(one), _AT_ONCE):
        i, j = one[start : start + _AT_ONCE], other[start : start + _AT_ONCE]
        for k in range(3):
            hit, where = _pierced(corners[i], corners[j][:, k], corners[j][:, (k + 1) % 3], tol)
            if len(found := np.flatnonzero(hit)):
                return int(i[found[0]]), int(j[found[0]]), where[found[0]]
    return None


def _near(corners: Array) -> tuple[Indices, Indices]:
    """Ordered pairs of triangles whose boxes meet."""
    from shapely import STRtree, box

    low, high = corners.min(axis=1), corners.max(axis=1)
    flat = box(low[:, 0], low[:, 1], high[:, 0], high[:, 1])
    tree, pairs, seen = STRtree(flat), [np.zeros((2, 0), dtype=np.int64)], 0
    for start in range(0, len(flat), _ROWS):
        one, other = tree.query(flat[start : start + _ROWS])
        one += start
        meet = (one != other) & (low[one, 2] <= high[other, 2]) & (low[other, 2] <= high[one, 2])
        pairs.append(np.array([one[meet], other[meet]]))
        seen += len(one)
        if seen > _MOST_PAIRS:
            raise GeometryError(f"too many of the {len(flat)} triangles lie over each other", "export the mesh coarser")
    one, other = np.hstack(pairs)
    order = np.lexsort((other, one))
    return one[order], other[order]


def _pierced(triangles: Array, start: Array, end: Array, tol: float) -> tuple[np.ndarray, Array]:
    """Whether segments (n, 3) pass through triangles (n, 3, 3), and where they meet the triangles' planes (n, 3)."""
    a, b, c = (triangles[:, k] for k in range(3))
    normal = np.cross(b - a, c - a)
    size = np.linalg.norm(normal, axis=1)
    normal /= np.where(size > 0.0, size, 1.0)[:, None]
    before, after = (np.einsum("ij,ij->i", normal, end_ - a) for end_ in (start, end))
    through = (size > 0.0) & (np.minimum(before, after) < -tol) & (np.maximum(before, after) > tol)
    share = before / np.where(through, before - after, 1.0)
    where = start + share[:, None] * (end - start)
    for one, two in ((a, b), (b, c), (c, a)):
        side = two - one
        length = np.linalg.norm(side, axis=1)
        inward = np.einsum("ij,ij->i", np.cross(normal, side), where - one)
        through &= inward > tol * length
    return through, where
