"""Primitive contacts: a vertex or a ball on a face, a face on a vertex, or two crossing edges, found near a pose.

[DakinPopplestone1993] section 2.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import assert_never

import numpy as np

from fmopt.contact.detection import (
    EDGE_AT_EDGE,
    FACE_AT_VERTEX,
    VERTEX_AT_FACE,
    Corners,
    PartWalls,
    Ridges,
    Solid,
    distances,
    edges_at_edges,
    vertices_at_faces,
)
from fmopt.geometry.polyhedron import Polyhedron
from fmopt.runtime.clock import heed
from fmopt.spatial.se3 import Pose, cross
from fmopt.spatial.values import Array, Bits, Indices, remembered

PARALLEL = math.radians(1.0)  # rad; edges closer than this in direction have no edge–edge contact
_CONTACTS = 1 << 18


class Kind(StrEnum):
    """What touches what; the moving part's feature comes first."""

    VERTEX_FACE = "vertex-face"
    FACE_VERTEX = "face-vertex"
    EDGE_EDGE = "edge-edge"
    BALL_FACE = "ball-face"


@dataclass(frozen=True)
class PrimitiveContact:
    """A contact in one point between a convex vertex and a face, or between two convex edges.

    `moving` and `fixed` list vertex indices: one for a vertex or a ball, whose centre it is, two for an edge, the outer
    loop for a face. Edges run so that (R e_moving) × e_fixed points out of the fixed part.
    """

    id: str
    kind: Kind
    moving: tuple[int, ...]
    fixed: tuple[int, ...]
    moving_feature: int
    fixed_feature: int

    def __hash__(self) -> int:
        return hash(self.id)  # tells the contacts of two parts apart, and is much faster than all of it


@remembered(_CONTACTS)
def vertex_face(fixed: Polyhedron, vertex: int, face: int) -> PrimitiveContact:
    """The contact of a moving vertex on a fixed face."""
    # The outer loop stands for the face; its holes are in its bounds.
    return PrimitiveContact(f"v{vertex}-f{face}", Kind.VERTEX_FACE, (vertex,), fixed.faces[face].loops[0], vertex, face)


@remembered(_CONTACTS)
def ball_face(fixed: Polyhedron, vertex: int, face: int) -> PrimitiveContact:
    """The contact of a moving ball, of which a vertex is the centre, on a fixed face."""
    return PrimitiveContact(f"b{vertex}-f{face}", Kind.BALL_FACE, (vertex,), fixed.faces[face].loops[0], vertex, face)


@remembered(_CONTACTS)
def face_vertex(moving: Polyhedron, face: int, vertex: int) -> PrimitiveContact:
    """The contact of a moving face on a fixed vertex."""
    loop = moving.faces[face].loops[0]
    return PrimitiveContact(f"f{face}-v{vertex}", Kind.FACE_VERTEX, loop, (vertex,), face, vertex)


def edge_edge(moving: Polyhedron, fixed: Polyhedron, R: Array, one: int, other: int) -> PrimitiveContact:
    """The contact of a moving edge across a fixed edge, the moving edge run so that the normal leaves the fixed part.

    They meet at a rotation R (3, 3) of the moving part.
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
    # Out of the fixed part points a × e or its opposite: the normals of the faces beside the edges tell which.
    m = cross(own.directions[ones] @ R.T, other.directions[others])
    outward = other.between[others] - own.between[ones] @ R.T
    along = (np.vecdot(m, outward) > 0.0).tolist()
    return [crossed(moving, fixed, i, j, on) for (i, j), on in zip(pairs, along, strict=True)]


@remembered(_CONTACTS)
def crossed(moving: Polyhedron, fixed: Polyhedron, one: int, other: int, along: bool) -> PrimitiveContact:
    """The contact of a moving edge, run along or the other way, across a fixed one; see `edge_edge`.

    Run along it keeps the order of its ends, on which the sign of R a × e depends.
    """
    ends = moving.edges[one].vertices if along else moving.edges[one].vertices[::-1]
    return PrimitiveContact(f"e{one}-e{other}", Kind.EDGE_EDGE, ends, fixed.edges[other].vertices, one, other)


@dataclass(frozen=True, eq=False)
class _Features:
    """Vertices, edges and faces of a polyhedron, unit directions of edges and sums (e, 3) of normals beside them."""

    vertices: Indices
    edges: Indices
    directions: Array
    between: Array
    corners: Corners
    ridges: Ridges
    solid: Solid

    @property
    def walls(self) -> PartWalls:
        """The faces."""
        return self.solid.walls


@remembered(1)
def _features(polyhedron: Polyhedron) -> _Features:
    ends = np.array([edge.vertices for edge in polyhedron.edges], dtype=np.intp)
    beside = polyhedron.normals[[edge.faces for edge in polyhedron.edges]]
    convex = np.array([edge.convex for edge in polyhedron.edges], dtype=bool)
    span = polyhedron.vertices[ends[:, 1]] - polyhedron.vertices[ends[:, 0]]
    directions = span / np.sqrt(np.vecdot(span, span))[:, None]
    # A vertex on a reflex edge cannot touch a face first: the faces of that edge are in the way.
    pointed = np.ones(len(polyhedron.vertices), dtype=bool)
    pointed[ends[~convex]] = False
    vertices, edges = np.flatnonzero(pointed), np.flatnonzero(convex)
    around = [np.flatnonzero((ends == v).any(axis=1)) for v in vertices]
    # Padded with zeros, which as directions satisfy every inequality.
    away = np.zeros((len(around), max((len(at) for at in around), default=0), 3))
    arcs = np.zeros((*away.shape[:2], 2, 3))
    for n, (v, at) in enumerate(zip(vertices, around, strict=True)):
        away[n, : len(at)] = np.where(ends[at, :1] == v, directions[at], -directions[at])
        arcs[n, : len(at)] = beside[at]
    corners = Corners(polyhedron.vertices[vertices], np.array(polyhedron.radii[vertices]), away, arcs)
    ridges = Ridges(polyhedron.vertices[ends[edges]], directions[edges], beside[edges])
    solid = Solid(np.array(polyhedron.vertices), np.array(polyhedron.radii), _walls(polyhedron))
    return _Features(vertices, edges, directions, beside.sum(axis=1), corners, ridges, solid)


def _walls(polyhedron: Polyhedron) -> PartWalls:
    loops = [[np.array(loop) for loop in face.loops] for face in polyhedron.faces]
    tails = np.concatenate([loop for of_face in loops for loop in of_face])
    heads = np.concatenate([np.roll(loop, -1) for of_face in loops for loop in of_face])
    begun = np.cumsum([0, *(sum(map(len, of_face)) for of_face in loops)])
    normals, offsets = np.array(polyhedron.normals), np.array(polyhedron.offsets)
    return PartWalls(normals, offsets, polyhedron.vertices[tails], polyhedron.vertices[heads], begun)


def near_contacts(
    moving: Polyhedron, fixed: Polyhedron, pose: Pose, reach: float, angle: float
) -> tuple[PrimitiveContact, ...]:
    """All primitive contacts at poses within a shift (`reach`, m) and a turn (`angle`, rad) of the body at `pose`.

    A contact counts when its features can come together (distance at `pose` at most reach + angle × lever) and when
    the contact normal can lie in the normal cones of both features after a turn by at most `angle`.

    Raises:
        OverdueError: there is no time left.
    """
    heed()
    own, other, back = _features(moving), _features(fixed), pose.inverse()
    T, T_back = matrices(pose.p, pose.R), matrices(back.p, back.R)
    # Both ways round: the fixed part's corners against the moving part's walls need the inverse pose.
    tips = near_tips(moving, fixed, pose, reach, angle)
    horns = vertices_at_faces(other.corners, own.walls, T_back, reach, angle, False)
    crossing = edges_at_edges(own.ridges, other.ridges, T, reach, angle, math.sin(PARALLEL))
    # Balls last, so that the order of all others does not depend on there being any.
    return (
        *(tip for tip in tips if tip.kind is Kind.VERTEX_FACE),
        *(face_vertex(moving, f, v) for v, f in _pairs(horns, other.vertices) if not fixed.radii[v]),
        *_crossing(moving, fixed, pose.R, _pairs(crossing, own.edges, other.edges)),
        *(tip for tip in tips if tip.kind is Kind.BALL_FACE),
    )


def near_tips(
    moving: Polyhedron, fixed: Polyhedron, pose: Pose, reach: float, angle: float
) -> tuple[PrimitiveContact, ...]:
    """Those that are of a moving vertex or ball on a fixed face; errors and arguments as for `near_contacts`."""
    heed()
    own, other = _features(moving), _features(fixed)
    tips = vertices_at_faces(own.corners, other.walls, matrices(pose.p, pose.R), reach, angle, True)
    return tuple(
        ball_face(fixed, v, f) if moving.radii[v] else vertex_face(fixed, v, f) for v, f in _pairs(tips, own.vertices)
    )


def matrices(p: Array, R: Array) -> Array:
    """Poses as kernels take them: rotations R (…, 3, 3) with positions p (…, 3), m, beside them, (…, 3, 4)."""
    found = np.empty((*p.shape, 4))
    found[..., :3], found[..., 3] = R, p
    return found


def _pairs(near: Bits, first: Indices, second: Indices | None = None) -> list[tuple[int, int]]:
    """The pairs of features that are near, by their numbers; those of the second kind count from 0 without."""
    one, other = np.nonzero(near)
    return list(zip(first[one].tolist(), (other if second is None else second[other]).tolist(), strict=True))


@remembered(1)
def convex_vertices(polyhedron: Polyhedron) -> frozenset[int]:
    """The vertices all of whose edges are convex."""
    return frozenset(_features(polyhedron).vertices.tolist())


def feature_distances(contacts: Sequence[PrimitiveContact], moving: Polyhedron, fixed: Polyhedron, pose: Pose) -> Array:
    """Distances (k,) between the two features of contacts at a pose, m: what touches is next to each other, too.

    Bounds do not say that, as there are none where a face or an edge ends at a wall, or at the next one in its plane.
    """
    pairs = np.array([_pair(contact) for contact in contacts], dtype=np.intp).reshape(-1, 5)
    back = pose.inverse()
    T, T_back = matrices(pose.p, pose.R), matrices(back.p, back.R)
    return distances(pairs, _features(moving).solid, _features(fixed).solid, T, T_back)


def _pair(contact: PrimitiveContact) -> tuple[int, int, int, int, int]:
    """A contact as `distances` takes it."""
    match contact.kind:
        case Kind.VERTEX_FACE | Kind.BALL_FACE:
            v, f = contact.moving[0], contact.fixed_feature
            return VERTEX_AT_FACE, v, v, f, f
        case Kind.FACE_VERTEX:
            f, v = contact.moving_feature, contact.fixed[0]
            return FACE_AT_VERTEX, f, f, v, v
        case Kind.EDGE_EDGE:
            (a, b), (c, d) = contact.moving, contact.fixed
            return EDGE_AT_EDGE, a, b, c, d
        case _:
            assert_never(contact.kind)
