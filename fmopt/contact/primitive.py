"""Primitive contacts: a vertex on a face, a face on a vertex, or two crossing edges, found near a pose.

[DakinPopplestone1993] section 2.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from fmopt.geometry.polyhedron import Edge, Face, Polyhedron
from fmopt.se3 import Pose
from fmopt.values import Array

PARALLEL = math.radians(1.0)  # rad; edges closer than this in direction have no edge–edge contact


class Kind(StrEnum):
    """What touches what; the moving part's feature comes first."""

    VERTEX_FACE = "vertex-face"
    FACE_VERTEX = "face-vertex"
    EDGE_EDGE = "edge-edge"


@dataclass(frozen=True)
class PrimitiveContact:
    """A contact in one point between a convex vertex and a face, or between two convex edges.

    `moving` and `fixed` list vertex indices: one for a vertex, two for an edge, the outer loop for a face. Edges run
    so that (R e_moving) × e_fixed points out of the fixed part.
    """

    id: str
    kind: Kind
    moving: tuple[int, ...]
    fixed: tuple[int, ...]
    moving_feature: int
    fixed_feature: int


def vertex_face(fixed: Polyhedron, vertex: int, face: int) -> PrimitiveContact:
    """The contact of a moving vertex on a fixed face."""
    outer = fixed.faces[face].loops[0]
    return PrimitiveContact(f"v{vertex}-f{face}", Kind.VERTEX_FACE, (vertex,), outer, vertex, face)


def face_vertex(moving: Polyhedron, face: int, vertex: int) -> PrimitiveContact:
    """The contact of a moving face on a fixed vertex."""
    outer = moving.faces[face].loops[0]
    return PrimitiveContact(f"f{face}-v{vertex}", Kind.FACE_VERTEX, outer, (vertex,), face, vertex)


def edge_edge(moving: Polyhedron, fixed: Polyhedron, R: Array, one: int, other: int) -> PrimitiveContact:
    """The contact of a moving edge across a fixed edge, the moving edge run so that the normal leaves the fixed part.

    Args:
        moving: the part with edge `one`.
        fixed: the part with edge `other`.
        R: rotation (3, 3) of the moving part at which the edges meet.
        one: index of the moving edge.
        other: index of the fixed edge.
    """
    e, g = moving.edges[one], fixed.edges[other]
    m = np.cross(R @ _direction(moving, e), _direction(fixed, g))
    outward = sum(fixed.faces[f].normal for f in g.faces) - R @ sum(moving.faces[f].normal for f in e.faces)
    ends = e.vertices if m @ outward > 0.0 else e.vertices[::-1]
    return PrimitiveContact(f"e{one}-e{other}", Kind.EDGE_EDGE, ends, g.vertices, one, other)


def near_contacts(
    moving: Polyhedron, fixed: Polyhedron, pose: Pose, reach: float, angle: float
) -> tuple[PrimitiveContact, ...]:
    """All primitive contacts that can occur at poses within `reach` and `angle` of `pose`.

    A contact counts when its features can come together (distance at `pose` at most reach + angle × lever) and when
    the contact normal can lie in the normal cones of both features after a turn by at most `angle`.

    Args:
        moving: the moving part in its body frame, m.
        fixed: the fixed part.
        pose: pose of the moving part.
        reach: largest shift of the body origin, m.
        angle: largest turn about the body origin, rad.
    """
    found = [
        *(vertex_face(fixed, v, f) for v, f in _vertices_at_faces(moving, fixed, pose, reach, angle, lever=True)),
        *(
            face_vertex(moving, f, v)
            for v, f in _vertices_at_faces(fixed, moving, pose.inverse(), reach, angle, lever=False)
        ),
        *(edge_edge(moving, fixed, pose.R, a, b) for a, b in _edges_at_edges(moving, fixed, pose, reach, angle)),
    ]
    return tuple(found)


def convex_vertices(polyhedron: Polyhedron) -> NDArray[np.intp]:
    """Indices of the vertices all of whose edges are convex."""
    convex = np.ones(len(polyhedron.vertices), dtype=bool)
    for edge in polyhedron.edges:
        if not edge.convex:
            convex[list(edge.vertices)] = False
    return np.flatnonzero(convex)


def _vertices_at_faces(
    pointed: Polyhedron, faced: Polyhedron, T: Pose, reach: float, angle: float, lever: bool
) -> Iterator[tuple[int, int]]:
    """Pairs (vertex, face) that can meet; T carries the part with the vertices into the frame of the faces.

    Levers turn about the origin of the vertices' part when `lever`, else about that of the faces' part.
    """
    vertices = convex_vertices(pointed)
    points = T.apply(pointed.vertices)
    arms = np.linalg.norm(pointed.vertices if lever else points, axis=1)
    limit = reach + angle * arms
    height = points @ faced.normals.T - faced.offsets
    cones = pointed.vertex_faces
    normals = pointed.normals @ T.R.T
    for v in vertices:
        for f in np.flatnonzero(np.abs(height[v]) <= limit[v]):
            face = faced.faces[f]
            if _cone_angle(-face.normal, normals[list(cones[v])]) > angle:
                continue
            if _distance_to_face(points[v], face, faced.vertices) <= limit[v]:
                yield int(v), int(f)


def _edges_at_edges(
    moving: Polyhedron, fixed: Polyhedron, pose: Pose, reach: float, angle: float
) -> Iterator[tuple[int, int]]:
    ones = [i for i, e in enumerate(moving.edges) if e.convex]
    others = [i for i, e in enumerate(fixed.edges) if e.convex]
    if not ones or not others:
        return
    P = pose.apply(moving.vertices[[moving.edges[i].vertices for i in ones]])
    Q = fixed.vertices[[fixed.edges[i].vertices for i in others]]
    arms = np.linalg.norm(moving.vertices[[moving.edges[i].vertices for i in ones]], axis=2).max(axis=1)
    distance = _segment_distances(P, Q)
    sine = np.linalg.norm(np.cross(_units(P)[:, None], _units(Q)[None]), axis=2)
    near = (distance <= (reach + angle * arms)[:, None]) & (sine >= math.sin(PARALLEL))
    normals = -moving.normals @ pose.R.T
    for a, b in np.argwhere(near):
        one, other = moving.edges[ones[a]], fixed.edges[others[b]]
        if _arc_angle(normals[list(one.faces)], fixed.normals[list(other.faces)]) <= angle:
            yield ones[a], others[b]


def _cone_angle(x: Array, generators: Array) -> float:
    """Angle (rad) between the unit vector x and the cone of the generators (k, 3); π/2 when that or more."""
    from scipy.optimize import nnls

    _, residual = nnls(generators.T, x)
    return math.asin(min(float(residual), 1.0))


def _arc_angle(one: Array, other: Array) -> float:
    """Least angle (rad) between two great-circle arcs, each given by its unit end points (2, 3)."""
    meet = np.cross(np.cross(*one), np.cross(*other))
    size = float(np.linalg.norm(meet))
    for m in (meet / size, -meet / size) if size > 0.0 else ():
        if max(_cone_angle(m, one), _cone_angle(m, other)) < 1e-12:
            return 0.0
    return min(*(_cone_angle(x, other) for x in one), *(_cone_angle(x, one) for x in other))


def _distance_to_face(point: Array, face: Face, vertices: Array) -> float:
    """Distance (m) from a point to the face as a region of its plane."""
    height = float(face.normal @ point) - face.offset
    a = np.concatenate([vertices[list(loop)] for loop in face.loops])
    b = np.concatenate([np.roll(vertices[list(loop)], -1, axis=0) for loop in face.loops])
    foot = point - height * face.normal
    e = b - a
    t = np.clip(np.sum((foot - a) * e, axis=1) / np.sum(e * e, axis=1), 0.0, 1.0)
    aside = float(np.min(np.linalg.norm(a + t[:, None] * e - foot, axis=1)))
    return math.hypot(height, 0.0 if _winds_round(foot, a, b, face.normal) else aside)


def _winds_round(point: Array, a: Array, b: Array, normal: Array) -> bool:
    """Whether loops of segments a → b in the plane with this normal wind round a point of it (angle sum)."""
    u, v = a - point, b - point
    sine = np.cross(u, v) @ normal
    cosine = np.sum(u * v, axis=1)
    return bool(np.sum(np.arctan2(sine, cosine)) > np.pi)


def _segment_distances(P: Array, Q: Array) -> Array:
    """Distances (a, b) between segments P (a, 2, 3) and Q (b, 2, 3), m."""
    u, w = (P[:, 1] - P[:, 0])[:, None], (Q[:, 1] - Q[:, 0])[None]
    d = P[:, None, 0] - Q[None, :, 0]
    uu, ww, uw = np.sum(u * u, -1), np.sum(w * w, -1), np.sum(u * w, -1)
    du, dw = np.sum(d * u, -1), np.sum(d * w, -1)
    det = uu * ww - uw * uw
    s0 = np.clip(np.where(det > 1e-12 * uu * ww, (uw * dw - ww * du) / np.maximum(det, 1e-300), 0.0), 0.0, 1.0)
    best = np.full(det.shape, np.inf)
    # The least distance is at the clamped stationary point or has one parameter at an end.
    for s in (s0, np.zeros_like(s0), np.ones_like(s0)):
        t = np.clip((uw * s + dw) / ww, 0.0, 1.0)
        s1 = np.clip((uw * t - du) / uu, 0.0, 1.0)
        gap = d + s1[..., None] * u - t[..., None] * w
        best = np.minimum(best, np.linalg.norm(gap, axis=-1))
    return best


def _units(segments: Array) -> Array:
    e = segments[:, 1] - segments[:, 0]
    return np.asarray(e / np.linalg.norm(e, axis=1, keepdims=True))


def _direction(polyhedron: Polyhedron, edge: Edge) -> Array:
    a, b = polyhedron.vertices[list(edge.vertices)]
    return np.asarray((b - a) / np.linalg.norm(b - a))
