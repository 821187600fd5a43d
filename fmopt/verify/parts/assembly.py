"""The two parts of a plan with its contacts resolved to points, lines and planes."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

from fmopt.verify.arithmetic.rational import ONE, Row, Vector, add, cross, dot, fixed, length, scaled, sub
from fmopt.verify.parts.covering import uncovered
from fmopt.verify.parts.incidence import Incidence
from fmopt.verify.parts.rows import CheckedPose, DirectionAlong, EdgesApart, FaceAbove, Function, PointAbove
from fmopt.verify.parts.solids import DEVIATION, Line, Plane, line
from fmopt.verify.reading.document import StatedContact, StatedPlan
from fmopt.verify.remembered import remembered


@dataclass(frozen=True)
class Touch:
    """A primitive contact with its geometry."""

    id: str
    kind: str
    moving: tuple[Vector, ...]  # body points
    fixed: tuple[Vector, ...]  # world points
    # Plane of the face (in the world for vertex-face, in the body for face-vertex), None for edge-edge; for ball-face
    # that on which the ball's centre is, a radius over the face
    plane: Plane | None
    # Planes of the fixed faces left and right of a fixed edge, in the world; for vertex-face and ball-face its own
    faces: tuple[Plane, ...]
    face: int  # index of the face, −1 for edge-edge
    indices: tuple[tuple[int, ...], tuple[int, ...]]

    @cached_property
    def moving_line(self) -> Line:
        """The line of the moving edge."""
        return line(*self.moving)

    @cached_property
    def fixed_line(self) -> Line:
        """The line of the fixed edge."""
        return line(*self.fixed)


class Rim(NamedTuple):
    """A face of the moving part, one edge of which is held on a rim, and how another edge meets it."""

    held: Touch
    face: Plane
    away: Vector  # unit direction in the face across the edge held, in the body
    far: int  # how far along `away` the other edge reaches, m

    def settles(self, v: Vector) -> bool:
        """Whether a body point is on the face, on the side of the other edge.

        Over the plane of the edge held and the rim its height is a part, not negative, of what `Assembly.function`
        measures. A vertex of a piece may be off that half of the face by `DEVIATION`: nothing is concluded from it but
        that it is no lower than by so much, since the body is rigid.
        """
        off = sub(v, self.held.moving[0])
        side = dot(self.away, off)
        return abs(dot(self.face.normal, off)) <= DEVIATION and (side if self.far > 0 else -side) >= -DEVIATION


@dataclass(frozen=True)
class Passage:
    """The piece to be carried through."""

    start: CheckedPose
    goal: CheckedPose
    held: tuple[tuple[Touch, Row], ...]
    made: Touch | None
    state: tuple[Touch, ...]
    goal_state: tuple[Touch, ...]  # all contacts held after the move
    share: int  # φ, the piece's share of what is left of the move; ONE on its last piece
    theta: int  # stated bound of |ε|, rad
    angles: Vector  # stated half-widths of the box of ε, rad
    box: Vector  # stated half-widths of the box of e, m
    rates: tuple[int, int]  # λ_t and λ_r
    rho: int

    @property
    def last(self) -> bool:
        """Whether the move ends with this piece."""
        return self.share == ONE

    @property
    def basis(self) -> list[Touch]:
        """The contacts of the basis, the one being made the last of them."""
        return [*(touch for touch, _ in self.held), *([] if self.made is None else [self.made])]


class PartPair(Incidence):
    """The parts, their convex pieces and the contacts of a plan.

    Attributes:
        form: how far the surfaces of both parts may lie from these, together, m.
    """

    def __init__(self, plan: StatedPlan) -> None:
        super().__init__(plan.moving, plan.fixed)
        self.form = fixed(plan.moving.form) + fixed(plan.fixed.form)
        self.touches: dict[str, Touch] = {}
        # Flaws are collected, not raised: a plan with one is judged, and found wanting, with all of them.
        self.flaws = [*self._solids(), *self.blurred(plan.touch)]
        for contact in plan.contacts:
            found = self._resolve(contact)
            if found is None:
                self.flaws.append(f"contact {contact.id} names no convex edge or whole face of the parts")
            else:
                self.touches[contact.id] = found

    def _solids(self) -> Iterator[str]:
        sides = ("moving", self.moving, self.moving_pieces), ("fixed", self.fixed, self.fixed_pieces)
        for name, part, pieces in sides:
            flaws = list(part.flaws())
            flat = [piece for piece in pieces if not piece.ball]
            # Balls are no polyhedra: they have neither faces to close nor a hull.
            for n, piece in enumerate(flat):
                flaws += [f"piece {n}: {flaw}" for flaw in piece.bulges()]
            # Whether pieces cover the part is asked of sound ones alone.
            yield from (f"{name} part: {flaw}" for flaw in flaws or uncovered(part, flat))

    @remembered
    def reach(self, v: Vector) -> int:
        """|v|, rounded up."""
        return length(v)

    def _resolve(self, contact: StatedContact) -> Touch | None:
        own = tuple(self.moving.vertices[i] for i in contact.moving)
        other = tuple(self.fixed.vertices[i] for i in contact.fixed)
        plane: Plane | None = None
        faces: tuple[Plane, ...] = ()
        face = -1
        if contact.kind in ("vertex-face", "ball-face"):
            found = self.fixed.face_of(contact.fixed)
            if found is None:
                return None
            face, plane = found, self.fixed.faces[found].plane
            faces = (plane,)
        elif contact.kind == "face-vertex":
            found = self.moving.face_of(contact.moving)
            if found is None:
                return None
            face, plane = found, self.moving.faces[found].plane
        else:
            sides = self.fixed.edge(*contact.fixed)
            # Reflex edges touch nothing first, so that no contact of them would be one.
            if sides is None or not (self.fixed.convex(*contact.fixed) and self.moving.convex(*contact.moving)):
                return None
            faces = tuple(self.fixed.faces[k].plane for k in sides)
        # Planes that are told apart from others exactly are the only ones that facts are stated of.
        if not all(self.agree(p, p) for p in (*faces, *([plane] if plane is not None else []))):
            return None
        if contact.kind == "ball-face":
            plane = over_balls(faces[0], self.moving.radii[contact.moving[0]])
        return Touch(contact.id, contact.kind, own, other, plane, faces, face, (contact.moving, contact.fixed))

    def hinge(self, touch: Touch, together: Sequence[Touch]) -> tuple[Plane, Vector, Vector] | None:
        """The hinge of an edge-edge contact: (wall φ, end a on it, other end b), or None, as of any other contact.

        When a vertex-face contact of `together` holds one end exactly on a wall through the fixed edge, the lines of
        both edges meet exactly when the other end is on that wall too.
        """
        if touch.kind != "edge-edge":
            return None
        for other in together:
            if other.kind != "vertex-face" or other.plane is None:
                continue
            # A wall through the fixed edge: where an end of the moving edge is on it, the lines can meet only there.
            if any(self.agree(other.plane, face) for face in touch.faces):
                a, b = touch.moving
                for one, two in ((a, b), (b, a)):
                    if one == other.moving[0]:
                        return other.plane, one, two
        return None

    def level(self, touch: Touch, together: Sequence[Touch]) -> Rim | None:
        """What tells that an edge meets a rim on which an edge of the same body face, listed before it, is held.

        The plane of that face has a point of the rim already, from the edge held: its other lines meet the rim exactly
        when the whole rim lies in it. Where the two edges share an end, that end is not on the rim: else the edge held
        would have no place inside its bounds, or a wall would make `touch` a hinge. Contacts come `together` in the
        order in which they are held, and those before `touch` count.
        """
        if touch.kind != "edge-edge":
            return None
        sides = self.moving.edge(*touch.indices[0])
        for other in together:
            # Contacts listed later do not count: else two edges would each be measured by the other.
            if other.id == touch.id:
                return None
            if other.kind != "edge-edge" or set(other.indices[1]) != set(touch.indices[1]):
                continue
            own = self.moving.edge(*other.indices[0])
            if own is None or sides is None or set(other.indices[0]) == set(touch.indices[0]):
                continue
            shared = set(own) & set(sides)
            # One common face: it is what both edges hold level.
            if len(shared) == 1:
                face = self.moving.faces[shared.pop()].plane
                away = cross(other.moving_line.direction, face.normal)
                # With its sign, by which `Rim.settles` tells the sides of the edge held apart.
                far = max((dot(away, sub(v, other.moving[0])) for v in touch.moving), key=abs)
                return Rim(other, face, away, far)
        return None

    def made(self, touch: Touch, held: Sequence[Touch]) -> Function:
        """The function that tells how far a contact is from being made, positive before.

        A vertex that reaches a wall while its edge is held on a rim of that wall is as high over it as the edge rises
        from the crossing to the vertex: a part, in (0, 1), of the rise of the whole edge, which its direction tells.
        """
        if touch.kind == "vertex-face":
            for other in held:
                found = self.hinge(other, (touch,))
                # As long as the crossing measures the edge: once it is hinged, its direction is what is held.
                if found is not None and self.hinge(other, held) is None:
                    k = sub(found[1], found[2])
                    return DirectionAlong(found[0].normal, k, length(k))
        return self.function(touch, held)

    def function(self, touch: Touch, together: Sequence[Touch]) -> Function:
        """The function of a contact as an equality: zero exactly while it is held, positive before it is made."""
        # In their order: of those before it a contact may be level.
        return self._function((touch.id, *(t.id for t in together)))

    @remembered
    def _function(self, ids: tuple[str, ...]) -> Function:
        touch, *together = (self.touches[one] for one in ids)
        if touch.kind in ("vertex-face", "ball-face") and touch.plane is not None:
            v = touch.moving[0]
            return PointAbove(touch.plane, v, length(v))
        if touch.kind == "face-vertex" and touch.plane is not None:
            return FaceAbove(touch.plane, touch.fixed[0])
        hinge = self.hinge(touch, together)
        if hinge is not None:
            k = sub(hinge[2], hinge[1])
            return DirectionAlong(hinge[0].normal, k, length(k))
        level = self.level(touch, together)
        if level is not None:
            along, across = level.held.fixed_line.direction, scaled(level.far, level.face.normal)
            return DirectionAlong(along, across, abs(level.far) + 2)  # of a unit normal, but for rounding
        return EdgesApart(touch.moving_line, touch.fixed_line, touch.moving[0])


def over_balls(plane: Plane, radius: int) -> Plane:
    """The plane in front of which a ball's centre is where the ball, of a radius in m, is in front of a plane."""
    return Plane(plane.normal, plane.offset + radius)


def middle(points: Sequence[Vector]) -> Vector:
    """The mean of points."""
    total: Vector = (0, 0, 0)
    for p in points:
        total = add(total, p)
    n = len(points)
    return (total[0] // n, total[1] // n, total[2] // n)


def taken_turns(assembly: PartPair, touch: Touch, held: Sequence[Touch]) -> Plane | None:
    """The wall along an edge contact's fixed edge that its moving edge lies in whether or not it still crosses there.

    Held on the wall is one end of the moving edge, and either its other end or a crossing of the same edge with another
    rim of the wall. When the end slips over the rim, the crossing there takes over from it, and both have the same
    zeros: the edge's line in the wall. None when there is no such wall.
    """
    for face in touch.faces:
        ends = [t.moving[0] for t in held if t.kind == "vertex-face" and assembly.agree(face, t.faces[0])]
        on = [end for end in touch.moving if end in ends]
        if len(on) == 2 or (on and any(other_rim(assembly, touch, other, face) for other in held)):
            return face
    return None


def other_rim(assembly: PartPair, touch: Touch, other: Touch, wall: Plane) -> bool:
    """Whether another contact has the same moving edge against another rim of the wall."""
    return (
        other.kind == "edge-edge"
        and set(other.indices[0]) == set(touch.indices[0])
        and set(other.indices[1]) != set(touch.indices[1])
        and any(assembly.agree(wall, face) for face in other.faces)
    )
