"""What the uncertain moving part could touch at nominal poses, linearised in the pose error.

A candidate is a vertex and a convex piece of a face (kind 0), the same the other way round (kind 1), or two convex
edges that are not nearly parallel (kind 2), each with the numbers of the two features in their bodies. With the error
e = (d, δ) in a box |eᵢ| ≤ aᵢ the candidate's distance is f(e) = f₀ + N·e + o(e) and its bounds (inside the face, inside
both edges) are rows gₖ(e) = cₖ + Bₖ·e + o(e) ≥ 0, with |o| ≤ ρ in closed form (θ = |a_δ|, D = |a_d|).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from manifold3d import triangulate

from fmopt.geometry.polyhedron import Face, Polyhedron, plane_basis
from fmopt.runtime.clock import heed
from fmopt.spatial.se3 import cross
from fmopt.spatial.values import Array, Bits, Indices, Value

_BLOCK = 2_000_000  # pairs of boxes looked at in one go
PARALLEL = float(np.sin(np.radians(1.0)))  # edges closer in direction touch where one of them ends: at a vertex


@dataclass(frozen=True, eq=False)
class Features(Value):
    """A part's features as arrays, each padded by repeating its last entry.

    Attributes:
        vertices: (n, 3), m.
        radii: of the balls about them (n,), m; 0 of those that are points.
        spokes: unit directions (n, s, 3) of the edges that leave each vertex; 0 of a ball.
        normals: unit outward normals (m, 3) of the plates, convex pieces of faces.
        corners: (m, k, 3), counter-clockwise seen from outside.
        inward: unit in-plane normals (m, k, 3) of the plates' sides, pointing inside.
        edges: ends (l, 2, 3) of the convex edges.
        tangents: unit directions (l, 2, 3) from an edge into its two faces, at right angles to it.
    """

    vertices: Array
    radii: Array
    spokes: Array
    normals: Array
    corners: Array
    inward: Array
    edges: Array
    tangents: Array

    @staticmethod
    def of(polyhedron: Polyhedron) -> "Features":
        """The features of a polyhedron."""
        ends = np.array([edge.vertices for edge in polyhedron.edges])
        spans = polyhedron.vertices[ends]
        along = _unit(spans[:, 1] - spans[:, 0])
        count = range(len(polyhedron.vertices))
        spokes = [np.vstack([along[ends[:, 0] == v], -along[ends[:, 1] == v]]) for v in count]
        # A ball has no edges: a zero spoke is at right angles to everything.
        spokes = [leaving if len(leaving) else np.zeros((1, 3)) for leaving in spokes]
        convex = np.array([edge.convex for edge in polyhedron.edges])
        n = polyhedron.normals[np.array([edge.faces for edge in polyhedron.edges])[convex]]
        # In each face the direction square to the edge: the other face's normal less its part along this one's.
        tangents = _unit(np.sum(n[:, :1] * n[:, 1:], axis=2, keepdims=True) * n - n[:, ::-1])
        plates = [(face.normal, plate) for face in polyhedron.faces for plate in _plates(polyhedron, face)]
        sides = [_unit(cross(normal, np.roll(plate, -1, axis=0) - plate)) for normal, plate in plates]
        return Features(
            polyhedron.vertices,
            polyhedron.radii,
            _padded(spokes),
            np.array([normal for normal, _ in plates]),
            _padded([plate for _, plate in plates]),
            _padded(sides),
            spans[convex],
            tangents,
        )


@dataclass(frozen=True, eq=False)
class Linearised(Value):
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


def candidates(moving: Features, fixed: Features, p: Array, R: Array, half_widths: Array) -> tuple[Indices, Indices]:
    """The candidates that come near enough within the box, and can meet from outside.

    The moving body is in its body frame, at nominal positions p (n, 3), m, the fixed one in the B-frame; the box is a
    (6,), m and rad.

    Returns:
        Which position (k,), and there the kind and the feature of the moving and of the fixed body (k, 3).
    """
    heed()
    D, theta = float(np.linalg.norm(half_widths[:3])), float(np.linalg.norm(half_widths[3:]))
    # A little more than the error, for rounding.
    tilt = theta + 1e-9

    def near(one: Array, other: Array, radii: Array | float = 0.0) -> tuple[Indices, Indices, Indices]:
        # Turned about the reference point, a feature farther away swings farther.
        grow = D + theta * np.linalg.norm(one, axis=2).max(axis=1)[:, None] + 1e-9 + np.reshape(radii, (-1, 1))
        turned = one @ R.T
        box = turned.min(axis=1) - grow, turned.max(axis=1) + grow
        return _meeting(box, (other.min(axis=1), other.max(axis=1)), p)

    def found(kind: int, meets: Bits, rows: tuple[Indices, Indices, Indices]) -> tuple[Indices, Indices]:
        at, i, j = (row[meets] for row in rows)
        return at, np.column_stack([np.full(len(at), kind), i, j])

    vertices = near(moving.vertices[:, None], fixed.corners, moving.radii)
    _, i, j = vertices
    # A vertex meets a plate from outside if no edge from it leads into the wall, tilts allowed.
    outside = _dot(moving.spokes[i] @ R.T, fixed.normals[j][:, None]).min(axis=1, initial=1.0) >= -tilt
    faces = near(moving.corners, fixed.vertices[:, None])
    _, i, j = faces
    around = _dot(fixed.spokes[j], (moving.normals[i] @ R.T)[:, None]).min(axis=1, initial=1.0) >= -tilt
    edges = near(moving.edges, fixed.edges)
    _, i, j = edges
    outward = _outward(moving, fixed, R, i, j)
    # The normal of two edges may have either sign: one of both has to separate their faces.
    crossed = np.minimum(-outward.min(axis=1, initial=1.0), outward.max(axis=1, initial=-1.0)) <= 2.0 * tilt
    crossed &= np.any(outward != 0.0, axis=1)
    parts = found(0, outside, vertices), found(1, around, faces), found(2, crossed, edges)
    return np.concatenate([at for at, _ in parts]), np.concatenate([items for _, items in parts])


def linear(items: Indices, moving: Features, fixed: Features, p: Array, R: Array, half_widths: Array) -> Linearised:
    """The candidates linearised in the pose error, each at its own nominal pose.

    Items (n, 3) are the kind of the pair, number on `moving`, number on `fixed`; p (n, 3), m, and R (n, 3, 3) are
    nominal poses, and the box of the pose error is a (6,), m and rad.
    """
    D, theta = float(np.linalg.norm(half_widths[:3])), float(np.linalg.norm(half_widths[3:]))
    n, k = len(items), max(4, moving.corners.shape[1], fixed.corners.shape[1])
    made = Linearised(*(np.zeros((n, *shape)) for shape in ((), (6,), (k,), (k, 6), (2,), (3,))))
    for kind, rows_of in enumerate((_vertex_face, _face_vertex, _edge_edge)):
        which = np.flatnonzero(items[:, 0] == kind)
        if not which.size:
            continue
        _, i, j = items[which].T
        part = rows_of(moving, fixed, i, j, _At(p[which], R[which]), (D, theta))
        # Kinds have different numbers of sides: the last one is repeated, which changes no minimum.
        pad = np.minimum(np.arange(k), part.heights.shape[1] - 1)
        made.distance[which], made.gradient[which], made.remainder[which] = part.distance, part.gradient, part.remainder
        made.heights[which], made.rows[which], made.arm[which] = part.heights[:, pad], part.rows[:, pad], part.arm
    return made


class _At(NamedTuple):
    """Nominal poses: p (n, 3), m, and R (n, 3, 3)."""

    p: Array
    R: Array


def _vertex_face(
    moving: Features, fixed: Features, i: Indices, j: Indices, at: _At, reach: tuple[float, float]
) -> Linearised:
    (p, R), (_, theta) = at, reach
    arm = _turned(R, moving.vertices[i])
    normal, inward = fixed.normals[j], fixed.inward[j]
    x = (p + arm)[:, None]
    return Linearised(
        _dot(normal, x[:, 0] - fixed.corners[j, 0]) - moving.radii[i],
        np.concatenate([normal, cross(arm, normal)], axis=1),
        _dot(inward, x - fixed.corners[j]),
        np.concatenate([inward, cross(arm[:, None], inward)], axis=2),
        # A turn by ε moves an arm by ε × arm and at most ½ θ² |arm| more.
        np.repeat(0.5 * theta**2 * np.linalg.norm(arm, axis=1)[:, None], 2, axis=1),
        arm,
    )


def _face_vertex(
    moving: Features, fixed: Features, i: Indices, j: Indices, at: _At, reach: tuple[float, float]
) -> Linearised:
    (p, R), (D, theta) = at, reach
    arm = fixed.vertices[j] - p
    normal, inward = _turned(R, moving.normals[i]), _turned(R, moving.inward[i])
    corners = _turned(R, moving.corners[i])
    return Linearised(
        _dot(normal, arm - corners[:, 0]),
        np.concatenate([-normal, cross(normal, arm)], axis=1),
        _dot(inward, arm[:, None] - corners),
        np.concatenate([-inward, cross(inward, arm[:, None])], axis=2),
        np.repeat(theta * (0.5 * theta * np.linalg.norm(arm, axis=1) + D)[:, None], 2, axis=1),
        arm,
    )


def _edge_edge(
    moving: Features, fixed: Features, i: Indices, j: Indices, at: _At, reach: tuple[float, float]
) -> Linearised:
    """Edges as lines: f = m·(p + Ra − q), m the cross product of their directions over its nominal length.

    The ends of each edge lie on two sides of the plane through the other edge and m.
    """
    (p, R), (D, theta) = at, reach
    own, wall = _turned(R, moving.edges[i]), fixed.edges[j] - p[:, None]
    # Run so that the normal leads out of the fixed part.
    flip = _outward(moving, fixed, R, i, j).sum(axis=1) < 0.0
    own[flip] = own[flip, ::-1]
    e, g = _unit(own[:, 1] - own[:, 0]), _unit(wall[:, 1] - wall[:, 0])
    m = cross(e, g)
    k = np.linalg.norm(m, axis=1)
    m /= k[:, None]
    y, moment = cross(g, -wall[:, 0]), cross(own[:, 0], e)
    distance = (_dot(e, y) + _dot(g, moment)) / k
    across, beside = cross(g, m), cross(e, m)
    # Each across-vector points along the other edge, so that heights are positive within it.
    across *= np.sign(_dot(across, e))[:, None]
    beside *= np.sign(_dot(beside, g))[:, None]
    heights, rows = np.empty((len(k), 4)), np.empty((len(k), 4, 6))
    for end, sign in ((0, -1.0), (1, 1.0)):
        heights[:, end] = sign * _dot(across, own[:, end] - wall[:, 0])
        rows[:, end] = sign * np.concatenate([across, cross(own[:, end], across)], axis=1)
        heights[:, 2 + end] = sign * _dot(beside, wall[:, end] - own[:, 0])
        rows[:, 2 + end] = sign * np.concatenate([-beside, cross(beside, wall[:, end])], axis=1)
    longest = np.linalg.norm(np.concatenate([own, wall], axis=1), axis=2).max(axis=1)
    # Sides are measured off the nominal lines: both turn, and the foot moves by distance over the sine.
    of_sides = 0.5 * theta**2 * longest + D * theta + (np.abs(distance) + D + theta * longest) * theta / k
    of_lines = 0.5 * theta**2 * (np.linalg.norm(moment, axis=1) + np.linalg.norm(y, axis=1)) + D * theta
    return Linearised(
        distance,
        np.concatenate([cross(e, g), cross(e, y) + cross(moment, g)], axis=1) / k[:, None],
        heights,
        rows,
        np.column_stack([of_lines / k, of_sides]),
        own[:, 0] + e * (_dot(cross(wall[:, 0] - own[:, 0], g), m) / k)[:, None],
    )


def _outward(moving: Features, fixed: Features, R: Array, i: Indices, j: Indices) -> Array:
    """m·t (n, 4) for the unit normal m of two edges and the tangents t of their four faces, away from each other.

    All of one sign when the edges can meet from outside; all zero for edges that are nearly parallel.
    """
    own, wall = moving.edges[i], fixed.edges[j]
    m = cross(_turned(R, _unit(own[:, 1] - own[:, 0])), _unit(wall[:, 1] - wall[:, 0]))
    size = np.linalg.norm(m, axis=1)[:, None]
    tangents = np.concatenate([_turned(R, moving.tangents[i]), -fixed.tangents[j]], axis=1)
    value = _dot(tangents, m[:, None]) / np.maximum(size, PARALLEL)
    return np.where(size < PARALLEL, 0.0, value)


def _meeting(one: tuple[Array, Array], other: tuple[Array, Array], shifts: Array) -> tuple[Indices, Indices, Indices]:
    """Which of the shifts (n, 3) of one, and the index pairs of the boxes (low, high) that overlap there."""
    # One coarse comparison for all shifts first: most pairs of boxes never come together.
    i, j = np.nonzero(_overlap(one[0][:, None] + shifts.min(axis=0), one[1][:, None] + shifts.max(axis=0), *other))
    low, high, other = one[0][i], one[1][i], (other[0][j], other[1][j])
    found = []
    for rows in np.array_split(np.arange(len(shifts)), 1 + len(shifts) * len(i) // _BLOCK):
        moves = shifts[rows, None]
        at, pair = np.nonzero(_overlap(low + moves, high + moves, *other))
        found.append((rows[at], i[pair], j[pair]))
    at, i, j = (np.concatenate(column) for column in zip(*found, strict=True))
    return at, i, j


def _overlap(low: Array, high: Array, lower: Array, upper: Array) -> Bits:
    """Whether boxes (…, 3) overlap."""
    return np.asarray(((low <= upper) & (lower <= high)).all(axis=-1))


def _plates(polyhedron: Polyhedron, face: Face) -> list[Array]:
    """Corners of the convex pieces of a face: itself, or the triangles of a polygon with holes or reflex corners."""
    outer = polyhedron.vertices[list(face.loops[0])]
    steps = np.roll(outer, -1, axis=0) - outer
    if len(face.loops) == 1 and np.all(cross(np.roll(steps, 1, axis=0), steps) @ face.normal > 0.0):
        return [outer]
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
