"""What held contacts say exactly: body points on walls, flush faces, and what follows from them.

While contacts are held, their functions are zero on every execution, not only nearly so. The height of a body point
over a wall is affine in the point: two known points of a line put the line on the wall, a line and a point off it put
a whole body plane there (a flush). A flush turns a body normal onto a known world direction; height differences along
it, and with two flushes all of them, are known numbers. So they are with one flush and an edge in another wall: it is
level with that wall and at a known angle to the flush. Nothing here uses an error set.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

from fmopt.verify.arithmetic.exact import height, inner, one_way, outer, parallel, turned_over
from fmopt.verify.arithmetic.rational import ONE, Matrix, Vector, dot, length, neg, scaled, sub, times, turned, unit
from fmopt.verify.parts.assembly import PartPair, Touch, taken_turns
from fmopt.verify.parts.incidence import Flush, Turn, about, cancel, crossing, directed, image_of, steep
from fmopt.verify.parts.solids import DEVIATION, ROUNDING, Line, Plane, line, near, short
from fmopt.verify.remembered import remembered


@dataclass
class CheckedWall:
    """A fixed plane and what is known to lie on it."""

    plane: Plane
    points: list[Vector] = field(default_factory=list)
    # Pairs of body points with an unknown point strictly between them on it
    between: list[tuple[Vector, Vector]] = field(default_factory=list)
    flush: list[Flush] = field(default_factory=list)
    # How many points, flushes and turns there were when conclusions were last looked for
    looked: tuple[int, int, int] = (0, 0, 0)
    _lines: tuple[int, int, tuple[Line, ...]] = (0, 0, ())

    def lines(self, assembly: PartPair) -> tuple[Line, ...]:
        """Body lines in the wall: two points, or an end of an edge and a point within the edge."""
        known = len(self.points), len(self.between)
        if self._lines[:2] != known:
            self._lines = *known, tuple(self._distinct(assembly))
        return self._lines[2]

    def _distinct(self, assembly: PartPair) -> list[Line]:
        pairs = [(self.points[i], self.points[j]) for i in range(len(self.points)) for j in range(i)]
        pairs += [(a, b) for a, b in self.between if a in self.points or b in self.points]
        distinct: list[Line] = []
        for a, b in pairs:
            if not any(assembly.holds(known, a) and assembly.holds(known, b) for known in distinct):
                distinct.append(line(a, b))
        return distinct


class CheckedFacts:
    """What a set of contacts, held exactly, implies.

    Their bounds (that edges cross inside) are checked elsewhere; R, a nominal rotation while they are held, only tells
    the two sides of a flush face apart.
    """

    def __init__(self, assembly: PartPair, held: Sequence[Touch], R: Matrix) -> None:
        self.assembly = assembly
        self.held = tuple(held)
        self.R = R
        self.walls: list[CheckedWall] = []
        self.turns: list[Turn] = []
        self._wholes: tuple[int, tuple[Turn, Turn] | None] = (0, None)
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
        # Each round may allow another; points, planes and turns are finitely many, and none is taken back.
        while self._grow() or self._turn_edge():
            pass

    def _wall(self, plane: Plane) -> CheckedWall:
        for wall in self.walls:
            if self.assembly.agree(wall.plane, plane):
                return wall
        self.walls.append(CheckedWall(plane))
        return self.walls[-1]

    def on(self, plane: Plane) -> CheckedWall:
        """What is known about a plane."""
        return next((w for w in self.walls if self.assembly.agree(w.plane, plane)), CheckedWall(plane))

    @staticmethod
    def _point(wall: CheckedWall, v: Vector) -> bool:
        if v in wall.points:
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
            lines = wall.lines(self.assembly)
            for l in lines:
                grown |= self._planes(wall, l)
            for v in self.assembly.body_points:
                if v not in wall.points and (
                    any(self.assembly.holds(l, v) for l in lines)
                    or any(height(flush.exact, self.assembly.point(v)) == 0 for flush in wall.flush)
                    or (self.turns and any(self.level(wall.plane, v, p) for p in wall.points))
                ):
                    grown |= self._point(wall, v)
        return grown

    def _planes(self, wall: CheckedWall, l: Line) -> bool:
        """Body planes spanned in the wall by a line and something known off it."""
        candidates = list(wall.points)
        for a, b in wall.between:
            # An unknown point between a and b is off the line, and in one plane with it, when just one end is on it.
            if (on := self.assembly.holds(l, a)) != self.assembly.holds(l, b):
                candidates.append(b if on else a)
            # So it is when both are off the line on one side of it, as those of the edge across a face are.
            elif not on and self._on_one_side(l, a, b):
                candidates.append(a)
        grown = False
        for p in candidates:
            flush = self.assembly.spanned(l, p)
            if flush is None or any(parallel(flush.exact, known.exact) for known in wall.flush):
                continue
            # A face lies in the wall with its outside towards it; which of its sides that is tells the nominal pose.
            towards = dot(turned(self.R, flush.plane.normal), wall.plane.normal)
            if towards > 0:
                flush = Flush(Plane(neg(flush.plane.normal), -flush.plane.offset), turned_over(flush.exact))
            # Nominal poses are near: what is far from flat there is no flush face but an accident of the arithmetic.
            if abs(towards) < ONE >> 1:
                continue
            wall.flush.append(flush)
            against = turned_over(self.assembly.exact(wall.plane))
            self.turns.append(Turn(flush.plane.normal, neg(wall.plane.normal), flush.exact[:3], against[:3], None))
            grown = True
        return grown

    def _on_one_side(self, l: Line, a: Vector, b: Vector) -> bool:
        """Whether two vertices are in one plane with a line that neither is on, and on one side of it, exactly."""
        along = self.assembly.way(l.point, l.far)
        return one_way(*(outer(along, self.assembly.way(l.point, v)) for v in (a, b)))

    def _turn_edge(self) -> bool:
        """Whether a body edge was found that lies in a wall and that a flush elsewhere leaves but one direction.

        Level with the wall and at a known angle to the flush there are two, apart whatever the errors are: it is the
        one that the nominal rotation says.
        """
        for touch in self.held:
            if touch.kind != "edge-edge":
                continue
            u, exact = touch.moving_line.direction, self.assembly.way(*touch.moving)
            if any(parallel(turn.exact, exact) for turn in self.turns) or self._whole is not None:
                continue
            for plane in touch.faces:
                if all(self._on_wall(plane, v) for v in touch.moving):
                    for turn in self.turns:
                        there = directed(plane.normal, turn.world, dot(turn.body, u), turned(self.R, u))
                        if there is not None:
                            normal = self.assembly.exact(plane)[:3]
                            onto = crossing(normal, turn, exact, there, self.R)
                            self.turns.append(Turn(u, there, exact, onto, normal))
                            return True
        return False

    @property
    def _whole(self) -> tuple[Turn, Turn] | None:
        """Two turns that together say how the whole body is turned, the first that do."""
        known = len(self.turns)
        if self._wholes[0] != known:
            pairs = ((self.turns[i], self.turns[j]) for i in range(known) for j in range(i))
            self._wholes = known, next((pair for pair in pairs if steep(*pair)), None)
        return self._wholes[1]

    def image(self, w: Vector) -> Vector | None:
        """R w for a body vector when the flushes and turned edges say how the whole body is turned, else None."""
        pair = self._whole
        return None if pair is None else self._image(pair, w)

    @remembered
    def _image(self, pair: tuple[Turn, Turn], w: Vector) -> Vector:
        return image_of(*pair, w)

    def keeps(self, normal: Vector, d: Vector) -> bool:
        """Whether a body direction is known to be level with planes of a normal, both given exactly, by integers.

        It is decided and not measured: either the direction is one that is turned onto one level with them, or the two
        turned directions that it is made of, and the one across them, cancel exactly.
        """
        if not any(d) or any(parallel(turn.exact, d) and turn.keeps(normal) for turn in self.turns):
            return True
        pair = self._whole
        return pair is not None and cancel(*pair, normal, d)

    def across(self, along: Vector, d: Vector) -> bool:
        """Whether a body direction is known to be across a world direction, both given exactly, by integers.

        So it is where one across it is turned onto that.
        """
        turned = (turn for turn in self.turns if turn.onto is not None and parallel(turn.onto, along))
        return any(inner(turn.exact, d) == 0 for turn in turned) or self.keeps(along, d)

    def level(self, plane: Plane, v: Vector, w: Vector) -> bool:
        """Whether two body points, m, are known to be equally high over a wall."""
        return self._level(len(self.turns), plane, v, w)  # what is open may be decided when more turns are known

    @remembered
    def _level(self, turns: int, plane: Plane, v: Vector, w: Vector) -> bool:
        # First in fixed point, which rules out nearly all; only what is left is decided exactly.
        image = self.image(sub(v, w))
        far = image is not None and abs(dot(plane.normal, image)) > ROUNDING
        return not far and self.keeps(self.assembly.exact(plane)[:3], self.assembly.way(w, v))

    def rises(self, normal: Vector, d: Vector) -> bool:
        """Whether a body vector d, m, cannot fall along a unit normal, by one known direction or by all of them.

        The vector keeps its part along the direction: it rises by that part's height less all of the rest. What the
        arithmetic is off by, `ROUNDING`, is allowed: what is taken off the rows that are left is more.
        """
        for turn in self.turns:
            along, rise = dot(turn.body, d), dot(turn.world, normal)
            rest = times(length(sub(d, scaled(along, turn.body))), length(sub(normal, scaled(rise, turn.world))))
            if times(along, rise) - rest >= -ROUNDING:
                return True
        image = self.image(d)
        return image is not None and dot(normal, image) >= -ROUNDING

    def beside(self, v: Vector, w: Vector, base: Line) -> bool:
        """Whether the vector from w to v, vertices of the moving part, m, is known to point along a world line."""
        d = self.assembly.way(w, v)
        if not any(d):
            return True
        along = self.assembly.way(base.point, base.far)
        for turn in self.turns:
            if turn.onto is not None and parallel(turn.exact, d) and parallel(turn.onto, along):
                return True
        return self._whole is not None and all(self.keeps(normal, d) for normal in about(along))

    def implies(self, touch: Touch) -> bool:
        """Whether a contact's function is zero because those of the held ones are."""
        if any(touch.id == known.id for known in self.held):
            return True
        if touch.kind == "vertex-face":
            return self._on_wall(touch.faces[0], touch.moving[0])
        assembly = self.assembly
        if touch.kind == "ball-face":
            same = (known for known in self.held if known.kind == touch.kind and known.moving == touch.moving)
            return any(assembly.agree(known.faces[0], touch.faces[0]) for known in same)
        if touch.kind == "face-vertex":
            assert touch.plane is not None
            own, w = assembly.exact(touch.plane), assembly.point(touch.fixed[0])
            return any(
                height(assembly.exact(wall.plane), w) == 0 and any(flush.exact == own for flush in wall.flush)
                for wall in self.walls
            )
        # Both ends in a wall along the fixed edge: the lines of both lie there, and meet.
        if any(self._on_wall(plane, a) and self._on_wall(plane, b) for plane in touch.faces for a, b in [touch.moving]):
            return True
        # An edge moved along the fixed line from one that meets it meets it as well.
        return any(
            known.kind == "edge-edge"
            and assembly.one_line(known.fixed_line, touch.fixed_line)
            and parallel(assembly.way(*known.moving), assembly.way(*touch.moving))
            and self.beside(touch.moving[0], known.moving[0], touch.fixed_line)
            for known in self.held
        )

    def _on_wall(self, plane: Plane, v: Vector) -> bool:
        return v in self.on(plane).points

    @remembered
    def _planes_beside(self, turns: int, plane: Plane) -> tuple[Plane, ...]:
        """Body planes that lie in a plane, as follows from a face beside them in a wall parallel to it."""
        assembly = self.assembly
        if assembly.form or not assembly.agree(plane, plane):
            return ()  # faces of a part may be off each other, or the plane is none of the parts' own
        walls = (wall for wall in self.walls if wall.flush and assembly.along(wall.plane, plane))
        flushes = ((wall.flush[0].plane, wall.plane) for wall in walls if not assembly.agree(wall.plane, plane))
        # As far behind the body plane that lies in the wall as the plane is behind the wall.
        return tuple(Plane(flush.normal, flush.offset + wall.offset - plane.offset) for flush, wall in flushes)

    def not_below(self, wall_plane: Plane, vertices: Sequence[Vector], above: Iterable[Vector]) -> set[int]:
        """Which body points are on or above a wall, given some vertices known to be on or above it.

        On a line in the wall every point is zero; on a body plane hinged there all points on the side of one that is
        not below are not below; nor are points beyond such a one, seen from a point in the wall. The points, lines and
        planes that are known to be there are exact. So is the body plane beside a face that lies in a parallel wall,
        as far from the face as the plane from the wall. The body points asked for may be vertices of pieces, off them
        by `DEVIATION`: as the body is rigid they are below the wall by no more than that, and nothing follows from
        them. All are in m.
        """
        wall = self.on(wall_plane)
        raised, beside = list(above), self._planes_beside(len(self.turns), wall_plane)
        if self.turns and raised:
            raised += [v for v in self.assembly.body_points if any(self.level(wall_plane, v, p) for p in raised)]
        lines = wall.lines(self.assembly)
        known = (*wall.points, *raised)
        done = set()
        for n, v in enumerate(vertices):
            if (
                v in known
                or any(near(sub(v, p)) for p in known)
                or any(near(l.away(v)) for l in lines)
                or any(abs(flush.plane.height(v)) <= DEVIATION for flush in wall.flush)
                or any(abs(plane.height(v)) <= DEVIATION for plane in beside)
                or any(_same_side(l, v, p) for l in lines for p in raised)
                or any(_beyond(z, v, p) for z in wall.points for p in raised)
            ):
                done.add(n)
        return done


def _same_side(l: Line, v: Vector, p: Vector) -> bool:
    """Whether v lies in the half-plane that the line bounds and p spans, up to `DEVIATION`."""
    across = l.away(p)
    if short(across):
        return False
    u, d = unit(across), l.away(v)
    t = dot(d, u)
    return t > 0 and near(sub(d, scaled(t, u)))


def _beyond(z: Vector, v: Vector, p: Vector) -> bool:
    """Whether v lies on the ray from z through p, up to `DEVIATION`."""
    if z == p:
        return False
    u = unit(sub(p, z))
    d = sub(v, z)
    t = dot(d, u)
    return t > 0 and near(sub(d, scaled(t, u)))
