"""C-PF along the axes: freedom decomposition, artificial position constraints Pₐ = Γ(S, P) and forces Fₐ = Ω(S).

[LeeHuang1985] sections 2 and 4.2. A degree with s ≠ 0 is natural position constrained and servoed in force, one with
s = 0 is artificially position constrained and servoed in position, N_c + N_a = 6. Ω gives the *reaction* that the fixed
part puts on the moving part: where motion in + is stopped (s = 1) it is −f. A controller that takes the wrench that it
applies to the moving part wants the opposite sign.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from fmopt.nominal.intervals import FreedomInterval
from fmopt.nominal.trajectory import NominalTrajectory
from fmopt.task.problem import Specification
from fmopt.values import Array, Value, frozen

_REACTION = {0: 0.0, 1: -1.0, -1: 1.0, 2: 1.0}
_POSITION = ("p_x", "p_y", "p_z", "q_x", "q_y", "q_z")
_FORCE = ("f_x", "f_y", "f_z", "tau_x", "tau_y", "tau_z")


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
    def C_np(self) -> Array:
        """Basis (N_c, 6) of the subspace of natural position constraints."""
        return frozen(np.eye(6)[list(self.natural)], None, 6)

    @property
    def C_ap(self) -> Array:
        """Basis (N_a, 6) of the subspace of artificial position constraints, the complement of C_np."""
        return frozen(np.eye(6)[list(self.artificial)], None, 6)

    @property
    def C_af(self) -> Array:
        """Basis (N_c, 6) of the subspace of artificial reaction-force constraints, in force space."""
        return self.C_np

    @property
    def written(self) -> dict[str, str]:
        """The subspaces as the paper writes their elements, such as C_ap: (0, 0, p_z, 0, 0, q_z)."""
        rows = (("C_np", _POSITION, self.natural), ("C_ap", _POSITION, self.artificial), ("C_af", _FORCE, self.natural))
        return {
            name: f"({', '.join(letters[k] if k in kept else '0' for k in range(6))})" for name, letters, kept in rows
        }


def gamma(s: Sequence[int], P: ArrayLike) -> Array:
    """Γ(S, P): the artificial position constraints Pₐ (6,), P where s = 0 and 0 elsewhere; P − Pₐ is Pₙ."""
    free = Decomposition(tuple(s)).artificial
    return np.where(np.isin(np.arange(6), free), np.asarray(P, dtype=np.float64), 0.0)


def natural_constraints(s: Sequence[int], P: ArrayLike) -> Array:
    """Pₙ (6,), the part of P in C_np, with P = Pₐ + Pₙ: what contact holds and position servoing leaves alone."""
    held = Decomposition(tuple(s)).natural
    return np.where(np.isin(np.arange(6), held), np.asarray(P, dtype=np.float64), 0.0)


def omega(s: Sequence[int], f: ArrayLike) -> Array:
    """Ω(S): the reaction Fₐ (6,) on the moving part, −f where s = 1, +f where s = −1, 0 where s = 0.

    Where s = 2 the paper's ±f stands as +f; `Decomposition.either_sign` names these degrees.

    Args:
        s: S.
        f: wanted contact forces and torques (6,), not negative, N and N·m.
    """
    signs = np.array([_REACTION[value] for value in Decomposition(tuple(s)).s])
    return np.asarray(signs * np.asarray(f, dtype=np.float64) + 0.0)


def contact_forces(specification: Specification, rho: float) -> Array:
    """Wanted contact forces fᵢ (6,): the specification's force, and its torque about ρ (m) up to the torque limit."""
    torque = min(specification.contact_force * rho, specification.torque_limit)
    return frozen([specification.contact_force] * 3 + [torque] * 3)


@dataclass(frozen=True, eq=False)
class PositionForce(Value):
    """Pₐ(t) and Fₐ(t) on [start, end], where P(t) is straight and S constant.

    Args:
        start, end: s.
        s: S.
        pa_start, pa_end: Pₐ (6,) at both ends, straight between, m and rad.
        pn_start, pn_end: Pₙ (6,) likewise; P = Pₐ + Pₙ.
        fa: Fₐ (6,), the reaction on the moving part, N and N·m.
    """

    start: float
    end: float
    s: tuple[int, ...]
    pa_start: Array
    pa_end: Array
    pn_start: Array
    pn_end: Array
    fa: Array

    def __post_init__(self) -> None:
        for name in ("pa_start", "pa_end", "pn_start", "pn_end", "fa"):
            object.__setattr__(self, name, frozen(getattr(self, name), 6, name=name))

    @property
    def applied(self) -> Array:
        """The wrench (6,) that a controller applies to the moving part, −Fₐ."""
        return frozen(0.0 - self.fa)

    def document(self) -> dict[str, Any]:
        """A row of the plan file's "position_force"."""
        return {
            "t0": self.start,
            "t1": self.end,
            "s": list(self.s),
            "pa_start": self.pa_start.tolist(),
            "pa_end": self.pa_end.tolist(),
            "pn_start": self.pn_start.tolist(),
            "pn_end": self.pn_end.tolist(),
            "fa": self.fa.tolist(),
            "fa_sign": "reaction",
            "applied": self.applied.tolist(),
            "either_sign": list(Decomposition(self.s).either_sign),
        }


def position_force(
    path: NominalTrajectory, freedom: Sequence[FreedomInterval], forces: ArrayLike
) -> tuple[PositionForce, ...]:
    """C-PF: P(t) × S(t) → Pₐ(t) × Fₐ(t), one row for each stretch on which P is straight and S constant.

    Args:
        path: P(t).
        freedom: S(t) on [0, T].
        forces: fᵢ (6,), N and N·m.
    """
    rows = []
    for interval in freedom:
        inner = [float(t) for t in path.times if interval.start < t < interval.end]
        for a, b in pairwise([interval.start, *inner, interval.end]):
            pa, pn = ([split(interval.s, path.at(t)) for t in (a, b)] for split in (gamma, natural_constraints))
            rows.append(PositionForce(a, b, interval.s, pa[0], pa[1], pn[0], pn[1], omega(interval.s, forces)))
    return tuple(rows)
