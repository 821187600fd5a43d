"""Triangles to polygons: coplanar neighbours are merged and their common outline is traced into loops."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fmopt.errors import GeometryError
from fmopt.values import Array

MAX_FACES = 2_000  # what is planned with them takes a time that grows by their square, at least
_MOST_PAIRS = 2_000_000  # of vertices near each other: more than any honest mesh has
_FOLD = 100.0  # slivers up to this many tolerances high may lie folded back in their face's plane

Indices = NDArray[np.int64]
Loop = tuple[int, ...]


@dataclass(frozen=True)
class _Mesh:
    """Triangles with, for each side k (from corner k to k + 1), the triangle and side across it."""

    vertices: Array
    triangles: Indices
    across: tuple[tuple[tuple[int, int], ...], ...]


def polygon_faces(
    vertices: Array, triangles: Indices, tol: float, numbers: Indices | None = None
) -> tuple[tuple[Loop, ...], ...]:
    """Faces of a closed triangle mesh as loops of vertex indices, outer loop first, collinear vertices dropped.

    Args:
        vertices: (n, 3), m.
        triangles: (m, 3), counter-clockwise seen from outside.
        tol: triangles whose corners lie this close to a face's plane belong to the face, m.
        numbers: what to call each triangle (m,) in an error; its index if not given.

    Raises:
        GeometryError: the mesh is open or its triangles disagree about orientation, naming a triangle and an edge; or
            there are more than `MAX_FACES`.
    """
    called = np.arange(len(triangles)) if numbers is None else numbers
    mesh = _Mesh(vertices, triangles, _across(vertices, triangles, called))
    normals, heights = _frames(vertices, triangles)
    region = _regions(mesh, normals, heights, tol)
    outlines = _outlines(mesh, region)
    return _straightened(vertices, triangles, normals, region, outlines)


def merged_vertices(points: Array, triangles: Indices, reach: float) -> tuple[Array, Indices, Indices]:
    """Vertices within `reach` of each other become the first of them, triangles that vanish by it are dropped.

    Args:
        points: (n, 3), m.
        triangles: (m, 3) vertex indices.
        reach: m.

    Returns:
        The points (k, 3), the triangles (j, 3) over them, and which of the triangles given (j,) these are.

    Raises:
        GeometryError: the vertices lie in heaps.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    distinct, which = _distinct(points)
    _refuse_heaps(points[distinct], reach)
    pairs = cKDTree(points[distinct]).query_pairs(reach, output_type="ndarray")
    links = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(distinct), len(distinct)))
    group = connected_components(links, directed=False)[1]
    first = distinct[np.unique(group, return_index=True)[1]]
    merged = group[which][triangles].astype(np.int64)
    alive = np.all(merged != np.roll(merged, 1, axis=1), axis=1)
    return points[first], merged[alive], np.flatnonzero(alive)


def _distinct(points: Array) -> tuple[Indices, Indices]:
    """The first of each set of equal points (k,), in their order, and for every point (n,) which of these it is."""
    first, which = np.unique(points, axis=0, return_index=True, return_inverse=True)[1:]
    order = np.argsort(first)
    rank = np.empty(len(order), dtype=np.int64)
    rank[order] = np.arange(len(order))
    return first[order], rank[which.ravel()]


def _refuse_heaps(points: Array, reach: float) -> None:
    """Refuses points (n, 3) of which too many lie within `reach`, to go by cells of that size."""
    if reach > 0.0:
        cells = np.floor((points - points.min(axis=0)) / reach)
        count = np.unique(cells, axis=0, return_counts=True)[1].astype(np.float64)
        if count @ count - len(points) > _MOST_PAIRS:
            message = f"too many of the {len(points)} vertices lie within {1e3 * reach:.3g} mm of each other"
            raise GeometryError(message, "export the mesh again: its points must be spread over its surface")


def place(point: Sequence[float] | Array) -> str:
    """A point in words: "(1, 2, 3) mm"."""
    x, y, z = (1e3 * float(value) for value in point)
    return f"({x:.6g}, {y:.6g}, {z:.6g}) mm"


def _across(vertices: Array, triangles: Indices, called: Indices) -> tuple[tuple[tuple[int, int], ...], ...]:
    owner: dict[tuple[int, int], tuple[int, int]] = {}
    sides = [[(int(t[k]), int(t[(k + 1) % 3])) for k in range(3)] for t in triangles]
    advice = "repair the mesh: close it, orient all triangles outward, keep the solid free of edges of no thickness"
    for number, triangle in enumerate(sides):
        for k, side in enumerate(triangle):
            if side[0] == side[1]:
                raise GeometryError(
                    f"triangle {called[number]} near {place(vertices[side[0]])} repeats a vertex", advice
                )
            if side in owner:
                pair = f"{called[owner[side][0]]} and {called[number]}"
                message = f"edge {span(vertices, side)} runs the same way in triangles {pair}"
                raise GeometryError(message, advice)
            owner[side] = (number, k)
    for number, triangle in enumerate(sides):
        for a, b in triangle:
            if (b, a) not in owner:
                message = f"the surface is open: edge {span(vertices, (a, b))} has triangle {called[number]} only"
                raise GeometryError(message, advice)
    return tuple(tuple(owner[b, a] for a, b in triangle) for triangle in sides)


def span(vertices: Array, side: tuple[int, int]) -> str:
    """An edge in words: its vertices by index, and where these are of all vertices (n, 3), m."""
    return f"{side[0]}-{side[1]} from {place(vertices[side[0]])} to {place(vertices[side[1]])}"


def _frames(vertices: Array, triangles: Indices) -> tuple[Array, Array]:
    """Unit normals (m, 3) and smallest heights (m,) of the triangles; slivers have heights near 0."""
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    area = np.cross(b - a, c - a)
    size = np.linalg.norm(area, axis=1)
    longest = np.max([np.linalg.norm(side, axis=1) for side in (b - a, c - b, a - c)], axis=0)
    return area / np.where(size > 0.0, size, 1.0)[:, None], size / longest


def _regions(mesh: _Mesh, normals: Array, heights: Array, tol: float) -> Indices:
    """Number of the planar face of each triangle, grown from large triangles so that slivers decide nothing."""
    region = np.full(len(mesh.triangles), -1, dtype=np.int64)
    offsets = np.einsum("ij,ij->i", normals, mesh.vertices[mesh.triangles[:, 0]])
    spans = np.ptp(mesh.vertices[mesh.triangles], axis=1).max(axis=1)
    count = 0
    for seed in np.argsort(-heights * spans, kind="stable"):
        if region[seed] >= 0:
            continue
        if heights[seed] <= tol:
            region[seed] = _over_longest_side(mesh, region, int(seed))
        if region[seed] >= 0:
            continue
        if count == MAX_FACES:
            message = f"the {len(region)} triangles make more than {MAX_FACES} faces"
            raise GeometryError(message, "export it coarser: curved surfaces with fewer facets")
        near = np.abs(mesh.vertices @ normals[seed] - offsets[seed]) <= tol
        region[seed] = count
        front = [int(seed)]
        while front:
            for neighbour, _ in mesh.across[front.pop()]:
                alike = heights[neighbour] <= _FOLD * tol or normals[neighbour] @ normals[seed] > 0.0
                if region[neighbour] < 0 and alike and near[mesh.triangles[neighbour]].all():
                    region[neighbour] = count
                    front.append(neighbour)
        count += 1
    return region


def _over_longest_side(mesh: _Mesh, region: Indices, triangle: int) -> int:
    corners = mesh.vertices[mesh.triangles[triangle]]
    lengths = np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1)
    return int(region[mesh.across[triangle][int(np.argmax(lengths))][0]])


def _outlines(mesh: _Mesh, region: Indices) -> dict[int, list[list[int]]]:
    """For each face its loops; at a vertex that a loop meets twice, the walk turns inside the face's own fan."""
    loops: dict[int, list[list[int]]] = {}
    done: set[tuple[int, int]] = set()
    for start in ((t, k) for t in range(len(mesh.triangles)) for k in range(3)):
        number = int(region[start[0]])
        if start in done or region[mesh.across[start[0]][start[1]][0]] == number:
            continue
        loop = []
        t, k = start
        while (t, k) not in done:
            done.add((t, k))
            loop.append(int(mesh.triangles[t][k]))
            k = (k + 1) % 3
            while region[mesh.across[t][k][0]] == number:
                t, k = mesh.across[t][k]
                k = (k + 1) % 3
        loops.setdefault(number, []).append(loop)
    return loops


def _straightened(
    vertices: Array, triangles: Indices, normals: Array, region: Indices, outlines: dict[int, list[list[int]]]
) -> tuple[tuple[Loop, ...], ...]:
    """Drop vertices where only two faces meet (their edge runs straight through), put outer loops first."""
    meeting: Counter[int] = Counter(vertex for loops in outlines.values() for loop in loops for vertex in loop)
    faces = []
    for number in sorted(outlines):
        members = np.flatnonzero(region == number)
        a, b, c = (vertices[triangles[members, k]] for k in range(3))
        axis = np.cross(b - a, c - a).sum(axis=0)
        kept = [tuple(vertex for vertex in loop if meeting[vertex] > 2) for loop in outlines[number]]
        loops = [loop for loop in kept if len(loop) >= 3]
        if not loops:
            raise GeometryError(
                f"the face around triangle {members[0]} near {place(a[0])} has no corners",
                "lower the merging tolerance",
            )
        faces.append(tuple(sorted(loops, key=lambda loop: -_area(vertices, loop, axis))))
    return tuple(faces)


def _area(vertices: Array, loop: Loop, axis: Array) -> float:
    arms = vertices[list(loop)] - vertices[loop[0]]
    return float(np.sum(np.cross(arms[:-1], arms[1:]) @ axis))
