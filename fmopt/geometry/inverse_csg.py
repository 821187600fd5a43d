"""From a polyhedron back to a CSG tree: its convex hull minus convex bodies that make up what the hull has too much.

The excess is cut through its reflex edges, one plane at a time, the plane that settles most of them first. Tools may
be many and small, the pieces that they leave are as large as those of a model written by hand. It gives imported
meshes the exact half-space pieces of a CSG solid.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations, product

import numpy as np
from manifold3d import Manifold

from fmopt.errors import GeometryError
from fmopt.geometry.convex_pieces import bounded, clip, convex_manifold, snapped
from fmopt.geometry.csg import Difference, Hull, Moved, Solid, exact_pose
from fmopt.geometry.facets import fan, merged_vertices
from fmopt.geometry.polyhedron import (
    Face,
    Polyhedron,
    convex_hull_polyhedron,
    from_faces,
    from_triangles,
    halfspace_corners,
    level,
    manifold_of,
    mesh_of,
    placed,
    plane_basis,
    triangulated,
)
from fmopt.geometry.upright_prisms import upright_prisms
from fmopt.spatial.se3 import Pose
from fmopt.spatial.values import Array

Plane = tuple[Array, float]

MESH_NOISE = 1e-6  # of the diameter: what is cleaned away from imported meshes
_CUTS = 64  # one after the other; a mesh that needs more is no machined part
_MOST_FACES = 800  # of a body that is no stack of prisms: one that has more stands for curved surfaces
_FEW = 16  # faces of a tool
_PUSHED = 0.05  # of the diameter: how far tools stand out of the hull
_LEVEL = 1e-6  # of three normals: less is as good as a plane
_NEAR = 1e-6  # of the size: no step worth taking
_OVERLAP = 1e-9  # of the volume: what two bodies have in common by rounding
_PAIRS = 128  # reflex edges up to which planes through any two are tried; above, through neighbours only


def apart(body: Polyhedron, tol: float) -> tuple[Solid, Polyhedron]:
    """A CSG solid equal to a polyhedron but for noise; and the polyhedron without it, in the coordinates of the solid.

    Face planes within `tol` (m, the size of the noise) of each other or of an axis direction become one, vertices move
    onto their planes, and excess thinner than `tol` is dropped.

    Raises:
        GeometryError: the excess does not come apart into convex bodies.
    """
    turn, loops = _squared(body, 4.0 * tol / body.diameter), [face.loops for face in body.faces]
    try:
        if np.array_equal(turn, np.eye(3)):
            solid, ideal = _upright(body, tol)
            return solid, bounded(solid, from_faces(ideal, loops))
        back = Pose(np.zeros(3), turn)
        solid, ideal = _upright(placed(body, Pose(np.zeros(3), turn.T)), tol)
        whole = Moved(solid, back)
        return whole, bounded(whole, placed(from_faces(ideal, loops), exact_pose(back)))
    except GeometryError as error:  # of what was cut off, which nobody who reads this has made
        raise GeometryError("it does not come apart into convex bodies") from error


def _squared(body: Polyhedron, slack: float) -> Array:
    """A rotation (3, 3) whose columns are normals of large faces, where coordinates of corners coincide to the bit."""
    areas = [np.linalg.norm(sum(fan(body.vertices, loop).sum(axis=0) for loop in face.loops)) for face in body.faces]
    order = [body.normals[i] for i in np.argsort(np.negative(areas), kind="stable")]
    z = order[0]
    x = next((normal for normal in order if abs(normal @ z) <= slack), None)
    across = [z] if x is None else [z, x]
    # Turned there and back coordinates would lose their last digits, for nothing.
    if all(np.abs(normal).max() >= 1.0 - slack for normal in across):
        return np.eye(3)
    x = plane_basis(z)[:, 0] if x is None else x - (x @ z) * z
    x = x / np.linalg.norm(x)
    return np.column_stack([x, np.cross(z, x), z])


def _upright(body: Polyhedron, tol: float) -> tuple[Solid, Array]:
    """The solid, and the vertices (n, 3) of the body as cleaned."""
    ideal = _idealised(body, tol)
    shape = manifold_of(ideal, triangulated(body))
    upright = upright_prisms(from_faces(ideal, [face.loops for face in body.faces]), tol)
    if upright is None:
        if len(body.faces) > _MOST_FACES:
            raise GeometryError(f"{len(body.faces)} faces are too many")
        outer = convex_hull_polyhedron(ideal)
        whole = [one for one in (shape.hull() - shape).decompose() if _is_thick(one, tol)]
        excess = [_convex_parts(one, ideal, tol, _CUTS) for one in whole]
        # Where two parts share the whole of a face, rounding would leave a skin: each is as large as it may be.
        parts = [_grown(p, shape, ideal, p.faces) if len(some) > 1 else p for some in excess for p in some]
    else:
        outer = upright.base
        parts = [_grown(one, shape, ideal, one.faces[:2]) for one in upright.tools]
    # Tools of few faces make few pieces, and small ones leave most of these whole.
    parts.sort(key=lambda part: (len(part.faces) > _FEW, -part.volume))
    tools = tuple(_opened(part, outer, tol) for part in parts)
    base = _hull(outer.vertices)
    return (Difference(base, tools) if tools else base), ideal


def _grown(part: Polyhedron, shape: Manifold, known: Array, faces: Sequence[Face]) -> Polyhedron:
    """The part, faces of it pushed out one after the other to where the farthest of known points (n, 3) allows it."""
    size = float(np.linalg.norm(np.ptp(known, axis=0)))
    for normal, offset in [(face.normal, face.offset) for face in faces]:
        heights = np.unique(level((known @ normal)[known @ normal > offset + _NEAR * size, None]))
        if not len(heights) or not _is_free(_corners(part, normal, offset, float(heights[0])), shape, part):
            continue
        farthest = _pushed(part, normal, offset, float(heights[-1]))
        if farthest is None:
            continue
        # What keeps clear at one height does so at all below, so that halving finds the highest.
        low, high = 0, len(heights)
        while low < high:
            middle = (low + high) // 2
            pushed = clip(farthest, normal, float(heights[middle]))
            free = pushed is None or _is_free(pushed.vertices, shape, part)
            low, high = (middle + 1, high) if free else (low, middle)
        if low:
            part = _pushed(part, normal, offset, float(heights[low - 1])) or part
    return part


def _is_free(corners: Array, shape: Manifold, part: Polyhedron) -> bool:
    """Whether the hull of corners (n, 3) has next to nothing of a shape, for the size of the part that it grew from."""
    return bool((Manifold.hull_points(corners) ^ shape).volume() <= _OVERLAP * part.volume)


def _corners(part: Polyhedron, normal: Array, offset: float, height: float) -> Array:
    """Corners (n, 3), but for rounding, of the part with the face in a plane pushed out to a height; see `_pushed`."""
    own = (part.normals @ normal > 1.0 - 1e-9) & (np.abs(part.offsets - offset) < 1e-9)
    offsets = np.where(own, height, part.offsets)
    return halfspace_corners(part.normals, offsets, part.vertices.mean(axis=0), part.diameter)


def _pushed(part: Polyhedron, normal: Array, offset: float, height: float) -> Polyhedron | None:
    """The part with the face in a plane pushed out to a height along its normal (m), as far as the others let it."""
    faces = [
        face for face in part.faces if not (face.normal @ normal > 1.0 - 1e-9 and abs(face.offset - offset) < 1e-9)
    ]
    body: Polyhedron | None = _room(part, 2.0 * (part.diameter + height - offset))
    for plane in [*((face.normal, face.offset) for face in faces), (normal, height)]:
        body = clip(body, *plane) if body is not None else None
    return body


def _room(body: Polyhedron, reach: float) -> Polyhedron:
    """A cube around the middle of a body."""
    return convex_hull_polyhedron(body.vertices.mean(axis=0) + reach * np.array(list(product((-1.0, 1.0), repeat=3))))


def _convex_parts(shape: Manifold, known: Array, tol: float, patience: int) -> list[Polyhedron]:
    vertices, corners = mesh_of(shape)
    points, triangles, _ = merged_vertices(_onto(snapped(vertices, known), known, tol), corners, tol)
    body = from_triangles(points, triangles, tol)
    plane = _best_cut(body, tol)
    if plane is None:
        return [convex_hull_polyhedron(body.vertices[_solid_corners(body)])]
    if patience == 0:
        raise GeometryError(f"more than {_CUTS} cuts are needed")
    parts = [part for half in _halves(shape, body, plane) for part in half.decompose() if _is_thick(part, tol)]
    return [tool for part in parts for tool in _convex_parts(part, known, tol, patience - 1)]


def _solid_corners(body: Polyhedron) -> list[int]:
    """The vertices at which faces meet whose normals span space: none of a skin that rounding left on a face."""
    return [
        vertex
        for vertex, faces in enumerate(body.vertex_faces)
        if np.linalg.svd(body.normals[list(faces)], compute_uv=False)[-1] > _LEVEL and len(faces) >= 3
    ]


def _opened(tool: Polyhedron, outer: Polyhedron, tol: float) -> Hull:
    """The tool, its faces in those of the hull pushed out of the hull, so that cutting leaves no skin there.

    Only what lies beyond a plane of the hull is added, where there is nothing to cut.
    """
    alike = tool.normals @ outer.normals.T > 1.0 - 1e-9
    at_hull = np.any(alike & (np.abs(tool.offsets[:, None] - outer.offsets) <= 4.0 * tol), axis=1)
    offsets = tool.offsets + np.where(at_hull, _PUSHED * outer.diameter, 0.0)
    corners = halfspace_corners(tool.normals, offsets, tool.vertices.mean(axis=0), outer.diameter)
    for normal, offset in zip(tool.normals[~at_hull], offsets[~at_hull], strict=True):
        for axis in np.flatnonzero(np.abs(normal) == 1.0):
            near = np.abs(corners[:, axis] - normal[axis] * offset) <= tol
            corners[near, axis] = normal[axis] * offset
    return _hull(_onto(corners, tool.vertices, tol))


def _halves(shape: Manifold, body: Polyhedron, plane: Plane) -> list[Manifold]:
    """The shape on both sides of a plane, by subtraction: that leaves no skin where a face lies in the plane."""
    room = _room(body, 2.0 * body.diameter)
    sides = (clip(room, *plane), clip(room, -plane[0], -plane[1]))
    return [shape - convex_manifold(side) for side in sides if side is not None]


def _best_cut(body: Polyhedron, tol: float) -> Plane | None:
    """The plane that holds most reflex edges, which it leaves convex on both sides; None when there are none.

    Candidates are the planes of the faces at reflex edges and the planes through two of the edges.
    """
    reflex = []
    for edge in body.edges:
        one, other = (body.faces[number] for number in edge.faces)
        # A face that rises less than `tol` above the plane of the other is level with it but for noise.
        beyond = body.vertices[list(other.vertices)] @ one.normal - one.offset
        if not edge.convex and beyond.max() > tol:
            reflex.append((edge.vertices, one.normal, other.normal))
    spans = [body.vertices[list(ends)] for ends, *_ in reflex]
    planes = [
        (normal, float(normal @ span[0]))
        for span, (_, *normals) in zip(spans, reflex, strict=True)
        for normal in normals
    ]
    for i, j in combinations(range(len(reflex)), 2):
        near = len(reflex) <= _PAIRS or set(reflex[i][0]) & set(reflex[j][0])
        if near and (plane := _through(spans[i], spans[j], tol)):
            planes.append(plane)
    if not planes:
        return None
    normals, offsets = np.array([normal for normal, _ in planes]), np.array([offset for _, offset in planes])
    held = np.all(np.abs(np.array(spans) @ normals.T - offsets) <= tol, axis=1)
    return planes[int(np.argmax(held.sum(axis=0)))]


def _through(a: Array, b: Array, tol: float) -> Plane | None:
    """The plane through two segments (2, 3), if there is one."""
    corners = np.vstack([a, b])
    centre = corners.mean(axis=0)
    normal = np.linalg.svd(corners - centre)[2][2]
    normal = np.where(np.abs(normal) < 1e-12, 0.0, normal)
    flat = np.all(np.abs((corners - centre) @ normal) <= tol)
    # Across an axis the coordinate of a corner to the bit, not a mean.
    offset = float(normal @ (corners[0] if np.abs(normal).max() == 1.0 else centre))
    return (normal, offset) if flat else None


def _hull(points: Array) -> Hull:
    return Hull(convex_hull_polyhedron(points).vertices.tolist())


def _is_thick(body: Manifold, tol: float) -> bool:
    return 2.0 * float(body.volume()) > tol * float(body.surface_area())


def _onto(points: Array, known: Array, tol: float) -> Array:
    """Points that lie within `tol` of a known one become that one."""
    from scipy.spatial import cKDTree

    distance, index = cKDTree(known).query(points)
    return np.where(np.asarray(distance)[:, None] <= tol, known[index], points)


def _idealised(body: Polyhedron, tol: float) -> Array:
    """The vertices (n, 3) moved onto the cleaned planes of their faces, by the smallest shift that does it."""
    planes = _Planes(np.zeros((len(body.faces), 3)), np.zeros(len(body.faces)))
    slack = 4.0 * tol / body.diameter
    chosen = [planes.cleaned(face, body.vertices[list(face.vertices)], tol, slack) for face in body.faces]
    points = np.array(body.vertices)
    for vertex, faces in enumerate(body.vertex_faces):
        own = sorted({chosen[number] for number in faces})
        normals, offsets = planes.normals[own], planes.offsets[own]
        # By `rcond` planes that are nearly one count once: a corner would run off along the line in which they meet.
        shift = np.linalg.pinv(normals, rcond=1e-3) @ (offsets - normals @ points[vertex])
        if np.linalg.norm(shift) <= 100.0 * tol:
            points[vertex] += shift
        for normal, offset in zip(normals, offsets, strict=True):
            for axis in np.flatnonzero(np.abs(normal) == 1.0):
                points[vertex, axis] = normal[axis] * offset
    return level(points)


@dataclass
class _Planes:
    """Planes that are told apart, with room for more: normals (n, 3) and offsets (n,), m; opposite ones are one."""

    normals: Array
    offsets: Array
    count: int = 0

    def cleaned(self, face: Face, corners: Array, tol: float, slack: float) -> int:
        """Index of the cleaned plane of a face with corners (k, 3), a new one where there is none yet."""
        for index in np.flatnonzero(np.abs(self.normals[: self.count] @ face.normal) > 1.0 - 1e-6):
            if np.all(np.abs(corners @ self.normals[index] - self.offsets[index]) <= tol):
                return int(index)
        normal = np.where(np.abs(face.normal) <= slack, 0.0, face.normal)
        normal = normal / np.linalg.norm(normal)
        self.normals[self.count], self.offsets[self.count] = normal, np.median(corners @ normal)
        self.count += 1
        return self.count - 1
