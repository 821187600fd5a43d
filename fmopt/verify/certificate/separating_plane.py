"""That a moving and a fixed piece stay on two sides of a witness plane, whatever the error does."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from fmopt.verify.arithmetic.exact import height, nearer
from fmopt.verify.arithmetic.rational import (
    ONE,
    Vector,
    add,
    cross,
    dot,
    fixed,
    length,
    neg,
    over,
    scaled,
    sub,
    times,
    unit,
    vector,
)
from fmopt.verify.certificate.contact_implications import Facts
from fmopt.verify.certificate.propagation import Motion
from fmopt.verify.parts.assembly import Assembly, Rim, Touch, over_balls
from fmopt.verify.parts.rows import DirectionAlong, Distance, EdgesApart, FaceAbove, Function, PointAbove
from fmopt.verify.parts.solids import DEVIATION, Line, Plane, Shape, line, near
from fmopt.verify.reading.document import Witness


class WitnessError(ValueError):
    """A witness that names no face or edge, or holds nothing to be checked."""


@dataclass(frozen=True)
class Known:
    """What contacts say during the piece: facts of the held ones, and those that open or close but never pass.

    Attributes:
        facts: of all contacts of the state.
        made: the basis contact that the move makes, or None.
        hinge: its hinge, when it has one among the held contacts.
        leaving: contacts that the move gives up; none of them has a hinge among the held ones.
        coming_off: planes with the body points that lay in them with the contacts given up.
    """

    facts: Facts
    made: Touch | None
    hinge: tuple[Plane, Vector, Vector] | None
    leaving: tuple[Touch, ...]
    coming_off: tuple[tuple[Plane, Vector], ...]

    @property
    def beside(self) -> tuple[Touch, ...]:
        """Contacts whose distances are not negative on the way."""
        return self.leaving if self.made is None else (self.made, *self.leaving)

    @property
    def all(self) -> tuple[Touch, ...]:
        """Contacts held, being made and given up."""
        return (*self.facts.held, *self.beside)

    def presses(self, assembly: Assembly, centre: Vector, plane: Plane) -> bool:
        """Whether a contact keeps the ball about a body point on a plane, or from crossing it.

        Args:
            assembly: the parts.
            centre: body point, m.
            plane: of a face of the fixed part.
        """
        balls = (t for t in self.all if t.kind == "ball-face" and t.moving[0] == centre)
        return any(assembly.agree(t.faces[0], plane) for t in balls)

    def above(self, assembly: Assembly, plane: Plane) -> list[Vector]:
        """Body points that contacts not yet made, or given up, keep from crossing a plane, or that lay flat there.

        Args:
            assembly: the parts.
            plane: of a face of the fixed part.
        """
        points = [t.moving[0] for t in self.beside if t.kind == "vertex-face" and assembly.agree(t.faces[0], plane)]
        if self.hinge is not None and assembly.agree(self.hinge[0], plane):
            points.append(self.hinge[2])
        return points + [v for wall, v in self.coming_off if assembly.agree(wall, plane)]


@dataclass(frozen=True)
class Apart:
    """Outcome for a pair, in fixed point: certified margin and nominal clearance, m; the row that is tightest."""

    margin: int
    clearance: int
    tightest: tuple[Distance, Distance] | None


def apart(assembly: Assembly, M: Shape, F: Shape, witness: Witness, motion: Motion, known: Known) -> Apart:
    """Margin and clearance of a witness over a piece of motion.

    Args:
        assembly: the parts.
        M, F: the moving and the fixed piece.
        witness: what the plan says keeps them apart.
        motion: the piece of motion.
        known: what the contacts held, made and given up say.

    Raises:
        WitnessError: see there.
    """
    scale = ONE
    if witness.kind == "edges":
        functions, scale = _edge_rows(assembly, M, F, witness, motion, known)
    elif witness.kind == "moving-face":
        functions = _moving_face_rows(assembly, M, F, witness, known)
    else:
        functions = _fixed_plane_rows(assembly, M, F, witness, known)
    # A plane that contacts settle altogether proves nothing by itself: there must be a distance to speak of.
    if not functions:
        raise WitnessError("every row is excused")
    clearance = min([motion.nominal(function) for function in functions])
    margin, tightest = least(motion, functions)
    # Rows of edges are not of unit normal: divided by an upper bound of its length, the margin stays a lower bound.
    if scale != ONE:
        margin, clearance = over(margin, scale), over(clearance, scale)
    return Apart(margin, clearance, tightest)


def least(motion: Motion, functions: Sequence[Function]) -> tuple[int, tuple[Distance, Distance]]:
    """The least certified bound of functions, with the row of the one that has it.

    Those that the errors' box keeps far away are not looked at closely.

    Args:
        motion: the piece.
        functions: one or more.
    """
    # The quick bounds are not above the exact ones, so that in their order the search can stop.
    quick = sorted([(motion.far(function), k) for k, function in enumerate(functions)])
    tightest = functions[quick[0][1]]
    margin = motion.lowest(tightest)
    for far, k in quick[1:]:
        if far >= margin:
            break
        found = motion.lowest(functions[k])
        if found < margin:
            margin, tightest = found, functions[k]
    return margin, motion.ends(tightest)


def _face(shape: Shape, loop: tuple[int, ...]) -> int:
    found = shape.face_of(loop) if len(loop) >= 3 else None
    if found is None:
        raise WitnessError("names no face of the piece")
    return found


def _fixed_plane_rows(assembly: Assembly, M: Shape, F: Shape, witness: Witness, known: Known) -> list[Function]:
    done: set[int] = set()
    if witness.kind == "plane":
        normal = vector(witness.normal)
        size = length(normal)
        # Stated in doubles it is nearly of unit length; far from that it is no normal.
        if abs(size - ONE) > ONE >> 1:
            raise WitnessError("has no unit normal")
        n = unit(normal)
        # Moved out to have the whole fixed piece behind it, wherever the plan puts it.
        plane = Plane(n, max(over(fixed(witness.offset), size), *(dot(n, w) for w in F.vertices)))
    elif M.ball:
        face = _face(F, witness.fixed)
        plane, backed = F.supporting(face), assembly.backed(assembly.fixed, F, face)
        if backed is not None and known.presses(assembly, M.vertices[0], backed.wall):
            # The contact settles the ball's row; what is left to say is that its centre is on this side.
            return [PointAbove(backed.cover, M.vertices[0], M.lengths[0])]
    else:
        face = _face(F, witness.fixed)
        plane, backed = F.supporting(face), assembly.backed(assembly.fixed, F, face)
        # Only where the piece's face is one of the part's do contacts say anything about it.
        if backed is not None:
            done = known.facts.not_below(backed.wall, M.vertices, known.above(assembly, backed.wall))
            plane = backed.cover if done else plane
    kept = [k for k in range(len(M.vertices)) if k not in done]
    if M.ball:
        plane = over_balls(plane, M.radii[0])
    return [PointAbove(plane, M.vertices[k], M.lengths[k]) for k in kept]


def _moving_face_rows(assembly: Assembly, M: Shape, F: Shape, witness: Witness, known: Known) -> list[Function]:
    face = _face(M, witness.moving)
    plane, backed = M.supporting(face), assembly.backed(assembly.moving, M, face)
    done: set[int] = set()
    if backed is not None:
        touching = [t for t in known.all if t.kind == "face-vertex" and t.plane is not None]
        on = [t.fixed[0] for t in touching if t.plane is not None and assembly.agree(t.plane, backed.wall)]
        done = {k for k, w in enumerate(F.vertices) if any(near(sub(w, x)) for x in on)}
        for rim in level_rims(assembly, known):
            if rim.held and assembly.along(rim.face, backed.wall):
                done |= {k for k, w in enumerate(F.vertices) if rim.before(assembly, w, backed.wall)}
        plane = backed.cover if done else plane
    return [FaceAbove(plane, w) for k, w in enumerate(F.vertices) if k not in done]


class LevelRim(NamedTuple):
    """A rim that contacts keep level with a face of the moving part, and from going behind it.

    Attributes:
        touch: the contact of an edge of the face on it.
        face: the plane of the face, in the body.
        held: whether the rim lies in that; else it may yet come nearer, or go away.
    """

    touch: Touch
    face: Plane
    held: bool

    def before(self, assembly: Assembly, w: Vector, plane: Plane) -> bool:
        """Whether a fixed point is not behind a body plane parallel to the face, as that is as far behind it at least.

        A vertex of a piece may be off an edge of the part by `DEVIATION`: what holds of the whole edge is then said of
        it, and nothing follows from that.
        """
        exact = assembly.exact(self.face), assembly.exact(plane)
        ends = assembly.point(self.touch.fixed[0]), assembly.point(self.touch.fixed[1])
        return any(nearer(p, *ends, *exact) for p in assembly.edge_near(w, self.touch.fixed_line))


def level_rims(assembly: Assembly, known: Known) -> list[LevelRim]:
    """The rims that contacts keep level with faces of the moving part.

    Two edges of a face that are held on one rim put it into the face's plane. One does where what is known of turns
    keeps the face level with the rim; where its contact is made or given up, the rim stays on the contact's side.
    """
    held, found = known.facts.held, list[LevelRim]()
    for n, touch in enumerate(held):
        for other in held[:n]:
            level = assembly.level(touch, (other,))
            if level is not None:
                found += [LevelRim(touch, level.face, True), LevelRim(other, level.face, True)]
    for touch in known.all:
        sides = assembly.moving.edge(*touch.indices[0]) if touch.kind == "edge-edge" else None
        if sides is None or (touch is known.made and known.hinge is not None):
            continue
        along = assembly.way(*touch.fixed)
        for side in sides:
            face = assembly.moving.faces[side].plane
            if known.facts.keeps(along, assembly.exact(face)[:3]):
                found.append(LevelRim(touch, face, touch in held))
    return found


def _edge_rows(
    assembly: Assembly, M: Shape, F: Shape, witness: Witness, motion: Motion, known: Known
) -> tuple[list[Function], int]:
    own, other = [M.vertices[i] for i in witness.moving], [F.vertices[i] for i in witness.fixed]
    moving, base = _lines(known, own, other)
    anchors = list(_anchors(assembly, known, moving, base))
    if not anchors:
        beside = next(_beside_rims(assembly, known, M, own, other), None)
        if beside is not None:
            return _level_rows(assembly, M, F, beside, motion, known)
    a, b = moving.point, moving.far
    functions: list[Function] = []
    kept = M.vertices
    if anchors:
        # Contacts of these two edges keep the moving edge on or above the plane; without one each vertex is its own
        # row.
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
    # Vertices on the fixed edge are on the plane by its construction.
    below = {k for k, w in enumerate(F.vertices) if near(base.away(w))}
    if any(held for held in anchors):
        for v, inward, wall in _turned_onto(assembly, known, moving, base):
            if _outside(assembly, motion, moving, base, wall):
                functions.append(PointAbove(inward, v, assembly.reach(v)))
                # A vertex of the piece that is off the wall by so much is in front of the witness plane by no more.
                below |= {
                    k
                    for k, w in enumerate(F.vertices)
                    if abs(wall.height(w)) <= DEVIATION and inward.height(w) >= -DEVIATION
                }
    for k, w in enumerate(F.vertices):
        if k not in below:
            functions.append(_relative(assembly, neg(cross(base.direction, sub(w, base.point))), moving.direction))
    return functions, _scale(motion, moving, base)


class _Beside(NamedTuple):
    """Two edges that are kept apart as a level rim and a face are: the plane of the moving one, and both lines."""

    rim: LevelRim
    plane: Plane
    moving: Line
    base: Line


def _beside_rims(
    assembly: Assembly, known: Known, M: Shape, own: Sequence[Vector], other: Sequence[Vector]
) -> Iterator[_Beside]:
    """Level rims that keep a fixed edge from going behind the plane of a face through a moving edge.

    The line of the moving edge is taken to run as the edge in touch does, through an end of it.
    """
    asked, base = line(*own), line(*other)
    for rim in level_rims(assembly, known):
        one = rim.touch.moving_line
        way = one.direction if dot(one.direction, asked.direction) > 0 else neg(one.direction)
        for face in assembly.moving.faces:
            if face.exact is None or not assembly.along(rim.face, face.plane):
                continue
            flat = all(abs(face.plane.height(v)) <= DEVIATION for v in own)
            behind = all(face.plane.height(v) <= DEVIATION for v in M.vertices)
            if flat and behind and all(rim.before(assembly, w, face.plane) for w in other):
                moving = Line(own[0], way, add(own[0], scaled(length(sub(own[1], own[0])), way)))
                # The contact's side is that which the witness plane is to have in front.
                turned = dot(one.direction, asked.direction) * dot(rim.touch.fixed_line.direction, base.direction)
                if rim.held or turned > 0:
                    yield _Beside(rim, face.plane, moving, base)


def _level_rows(
    assembly: Assembly, M: Shape, F: Shape, beside: _Beside, motion: Motion, known: Known
) -> tuple[list[Function], int]:
    """Rows of a plane through a moving edge and along a fixed one, which a level rim keeps from going behind it.

    Heights are relative to the moving edge on the one side and to the fixed one on the other; what lies in the plane of
    the moving edge's face is level with both.
    """
    rim, plane, moving, base = beside
    a = moving.point
    kept = [v for v in M.vertices if abs(plane.height(v)) > DEVIATION]
    functions: list[Function] = [_relative(assembly, base.direction, cross(sub(v, a), moving.direction)) for v in kept]
    below = {k for k, w in enumerate(F.vertices) if near(base.away(w))}
    for v, inward, wall in _turned_beside(assembly, known, rim) if rim.held else ():
        if _outside(assembly, motion, moving, base, wall):
            functions.append(PointAbove(inward, v, assembly.reach(v)))
            way = inward.normal
            below |= {
                k
                for k, w in enumerate(F.vertices)
                if abs(dot(wall.normal, sub(w, base.point))) <= DEVIATION and dot(way, sub(w, base.point)) >= -DEVIATION
            }
    for k, w in enumerate(F.vertices):
        if k not in below:
            functions.append(_relative(assembly, neg(cross(base.direction, sub(w, base.point))), moving.direction))
    return functions, _scale(motion, moving, base)


def _turned_beside(assembly: Assembly, known: Known, rim: LevelRim) -> Iterator[tuple[Vector, Plane, Plane]]:
    """Vertices of a face with a rim in its plane that are on or above a wall along the rim, as `_turned_onto`."""
    base = rim.touch.fixed_line
    for touch in known.all:
        if touch.kind != "vertex-face" or height(assembly.exact(rim.face), assembly.point(touch.moving[0])):
            continue
        wall = touch.faces[0]
        if not any(height(assembly.exact(wall), assembly.point(w)) for w in rim.touch.fixed):
            yield touch.moving[0], _inward(touch, base, wall), wall


def _relative(assembly: Assembly, u: Vector, k: Vector) -> DirectionAlong:
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
    for touch in known.all:
        if touch.kind == "edge-edge" and all(near(touch.fixed_line.away(w)) for w in other):
            one = touch.moving_line
            if all(_level(known.facts, base.direction, cross(one.away(v), one.direction)) for v in own):
                return _along(one, moving), _along(touch.fixed_line, base)
    return moving, base


def _level(facts: Facts, along: Vector, d: Vector) -> bool:
    """Whether a body vector can neither rise nor fall along a unit direction of the world, see `Facts.rises`."""
    return facts.rises(along, d) and facts.rises(along, neg(d))


def _along(found: Line, asked: Line) -> Line:
    """A line, run through the way that another one is."""
    return found if dot(found.direction, asked.direction) > 0 else line(found.far, found.point)


def _between(assembly: Assembly, touch: Touch, moving: Line, base: Line) -> bool:
    """Whether a contact is one of just these two edges."""
    return (
        touch.kind == "edge-edge"
        and assembly.one_line(touch.moving_line, moving)
        and assembly.one_line(touch.fixed_line, base)
    )


def _anchors(assembly: Assembly, known: Known, moving: Line, base: Line) -> Iterator[bool]:
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


def _levels(assembly: Assembly, known: Known, moving: Line, base: Line) -> Iterator[Rim]:
    """Faces along the moving edge, held on the fixed one, that another edge holds level with it, or will."""
    for held in known.facts.held:
        if not _between(assembly, held, moving, base):
            continue
        for touch in known.all:
            level = assembly.level(touch, (held,))
            if level is not None:
                yield level


def _turned_onto(assembly: Assembly, known: Known, moving: Line, base: Line) -> Iterator[tuple[Vector, Plane, Plane]]:
    """Points in the plane of both edges known to be on or above a wall along the fixed one: (point, rim plane, wall).

    The witness plane holds the fixed edge and this point. With the point on or above the wall and inside its rim, the
    wall is behind the plane.
    """
    for touch in known.all:
        if touch.kind != "vertex-face" or not _in_plane(assembly, known, moving, base, touch.moving[0]):
            continue
        wall = touch.faces[0]
        exact = assembly.exact(wall)
        # Exactly along the fixed edge: only then does the end of the moving edge, turned onto it, lie in the witness
        # plane.
        if any(height(exact, assembly.point(w)) for w in (base.point, base.far)):
            continue
        yield touch.moving[0], _inward(touch, base, wall), wall


def _inward(touch: Touch, base: Line, wall: Plane) -> Plane:
    """The plane across a wall through a rim of it, with the wall in front."""
    total: Vector = (0, 0, 0)
    for w in touch.fixed:
        total = add(total, sub(w, base.point))
    n = len(touch.fixed)
    inward = (total[0] // n, total[1] // n, total[2] // n)
    for axis in (base.direction, wall.normal):
        inward = sub(inward, scaled(dot(axis, inward), axis))
    inward = unit(inward)
    return Plane(inward, dot(inward, base.point))


def _in_plane(assembly: Assembly, known: Known, moving: Line, base: Line, v: Vector) -> bool:
    """Whether a body point is known to lie in the plane of both edges: on the moving one, or beside it along the other.

    The moving edge is one of a contact that is held.
    """
    return assembly.holds(moving, v) or any(known.facts.beside(v, p, base) for p in (moving.point, moving.far))


def _outside(assembly: Assembly, motion: Motion, moving: Line, base: Line, wall: Plane) -> bool:
    """Whether the witness plane's normal R e_m × e_f has a positive part along the wall's, over the whole piece."""
    return motion.lowest(_relative(assembly, cross(base.direction, wall.normal), moving.direction)) > 0
