"""Tolerances of form: by how much they thicken the surfaces of contacts, and what rows lose to them.

Let Δ be the sum of what both parts may be off. A plane that keeps the parts of the plan apart by m keeps the real ones
apart by m − Δ; a height over another point of the same part may be off by what both places are, 2 Δ. A real contact is
a point of two real features, with points y and z of the nominal ones next to it, |y − z| ≤ Δ: their distance is within
±Δ, which is how thick the surface of a contact is that is held, or has been made.

A direction is no distance, and may be off zero by more. In a wall an end a of an edge is as high as y to 2 Δ, where the
edge crosses a rim; a is r inside, so that y is r − Δ away from it at least, and the other end of the edge, ℓ from a, is
as high as a to 2 Δ ℓ/(r − Δ). Where that end is on the wall itself, it is to 2 Δ. A face that meets a rim with two of
its edges has it level to 2 Δ over the distance of the two places there, which is that of the y less 2 Δ. The second y
is as far from the first edge as its own edge is where it is nearest; of two with one corner, by the sine of their angle
times how far it is from the corner, which is as far as that is from the rim, less Δ.

When several contacts are made together any of them may be the one that touches. Of two corners of one wall, or two
edges of a face on one rim, the other is off by as much more as a direction that held contacts have at zero: the height
of one corner over the other, or how much the rim, which is as long as they are apart at most, leans on the face. Else
let Q be the rows of the held ones and of that one, times the directions that give way, κ by how many Δ each is off, and
W what Q varies by while errors vary. Then z = Q y is |z| ≤ Δ κ + W |Q⁻¹| |z|, so that |z| ≤ Δ (1 − W |Q⁻¹|)⁻¹ κ if that
inverse has no negative entry; and what counts is a y with a row a that varies by w, |a y| ≤ (|a Q⁻¹| + w |Q⁻¹|) |z|.
A direction that held contacts have at zero is bounded in the same way, by their rows alone.
"""

from collections.abc import Callable, Sequence
from operator import mul
from typing import NamedTuple, Protocol

from fmopt.verify.arithmetic.rational import (
    BITS,
    ONE,
    ArithmeticRefusal,
    Row,
    Vector,
    cross,
    dot,
    inverse,
    length,
    over,
    row_dot,
    scaled,
    sub,
    times,
    unit,
)
from fmopt.verify.certificate.contact_implications import CheckedFacts
from fmopt.verify.certificate.error_set import dual
from fmopt.verify.parts.assembly import PartPair, Passage, Touch
from fmopt.verify.parts.rows import DirectionAlong, Distance, Function, PointAbove, Spread, size
from fmopt.verify.parts.solids import Plane

_ALONGSIDE = 1_000_000  # times as fast as others the contact comes nearer that is made, and not passed


class Tied(Protocol):
    """A piece of motion whose errors contacts tie; see `propagation.Motion`."""

    assembly: PartPair
    task: Passage
    extent: Spread
    held: list[Function]
    made: Function | None
    directions: tuple[Row, ...]
    motion: Row
    rate: int


def levers(piece: Tied, room: Callable[[PointAbove], int]) -> list[int]:
    """By how many Δ the functions of the contacts held, and of the one that is made at the end, may be off zero.

    They rest on the `room` of a real point over a fixed plane, how high it is at least, m.

    Raises:
        ArithmeticRefusal: a direction tells of a contact, and nothing how far that may be off.
    """
    task, known = piece.task, _Known(piece, room)
    found = [known.lever(touch, f) for (touch, _), f in zip(task.held, piece.held, strict=True)]
    if piece.made is not None and task.made is not None and task.last:
        lever = most = known.lever(task.made, piece.made)
        old = {task.made.id, *(touch.id for touch in task.state)}
        for other in (touch for touch in task.goal_state if touch.id not in old):
            most = max(most, known.instead(other, piece.made, (*found, lever)))
        found.append(most)
    return found


def made_lever(piece: Tied, room: Callable[[PointAbove], int]) -> int:
    """By how many Δ the function of the contact being made is off zero at most where it touches along the piece.

    Raises:
        ArithmeticRefusal: nothing tells.
    """
    assert piece.task.made is not None
    return _Known(piece, room).lever(piece.task.made, piece.made)


class _Known(NamedTuple):
    """How far functions of contacts may be off zero, as multiples of Δ."""

    piece: Tied
    room: Callable[[PointAbove], int]

    @property
    def assembly(self) -> PartPair:
        """The parts."""
        return self.piece.assembly

    @property
    def task(self) -> Passage:
        """The piece that is to be carried through."""
        return self.piece.task

    def lever(self, touch: Touch, function: Function | None) -> int:
        """That of a contact, told by those of the basis."""
        own = [known for known, _ in self.task.held]
        if not isinstance(function, DirectionAlong):
            return ONE
        if touch.kind == "vertex-face":
            return self._completed(touch, own)
        hinge = self.assembly.hinge(touch, self.task.state)
        return self._levelled(touch, own) if hinge is None else self._hinged(touch, hinge[0], own)

    def _completed(self, made: Touch, own: Sequence[Touch]) -> int:
        """That of a vertex that reaches a wall on a rim of which its edge is held."""
        state = self.task.state
        for touch in state:
            hinge = self.assembly.hinge(touch, (made,))
            if hinge is not None and self.assembly.hinge(touch, state) is None:
                if all(touch.id != known.id for known in own):
                    break
                return self._hinged(touch, hinge[0], (made,))
        raise _unknown(made)

    def _hinged(self, touch: Touch, wall: Plane, own: Sequence[Touch]) -> int:
        """That of an edge hinged in a wall, on which one of some contacts has an end of it."""
        on = [t for t in own if t.kind == "vertex-face" and self.assembly.agree(t.faces[0], wall)]
        ends = [v for v in touch.moving if any(t.moving[0] == v for t in on)]
        if not ends:
            raise _unknown(touch)
        a, b = touch.moving if touch.moving[0] in ends else touch.moving[::-1]
        beyond = next(face for face in touch.faces if not self.assembly.agree(face, wall))
        # In the wall across its rim, away from the other face there: along it the end is as far inside as counts.
        inward = unit(sub(scaled(dot(beyond.normal, wall.normal), wall.normal), beyond.normal))
        room = self._room(a, Plane(inward, dot(inward, touch.fixed[0])))
        # At least as for an end that is on the wall itself: two places that are off by Δ each.
        return max(2 * ONE, over(2 * length(sub(b, a)), _positive(room, touch)) + 1)

    def _levelled(self, touch: Touch, own: Sequence[Touch]) -> int:
        level, form = self.assembly.level(touch, self.task.state), self.assembly.form
        if level is None or all(level.held.id != known.id for known in own):
            raise _unknown(touch)
        reach = [dot(level.away, sub(v, level.held.moving[0])) for v in touch.moving]
        corners = [v for v in touch.moving if v in level.held.moving]
        if corners:
            sine = over(max(map(abs, reach)), length(sub(touch.moving[1], touch.moving[0])))
            u, q = level.held.fixed_line.direction, touch.fixed[0]
            off = sub(self.task.goal.apply(corners[0]), q)
            across = unit(sub(off, scaled(dot(off, u), u)))
            apart = times(sine, self._room(corners[0], Plane(across, dot(across, q))))
        else:
            # With an end on either side the edge meets the line of the one held: nothing keeps the two places apart.
            apart = min(map(abs, reach)) if (reach[0] > 0) == (reach[1] > 0) else 0
        # The row is of the face's normal times how far the other edge reaches, see `Assembly.function`.
        return over(2 * abs(level.far), _positive(apart - 2 * form, touch)) + 1

    def _room(self, v: Vector, plane: Plane) -> int:
        return self.room(PointAbove(plane, v, self.assembly.reach(v)))

    def instead(self, other: Touch, made: Function, found: Sequence[int]) -> int:
        """That of the contact being made where another one touches first."""
        piece, goal = self.piece, self.task.goal
        row = self.assembly.function(other, ()).at(goal)
        if -row_dot(row.N, piece.motion) <= piece.rate // _ALONGSIDE:
            return ONE
        *held, own = found
        rows = [function.at(goal) for function in piece.held]
        between = self._between(other, made)
        if between is None:
            return self._tied(made, [*rows, row], (*piece.directions, piece.motion), (*held, ONE))
        # A hinge that is completed takes the corner's height and that at the rim, one Δ each, times its lever.
        more = self._tied(between, rows, piece.directions, held)
        return times(own, ONE + (more >> 1 if isinstance(made, DirectionAlong) else more)) + 1

    def _between(self, other: Touch, made: Function) -> DirectionAlong | None:
        """By what direction, which the held contacts have at zero, two contacts that are made together differ."""
        touch, assembly = self.task.made, self.assembly
        facts = CheckedFacts(assembly, self.task.state, self.task.goal.R)
        if touch is None or other.kind != touch.kind:
            return None
        if touch.kind == "vertex-face" and assembly.agree(touch.faces[0], other.faces[0]):
            if facts.level(touch.faces[0], touch.moving[0], other.moving[0]):
                k = sub(touch.moving[0], other.moving[0])
                return DirectionAlong(touch.faces[0].normal, k, length(k) + 2)
        elif touch.kind == "edge-edge" and set(touch.indices[1]) == set(other.indices[1]):
            sides = [assembly.moving.edge(*t.indices[0]) for t in (touch, other)]
            for number in sorted(set(sides[0] or ()) & set(sides[1] or ())):
                plane, rim = assembly.moving.faces[number].plane, sub(touch.fixed[1], touch.fixed[0])
                exact = assembly.moving.faces[number].exact
                along = assembly.way(touch.fixed[0], touch.fixed[1])
                if exact is not None and not isinstance(made, DirectionAlong) and facts.keeps(along, exact[:3]):
                    return DirectionAlong(rim, plane.normal, length(rim) + 2)
        return None

    def _tied(self, function: Function, rows: Sequence[Distance], along: Sequence[Row], off: Sequence[int]) -> int:
        """By how many Δ a function is off at most where rows are off by so many, at the goal."""
        _, solved = dual(tuple(along), tuple(distance.N for distance in rows))
        sizes = [[abs(x) for x in shares] for shares in solved]
        varying = [self._varying(distance, along, sizes) for distance in rows]
        wider = inverse([[(ONE if i == j else 0) - x for j, x in enumerate(line)] for i, line in enumerate(varying)])
        if any(x < 0 for line in wider for x in line):
            raise ArithmeticRefusal("errors turn contacts too far for tolerances of form")
        z = [(sum(map(mul, line, off)) >> BITS) + 1 for line in wider]
        counted = function.at(self.task.goal)
        own = [row_dot(counted.N, c) for c in along]
        seen = [abs(sum(map(mul, own, shares)) >> BITS) + 1 for shares in zip(*solved, strict=True)]
        seen = [x + y for x, y in zip(seen, self._varying(counted, along, sizes), strict=True)]
        total: int = sum(map(mul, seen, z))
        return (total >> BITS) + 1

    def _varying(self, row: Distance, along: Sequence[Row], sizes: Sequence[Sequence[int]]) -> list[int]:
        """What a row's products with the directions may vary by at the goal, times the sizes of an inverse."""
        by = [varied(row, row, c, self.piece.extent.standing) for c in along]
        return [(sum(map(mul, by, column)) >> BITS) + 1 for column in zip(*sizes, strict=True)]


def _positive(room: int, touch: Touch) -> int:
    if room <= 0:
        raise ArithmeticRefusal(f"{touch.id} may be where tolerances of form tell nothing of it")
    return room


def _unknown(touch: Touch) -> ArithmeticRefusal:
    return ArithmeticRefusal(f"tolerances of form tell nothing of {touch.id}: it follows from contacts of no basis")


def loss(function: Function, form: int) -> int:
    """What a row loses to tolerances of form, m: see `certificate.form`."""
    return 2 * form if isinstance(function, DirectionAlong) else form


def varied(start: Distance, goal: Distance, motion: Row, extent: Spread) -> int:
    """A bound of how much a row's product with a motion differs between poses of the piece."""
    straight, round_, angle = length(motion[:3]), length(motion[3:]), extent.theta + extent.turn
    change = times(angle, times(size(start, goal), round_))
    if start.bend is not None:
        change += times(angle, straight) + times(extent.offset + length(extent.travel), round_)
    return change


def together(rows: Sequence[Distance], shares: Sequence[int], off: Sequence[int], extent: Spread) -> int:
    """What a combination of rows differs by from its linear part where a piece ends, with errors in its box, at most.

    Beyond that a row is ½ε·G ε + ε·(β × M e), G = w uᵀ + β yᵀ made symmetric less its trace, and no more than |ε|³/6
    times its size and |ε|²|M e|/2 of third order. In the sum of all G what rows have in common cancels.
    """
    axes, found, a = range(3), 0, extent.theta
    G, mixed = [[0] * 3 for _ in axes], [[0] * 3 for _ in axes]
    for row, share, least in zip(rows, shares, off, strict=True):
        parts, left = [(row.push, row.turned)], least + times(times(a, times(a, a)), size(row, row)) // 6 + 8
        if row.bend is not None:
            parts.append((row.bend.body, row.bend.arm))
            left += times(times(a, a), extent.offset) >> 1
            for j, column in enumerate(row.bend.columns()):
                for i, x in enumerate(cross(row.bend.body, column)):
                    mixed[i][j] += times(share, x)
        for i in axes:
            for j in axes:
                G[i][j] += times(share, sum(u[i] * w[j] + u[j] * w[i] for u, w in parts) >> BITS)
            G[i][i] -= 2 * times(share, sum(dot(*part) for part in parts))
        found += times(abs(share), left) + 8
    # Summed up, G is twice what was made symmetric: ½ε·G ε is a quarter of it.
    found += sum(times(times(extent.angles[i], extent.angles[j]), abs(G[i][j])) for i in axes for j in axes) >> 2
    found += sum(times(times(extent.angles[i], extent.box[j]), abs(mixed[i][j])) for i in axes for j in axes)
    return found + 64 * len(rows)
