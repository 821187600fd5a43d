"""C-PF along the axes: freedom decomposition, artificial position constraints Pₐ = Γ(S, P) and forces Fₐ = Ω(S).

[LeeHuang1985] sections 2 and 4.2. A degree with s ≠ 0 is natural position constrained and servoed in force, one with
s = 0 is artificially position constrained and servoed in position, N_c + N_a = 6. Ω gives the *reaction* that the fixed
part puts on the moving part: where motion in + is stopped (s = 1) it is −f. A controller that takes the wrench that it
applies to the moving part wants the opposite sign.

The nominal trajectory has its S from what an uncertain part could touch. A certified motion has one from the contacts
that it holds: motion along an axis is stopped where a held contact would open the other way, w·e ≠ 0 for its wrench w.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import ArrayLike

from fmopt.plan import Plan
from fmopt.plan.contact_geometry import Contact, contacts
from fmopt.plan.guarded_moves import length
from fmopt.spatial.se3 import Pose
from fmopt.spatial.values import Array, Value, frozen

if TYPE_CHECKING:
    from fmopt.plan.description import Nominal

AXES = ("x", "y", "z", "rx", "ry", "rz")
_REACTION = {0: 0.0, 1: -1.0, -1: 1.0, 2: 1.0}
_POSITION = ("p_x", "p_y", "p_z", "q_x", "q_y", "q_z")
_FORCE = ("f_x", "f_y", "f_z", "tau_x", "tau_y", "tau_z")
_STOPS = 1e-6  # of a unit normal force, torques counted with ρ: what a contact puts on an axis that it stops
_DEPTH = 1e-9  # m
_NAMED = 3  # contacts that a reason names


@dataclass(frozen=True)
class Decomposition:
    """The six degrees (x, y, z, rx, ry, rz) split by one value s of S(t)."""

    s: tuple[int, ...]

    def __post_init__(self) -> None:
        if len(self.s) != 6 or any(value not in _REACTION for value in self.s):
            raise ValueError(f"S has six values of -1, 0, 1, 2, not {self.s}")

    @property
    def natural(self) -> tuple[int, ...]:
        """Indices of the natural position constrained degrees, N_c of them."""
        return tuple(axis for axis, value in enumerate(self.s) if value != 0)

    @property
    def artificial(self) -> tuple[int, ...]:
        """Indices of the artificially position constrained degrees, N_a = 6 − N_c of them."""
        return tuple(axis for axis, value in enumerate(self.s) if value == 0)

    @property
    def either_sign(self) -> tuple[int, ...]:
        """Indices of the degrees stopped both ways, whose reaction may have either sign."""
        return tuple(axis for axis, value in enumerate(self.s) if value == 2)

    @property
    def written(self) -> dict[str, str]:
        """The subspaces as the paper writes their elements, such as C_ap: (0, 0, p_z, 0, 0, q_z)."""
        rows = (("C_np", _POSITION, self.natural), ("C_ap", _POSITION, self.artificial), ("C_af", _FORCE, self.natural))
        return {name: f"({', '.join(terms[k] if k in kept else '0' for k in range(6))})" for name, terms, kept in rows}


def gamma(s: Sequence[int], P: ArrayLike) -> Array:
    """Γ(S, P): the artificial position constraints Pₐ (6,), P (m and rad) where s = 0 and 0 elsewhere; P − Pₐ is Pₙ."""
    return np.where(np.isin(np.arange(6), Decomposition(tuple(s)).artificial), np.asarray(P, dtype=np.float64), 0.0)


def natural_constraints(s: Sequence[int], P: ArrayLike) -> Array:
    """Pₙ (6,), the part of P in C_np, with P = Pₐ + Pₙ: what contact holds and position servoing leaves alone."""
    return np.where(np.isin(np.arange(6), Decomposition(tuple(s)).natural), np.asarray(P, dtype=np.float64), 0.0)


def omega(s: Sequence[int], f: ArrayLike) -> Array:
    """Ω(S): the reaction Fₐ (6,) on the moving part, −f where s = 1, +f where s = −1, 0 where s = 0.

    Where s = 2 the paper's ±f stands as +f; `Decomposition.either_sign` names these degrees. Wanted contact forces and
    torques f (6,) are not negative, N and N·m.
    """
    signs = np.array([_REACTION[value] for value in Decomposition(tuple(s)).s])
    return np.asarray(signs * np.asarray(f, dtype=np.float64) + 0.0)  # no minus zero


class Forces(Protocol):
    """What contact forces are asked for, by a problem or a plan, N and N·m."""

    @property
    def contact_force(self) -> float:
        """With which contacts are held, N."""

    @property
    def torque_limit(self) -> float:
        """The largest torque, N·m."""


def contact_forces(asked: Forces, rho: float) -> Array:
    """Contact forces fᵢ (6,), N and N·m: the specification's force, its torque about ρ (m) up to the torque limit."""
    return frozen([asked.contact_force] * 3 + [min(asked.contact_force * rho, asked.torque_limit)] * 3)


@dataclass(frozen=True, eq=False)
class Stretch(Value, pa_start=(6,), pa_end=(6,), fa=(6,)):
    """A move of a certified motion along the axes; the last one is the seated part.

    Args:
        move: counts from 0; None for the seated part.
        start, end: when it is commanded, s from the beginning of the motion, at the plan's speeds.
        s: S of the contacts that it holds, at its goal.
        pa_start, pa_end: Pₐ (6,) at both ends, m and rad.
        fa: Fₐ (6,), the reaction on the moving part, N and N·m.
        by: the contacts that stop each axis (6).
        nominal: S of the nominal trajectory where that comes as deep.
    """

    move: int | None
    start: float
    end: float
    s: tuple[int, ...]
    pa_start: Array
    pa_end: Array
    fa: Array
    by: tuple[tuple[str, ...], ...]
    nominal: tuple[int, ...]

    @property
    def differences(self) -> tuple[str, ...]:
        """Where S of the motion and of the nominal trajectory are not the same, and why: axes with the same reason."""
        axes: dict[str, list[str]] = {}
        for axis, own, other, by in zip(AXES, self.s, self.nominal, self.by, strict=True):
            if own != other:
                axes.setdefault(_reason(own, other, by), []).append(axis)
        return tuple(f"{', '.join(names)}: {reason}" for reason, names in axes.items())


def _reason(own: int, other: int, by: Sequence[str]) -> str:
    """Why an axis has an S of its own, where another one is that of the nominal trajectory."""
    names = ", ".join(by[:_NAMED]) + (f" and {len(by) - _NAMED} more" if len(by) > _NAMED else "")
    if own == 0:
        return "what could be touched on the nominal way is not held here"
    if other == 0:
        return f"{names} held here, which the nominal way does not come near"
    if other == 2:
        return f"either side could be touched on the nominal way, {names} on one side held here"
    if own == 2:
        return f"{names} held here on both sides, on the nominal way one side alone could be touched"
    return f"{names} held here, on the nominal way the other side could be touched"


def stretches(plan: Plan) -> tuple[Stretch, ...]:
    """S, Pₐ and Fₐ of a plan's motion, one for each move, and of the seated part; none without a nominal trajectory.

    Raises:
        PlanFormatError: a contact of the plan has no normal.
    """
    if plan.description.nominal is None:
        return ()
    known, found, now = contacts(plan), list[Stretch](), 0.0
    for move, run in groupby(plan.segments, key=lambda segment: segment.move):
        pieces = list(run)
        first, last = pieces[0], pieces[-1]
        start, goal = np.array(first.start), np.array(last.goal)
        ends = ((Pose.from_vector(piece.start), Pose.from_vector(piece.goal)) for piece in pieces)
        lasting = (length(*both, plan.rho) / piece.hybrid.speed for both, piece in zip(ends, pieces, strict=True))
        end = now + sum(lasting)
        found.append(_stretch(plan, known, last.state, move, (now, end), (start, goal)))
        now = end
    final = plan.segments[-1]
    goal = np.array(final.goal)
    return (*found, _stretch(plan, known, final.goal_state, None, (now, now), (goal, goal)))


def _stretch(
    plan: Plan,
    known: Mapping[str, Contact],
    held: Sequence[str],
    move: int | None,
    times: tuple[float, float],
    poses: tuple[Array, Array],
) -> Stretch:
    nominal, pose = plan.description.nominal, Pose.from_vector(poses[1])
    assert nominal is not None
    scale = np.array([1.0, 1.0, 1.0, *[1.0 / plan.rho] * 3])
    wrenches = {name: scale * known[name].wrench(pose) for name in held if not known[name].level(pose)}
    s, by = [], []
    for axis in range(6):
        against = {name: w[axis] for name, w in wrenches.items() if abs(w[axis]) > _STOPS}
        forward, back = any(x < 0.0 for x in against.values()), any(x > 0.0 for x in against.values())
        s.append(2 if forward and back else 1 if forward else -1 if back else 0)
        by.append(tuple(against))
    fa = omega(s, contact_forces(plan.specification, plan.rho))
    pa = [gamma(s, at) for at in poses]
    return Stretch(move, *times, tuple(s), pa[0], pa[1], fa, tuple(by), _nominal(nominal, float(poses[1][2])))


def _nominal(nominal: "Nominal", depth: float) -> tuple[int, ...]:
    """S of the nominal trajectory when it first comes as deep (z, m)."""
    times, heights = np.array(nominal.times), np.array(nominal.nodes)[:, 2]
    below = np.flatnonzero(heights <= depth + _DEPTH)
    k = int(below[0]) if len(below) else len(times) - 1
    at = float(times[k])
    if k > 0 and heights[k - 1] > heights[k]:
        # The node may lie above the depth by up to `_DEPTH`: the share is 1 then, no more.
        share = (heights[k - 1] - max(depth, heights[k])) / (heights[k - 1] - heights[k])
        at = float(times[k - 1] + share * (times[k] - times[k - 1]))
    # Here in s: at the border of two intervals rounding decides, and the first one counts.
    inside = [interval for interval in nominal.intervals if interval.start - _DEPTH <= at <= interval.end + _DEPTH]
    return inside[0].s if inside else (0,) * 6
