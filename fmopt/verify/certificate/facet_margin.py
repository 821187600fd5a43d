"""That contacts stay inside their facets: the touching point within the face, or within both edges."""

from collections.abc import Sequence
from itertools import islice
from typing import NamedTuple

from fmopt.verify.arithmetic.rational import ONE, Vector, add, dot, fixed, neg, over, scaled, sub, times, unit
from fmopt.verify.certificate.propagation import Motion
from fmopt.verify.parts.assembly import PartPair, Touch, middle, other_rim, taken_turns
from fmopt.verify.parts.rows import DirectionAlong, FaceAbove, Function, PointAbove
from fmopt.verify.parts.solids import DEVIATION, ROUNDING, Bound, Plane, Shape

UNBOUNDED = ONE  # the margin, 1 m, of a contact that nothing bounds
_BEYOND = fixed(1e-6)  # of a blocked rim: material has to go on behind it for that far
_SURELY = fixed(1e-9)  # m: by how much what takes over is farther inside


class _Way(NamedTuple):
    """Where a contact is held: along a whole piece of motion, or just at its end, where it has been made."""

    motion: Motion
    whole: bool

    def above(self, v: Vector, plane: Plane) -> PointAbove:
        """How high a body point is above a plane."""
        return PointAbove(plane, v, self.motion.assembly.reach(v))

    def along(self, u: Vector, k: Vector) -> DirectionAlong:
        """How far a body vector goes along a unit vector."""
        return DirectionAlong(u, k, self.motion.assembly.reach(k) + 2)

    def least(self, function: Function) -> int:
        """Certified lower bound of a function."""
        return self.motion.lowest(function) if self.whole else self.motion.at_goal(function)[0]

    def most(self, function: Function) -> int:
        """Certified upper bound of a function."""
        return self.motion.highest(function) if self.whole else self.motion.at_goal(function)[1]

    def nominal(self, function: Function) -> tuple[int, int]:
        """The least and the greatest of a function's values at nominal poses, which `least` and `most` lie around."""
        values = function.value(self.motion.task.start), function.value(self.motion.task.goal)
        return (min(values), max(values)) if self.whole else (values[1], values[1])

    def quick(self, function: Function) -> tuple[int, int]:
        """What `least` is not below, and `most` not above, by the box around the errors."""
        low, high = self.nominal(function)
        blur = self.motion.blur(function)
        return low - blur, high + blur


def facet_margin(assembly: PartPair, touch: Touch, together: Sequence[Touch], motion: Motion, held: bool) -> int:
    """How far a contact stays from the boundary of its facet, m, held along the piece or else just made at its end."""
    way = _Way(motion, held)
    if assembly.form and any(touch.id == own.id for own in motion.task.basis):
        # The crossing of another rim says the same only nearly. That an end of the edge is on the wall is enough.
        together = [other for other in together if other.kind == "vertex-face"]
    if touch.kind in ("vertex-face", "ball-face"):  # a ball touches where its centre is over the face
        # In any of the convex parts is in the face: the one that leaves most room counts.
        regions = assembly.fixed.regions(touch.face)
        return max((_in_region(assembly, touch, together, region, way) for region in regions), default=-UNBOUNDED)
    if touch.kind == "edge-edge":
        return _in_edges(assembly, touch, together, way)
    return _on_moving_face(assembly, touch, way)


def _beside(shape: Shape, face: int, loop: Sequence[int]) -> list[Plane]:
    """Planes across a face that have all of a hole behind them, each along one of its edges or next to it."""
    found = []
    for _, _, plane in shape.across(face, loop):
        beyond = max(plane.height(shape.vertices[k]) for k in loop)
        # Only edges with the whole hole behind them: the point is outside the hole if in front of one such plane.
        if beyond <= DEVIATION:
            found.append(Plane(plane.normal, plane.offset + max(0, beyond)))
    return found


def _in_region(assembly: PartPair, touch: Touch, together: Sequence[Touch], region: Sequence[Bound], way: _Way) -> int:
    """How far a point is from the edges of a convex part of its face, and beyond the holes of that."""
    v, found, walled = touch.moving[0], UNBOUNDED, False
    for i, j, rim, whole in region:
        above = way.above(v, rim)
        # The quick bound is never above the exact one: a rim that it puts farther away cannot bind.
        if way.quick(above)[0] >= found:
            continue
        room = way.least(above)
        # Where the part goes on along the line beyond the edge there is more of the face behind it, not a wall.
        if room < found and whole and _swallowed(assembly, (i, j), rim, room):
            walled = True
        elif room < found and not (whole and _slips(assembly, touch, together, (i, j, rim), room, way)):
            found = room
    for hole in assembly.fixed.faces[touch.face].loops[1:]:
        beyond = [way.least(way.above(v, plane)) for plane in _beside(assembly.fixed, touch.face, hole)]
        found = min(found, max(beyond, default=-UNBOUNDED))
    return min(found, 0) if walled and found <= _SURELY else found  # walls are looked at so far from other rims


def _swallowed(assembly: PartPair, edge: tuple[int, int], rim: Plane, room: int) -> bool:
    """Whether the strip of the wall's plane just beyond a re-entrant edge is inside a fixed piece.

    The contact cannot leave its face there without the two parts overlapping, which the separations rule out.
    """
    if assembly.fixed.convex(*edge):
        # Beyond a convex edge there is nothing.
        return False
    # As far as the point may get, and so much on that rounding does not decide.
    far = max(0, -room) + _BEYOND
    back = scaled(far, neg(rim.normal))
    a, b = (assembly.fixed.vertices[k] for k in edge)
    # A little within the ends of the edge, where rounding does not decide.
    inwards = scaled(_SURELY, unit(sub(b, a)))
    ends = [add(a, inwards), sub(b, inwards)]
    strip = [*ends, *(add(p, back) for p in ends)]
    # One convex piece has to hold the whole strip: of two, each with a part, the seam would have to be looked at.
    return any(all(_behind(face.plane, strip, far) for face in piece.faces) for piece in assembly.fixed_pieces)


def _behind(plane: Plane, strip: Sequence[Vector], far: int) -> bool:
    """Whether a strip is behind a face of a piece: its two ends, and the same so far on.

    Where the face is off the ends by `DEVIATION`, the strip goes down from it by a sixteenth at least, so that it is
    behind after sixteen times as much.
    """
    heights = [plane.height(p) for p in strip]
    # Flush with a face is behind it, as long as the strip is not in that face altogether.
    if max(heights) <= ROUNDING:
        return plane.height(middle(strip)) < -ROUNDING
    return max(heights[:2]) <= DEVIATION and max(heights[2:]) <= -(far >> 4)


def _slips(
    assembly: PartPair, touch: Touch, together: Sequence[Touch], across: tuple[int, int, Plane], room: int, way: _Way
) -> bool:
    """Whether an edge held across the rim takes over when the vertex slips over it.

    That edge has its other end on the same wall, farther inside the rim, or properly crosses another rim of the wall;
    its line is then in the wall either way, so that edge contact and vertex contact have the same zeros.
    """
    v, wall, (i, j, rim) = touch.moving[0], touch.faces[0], across
    for other in together:
        if other.kind != "edge-edge" or set(other.indices[1]) != {i, j}:
            continue
        if v not in other.moving:
            continue
        far = other.moving[1] if v == other.moving[0] else other.moving[0]
        for partner in together:
            if partner.kind == "vertex-face" and partner.moving[0] == far and assembly.agree(partner.faces[0], wall):
                # By more than rounding, so that no other arithmetic decides otherwise.
                if way.least(way.above(far, rim)) > max(room, 0) + _SURELY:
                    return True
            elif other_rim(assembly, other, partner, wall) and _more_proper(assembly, partner, other, wall, way):
                return True
    return False


def _more_proper(assembly: PartPair, kept: Touch, waived: Touch, wall: Plane, way: _Way) -> bool:
    """Whether one of two crossings of an edge with rims of a wall is certain, and more so than the other."""
    return _sides(assembly, kept, wall, way) > max(_sides(assembly, waived, wall, way), 0) + _SURELY


def _sides(assembly: PartPair, touch: Touch, along: Plane, way: _Way) -> int:
    """How far the ends of a moving edge stay on different sides of the face across its fixed edge from a wall."""
    walls = [wall for wall in touch.faces if not assembly.agree(wall, along)]
    best = -UNBOUNDED
    for crossing in _crossings(touch, walls, way):
        # In the order of what they can be at most: the rest cannot be better.
        if crossing.most <= best:
            break
        best = max(best, crossing.sides(way))
    return best


class _Crossing(NamedTuple):
    """A moving edge from its end a behind a wall to its end b above it; `most` is what `sides` is below."""

    most: int
    wall: Plane
    a: Vector
    b: Vector

    def sides(self, way: _Way) -> int:
        """How far both ends stay on their sides."""
        above = way.above(self.b, self.wall)
        found = -way.most(way.above(self.a, self.wall))
        return found if way.quick(above)[0] >= found else min(found, way.least(above))

    def share(self, way: _Way) -> int:
        """How much of the edge is behind the wall, at most."""
        rise = way.least(way.along(self.wall.normal, sub(self.b, self.a)))
        # Rounded up by one unit, so that the share is an upper bound.
        return min(ONE, over(-way.least(way.above(self.a, self.wall)), rise) + 1) if rise > 0 else ONE


def _crossings(touch: Touch, walls: Sequence[Plane], way: _Way) -> list[_Crossing]:
    """The ways in which a moving edge may cross walls, the most likely first."""
    found = []
    for wall in walls:
        (a, low), (b, high) = ((v, way.nominal(way.above(v, wall))) for v in touch.moving)
        found += [_Crossing(min(-low[1], high[0]), wall, a, b), _Crossing(min(-high[1], low[0]), wall, b, a)]
    return sorted(found, key=lambda crossing: -crossing.most)


def _shared_wall(assembly: PartPair, touch: Touch, together: Sequence[Touch], way: _Way) -> Plane | None:
    """The wall in which the edge lies whether or not it crosses here, when another contact warrants that."""
    shared = taken_turns(assembly, touch, together)
    if shared is None:
        return None
    ends = [t.moving[0] for t in together if t.kind == "vertex-face" and assembly.agree(t.faces[0], shared)]
    if all(end in ends for end in touch.moving):
        return shared
    rims = [t for t in together if other_rim(assembly, touch, t, shared)]
    return shared if any(_more_proper(assembly, t, touch, shared, way) for t in rims) else None


def _in_edges(assembly: PartPair, touch: Touch, together: Sequence[Touch], way: _Way) -> int:
    shared = _shared_wall(assembly, touch, together, way)
    # In a shared wall the edge lies, and does not cross it.
    walls = [wall for wall in touch.faces if shared is None or not assembly.agree(wall, shared)]
    best = -UNBOUNDED
    for crossing in _crossings(touch, walls, way):
        sides = UNBOUNDED
        if shared is None:
            if crossing.most <= best:
                break
            sides = crossing.sides(way)
            if sides <= best:
                continue
        best = max(best, _within(assembly, touch, crossing, sides, way))
    return best


def _within(assembly: PartPair, touch: Touch, crossing: _Crossing, sides: int, way: _Way) -> int:
    """How far a crossing stays from the ends of the fixed edge, `sides` at most.

    The moving edge's ends stay `sides` on their sides of the wall; `UNBOUNDED` where the edge lies in one.
    """
    (c, d), u = touch.fixed, touch.fixed_line.direction
    a, k = crossing.a, sub(crossing.b, crossing.a)
    start, onwards, far = way.above(a, Plane(u, dot(u, c))), way.along(u, k), dot(u, sub(d, c))
    lies = sides == UNBOUNDED
    certain = lies or way.nominal(way.above(a, crossing.wall))[1] <= 0  # then the share is in [0, 1]
    near, nearer = way.quick(start), way.quick(onwards)
    found = sides
    if not certain or near[0] + min(0, nearer[0]) - 1 < found:
        share = ONE if lies else crossing.share(way)
        # The crossing is the end a and a share of the way to b; whatever the share, the bound takes the worse end.
        room = way.least(start) + min(0, times(share, way.least(onwards)) - 1)
        if room < found and not _blocked(assembly, crossing.wall, c, u, room):
            found = room
    if not certain or far - near[1] - max(0, nearer[1]) - 1 < found:
        share = ONE if lies else crossing.share(way)
        room = far - way.most(start) + min(0, times(share, -way.most(onwards)) - 1)
        if room < found and not _blocked(assembly, crossing.wall, d, neg(u), room):
            found = room
    return found


def _blocked(assembly: PartPair, wall: Plane, end: Vector, inward: Vector, room: int) -> bool:
    """Whether the fixed edge's line goes on, beyond its end, within a piece, or its face in the plane of `wall`.

    An edge that crosses the wall there would enter that piece, which the separations rule out.
    """
    far = max(0, -room) + _BEYOND
    beyond = sub(end, scaled(far, inward))
    for piece in assembly.fixed_pieces:
        faces = enumerate(piece.faces)
        outside = list(islice((n for n, face in faces if not _behind(face.plane, (end, end, beyond, beyond), far)), 2))
        if not outside:
            return True
        if len(outside) == 1:
            backed = assembly.backed(assembly.fixed, piece, outside[0])
            if backed is not None and assembly.agree(backed.wall, wall):
                return True
    return False


def _on_moving_face(assembly: PartPair, touch: Touch, way: _Way) -> int:
    w = touch.fixed[0]
    # Holes of a moving face are not looked at: nothing is claimed of a face with some.
    if len(assembly.moving.faces[touch.face].loops) > 1:
        return -UNBOUNDED
    regions = assembly.moving.regions(touch.face)
    return max((min(way.least(FaceAbove(rim.plane, w)) for rim in region) for region in regions), default=-UNBOUNDED)
