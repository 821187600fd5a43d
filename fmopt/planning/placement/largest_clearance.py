"""Placement of goal poses as cone programs: the largest least clearance over linearised C-surfaces.

Poses are local coordinates X = (d, δ) around one reference pose; the distance of X from N·X = D is measured
in the metric |X|² = |d|² + ρ²|δ|² ([DakinPopplestone1993] appendix II, with D′ = D/|N*| for its eq. 19).
"""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike

from fmopt.planning.optimise.cone_program import ConeProgram, Solution, certify, checked
from fmopt.planning.optimise.solvers import ClarabelSolver
from fmopt.spatial.values import Array, Value

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


@dataclass(frozen=True, eq=False)
class Room(Value, lower=(6,), upper=(6,)):
    """Bounds (6,) of the local coordinates of a pose, m and rad, and the metric that weighs rotations."""

    metric: Metric = field(kw_only=True)
    lower: Array = field(kw_only=True)
    upper: Array = field(kw_only=True)

    @property
    def cap(self) -> float:
        """The diameter of the bounds, m: no clearance counts for more."""
        return float(np.linalg.norm(self.metric.sigma * (self.upper - self.lower)))


@dataclass(frozen=True, eq=False)
class Placement(Room, N=(None, 6), D=("N",)):
    """Where to put the goal pose X of a segment: maximise t over

        N_j·X − D_j ≥ t,   X in `goal`,   lower ≤ X ≤ upper,   t ≤ cap.

    Raises:
        ValueError: shapes do not fit.
    """

    N: Array  # gradient rows (k, 6) of the obstacles; divided by |N*|, as D, they make t a distance in the metric
    D: Array  # offsets (k,), in m times that length; allowances such as √(NᵀQN) are added by the caller
    goal: Flat

    def program(self) -> ConeProgram:
        """The cone program over (X, t)."""
        return ConeProgram(
            np.append(np.zeros(6), 1.0),
            A=np.column_stack([self.goal.E, np.zeros(len(self.goal.e))]),
            b=self.goal.e,
            G=np.column_stack([self.N, -np.ones(len(self.D))]),
            h=-self.D,
            lower=np.append(self.lower, -np.inf),
            upper=np.append(self.upper, self.cap),
            units=np.append(self.metric.units, self.metric.clearance),
        )

    def clearances(self, X: Array) -> Array:
        """Clearance (k,) of every row at X (6,), m."""
        return self.N @ X - self.D

    def at(self, X: Array) -> Solution:
        """The certified (not optimal) solution at X (6,), with t as large as the rows allow.

        Raises:
            SolverError: the pose leaves its affine space or the bounds.
        """
        return certify(self.program(), np.append(X, min(self.cap, float(self.clearances(X).min(initial=np.inf)))))


def lexicographic(problem: Placement) -> Solution:
    """The poses of largest least clearance t, m, of which the second-least is largest too, and so on.

    The value t is negative where obstacles must overlap. Each answer of the solver is checked again.

    Rows with positive multipliers are tight at every optimum: they are held where they are, and the rest
    is maximised again, until no row is left.

    Raises:
        InfeasibleError: the affine space and the bounds contradict each other.
        SolverError: no certified optimum.
    """
    solver = ClarabelSolver()
    original = problem.program()
    first = checked(original, solver)
    program, latest = original, first
    for _ in range(len(original.h)):  # each round holds at least one row more
        held = _held(program, latest)
        if held is None:
            break
        program = held
        latest = checked(program, solver)
    X = latest.x[:-1]
    x = np.append(X, min(first.value, float(problem.clearances(X).min(initial=np.inf))))
    return certify(original, x, first.duals)  # later multipliers are of other programs


def _held(program: ConeProgram, solution: Solution) -> ConeProgram | None:
    """The program with its binding rows held at their level and the others still to be raised; None at the end."""
    counted = program.G[:, -1] < 0.0  # rows that are held have no part in t any more
    duals = np.zeros(len(program.h)) if solution.duals is None else solution.duals.rows
    binding = counted & (-program.G[:, -1] * duals > _BINDING)
    if not binding.any() or (counted == binding).all() or solution.value >= program.upper[-1]:
        return None
    level = program.h[binding] + program.G[binding, -1] * solution.value
    held = program.G[binding].copy()
    held[:, -1] = 0.0
    A, b = np.vstack([program.A, held]), np.concatenate([program.b, -level])
    return replace(program, A=A, b=b, G=program.G[~binding], h=program.h[~binding], W=program.W[~binding])
