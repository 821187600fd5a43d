"""Placement of goal poses as cone programs: the largest least clearance over linearised C-surfaces.

Poses are local coordinates X = (d, δ) around one reference pose; the distance of X from N·X = D is measured
in the metric |X|² = |d|² + ρ²|δ|² ([DakinPopplestone1993] appendix II, with D′ = D/|N*| for its eq. 19).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike

from fmopt.planning.optimise.cone_program import ConeProgram, Norm, Solution, Solver, certify, checked, left_out, stated
from fmopt.planning.optimise.solvers import ClarabelSolver
from fmopt.spatial.values import Array, Value, frozen

_BINDING = 1e-6  # share in the price of t, which is 1 in all, from which a row binds


@dataclass(frozen=True)
class Metric:
    """How rotations compare with translations: characteristic length ρ (m), and the clearance (m) as unit."""

    rho: float
    clearance: float

    @property
    def sigma(self) -> Array:
        """Factors (6,) that make local coordinates comparable, (1, 1, 1, ρ, ρ, ρ)."""
        return np.array([1.0, 1.0, 1.0, self.rho, self.rho, self.rho])

    @property
    def units(self) -> Array:
        """Natural sizes (6,) of local coordinates: the clearance, and the clearance over ρ."""
        return self.clearance / self.sigma

    def dual_norm(self, N: ArrayLike) -> Array:
        """|N*| of rows (…, 6): the distance of X from N·X = D is (N·X − D)/|N*|, in m."""
        return np.asarray(np.linalg.norm(np.asarray(N) / self.sigma, axis=-1))


@dataclass(frozen=True, eq=False)
class Flat(Value, E=(None, 6), e=("E",)):
    """The affine space E X = e of a contact state, E (p, 6), e (p,)."""

    E: Array
    e: Array

    @staticmethod
    def everything() -> Flat:
        """Free space: no equality."""
        return Flat(np.zeros((0, 6)), np.zeros(0))

    @staticmethod
    def point(X: ArrayLike) -> Flat:
        """The single pose X (6,)."""
        return Flat(np.eye(6), np.asarray(X, dtype=np.float64))


@dataclass(frozen=True, eq=False)
class Room(Value):
    """Within what a pose is placed, and what counts as its clearance t.

    Args:
        metric: scale of rotations, and the unit.
        lower: bounds (6,) of the local coordinates from below, m and rad.
        weights: metres of slack per metre of clearance (k,), else |N*|, so that t is a distance in the metric.
        growth: λ_N (k,), slack lost per metre of travel, else none.
        cap: largest clearance of interest (m), else the diameter of the bounds.
    """

    metric: Metric = field(kw_only=True)
    lower: Array = field(kw_only=True)
    upper: Array = field(kw_only=True)
    weights: Array = field(default_factory=left_out, kw_only=True)
    growth: Array = field(default_factory=left_out, kw_only=True)
    cap: float = field(default=math.inf, kw_only=True)

    def complete(self, weights: Array, *, moving: bool) -> None:
        """Checks what is given while the value is made, and puts defaults where something is left out.

        For want of others, `weights` (k,) are those of the obstacles; with a start to travel from it is `moving`.

        Raises:
            ValueError: shapes do not fit, growth where nothing moves, or a negative weight or growth.
        """
        k = len(weights)
        stated(self, weights=weights, growth=np.zeros(k))
        for name, n in (("lower", 6), ("upper", 6), ("weights", k), ("growth", k)):
            object.__setattr__(self, name, frozen(getattr(self, name), n, name=name))
        if (self.weights < 0.0).any() or (self.growth < 0.0).any() or (self.growth.any() and not moving):
            raise ValueError("weights and growth must not be negative, and growth needs a start")
        if self.cap == math.inf:
            object.__setattr__(self, "cap", float(np.linalg.norm(self.metric.sigma * (self.upper - self.lower))))


@dataclass(frozen=True, eq=False)
class Placement(Room, N=(None, 6), D=("N",)):
    """Where to put the goal of a segment, or both its ends: maximise t over

        N_j·G − D_j − growth_j |G − S|_σ ≥ weights_j t,   G in `goal`,   lower ≤ G ≤ upper,   t ≤ cap.

    A fixed pose as `start` enters the growth alone. A `Flat` as start makes S a variable within it, with
    N_j·S − D_j ≥ weights_j t as well. A row of weight 0 must hold but does not count as clearance.

    Args:
        N: gradient rows (k, 6) of the obstacles, any length.
        D: offsets (k,), in m times that length; allowances such as √(NᵀQN) are added by the caller.
        start: fixed start pose (6,), or the affine space of a free one.

    Raises:
        ValueError: shapes do not fit, growth without a start, or a negative weight or growth.
    """

    N: Array
    D: Array
    goal: Flat = field(default_factory=Flat.everything, kw_only=True)
    start: Array | Flat | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.start is not None and not isinstance(self.start, Flat):
            object.__setattr__(self, "start", frozen(self.start, 6, name="start"))
        self.complete(self.metric.dual_norm(self.N), moving=self.start is not None)

    def program(self) -> ConeProgram:
        """The cone program over (G, t), or (G, S, t) when the start is free."""
        ends = 2 if isinstance(self.start, Flat) else 1
        n, k = 6 * ends + 1, len(self.D)
        G = np.zeros((ends * k, n))
        for end in range(ends):
            G[end * k : (end + 1) * k, 6 * end : 6 * end + 6] = self.N
        G[:, -1] = -np.tile(self.weights, ends)
        flats = [self.goal, self.start] if isinstance(self.start, Flat) else [self.goal]
        A = np.zeros((sum(len(flat.e) for flat in flats), n))
        A[: len(self.goal.e), :6] = self.goal.E
        if isinstance(self.start, Flat):
            A[len(self.goal.e) :, 6:12] = self.start.E
        norms, W = self._travel(n), np.zeros((ends * k, 0))
        if norms:
            W = np.concatenate([self.growth, np.zeros((ends - 1) * k)])[:, None]
        return ConeProgram(
            np.append(np.zeros(n - 1), 1.0),
            A=A,
            b=np.concatenate([flat.e for flat in flats]),
            G=G,
            h=-np.tile(self.D, ends),
            W=W,
            norms=norms,
            lower=np.append(np.tile(self.lower, ends), -np.inf),
            upper=np.append(np.tile(self.upper, ends), self.cap),
            units=np.append(np.tile(self.metric.units, ends), self.metric.clearance),
        )

    def _travel(self, n: int) -> tuple[Norm, ...]:
        if not self.growth.any():
            return ()
        F, offset, sigma = np.zeros((6, n)), np.zeros(6), np.diag(self.metric.sigma)
        F[:, :6] = sigma
        if isinstance(self.start, Flat):
            F[:, 6:12] = -sigma
        elif self.start is not None:
            offset = -sigma @ self.start
        return (Norm(F, offset),)

    def clearances(self, x: Array) -> Array:
        """Clearance of every counted row and end at x, shape (ends, k), in m; rows of weight 0 have inf."""
        slacks = self.program().slacks(np.append(x[:-1], 0.0)).reshape(-1, len(self.D))  # at t = 0
        return per_weight(slacks, self.weights)

    def at(self, poses: Array) -> Solution:
        """The certified (not optimal) solution at given poses (ends, 6), with t as large as they allow.

        Raises:
            SolverError: the poses leave their affine spaces, the bounds or a row of weight 0.
        """
        x = np.append(np.ravel(poses), 0.0)
        x[-1] = min(self.cap, float(self.clearances(x).min(initial=np.inf)))
        return certify(self.program(), x)


def per_weight(slacks: Array, weights: Array) -> Array:
    """Clearances (…, k) of slacks (…, k), m, by weights (k,), 0 or more; those of weight 0 have inf."""
    counted = weights > 0.0
    return np.asarray(np.where(counted, slacks / np.where(counted, weights, 1.0), np.inf))


def max_min_clearance(problem: Placement, solver: Solver | None = None) -> Solution:
    """The poses of largest least clearance; the value t (m) is negative when obstacles must overlap.

    The answer of the solver, Clarabel if None, is checked again.

    Raises:
        InfeasibleError: the affine spaces, bounds and rows of weight 0 contradict each other.
        SolverError: no certified optimum.
    """
    return checked(problem.program(), ClarabelSolver() if solver is None else solver)


def lexicographic(problem: Placement, solver: Solver | None = None) -> Solution:
    """The max-min solution whose second-least clearance is largest too, and so on.

    Rows with positive multipliers are tight at every optimum: they are held where they are, and the rest
    is maximised again, until no row is left.

    Raises:
        InfeasibleError, SolverError: as `max_min_clearance`.
    """
    solver = ClarabelSolver() if solver is None else solver
    original = problem.program()
    first = checked(original, solver)
    program, latest = original, first
    for _ in range(len(original.h)):  # each round holds at least one row more
        held = _held(program, latest)
        if held is None:
            break
        program = held
        latest = checked(program, solver)
    x = np.append(latest.x[:-1], first.value)
    x[-1] = min(first.value, float(problem.clearances(x).min(initial=np.inf)))
    return certify(original, x, first.duals)  # later multipliers are of other programs


def _held(program: ConeProgram, solution: Solution) -> ConeProgram | None:
    """The program with its binding rows held at their level and the others still to be raised; None at the end."""
    counted = program.G[:, -1] < 0.0
    duals = np.zeros(len(program.h)) if solution.duals is None else solution.duals.rows
    binding = counted & (-program.G[:, -1] * duals > _BINDING)
    if not binding.any() or (counted == binding).all() or solution.value >= program.upper[-1]:
        return None
    for k in np.flatnonzero((program.W[binding] > 0.0).any(axis=0))[::-1]:  # from the last: others keep their places
        program = _straightened(program, int(k), solution.x)
    level = program.h[binding] + program.G[binding, -1] * solution.value
    held = program.G[binding].copy()
    held[:, -1] = 0.0
    return replace(
        program,
        A=np.vstack([program.A, held]),
        b=np.concatenate([program.b, -level]),
        G=program.G[~binding],
        h=program.h[~binding],
        W=program.W[~binding],
    )


def _straightened(program: ConeProgram, k: int, x: Array) -> ConeProgram:
    """The program on the ray where |F x + g| is linear, with that norm replaced by the linear function.

    A row with a norm that is tight at every optimum is constant over them; it is concave, so the norm is linear
    there, and F x + g keeps its direction.
    """
    F, g = program.norms[k].F, program.norms[k].g
    v = F @ x + g
    length = float(np.linalg.norm(v))
    along = v / length if length > _BINDING * program.size.norms[k] else np.zeros_like(v)
    across = np.eye(len(g)) - np.outer(along, along)
    return replace(
        program,
        A=np.vstack([program.A, across @ F]),
        b=np.concatenate([program.b, -across @ g]),
        G=program.G - np.outer(program.W[:, k], along @ F),
        h=program.h - program.W[:, k] * float(along @ g),
        W=np.delete(program.W, k, axis=1),
        norms=program.norms[:k] + program.norms[k + 1 :],
    )
