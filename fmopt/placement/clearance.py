"""Placement of goal poses as cone programs: the largest least clearance over linearised C-surfaces.

Poses are local coordinates X = (d, δ) around one reference pose; the distance of X from N·X = D is measured
in the metric |X|² = |d|² + ρ²|δ|² ([DakinPopplestone1993] appendix II, with D′ = D/|N*| for its eq. 19).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from fmopt.placement.program import ConeProgram, Norm, Solution, Solver, certify, checked
from fmopt.placement.solvers import ClarabelSolver
from fmopt.values import Array, Value, frozen

_BINDING = 1e-6


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
class Flat(Value):
    """The affine space E X = e of a contact state, E (p, 6), e (p,)."""

    E: Array
    e: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "E", frozen(self.E, None, 6, name="E"))
        object.__setattr__(self, "e", frozen(self.e, len(self.E), name="e"))

    @staticmethod
    def everything() -> Flat:
        """Free space: no equality."""
        return Flat(np.zeros((0, 6)), np.zeros(0))

    @staticmethod
    def point(X: ArrayLike) -> Flat:
        """The single pose X (6,)."""
        return Flat(np.eye(6), np.asarray(X, dtype=np.float64))


@dataclass(frozen=True, eq=False)
class Placement(Value):
    """Where to put the goal of a segment, or both its ends: maximise t over

        N_j·G − D_j − growth_j |G − S|_σ ≥ weights_j t,   G in `goal`,   lower ≤ G ≤ upper,   t ≤ cap.

    A fixed pose as `start` enters the growth alone. A `Flat` as start makes S a variable within it, with
    N_j·S − D_j ≥ weights_j t as well. A row of weight 0 must hold but does not count as clearance.

    Shapes: N (k, 6), D, weights and growth (k,), bounds (6,). Built by `placement`.
    """

    N: Array
    D: Array
    weights: Array
    growth: Array
    goal: Flat
    start: Array | Flat | None
    lower: Array
    upper: Array
    metric: Metric
    cap: float

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
        return ConeProgram.of(
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
        program = self.program()
        slacks = program.slacks(np.append(x[:-1], 0.0)).reshape(-1, len(self.D))
        return per_weight(slacks, self.weights)

    def at(self, poses: Array) -> Solution:
        """The certified (not optimal) solution at given poses (ends, 6), with t as large as they allow.

        Raises:
            SolverError: the poses leave their affine spaces, the bounds or a row of weight 0.
        """
        x = np.append(np.ravel(poses), 0.0)
        x[-1] = min(self.cap, float(self.clearances(x).min(initial=np.inf)))
        return certify(self.program(), x)


def placement(
    N: ArrayLike,
    D: ArrayLike,
    *,
    metric: Metric,
    lower: ArrayLike,
    upper: ArrayLike,
    goal: Flat | None = None,
    start: ArrayLike | Flat | None = None,
    weights: ArrayLike | None = None,
    growth: ArrayLike | None = None,
    cap: float | None = None,
) -> Placement:
    """A placement problem; see `Placement`.

    Args:
        N: gradient rows (k, 6) of the obstacles, any length.
        D: offsets (k,), in m times that length; allowances such as √(NᵀQN) are added by the caller.
        metric: scale of rotations, and the unit.
        lower, upper: bounds (6,) of the local coordinates, m and rad.
        goal: affine space of the goal state, else everything.
        start: fixed start pose (6,), or the affine space of a free one.
        weights: metres of slack per metre of clearance (k,), else |N*|, so that t is a distance in the metric.
        growth: λ_N (k,), slack lost per metre of travel.
        cap: largest clearance of interest (m), else the diameter of the bounds.

    Raises:
        ValueError: shapes do not fit, growth without a start, or a negative weight or growth.
    """
    rows = frozen(N, None, 6, name="N")
    k, low, high = len(rows), frozen(lower, 6, name="lower"), frozen(upper, 6, name="upper")
    weigh, grow = weighed(k, metric.dual_norm(rows) if weights is None else weights, growth, moving=start is not None)
    return Placement(
        rows,
        frozen(D, k, name="D"),
        weigh,
        grow,
        Flat.everything() if goal is None else goal,
        start if start is None or isinstance(start, Flat) else frozen(start, 6, name="start"),
        low,
        high,
        metric,
        float(np.linalg.norm(metric.sigma * (high - low))) if cap is None else cap,
    )


def weighed(k: int, weights: ArrayLike, growth: ArrayLike | None, *, moving: bool) -> tuple[Array, Array]:
    """Weights and growth (k,) of obstacles, no growth by default.

    Raises:
        ValueError: shapes do not fit, growth where nothing moves, or a negative weight or growth.
    """
    weigh = frozen(weights, k, name="weights")
    grow = frozen(np.zeros(k) if growth is None else growth, k, name="growth")
    if (weigh < 0.0).any() or (grow < 0.0).any() or (grow.any() and not moving):
        raise ValueError("weights and growth must not be negative, and growth needs a start")
    return weigh, grow


def per_weight(slacks: Array, weights: Array) -> Array:
    """Clearances of slacks (…, k) in m; those of weight 0 have inf."""
    counted = weights > 0.0
    return np.asarray(np.where(counted, slacks / np.where(counted, weights, 1.0), np.inf))


def max_min_clearance(problem: Placement, solver: Solver | None = None) -> Solution:
    """The poses of largest least clearance; the value t (m) is negative when obstacles must overlap.

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
    for _ in range(len(original.h)):
        held = _held(program, latest)
        if held is None:
            break
        program = held
        latest = checked(program, solver)
    x = np.append(latest.x[:-1], first.value)
    x[-1] = min(first.value, float(problem.clearances(x).min(initial=np.inf)))
    return certify(original, x, first.duals)


def _held(program: ConeProgram, solution: Solution) -> ConeProgram | None:
    """The program with its binding rows held at their level and the others still to be raised; None at the end."""
    counted = program.G[:, -1] < 0.0
    duals = np.zeros(len(program.h)) if solution.duals is None else solution.duals.rows
    binding = counted & (-program.G[:, -1] * duals > _BINDING)
    if not binding.any() or (counted == binding).all() or solution.value >= program.upper[-1]:
        return None
    for k in np.flatnonzero((program.W[binding] > 0.0).any(axis=0))[::-1]:
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
