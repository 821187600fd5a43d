"""What the uncertain moving part could touch at nominal poses, linearised in the pose error.

A candidate is a vertex and a convex piece of a face, or two convex edges that are not nearly parallel. With the error
e = (d, δ) in a box |eᵢ| ≤ aᵢ the candidate's distance is f(e) = f₀ + N·e + o(e) and its bounds (inside the face, inside
both edges) are rows gₖ(e) = cₖ + Bₖ·e + o(e) ≥ 0, with |o| ≤ ρ in closed form (θ = |a_δ|, D = |a_d|).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fmopt.geometry.polyhedron import Face, Polyhedron, plane_basis
from fmopt.se3 import Pose, cross
from fmopt.values import Array, Value

Indices = NDArray[np.intp]

PARALLEL = float(np.sin(np.radians(1.0)))  # edges closer in direction touch where one of them ends: at a vertex
_KINDS = ("vertex-face", "face-vertex", "edge-edge")


class Candidate(NamedTuple):
    """A pair of features that could touch: its kind, the vertex, plate or edge of the moving and of the fixed body."""

    kind: str
    moving: int
    fixed: int


@dataclass(frozen=True, eq=False)
class Body(Value):
    """A part's features as arrays, each padded by repeating its last entry.

    Attributes:
        vertices: (n, 3), m.
        spokes: unit directions (n, s, 3) of the edges that leave each vertex.
        normals: unit outward normals (m, 3) of the plates, convex pieces of faces.
        corners: (m, k, 3), counter-clockwise seen from outside.
        inward: unit in-plane normals (m, k, 3) of the plates' sides, pointing inside.
        edges: ends (l, 2, 3) of the convex edges.
        tangents: unit directions (l, 2, 3) from an edge into its two faces, at right angles to it.
    """

    vertices: Array
    spokes: Array
    normals: Array
    corners: Array
    inward: Array
    edges: Array
    tangents: Array

    @staticmethod
    def of(polyhedron: Polyhedron) -> Body:
        """The features of a polyhedron."""
        ends = np.array([edge.vertices for edge in polyhedron.edges])
        spans = polyhedron.vertices[ends]
        along = _unit(spans[:, 1] - spans[:, 0])
        count = range(len(polyhedron.vertices))
        spokes = [np.vstack([along[ends[:, 0] == v], -along[ends[:, 1] == v]]) for v in count]
        convex = np.array([edge.convex for edge in polyhedron.edges])
        n = polyhedron.normals[np.array([edge.faces for edge in polyhedron.edges])[convex]]
        tangents = _unit(np.sum(n[:, :1] * n[:, 1:], axis=2, keepdims=True) * n - n[:, ::-1])
        plates = [(face.normal, plate) for face in polyhedron.faces for plate in _plates(polyhedron, face)]
        sides = [_unit(cross(normal, np.roll(plate, -1, axis=0) - plate)) for normal, plate in plates]
        return Body(
            polyhedron.vertices,
            _padded(spokes),
            np.array([normal for normal, _ in plates]),
            _padded([plate for _, plate in plates]),
            _padded(sides),
            spans[convex],
            tangents,
        )


@dataclass(frozen=True, eq=False)
class Linear(Value):
    """Candidates linearised.

    f₀ (n,), N (n, 6), c (n, k), B (n, k, 6), ρ of f and of all gₖ (n, 2), contact points minus p (n, 3).
    """

    distance: Array
    gradient: Array
    heights: Array
    rows: Array
    remainder: Array
    arm: Array

    @property
    def wrenches(self) -> Array:
        """Frictionless contact wrenches (n, 6) about p, N at f₀ = 0."""
        force = self.gradient[:, :3]
        return np.concatenate([force, cross(self.arm, force)], axis=1)


def candidates(moving: Body, fixed: Body, pose: Pose, half_widths: Array) -> list[Candidate]:
    """The candidates that come near enough within the box, and can meet from outside.

    Args:
        moving: in its body frame.
        fixed: in the B-frame.
        pose: nominal pose of the moving body.
        half_widths: a (6,), m and rad.
    """
    D, theta = float(np.linalg.norm(half_widths[:3])), float(np.linalg.norm(half_widths[3:]))
    tilt = theta + 1e-9

    def near(one: Array, other: Array) -> tuple[Indices, Indices]:
        grow = D + theta * np.linalg.norm(one, axis=2).max(axis=1)[:, None] + 1e-9
        turned = pose.apply(one)
        return _meeting((turned.min(axis=1) - grow, turned.max(axis=1) + grow), (other.min(axis=1), other.max(axis=1)))

    i, j = near(moving.vertices[:, None], fixed.corners)
    meets = _dot(moving.spokes[i] @ pose.R.T, fixed.normals[j][:, None]).min(axis=1, initial=1.0) >= -tilt
    found = [Candidate(_KINDS[0], int(a), int(b)) for a, b in zip(i[meets], j[meets], strict=True)]
    i, j = near(moving.corners, fixed.vertices[:, None])
    meets = _dot(fixed.spokes[j], (moving.normals[i] @ pose.R.T)[:, None]).min(axis=1, initial=1.0) >= -tilt
    found += [Candidate(_KINDS[1], int(a), int(b)) for a, b in zip(i[meets], j[meets], strict=True)]
    i, j = near(moving.edges, fixed.edges)
    outward = _outward(moving, fixed, pose.R, i, j)
    meets = np.minimum(-outward.min(axis=1, initial=1.0), outward.max(axis=1, initial=-1.0)) <= 2.0 * tilt
    meets &= np.any(outward != 0.0, axis=1)
    return found + [Candidate(_KINDS[2], int(a), int(b)) for a, b in zip(i[meets], j[meets], strict=True)]


def linear(items: Sequence[Candidate], moving: Body, fixed: Body, poses: Sequence[Pose], half_widths: Array) -> Linear:
    """The n candidates linearised in the pose error, each at its own nominal pose."""
    D, theta = float(np.linalg.norm(half_widths[:3])), float(np.linalg.norm(half_widths[3:]))
    n, k = len(items), max(4, moving.corners.shape[1], fixed.corners.shape[1])
    made = Linear(*(np.zeros((n, *shape)) for shape in ((), (6,), (k,), (k, 6), (2,), (3,))))
    for kind, rows_of in zip(_KINDS, (_vertex_face, _face_vertex, _edge_edge), strict=True):
        which = np.array([number for number, item in enumerate(items) if item.kind == kind], dtype=int)
        if not which.size:
            continue
        i, j = np.array([items[number][1:] for number in which]).T
        p = np.array([poses[number].p for number in which])
        R = np.array([poses[number].R for number in which])
        part = rows_of(moving, fixed, i, j, p, R, D, theta)
        pad = np.minimum(np.arange(k), part.heights.shape[1] - 1)
        made.distance[which], made.gradient[which], made.remainder[which] = part.distance, part.gradient, part.remainder
        made.heights[which], made.rows[which], made.arm[which] = part.heights[:, pad], part.rows[:, pad], part.arm
    return made


def _vertex_face(
    moving: Body, fixed: Body, i: Indices, j: Indices, p: Array, R: Array, D: float, theta: float
) -> Linear:
    arm = _turned(R, moving.vertices[i])
    normal, inward = fixed.normals[j], fixed.inward[j]
    x = (p + arm)[:, None]
    return Linear(
        _dot(normal, x[:, 0] - fixed.corners[j, 0]),
        np.concatenate([normal, cross(arm, normal)], axis=1),
        _dot(inward, x - fixed.corners[j]),
        np.concatenate([inward, cross(arm[:, None], inward)], axis=2),
        np.repeat(0.5 * theta**2 * np.linalg.norm(arm, axis=1)[:, None], 2, axis=1),
        arm,
    )


def _face_vertex(
    moving: Body, fixed: Body, i: Indices, j: Indices, p: Array, R: Array, D: float, theta: float
) -> Linear:
    arm = fixed.vertices[j] - p
    normal, inward = _turned(R, moving.normals[i]), _turned(R, moving.inward[i])
    corners = _turned(R, moving.corners[i])
    return Linear(
        _dot(normal, arm - corners[:, 0]),
        np.concatenate([-normal, cross(normal, arm)], axis=1),
        _dot(inward, arm[:, None] - corners),
        np.concatenate([-inward, cross(inward, arm[:, None])], axis=2),
        np.repeat(theta * (0.5 * theta * np.linalg.norm(arm, axis=1) + D)[:, None], 2, axis=1),
        arm,
    )


def _edge_edge(moving: Body, fixed: Body, i: Indices, j: Indices, p: Array, R: Array, D: float, theta: float) -> Linear:
    """Edges as lines: f = m·(p + Ra − q), m the cross product of their directions over its nominal length.

    The ends of each edge lie on two sides of the plane through the other edge and m.
    """
    own, wall = _turned(R, moving.edges[i]), fixed.edges[j] - p[:, None]
    flip = _outward(moving, fixed, R, i, j).sum(axis=1) < 0.0
    own[flip] = own[flip, ::-1]
    e, g = _unit(own[:, 1] - own[:, 0]), _unit(wall[:, 1] - wall[:, 0])
    m = cross(e, g)
    k = np.linalg.norm(m, axis=1)
    m /= k[:, None]
    y, moment = cross(g, -wall[:, 0]), cross(own[:, 0], e)
    distance = (_dot(e, y) + _dot(g, moment)) / k
    across, beside = cross(g, m), cross(e, m)
    across *= np.sign(_dot(across, e))[:, None]
    beside *= np.sign(_dot(beside, g))[:, None]
    heights, rows = np.empty((len(k), 4)), np.empty((len(k), 4, 6))
    for end, sign in ((0, -1.0), (1, 1.0)):
        heights[:, end] = sign * _dot(across, own[:, end] - wall[:, 0])
        rows[:, end] = sign * np.concatenate([across, cross(own[:, end], across)], axis=1)
        heights[:, 2 + end] = sign * _dot(beside, wall[:, end] - own[:, 0])
        rows[:, 2 + end] = sign * np.concatenate([-beside, cross(beside, wall[:, end])], axis=1)
    reach = np.linalg.norm(np.concatenate([own, wall], axis=1), axis=2).max(axis=1)
    of_sides = 0.5 * theta**2 * reach + D * theta + (np.abs(distance) + D + theta * reach) * theta / k
    of_lines = 0.5 * theta**2 * (np.linalg.norm(moment, axis=1) + np.linalg.norm(y, axis=1)) + D * theta
    return Linear(
        distance,
        np.concatenate([cross(e, g), cross(e, y) + cross(moment, g)], axis=1) / k[:, None],
        heights,
        rows,
        np.column_stack([of_lines / k, of_sides]),
        own[:, 0] + e * (_dot(cross(wall[:, 0] - own[:, 0], g), m) / k)[:, None],
    )


def _outward(moving: Body, fixed: Body, R: Array, i: Indices, j: Indices) -> Array:
    """m·t (n, 4) for the unit normal m of two edges and the tangents t of their four faces, away from each other.

    All of one sign when the edges can meet from outside; all zero for edges that are nearly parallel.
    """
    own, wall = moving.edges[i], fixed.edges[j]
    m = cross(_turned(R, _unit(own[:, 1] - own[:, 0])), _unit(wall[:, 1] - wall[:, 0]))
    size = np.linalg.norm(m, axis=1)[:, None]
    tangents = np.concatenate([_turned(R, moving.tangents[i]), -fixed.tangents[j]], axis=1)
    value = _dot(tangents, m[:, None]) / np.maximum(size, PARALLEL)
    return np.where(size < PARALLEL, 0.0, value)


def _meeting(one: tuple[Array, Array], other: tuple[Array, Array]) -> tuple[Indices, Indices]:
    """Index pairs of the axis-parallel boxes (low, high) that overlap."""
    meet = np.ones((len(one[0]), len(other[0])), dtype=bool)
    for axis in range(3):
        meet &= one[0][:, None, axis] <= other[1][None, :, axis]
        meet &= other[0][None, :, axis] <= one[1][:, None, axis]
    i, j = np.nonzero(meet)
    return i, j


def _plates(polyhedron: Polyhedron, face: Face) -> list[Array]:
    """Corners of the convex pieces of a face: itself, or the triangles of a polygon with holes or reflex corners."""
    outer = polyhedron.vertices[list(face.loops[0])]
    steps = np.roll(outer, -1, axis=0) - outer
    if len(face.loops) == 1 and np.all(np.cross(np.roll(steps, 1, axis=0), steps) @ face.normal > 0.0):
        return [outer]
    from manifold3d import triangulate

    points = polyhedron.vertices[[index for loop in face.loops for index in loop]]
    flat = points @ plane_basis(face.normal)
    ends = np.cumsum([len(loop) for loop in face.loops])[:-1]
    return [points[list(corners)] for corners in triangulate(np.split(flat, ends))]


def _padded(groups: Sequence[Array]) -> Array:
    """Groups of points (k_i, 3) as one array (n, max k, 3), the last point of each repeated."""
    most = max(len(group) for group in groups)
    return np.array([group[np.minimum(np.arange(most), len(group) - 1)] for group in groups])


def _turned(R: Array, points: Array) -> Array:
    """Points (n, 3) or (n, k, 3), each turned by its own R (n, 3, 3) or by one R (3, 3)."""
    columns = np.swapaxes(R, -1, -2)
    return np.asarray(points @ columns if points.ndim == 3 or R.ndim == 2 else (points[:, None] @ columns)[:, 0])


def _dot(a: Array, b: Array) -> Array:
    return np.asarray((a * b).sum(axis=-1))


def _unit(vectors: Array) -> Array:
    return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True))
