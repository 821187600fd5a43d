"""Kernels: which vertices and edges that lie in the plane of a fixed face touch it or its rims on a piece of motion."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from fmopt.compiled import compiled, part
from fmopt.values import Array

DOUBT = 3e-5  # m; a vertex nearer to a rim than its error and this is listed with its edge
_LEVEL = 1e-3  # sine of the angle at which an edge runs level with a rim

Rims = tuple[Array, Array]
"""Of each rim of a face a point, and the unit direction (r, 3) into the face across it."""

Edges = tuple[NDArray[np.intp], Array, Array, Array, Array]
"""Places (e, 2) of the ends of edges of the moving part, their directions (e, 3) and the sums (e, 3) of the normals of
their faces, and both (c, 3) for the convex rims."""


@compiled
def depths(vertices: Array, rims: Rims, p: Array, R: Array, depth: Array, rows: Array) -> None:
    """Fills in how far inside rims (r) vertices are, m, and how errors change that.

    Args:
        vertices: in the body (n, 3).
        rims: of the face.
        p: positions (2, 3).
        R: rotations (2, 3, 3).
        depth: (2, n, r).
        rows: (2, n, r, 6).
    """
    points, inward = rims
    arm = np.empty(3)
    for end in range(len(p)):
        for i in range(len(vertices)):
            v = vertices[i]
            for j in range(3):
                arm[j] = R[end, j, 0] * v[0] + R[end, j, 1] * v[1] + R[end, j, 2] * v[2]
            for r in range(len(points)):
                total = 0.0
                for j in range(3):
                    k, m = (j + 1) % 3, (j + 2) % 3
                    total += inward[r, j] * (arm[j] + p[end, j] - points[r, j])
                    rows[end, i, r, j] = inward[r, j]
                    rows[end, i, r, 3 + j] = arm[k] * inward[r, m] - arm[m] * inward[r, k]
                depth[end, i, r] = total


@part
def _meets(a: Array, b: Array, rims: Rims, rim: int) -> bool:
    """Whether an edge from a to b (3,) in a wall's plane crosses a rim, rather than passing the face beside it."""
    points, inward = rims
    rise, to, square = 0.0, 0.0, 0.0
    for j in range(3):
        rise += (b[j] - a[j]) * inward[rim, j]
        to += (points[rim, j] - a[j]) * inward[rim, j]
        square += (b[j] - a[j]) ** 2
    if abs(rise) <= _LEVEL * math.sqrt(square):
        return False
    share = min(max(to / rise, 0.0), 1.0)
    for r in range(len(points)):
        room = 0.0
        for j in range(3):
            room += inward[r, j] * (a[j] + share * (b[j] - a[j]) - points[r, j])
        if r != rim and not room > -DOUBT:
            return False
    return True


@part
def _forward(edges: Edges, e: int, r: int, R: Array) -> bool:
    """Whether (R e_moving) × e_fixed points out of the fixed part as edge and rim run."""
    _, own, own_normals, other, other_normals = edges
    turned, normals = np.empty(3), np.empty(3)
    for j in range(3):
        turned[j] = R[j, 0] * own[e, 0] + R[j, 1] * own[e, 1] + R[j, 2] * own[e, 2]
        normals[j] = R[j, 0] * own_normals[e, 0] + R[j, 1] * own_normals[e, 1] + R[j, 2] * own_normals[e, 2]
    total = 0.0
    for j in range(3):
        k, m = (j + 1) % 3, (j + 2) % 3
        out = turned[k] * other[r, m] - turned[m] * other[r, k]
        total += out * (other_normals[r, j] - normals[j])
    return bool(total > 0.0)


@compiled
def pattern(
    vertices: Array, rims: Rims, edges: Edges, p: Array, R: Array, depth: Array, doubt: Array, found: NDArray[np.uint8]
) -> None:
    """Fills in which vertices touch a face, and which edges cross its convex rims along a piece of motion.

    Args:
        vertices: in the body (n, 3), in the face's plane.
        rims: of the face, c convex ones first; at the others another face begins.
        edges: convex edges between the vertices.
        p: position (3,) at the start.
        R: rotation (3, 3) there.
        depth: how far inside rims vertices are at both ends (2, n, r), m.
        doubt: how far errors displace that (2, n, r), m.
        found: (n + e c), of each vertex whether it is listed, of each edge and rim 1 where they cross, 2 where they do
            so with the edge run from its first end to its second.
    """
    n, c = len(vertices), len(edges[3])
    side = np.empty((n, len(rims[0])), dtype=np.int8)
    for i in range(n):
        for r in range(len(rims[0])):
            least, most = min(depth[0, i, r], depth[1, i, r]), max(depth[0, i, r], depth[1, i, r])
            wide = max(doubt[0, i, r], doubt[1, i, r])
            side[i, r] = 1 if least > wide else (-1 if most < -wide else 0)
    sure = side == 1
    sure[:, c:] = side[:, c:] >= 0
    joined = sure.copy()
    ends = edges[0]
    for e in range(len(ends)):
        a, b = ends[e]
        for r in range(len(rims[0])):
            joined[a, r] |= sure[b, r] and side[a, r] == 0
            joined[b, r] |= sure[a, r] and side[b, r] == 0
    for i in range(n):
        found[i] = joined[i].all()
    # An edge crosses a rim all along where one end is beyond it, or as long as that end, which is listed, is.
    at = np.empty((2, 3))
    for e in range(len(ends)):
        for k in range(2):
            v = vertices[ends[e, k]]
            for j in range(3):
                at[k, j] = p[j] + R[j, 0] * v[0] + R[j, 1] * v[1] + R[j, 2] * v[2]
        for r in range(c):
            over = False
            for k in range(2):
                a, b = ends[e, k], ends[e, 1 - k]
                over |= sure[a, r] and (side[b, r] == -1 or (side[b, r] == 0 and found[b] == 1))
            crossing = over and _meets(at[0], at[1], rims, r)
            found[n + e * c + r] = (2 if _forward(edges, e, r, R) else 1) if crossing else 0
