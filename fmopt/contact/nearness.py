"""Which features of two parts can come together, compiled: vertices and faces, edges and edges, one pair at a time.

Features can when they are near enough to each other, and when some turn small enough brings a normal of the one against
a normal of the other. The normals of a convex vertex are a cone, those of a convex edge an arc.
"""

from __future__ import annotations

import math
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from fmopt.compiled import compiled, part
from fmopt.values import Array

Bits = NDArray[np.bool_]
Vector: TypeAlias = tuple[float, float, float]

_PARALLEL = 1e-12  # squared sine below which two normals span no arc
_TOGETHER = 1e-12  # distance of a unit vector from an arc on which it lies


class Corners(NamedTuple):
    """The n convex vertices of a part.

    Attributes:
        points: (n, 3), m.
        away: unit vectors (n, k, 3) along their edges, away from them; zero where there are fewer than k.
        arcs: normals (n, k, 2, 3) of the faces beside these; zero where there are fewer.
    """

    points: Array
    away: Array
    arcs: Array


class Walls(NamedTuple):
    """The m faces of a part.

    Attributes:
        normals: (m, 3), unit length.
        offsets: (m,), m.
        tails: (s, 3), where the edges of each face begin, m.
        heads: (s, 3), where they end.
        begun: (m + 1,), which of the edges are the first of each face, and how many there are.
    """

    normals: Array
    offsets: Array
    tails: Array
    heads: Array
    begun: NDArray[np.int64]


class Ridges(NamedTuple):
    """The n convex edges of a part.

    Attributes:
        ends: (n, 2, 3), m.
        directions: unit vectors (n, 3) along them.
        arcs: normals (n, 2, 3) of the faces beside them.
    """

    ends: Array
    directions: Array
    arcs: Array


@compiled
def vertices_at_faces(corners: Corners, walls: Walls, T: Array, reach: float, angle: float, lever: bool) -> Bits:
    """Which vertices (n) of one part can meet which faces (m) of another: (n, m).

    Args:
        corners: the vertices.
        walls: the faces.
        T: (3, 4), rotation and position that carry the vertices into the frame of the faces, m.
        reach: largest shift, m.
        angle: largest turn, rad.
        lever: whether it is about the origin of the vertices' part, or else about that of the faces' part.
    """
    near = np.zeros((len(corners.points), len(walls.normals)), dtype=np.bool_)
    for i in range(near.shape[0]):
        point = _vector(corners.points, i)
        x = _turned(T, point)
        x = (x[0] + T[0, 3], x[1] + T[1, 3], x[2] + T[2, 3])
        limit = reach + angle * _length(point if lever else x)
        for f in range(near.shape[1]):
            normal = _vector(walls.normals, f)
            if abs(_dot(normal, x) - walls.offsets[f]) > limit:
                continue
            inward = _turned_back(T, (-normal[0], -normal[1], -normal[2]))
            if math.asin(min(_from_cone(corners.away[i], corners.arcs[i], inward), 1.0)) <= angle:
                near[i, f] = face_distance(walls, f, x) <= limit
    return near


@compiled
def edges_at_edges(own: Ridges, other: Ridges, T: Array, reach: float, angle: float, sine: float) -> Bits:
    """Which edges (n) of one part can meet which edges (m) of another: (n, m).

    Args:
        own: the edges of the one part.
        other: those of the other.
        T: (3, 4), rotation and position that carry the first into the frame of the others, m.
        reach: largest shift, m.
        angle: largest turn about the origin of the first, rad.
        sine: least sine of the angle between edges that meet.
    """
    near = np.zeros((len(own.ends), len(other.ends)), dtype=np.bool_)
    p = (T[0, 3], T[1, 3], T[2, 3])
    for i in range(near.shape[0]):
        first, last = _vector(own.ends[i], 0), _vector(own.ends[i], 1)
        limit = reach + angle * max(_length(first), _length(last))
        a, along = _sum(_turned(T, first), 1.0, p), _turned(T, _vector(own.directions, i))
        b = _sum(_turned(T, last), 1.0, p)
        left, right = _turned(T, _vector(own.arcs[i], 0)), _turned(T, _vector(own.arcs[i], 1))
        left, right = (-left[0], -left[1], -left[2]), (-right[0], -right[1], -right[2])
        for j in range(near.shape[1]):
            if _length(_cross(along, _vector(other.directions, j))) < sine:
                continue
            if segment_distance(a, b, _vector(other.ends[j], 0), _vector(other.ends[j], 1)) > limit:
                continue
            near[i, j] = arc_angle(left, right, _vector(other.arcs[j], 0), _vector(other.arcs[j], 1)) <= angle
    return near


@compiled
def face_distance(walls: Walls, face: int, x: Vector) -> float:
    """Distance from a point to a face as a region of its plane, m."""
    normal = _vector(walls.normals, face)
    height = _dot(normal, x) - walls.offsets[face]
    foot = _sum(x, -height, normal)
    aside, round_ = np.inf, 0.0
    for s in range(walls.begun[face], walls.begun[face + 1]):
        u, v = _sum(_vector(walls.tails, s), -1.0, foot), _sum(_vector(walls.heads, s), -1.0, foot)
        e = _sum(v, -1.0, u)
        t = min(max(-_dot(u, e) / _dot(e, e), 0.0), 1.0)
        aside = min(aside, _length(_sum(u, t, e)))
        round_ += math.atan2(_dot(_cross(u, v), normal), _dot(u, v))
    return abs(height) if round_ > math.pi else math.hypot(height, aside)


@compiled
def segment_distance(a: Vector, b: Vector, c: Vector, d: Vector) -> float:
    """Distance between the segments from a to b and from c to d, m."""
    u, w, r = _sum(b, -1.0, a), _sum(d, -1.0, c), _sum(a, -1.0, c)
    uu, ww, uw, ru, rw = _dot(u, u), _dot(w, w), _dot(u, w), _dot(r, u), _dot(r, w)
    det, least = uu * ww - uw * uw, np.inf
    s = min(max((uw * rw - ww * ru) / det, 0.0), 1.0) if det > 1e-12 * uu * ww else 0.0
    # The least distance is at the clamped stationary point or has one parameter at an end.
    for start in (s, 0.0, 1.0):
        t = min(max((uw * start + rw) / ww, 0.0), 1.0)
        s = min(max((uw * t - ru) / uu, 0.0), 1.0)
        least = min(least, _length(_sum(_sum(r, s, u), -t, w)))
    return least


@part
def arc_distance(x: Vector, a: Vector, b: Vector) -> float:
    """Distance of a unit vector from the cone of two unit generators, 1 at most."""
    xa, xb, ab = _dot(x, a), _dot(x, b), _dot(a, b)
    rest, found = max(1.0 - ab * ab, _PARALLEL), 1.0
    s, t = (xa - ab * xb) / rest, (xb - ab * xa) / rest
    if s >= 0.0 and t >= 0.0 and rest > _PARALLEL:
        found = _length(_sum(_sum(x, -s, a), -t, b))
    if xa > 0.0:
        found = min(found, _length(_sum(x, -xa, a)))
    if xb > 0.0:
        found = min(found, _length(_sum(x, -xb, b)))
    return found


@part
def arc_angle(a: Vector, b: Vector, c: Vector, d: Vector) -> float:
    """Least angle between the great-circle arcs from a to b and from c to d, rad; π/2 when more."""
    ends = min(arc_distance(a, c, d), arc_distance(b, c, d))
    ends = min(ends, arc_distance(c, a, b), arc_distance(d, a, b))
    meet = _cross(_cross(a, b), _cross(c, d))
    size = _length(meet)
    if size > 0.0:
        for sign in (1.0, -1.0):
            m = (sign * meet[0] / size, sign * meet[1] / size, sign * meet[2] / size)
            if max(arc_distance(m, a, b), arc_distance(m, c, d)) < _TOGETHER:
                return 0.0
    return math.asin(min(ends, 1.0))


@part
def _from_cone(away: Array, arcs: Array, x: Vector) -> float:
    """Distance of a unit vector from the cone of a vertex' normals, 1 at most.

    It is what no edge leaves the vertex along; its boundary are arcs across the edges.
    """
    within, least = True, 1.0
    for k in range(len(away)):
        within = within and _dot(_vector(away, k), x) <= 0.0
    if within:
        return 0.0
    for k in range(len(away)):
        least = min(least, arc_distance(x, _vector(arcs[k], 0), _vector(arcs[k], 1)))
    return least


@part
def _vector(rows: Array, i: int) -> Vector:
    return rows[i, 0], rows[i, 1], rows[i, 2]


@part
def _turned(T: Array, v: Vector) -> Vector:
    return (
        T[0, 0] * v[0] + T[0, 1] * v[1] + T[0, 2] * v[2],
        T[1, 0] * v[0] + T[1, 1] * v[1] + T[1, 2] * v[2],
        T[2, 0] * v[0] + T[2, 1] * v[1] + T[2, 2] * v[2],
    )


@part
def _turned_back(T: Array, v: Vector) -> Vector:
    return (
        T[0, 0] * v[0] + T[1, 0] * v[1] + T[2, 0] * v[2],
        T[0, 1] * v[0] + T[1, 1] * v[1] + T[2, 1] * v[2],
        T[0, 2] * v[0] + T[1, 2] * v[1] + T[2, 2] * v[2],
    )


@part
def _sum(a: Vector, share: float, b: Vector) -> Vector:
    return a[0] + share * b[0], a[1] + share * b[1], a[2] + share * b[2]


@part
def _cross(a: Vector, b: Vector) -> Vector:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@part
def _dot(a: Vector, b: Vector) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@part
def _length(a: Vector) -> float:
    return math.sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2])
