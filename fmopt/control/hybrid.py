"""One hybrid position/force strategy for each segment, after [DakinPopplestone1993] section 3.1.

The frame, and position and force axes in its coordinates; velocity, bias wrench and termination wrench about the moving
part's reference point in axes of the B-frame. The bias is the wrench *applied to* the moving part, the termination
wrench the extra *reaction* on it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Any, NamedTuple

import numpy as np

from fmopt.control.compliance import axes, compliance_frame, free_part, row_space, twist_scale, wrenches_in
from fmopt.errors import InfeasibleError, SolverError
from fmopt.se3 import Pose
from fmopt.task.problem import Specification
from fmopt.values import Array, Value, frozen

_CHECK = 1e-7  # N, by which a solver's answer may break a balance
_SURE = 1.25  # times the threshold that the push alone can bring about
_ROUNDS = 8  # in which forces and what they may take from the motion settle
_SETTLED = 1e-3  # of that, which need not be there
_PRESSED = 0.5  # of what the least force can be


class Hold(Enum):
    """Held contacts stay closed under the whole push on the new ones, the reaction that ends the move, or neither."""

    PUSH = "push"
    STOP = "stop"
    NONE = "none"


def _nothing(_: Array) -> float:
    return 0.0


@dataclass(frozen=True, eq=False)
class GuardedMove(Value):
    """What a segment asks of its controller, all about the moving part's reference point at the goal, axes of B.

    Args:
        reference: pose of the moving part at the goal.
        displacement: V (6,) = (p_G − p_S, ω), m and rad.
        held: wrenches (m, 6) of the held contacts for a unit normal force, all of them, also dependent ones.
        points: their contact points (m, 3) in the B-frame, m.
        made: wrenches (k, 6) of the contacts that end the move, made together; none for a move that ends by its travel.
        bound: how much longer than ‖V‖ the way may be, m.
        resisting: how much work normal forces (m,) of the held contacts may take from the motion as errors turn them,
            J; none by default.
    """

    reference: Pose
    displacement: Array
    held: Array
    points: Array
    made: Array
    bound: float
    resisting: Callable[[Array], float] = _nothing

    def __post_init__(self) -> None:
        object.__setattr__(self, "displacement", frozen(self.displacement, 6, name="displacement"))
        object.__setattr__(self, "held", frozen(np.reshape(self.held, (-1, 6)), None, 6, name="held wrenches"))
        points = np.reshape(self.points, (-1, 3))
        object.__setattr__(self, "points", frozen(points, len(self.held), 3, name="contact points"))
        object.__setattr__(self, "made", frozen(np.reshape(self.made, (-1, 6)), None, 6, name="made wrenches"))

    @property
    def reaction(self) -> Array:
        """Wrench (6,) of a unit reaction of the new contacts, shared equally; zero where there are none."""
        return frozen(self.made.mean(axis=0) if len(self.made) else np.zeros(6))

    def length(self, rho: float) -> float:
        """‖V‖ in the metric of ρ, m."""
        return float(np.linalg.norm(self.displacement * twist_scale(rho)))


@dataclass(frozen=True, eq=False)
class Termination(Value):
    """When a move ends: the reaction wrench (6,) that reaches the threshold (N), or the travel (m) or time (s) used up.

    The wrench is zero where no contact is expected; then the move ends with its travel.
    """

    wrench: Array
    threshold: float
    max_travel: float
    timeout: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "wrench", frozen(self.wrench, 6, name="termination wrench"))


@dataclass(frozen=True, eq=False)
class HybridStrategy(Value):
    """The `hybrid` entry of a plan's segment.

    Args:
        frame: compliance frame (6,), a pose in the B-frame.
        position_axes: twists (6 − r, 6) in the frame's coordinates, orthonormal in diag(1, 1, 1, ρ², ρ², ρ²).
        force_axes: wrenches (r, 6) in its coordinates, orthonormal in the dual metric, reciprocal to the twists.
        velocity: twist (6,), V / ‖V‖_ρ.
        speed: m/s.
        bias_wrench: applied wrench (6,), N and N·m.
        push: size of the part of the bias that pushes along the motion, N in the metric of ρ.
        termination: when the move ends.
        normal_forces: (m,), a normal force of each held contact that balances the rest of the bias, N.
        stays: what the held contacts stay closed under.
    """

    frame: Array
    position_axes: Array
    force_axes: Array
    velocity: Array
    speed: float
    bias_wrench: Array
    push: float
    termination: Termination
    normal_forces: Array
    stays: Hold

    def __post_init__(self) -> None:
        for name in ("frame", "velocity", "bias_wrench"):
            object.__setattr__(self, name, frozen(getattr(self, name), 6, name=name))
        for name in ("position_axes", "force_axes"):
            object.__setattr__(self, name, frozen(getattr(self, name), None, 6, name=name))
        object.__setattr__(self, "normal_forces", frozen(self.normal_forces, None, name="normal forces"))

    def document(self, held: Sequence[str], made: Sequence[str]) -> dict[str, Any]:
        """As in the plan file, with the names of the held and of the made contacts in the order of the guarded move."""
        end = self.termination
        return {
            "frame": self.frame.tolist(),
            "position_axes": self.position_axes.tolist(),
            "force_axes": self.force_axes.tolist(),
            "velocity": self.velocity.tolist(),
            "speed": self.speed,
            "bias_wrench": self.bias_wrench.tolist(),
            "push": self.push,
            "normal_forces": [
                {"contact": name, "force": force} for name, force in zip(held, self.normal_forces.tolist(), strict=True)
            ],
            "termination": {
                "contacts": list(made),
                "wrench": end.wrench.tolist(),
                "threshold": end.threshold,
                "max_travel": end.max_travel,
                "timeout": end.timeout,
            },
        }


def hybrid_strategy(move: GuardedMove, rho: float, specification: Specification) -> HybridStrategy:
    """The strategy of a move.

    Args:
        move: what is held, where it goes, what ends it.
        rho: characteristic length, m.
        specification: speed, forces and friction.

    Raises:
        ValueError: the move has no length.
        InfeasibleError: the move does not approach its contact, or no bias within the forces holds all contacts.
    """
    length = move.length(rho)
    if not length > 0.0:
        raise ValueError("a move of no length has no direction")
    V = move.displacement / length
    frame = compliance_frame(move.held, move.points, move.reference, rho)
    split = axes(wrenches_in(frame, move.held, move.reference), rho)
    bias = bias_wrench(move, V, rho, specification)
    threshold = specification.termination_force
    travel = length + move.bound
    return HybridStrategy(
        frame.vector(),
        split.position,
        split.force,
        V,
        specification.speed,
        bias.wrench,
        bias.push,
        Termination(threshold * move.reaction, threshold, travel, 2.0 * travel / specification.speed),
        bias.normal_forces,
        bias.stays,
    )


@dataclass(frozen=True, eq=False)
class Bias(Value):
    """Applied wrench (6,), its push along the motion, normal forces (m,) that balance the rest of it, N."""

    wrench: Array
    push: float
    normal_forces: Array
    stays: Hold


def bias_wrench(move: GuardedMove, V: Array, rho: float, specification: Specification) -> Bias:
    """The applied wrench that holds every contact, the least normal force greatest.

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
    take where errors turn them, from one solution to the next. The push must allow for friction that need not be there,
    and what friction does not take comes onto the new contacts: contacts that it could pry open are pressed more, those
    whose friction asks for it less. Of equal answers that with the least greatest force is taken. Without a new contact
    there is no push. Where no g exists, Σ kⱼ = h takes the place of the second line: only the reaction that ends the
    move leaves all contacts closed; where none exists then either, the new contact pries a held one open as it is felt,
    and the program is solved without g. `stays` tells which.

    Args:
        move: the move.
        V: unit twist (6,) in the metric of ρ.
        rho: characteristic length, m.
        specification: forces and friction.

    Raises:
        InfeasibleError: the move does not approach its contact, or the greatest t is not positive.
        SolverError: the answer of the linear program does not balance.
    """
    m = len(move.held)
    if m == 0 and len(move.made) == 0:
        return Bias(np.zeros(6), 0.0, np.zeros(0), Hold.PUSH)
    push, along = np.zeros(6), 1.0
    if len(move.made):
        push, along = _push(move.reaction, V, row_space(move.held, rho), twist_scale(rho))
    for hold in Hold:
        x = _with_reserve(move, _program(move, V, rho, specification, push, along, hold), rho)
        if x is not None:
            return Bias(0.0 - move.held.T @ x[:m] + x[-2] * push, float(x[-2]), x[:m], hold)
    raise InfeasibleError(
        f"no bias wrench within {specification.contact_force:g} N and {specification.torque_limit:g} N m keeps all {m} "
        f"contacts and makes the next one felt at {specification.termination_force:g} N",
        advice="raise specification.contact_force or torque_limit, or lower termination_force or friction",
    )


class _Program(NamedTuple):
    """Maximise the last entry of x, and a little the least of the two before, over A x ≤ b, C x = d, x ≥ 0."""

    A: Array
    b: Array
    C: Array
    d: Array


def _program(
    move: GuardedMove, V: Array, rho: float, specification: Specification, push: Array, along: float, hold: Hold
) -> _Program:
    """The linear program of `bias_wrench` over x = (f, g, k, m, b, t), m the greatest of f; idle g stay at t."""
    W, m, n = move.held, len(move.held), len(move.made)
    h = specification.termination_force if n else 0.0
    basis, scale = row_space(W, rho), twist_scale(rho)
    spread = basis @ (W / scale).T
    drag = specification.friction * _sliding_speeds(W, move.points - move.reference.p, V) * (n > 0)
    F = specification.contact_force
    f, g, k = (np.eye(2 * m + n + 3)[cut] for cut in (slice(m), slice(m, 2 * m), slice(2 * m, 2 * m + n)))
    greatest, b, t = np.eye(2 * m + n + 3)[-3:]
    torque = -W[:, 3:].T @ f + np.outer(push[3:], b)
    A = np.vstack([t - f, t - g, f - greatest, drag @ f - along * b, f.sum(axis=0) + b, g.sum(axis=0), torque, -torque])
    pressed = _SURE * h * abs(float(move.reaction @ V))
    limits = np.concatenate([np.zeros(3 * m), [-pressed, F, F], [specification.torque_limit] * 6])
    balance = spread @ (g - f) + basis @ (move.made / scale).T @ k
    taken = -(move.made @ V) @ k - along * b if hold is Hold.PUSH else k.sum(axis=0)
    C = np.vstack([taken, balance[: 0 if hold is Hold.NONE else None]])
    d = np.concatenate([[0.0 if hold is Hold.PUSH else h], np.zeros(len(C) - 1)])
    return _Program(A, limits, C, d)


def _with_reserve(move: GuardedMove, program: _Program, rho: float) -> Array | None:
    """The best x whose push also does the work that its forces may take, None without any.

    The forces decide how much that is; a few rounds settle it. A push so large that the least force would fall below
    a share of what it can be is made smaller: contacts that are hardly pressed are lost.
    """
    m, length = len(move.held), move.length(rho)

    def solved(reserve: float) -> Array | None:
        limits = program.b.copy()
        limits[3 * m] -= reserve
        x = _best(program._replace(b=limits))
        return x if x is not None and x[-1] > least else None

    least = _CHECK
    found, reserve, most = solved(0.0), 0.0, np.inf
    if found is None or not len(move.made):
        return found
    least = _PRESSED * float(found[-1])
    for _ in range(_ROUNDS):
        needed = move.resisting(found[:m]) / length
        if needed <= reserve * (1.0 + _SETTLED):
            break
        tried = needed if needed < most else 0.5 * (reserve + most)
        x = solved(tried)
        if x is None:
            most = tried
        else:
            found, reserve = x, tried
    return found


def _push(made: Array, V: Array, basis: Array, scale: Array) -> tuple[Array, float]:
    """Unit wrench u (6,) along the motion, in the complement of the held wrenches, and its power u·V."""
    if not made @ V < 0.0:
        raise InfeasibleError(
            f"the move does not approach the contact that is to end it (w·V = {float(made @ V):.3g})",
            advice="choose a goal that makes the contact from its free side",
        )
    direction = V * scale
    free = free_part(direction, basis)
    if free is None:
        raise InfeasibleError("the move runs into a contact that it holds", advice="release the contact first")
    size = float(np.linalg.norm(free))
    return free / size * scale, float(free @ direction) / size


def _sliding_speeds(W: Array, arms: Array, V: Array) -> Array:
    """Speeds (m,) at which contact points slide along their faces for the unit twist V."""
    velocity = V[:3] + np.cross(V[3:], arms)
    normals = W[:, :3]
    return np.asarray(np.linalg.norm(velocity - np.sum(velocity * normals, axis=1, keepdims=True) * normals, axis=1))


def _best(program: _Program) -> Array | None:
    """The best x, re-checked; None where there is none."""
    from scipy.optimize import linprog

    A, b, C, d = program
    cost = np.zeros(A.shape[1])
    cost[-3:] = 1e-4, 1e-3, -1.0
    limits: Any = [(0.0, None)] * (len(cost) - 1) + [(None, float(b.max()))]
    answer = linprog(cost, A_ub=A, b_ub=b, A_eq=C, b_eq=d, bounds=limits)
    if answer.status == 2:
        return None
    if answer.status != 0:
        raise SolverError(f"the bias program stopped: {answer.message}", "check the specification's forces")
    x = np.asarray(answer.x, dtype=np.float64)
    short = max(float(np.max(A @ x - b)), float(np.max(np.abs(C @ x - d))))
    if not short <= _CHECK:
        raise SolverError(f"the bias program's answer breaks its balance by {short:.3g} N", "report this problem")
    return x
