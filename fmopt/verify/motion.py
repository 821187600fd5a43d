"""One piece of motion: how the error set is carried through it, re-derived from the plan's own statements.

The model. From an error e₀ the execution runs along the commanded twist with a drift inside the stated cone (an
ellipsoid that grows with the distance travelled), gives way along the compliant directions so that held contacts stay
at zero, and, when a contact m is being made, goes on until it touches. Measured on its own way, at every fraction s

    e(s) = (1 − s)(ẽ₀ + Σ T^S_i t_i) + s (ẽ₁ + Σ T^G_i t_i),   |t_i| ≤ thickness_i,

ẽ₀ in the start set without its old thickness, ẽ₁ = Π(ẽ₀ + drift), T^S and T^G dual to the contacts' rows at either
end. A row's linear part is therefore bounded at the two ends, and its remainder by the formula of `rows`. Thickness is
what a contact's own row leaves: its remainder, and its value at the nominal poses.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

from fmopt.verify.assembly import Assembly, Touch
from fmopt.verify.errors import ErrorSet
from fmopt.verify.linear import (
    blurred,
    complement,
    congruent,
    diagonal,
    dual,
    gram,
    image,
    measure,
    metric,
    outer_sum,
    row_of,
    seen,
    square_of,
    stretched,
    without,
)
from fmopt.verify.rational import (
    ONE,
    SLACK,
    ArithmeticRefusal,
    Row,
    Vector,
    dot,
    length,
    logarithm,
    over,
    product,
    root,
    row_dot,
    spread,
    sub,
    times,
    transposed,
    width,
)
from fmopt.verify.rows import Distance, Extent, Pose, coarse, remainder, size

_HALF = ONE >> 1


@dataclass(frozen=True)
class Task:
    """The piece to be carried through.

    Attributes:
        start, goal: nominal poses.
        held: basis contacts held along the piece, with directions.
        made: basis contact that the move makes, or None.
        state: all contacts held along the piece.
        goal_state: all contacts held after the move.
        share: φ, the piece's share of what is left of the move; ONE on its last piece.
        theta: stated bound of |ε|, rad.
        angles: stated half-widths of the box of ε, rad.
        box: stated half-widths of the box of e, m.
        rates: λ_t and λ_r.
        rho: characteristic length, m.
    """

    start: Pose
    goal: Pose
    held: tuple[tuple[Touch, Row], ...]
    made: Touch | None
    state: tuple[Touch, ...]
    goal_state: tuple[Touch, ...]
    share: int
    theta: int
    angles: Vector
    box: Vector
    rates: tuple[int, int]
    rho: int

    @property
    def last(self) -> bool:
        """Whether the move ends with this piece."""
        return self.share == ONE


class Motion:
    """A piece of motion with everything that rows need.

    Args:
        assembly: parts and contacts.
        task: the piece.
        errors: error set at its start; `thick` is the old thickness, which does not count inside the piece.

    Attributes:
        twist: V = (Δ, ω).
        motion: the part of V inside the held contacts.
        start_slack: thickness at the start, as generators.
        overtravel: bound of how much longer or shorter than V an execution's piece can be, as a share of V.
        goal_errors: error set at the end.
        half: half-widths (6,) around all errors of the piece.

    Raises:
        ArithmeticRefusal: the piece turns too far, contacts do not fix their directions, or the motion does not lead
            to the contact it is to make.
    """

    def __init__(self, assembly: Assembly, task: Task, errors: ErrorSet) -> None:
        self.assembly = assembly
        self.task = task
        self.errors = errors
        turn = logarithm(product(task.goal.R, transposed(task.start.R)))
        travel = sub(task.goal.p, task.start.p)
        self.twist: Row = travel + turn
        self.length = measure(self.twist, task.rho)
        if self.length < ONE >> 40:
            raise ArithmeticRefusal("a piece of motion goes nowhere")
        self.extent = Extent(turn, length(turn), travel, task.theta, task.angles, task.box)
        self._hold()
        self._make()
        self._thicken()
        self.overtravel = self._overtravel()
        self._carry()

    def rest(self, start: Distance, goal: Distance) -> int:
        """The remainder of a row."""
        return remainder(start, goal, self.extent)

    def lowest(self, start: Distance, goal: Distance) -> int:
        """Certified lower bound of a row over the piece."""
        first = start.f - self.errors.core_support(start.N) - spread(self.start_slack, start.N)
        second = goal.f - self.goal_errors.support(goal.N)
        return min(first, second) - self.rest(start, goal) - SLACK

    def at_start(self, start: Distance, goal: Distance) -> int:
        """Certified lower bound of a row at the start of the piece."""
        first = start.f - self.errors.core_support(start.N) - spread(self.start_slack, start.N)
        return first - self.rest(start, goal) - SLACK

    def at_goal(self, goal: Distance) -> int:
        """Certified lower bound of a row when the piece has ended."""
        return goal.f - self.goal_errors.support(goal.N) - remainder(goal, goal, self.extent.standing()) - SLACK

    def far(self, start: Distance, goal: Distance) -> int:
        """A quick lower bound of a row, never above `lowest`: the errors' whole box instead of their sets."""
        errors = self._offset + times(self.task.theta, size(start, goal))
        return min(start.f, goal.f) - errors - coarse(start, goal, self.extent) - 2 * SLACK

    @cached_property
    def _offset(self) -> int:
        return length(self.task.box)

    def _rows(self, touches: Sequence[Touch], together: Sequence[Touch], X: Pose) -> list[Distance]:
        return [self.assembly.function(t, together, X) for t in touches]

    def _hold(self) -> None:
        """Rows of the held contacts, and the projection along their directions."""
        task = self.task
        self.contacts = [t for t, _ in task.held]
        self.directions = [c for _, c in task.held]
        self.held_start = self._rows(self.contacts, task.state, task.start)
        self.held_goal = self._rows(self.contacts, task.state, task.goal)
        self.start_dual, _ = dual(self.directions, [d.N for d in self.held_start])
        rows = [d.N for d in self.held_goal]
        self.held_dual, _ = dual(self.directions, rows)
        self.hold = complement(self.held_dual, rows)
        self.motion = image(self.hold, self.twist)

    def _make(self) -> None:
        """The row of the contact being made, its direction, and the projection Π along both."""
        task = self.task
        self.projector, self.rate = self.hold, 0
        self.made_rows: tuple[Distance, Distance] | None = None
        self.made_direction: Row | None = None
        if task.made is None:
            return
        start, goal = (self.assembly.made(task.made, task.state, X) for X in (task.start, task.goal))
        self.made_rows = start, goal
        self.rate = -row_dot(goal.N, self.motion)
        if self.rate <= ONE >> 32:
            raise ArithmeticRefusal("the motion does not lead to the contact that it is to make")
        size = measure(self.motion, task.rho)
        self.made_direction = row_of(over(x, size) for x in self.motion)
        column = row_of(over(times(task.share, x), -self.rate) for x in self.motion)
        self.projector = without(self.hold, column, seen(goal.N, self.hold))

    def _thicken(self) -> None:
        """Thickness of the contact surfaces at both ends, and by how much it delays the touch (a share of V)."""
        task, core = self.task, self.errors.core_support
        self.start_thickness = [
            self.rest(s, g) + max(abs(s.f) + core(s.N), abs(g.f)) + SLACK
            for s, g in zip(self.held_start, self.held_goal, strict=True)
        ]
        self.thickness, self.goal_dual, self.delay = list(self.start_thickness), self.held_dual, 0
        if self.made_rows is None or not task.last:
            return
        start, goal = self.made_rows
        self.goal_dual, solved = dual([*self.directions, self.motion], [*(d.N for d in self.held_goal), goal.N])
        self.thickness.append(self.rest(start, goal) + abs(goal.f) + self._left(goal.N) + SLACK)
        self.delay = sum(times(abs(c), t) for c, t in zip(solved[-1], self.thickness, strict=True)) + SLACK

    @property
    def _angular_rate(self) -> int:
        return over(self.task.rates[1], self.task.rho)

    @property
    def _wide(self) -> int:
        """A bound of the angular error with its drift, before contacts take it up."""
        return self.task.theta + 2 * times(self._angular_rate, self.length)

    def _left(self, N: Row) -> int:
        """What the projected errors leave of a row: nothing but rounding when contacts are consistent."""
        left = seen(N, self.projector)
        offset = self._offset + 2 * times(self.task.rates[0], self.length)
        return times(length(left[:3]), offset) + times(length(left[3:]), self._wide) + 1

    def _carry(self) -> None:
        """The error set at the end, and the box around the errors of the whole piece."""
        weights = metric(self.task.rho)
        growth, shape = (congruent(self.projector, Q) for Q in (self.errors.growth, self.errors.shape))
        for entries in self._drift():
            if any(entries):
                extra = congruent(self.projector, diagonal(entries))
                growth, shape = outer_sum(growth, extra, weights), outer_sum(shape, extra, weights)
        self.start_slack = [stretched(t, c) for t, c in zip(self.start_thickness, self.start_dual, strict=True)]
        thick = tuple(stretched(t, c) for t, c in zip(self.thickness, self.goal_dual, strict=True))
        if thick:
            around = square_of([len(thick) * x for x in r] for r in gram(thick))
            shape = outer_sum(shape, around, weights)
        core = tuple(image(self.projector, g) for g in self.errors.core)
        self.goal_errors = ErrorSet(core, thick, blurred(growth), blurred(shape))
        ends = self.errors.half_widths(self.start_slack), self.goal_errors.half_widths(thick)
        self.half = [max(a, b) for a, b in zip(*ends, strict=True)]

    def cone(self, N: Row) -> int:
        """How fast the velocity error can move a row, per unit of travel."""
        t, r = self.task.rates[0], self._angular_rate
        return root(times(times(t, t), dot(N[:3], N[:3])) + times(times(r, r), dot(N[3:], N[3:])))

    def _overtravel(self) -> int:
        """How much longer than V, as a share of it, the way to the touch can be for any error.

        It makes up for the error of the start, for the drift (of the longer way), for what the extra turn adds to
        second order, and for the thickness: o = φ(o_start + η(1 + o) + ζ o) + delay, solved for o.
        """
        if self.made_rows is None:
            return 0
        N = seen(self.made_rows[1].N, self.hold)
        eta = over(times(self.cone(N), self.length), self.rate) + 1
        zeta = over(times(times(self._wide, self.extent.turn), length(N[3:])) * 3 // 4, self.rate) + 1
        late = over(spread(self.errors.core, N) + width(self.errors.growth, N), self.rate) + 1
        rest = ONE - times(self.task.share, eta + zeta)
        if rest < _HALF:
            raise ArithmeticRefusal("drift could carry the part past the contact that it is to make")
        return over(times(self.task.share, late + eta) + self.delay, rest) + 1

    def _drift(self) -> tuple[list[int], list[int]]:
        """Squared radii of the drift, and of what overtravel adds to it: log(eᵃeᵇ) against a + b.

        For |a| + |b| ≤ 1/2 the two differ by at most |a||b|(1 + |a| + |b|)/2.
        """
        overtravel = self.overtravel
        far = times(self.length, ONE + overtravel)
        a, b = times(self.task.rates[0], far), times(self._angular_rate, far)
        swung, wide = times(overtravel, self.extent.turn), self.task.theta + b
        if overtravel > ONE or wide + swung > _HALF:
            raise ArithmeticRefusal("errors are too large for the bounds of this check")
        c = times(times(wide, swung) >> 1, ONE + wide + swung) + 1 if swung else 0
        return [times(a, a)] * 3 + [times(b, b)] * 3, [0] * 3 + [times(c, c)] * 3
