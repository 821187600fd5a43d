"""Polyhedra with merged coplanar faces: each edge flagged convex or reflex, closedness and orientation checked.

Lengths in m. Face loops list vertex indices, the outer loop first, counter-clockwise seen from outside, then the
holes, clockwise. Coordinates that come in are kept to the bit.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fmopt.errors import GeometryError
from fmopt.geometry.facets import Loop, faces_of, patchwork, place, span
from fmopt.spatial.se3 import Pose, cross
from fmopt.spatial.values import Array, Value, frozen

if TYPE_CHECKING:
    from manifold3d import Manifold

_LEVEL = 1e-12  # m
_ON_FACE = 1e-9  # of the diameter: points so near to a face of a hull are on it
_ROWS = 256  # points whose distances from all others are taken at once
_DECIMALS = 15  # of coordinates in m, once rounded: the normals of faces of 1 mm stay the same to 1e-12


@dataclass(frozen=True, eq=False)
class Face(Value, normal=(3,), labels={"normal": "face normal"}):
    """A planar face: its loops, and its plane normal·x = offset with the unit normal (3,) pointing outward."""

    loops: tuple[Loop, ...]
    normal: Array
    offset: float

    @property
    def vertices(self) -> Loop:
        """All vertex indices of the face, each once, outer loop first."""
        return tuple(dict.fromkeys(index for loop in self.loops for index in loop))


@dataclass(frozen=True)
class Edge:
    """An edge: runs from vertices[0] to vertices[1] in faces[0], the other way in faces[1]."""

    vertices: tuple[int, int]
    faces: tuple[int, int]
    convex: bool


@dataclass(frozen=True, eq=False)
class Polyhedron(Value, vertices=(None, 3)):
    """A closed polyhedron, oriented outward: vertices (n, 3) in m, planar faces, edges; and exact balls beside it.

    `balls` are (vertex, radius in m): the vertex, which belongs to no face, is the centre of a ball of the body.
    """

    vertices: Array
    faces: tuple[Face, ...]
    edges: tuple[Edge, ...]
    balls: tuple[tuple[int, float], ...] = ()

    @cached_property
    def normals(self) -> Array:
        """Outward unit normals (m, 3) of the faces."""
        return frozen(np.reshape([face.normal for face in self.faces], (-1, 3)))

    @cached_property
    def offsets(self) -> Array:
        """Plane offsets (m,) of the faces, m."""
        return frozen([face.offset for face in self.faces])

    @cached_property
    def radii(self) -> Array:
        """Radii (n,) of the balls about the vertices, m; 0 about those that are points."""
        found = np.zeros(len(self.vertices))
        for vertex, radius in self.balls:
            found[vertex] = radius
        return frozen(found)

    @property
    def widths(self) -> Array:
        """How wide it is along the axes, balls and all (3,), m."""
        round_ = self.radii[:, None]
        return np.asarray((self.vertices + round_).max(axis=0) - (self.vertices - round_).min(axis=0))

    @cached_property
    def reflex(self) -> int:
        """The number of edges along which it is not convex."""
        return sum(not edge.convex for edge in self.edges)

    @property
    def vertex_faces(self) -> tuple[tuple[int, ...], ...]:
        """For each vertex the indices of its faces, ascending."""
        around: list[set[int]] = [set() for _ in self.vertices]
        for number, face in enumerate(self.faces):
            for vertex in face.vertices:
                around[vertex].add(number)
        return tuple(tuple(sorted(numbers)) for numbers in around)

    @cached_property
    def volume(self) -> float:
        """Volume in m³, by the divergence theorem about the centre of the vertices."""
        return _volume(self.vertices, (face.loops for face in self.faces))

    @cached_property
    def diameter(self) -> float:
        """Largest distance between two vertices, m."""
        return diameter(self.vertices)


def diameter(points: Array) -> float:
    """Largest distance between two of the points (n, d)."""
    from scipy.spatial.distance import cdist

    # By some rows: all distances at once would take memory by the square of their number.
    rows = (points[i : i + _ROWS] for i in range(0, len(points), _ROWS))
    return math.sqrt(max(float(cdist(some, points, "sqeuclidean").max()) for some in rows))


def from_faces(
    vertices: ArrayLike,
    faces: Sequence[Sequence[Sequence[int]]],
    planes: Sequence[tuple[Array, float] | None] | None = None,
    balls: Sequence[tuple[int, float]] = (),
) -> Polyhedron:
    """The polyhedron of planar faces given by their loops; unused vertices are dropped, the others keep their order.

    >>> tip = from_faces([[0.0, 0.0, 0.005]], [], balls=[(0, 0.005)])
    >>> len(tip.faces), tip.radii.tolist()
    (0, [0.005])

    Args:
        vertices: (n, 3), m.
        faces: for each face its loops, outer loop first, seen from outside counter-clockwise, holes clockwise.
        planes: (normal, offset) of each face where it is known; else it is computed from the loops.
        balls: (vertex, radius) of balls beside it, m; there need be no faces then.

    Raises:
        GeometryError: an edge without exactly two faces in opposite directions, or a volume that is not positive.
    """
    # + 0.0 turns −0 into 0, so that equal coordinates are equal in their bytes, by which parts look them up.
    points = np.asarray(vertices, dtype=np.float64) + 0.0
    used = sorted({index for loops in faces for loop in loops for index in loop}.union(n for n, _ in balls))
    number = {old: new for new, old in enumerate(used)}
    points = points[used]
    renumbered = [tuple(tuple(number[index] for index in loop) for loop in loops) for loops in faces]
    known = planes if planes is not None else [None] * len(renumbered)
    made = tuple(
        Face(loops, *(plane or plane_of(points, loops))) for loops, plane in zip(renumbered, known, strict=True)
    )
    rounds = tuple(sorted((number[vertex], radius) for vertex, radius in balls))
    if rounds and not faces:
        return Polyhedron(points, (), (), rounds)
    edges = _edges(points, made)
    volume = _volume(points, renumbered)
    if not volume > 0.0:
        raise GeometryError(f"the volume is {volume:.3g} m³, not positive", "turn the faces round or give it thickness")
    return Polyhedron(points, made, edges, rounds)


def extruded(loops: Sequence[ArrayLike], low: float, high: float, axis: int = 2) -> Polyhedron:
    """The prism over an outline, then its holes, between two heights along an axis, m.

    Loops are corners (n, 2) along the axes that follow, m, the outline counter-clockwise, holes clockwise.
    """
    outlines = [np.asarray(loop) for loop in loops]
    rings = [tuple(range(a, b)) for a, b in pairwise(np.cumsum([0, *map(len, outlines)]).tolist())]
    flat, count = np.vstack(outlines), sum(map(len, outlines))
    points = np.vstack([np.column_stack([flat, np.full(count, height)]) for height in (low, high)])
    walls = [(a, b, b + count, a + count) for ring in rings for a, b in zip(ring, ring[1:] + ring[:1], strict=True)]
    floor, roof = [ring[::-1] for ring in rings], [tuple(index + count for index in ring) for ring in rings]
    return from_faces(np.roll(points, axis + 1, axis=1), [floor, roof, *([wall] for wall in walls)])


def from_triangles(vertices: ArrayLike, triangles: ArrayLike, tol: float = 1e-9) -> Polyhedron:
    """The polyhedron of a closed triangle mesh: coplanar triangles merged, straight-through vertices dropped.

    Triangles (m, 3) over vertices (n, 3), m, which are kept to the bit, are counter-clockwise seen from outside; those
    within `tol`, m, of a face's plane belong to it.

    Raises:
        GeometryError: open, disagreeing or inside-out triangles, no volume; names the triangle, the edge, the place.
    """
    points = np.asarray(vertices, dtype=np.float64)
    corners = np.asarray(triangles, dtype=np.int64)
    if not len(corners):
        raise GeometryError("the solid is empty: no triangles", "check that the operands overlap as meant")
    volume = _volume(points, corners[:, None, :].tolist())
    if volume < 0.0:
        raise GeometryError(
            f"the surface is inside out: triangle 0 at {place(points[corners[0, 0]])} faces inward, volume "
            f"{volume:.3g} m³",
            "reverse the corners of every triangle",
        )
    parts = patchwork(points, corners, tol, np.arange(len(corners)))
    return from_faces(points, faces_of(parts, parts.region)[0])


def triangulated(body: Polyhedron) -> NDArray[np.int64]:
    """Outward triangles (m, 3) over the polyhedron's vertices."""
    from manifold3d import triangulate

    triangles = []
    for face in body.faces:
        flat = body.vertices @ plane_basis(face.normal)
        order = np.array([index for loop in face.loops for index in loop])
        triangles.append(order[np.asarray(triangulate([flat[list(loop)] for loop in face.loops]))])
    return np.vstack(triangles)


def plane_of(points: Array, loops: Sequence[Sequence[int]]) -> tuple[Array, float]:
    """Unit normal (3,) and offset (m) of the plane through loops of points (n, 3), exact when all share a coordinate.

    Raises:
        GeometryError: the loops have no area.
    """
    corners = points[[index for loop in loops for index in loop]]
    centre = corners.mean(axis=0)
    area = np.zeros(3)
    for loop in loops:
        arms = points[[*loop, loop[0]]] - centre
        area += np.sum(cross(arms[:-1], arms[1:]), axis=0)
    if (flat := np.all(corners == corners[0], axis=0)).any():
        axis = int(np.argmax(flat))
        normal = np.zeros(3)
        normal[axis] = 1.0 if area[axis] > 0.0 else -1.0
        return normal, float(normal[axis] * corners[0, axis] + 0.0)
    size = float(np.linalg.norm(area))
    if size == 0.0:
        raise GeometryError(f"a face near {place(centre)} has no area", "drop it or merge its vertices")
    normal = area / size
    normal[np.abs(normal) < 1e-15] = 0.0
    return normal, float(np.mean(corners @ normal))


def plane_basis(normal: Array) -> Array:
    """Two unit columns (3, 2) that span the plane across `normal`, right-handed with it."""
    # The axis that is least along the normal, so that the product is far from 0.
    u = cross(normal, np.eye(3)[int(np.argmin(np.abs(normal)))])
    u /= np.linalg.norm(u)
    return np.column_stack([u, cross(normal, u)])


def placed(polyhedron: Polyhedron, pose: Pose) -> Polyhedron:
    """The polyhedron moved by a pose; planes of faces that stay axis-parallel are exact."""
    return with_vertices(polyhedron, pose.apply(polyhedron.vertices) + 0.0)


def scaled(polyhedron: Polyhedron, factors: Sequence[float]) -> Polyhedron:
    """The polyhedron stretched along the axes by positive factors (3,); balls stay balls, by the least of these."""
    found = with_vertices(polyhedron, polyhedron.vertices * np.asarray(factors))
    if not polyhedron.balls:
        return found
    return replace(found, balls=tuple((vertex, min(factors) * radius) for vertex, radius in polyhedron.balls))


def levelled(bodies: Sequence[Polyhedron]) -> tuple[Polyhedron, ...]:
    """Polyhedra with coordinates that differ by rounding alone made equal, so that faces across an axis are exactly so.

    Values along an axis of which each is within 1e-12 m of the next become the least of them.
    """
    points = level(np.vstack([body.vertices for body in bodies]))
    ends = np.cumsum([len(body.vertices) for body in bodies])[:-1]
    return tuple(with_vertices(body, own) for body, own in zip(bodies, np.split(points, ends), strict=True))


def level(points: Array) -> Array:
    """Points (n, 3), m, with coordinates that differ by rounding alone made equal."""
    found = points.copy()
    for column in found.T:
        order = np.argsort(column, kind="stable")
        first = np.concatenate([[True], np.diff(column[order]) > _LEVEL])
        column[order] = column[order][np.maximum.accumulate(np.where(first, np.arange(len(column)), 0))]
    return found


def rounded(polyhedron: Polyhedron) -> Polyhedron:
    """The polyhedron with coordinates rounded to 1 fm, which frames and units differ by once they are turned about."""
    return with_vertices(polyhedron, polyhedron.vertices.round(_DECIMALS) + 0.0)


def with_vertices(polyhedron: Polyhedron, points: Array) -> Polyhedron:
    """The polyhedron with its vertices at other points (n, 3), m, as good as in the same planes."""
    planes = [plane_of(points, face.loops) for face in polyhedron.faces]
    faces = tuple(Face(face.loops, *plane) for face, plane in zip(polyhedron.faces, planes, strict=True))
    return Polyhedron(points, faces, polyhedron.edges, polyhedron.balls)


def convex_hull_polyhedron(points: ArrayLike) -> Polyhedron:
    """The convex hull of points (n, 3), m, with merged faces; its vertices are input points to the bit, in their order.

    Raises:
        GeometryError: the points lie in a plane, or as good as in one.
    """
    from manifold3d import Manifold
    from scipy.spatial import ConvexHull, QhullError

    cloud = np.asarray(points, dtype=np.float64)
    try:
        # Qhull's own rounding grows with the largest coordinate: it gets the points about 0.
        hull = ConvexHull((cloud - cloud.mean(axis=0)) / np.max(np.abs(cloud - cloud.mean(axis=0))))
    except (QhullError, ValueError, ZeroDivisionError) as error:
        raise GeometryError(f"{len(cloud)} points span no volume", "give four or more that are not flat") from error
    reach = _ON_FACE * diameter(cloud)
    loops: dict[frozenset[int], Loop] = {}
    # Only directions are Qhull's: which points are on a face is settled by their own coordinates.
    for normal in np.unique(hull.equations[:, :3], axis=0):
        height = cloud @ normal
        loop = _convex_loop(cloud, np.flatnonzero(height >= height.max() - reach), normal, reach)
        if len(loop) >= 3:
            loops[frozenset(loop)] = loop
    # Directions that differ by rounding find one face twice, once without some of its corners.
    beside = dict[int, list[frozenset[int]]]()
    for key in loops:
        for index in key:
            beside.setdefault(index, []).append(key)
    kept = [key for key in loops if not any(key < other for other in beside[min(key)])]
    ordered = sorted((loops[key] for key in kept), key=lambda loop: tuple(sorted(loop)))
    if len(ordered) < 4:
        raise GeometryError(
            f"{len(cloud)} points span next to no volume", "make no solid thinner than 1e-9 of its size"
        )
    try:
        return from_faces(cloud, [(loop,) for loop in ordered])
    except GeometryError:  # of points that are as good as on other faces
        return of_manifold(Manifold.hull_points(cloud), reach)


def halfspace_corners(normals: Array, offsets: Array, inside: Array, size: float) -> Array:
    """The corners (n, 3) of what planes (k, 3), (k,), m, around a point (3,) inside bound, m; of about this size, m."""
    from scipy.spatial import HalfspaceIntersection

    # Qhull wants a point inside, and rounds by the size of numbers: it gets the planes seen from there, in sizes.
    rows = np.column_stack([normals, (normals @ inside - offsets) / size])
    return np.asarray(inside + size * HalfspaceIntersection(rows, np.zeros(3)).intersections)


def manifold_of(points: Array, triangles: NDArray[np.int64]) -> Manifold:
    """The manifold3d solid of triangles (m, 3) over points (n, 3)."""
    from manifold3d import Manifold, Mesh64

    # It takes arrays that are contiguous and may be written.
    return Manifold(Mesh64(np.array(points, order="C"), np.array(triangles, dtype=np.uint64, order="C")))


def of_manifold(shape: Manifold, tol: float) -> Polyhedron:
    """The polyhedron of a manifold3d solid; errors and `tol` as of `from_triangles`."""
    return from_triangles(*mesh_of(shape), tol)


def mesh_of(shape: Manifold) -> tuple[Array, NDArray[np.int64]]:
    """Points (n, 3) and outward triangles (m, 3) of a manifold3d solid."""
    mesh = shape.to_mesh64()
    return np.array(mesh.vert_properties)[:, :3], np.array(mesh.tri_verts, dtype=np.int64)


def _volume(points: Array, faces: Iterable[Sequence[Sequence[int]]]) -> float:
    fans = [(loop[0], a, b) for loops in faces for loop in loops for a, b in pairwise(loop[1:])]
    a, b, c = (points - points.mean(axis=0))[np.array(fans).T]
    return float(np.sum(_triple(a, b, c))) / 6.0


def _triple(a: Array, b: Array, c: Array) -> Array:
    """a·(b × c) row by row, shape (n,)."""
    x, y, z = (a * cross(b, c)).T
    return np.asarray(x + y + z)


def _convex_loop(cloud: Array, on: np.ndarray, normal: Array, reach: float) -> Loop:
    """Corners of the convex hull of the coplanar points `on`, counter-clockwise about `normal` (monotone chain)."""
    flat = cloud[on] @ plane_basis(normal)
    column = np.round((flat[:, 0] - flat[:, 0].min()) / reach) if reach > 0.0 else flat[:, 0]
    order = np.lexsort((flat[:, 1], column)).tolist()  # rounding puts points over each other side by side
    corners = flat.tolist()

    def half(indices: Iterable[int]) -> list[int]:
        chain: list[int] = []
        for i in indices:
            while len(chain) > 1:
                (x, y), (u, v), (p, q) = corners[chain[-2]], corners[chain[-1]], corners[i]
                if (u - x) * (q - y) - (v - y) * (p - x) > reach * math.hypot(p - x, q - y):
                    break
                chain.pop()
            chain.append(i)
        return chain[:-1]

    return tuple(int(on[i]) for i in half(order) + half(reversed(order)))


def _edges(points: Array, faces: Sequence[Face]) -> tuple[Edge, ...]:
    owner: dict[tuple[int, int], int] = {}
    for number, face in enumerate(faces):
        for loop in face.loops:
            for a, b in zip(loop, loop[1:] + loop[:1], strict=True):
                if (a, b) in owner:
                    raise _edge_error(points, a, b, f"runs the same way in faces {owner[a, b]} and {number}")
                owner[a, b] = number
    for a, b in owner:
        if (b, a) not in owner:
            raise _edge_error(points, a, b, f"has face {owner[a, b]} only")
    spans = sorted((a, b) for a, b in owner if a < b)
    sides = [(owner[a, b], owner[b, a]) for a, b in spans]
    normals = np.array([face.normal for face in faces])
    start, end = points[np.array(spans).T]
    one, other = normals[np.array(sides).T]
    # Convex where the normals turn counter-clockwise about the edge, which runs as in the first face.
    convex = _triple(end - start, one, other) > 0.0
    return tuple(Edge(span, pair, bool(flag)) for span, pair, flag in zip(spans, sides, convex, strict=True))


def _edge_error(points: Array, a: int, b: int, fault: str) -> GeometryError:
    return GeometryError(f"edge {span(points, (a, b))} {fault}", "close the surface and orient all faces outward")
