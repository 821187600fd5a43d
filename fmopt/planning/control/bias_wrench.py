"""The bias wrench of a guarded move: what presses held contacts while the part goes to its next one.

The bias is the wrench *applied to* the moving part, about its reference point, in axes of the B-frame.
"""

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from enum import Enum
from itertools import chain, product
from typing import NamedTuple

import numpy as np

from fmopt.errors import InfeasibleError
from fmopt.planning.control.compliance_frame import free_part, row_space, twist_scale
from fmopt.planning.optimise.solvers import least_vertex
from fmopt.spatial.se3 import Pose, cross, length
from fmopt.spatial.values import Array, Value, frozen, remembered
from fmopt.task.problem import Specification

_CHECK = 1e-7  # N; a force that is no more than what a solver may be off by
SURE = 1.25  # times the threshold that the push alone can bring about
_ROUNDS = 8  # in which forces and what they may take from the motion settle
_SETTLED = 1e-3  # of that, which need not be there
_PRESSED = 0.5  # of what the least force can be
_RUBBED, _AWAY = 0.25, 1.0  # of the least force, which friction leaves that nobody makes up for: at a stop, before it
STILL = 1e-9  # of a unit twist: contacts that slide more slowly rub by less
_TURNING = 0.1  # share of turning in a motion, in the metric of ρ, from which on it counts as a turn


class Hold(Enum):
    """Held contacts stay closed under the whole push on the new ones, the reaction that ends the move, or neither."""

    PUSH = "push"
    STOP = "stop"
    NONE = "none"


_LABELS = {"held": "held wrenches", "points": "contact points", "made": "made wrenches"}


@dataclass(frozen=True, eq=False)
class GuardedMove(Value, displacement=(6,), held=(None, 6), points=("held", 3), made=(None, 6), labels=_LABELS):
    """What a segment asks of its controller: V (6,) and wrenches (m, 6) about the part's reference point, axes of B."""

    reference: Pose  # at the goal
    displacement: Array  # V (6,) = (p_G − p_S, ω), m and rad
    held: Array  # wrenches (m, 6) of the held contacts for a unit normal force, all of them, also dependent ones
    points: Array  # their contact points (m, 3) in the B-frame, m
    made: Array  # wrenches (k, 6) of the contacts that end the move, made together; none where it ends by its travel
    bound: float  # how much longer than ‖V‖ the way may be, m
    # How much work (J) normal forces (m,) of held contacts may take from the motion as errors turn them; 0 by default
    resisting: Callable[[Array], float] = lambda _: 0.0
    near: bool = True  # whether the new contacts may be met on this way; not on the first pieces of a longer move
    centres: Array | None = None  # of balls through which held contacts push (k, 3), m; None without any

    @property
    def reaction(self) -> Array:
        """Wrench (6,) of a unit reaction of the new contacts, shared equally; zero where there are none."""
        return frozen(self.made.mean(axis=0) if len(self.made) else np.zeros(6))

    @property
    def approaches(self) -> bool:
        """Whether the new contacts, if any, come nearer as it ends, so that their reaction can be felt."""
        return not len(self.made) or bool(self.reaction @ self.displacement < 0.0)

    def length(self, rho: float) -> float:
        """‖V‖ in the metric of ρ, m."""
        return length(self.displacement * twist_scale(rho))

    @remembered(1)
    def space(self, rho: float) -> Array:
        """Orthonormal basis (r, 6) of the space of scaled wrenches that the held contacts span."""
        return frozen(row_space(self.held, rho))

    def direction(self, rho: float) -> Array:
        """V / ‖V‖ (6,).

        Raises:
            ValueError: the move has no length.
        """
        length = self.length(rho)
        if not length > 0.0:
            raise ValueError("a move of no length has no direction")
        return np.asarray(self.displacement / length)


@dataclass(frozen=True, eq=False)
class Bias(Value):
    """Applied wrench (6,), its push along the motion, normal forces (m,) that balance the rest of it, N."""

    wrench: Array
    push: float
    normal_forces: Array
    stays: Hold


def bias_wrench(move: GuardedMove, V: Array, rho: float, specification: Specification) -> Bias:
    """The applied wrench that holds every contact, the least normal force greatest, for a unit twist V (6,).

    With contact wrenches wᵢ and normal forces fᵢ the applied wrench is −Σ fᵢ wᵢ + b u: a frictionless balance, which
    lies inside every friction cone, and a push b ≥ 0 along the motion, u without power on what the held contacts stop.
    Over f, b, the forces g and k of the held and the new contacts at the stop, and the least force t, a linear program
    maximises t subject to

        fᵢ ≥ t,  gᵢ ≥ t,  kⱼ ≥ 0,                      all contacts stay, also
        −Σ kⱼ wⱼ·V = b u·V,                           when the new ones take the whole push,
        Σ gᵢ wᵢ = Σ fᵢ wᵢ − Π Σ kⱼ wⱼ,              Π onto the space of held wrenches,
        b u·V ≥ 1.25 h |w·V| + μ Σ fᵢ sᵢ + p,       the push alone makes the contact felt against what resists,
        Σ fᵢ + b ≤ contact force,  Σ gᵢ ≤ contact force,  |τ| ≤ torque limit on each axis,

    with sᵢ the sliding speed of contact i for the unit motion V, h the threshold, and p the power that the forces f may
    take where errors turn them, from one solution to the next. What resists a part that slides tells its controller of
    all the friction. One that turns hardly slides near the axis, and friction there still turns it off what it holds:
    with uᵢ the wrench of friction of coefficient 1 for a unit normal force, all contacts stay under forces r as well,

        rᵢ ≥ t / 4,  Π Σ rᵢ (wᵢ + μ uᵢ) = Σ fᵢ wᵢ,

    if that can be; else the program is solved without r. While the new contacts cannot be met yet there is no g, and
    rᵢ ≥ t: over a long turn, what friction opens adds up. The push must allow for friction that need not be there,
    and what friction does not take comes onto the new contacts: contacts that it could pry open are pressed more, those
    whose friction asks for it less. Of equal answers that with the least greatest force is taken. Without a new contact
    there is no push. Where no g exists, Σ kⱼ = h takes the place of the second line: only the reaction that ends the
    move leaves all contacts closed; where none exists then either, the new contact pries a held one open as it is felt,
    and the program is solved without g. `stays` tells which. Twists are of unit length in the metric of ρ.

    Raises:
        InfeasibleError: the move does not approach its contact, or the greatest t is not positive.
        SolverError: the answer of the linear program does not balance.
    """
    m = len(move.held)
    if m == 0 and len(move.made) == 0:
        return Bias(np.zeros(6), 0.0, np.zeros(0), Hold.PUSH)
    found = _balanced(move, V, rho, specification)
    if found is not None:
        x, push = found.x, found.push
        wrench = 0.0 - move.held.T @ x[:m] + x[-2] * push.wrench
        return Bias(wrench, float(x[-2]), x[:m], push.hold)
    raise InfeasibleError(
        f"no bias wrench within {specification.contact_force:g} N and {specification.torque_limit:g} N m keeps all {m} "
        f"contacts and makes the next one felt at {specification.termination_force:g} N",
        advice="raise specification.contact_force or torque_limit, or lower termination_force or friction",
    )


class Balance(NamedTuple):
    """A linear program of `bias_wrench` with its answer, the forces x = (f, g, k, r, m, b, t).

    `which` of them presses the least pressed contact; t by default.
    """

    program: "PriorityProgram"
    push: "Push"
    rubbed: float
    x: Array
    which: int = -1

    @property
    def least(self) -> float:
        """What presses the least pressed contact, N."""
        return float(self.x[self.which])


def _balanced(move: GuardedMove, V: Array, rho: float, specification: Specification) -> Balance | None:
    """The first of the programs of `bias_wrench` that has an answer; arguments and errors as there."""
    push, along = np.zeros(6), 1.0
    if len(move.made):
        push, along = _push(move, V, rho)
    turning = bool(len(move.made)) and turns(V, rho)
    away = [(_AWAY, Hold.NONE)] if turning and not move.near else []
    for rubbed, hold in chain(away, product((_RUBBED, 0.0) if turning else (0.0,), Hold)):
        towards = Push(push, along, hold)
        found = _with_reserve(move, _program(move, V, rho, specification, towards, rubbed), rho)
        if found is not None:
            program, x = found
            return Balance(program, towards, rubbed, x)
    return None


def firmness(move: GuardedMove, rho: float, specification: Specification) -> float:
    """Share of the contact force that presses the least pressed contact while a part slides to its next one.

    All held contacts rub the same way then, and until what resists has told how much, nothing but these forces keeps
    friction from turning the part off them. Of moves that turn, hold nothing or meet nothing it is 1, and 0 where no
    bias holds all contacts.
    """
    return 1.0 if turns(move.direction(rho), rho) else _pressed(move, rho, specification)


def steadiness(move: GuardedMove, rho: float, specification: Specification) -> float:
    """Share of the contact force that presses the least pressed contact under friction that nothing makes up for.

    It counts while a part turns to its next contact. What such friction opens stays open: the load then lies on other
    contacts, which rub in other directions than those planned. Of moves that do not turn, hold nothing or meet nothing
    it is 1, and 0 where friction opens a contact under any bias, or the next contact does not come nearer.
    """
    return _pressed(move, rho, specification) if turns(move.direction(rho), rho) else 1.0


def _pressed(move: GuardedMove, rho: float, specification: Specification) -> float:
    """Share of the contact force that presses the least pressed contact; 1 where it holds or meets nothing."""
    if not len(move.held) or not len(move.made):
        return 1.0
    found = held_by(move, rho, specification)
    return 0.0 if found is None else found.least / specification.contact_force


@remembered(1)
def held_by(move: GuardedMove, rho: float, specification: Specification) -> Balance | None:
    """What says how firm a slide is, or how steady a turn; None where no bias holds all contacts.

    Raises:
        InfeasibleError: a turn runs into a contact that it holds.
    """
    V = move.direction(rho)
    if not move.approaches:
        return None
    if not turns(V, rho):
        with suppress(InfeasibleError):
            found = _balanced(move, V, rho, specification)
            return found and found._replace(which=int(np.argmin(found.x[: len(move.held)])))
        return None
    push = Push(*_push(move, V, rho), Hold.NONE)
    program = _program(move, V, rho, specification, push, _RUBBED)
    x = _best(program)
    return None if x is None else Balance(program, push, _RUBBED, x)


def turns(displacement: Array, rho: float) -> bool:
    """Whether a motion (6,), m and rad, counts as a turn: by the share of turning in it, in the metric of ρ."""
    return rho * length(displacement[3:]) > _TURNING * length(displacement * twist_scale(rho))


class PriorityProgram(NamedTuple):
    """Maximise the last of x (n,), and a little the least of the two before, over A x ≤ b (k,), C x = d (p,), x ≥ 0."""

    A: Array
    b: Array
    C: Array
    d: Array


class Push(NamedTuple):
    """Unit wrench (6,) along the motion, its power, and what held contacts stay closed under."""

    wrench: Array
    power: float
    hold: Hold


def _program(
    move: GuardedMove, V: Array, rho: float, specification: Specification, push: Push, rubbed: float
) -> PriorityProgram:
    """The linear program of `bias_wrench` over x = (f, g, k, r, m, b, t), m the greatest of f; idle g stay at t."""
    W, m, n, mu = move.held, len(move.held), len(move.made), specification.friction
    h = specification.termination_force if n else 0.0
    basis, scale = move.space(rho), twist_scale(rho)
    spread = basis @ (W / scale).T
    slid = slides(W, move.points - move.reference.p, V)
    drag = mu * np.linalg.norm(slid, axis=1) * (n > 0)  # what meets nothing has no push
    F = specification.contact_force
    unit = np.eye(2 * m + n + m * (rubbed > 0.0) + 3)  # rows that pick one variable each
    f, g, k, r = unit[:m], unit[m : 2 * m], unit[2 * m : 2 * m + n], unit[2 * m + n : -3]
    greatest, b, t = unit[-3:]
    torque = -W[:, 3:].T @ f + np.outer(push.wrench[3:], b)
    along = push.power * b
    rows = [t - f, t - g, f - greatest, drag @ f - along, f.sum(axis=0) + b, g.sum(axis=0), torque, -torque]
    A = np.vstack([*rows, rubbed * t - r])
    pressed = SURE * h * abs(float(move.reaction @ V))
    limits = np.concatenate([np.zeros(3 * m), [-pressed, F, F], [specification.torque_limit] * 6, np.zeros(len(r))])
    balance = spread @ (g - f) + basis @ (move.made / scale).T @ k
    taken = -(move.made @ V) @ k - along if push.hold is Hold.PUSH else k.sum(axis=0)
    C = np.vstack([taken, balance[: 0 if push.hold is Hold.NONE else None]])
    if rubbed:
        friction = mu * rubbing(slid, move.points - move.reference.p)
        C = np.vstack([C, spread @ (r - f) + basis @ (friction / scale).T @ r])
    d = np.concatenate([[0.0 if push.hold is Hold.PUSH else h], np.zeros(len(C) - 1)])
    return PriorityProgram(A, limits, C, d)


def _with_reserve(move: GuardedMove, program: PriorityProgram, rho: float) -> tuple[PriorityProgram, Array] | None:
    """The best x whose push also does the work that its forces may take, with the program that asks so; None without.

    The forces decide how much that is; a few rounds settle it. A push so large that the least force would fall below
    a share of what it can be is made smaller: contacts that are hardly pressed are lost.
    """
    m, length = len(move.held), move.length(rho)

    def solved(reserve: float) -> tuple[PriorityProgram, Array] | None:
        limits = program.b.copy()
        limits[3 * m] -= reserve  # the row of the push
        asked = program._replace(b=limits)
        x = _best(asked)
        return (asked, x) if x is not None and x[-1] > least else None

    least = _CHECK
    found, reserve, most = solved(0.0), 0.0, np.inf
    if found is None or not len(move.made):
        return found
    least = _PRESSED * float(found[1][-1])
    for _ in range(_ROUNDS):
        needed = move.resisting(found[1][:m]) / length
        if needed <= reserve * (1.0 + _SETTLED):
            break
        tried = needed if needed < most else 0.5 * (reserve + most)
        more = solved(tried)
        if more is None:
            most = tried
        else:
            found, reserve = more, tried
    return found


def _push(move: GuardedMove, V: Array, rho: float) -> tuple[Array, float]:
    """Unit wrench u (6,) along the motion, in the complement of the held wrenches, and its power u·V."""
    made, scale = move.reaction, twist_scale(rho)
    if not move.approaches:
        raise InfeasibleError(
            f"the move does not approach the contact that is to end it (w·V = {float(made @ V):.3g})",
            advice="choose a goal that makes the contact from its free side",
        )
    direction = V * scale
    free = free_part(direction, move.space(rho))
    if free is None:
        raise InfeasibleError("the move runs into a contact that it holds", advice="release the contact first")
    size = float(np.linalg.norm(free))
    return free / size * scale, float(free @ direction) / size


def slides(W: Array, arms: Array, V: Array) -> Array:
    """Velocities (m, 3) with which contact points slide along their faces for the unit twist V."""
    velocity = V[:3] + cross(V[3:], arms)
    normals = W[:, :3]
    return np.asarray(velocity - np.sum(velocity * normals, axis=1, keepdims=True) * normals)


def rubbing(slid: Array, arms: Array) -> Array:
    """Wrenches (m, 6) of friction of coefficient 1 for a unit normal force on contacts that slide like this."""
    speeds = np.linalg.norm(slid, axis=1, keepdims=True)
    against = -slid / np.maximum(speeds, STILL)
    return np.hstack([against, cross(arms, against)])


def _best(program: PriorityProgram) -> Array | None:
    """The best x; None where there is none."""
    A, b, C, d = program
    cost, lower, upper = np.zeros(A.shape[1]), np.zeros(A.shape[1]), np.full(A.shape[1], np.inf)
    cost[-3:] = 1e-4, 1e-3, -1.0  # a newton of t is worth 1000 of push, 10000 of the greatest force
    lower[-1], upper[-1] = -np.inf, b.max()  # without held contacts nothing else bounds t
    return least_vertex(cost, (A, b), (C, d), (lower, upper))
