"""Second-order cone programs as values, the contract with every solver, and the check of every answer.

    maximise    c·x
    subject to  A x = b,   G x + h ≥ W (|F₁x + g₁|, …, |F_K x + g_K|),   lower ≤ x ≤ upper,   W ≥ 0

A solver proposes a point and multipliers; `certify` recomputes both sides in NumPy on the original
data: residuals of the point, and the bound of weak duality from the multipliers. Tolerances count in
the program's own `units`, after each row is scaled to unit length.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from fmopt.errors import SolverError
from fmopt.spatial.values import Array, Indices, Value, frozen

if TYPE_CHECKING:
    import cvxpy

T = TypeVar("T")

FEASIBLE = 2e-9  # scaled units by which a point may break rows: twice what Clarabel is asked for
OPTIMAL = 1e-7  # by which bound and value may be apart, of the size of the objective


def left_out() -> Array:
    """What stands in a value for an array that is left out: an empty one."""
    return np.zeros(0)


def stated(value: Value, **defaults: Array) -> None:
    """Puts defaults where a value that is being made has arrays left out."""
    for name, default in defaults.items():
        if np.size(getattr(value, name)) == 0:
            object.__setattr__(value, name, default)


@dataclass(frozen=True, eq=False)
class Norm(Value, F=(None, None), g=("F",)):
    """The convex term |F x + g|, F (q, n), g (q,)."""

    F: Array
    g: Array

    def __call__(self, x: Array) -> float:
        """The value at x (n,)."""
        return float(np.linalg.norm(self.F @ x + self.g))


@dataclass(frozen=True, eq=False)
class Sizes(Value):
    """What scaling divides by: lengths in scaled variables of equalities (p,), rows (m,), norms (K,), objective."""

    equalities: Array
    rows: Array
    norms: Array
    objective: float

    def __post_init__(self) -> None:
        for name in ("equalities", "rows", "norms"):
            getattr(self, name).setflags(write=False)


@dataclass(frozen=True, eq=False)
class NormStack:
    """Norms one below the other: F (Σq, n) and g (Σq,), where each begins (K,), and how many rows it has (K,)."""

    F: Array
    g: Array
    begins: Indices
    widths: Indices

    def at(self, x: Array) -> Array:
        """The values (K,) at x (n,)."""
        y = self.F @ x + self.g
        return np.asarray(np.sqrt(np.add.reduceat(y * y, self.begins)))


@dataclass(frozen=True, eq=False)
class ConeProgram(Value, c=("c",), A=("b", "c"), b=("b",), G=("h", "c"), h=("h",), W=("h", "norms"), units=("c",)):
    """Maximise c·x over A x = b, G x + h ≥ W (norms), lower ≤ x ≤ upper.

    Shapes: c (n,), A (p, n), b (p,), G (m, n), h (m,), W (m, K) not negative, K norms, lower and
    upper (n,) with ±inf for "none", units (n,) positive: the natural size of each variable, else one. All but c may be
    left out. `size` is derived.

    Raises:
        ValueError: shapes do not fit, or a number is not finite where it must be.
    """

    c: Array
    A: Array = field(default_factory=left_out, kw_only=True)
    b: Array = field(default_factory=left_out, kw_only=True)
    G: Array = field(default_factory=left_out, kw_only=True)
    h: Array = field(default_factory=left_out, kw_only=True)
    W: Array = field(default_factory=left_out, kw_only=True)
    norms: tuple[Norm, ...] = field(default=(), kw_only=True)
    lower: Array = field(default_factory=left_out, kw_only=True)
    upper: Array = field(default_factory=left_out, kw_only=True)
    units: Array = field(default_factory=left_out, kw_only=True)

    def __post_init__(self) -> None:
        n, p, m, K = len(self.c), len(self.b), len(self.h), len(self.norms)
        stated(self, A=np.zeros((p, n)), G=np.zeros((m, n)), W=np.zeros((m, K)), units=np.ones(n))
        stated(self, lower=np.full(n, -np.inf), upper=np.full(n, np.inf))
        super().__post_init__()
        for name in ("lower", "upper"):
            bound = np.array(getattr(self, name), dtype=np.float64)
            if bound.shape != (n,) or np.isnan(bound).any():
                raise ValueError(f"a bound has shape {bound.shape} or holds nan, expected ({n},)")
            bound.setflags(write=False)
            object.__setattr__(self, name, bound)
        if any(norm.F.shape[1] != n for norm in self.norms):
            raise ValueError(f"every norm needs {n} columns")
        if (self.W < 0.0).any() or (self.units <= 0.0).any():
            raise ValueError("W must not be negative, and units must be positive")

    @cached_property
    def size(self) -> Sizes:
        """What scaling divides by."""
        units, stack = self.units, self.stacked
        norms = np.maximum.reduceat(_lengths(stack.F * units), stack.begins) if self.norms else np.zeros(0)
        norms[norms == 0.0] = 1.0
        rows = np.maximum(_lengths(self.G * units), (self.W * norms).max(axis=1, initial=0.0))
        rows[rows == 0.0] = 1.0
        equalities = _lengths(self.A * units)
        equalities[equalities == 0.0] = 1.0
        return Sizes(equalities, rows, norms, float(np.abs(self.c * units).max()) or 1.0)

    @cached_property
    def stacked(self) -> NormStack:
        """All norms one below the other."""
        widths = np.array([len(norm.g) for norm in self.norms], dtype=np.intp)
        F = np.concatenate([np.zeros((0, len(self.c))), *(norm.F for norm in self.norms)])
        g = np.concatenate([np.zeros(0), *(norm.g for norm in self.norms)])
        return NormStack(F, g, widths.cumsum() - widths, widths)

    def slacks(self, x: Array) -> Array:
        """G x + h − W (norms), shape (m,)."""
        found = self.G @ x + self.h
        return np.asarray(found - self.W @ self.stacked.at(x) if self.norms else found)

    def scaled(self) -> ConeProgram:
        """The same program in x′ = x / units, with each row and the objective divided by its size."""
        size, units, stack = self.size, self.units, self.stacked
        by = np.repeat(size.norms, stack.widths)
        F, g = stack.F * units / by[:, None], stack.g / by
        spans = zip(stack.begins.tolist(), (stack.begins + stack.widths).tolist(), strict=True)
        scaled = _unchecked(
            ConeProgram,
            c=self.c * units / size.objective,
            A=self.A * units / size.equalities[:, None],
            b=self.b / size.equalities,
            G=self.G * units / size.rows[:, None],
            h=self.h / size.rows,
            W=self.W * size.norms / size.rows[:, None],
            norms=tuple(_unchecked(Norm, F=F[i:j], g=g[i:j]) for i, j in spans),
            lower=self.lower / units,
            upper=self.upper / units,
            units=np.ones_like(units),
        )
        scaled.__dict__["stacked"] = NormStack(
            F, g, stack.begins, stack.widths
        )  # of which its norms are slices already
        return scaled

    def relaxed(self) -> ConeProgram:
        """The scaled program with every row and equality let out by a common s ≥ 0, and −s maximised."""
        scaled = self.scaled()
        n, p, m = len(self.c), len(self.b), len(self.h)
        one = np.ones((2 * p + m, 1))
        return ConeProgram(
            np.append(np.zeros(n), -1.0),
            G=np.hstack([np.vstack([scaled.A, -scaled.A, scaled.G]), one]),
            h=np.concatenate([-scaled.b, scaled.b, scaled.h]),
            W=np.vstack([np.zeros((2 * p, len(self.norms))), scaled.W]),
            norms=tuple(Norm(np.hstack([v.F, np.zeros((len(v.g), 1))]), v.g) for v in scaled.norms),
            lower=np.append(scaled.lower, 0.0),
            upper=np.append(scaled.upper, np.inf),
        )


def _unchecked(kind: type[T], **fields: Any) -> T:
    """A value whose arrays are known to be new and to fit, since they are multiples of another one's."""
    made = object.__new__(kind)
    for array in fields.values():
        if isinstance(array, np.ndarray):
            array.setflags(write=False)
    made.__dict__.update(fields)
    return made


def _lengths(M: Array) -> Array:
    return np.asarray(np.sqrt(np.einsum("ij,ij->i", M, M)))


@dataclass(frozen=True, eq=False)
class Duals(Value, equalities=(None,), rows=(None,), norms=(None,)):
    """Multipliers in original units: equalities (p,), rows (m,), and one vector per norm (together (Σq,))."""

    equalities: Array
    rows: Array
    norms: Array


@dataclass(frozen=True, eq=False)
class Solution(Value):
    """A point x (n,), original units, that passed `certify`; `value` is c·x.

    `duals` prove that no feasible point exceeds `bound`, inf without them; `gap` is bound − value.
    """

    x: Array
    value: float
    bound: float
    gap: float
    duals: Duals | None


class Solver(Protocol):
    """Anything that maximises a cone program."""

    def solve(self, program: ConeProgram) -> Solution:
        """A certified optimum.

        Raises:
            InfeasibleError: the program has no feasible point.
            SolverError: the solver stopped without a point and a bound that pass `certify`.
        """
        ...


def certify(program: ConeProgram, x: ArrayLike, duals: Duals | None = None, tol: float = FEASIBLE) -> Solution:
    """Checks a point (n,), and its optimality if multipliers are given, on the original data, to `tol` in scaled units.

    Raises:
        SolverError: an equality, row or bound is violated, or the multipliers do not close the gap.
    """
    x, size = np.asarray(x, dtype=np.float64), program.size
    if x.shape != program.c.shape or not np.isfinite(x).all():
        raise SolverError(f"the solver returned no finite point of {len(program.c)} numbers")
    equality = np.abs(program.A @ x - program.b) / size.equalities
    slacks = program.slacks(x) / size.rows
    box = np.minimum(x - program.lower, program.upper - x) / program.units
    for what, worst in (("equality", -equality), ("row", slacks), ("bound", box)):
        if worst.min(initial=np.inf) < -tol:
            i = int(worst.argmin())
            raise SolverError(f"the proposed point violates {what} {i} by {-worst[i]:.3g} scaled units")
    value, bound = float(program.c @ x), float("inf")
    if duals is not None:
        bound, residual = dual_bound(program, duals, x)
        gap, tolerance = (bound - value) / size.objective, OPTIMAL * (1.0 + abs(value) / size.objective)
        if not (residual <= tolerance and abs(gap) <= tolerance):  # so that nan does not pass
            raise SolverError(
                f"the proposed multipliers leave a gap of {gap:.3g} and a dual residual of {residual:.3g} (scaled)"
            )
    return Solution(frozen(x), value, bound, bound - value, duals)


def dual_bound(program: ConeProgram, duals: Duals, x: Array) -> tuple[float, float]:
    """Upper bound on c·x by weak duality, and the scaled residual on variables without the bound it would need.

    With y free, λ ≥ 0 and |u_k| ≤ Σ_j λ_j W_jk every feasible x has
    c·x ≤ y·b + λ·h − Σ u_k·g_k + r·x,  r = c − Aᵀy + Gᵀλ − Σ F_kᵀu_k;
    r·x is at most its maximum over the box, or at x (n,) for variables that lack the bound they would need. Multipliers
    outside their cones are pulled in first.

    Raises:
        SolverError: the multipliers are not as many as the rows.
    """
    y, lam = duals.equalities, np.maximum(duals.rows, 0.0)
    widths = [len(norm.g) for norm in program.norms]
    if (len(y), len(lam), len(duals.norms)) != (len(program.b), len(program.h), sum(widths)):
        raise SolverError("the solver's multipliers do not fit the program")
    r = program.c - program.A.T @ y + program.G.T @ lam
    bound = float(y @ program.b + lam @ program.h)
    if program.norms:
        stack = program.stacked
        length, limit = np.sqrt(np.add.reduceat(duals.norms**2, stack.begins)), lam @ program.W
        share = np.where(length > limit, limit / np.where(length > 0.0, length, 1.0), 1.0)
        inside = duals.norms * np.repeat(share, stack.widths)
        r -= stack.F.T @ inside
        bound -= float(inside @ stack.g)
    side = np.where(r > 0.0, program.upper, program.lower)
    held = np.isfinite(side)
    bound += float(r @ np.where(held, side, x))
    residual = np.abs(np.where(held, 0.0, r * program.units)) / program.size.objective
    return bound, float(residual.max(initial=0.0))


def checked(program: ConeProgram, solver: Solver) -> Solution:
    """The solver's solution, certified again here, so that a solver that lies is caught.

    Raises:
        SolverError: the solution fails `certify`, proves no optimum, or states another value than c·x.
    """
    claimed = solver.solve(program)
    if claimed.duals is None:
        raise SolverError("the solver returned no multipliers, so its optimum is not proven")
    solution = certify(program, claimed.x, claimed.duals)
    if abs(claimed.value - solution.value) > OPTIMAL * (program.size.objective + abs(solution.value)):
        raise SolverError(f"the solver stated the value {claimed.value:.9g}, its point has {solution.value:.9g}")
    return solution


def as_cvxpy(program: ConeProgram) -> tuple[cvxpy.Problem, cvxpy.Variable]:
    """The same program as a CVXPY problem over x, to inspect or extend; needs the extra `cvxpy`."""
    import cvxpy as cp

    x = cp.Variable(len(program.c), name="x")
    rows = program.G @ x + program.h
    for k, norm in enumerate(program.norms):
        rows = rows - program.W[:, k] * cp.norm(norm.F @ x + norm.g, 2)
    low, high = np.isfinite(program.lower), np.isfinite(program.upper)
    constraints: list[Any] = []
    if len(program.b):
        constraints.append(program.A @ x == program.b)
    if len(program.h):
        constraints.append(rows >= 0)
    if low.any():
        constraints.append(x[low] >= program.lower[low])
    if high.any():
        constraints.append(x[high] <= program.upper[high])
    return cp.Problem(cp.Maximize(program.c @ x), constraints), x
