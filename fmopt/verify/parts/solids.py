"""The parts and pieces of a plan in fixed point, with their planes and edges, and what is wrong with them."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

from fmopt.verify.arithmetic.exact import area, height, inner, outer, point, rounded, through, turned_over, unit_of, way
from fmopt.verify.arithmetic.rational import (
    BITS,
    ONE,
    ArithmeticRefusal,
    Vector,
    add,
    cross,
    dot,
    doubles,
    fixed,
    length,
    over,
    scaled,
    sub,
    unit,
    vector,
)
from fmopt.verify.reading.document import Body
from fmopt.verify.reading.reader import Numbers
from fmopt.verify.remembered import remembered

ROUNDING = ONE >> 150  # more than the arithmetic's own error of a height, and less than SLACK
DEVIATION = fixed(1e-12)  # m: how far vertices of pieces may be off the planes of the part that they stand for
_OUTWARD = 64  # in fixed point: a normal is no longer than 1 by more than 16 of these, radii are up to 4 m
SHORT = fixed(1e-6)  # m: what is nearer to a line than this is not taken to span a plane with it


class Plane(NamedTuple):
    """The plane normal·x = offset, unit normal."""

    normal: Vector
    offset: int

    def height(self, point: Vector) -> int:
        """Signed distance of a point."""
        (a, b, c), offset = self
        x, y, z = point
        return ((a * x + b * y + c * z) >> BITS) - offset


class Bound(NamedTuple):
    """An edge, by its vertices, around a convex part of a face, with the plane through it across the face.

    The part is in front of that; it is `whole` where it goes along the edge's line no farther than the edge does.
    """

    i: int
    j: int
    plane: Plane
    whole: bool


class Line(NamedTuple):
    """The line from `point` along the unit vector `direction`, through `far`."""

    point: Vector
    direction: Vector
    far: Vector

    def away(self, point: Vector) -> Vector:
        """The part of a point's offset across the line."""
        d = sub(point, self.point)
        return sub(d, scaled(dot(d, self.direction), self.direction))


def near(offset: Vector) -> bool:
    """Whether an offset is no longer than `DEVIATION`."""
    a, b, c = offset
    return abs(a) <= DEVIATION and abs(b) <= DEVIATION and abs(c) <= DEVIATION and length(offset) <= DEVIATION


def short(u: Vector) -> bool:
    """Whether a vector is no longer than `SHORT`."""
    a, b, c = u
    return a * a + b * b + c * c < SHORT * SHORT


def line(a: Vector, b: Vector) -> Line:
    """The line from a to b."""
    return Line(a, unit(sub(b, a)), b)


@dataclass(frozen=True)
class ExactFace:
    """A face: its loops of vertex indices, its plane with the outward normal, and that exactly where it is flat."""

    loops: tuple[tuple[int, ...], ...]
    plane: Plane
    exact: tuple[int, int, int, int] | None


class Shape:
    """A polyhedron, exactly and in fixed point.

    Attributes:
        points: vertices exactly.
        vertices: the same in fixed point, m: where the plan states none other, these are the points themselves.
        radii: of the balls about the vertices, m, 0 of those that are points; more than planes whose normals are longer
            than 1 by rounding make of them.
    """

    def __init__(self, body: Body) -> None:
        stated = tuple(vector(v) for v in body.vertices)
        self.points = tuple(body.exact.get(i) or point(v) for i, v in enumerate(stated))
        # Exact coordinates take the place of floats where the plan states them; all else follows from the former.
        self.vertices = tuple(rounded(self.points[i]) if i in body.exact else v for i, v in enumerate(stated))
        self.deviation = max((length(sub(self.vertices[i], stated[i])) for i in body.exact), default=0)
        if self.deviation > DEVIATION:
            raise ArithmeticRefusal("exact coordinates are not those stated as floats")
        # Radii are rounded up, so that a ball in fixed point holds the ball.
        radii = {n: fixed(radius) + _OUTWARD for n, radius in body.balls}
        self.radii = tuple(radii.get(n, 0) for n in range(len(stated)))
        self.ball = bool(body.balls) and not body.faces
        self.faces = tuple(self._face(loops) for loops in body.faces)

    def _face(self, loops: tuple[tuple[int, ...], ...]) -> ExactFace:
        normal = area(self.vertices, loops)
        # The plane through three corners exactly; whether the others are in it decides whether the face is flat.
        exact = through(self.points[i] for i in loops[0])
        if exact is None or not any(normal):
            raise ArithmeticRefusal("a face has no area")
        # Newell's normal tells which way the face looks; three corners may run the other way at a dent.
        turn = inner(exact, normal)
        if turn == 0 or any(height(exact, self.points[i]) for loop in loops for i in loop):
            return ExactFace(loops, self._plane(unit_of(normal), loops[0]), None)
        exact = exact if turn > 0 else turned_over(exact)
        return ExactFace(loops, self._plane(unit_of(exact), loops[0]), exact)

    def _plane(self, normal: Vector, loop: tuple[int, ...]) -> Plane:
        offsets = [dot(normal, self.vertices[i]) for i in loop]
        # The mean, as corners in fixed point are off the plane by rounding, some on either side.
        return Plane(normal, sum(offsets) // len(offsets))

    @cached_property
    def radius(self) -> int:
        """The largest distance of a vertex, or of a point of a ball about one, from the origin."""
        return max(length(v) + r for v, r in zip(self.vertices, self.radii, strict=True))

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
        """The faces left and right of the edge from vertex i to j, or None when there is no such edge.

        From j to i it is the same edge with its faces exchanged.
        """
        left, right = self.edge_faces.get((i, j)), self.edge_faces.get((j, i))
        return None if left is None or right is None else (left, right)

    def convex(self, i: int, j: int) -> bool:
        """Whether material fills less than half a turn around the edge from vertex i to j; no edge is not convex."""
        faces = self.edge(i, j)
        if faces is None:
            return False
        n, m = (self.faces[k].exact or self.faces[k].plane.normal for k in faces)
        # The edge is convex where the turn from the left face to the right one is about the edge's own direction.
        return inner(outer(n, m), way(self.points[i], self.points[j])) > 0

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

    @remembered
    def regions(self, face: int) -> tuple[tuple[Bound, ...], ...]:
        """Convex parts of a face without its holes, each by the edges before which it lies; all of it if it is convex.

        One is taken around a point beside each corner and each edge: before edges that the point is before, the nearest
        first or the farthest, and no others that are behind one of these. Where every edge is behind one of them,
        nothing of the outline is inside, so that with the point all of it is in the face.
        """
        return tuple(dict.fromkeys(self._convex_parts(face)))

    def _convex_parts(self, face: int) -> Iterator[tuple[Bound, ...]]:
        outline = self.faces[face].loops[0]
        edges = self.across(face, outline)
        # A point in front of all of them is in the face whatever dents it has: it sees the whole outline.
        if not any(rim.height(self.vertices[k]) < -DEVIATION for _, _, rim in edges for k in outline):
            yield tuple(Bound(i, j, plane, True) for i, j, plane in edges)
            return
        behind = [
            {m for m, (i, j, _) in enumerate(edges) if all(plane.height(self.vertices[k]) <= ROUNDING for k in (i, j))}
            for _, _, plane in edges
        ]
        # A thousandth of the shortest edge beside the outline: whether that is inside is for `_winding` to say.
        short = min(length(sub(self.vertices[j], self.vertices[i])) for i, j, _ in edges)
        for n, (i, j, plane) in enumerate(edges):
            before = edges[n - 1][2].normal
            p, q = self.vertices[i], self.vertices[j]
            middle = (p[0] + q[0]) // 2, (p[1] + q[1]) // 2, (p[2] + q[2]) // 2
            for start, inward in ((middle, plane.normal), (p, add(plane.normal, before))):
                at = add(start, scaled(short >> 10, inward))
                depths = [rim.height(at) for _, _, rim in edges]
                if _winding(at, [(self.vertices[a], self.vertices[b]) for a, b, _ in edges], self.faces[face].plane):
                    for sign in (1, -1):
                        chosen = _before(depths, behind, sorted(range(len(edges)), key=lambda m: sign * depths[m]))
                        if chosen is not None:
                            yield tuple(self._bounding(edges, m, chosen) for m in sorted(chosen))

    def _bounding(self, edges: Sequence[tuple[int, int, Plane]], m: int, chosen: Sequence[int]) -> Bound:
        """An edge of a convex part of a face, and whether that goes along its line no farther than the edge does."""
        i, j, plane = edges[m]
        # Shares of the way from i to j, at which other lines cut it: 0 and 1 are the edge's ends, −1 and 2 beyond them.
        low, high = -ONE, 2 * ONE
        for n in chosen:
            at, there = (edges[n][2].height(self.vertices[k]) for k in (i, j))
            if n != m and abs(there - at) > DEVIATION:
                share = over(-at, there - at)
                low, high = (max(low, share), high) if there > at else (low, min(high, share))
        return Bound(i, j, plane, low >= -DEVIATION and high <= ONE + DEVIATION)

    def supporting(self, face: int) -> Plane:
        """The plane of a face moved out until no vertex is beyond it."""
        normal = self.faces[face].plane.normal
        return Plane(normal, max(dot(normal, v) for v in self.vertices))

    def open_edges(self) -> Iterator[str]:
        """What keeps the faces from being a closed surface seen from outside."""
        edges = [edge for face in self.faces for loop in face.loops for edge in _around(loop)]
        # Each edge is run once each way: closed, and oriented alike, which is all that a surface needs locally.
        if len(set(edges)) != len(edges) or any((j, i) not in self.edge_faces for i, j in edges):
            yield "the faces do not close: an edge is not shared by exactly two of them"
        for n, face in enumerate(self.faces):
            # Outer loops run with the area of the face, holes against it.
            normal = area(self.vertices, face.loops)
            for k, loop in enumerate(face.loops):
                if (inner(normal, area(self.vertices, [loop])) > 0) != (k == 0):
                    yield f"loop {k} of face {n} runs the wrong way round"

    def flaws(self) -> Iterator[str]:
        """What keeps the faces from being a closed surface of plane faces, each vertex exactly in the planes of its."""
        yield from self.open_edges()
        yield from (f"face {n} is not flat" for n, face in enumerate(self.faces) if face.exact is None)

    def bulges(self) -> Iterator[str]:
        """What keeps a piece from being the convex hull of its vertices, up to `DEVIATION`."""
        yield from self.open_edges()
        for n, face in enumerate(self.faces):
            if any(face.plane.height(v) > DEVIATION for v in self.vertices):
                yield f"face {n} has material on both sides"
            # Faces of pieces have one loop, see `parse`.
            if any(face.plane.height(self.vertices[i]) < -DEVIATION for i in face.loops[0]):
                yield f"face {n} is not flat"


def _before(depths: Sequence[int], behind: Sequence[set[int]], order: Sequence[int]) -> list[int] | None:
    """The edges, taken in order, that bound a convex part around a point so far before each; None if others cut it."""
    chosen: list[int] = []
    for m in order:
        if depths[m] > 0 and not any(m in behind[n] for n in chosen):
            chosen.append(m)
    return chosen if len(set(chosen).union(*(behind[n] for n in chosen))) == len(depths) else None


def _winding(at: Vector, edges: Sequence[tuple[Vector, Vector]], plane: Plane) -> bool:
    """Whether an outline in a plane goes around a point of it: how often it crosses a ray from there, one way or other.

    The ray goes along the plane, and an edge crosses it where its ends are on different sides.
    """
    # Of x and y the one that is farther from the normal: the cross product with it is not short.
    axis: Vector = (ONE, 0, 0) if abs(plane.normal[0]) <= abs(plane.normal[1]) else (0, ONE, 0)
    across = unit(cross(plane.normal, axis))
    along = cross(across, plane.normal)
    turns = 0
    for a, b in edges:
        low, high = dot(across, sub(a, at)), dot(across, sub(b, at))
        # Half-open: of a corner on the ray one edge counts where the outline crosses there, none or both where not.
        if (low > 0) != (high > 0):
            share = over(low, low - high)
            reach = dot(along, add(sub(a, at), scaled(share, sub(b, a))))
            turns += (1 if high > low else -1) if reach > 0 else 0
    return turns != 0


def _around(loop: tuple[int, ...]) -> Iterator[tuple[int, int]]:
    return zip(loop, (*loop[1:], loop[0]), strict=True)
