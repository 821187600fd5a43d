"""Primitive contacts: a vertex on a face, a face on a vertex, or two crossing edges, found near a pose.

[DakinPopplestone1993] section 2.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from functools import lru_cache
from typing import assert_never

import numpy as np
from numpy.typing import NDArray

from fmopt.geometry.polyhedron import Face, Polyhedron
from fmopt.se3 import Pose, cross
from fmopt.values import Array

PARALLEL = math.radians(1.0)  # rad; edges closer than this in direction have no edge–edge contact
_MEMORY = 256
_PARALLEL = 1e-12  # squared sine below which two normals span no arc


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
    return _crossing(moving, fixed, R, [(one, other)])[0]


def _crossing(
    moving: Polyhedron, fixed: Polyhedron, R: Array, pairs: Sequence[tuple[int, int]]
) -> list[PrimitiveContact]:
    """The contacts of moving edges across fixed ones; see `edge_edge`."""
    if not pairs:
        return []
    own, other = _features(moving), _features(fixed)
    ones, others = np.array(pairs).T
    m = cross(own.directions[ones] @ R.T, other.directions[others])
    outward = other.between[others] - own.between[ones] @ R.T
    found = []
    for (i, j), along in zip(pairs, np.vecdot(m, outward) > 0.0, strict=True):
        e, g = moving.edges[i], fixed.edges[j]
        ends = e.vertices if along else e.vertices[::-1]
        found.append(PrimitiveContact(f"e{i}-e{j}", Kind.EDGE_EDGE, ends, g.vertices, i, j))
    return found


@dataclass(frozen=True, eq=False)
class _Features:
    """Vertices and edges of a polyhedron as arrays.

    Args:
        vertices: which vertices have convex edges only.
        edges: which edges are convex.
        ends: vertices (e, 2) of all edges.
        directions: unit vectors (e, 3) along them.
        sides: their faces (e, 2).
        between: sums (e, 3) of the normals of these.
        around: edges (n, k) at each of `vertices`, the number of edges where there are fewer.
        away: unit vectors (n, k, 3) along these, away from the vertex; zero where there are fewer.
    """

    vertices: NDArray[np.intp]
    edges: NDArray[np.intp]
    ends: NDArray[np.intp]
    directions: Array
    sides: NDArray[np.intp]
    between: Array
    around: NDArray[np.intp]
    away: Array


@lru_cache(maxsize=_MEMORY)
def _features(polyhedron: Polyhedron) -> _Features:
    ends = np.array([edge.vertices for edge in polyhedron.edges], dtype=np.intp)
    sides = np.array([edge.faces for edge in polyhedron.edges], dtype=np.intp)
    convex = np.array([edge.convex for edge in polyhedron.edges], dtype=bool)
    span = polyhedron.vertices[ends[:, 1]] - polyhedron.vertices[ends[:, 0]]
    directions = span / np.sqrt(np.vecdot(span, span))[:, None]
    pointed = np.ones(len(polyhedron.vertices), dtype=bool)
    pointed[ends[~convex]] = False
    vertices = np.flatnonzero(pointed)
    vertices.setflags(write=False)
    at = [np.flatnonzero((ends == v).any(axis=1)) for v in vertices]
    around = np.full((len(at), max((len(edges) for edges in at), default=0)), len(ends), dtype=np.intp)
    away = np.zeros((*around.shape, 3))
    for n, (v, edges) in enumerate(zip(vertices, at, strict=True)):
        around[n, : len(edges)] = edges
        away[n, : len(edges)] = np.where(ends[edges, :1] == v, directions[edges], -directions[edges])
    between = polyhedron.normals[sides].sum(axis=1)
    return _Features(vertices, np.flatnonzero(convex), ends, directions, sides, between, around, away)


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
        *_crossing(moving, fixed, pose.R, _edges_at_edges(moving, fixed, pose, reach, angle)),
    ]
    return tuple(found)


def convex_vertices(polyhedron: Polyhedron) -> NDArray[np.intp]:
    """Indices (n,) of the vertices all of whose edges are convex."""
    return _features(polyhedron).vertices


def _vertices_at_faces(
    pointed: Polyhedron, faced: Polyhedron, T: Pose, reach: float, angle: float, lever: bool
) -> list[tuple[int, int]]:
    """Pairs (vertex, face) that can meet; T carries the part with the vertices into the frame of the faces.

    Levers turn about the origin of the vertices' part when `lever`, else about that of the faces' part.
    """
    features = _features(pointed)
    points = T.apply(pointed.vertices[features.vertices])
    arms = pointed.vertices[features.vertices] if lever else points
    limit = reach + angle * np.sqrt(np.vecdot(arms, arms))
    height = points @ faced.normals.T - faced.offsets
    which, face = np.nonzero(np.abs(height) <= limit[:, None])
    normals = np.vstack([pointed.normals @ T.R.T, np.zeros((1, 3))])
    arcs = normals[np.vstack([features.sides, [[-1, -1]]])[features.around[which]]]
    inward = -faced.normals[face]
    # The cone of a vertex' normals: what no edge leaves the vertex along; its boundary are arcs across the edges.
    within = (np.vecdot((features.away @ T.R.T)[which], inward[:, None]) <= 0.0).all(axis=1)
    aside = np.where(within, 0.0, _arc_distances(inward[:, None], arcs).min(axis=1, initial=1.0))
    turned = np.arcsin(np.minimum(aside, 1.0)) <= angle
    near = np.zeros(len(which), dtype=bool)
    for f in dict.fromkeys(face[turned].tolist()):
        asked = np.flatnonzero(turned & (face == f))
        near[asked] = _distances_to_face(points[which[asked]], faced.faces[f], faced.vertices) <= limit[which[asked]]
    return [(int(features.vertices[v]), int(f)) for v, f in zip(which[near], face[near], strict=True)]


def _edges_at_edges(
    moving: Polyhedron, fixed: Polyhedron, pose: Pose, reach: float, angle: float
) -> list[tuple[int, int]]:
    """Pairs of edges that can meet."""
    own, other = _features(moving), _features(fixed)
    P = pose.apply(moving.vertices[own.ends[own.edges]])
    Q = fixed.vertices[other.ends[other.edges]]
    ends = moving.vertices[own.ends[own.edges]]
    limit = reach + angle * np.sqrt(np.vecdot(ends, ends)).max(axis=1, initial=0.0)
    m = cross((own.directions[own.edges] @ pose.R.T)[:, None], other.directions[other.edges][None])
    crossing = np.sqrt(np.vecdot(m, m)) >= math.sin(PARALLEL)
    a, b = np.nonzero((_segment_distances(P, Q) <= limit[:, None]) & crossing)
    ones, others = own.edges[a], other.edges[b]
    normals = -moving.normals @ pose.R.T
    turned = _arc_angles(normals[own.sides[ones]], fixed.normals[other.sides[others]]) <= angle
    return list(zip(ones[turned].tolist(), others[turned].tolist(), strict=True))


def _arc_distances(x: Array, arcs: Array) -> Array:
    """Distances (…) of unit vectors x (…, 3) from the cones of pairs of unit generators (…, 2, 3), 1 at most."""
    a, b = arcs[..., 0, :], arcs[..., 1, :]
    xa, xb, ab = np.vecdot(x, a), np.vecdot(x, b), np.vecdot(a, b)
    rest = np.maximum(1.0 - ab**2, _PARALLEL)
    s, t = (xa - ab * xb) / rest, (xb - ab * xa) / rest
    between = (s >= 0.0) & (t >= 0.0) & (rest > _PARALLEL)
    found = np.where(between, _size(x - s[..., None] * a - t[..., None] * b), 1.0)
    for along, end in ((xa, a), (xb, b)):
        found = np.minimum(found, np.where(along > 0.0, _size(x - along[..., None] * end), 1.0))
    return np.asarray(found)


def _arc_angles(one: Array, other: Array) -> Array:
    """Least angles (n,), rad, between great-circle arcs given by their unit end points (n, 2, 3); π/2 when more."""
    meet = cross(cross(one[:, 0], one[:, 1]), cross(other[:, 0], other[:, 1]))
    size = _size(meet)
    m = meet / np.where(size > 0.0, size, 1.0)[:, None]
    apart = [np.maximum(_arc_distances(end, one), _arc_distances(end, other)) for end in (m, -m)]
    crossing = (np.minimum(*apart) < 1e-12) & (size > 0.0)
    ends = [_arc_distances(one[:, k], other) for k in (0, 1)] + [_arc_distances(other[:, k], one) for k in (0, 1)]
    least = np.minimum.reduce(ends)
    return np.asarray(np.where(crossing, 0.0, np.arcsin(np.minimum(least, 1.0))))


def _size(vectors: Array) -> Array:
    return np.asarray(np.sqrt(np.vecdot(vectors, vectors)))


def feature_distance(contact: PrimitiveContact, moving: Polyhedron, fixed: Polyhedron, pose: Pose) -> float:
    """Distance between the two features of a contact at a pose, m: what touches is next to each other, too.

    Bounds do not say that, as there are none where a face or an edge ends at a wall, or at the next one in its plane.
    """
    match contact.kind:
        case Kind.VERTEX_FACE:
            points = pose.apply(moving.vertices[list(contact.moving)])
            return float(_distances_to_face(points, fixed.faces[contact.fixed_feature], fixed.vertices)[0])
        case Kind.FACE_VERTEX:
            points = (fixed.vertices[list(contact.fixed)] - pose.p) @ pose.R
            return float(_distances_to_face(points, moving.faces[contact.moving_feature], moving.vertices)[0])
        case Kind.EDGE_EDGE:
            ends = pose.apply(moving.vertices[list(contact.moving)])
            return float(_segment_distances(ends[None], fixed.vertices[list(contact.fixed)][None])[0, 0])
        case _:
            assert_never(contact.kind)


def _distances_to_face(points: Array, face: Face, vertices: Array) -> Array:
    """Distances (n,) from points (n, 3) to the face as a region of its plane, m."""
    height = points @ face.normal - face.offset
    a = np.concatenate([vertices[list(loop)] for loop in face.loops])
    b = np.concatenate([np.roll(vertices[list(loop)], -1, axis=0) for loop in face.loops])
    feet = (points - height[:, None] * face.normal)[:, None]
    e = b - a
    t = np.clip(np.vecdot(feet - a, e) / np.vecdot(e, e), 0.0, 1.0)
    aside = _size(a + t[..., None] * e - feet).min(axis=1)
    return np.asarray(np.hypot(height, np.where(_wind_round(feet, a, b, face.normal), 0.0, aside)))


def _wind_round(points: Array, a: Array, b: Array, normal: Array) -> NDArray[np.bool_]:
    """Whether loops of segments a → b in the plane with this normal wind round points (n, 1, 3) of it (angle sum)."""
    u, v = a - points, b - points
    return np.asarray(np.arctan2(cross(u, v) @ normal, np.vecdot(u, v)).sum(axis=1) > np.pi)


def _segment_distances(P: Array, Q: Array) -> Array:
    """Distances (a, b) between segments P (a, 2, 3) and Q (b, 2, 3), m."""
    u, w = (P[:, 1] - P[:, 0])[:, None], (Q[:, 1] - Q[:, 0])[None]
    d = P[:, None, 0] - Q[None, :, 0]
    uu, ww, uw, du, dw = (np.vecdot(one, other) for one, other in ((u, u), (w, w), (u, w), (d, u), (d, w)))
    det = uu * ww - uw * uw
    s0 = np.clip(np.where(det > 1e-12 * uu * ww, (uw * dw - ww * du) / np.maximum(det, 1e-300), 0.0), 0.0, 1.0)
    best = np.full(det.shape, np.inf)
    # The least distance is at the clamped stationary point or has one parameter at an end.
    for s in (s0, 0.0, 1.0):
        t = np.clip((uw * s + dw) / ww, 0.0, 1.0)
        s1 = np.clip((uw * t - du) / uu, 0.0, 1.0)
        best = np.minimum(best, _size(d + s1[..., None] * u - t[..., None] * w))
    return best
