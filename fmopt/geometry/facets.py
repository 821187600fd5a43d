"""Triangles to polygons: coplanar neighbours are merged and their common outline is traced into loops."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from fmopt.errors import GeometryError
from fmopt.geometry.plane.boolean import linked
from fmopt.spatial.values import Array

MAX_FACES = 2_000  # what is planned with them takes a time that grows by their square, at least
FEW_REFLEX, MOST_REFLEX = 100, 350  # reflex edges of a part that is cut through them in no time, and in a minute
_MOST_PAIRS = 2_000_000  # of vertices near each other: more than any honest mesh has
_FOLD = 100.0  # slivers up to this many tolerances high may lie folded back in their face's plane

Indices = NDArray[np.int64]
Loop = tuple[int, ...]


@dataclass(frozen=True, eq=False)
class Patchwork:
    """A closed mesh of triangles (m, 3) between vertices (n, 3), m, and the regions that they make."""

    vertices: Array
    triangles: Indices  # counter-clockwise seen from outside
    # For each side k of a triangle, from corner k to k + 1, the triangle and the side across it
    across: tuple[tuple[tuple[int, int], ...], ...]
    region: Indices  # number of the region of each triangle (m,), from 0

    @cached_property
    def areas(self) -> Array:
        """Normals (m, 3) of the triangles, as long as their areas, m²."""
        return 0.5 * normals_of(self.vertices[self.triangles])

    @cached_property
    def members(self) -> tuple[Indices, ...]:
        """The triangles (k,) of each region (m,)."""
        order = np.argsort(self.region, kind="stable")
        return tuple(np.split(order, np.flatnonzero(np.diff(self.region[order])) + 1))

    @property
    def neighbours(self) -> list[set[int]]:
        """The regions beside each region."""
        around: list[set[int]] = [set() for _ in self.members]
        for number, sides in enumerate(self.across):
            own = int(self.region[number])
            around[own].update(int(self.region[other]) for other, _ in sides)
        for own, row in enumerate(around):
            row.discard(own)
        return around


def patchwork(vertices: Array, triangles: Indices, tol: float, numbers: Indices) -> Patchwork:
    """A closed triangle mesh with the number of the planar face of each triangle.

    Triangles (m, 3) over vertices (n, 3), m, are counter-clockwise seen from outside, and called by `numbers` (m,) in
    an error; those whose corners are within `tol`, m, of a face's plane belong to the face.

    Raises:
        GeometryError: the mesh is open or its triangles disagree about orientation, naming a triangle and an edge.
    """
    across = _across(vertices, triangles, numbers)
    parts = Patchwork(vertices, triangles, across, np.full(len(triangles), -1, dtype=np.int64))
    return replace(parts, region=_regions(parts, tol))


def faces_of(parts: Patchwork, region: Indices) -> tuple[tuple[tuple[Loop, ...], ...], Indices]:
    """The faces of regions (m,) of triangles as loops, outer first, collinear vertices dropped; and these regions (m,).

    A region without corners, such as a sliver along an edge, goes to the one beside it with which it shares most.

    Raises:
        GeometryError: a region is all of a surface that closes.
    """
    outlines = _outlines(parts, region)
    while (bare := _without_corners(outlines)) is not None:  # with each there is one region less
        region = _handed_over(parts, region, bare)
        outlines = _outlines(parts, region)
    if len(whole := np.flatnonzero(~np.isin(region, [*outlines]))):  # all of a surface that closes
        where = place(parts.vertices[parts.triangles[whole[0], 0]])
        raise GeometryError(f"the face at {where} has no corners", "export the mesh again: it bounds no solid there")
    return _straightened(parts, region, outlines), region


def merged_vertices(points: Array, triangles: Indices, reach: float) -> tuple[Array, Indices, Indices]:
    """Points (n, 3) within `reach` (m) of each other become the first of them, triangles (m, 3) without area go.

    Returns:
        The points (k, 3), the triangles (j, 3) over them, and which of the triangles given (j,) these are.

    Raises:
        GeometryError: the vertices lie in heaps.
    """
    kept, group = np.unique(first_within(points, reach), return_inverse=True)
    merged = group[triangles].astype(np.int64)
    alive = np.all(merged != np.roll(merged, 1, axis=1), axis=1)
    return points[kept], merged[alive], np.flatnonzero(alive)


def together(surfaces: Sequence[tuple[Array, Indices]]) -> tuple[Array, Indices]:
    """Points (n, 3) and triangles (m, 3) of several surfaces as those of one."""
    starts = np.cumsum([0, *(len(points) for points, _ in surfaces)])[:-1]
    triangles = [corners + start for (_, corners), start in zip(surfaces, starts, strict=True)]
    return np.vstack([points for points, _ in surfaces]), np.vstack(triangles)


def compact(points: Array, triangles: Indices) -> tuple[Array, Indices]:
    """The points (k, 3) of those (n, 3) that triangles (m, 3) use, and the triangles over them."""
    used, renumbered = np.unique(triangles, return_inverse=True)
    return points[used], renumbered.reshape(-1, 3).astype(np.int64)


def first_within(points: Array, reach: float) -> Indices:
    """For each point (n, 3) the first of those that hang together by steps of at most `reach`, m.

    Raises:
        GeometryError: the points lie in heaps.
    """
    # Equal points count once: a corner of many triangles would be a heap of pairs by itself.
    distinct, which = np.unique(points, axis=0, return_inverse=True)
    _refuse_heaps(distinct, reach)
    label = linked(distinct, reach)[which.ravel()]
    return np.unique(label, return_index=True)[1][label]


def _refuse_heaps(points: Array, reach: float) -> None:
    """Refuses points (n, 3) of which too many lie within `reach`, to go by cells of that size."""
    if reach > 0.0:
        cells = np.floor((points - points.min(axis=0)) / reach)
        count = np.unique(cells, axis=0, return_counts=True)[1].astype(np.float64)
        if count @ count - len(points) > _MOST_PAIRS:
            message = f"too many of the {len(points)} vertices lie within {1e3 * reach:.3g} mm of each other"
            raise GeometryError(message, "export the mesh again: its points must be spread over its surface")


def shells_of(triangles: Indices, count: int) -> Indices:
    """The number of the shell of each triangle (m,), of those (m, 3) that share some of as many vertices as `count`."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    sides = np.vstack([triangles[:, :2], triangles[:, 1:]])
    links = coo_array((np.ones(len(sides)), sides.T), shape=(count, count))
    return np.asarray(connected_components(links, directed=False)[1][triangles[:, 0]], dtype=np.int64)


def normals_of(corners: Array) -> Array:
    """Normals (m, 3) of triangles by their corners (m, 3, 3), m, as long as twice their areas, m²."""
    return np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])


def heights_of(corners: Array) -> Array:
    """The least heights (m,) of triangles by their corners (m, 3, 3), m; 0 of a point."""
    longest = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2).max(axis=1)
    return np.asarray(np.linalg.norm(normals_of(corners), axis=1) / np.where(longest > 0.0, longest, 1.0))


def place(point: Sequence[float] | Array) -> str:
    """A point in words: "(1, 2, 3) mm"."""
    x, y, z = (1e3 * float(value) for value in point)
    return f"({x:.6g}, {y:.6g}, {z:.6g}) mm"


def _across(vertices: Array, triangles: Indices, called: Indices) -> tuple[tuple[tuple[int, int], ...], ...]:
    owner: dict[tuple[int, int], tuple[int, int]] = {}
    sides = [((a, b), (b, c), (c, a)) for a, b, c in triangles.tolist()]
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


def _frames(parts: Patchwork) -> tuple[Array, Array]:
    """Unit normals (m, 3) and smallest heights (m,) of the triangles; slivers have heights near 0."""
    area = np.linalg.norm(parts.areas, axis=1)
    return parts.areas / np.where(area > 0.0, area, 1.0)[:, None], heights_of(parts.vertices[parts.triangles])


def _regions(parts: Patchwork, tol: float) -> Indices:
    """Number of the planar face of each triangle, grown from large triangles so that slivers decide nothing."""
    normals, heights = _frames(parts)
    region, triangles, points = parts.region.copy(), parts.triangles.tolist(), parts.vertices.tolist()
    offsets = np.einsum("ij,ij->i", normals, parts.vertices[parts.triangles[:, 0]])
    spans = np.ptp(parts.vertices[parts.triangles], axis=1).max(axis=1)
    count = 0
    for seed in np.argsort(-heights * spans, kind="stable"):
        if region[seed] >= 0:
            continue
        # The normal of a sliver says nothing: it goes with what is across its longest side, once that has a face.
        if heights[seed] <= tol:
            region[seed] = _over_longest_side(parts, region, int(seed))
        if region[seed] >= 0:
            continue
        (x, y, z), offset = normals[seed].tolist(), float(offsets[seed])
        region[seed] = count
        front = [int(seed)]
        while front:
            for neighbour, _ in parts.across[front.pop()]:
                corners = (points[index] for index in triangles[neighbour])
                if region[neighbour] >= 0 or any(abs(x * a + y * b + z * c - offset) > tol for a, b, c in corners):
                    continue
                if heights[neighbour] <= _FOLD * tol or normals[neighbour] @ normals[seed] > 0.0:
                    region[neighbour] = count
                    front.append(neighbour)
        count += 1
    return region


def require_few(count: int, most: int = MAX_FACES) -> None:
    """Refuses more faces than are taken.

    Raises:
        GeometryError: there are more.
    """
    if count > most:
        message = f"it has {count} faces, of which {most} are taken"
        raise GeometryError(message, "give curved surfaces fewer facets, by a coarser export or by lower 'sides'")


def _over_longest_side(parts: Patchwork, region: Indices, triangle: int) -> int:
    corners = parts.vertices[parts.triangles[triangle]]
    lengths = np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1)
    return int(region[parts.across[triangle][int(np.argmax(lengths))][0]])


def _outlines(parts: Patchwork, region: Indices) -> dict[int, list[list[int]]]:
    """For each face its loops; at a vertex that a loop meets twice, the walk turns inside the face's own fan."""
    loops: dict[int, list[list[int]]] = {}
    done: set[tuple[int, int]] = set()
    face, triangles = region.tolist(), parts.triangles.tolist()
    for start in ((t, k) for t in range(len(triangles)) for k in range(3)):
        number = face[start[0]]
        if start in done or face[parts.across[start[0]][start[1]][0]] == number:
            continue
        loop = []
        t, k = start
        while (t, k) not in done:
            done.add((t, k))
            loop.append(triangles[t][k])
            k = (k + 1) % 3
            while face[parts.across[t][k][0]] == number:
                t, k = parts.across[t][k]
                k = (k + 1) % 3
        loops.setdefault(number, []).append(loop)
    return loops


def _meeting(outlines: dict[int, list[list[int]]]) -> Counter[int]:
    """How many loops run through each vertex: where two do, their edge runs straight through."""
    return Counter(vertex for loops in outlines.values() for loop in loops for vertex in loop)


def _without_corners(outlines: dict[int, list[list[int]]]) -> int | None:
    """The first region none of whose loops has three corners or more."""
    meeting = _meeting(outlines)
    for number in sorted(outlines):
        if all(sum(meeting[vertex] > 2 for vertex in loop) < 3 for loop in outlines[number]):
            return number
    return None


def _handed_over(parts: Patchwork, region: Indices, bare: int) -> Indices:
    """The regions with one of them, which has an outline, made part of that beside it along the longest border."""
    shared: dict[int, float] = {}
    for number in np.flatnonzero(region == bare).tolist():
        for k, (other, _) in enumerate(parts.across[number]):
            if region[other] != bare:
                a, b = parts.vertices[parts.triangles[number][[k, (k + 1) % 3]]]
                beside = int(region[other])
                shared[beside] = shared.get(beside, 0.0) + float(np.linalg.norm(b - a))
    return np.where(region == bare, max(sorted(shared), key=lambda number: shared[number]), region)


def _straightened(
    parts: Patchwork, region: Indices, outlines: dict[int, list[list[int]]]
) -> tuple[tuple[Loop, ...], ...]:
    """Drop vertices where only two faces meet (their edge runs straight through), put outer loops first."""
    meeting = _meeting(outlines)
    faces = []
    for number in sorted(outlines):
        kept = [tuple(vertex for vertex in loop if meeting[vertex] > 2) for loop in outlines[number]]
        loops = [loop for loop in kept if len(loop) >= 3]
        if len(loops) > 1:
            axis = parts.areas[region == number].sum(axis=0)
            loops.sort(key=lambda loop: -float(np.sum(fan(parts.vertices, loop) @ axis)))
        faces.append(tuple(loops))
    return tuple(faces)


def fan(vertices: Array, loop: Loop) -> Array:
    """Normals (k, 3) of the triangles of a loop of vertices (n, 3) about its first, long by twice their areas, m²."""
    arms = vertices[list(loop)] - vertices[loop[0]]
    return np.cross(arms[:-1], arms[1:])
