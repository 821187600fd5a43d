"""Which points, lines and planes of the two parts are the same: exactly, and in fixed point beside it.

Whatever is concluded rests on exact incidence: of vertices, and of the lines and planes that faces or vertices span.
Pieces of a part have vertices that were cut, and may be off the part's planes and lines by `DEVIATION`. Of those it is
asked only at the end of a chain of conclusions whether they are on one side of a plane. A rigid body keeps distances:
what is no farther than that from a point that is on or above a plane is below it by no more. This loss is not handed
on, and together with what the parts deviate by, and their pieces from them, it is within the touch tolerance.

Body directions that are known to be turned onto world directions, and what follows for others, exactly.
"""

from collections.abc import Iterator, Sequence
from functools import cached_property
from typing import NamedTuple

from fmopt.verify.arithmetic.exact import (
    Level,
    Point,
    balanced,
    inner,
    level,
    one_way,
    outer,
    parallel,
    point,
    unit_of,
    way,
)
from fmopt.verify.arithmetic.rational import ONE, Vector, add, cross, dot, fixed, length, over, root, scaled, sub, times
from fmopt.verify.parts.covering import DEVIATION as COVERED
from fmopt.verify.parts.solids import DEVIATION, Line, Plane, Shape, short
from fmopt.verify.reading.document import Body, StatedPart
from fmopt.verify.remembered import remembered

_LOSSES = 32  # at most so many deviations add up, see `facet_margin` for the most of them

_STEEP = ONE >> 6  # of the squared sine between directions: less tells a turn about their axis too badly
_APART = ONE >> 4  # between the two directions that a wall and an angle leave an edge, at least twice that
_NEARLY = ONE >> 30  # of the entries of a rotation that turns axes onto axes: how far they may be from 0 or ±1
# rad: no error may be larger where an edge is known by its nominal direction; the other one is 1/4 from it.
LARGEST_ERROR = (ONE >> 3) + (ONE >> 4)


class Flush(NamedTuple):
    """A body plane that lies in a wall: in fixed point, and exactly."""

    plane: Plane
    exact: Level


class Backed(NamedTuple):
    """A face of a piece: the plane of the part that it lies in, and that plane moved out to have the piece behind."""

    wall: Plane
    cover: Plane


class Incidence:
    """The parts and their pieces, and which of their points, lines and planes are the same.

    Attributes:
        body_points: vertices of the moving part and of its pieces.
    """

    form = 0  # m: how far surfaces may lie from these, see `Assembly`

    def __init__(self, moving: StatedPart, fixed: StatedPart) -> None:
        self.moving, self.fixed = Shape(moving.body), Shape(fixed.body)
        self.moving_pieces = tuple(Shape(_sharing(piece, moving.body)) for piece in (*moving.pieces, *moving.balls))
        self.fixed_pieces = tuple(Shape(_sharing(piece, fixed.body)) for piece in fixed.pieces)
        own = (self.moving, *self.moving_pieces)
        self.body_points = tuple(dict.fromkeys(v for shape in own for v in shape.vertices))

    def blurred(self, touch: float) -> Iterator[str]:
        """What keeps fixed point from telling points and planes apart, and deviations from being tolerated."""
        # Fixed point serves as key of exact values: two of these with one key would be taken for each other.
        points = all(self._points[v] == p for v, p in self._vertices())
        if not points or any(self._levels[plane] != exact for plane, exact in self._walls()):
            yield "vertices or faces lie too close together to be told apart"
        # All deviations together stay below what the plan calls touching, which is what contacts are excused by.
        if self.moving.deviation + self.fixed.deviation + 2 * COVERED + _LOSSES * DEVIATION > fixed(touch):
            yield "parts and pieces deviate from what is proved of them by more than the touch tolerance"

    def agree(self, a: Plane, b: Plane) -> bool:
        """Whether two planes of faces of the parts are one, seen from the same side."""
        exact = self._levels.get(a)
        return exact is not None and exact == self._levels.get(b)

    def along(self, a: Plane, b: Plane) -> bool:
        """Whether two planes of faces of the parts are parallel, seen from the same side."""
        one, other = self._levels.get(a), self._levels.get(b)
        return one is not None and other is not None and one_way(one[:3], other[:3])

    def exact(self, plane: Plane) -> Level:
        """The plane of a face of the parts exactly."""
        return self._levels[plane]

    @remembered
    def backed(self, part: Shape, piece: Shape, face: int) -> Backed | None:
        """The plane of a part that a face of one of its pieces, by its index, lies in, None when it lies in none.

        Corners of the face may be off that plane by `DEVIATION`, and no vertex is farther beyond it. What is known of
        the plane is then asked of the part's, and the piece is behind that moved out to its farthest vertex.
        """
        corners = [piece.vertices[i] for i in piece.faces[face].loops[0]]
        best: tuple[int, Plane] | None = None
        for own in part.faces:
            # Facing the same way: the back of a thin wall is another face.
            if own.exact is None or dot(own.plane.normal, piece.faces[face].plane.normal) <= 0:
                continue
            off = max(abs(own.plane.height(v)) for v in corners)
            if off <= DEVIATION and (best is None or off < best[0]):
                # The nearest one, as faces of a part may be close to each other, too.
                best = off, own.plane
        if best is None:
            return None
        wall = best[1]
        cover = Plane(wall.normal, max(dot(wall.normal, v) for v in piece.vertices))
        # Its vertices may reach farther out than its face: then the plane moved out would be another one.
        return Backed(wall, cover) if cover.offset - wall.offset <= DEVIATION else None

    def point(self, v: Vector) -> Point:
        """A vertex exactly."""
        return self._points.get(v) or point(v)

    def _vertices(self) -> Iterator[tuple[Vector, Point]]:
        for shape in (self.moving, self.fixed, *self.moving_pieces, *self.fixed_pieces):
            yield from zip(shape.vertices, shape.points, strict=True)

    def _walls(self) -> Iterator[tuple[Plane, Level]]:
        for part in (self.moving, self.fixed):
            for face in part.faces:
                if face.exact is not None:
                    yield face.plane, face.exact

    @cached_property
    def _points(self) -> dict[Vector, Point]:
        return dict(self._vertices())

    @cached_property
    def _levels(self) -> dict[Plane, Level]:
        return dict(self._walls())

    def way(self, v: Vector, w: Vector) -> Vector:
        """The direction from one vertex to another, exactly."""
        return way(self.point(v), self.point(w))

    @remembered
    def holds(self, l: Line, v: Vector) -> bool:
        """Whether a vertex lies on the line of two others."""
        return parallel(self.way(l.point, l.far), self.way(l.point, v))

    def one_line(self, l: Line, other: Line) -> bool:
        """Whether two lines are the same."""
        return self.holds(l, other.point) and self.holds(l, other.far)

    @remembered
    def spanned(self, l: Line, v: Vector) -> Flush | None:
        """The plane through a line and a vertex; None where the vertex is too near the line."""
        # Too near the line for a plane: its direction would be rounding.
        if short(l.away(v)):
            return None
        normal = outer(self.way(l.point, l.far), self.way(l.point, v))
        along = unit_of(normal)
        return Flush(Plane(along, dot(along, v)), level(normal, self.point(v)))


def _sharing(piece: Body, part: Body) -> Body:
    """A piece with the exact coordinates of those of its vertices that are the part's."""
    if not part.exact or piece.balls:  # balls got theirs as they were read
        return piece
    # Pieces share corners with the part, whose exact coordinates they get; their other corners are what floats say.
    exact = {part.vertices[i]: p for i, p in part.exact.items()}
    return Body(piece.vertices, piece.faces, {n: exact[v] for n, v in enumerate(piece.vertices) if v in exact})


class Turn(NamedTuple):
    """A body direction that is known to be turned onto a world direction."""

    body: Vector
    world: Vector
    exact: Vector  # the body direction exactly
    onto: Vector | None  # the world direction exactly; None for an edge in a wall at an odd angle to a flush
    level: Vector | None  # for such an edge the normal of the wall exactly, else None

    def keeps(self, normal: Vector) -> bool:
        """Whether the world direction is level with planes of a normal."""
        if self.onto is not None:
            return inner(self.onto, normal) == 0
        return self.level is not None and parallel(self.level, normal)


def steep(one: Turn, two: Turn) -> bool:
    """Whether two directions are far enough from parallel to tell together how all is turned."""
    axis = cross(one.body, two.body)
    return dot(axis, axis) >= _STEEP


def image_of(one: Turn, two: Turn, w: Vector) -> Vector:
    """R w from two directions that R turns, w of the body, m."""
    axis, turned_axis = cross(one.body, two.body), cross(one.world, two.world)
    # Coordinates in n₁, n₂ and n₁ × n₂, by the Gram determinant: the two need not be at right angles.
    sine = dot(axis, axis)
    g = dot(one.body, two.body)
    x, y = dot(one.body, w), dot(two.body, w)
    alpha, beta = over(x - times(g, y), sine), over(y - times(g, x), sine)
    gamma = over(dot(axis, w), sine)
    return add(add(scaled(alpha, one.world), scaled(beta, two.world)), scaled(gamma, turned_axis))


def cancel(one: Turn, two: Turn, normal: Vector, d: Vector) -> bool:
    """Whether a normal is exactly across R d, for d = α n₁ + β n₂ + γ n₁ × n₂ of two directions that R turns.

    With R nᵢ = kᵢ mᵢ, kᵢ² = |nᵢ|²/|mᵢ|², it is when α k₁ (normal·m₁) + β k₂ (normal·m₂) + γ k₁ k₂ (normal·m₁ × m₂) = 0.
    The normal, of the world, and d, of the body, are integers.
    """
    n1, n2 = one.exact, two.exact
    g11, g12, g22 = inner(n1, n1), inner(n1, n2), inner(n2, n2)
    x, y = inner(n1, d), inner(n2, d)
    # Times the Gram determinant, so that all stays integer.
    alpha, beta, gamma = x * g22 - y * g12, y * g11 - x * g12, inner(outer(n1, n2), d)
    if one.onto is None or two.onto is None:
        # Of an edge's direction only the wall that it is level with is known exactly.
        crossed = any(turn.onto is not None and parallel(turn.onto, normal) for turn in (one, two))
        flat = (alpha == 0 or one.keeps(normal)) and (beta == 0 or two.keeps(normal))
        return flat and (gamma == 0 or crossed)
    m1, m2 = one.onto, two.onto
    terms = alpha * inner(m1, normal), beta * inner(m2, normal), gamma * inner(outer(m1, m2), normal)
    return balanced(*terms, (g11, inner(m1, m1)), (g22, inner(m2, m2)))


def about(along: Vector) -> tuple[Vector, Vector]:
    """Two directions across one, and across each other."""
    a, b, c = along
    # Made of two components that are not both zero.
    first = (0, c, -b) if abs(a) <= max(abs(b), abs(c)) else (c, 0, -a)
    return first, outer(along, first)


def directed(normal: Vector, w: Vector, cosine: int, nominal: Vector) -> Vector | None:
    """The unit direction level with a plane of unit normal and at a known angle to w that is nearly a nominal one.

    None where the nominal one is neither of the two that there are, or they are too near each other. w and `nominal`,
    which tells the two apart, are unit vectors.
    """
    axis = cross(normal, w)
    square = dot(axis, axis)
    if square < _STEEP:
        return None
    # Pythagoras in the plane: along the projection of w, and aside of it by the rest.
    rest = ONE - over(times(cosine, cosine), square)
    if rest < _STEEP:
        return None
    along = scaled(over(cosine, square), sub(w, scaled(dot(normal, w), normal)))
    aside = scaled(root(over(rest, square)), axis)
    for there in (add(along, aside), sub(along, aside)):
        # Two candidates, mirror images: the nominal direction is near one of them, and far from the other.
        if length(sub(there, nominal)) < _APART:
            return there
    return None


def crossing(normal: Vector, turn: Turn, edge: Vector, there: Vector, nominal: Sequence[Vector]) -> Vector | None:
    """The direction of an edge in a wall exactly, None where it is not known.

    It is when it is square to a direction that is turned exactly. It is, too, where axes are turned onto axes, as they
    are in a part that is seated, and the edge so turned is level with the wall and at the right angle exactly: of the
    two directions that are, it is the one that is near. The wall's normal and the edge, of the body, are integers.
    """
    m = turn.onto
    if m is None:
        return None
    if inner(turn.exact, edge) == 0:
        # In the wall and square to what is turned exactly: the cross product of the two, up to its sign.
        along = outer(normal, m)
        return along if inner(along, there) > 0 else (-along[0], -along[1], -along[2])
    found = _axes_turned(nominal, edge)
    if found is None or inner(found, normal) != 0:
        return None
    before, after = inner(edge, turn.exact), inner(found, m)
    # Equal cosines, by squares and signs: turned so, the edge is as long as before.
    alike = before**2 * inner(m, m) == after**2 * inner(turn.exact, turn.exact) and (before > 0) == (after > 0)
    return found if alike and length(sub(unit_of(found), there)) < _APART else None


def _axes_turned(R: Sequence[Vector], d: Vector) -> Vector | None:
    """R d exactly where R turns axes onto axes but for rounding, else None."""
    found = list[int]()
    for row in R:
        n = max(range(3), key=lambda i: abs(row[i]))
        if any(abs(abs(x) - (ONE if i == n else 0)) > _NEARLY for i, x in enumerate(row)):
            return None
        found.append(d[n] if row[n] > 0 else -d[n])
    return (found[0], found[1], found[2])
