"""That contacts stay inside their facets: the touching point within the face, or within both edges."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from fmopt.verify.assembly import Assembly, Touch, middle
from fmopt.verify.knowledge import other_rim, taken_turns
from fmopt.verify.motion import Motion
from fmopt.verify.rational import (
    ONE,
    Vector,
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
)
from fmopt.verify.rows import Distance, Pose, direction_along, face_above, point_above
from fmopt.verify.solids import NEAR, Plane, Shape, same

UNBOUNDED = ONE  # the margin, 1 m, of a contact that nothing bounds
_BEYOND = fixed(1e-6)
_SURELY = fixed(1e-9)  # m: by how much what takes over is farther inside
Least = Callable[[Callable[[Pose], Distance]], int]


def facet_margin(assembly: Assembly, touch: Touch, together: Sequence[Touch], motion: Motion, held: bool) -> int:
    """How far a contact stays from the boundary of its facet, m.

    Args:
        assembly: parts and contacts.
        touch: the contact.
        together: all contacts held with it.
        motion: the piece of motion.
        held: whether the contact is held along the piece; else it has just been made at the piece's end.
    """
    task = motion.task

    def least(function: Callable[[Pose], Distance]) -> int:
        goal = function(task.goal)
        return motion.lowest(function(task.start), goal) if held else motion.at_goal(goal)

    if touch.kind == "vertex-face":
        return _in_face(assembly, touch, together, least)
    if touch.kind == "edge-edge":
        return _in_edges(assembly, touch, together, least)
    return _on_moving_face(assembly, touch, least)


def _above(v: Vector, plane: Plane) -> Callable[[Pose], Distance]:
    reach = length(v)
    return lambda X: point_above(X, v, reach, plane)


def _rims(shape: Shape, face: int) -> list[tuple[int, int, Plane]] | None:
    """The edges around a face whose outline is convex, each with its inward plane; None for other faces."""
    outline = shape.faces[face].loops[0]
    rims = _across(shape, face, outline)
    if any(rim.height(shape.vertices[k]) < -NEAR for _, _, rim in rims for k in outline):
        return None
    return rims


def _across(shape: Shape, face: int, loop: Sequence[int]) -> list[tuple[int, int, Plane]]:
    """The edges of a loop of a face, each with the plane across the face that has the face in front of it."""
    planes = []
    for i, j in zip(loop, (*loop[1:], loop[0]), strict=True):
        p, q = shape.vertices[i], shape.vertices[j]
        inward = cross(shape.faces[face].plane.normal, unit(sub(q, p)))
        planes.append((i, j, Plane(inward, dot(inward, p))))
    return planes


def _beside(shape: Shape, face: int, loop: Sequence[int]) -> list[Plane]:
    """Planes across a face that have all of a hole behind them, each along one of its edges."""
    planes = (plane for _, _, plane in _across(shape, face, loop))
    return [plane for plane in planes if all(plane.height(shape.vertices[k]) <= NEAR for k in loop)]


def _in_face(assembly: Assembly, touch: Touch, together: Sequence[Touch], least: Least) -> int:
    v = touch.moving[0]
    rims = _rims(assembly.fixed, touch.face)
    if rims is None:
        return -UNBOUNDED
    found = UNBOUNDED
    for i, j, rim in rims:
        room = least(_above(v, rim))
        if room < found and not (
            _swallowed(assembly, touch.faces[0], (i, j), rim, room)
            or _slips(assembly, touch, together, (i, j), rim, room, least)
        ):
            found = room
    for hole in assembly.fixed.faces[touch.face].loops[1:]:
        beyond = [least(_above(v, plane)) for plane in _beside(assembly.fixed, touch.face, hole)]
        found = min(found, max(beyond, default=-UNBOUNDED))
    return found


def _swallowed(assembly: Assembly, wall: Plane, edge: tuple[int, int], rim: Plane, room: int) -> bool:
    """Whether the strip of the wall's plane just beyond a re-entrant edge is inside a fixed piece.

    The contact cannot leave its face there without the two parts overlapping, which the separations rule out.
    """
    if assembly.fixed.convex(*edge):
        return False
    back = scaled(max(0, -room) + _BEYOND, neg(rim.normal))
    ends = [assembly.fixed.vertices[k] for k in edge]
    strip = [*ends, *((p[0] + back[0], p[1] + back[1], p[2] + back[2]) for p in ends)]
    return any(
        all(face.plane.height(p) <= NEAR for face in piece.faces for p in strip)
        and all(face.plane.height(middle(strip)) < -NEAR for face in piece.faces)
        for piece in assembly.fixed_pieces
    )


def _slips(
    assembly: Assembly,
    touch: Touch,
    together: Sequence[Touch],
    rim_edge: tuple[int, int],
    rim: Plane,
    room: int,
    least: Least,
) -> bool:
    """Whether an edge held across the rim takes over when the vertex slips over it.

    That edge has its other end on the same wall, farther inside the rim, or properly crosses another rim of the wall;
    its line is then in the wall either way, so that edge contact and vertex contact have the same zeros.
    """
    v, wall = touch.moving[0], touch.faces[0]
    for other in together:
        if other.kind != "edge-edge" or set(other.indices[1]) != set(rim_edge):
            continue
        if not any(same(v, end) for end in other.moving):
            continue
        far = other.moving[1] if same(v, other.moving[0]) else other.moving[0]
        for partner in together:
            if (
                partner.kind == "vertex-face"
                and same(partner.moving[0], far)
                and assembly.agree(partner.faces[0], wall)
            ):
                if least(_above(far, rim)) > max(room, 0) + _SURELY:
                    return True
            elif other_rim(assembly, other, partner, wall) and _more_proper(assembly, partner, other, wall, least):
                return True
    return False


def _more_proper(assembly: Assembly, kept: Touch, waived: Touch, wall: Plane, least: Least) -> bool:
    """Whether one of two crossings of an edge with rims of a wall is certain, and more so than the other."""
    return _sides(assembly, kept, wall, least) > max(_sides(assembly, waived, wall, least), 0) + _SURELY


def _sides(assembly: Assembly, touch: Touch, along: Plane, least: Least) -> int:
    """How far the ends of a moving edge stay on different sides of the face across its fixed edge from a wall."""
    best = -UNBOUNDED
    for wall in touch.faces:
        if not assembly.agree(wall, along):
            behind = Plane(neg(wall.normal), -wall.offset)
            for a, b in (touch.moving, touch.moving[::-1]):
                best = max(best, min(least(_above(a, behind)), least(_above(b, wall))))
    return best


def _shared_wall(assembly: Assembly, touch: Touch, together: Sequence[Touch], least: Least) -> Plane | None:
    """The wall in which the edge lies whether or not it crosses here, when another contact warrants that."""
    shared = taken_turns(assembly, touch, together)
    if shared is None:
        return None
    ends = [t.moving[0] for t in together if t.kind == "vertex-face" and assembly.agree(t.faces[0], shared)]
    if all(any(same(end, p) for p in ends) for end in touch.moving):
        return shared
    rims = [t for t in together if other_rim(assembly, touch, t, shared)]
    return shared if any(_more_proper(assembly, t, touch, shared, least) for t in rims) else None


def _in_edges(assembly: Assembly, touch: Touch, together: Sequence[Touch], least: Least) -> int:
    c, d = touch.fixed
    u = touch.fixed_line.direction
    shared = _shared_wall(assembly, touch, together, least)
    best = -UNBOUNDED
    for wall in touch.faces:
        if shared is not None and assembly.agree(wall, shared):
            continue  # the edge lies in this wall and does not cross it
        for a, b in (touch.moving, touch.moving[::-1]):
            k = sub(b, a)
            sides = UNBOUNDED
            share = ONE
            if shared is None:
                behind = Plane(neg(wall.normal), -wall.offset)
                sides = min(least(_above(a, behind)), least(_above(b, wall)))
                if sides <= best:
                    continue
                rise = least(_along(wall.normal, k))
                if rise > 0:
                    share = min(ONE, over(-least(_above(a, wall)), rise) + 1)
            rooms = [sides]
            for end, direction in ((c, u), (d, neg(u))):
                room = least(_above(a, Plane(direction, dot(direction, end))))
                room += min(0, times(share, least(_along(direction, k))) - 1)
                if room < min(rooms) and not _blocked(assembly, wall, end, direction, room):
                    rooms.append(room)
            best = max(best, min(rooms))
    return best


def _along(u: Vector, k: Vector) -> Callable[[Pose], Distance]:
    reach = length(k) + 2
    return lambda X: direction_along(X, u, k, reach)


def _blocked(assembly: Assembly, wall: Plane, end: Vector, inward: Vector, room: int) -> bool:
    """Whether the fixed edge's line goes on, beyond its end, within a piece, or its face in the plane of `wall`.

    An edge that crosses the wall there would enter that piece, which the separations rule out.
    """
    back = scaled(max(0, -room) + _BEYOND, inward)
    beyond = sub(end, back)
    for piece in assembly.fixed_pieces:
        planes = [face.plane for face in piece.faces]
        flush = [plane for plane in planes if assembly.agree(plane, wall)]
        for own in (None, *flush):
            others = [plane for plane in planes if plane is not own]
            if all(p.height(end) <= NEAR for p in others) and all(p.height(beyond) < -NEAR for p in others):
                return True
    return False


def _on_moving_face(assembly: Assembly, touch: Touch, least: Least) -> int:
    w = touch.fixed[0]
    rims = _rims(assembly.moving, touch.face)
    if rims is None or len(assembly.moving.faces[touch.face].loops) > 1:
        return -UNBOUNDED
    return min(least(_body_row(rim, w)) for _, _, rim in rims)


def _body_row(plane: Plane, w: Vector) -> Callable[[Pose], Distance]:
    return lambda X: face_above(X, plane, w)
