"""The parts and pieces of a plan in fixed point, with their planes and edges, and what is wrong with them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

from fmopt.verify.document import Body, Numbers
from fmopt.verify.doubles import doubles
from fmopt.verify.rational import (
    BITS,
    ZERO3,
    Vector,
    add,
    cross,
    dot,
    fixed,
    length,
    scaled,
    sub,
    unit,
    vector,
)

NEAR = fixed(1e-11)  # m: points, lines and planes of one part closer than this are the same
SHORT = fixed(1e-6)  # m: what is nearer to a line than this spans no plane with it
_NEAR_SQUARED = NEAR * NEAR


class Plane(NamedTuple):
    """The plane normal·x = offset, unit normal."""

    normal: Vector
    offset: int

    def height(self, point: Vector) -> int:
        """Signed distance of a point."""
        (a, b, c), offset = self
        x, y, z = point
        return ((a * x + b * y + c * z) >> BITS) - offset


class Line(NamedTuple):
    """The line through `point` along the unit vector `direction`."""

    point: Vector
    direction: Vector

    def holds(self, point: Vector) -> bool:
        """Whether a point lies on the line, to `NEAR`."""
        return aligned(sub(point, self.point), self.direction)

    def away(self, point: Vector) -> Vector:
        """The part of a point's offset across the line."""
        d = sub(point, self.point)
        return sub(d, scaled(dot(d, self.direction), self.direction))

    def spanned(self, point: Vector) -> Vector | None:
        """A unit normal of the plane through the line and a point; None where the point is too near the line."""
        across = self.away(point)
        return None if short(across) else unit(cross(self.direction, unit(across)))


def short(u: Vector) -> bool:
    """Whether a vector is no longer than `SHORT`."""
    a, b, c = u
    return a * a + b * b + c * c < SHORT * SHORT


def vanishes(u: Vector) -> bool:
    """Whether a vector is no longer than `NEAR`."""
    a, b, c = u
    # Rounded up as `length` is, it is that where its square is below the square of NEAR.
    return -NEAR < a < NEAR and -NEAR < b < NEAR and -NEAR < c < NEAR and a * a + b * b + c * c < _NEAR_SQUARED


def aligned(u: Vector, v: Vector) -> bool:
    """Whether u × v is no longer than `NEAR`."""
    a, b, c = u
    x, y, z = v
    across = (b * z - c * y) >> BITS
    return -NEAR < across < NEAR and vanishes((across, (c * x - a * z) >> BITS, (a * y - b * x) >> BITS))


def line(a: Vector, b: Vector) -> Line:
    """The line from a to b."""
    return Line(a, unit(sub(b, a)))


def same(a: Vector, b: Vector) -> bool:
    """Whether two points coincide, to `NEAR`."""
    return abs(a[0] - b[0]) <= NEAR and abs(a[1] - b[1]) <= NEAR and abs(a[2] - b[2]) <= NEAR


def area_vector(points: Sequence[Vector]) -> Vector:
    """Twice the area of a closed loop, along its normal (Newell)."""
    total = ZERO3
    base = points[0]
    for p, q in pairwise(points[1:]):
        total = add(total, cross(sub(p, base), sub(q, base)))
    return total


@dataclass(frozen=True)
class Face:
    """A face: its loops of vertex indices, and its plane with the outward normal."""

    loops: tuple[tuple[int, ...], ...]
    plane: Plane


class Shape:
    """A polyhedron in fixed point.

    Attributes:
        vertices: points, m.
        faces: faces with their planes.
    """

    def __init__(self, body: Body) -> None:
        self.vertices = tuple(vector(v) for v in body.vertices)
        self.faces = tuple(Face(loops, self._plane(loops)) for loops in body.faces)
        self._rims: dict[int, list[tuple[int, int, Plane]] | None] = {}

    def _plane(self, loops: tuple[tuple[int, ...], ...]) -> Plane:
        total = ZERO3
        for loop in loops:
            total = add(total, area_vector([self.vertices[i] for i in loop]))
        normal = unit(scaled_up(total))
        outer = [dot(normal, self.vertices[i]) for i in loops[0]]
        return Plane(normal, sum(outer) // len(outer))

    @cached_property
    def radius(self) -> int:
        """The largest distance of a vertex from the origin."""
        return max(length(v) for v in self.vertices)

    @cached_property
    def lengths(self) -> tuple[int, ...]:
        """The distance of each vertex from the origin."""
        return tuple(length(v) for v in self.vertices)

    @cached_property
    def in_doubles(self) -> tuple[Numbers, ...]:
        """The floats nearest to the vertices."""
        return tuple(doubles(v) for v in self.vertices)

    @cached_property
    def edge_faces(self) -> dict[tuple[int, int], int]:
        """The face on the left of each directed edge."""
        return {edge: n for n, face in enumerate(self.faces) for loop in face.loops for edge in _around(loop)}

    def edge(self, i: int, j: int) -> tuple[int, int] | None:
        """The faces left and right of the edge from i to j, or None when there is no such edge."""
        left, right = self.edge_faces.get((i, j)), self.edge_faces.get((j, i))
        return None if left is None or right is None else (left, right)

    def convex(self, i: int, j: int) -> bool:
        """Whether material fills less than half a turn around the edge from i to j."""
        faces = self.edge(i, j)
        if faces is None:
            return False
        n, m = (self.faces[k].plane.normal for k in faces)
        return dot(cross(n, m), sub(self.vertices[j], self.vertices[i])) > 0

    def face_of(self, loop: tuple[int, ...]) -> int | None:
        """The face whose outer loop this is, from whichever vertex it starts."""
        for n, face in enumerate(self.faces):
            outer = face.loops[0]
            if len(outer) == len(loop) and loop[0] in outer:
                k = outer.index(loop[0])
                if outer[k:] + outer[:k] == loop:
                    return n
        return None

    def across(self, face: int, loop: Sequence[int]) -> list[tuple[int, int, Plane]]:
        """The edges of a loop of a face, each with the plane across the face that has the face in front of it."""
        planes = []
        for i, j in zip(loop, (*loop[1:], loop[0]), strict=True):
            p, q = self.vertices[i], self.vertices[j]
            inward = cross(self.faces[face].plane.normal, unit(sub(q, p)))
            planes.append((i, j, Plane(inward, dot(inward, p))))
        return planes

    def rims(self, face: int) -> list[tuple[int, int, Plane]] | None:
        """The edges around a face whose outline is convex, each with its inward plane; None for other faces."""
        if face not in self._rims:
            outline = self.faces[face].loops[0]
            rims = self.across(face, outline)
            cut = any(rim.height(self.vertices[k]) < -NEAR for _, _, rim in rims for k in outline)
            self._rims[face] = None if cut else rims
        return self._rims[face]

    def supporting(self, face: int) -> Plane:
        """The plane of a face moved out until no vertex is beyond it."""
        normal = self.faces[face].plane.normal
        return Plane(normal, max(dot(normal, v) for v in self.vertices))

    def flaws(self) -> Iterator[str]:
        """What keeps the faces from being a closed surface seen from outside."""
        edges = [edge for face in self.faces for loop in face.loops for edge in _around(loop)]
        if len(set(edges)) != len(edges) or any((j, i) not in self.edge_faces for i, j in edges):
            yield "the faces do not close: an edge is not shared by exactly two of them"
        for n, face in enumerate(self.faces):
            if any(abs(face.plane.height(self.vertices[i])) > NEAR for loop in face.loops for i in loop):
                yield f"face {n} is not flat"
            for k, loop in enumerate(face.loops):
                turn = dot(face.plane.normal, scaled_up(area_vector([self.vertices[i] for i in loop])))
                if (turn > 0) != (k == 0):
                    yield f"loop {k} of face {n} runs the wrong way round"

    def bulges(self) -> Iterator[str]:
        """What keeps the polyhedron from being convex."""
        for n, face in enumerate(self.faces):
            if any(face.plane.height(v) > NEAR for v in self.vertices):
                yield f"face {n} has material on both sides"


def scaled_up(u: Vector) -> Vector:
    """A vector times 2²⁰: areas of small faces are no length to normalise."""
    return (u[0] << 20, u[1] << 20, u[2] << 20)


def _around(loop: tuple[int, ...]) -> Iterator[tuple[int, int]]:
    return zip(loop, (*loop[1:], loop[0]), strict=True)


def on_line(a: Line, b: Line) -> bool:
    """Whether two lines are the same, over half a metre to `NEAR`."""
    return aligned(a.direction, b.direction) and a.holds(b.point)
