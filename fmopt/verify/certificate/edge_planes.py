"""Witness planes along an edge of each of two pieces: the rows that contacts do not settle.

Contacts settle rows of their own edges, and of edges and rims beside these: a rim that two edges of a face are held on
lies in the face's plane, and one that is no farther from it than a parallel face of the part is behind that face is in
front of that. Of parts that are off their form nothing is said beside what touches.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

from fmopt.verify.arithmetic.exact import height
from fmopt.verify.arithmetic.rational import ONE, Vector, add, cross, dot, length, neg, scaled, sub, times, unit
from fmopt.verify.certificate.contact_implications import CheckedFacts
from fmopt.verify.certificate.propagation import Motion
from fmopt.verify.parts.assembly import PartPair, Rim, Touch, middle
from fmopt.verify.parts.rows import DirectionAlong, EdgesApart, Function, PointAbove
from fmopt.verify.parts.solids import DEVIATION, Line, Plane, Shape, line, near
from fmopt.verify.reading.document import StatedWitness


class CheckedLevelRim(NamedTuple):
    """A rim that contacts keep level with a face of the moving part, and from going behind it."""

    touch: Touch
    face: Plane
    held: bool  # whether the rim lies in that; else it may yet come nearer, or go away

    def before(self, w: Vector, plane: Plane) -> bool:
        """Whether a fixed point is not behind a body plane parallel to the face, as that is as far behind it at least.

        It may be by `DEVIATION`, and nothing follows from that: so far parts are off what is said of them, too.
        """
        behind = self.face.offset - plane.offset
        return behind >= -DEVIATION and length(self.touch.fixed_line.away(w)) <= behind + DEVIATION


@dataclass(frozen=True)
class Known:
    """What contacts say during the piece: facts of the held ones, and those that open or close but never pass."""

    facts: CheckedFacts
    made: Touch | None
    hinge: tuple[Plane, Vector, Vector] | None  # its hinge, when it has one among the held contacts
    leaving: tuple[Touch, ...]  # contacts that the move gives up; none of them has a hinge among the held ones
    # Planes with the body points that lay in them with the contacts given up
    coming_off: tuple[tuple[Plane, Vector], ...]

    @property
    def beside(self) -> tuple[Touch, ...]:
        """Contacts whose distances are not negative on the way."""
        return self.leaving if self.made is None else (self.made, *self.leaving)

    @property
    def all(self) -> tuple[Touch, ...]:
        """Contacts held, being made and given up."""
        return (*self.facts.held, *self.beside)

    @cached_property
    def rims(self) -> tuple[CheckedLevelRim, ...]:
        """The rims that contacts keep level with faces of the moving part.

        Two edges of a face that are held on one rim put it into the face's plane. One does where what is known of turns
        keeps the face level with the rim; where its contact is made or given up, the rim stays on the contact's side.
        """
        assembly, held = self.facts.assembly, self.facts.held
        return () if assembly.form else (*_crossed(assembly, held), *self._turned())

    def _turned(self) -> Iterator[CheckedLevelRim]:
        assembly = self.facts.assembly
        for touch in self.all:
            sides = assembly.moving.edge(*touch.indices[0]) if touch.kind == "edge-edge" else None
            # A hinged contact is made as an angle, which does not say on which side of the rim the edge stays.
            if sides is None or (touch is self.made and self.hinge is not None):
                continue
            along = assembly.way(*touch.fixed)
            for side in sides:
                face = assembly.moving.faces[side].plane
                if self.facts.across(along, assembly.exact(face)[:3]):
                    yield CheckedLevelRim(touch, face, touch in self.facts.held)

    def presses(self, assembly: PartPair, centre: Vector, plane: Plane) -> bool:
        """Whether a contact keeps the ball about a body point, m, on a plane, or from crossing it."""
        balls = (t for t in self.all if t.kind == "ball-face" and t.moving[0] == centre)
        return any(assembly.agree(t.faces[0], plane) for t in balls)

    def above(self, assembly: PartPair, plane: Plane) -> list[Vector]:
        """Body points that contacts not yet made, or given up, keep from crossing a plane, or that lay flat there."""
        points = [t.moving[0] for t in self.beside if t.kind == "vertex-face" and assembly.agree(t.faces[0], plane)]
        if self.hinge is not None and assembly.agree(self.hinge[0], plane):
            points.append(self.hinge[2])
        return points + [v for wall, v in self.coming_off if assembly.agree(wall, plane)]


def _crossed(assembly: PartPair, held: Sequence[Touch]) -> Iterator[CheckedLevelRim]:
    """Rims on which two edges of a face are held."""
    for n, touch in enumerate(held):
        for other in held[:n]:
            level = assembly.level(touch, (other,))
            if level is not None:
                yield from (CheckedLevelRim(each, level.face, True) for each in (touch, other))


def edge_rows(
    assembly: PartPair, M: Shape, F: Shape, witness: StatedWitness, motion: Motion, known: Known
) -> tuple[list[Function], int]:
    """The rows of a plane along an edge of each of two pieces that contacts do not settle, and what scales them."""
    own, other = [M.vertices[i] for i in witness.moving], [F.vertices[i] for i in witness.fixed]
    moving, base = _lines(known, own, other)
    anchors = list(_anchors(assembly, known, moving, base))
    if not anchors:
        beside = next(_beside_rims(assembly, known, M, own, other), None)
        if beside is not None:
            return _level_rows(assembly, M, F, beside, motion, known)
    a, b = moving.point, moving.far

    def lies(v: Vector) -> bool:
        """Whether a body point is on the moving edge, or beside it along the fixed one."""
        return assembly.holds(moving, v) or (not assembly.form and any(known.facts.beside(v, p, base) for p in (a, b)))

    functions: list[Function] = []
    kept = M.vertices
    if anchors:
        # Contacts of these two edges keep the moving edge on or above the plane; without one each vertex is a row.
        levels = list(_levels(assembly, known, moving, base))
        kept = tuple(
            v
            for v in M.vertices
            if not near(moving.away(v))
            and not any(known.facts.beside(v, p, base) for p in (a, b))
            and not any(level.settles(v) for level in levels)
            and not known.facts.rises(base.direction, cross(sub(v, a), moving.direction))
        )
        functions += [_relative(assembly, base.direction, cross(sub(v, a), moving.direction)) for v in kept]
    else:
        functions += [EdgesApart(moving, base, v) for v in kept]
    # Only where the edges are held to meet does the fixed one lie in the plane along both.
    turned = _turned_onto(assembly, known, base, lies) if any(anchors) else iter(())
    return [*functions, *_fixed_rows(assembly, F, motion, moving, base, turned)], _scale(motion, moving, base)


class _Beside(NamedTuple):
    """Two edges that are kept apart as a level rim and a face are: the plane of the moving one, and both lines."""

    rim: CheckedLevelRim
    plane: Plane
    moving: Line
    base: Line


def _beside_rims(
    assembly: PartPair, known: Known, M: Shape, own: Sequence[Vector], other: Sequence[Vector]
) -> Iterator[_Beside]:
    """Level rims that keep a fixed edge from going behind the plane of a face through a moving edge.

    The line of the moving edge is taken to run as the edge in touch does, through an end of it.
    """
    asked, base = line(*own), line(*other)
    for rim in known.rims:
        one = rim.touch.moving_line
        if not near(sub(one.away(own[0]), one.away(own[1]))):
            continue
        way = one.direction if dot(one.direction, asked.direction) > 0 else neg(one.direction)
        for face in assembly.moving.faces:
            if face.exact is None or not assembly.along(rim.face, face.plane):
                continue
            flat = all(abs(face.plane.height(v)) <= DEVIATION for v in own)
            behind = all(face.plane.height(v) <= DEVIATION for v in M.vertices)
            if flat and behind and all(rim.before(w, face.plane) for w in other):
                moving = Line(own[0], way, add(own[0], scaled(length(sub(own[1], own[0])), way)))
                # The contact's side is that which the witness plane is to have in front.
                turned = dot(one.direction, asked.direction) * dot(rim.touch.fixed_line.direction, base.direction)
                if rim.held or turned > 0:
                    yield _Beside(rim, face.plane, moving, base)


def _level_rows(
    assembly: PartPair, M: Shape, F: Shape, beside: _Beside, motion: Motion, known: Known
) -> tuple[list[Function], int]:
    """Rows of a plane through a moving edge and along a fixed one, which a level rim keeps from going behind it.

    Heights are relative to the moving edge on the one side and to the fixed one on the other; what lies in the plane of
    the moving edge's face is level with both.
    """
    rim, plane, moving, base = beside
    a = moving.point
    arms = [cross(sub(v, a), moving.direction) for v in M.vertices if abs(plane.height(v)) > DEVIATION]
    kept = [arm for arm in arms if not known.facts.rises(base.direction, arm)]
    functions: list[Function] = [_relative(assembly, base.direction, arm) for arm in kept]
    plain = assembly.exact(rim.face)
    turned = (
        _turned_onto(assembly, known, rim.touch.fixed_line, lambda v: height(plain, assembly.point(v)) == 0)
        if rim.held
        else iter(())
    )
    return [*functions, *_fixed_rows(assembly, F, motion, moving, base, turned)], _scale(motion, moving, base)


def _fixed_rows(
    assembly: PartPair, F: Shape, motion: Motion, moving: Line, base: Line, turns: Iterator[tuple[Vector, Plane, Plane]]
) -> Iterator[Function]:
    """The rows of a fixed piece under a plane along its edge `base` and a moving one."""
    # Vertices on the fixed edge are on the plane by its construction.
    below = {k for k, w in enumerate(F.vertices) if near(base.away(w))}
    off = [sub(w, base.point) for w in F.vertices]
    for v, inward, wall in turns:
        # The witness plane's normal R e_m × e_f has a positive part along the wall's, over the whole piece.
        if motion.lowest(_relative(assembly, cross(base.direction, wall.normal), moving.direction)) > 0:
            yield PointAbove(inward, v, assembly.reach(v))
            # A vertex of the piece that is off the wall by so much is in front of the witness plane by no more.
            along = [abs(dot(wall.normal, d)) <= DEVIATION and dot(inward.normal, d) >= -DEVIATION for d in off]
            below.update(k for k, behind in enumerate(along) if behind)
    for k, d in enumerate(off):
        if k not in below:
            yield _relative(assembly, neg(cross(base.direction, d)), moving.direction)


def _relative(assembly: PartPair, u: Vector, k: Vector) -> DirectionAlong:
    return DirectionAlong(u, k, times(assembly.reach(u), assembly.reach(k)) + 2)


def _scale(motion: Motion, moving: Line, base: Line) -> int:
    """An upper bound of |R e_m × e_f|, at most 1."""
    sines = [length(cross(X.turned(moving.direction), base.direction)) for X in (motion.task.start, motion.task.goal)]
    return min(ONE, max(sines) + motion.task.theta + motion.extent.turn)


def _lines(known: Known, own: Sequence[Vector], other: Sequence[Vector]) -> tuple[Line, Line]:
    """The lines of the edges of pieces that a witness runs along: those of edges of the parts that touch there, if any.

    The edge of a piece may be off that of its part by `DEVIATION`; the witness plane runs along the part's then, and
    vertices of the piece are on it up to that. An edge beside one in touch, which what is known of turns keeps level
    with the fixed edge from it, spans the same plane with that: it runs along the one in touch, too.
    """
    moving, base = line(*own), line(*other)
    for touch in known.all:
        if touch.kind == "edge-edge":
            one, two = touch.moving_line, touch.fixed_line
            if all(near(one.away(v)) for v in own) and all(near(two.away(w)) for w in other):
                return _along(one, moving), _along(two, base)
    for touch in known.all if not known.facts.assembly.form else ():
        if touch.kind == "edge-edge" and all(near(touch.fixed_line.away(w)) for w in other):
            one = touch.moving_line
            parallel = near(sub(one.away(own[0]), one.away(own[1])))
            if parallel and all(_level(known.facts, base.direction, cross(one.away(v), one.direction)) for v in own):
                return _along(one, moving), _along(touch.fixed_line, base)
    return moving, base


def _level(facts: CheckedFacts, along: Vector, d: Vector) -> bool:
    """Whether a body vector can neither rise nor fall along a unit direction of the world, see `Facts.rises`."""
    return facts.rises(along, d) and facts.rises(along, neg(d))


def _along(found: Line, asked: Line) -> Line:
    """A line, run through the way that another one is."""
    return found if dot(found.direction, asked.direction) > 0 else line(found.far, found.point)


def _between(assembly: PartPair, touch: Touch, moving: Line, base: Line) -> bool:
    """Whether a contact is one of just these two edges."""
    return (
        touch.kind == "edge-edge"
        and assembly.one_line(touch.moving_line, moving)
        and assembly.one_line(touch.fixed_line, base)
    )


def _anchors(assembly: PartPair, known: Known, moving: Line, base: Line) -> Iterator[bool]:
    """Contacts of just these two edges: True for a held one, False for one being made or given up."""
    for touch in known.all:
        if not _between(assembly, touch, moving, base):
            continue
        held = touch in known.facts.held
        # Same sense of both edges: the contact keeps to the side on which the witness plane has the moving piece.
        same_side = dot(touch.moving_line.direction, moving.direction) * dot(touch.fixed_line.direction, base.direction)
        hinged = touch is known.made and known.hinge is not None
        if held or (not hinged and same_side > 0):
            yield held


def _levels(assembly: PartPair, known: Known, moving: Line, base: Line) -> Iterator[Rim]:
    """Faces along the moving edge, held on the fixed one, that another edge holds level with it, or will."""
    for held in known.facts.held:
        if not _between(assembly, held, moving, base):
            continue
        for touch in known.all:
            level = assembly.level(touch, (held,))
            if level is not None:
                yield level


def _turned_onto(
    assembly: PartPair, known: Known, base: Line, lies: Callable[[Vector], bool]
) -> Iterator[tuple[Vector, Plane, Plane]]:
    """Points in the plane of both edges known to be on or above a wall along the fixed one: (point, rim plane, wall).

    The plane holds the rim and this point. With the point on or above the wall and inside its rim, the wall is behind
    the plane, and so is one parallel to it under another rim that is level with the plane. Body points that are known
    to be in the plane are told by `lies`.
    """
    for touch in known.all:
        if touch.kind != "vertex-face" or not lies(touch.moving[0]):
            continue
        wall = touch.faces[0]
        exact = assembly.exact(wall)
        # Exactly along the fixed edge: only then does the moving edge's end, turned onto it, lie in the witness plane.
        if not any(height(exact, assembly.point(w)) for w in (base.point, base.far)):
            yield touch.moving[0], _inward(touch, base, wall), wall


def _inward(touch: Touch, base: Line, wall: Plane) -> Plane:
    """The plane across a wall through a rim of it, with the wall in front."""
    # The mean of the corners tells which way is inside; what it has along the rim and off the wall is taken away.
    inward = middle([sub(w, base.point) for w in touch.fixed])
    for axis in (base.direction, wall.normal):
        inward = sub(inward, scaled(dot(axis, inward), axis))
    inward = unit(inward)
    return Plane(inward, dot(inward, base.point))
