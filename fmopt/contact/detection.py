"""Which features of two parts can come together, compiled: vertices and faces, edges and edges, one pair at a time.

Features can when they are near enough to each other, and when some turn small enough brings a normal of the one against
a normal of the other. The normals of a convex vertex are a cone, those of a convex edge an arc.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fmopt.runtime.compiled import compiled, part
from fmopt.spatial.kernels import Vector, cross, dot, plus, row, size, turned, turned_back
from fmopt.spatial.values import Array, Bits, Indices

_PARALLEL = 1e-12  # squared sine below which two normals span no arc
_BALL = 0.5 + 1e-9  # of an edge's length, the radius of the ball around it
_TOGETHER = 1e-12  # distance of a unit vector from an arc on which it lies

VERTEX_AT_FACE, FACE_AT_VERTEX, EDGE_AT_EDGE = 0, 1, 2
"""Kinds of pairs of features; a ball is at a face like a vertex."""


class Corners(NamedTuple):
    """The convex vertices (n, 3) of a part, m, and the centres of its balls."""

    points: Array
    radii: Array  # of the balls about them (n,), m; 0 of vertices
    away: Array  # unit vectors (n, k, 3) along their edges, away from them; zero where there are fewer than k
    arcs: Array  # normals (n, k, 2, 3) of the faces beside these; zero where there are fewer


class PartWalls(NamedTuple):
    """The m faces of a part, their normals (m, 3) and offsets (m,), m."""

    normals: Array
    offsets: Array
    tails: Array  # (s, 3), where the edges of each face begin, m
    heads: Array
    begun: NDArray[np.int64]  # (m + 1,), which of the edges are the first of each face, and how many there are


class Ridges(NamedTuple):
    """The n convex edges of a part: ends (n, 2, 3), m, unit vectors (n, 3) along them, and arcs.

    These are between the normals (n, 2, 3) of the faces beside them.
    """

    ends: Array
    directions: Array
    arcs: Array


@compiled
def vertices_at_faces(corners: Corners, walls: PartWalls, T: Array, reach: float, angle: float, lever: bool) -> Bits:
    """Which vertices (n) of one part can meet which faces (m) of another: (n, m).

    T (3, 4), m, carries the vertices into the frame of the faces, `reach` is the largest shift, m, `angle` the largest
    turn, rad: about the origin of the vertices' part if `lever`, else about that of the faces' part.
    """
    near = np.zeros((len(corners.points), len(walls.normals)), dtype=np.bool_)
    for i in range(near.shape[0]):
        # How far the point may come is judged where it is nominally: the rest is in the limit.
        point = row(corners.points, i)
        x = turned(T, point)
        x = (x[0] + T[0, 3], x[1] + T[1, 3], x[2] + T[2, 3])
        # About the reference point of whichever part is turned: its own points swing, or it swings about the origin.
        limit = reach + angle * size(point if lever else x)
        for f in range(near.shape[1]):
            normal = row(walls.normals, f)
            if abs(dot(normal, x) - walls.offsets[f] - corners.radii[i]) > limit:
                continue
            # The wall's inward normal in the axes of the vertex's part, where the normal cone stands still.
            inward = turned_back(T, (-normal[0], -normal[1], -normal[2]))
            # The chord of a small angle is less than the angle: the arcsine makes an angle of it again.
            if math.asin(min(_from_cone(corners.away[i], corners.arcs[i], inward), 1.0)) <= angle:
                near[i, f] = face_distance(walls, f, x) - corners.radii[i] <= limit
    return near


@compiled
def edges_at_edges(own: Ridges, other: Ridges, T: Array, reach: float, angle: float, sine: float) -> Bits:
    """Which edges (n) of one part can meet which edges (m) of another: (n, m).

    Rotation and position T (3, 4) carry the first into the frame of the others, m, up to a shift of `reach`, m, and a
    turn of `angle`, rad, about its origin.
    """
    near = np.zeros((len(own.ends), len(other.ends)), dtype=np.bool_)
    p = (T[0, 3], T[1, 3], T[2, 3])
    for i in range(near.shape[0]):
        first, last = row(own.ends[i], 0), row(own.ends[i], 1)
        limit = reach + angle * max(size(first), size(last))
        a, along = plus(turned(T, first), 1.0, p), turned(T, row(own.directions, i))
        b = plus(turned(T, last), 1.0, p)
        left, right = turned(T, row(own.arcs[i], 0)), turned(T, row(own.arcs[i], 1))
        # Contact needs a normal of one in the opposite of one of the other.
        left, right = (-left[0], -left[1], -left[2]), (-right[0], -right[1], -right[2])
        # Edges are no nearer than the balls around them.
        middle, radius = plus(a, 0.5, plus(b, -1.0, a)), _BALL * size(plus(b, -1.0, a))
        for j in range(near.shape[1]):
            c, d = row(other.ends[j], 0), row(other.ends[j], 1)
            way = plus(d, -1.0, c)
            far = plus(plus(c, 0.5, way), -1.0, middle)
            room = limit + radius + _BALL * size(way)
            if dot(far, far) > room * room:
                continue
            # Edges as good as parallel touch along a line, or at an end; vertices on faces say that.
            if size(cross(along, row(other.directions, j))) < sine:
                continue
            if segment_distance(a, b, row(other.ends[j], 0), row(other.ends[j], 1)) > limit:
                continue
            near[i, j] = arc_angle(left, right, row(other.arcs[j], 0), row(other.arcs[j], 1)) <= angle
    return near


@part
def face_distance(walls: PartWalls, face: int, x: Vector) -> float:
    """Distance from a point, in the frame of the part, to a face as a region of its plane, m."""
    normal = row(walls.normals, face)
    height = dot(normal, x) - walls.offsets[face]
    foot = plus(x, -height, normal)
    aside, round_ = np.inf, 0.0
    for s in range(walls.begun[face], walls.begun[face + 1]):
        u, v = plus(row(walls.tails, s), -1.0, foot), plus(row(walls.heads, s), -1.0, foot)
        e = plus(v, -1.0, u)
        # The foot within the edge, or the end nearest to it.
        t = min(max(-dot(u, e) / dot(e, e), 0.0), 1.0)
        aside = min(aside, size(plus(u, t, e)))
        # The angles under which the edges are seen add up to a full turn inside, and to none outside, holes included.
        round_ += math.atan2(dot(cross(u, v), normal), dot(u, v))
    return abs(height) if round_ > math.pi else math.hypot(height, aside)


@part
def segment_distance(a: Vector, b: Vector, c: Vector, d: Vector) -> float:
    """Distance between the segments from a to b and from c to d, m; the ends of each differ."""
    u, w, r = plus(b, -1.0, a), plus(d, -1.0, c), plus(a, -1.0, c)
    uu, ww, uw, ru, rw = dot(u, u), dot(w, w), dot(u, w), dot(r, u), dot(r, w)
    # The Gram determinant: next to nothing for parallel segments, where any start is as good.
    det, least = uu * ww - uw * uw, np.inf
    s = min(max((uw * rw - ww * ru) / det, 0.0), 1.0) if det > 1e-12 * uu * ww else 0.0
    # The least distance is at the clamped stationary point or has one parameter at an end.
    for start in (s, 0.0, 1.0):
        # Alternating projections: exact after one round on two lines, and cut off at the ends.
        t = min(max((uw * start + rw) / ww, 0.0), 1.0)
        s = min(max((uw * t - ru) / uu, 0.0), 1.0)
        least = min(least, size(plus(plus(r, s, u), -t, w)))
    return least


class Solid(NamedTuple):
    """A part: its vertices (n, 3), m, the radii (n,) of balls about them, m, and its faces."""

    vertices: Array
    radii: Array
    walls: PartWalls


@compiled
def distances(pairs: Indices, own: Solid, other: Solid, T: Array, T_back: Array) -> Array:
    """Distances between features (n,), m.

    Args:
        pairs: (n, 5), what each is a pair of (`VERTEX_AT_FACE`, …), and the numbers of a face, a vertex or the vertices
            of an edge of either part, those of vertices and faces twice.
        T: (3, 4), rotation and position that carry it, m.
    """
    found = np.empty(len(pairs))
    p, p_back = (T[0, 3], T[1, 3], T[2, 3]), (T_back[0, 3], T_back[1, 3], T_back[2, 3])
    for k in range(len(pairs)):
        kind, i, j, m, n = pairs[k]
        if kind == FACE_AT_VERTEX:
            # In the frame of the carried part, where its face stands still.
            found[k] = face_distance(own.walls, i, plus(turned(T_back, row(other.vertices, m)), 1.0, p_back))
        elif kind == EDGE_AT_EDGE:
            a, b = turned(T, row(own.vertices, i)), turned(T, row(own.vertices, j))
            c, d = row(other.vertices, m), row(other.vertices, n)
            found[k] = segment_distance(plus(a, 1.0, p), plus(b, 1.0, p), c, d)
        else:
            far = face_distance(other.walls, m, plus(turned(T, row(own.vertices, i)), 1.0, p))
            found[k] = abs(far - own.radii[i])
    return found


@part
def arc_distance(x: Vector, a: Vector, b: Vector) -> float:
    """Distance of a unit vector from the cone of two unit generators, 1 at most."""
    # Least squares onto two generators that are not orthogonal, by their Gram matrix.
    xa, xb, ab = dot(x, a), dot(x, b), dot(a, b)
    rest, found = max(1.0 - ab * ab, _PARALLEL), 1.0
    # Only a combination without negative weights is in the cone; else the nearest vector lies on one of its rays.
    s, t = (xa - ab * xb) / rest, (xb - ab * xa) / rest
    if s >= 0.0 and t >= 0.0 and rest > _PARALLEL:
        found = size(plus(plus(x, -s, a), -t, b))
    if xa > 0.0:
        found = min(found, size(plus(x, -xa, a)))
    if xb > 0.0:
        found = min(found, size(plus(x, -xb, b)))
    return found


@part
def arc_angle(a: Vector, b: Vector, c: Vector, d: Vector) -> float:
    """Least angle between the shorter great-circle arcs from a to b and from c to d, unit vectors, rad; π/2 if more."""
    # The arcs are nearest at an end of one of them, unless they cross.
    ends = min(arc_distance(a, c, d), arc_distance(b, c, d))
    ends = min(ends, arc_distance(c, a, b), arc_distance(d, a, b))
    # The two planes share a line; both of its directions may lie on both arcs.
    meet = cross(cross(a, b), cross(c, d))
    far = size(meet)
    if far > 0.0:
        for sign in (1.0, -1.0):
            m = (sign * meet[0] / far, sign * meet[1] / far, sign * meet[2] / far)
            if max(arc_distance(m, a, b), arc_distance(m, c, d)) < _TOGETHER:
                return 0.0
    return math.asin(min(ends, 1.0))


@part
def _from_cone(away: Array, arcs: Array, x: Vector) -> float:
    """Distance of a unit vector from the cone of a vertex' normals, 1 at most.

    It is what no edge leaves the vertex along; its boundary are arcs across the edges.
    """
    # Inside the cone where the vector leaves along no edge.
    within, least = True, 1.0
    for k in range(len(away)):
        within = within and dot(row(away, k), x) <= 0.0
    if within:
        return 0.0
    for k in range(len(away)):
        least = min(least, arc_distance(x, row(arcs[k], 0), row(arcs[k], 1)))
    return least
