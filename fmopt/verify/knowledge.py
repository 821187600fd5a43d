"""What held contacts say exactly: body points on walls, flush faces, and what follows from them.

While contacts are held, their functions are zero on every execution, not only nearly so. The height of a body point
over a wall is affine in the point: two known points of a line put the line on the wall, a line and a point off it put
a whole body plane there (a flush). A flush turns a body normal onto a known world direction; height differences along
it, and with two flushes all of them, are known numbers. So they are with one flush and an edge in another wall: it is
level with that wall and at a known angle to the flush. Nothing here uses an error set.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from functools import cached_property

from fmopt.verify.assembly import Assembly, Touch
from fmopt.verify.rational import (
    ONE,
    Matrix,
    Vector,
    add,
    cross,
    dot,
    length,
    neg,
    over,
    root,
    scaled,
    sub,
    times,
    turned,
    unit,
)
from fmopt.verify.solids import NEAR, Line, Plane, aligned, line, on_line, same, short, vanishes

_STEEP = ONE >> 6
_APART = ONE >> 4


@dataclass
class Wall:
    """A fixed plane and what is known to lie on it.

    Attributes:
        plane: the wall, normal towards the moving part.
        points: body points exactly on it.
        between: pairs of body points with an unknown point strictly between them on it.
        flush: body planes that lie in it.
        looked: how many points, flushes and turns there were when conclusions were last looked for.
    """

    plane: Plane
    points: list[Vector] = field(default_factory=list)
    between: list[tuple[Vector, Vector]] = field(default_factory=list)
    flush: list[Plane] = field(default_factory=list)
    looked: tuple[int, int, int] = (0, 0, 0)
    _lines: tuple[int, int, tuple[Line, ...]] = (0, 0, ())

    def lines(self) -> tuple[Line, ...]:
        """Body lines in the wall: two points, or an end of an edge and a point within the edge."""
        known = len(self.points), len(self.between)
        if self._lines[:2] != known:
            self._lines = *known, tuple(self._distinct())
        return self._lines[2]

    def _distinct(self) -> list[Line]:
        n = len(self.points)
        found = [line(self.points[i], self.points[j]) for i in range(n) for j in range(i)]
        for a, b in self.between:
            if any(same(p, a) or same(p, b) for p in self.points):
                found.append(line(a, b))
        distinct: list[Line] = []
        for candidate in found:
            if not any(on_line(candidate, known) for known in distinct):
                distinct.append(candidate)
        return distinct


def taken_turns(assembly: Assembly, touch: Touch, held: Sequence[Touch]) -> Plane | None:
    """The wall along an edge contact's fixed edge that its moving edge lies in whether or not it still crosses there.

    Held on the wall is one end of the moving edge, and either its other end or a crossing of the same edge with another
    rim of the wall. When the end slips over the rim, the crossing there takes over from it, and both have the same
    zeros: the edge's line in the wall. None when there is no such wall.
    """
    for face in touch.faces:
        ends = [
            other.moving[0] for other in held if other.kind == "vertex-face" and assembly.agree(face, other.faces[0])
        ]
        on = [end for end in touch.moving if any(same(end, p) for p in ends)]
        if len(on) == 2 or (on and any(other_rim(assembly, touch, other, face) for other in held)):
            return face
    return None


def other_rim(assembly: Assembly, touch: Touch, other: Touch, wall: Plane) -> bool:
    """Whether another contact has the same moving edge against another rim of the wall."""
    return (
        other.kind == "edge-edge"
        and set(other.indices[0]) == set(touch.indices[0])
        and set(other.indices[1]) != set(touch.indices[1])
        and any(assembly.agree(wall, face) for face in other.faces)
    )


class Facts:
    """What a set of contacts, held exactly, implies.

    Args:
        assembly: parts and contacts.
        held: the contacts; their bounds (that edges cross inside) are checked elsewhere.
        R: a nominal rotation while they are held; it only tells the two sides of a flush face apart.
    """

    def __init__(self, assembly: Assembly, held: Sequence[Touch], R: Matrix) -> None:
        self.assembly = assembly
        self.held = tuple(held)
        self.R = R
        self.walls: list[Wall] = []
        self.turns: list[tuple[Vector, Vector]] = []
        for touch in held:
            if touch.kind == "vertex-face":
                self._point(self._wall(touch.faces[0]), touch.moving[0])
            elif touch.kind == "edge-edge":
                shared = taken_turns(assembly, touch, held)
                if shared is not None:
                    for v in touch.moving:
                        self._point(self._wall(shared), v)
                else:
                    for plane in touch.faces:
                        self._wall(plane).between.append((touch.moving[0], touch.moving[1]))
        while self._grow() or self._turn_edge():
            pass

    def _wall(self, plane: Plane) -> Wall:
        for wall in self.walls:
            if self.assembly.agree(wall.plane, plane):
                return wall
        self.walls.append(Wall(plane))
        return self.walls[-1]

    def on(self, plane: Plane) -> Wall:
        """What is known about a plane."""
        return next((w for w in self.walls if self.assembly.agree(w.plane, plane)), Wall(plane))

    @staticmethod
    def _point(wall: Wall, v: Vector) -> bool:
        if any(same(v, p) for p in wall.points):
            return False
        wall.points.append(v)
        return True

    def _grow(self) -> bool:
        """One round of conclusions; whether anything new came of it."""
        grown = False
        for wall in self.walls:
            known = len(wall.points), len(wall.flush), len(self.turns)
            if wall.looked == known:
                continue
            wall.looked = known
            lines = wall.lines()
            for l in lines:
                grown |= self._planes(wall, l)
            for v in self.assembly.body_points:
                if (
                    any(self.assembly.holds(l, v) for l in lines)
                    or any(abs(flush.height(v)) <= NEAR for flush in wall.flush)
                    or (self.turns and any(self.level(wall.plane, v, p) for p in wall.points))
                ):
                    grown |= self._point(wall, v)
        return grown

    def _planes(self, wall: Wall, l: Line) -> bool:
        """Body planes spanned in the wall by a line and something known off it."""
        candidates = list(wall.points)
        for a, b in wall.between:
            # An unknown point between a and b is off the line, and in one plane with it, when just one end is on it.
            if (on := self.assembly.holds(l, a)) != self.assembly.holds(l, b):
                candidates.append(b if on else a)
        grown = False
        for p in candidates:
            normal = self.assembly.spanned(l, p)
            if normal is None or any(aligned(normal, known.normal) for known in wall.flush):
                continue
            if dot(turned(self.R, normal), wall.plane.normal) > 0:
                normal = neg(normal)
            if -dot(turned(self.R, normal), wall.plane.normal) < ONE >> 1:
                continue
            wall.flush.append(Plane(normal, dot(normal, p)))
            self.turns.append((normal, neg(wall.plane.normal)))
            grown = True
        return grown

    def _turn_edge(self) -> bool:
        """Whether a body edge was found that lies in a wall and that a flush elsewhere leaves but one direction.

        Level with the wall and at a known angle to the flush there are two, apart whatever the errors are: it is the
        one that the nominal rotation says.
        """
        for touch in self.held:
            if touch.kind != "edge-edge":
                continue
            u = touch.moving_line.direction
            if self.image(u) is not None:
                continue
            for plane in touch.faces:
                if all(self._on_wall(plane, v) for v in touch.moving):
                    for n, w in self.turns:
                        there = _directed(plane.normal, w, dot(n, u), turned(self.R, u))
                        if there is not None:
                            self.turns.append((u, there))
                            return True
        return False

    def image(self, w: Vector) -> Vector | None:
        """R w for a body vector whose image the flushes and turned edges fix, else None."""
        key = len(self.turns), w
        if key not in self._images:
            self._images[key] = self._image(w)
        return self._images[key]

    @cached_property
    def _images(self) -> dict[tuple[int, Vector], Vector | None]:
        return {}

    def _image(self, w: Vector) -> Vector | None:
        for n, m in self.turns:
            t = dot(n, w)
            if vanishes(sub(w, scaled(t, n))):
                return scaled(t, m)
        for i, (n1, m1) in enumerate(self.turns):
            for n2, m2 in self.turns[:i]:
                axis, turned_axis = cross(n1, n2), cross(m1, m2)
                sine = dot(axis, axis)
                if sine < _STEEP:
                    continue
                g = dot(n1, n2)
                x, y = dot(n1, w), dot(n2, w)
                alpha, beta = over(x - times(g, y), sine), over(y - times(g, x), sine)
                gamma = over(dot(axis, w), sine)
                return add(add(scaled(alpha, m1), scaled(beta, m2)), scaled(gamma, turned_axis))
        return None

    def level(self, plane: Plane, v: Vector, w: Vector) -> bool:
        """Whether two body points are known to be equally high over a plane."""
        image = self.image(sub(v, w))
        return image is not None and abs(dot(plane.normal, image)) <= NEAR

    def rises(self, normal: Vector, d: Vector) -> bool:
        """Whether a body vector d cannot fall along a unit normal, by one known direction or by all of them.

        The vector keeps its part along the direction: it rises by that part's height less all of the rest.
        """
        for n, w in self.turns:
            along, rise = dot(n, d), dot(w, normal)
            rest = times(length(sub(d, scaled(along, n))), length(sub(normal, scaled(rise, w))))
            if times(along, rise) - rest >= -NEAR:
                return True
        image = self.image(d)
        return image is not None and dot(normal, image) >= -NEAR

    def beside(self, v: Vector, w: Vector, direction: Vector) -> bool:
        """Whether the vector from w to v is known to point along a world direction."""
        if same(v, w):
            return True
        image = self.image(sub(v, w))
        return image is not None and aligned(image, direction)

    def implies(self, touch: Touch) -> bool:
        """Whether a contact's function is zero because those of the held ones are."""
        if any(touch.id == known.id for known in self.held):
            return True
        if touch.kind == "vertex-face":
            return self._on_wall(touch.faces[0], touch.moving[0])
        if touch.kind == "face-vertex":
            assert touch.plane is not None
            return any(
                abs(wall.plane.height(touch.fixed[0])) <= NEAR
                and any(self.assembly.agree(flush, touch.plane) for flush in wall.flush)
                for wall in self.walls
            )
        if any(self._on_wall(plane, a) and self._on_wall(plane, b) for plane in touch.faces for a, b in [touch.moving]):
            return True
        return any(
            known.kind == "edge-edge"
            and on_line(known.fixed_line, touch.fixed_line)
            and aligned(known.moving_line.direction, touch.moving_line.direction)
            and self.beside(touch.moving[0], known.moving[0], touch.fixed_line.direction)
            for known in self.held
        )

    def _on_wall(self, plane: Plane, v: Vector) -> bool:
        return any(same(v, p) for p in self.on(plane).points)

    def not_below(self, plane: Plane, vertices: Sequence[Vector], above: Iterable[Vector]) -> set[int]:
        """Which body points are on or above a plane, given some points known to be on or above it.

        On a line in the wall every point is zero; on a body plane hinged there all points on the side of one that is
        not below are not below; nor are points beyond such a one, seen from a point in the wall.
        """
        wall = self.on(plane)
        raised = list(above)
        raised += [v for v in vertices if any(self.level(plane, v, p) for p in raised)]
        lines = wall.lines()
        done = set()
        for n, v in enumerate(vertices):
            if (
                any(same(v, p) for p in (*wall.points, *raised))
                or any(l.holds(v) for l in lines)
                or any(abs(flush.height(v)) <= NEAR for flush in wall.flush)
                or any(_same_side(l, v, p) for l in lines for p in raised)
                or any(_beyond(z, v, p) for z in wall.points for p in raised)
            ):
                done.add(n)
        return done


def _directed(normal: Vector, w: Vector, cosine: int, nominal: Vector) -> Vector | None:
    """The unit direction level with a plane and at a known angle to w that is nearly a nominal one.

    None where the nominal one is neither of the two that there are, or they are too near each other.
    """
    axis = cross(normal, w)
    square = dot(axis, axis)
    if square < _STEEP:
        return None
    rest = ONE - over(times(cosine, cosine), square)
    if rest < _STEEP:
        return None
    along = scaled(over(cosine, square), sub(w, scaled(dot(normal, w), normal)))
    aside = scaled(root(over(rest, square)), axis)
    for there in (add(along, aside), sub(along, aside)):
        if length(sub(there, nominal)) < _APART:
            return there
    return None


def _same_side(l: Line, v: Vector, p: Vector) -> bool:
    """Whether v lies in the half-plane that the line bounds and p spans."""
    across = l.away(p)
    if short(across):
        return False
    u, d = unit(across), l.away(v)
    t = dot(d, u)
    return t > 0 and vanishes(sub(d, scaled(t, u)))


def _beyond(z: Vector, v: Vector, p: Vector) -> bool:
    """Whether v lies on the ray from z through p."""
    if same(z, p):
        return False
    u = unit(sub(p, z))
    d = sub(v, z)
    t = dot(d, u)
    return t > 0 and vanishes(sub(d, scaled(t, u)))
