"""One piece of motion: how the error set is carried through it, re-derived from the plan's own statements.

The model. From an error e₀ the execution runs along the commanded twist with a drift inside the stated bounds (a ball
of translations and a ball of turns, both at once, which grow with the distance travelled), gives way along the
compliant directions so that held contacts stay at zero, and, when a contact m is being made, goes on until it touches.
Errors that are fixed in the hole or in the hand move on with the part (`error_set`). Measured on its own way, at every
fraction s

    e(s) = (1 − s)(ẽ₀ + Σ T^S_i t_i) + s (ẽ₁ + Σ T^G_i t_i),   |t_i| ≤ thickness_i,

ẽ₀ in the start set without its old thickness, ẽ₁ = Π(ẽ₀ + what frames and drift add), T^S and T^G dual to the
contacts' rows at either end. A row's linear part is therefore bounded at the two ends, and its remainder by
`rows`. Thickness is what a contact's own row leaves: its remainder, and its value at the nominal poses.
"""

from collections.abc import Sequence
from functools import cached_property

from fmopt.verify.arithmetic.rational import (
    BITS,
    ONE,
    SLACK,
    ArithmeticRefusal,
    Row,
    length,
    logarithm,
    over,
    product,
    row_dot,
    spread,
    sub,
    times,
    transposed,
)
from fmopt.verify.certificate.error_set import (
    NO_ROW,
    NOTHING,
    ErrorShape,
    blurred,
    complement,
    congruent,
    dual,
    gram,
    image,
    magnified,
    measure,
    metric,
    outer_sum,
    row_of,
    seen,
    spheres,
    square_of,
    stretched,
    without,
)
from fmopt.verify.certificate.form import levers, loss, together
from fmopt.verify.parts.assembly import PartPair, Passage
from fmopt.verify.parts.rows import DirectionAlong, Distance, Function, PointAbove, Spread, coarse, remainder, size
from fmopt.verify.remembered import remembered

_HALF, _ROUNDS, _ABOVE = ONE >> 1, 60, 10**11  # rounds in which levers rise, by 1/_ABOVE beyond what follows


class Motion:
    """A piece of motion with everything that rows need.

    Args:
        errors: error set at its start; `thick` is the old thickness, which does not count inside the piece.

    Attributes:
        twist: V = (Δ, ω).
        motion: the part of V inside the held contacts.
        held, made: functions of the contacts held, and of the one being made, or None.
        felt: the row of the contact being made at the goal, as errors inside the held contacts feel it.
        start_slack: thickness at the start, as generators.
        overtravel: bound of how much longer or shorter than V an execution's piece can be, as a share of V.
        goal_errors: error set at the end.
        half: half-widths (6,) around all errors of the piece.

    Raises:
        ArithmeticRefusal: the piece turns too far, contacts do not fix their directions, or the motion does not lead
            to the contact it is to make.
    """

    def __init__(self, assembly: PartPair, task: Passage, errors: ErrorShape) -> None:
        self.assembly = assembly
        self.task = task
        self.errors = errors
        turn = logarithm(product(task.goal.R, transposed(task.start.R)))
        travel = sub(task.goal.p, task.start.p)
        self.twist: Row = travel + turn
        self.length = measure(self.twist, task.rho)
        if self.length < ONE >> 40:  # 0.9 pm in the metric of ρ
            raise ArithmeticRefusal("a piece of motion goes nowhere")
        self.extent = Spread(turn, length(turn), travel, task.theta, task.angles, task.box)
        self._move_on()
        self._hold()
        self._make()
        self._follow()

    @remembered
    def ends(self, function: Function) -> tuple[Distance, Distance]:
        """A function's row at the start and at the goal."""
        return function.at(self.task.start), function.at(self.task.goal)

    @remembered
    def rest(self, function: Function) -> int:
        """The remainder of a function's row."""
        ends = self.ends(function)
        return remainder(*ends, self.extent) + self._coupled(size(*ends))

    def loss(self, function: Function) -> int:
        """What a function loses to tolerances of form."""
        return loss(function, self.assembly.form)

    @remembered
    def nominal(self, function: Function) -> int:
        """The lesser of a function's values at the nominal poses of both ends; `lowest` is less."""
        return min(function.value(self.task.start), function.value(self.task.goal))

    @remembered
    def lowest(self, function: Function) -> int:
        """Certified lower bound of a function over the piece."""
        start, goal = self.ends(function)
        # The end that is nominally lower first: often the other is so much higher that its errors need no sum.
        if start.f <= goal.f:
            found = start.f - self._first(function)
            if goal.f - self._boxed(goal.N) < found:
                found = min(found, goal.f - self._second(function))
        else:
            found = goal.f - self._second(function)
            if start.f - self._boxed(start.N) < found:
                found = min(found, start.f - self._first(function))
        return found - self.rest(function) - self.loss(function) - SLACK

    def highest(self, function: Function) -> int:
        """Certified upper bound of a function over the piece."""
        start, goal = self.ends(function)
        found = max(start.f + self._first(function), goal.f + self._second(function))
        return found + self.rest(function) + self.loss(function) + SLACK

    def at_start(self, function: Function) -> int:
        """Certified lower bound of a function at the start of the piece."""
        lost = self.rest(function) + self.loss(function) + SLACK
        return self.ends(function)[0].f - self._first(function) - lost

    def at_goal(self, function: Function) -> tuple[int, int]:
        """Certified lower and upper bound of a function when the piece has ended."""
        goal = self.ends(function)[1]
        off = self._second(function) + remainder(goal, goal, self.extent.standing) + self._coupled(size(goal, goal))
        off += self.loss(function) + SLACK
        return goal.f - off, goal.f + off

    @remembered
    def _first(self, function: Function) -> int:
        """By how much the errors at the start may change a function's linear part."""
        N = self.ends(function)[0].N
        return self.errors.core_support(N) + spread(self.start_slack, N)

    @remembered
    def _second(self, function: Function) -> int:
        """By how much the errors at the goal may change a function's linear part."""
        return self.goal_errors.support(self.ends(function)[1].N)

    def _boxed(self, N: Row) -> int:
        """A quick bound of `_first` and `_second` by the box around all errors."""
        (a, b, c, d, e, f), (u, v, w, x, y, z) = N, self.half
        return ((abs(a) * u + abs(b) * v + abs(c) * w + abs(d) * x + abs(e) * y + abs(f) * z) >> BITS) + SLACK

    def far(self, function: Function) -> int:
        """A quick lower bound of a function: `lowest` is above it where the errors are in their stated box."""
        lost = self._blur(function, self.extent.offset, self.task.theta) + self.loss(function)
        return self.nominal(function) - lost

    def blur(self, function: Function) -> int:
        """A quick bound of what `lowest` and `at_goal` take off nominal values, by the derived box of the errors."""
        offset, angle = self._reach
        # A row that measures an angle is the same at all positions.
        offset = 0 if isinstance(function, DirectionAlong) else offset
        return self._blur(function, offset, angle) + self.loss(function)

    @cached_property
    def _reach(self) -> tuple[int, int]:
        """Bounds of |e| and |ε| over the errors of the piece."""
        x, y, z, a, b, c = self.half
        return length((x, y, z)), length((a, b, c))

    def _blur(self, function: Function, offset: int, angle: int) -> int:
        """How much errors |e| ≤ offset and |ε| ≤ angle can take off a function, at most; |N·e| ≤ |e| + size |ε|."""
        if isinstance(function, (PointAbove, DirectionAlong)):
            return self._blur_within(function.reach, offset, angle)
        start, goal = self.ends(function)
        far = size(start, goal)
        return offset + times(angle, far) + coarse(start, goal, self.extent) + self._coupled(far) + 2 * SLACK

    @remembered
    def _blur_within(self, reach: int, offset: int, angle: int) -> int:
        shift = times(angle, reach) + times(self.extent.kappa, reach) + 9
        return offset + shift + self._coupled(reach) + 2 * SLACK

    def _move_on(self) -> None:
        """The generators as the motion alone carries them on, and the ellipsoid around everything likewise."""
        task, linkage, core = self.task, self.errors.linkage, self.errors.core
        self.linkage, self.moved, self.moved_shape, self.coupling = linkage, core, self.errors.shape, (0, 0)
        if linkage is None:
            return
        turn = product(task.goal.R, transposed(task.start.R))
        self.coupling = linkage.left(self.extent.offset, task.theta, (task.start.p, task.goal.p), self.extent.turn)
        by = linkage.moves(self.extent.travel, turn, len(core))
        self.moved = tuple(row_of(x + y for x, y in zip(g, d, strict=True)) for g, d in zip(core, by, strict=True))
        around = square_of([linkage.linked * x for x in r] for r in gram(by))  # k Σ gᵢgᵢᵀ around k generators
        self.moved_shape = outer_sum(self.errors.shape, around, metric(task.rho))
        self.linkage = linkage.turned(turn)

    def _coupled(self, far: int) -> int:
        """What errors that are fixed in different frames may add to a row of this size beyond its linear part."""
        return self.coupling[0] + times(self.coupling[1], far) + 1

    def _hold(self) -> None:
        """Functions of the held contacts, and the projection along their directions."""
        task = self.task
        self.held = [self.assembly.function(t, task.state) for t, _ in task.held]
        self.directions = tuple(c for _, c in task.held)
        ends = [self.ends(function) for function in self.held]
        self.start_dual, _ = dual(self.directions, tuple(start.N for start, _ in ends))
        rows = tuple(goal.N for _, goal in ends)
        self.held_dual, _ = dual(self.directions, rows)
        self.hold = complement(self.held_dual, rows)
        self.motion = image(self.hold, self.twist)

    def _make(self) -> None:
        """The function of the contact being made, its direction, and the projection Π along both."""
        task = self.task
        self.projector, self.rate, self.felt = self.hold, 0, NO_ROW
        self.made: Function | None = None
        self.made_direction: Row | None = None
        if task.made is None:
            return
        self.made = self.assembly.made(task.made, task.state)
        goal = self.ends(self.made)[1]
        self.rate = -row_dot(goal.N, self.motion)
        if self.rate <= ONE >> 32:  # what is late is divided by it
            raise ArithmeticRefusal("the motion does not lead to the contact that it is to make")
        size = measure(self.motion, task.rho)
        self.made_direction = row_of(over(x, size) for x in self.motion)
        column = row_of(over(times(task.share, x), -self.rate) for x in self.motion)
        self.felt = seen(goal.N, self.hold)
        self.projector = without(self.hold, column, self.felt)

    def _follow(self) -> None:
        """Thickness, overtravel and error set at the end.

        Where parts are off their form, levers depend on these: they are raised until none that follows is larger.
        """
        form = self.assembly.form
        most = levers(self, self._without_errors) if form else []
        for _ in range(_ROUNDS):
            self._thicken([times(form, lever) + 1 for lever in most] if form else [0] * (len(self.held) + 1))
            self.overtravel = self._overtravel()
            self._carry()
            least = levers(self, self.room) if form else []
            if all(one <= other for one, other in zip(least, most, strict=True)):
                return
            most = [lever + lever // _ABOVE + 1 for lever in least]
        raise ArithmeticRefusal("tolerances of form make the surfaces of contacts too thick")

    def _without_errors(self, function: PointAbove) -> int:
        """How high a point is over a plane nominally, less the tolerances of form."""
        return min(row.f for row in self.ends(function)) - self.loss(function)

    def room(self, function: PointAbove) -> int:
        """How high a point is over a plane at least, by all errors at the start, and by those along the piece."""
        for known in ("_first", "_second", "lowest"):
            self.__dict__.pop(known, None)  # found with the levers of the round before
        start = self.ends(function)[0]
        begun = start.f - self.errors.support(start.N) - self.rest(function) - self.loss(function) - SLACK
        return min(begun, self.lowest(function))

    def _thicken(self, added: Sequence[int]) -> None:
        """Thickness of contacts, `added` by tolerances of form (made one last), and how it delays, as a share of V."""
        off = []
        for function, more in zip(self.held, added, strict=False):
            start, goal = self.ends(function)
            off.append(max(abs(start.f) + self.errors.core_support(start.N), abs(goal.f)) + more + SLACK)
        self.start_thickness = [x + self.rest(function) for x, function in zip(off, self.held, strict=True)]
        self.thickness, self.goal_dual, self.delay = list(self.start_thickness), self.held_dual, 0
        closing, along = self.made, self.made_direction
        if closing is None or along is None or not self.task.last:
            return
        goals = [self.ends(function)[1] for function in (*self.held, closing)]
        off.append(abs(goals[-1].f) + added[-1] + SLACK)
        left = self._left(goals[-1].N)
        self.goal_dual, _ = dual((*self.directions, along), tuple(goal.N for goal in goals))
        self.thickness.append(self.rest(closing) + off[-1] + left)
        # The execution goes on until all rows together say that it touches: what they share does not delay it.
        shares = [*(-row_dot(goals[-1].N, column) for column in self.held_dual), ONE]
        off = [x + self._coupled(size(goal, goal)) for x, goal in zip(off, goals, strict=True)]
        self.delay = over(together(goals, shares, off, self.extent) + left + SLACK, self.rate) + 1

    @property
    def _angular_rate(self) -> int:
        return over(self.task.rates[1], self.task.rho)

    @property
    def _wide(self) -> int:
        """A bound of the angular error with its drift, before contacts take it up."""
        return self.task.theta + 2 * times(self._angular_rate, self.length)  # at most twice as long, see `_drift`

    def _left(self, N: Row) -> int:
        """What the projected errors leave of a row: nothing but rounding when contacts are consistent."""
        left = seen(N, self.projector)
        offset = self.extent.offset + 2 * times(self.task.rates[0], self.length)
        return times(length(left[:3]), offset) + times(length(left[3:]), self._wide) + 1

    def _carry(self) -> None:
        """The error set at the end, and the box around the errors of the whole piece."""
        weights = metric(self.task.rho)
        shape, drifts = congruent(self.projector, self.moved_shape), []
        before = self.errors.slide, self.errors.swing
        for square, ball, Q in zip(self._drift(), spheres(self.projector), before, strict=True):
            extra = magnified(square, ball) if square else NOTHING
            drifts.append(blurred(outer_sum(congruent(self.projector, Q), extra, weights)))
            shape = outer_sum(shape, extra, weights)
        self.start_slack = [stretched(t, c) for t, c in zip(self.start_thickness, self.start_dual, strict=True)]
        thick = tuple(stretched(t, c) for t, c in zip(self.thickness, self.goal_dual, strict=True))
        if thick:
            around = square_of([len(thick) * x for x in r] for r in gram(thick))
            shape = outer_sum(shape, around, weights)
        core = tuple(image(self.projector, g) for g in self.moved)
        self.goal_errors = ErrorShape(core, thick, drifts[0], drifts[1], blurred(shape), self.linkage)
        ends = self.errors.half_widths(self.start_slack), self.goal_errors.half_widths(thick)
        self.half = [max(a, b) + self.coupling[k // 3] for k, (a, b) in enumerate(zip(*ends, strict=True))]

    def cone(self, N: Row) -> int:
        """How fast the velocity error can move a row, per unit of travel."""
        t, r = self.task.rates[0], self._angular_rate
        return times(t, length(N[:3])) + times(r, length(N[3:])) + 2

    def _overtravel(self) -> int:
        """How much longer than V, as a share of it, the way to the touch can be for any error.

        It makes up for the error of the start, for the drift (of the longer way), for what the extra turn adds to
        second order, and for the thickness: o = φ(o_start + η(1 + o) + ζ o) + delay, solved for o.
        """
        if self.made is None:
            return 0
        N = self.felt
        eta = over(times(self.cone(N), self.length), self.rate) + 1
        zeta = over(times(times(self._wide, self.extent.turn), length(N[3:])) * 3 // 4, self.rate) + 1  # ½(1 + ½)
        late = over(spread(self.moved, N) + self.errors.drift(N), self.rate) + 1
        rest = ONE - times(self.task.share, eta + zeta)
        if rest < _HALF:
            raise ArithmeticRefusal("drift could carry the part past the contact that it is to make")
        return over(times(self.task.share, late + eta) + self.delay, rest) + 1

    def _drift(self) -> tuple[int, int]:
        """Squared radii of the drift in e, and in ε with what overtravel adds to it: log(eᵃeᵇ) against a + b.

        For |a| + |b| ≤ 1/2 the two differ by at most |a||b|(1 + |a| + |b|)/2.
        """
        overtravel = self.overtravel
        far = times(self.length, ONE + overtravel)
        a, b = times(self.task.rates[0], far), times(self._angular_rate, far)
        swung, wide = times(overtravel, self.extent.turn), self.task.theta + b
        if overtravel > ONE or wide + swung > _HALF:  # `_wide` and `_overtravel` rest on both
            raise ArithmeticRefusal("errors are too large for the bounds of this check")
        c = times(times(wide, swung) >> 1, ONE + wide + swung) + 1 if swung else 0
        return times(a, a), times(b + c, b + c)
