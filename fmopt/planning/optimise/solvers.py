"""Clarabel behind the `Solver` protocol: one persistent solver per sparsity pattern.

Clarabel's own equilibration is off, since it depends on the first data a solver saw: with the scaling of
`ConeProgram` alone, an updated solver returns the bits of a fresh one, whatever it solved before.

Linear programs of some twenty variables, in plain numbers: daqp, and HiGHS where it proves no optimum.
"""

import threading
from collections import OrderedDict
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fmopt.errors import InfeasibleError, SolverError
from fmopt.planning.optimise.cone_program import FEASIBLE, ConeProgram, Duals, Solution, certify
from fmopt.spatial.values import Array, Indices

_REMEMBERED = 64  # patterns of which a thread keeps the solver
_LOOSER = 100.0  # times the tolerance
_local = threading.local()  # solvers hold the numbers of one program: threads must not share them

Pair = tuple[Array, Array]  # a matrix and the other side of its rows, or lower and upper limits

_ALMOST = ("AlmostSolved", "AlmostPrimalInfeasible", "AlmostDualInfeasible", "NumericalError", "InsufficientProgress")
_ADVICE = dict.fromkeys(_ALMOST, "check the units of the program") | {
    "DualInfeasible": "the objective is unbounded: add bounds",
    "MaxIterations": "raise max_iterations, or check the units of the program",
    "MaxTime": "no time limit was set",
    "CallbackTerminated": "no callback was set",
    "Unsolved": "the solver did not run",
}

_OPTIMAL = 1
_CHECK = 1e-7  # by which a solver's answer may break rows, or miss the bound that its multipliers prove
_ROUNDING = 1e-15  # of numbers of order 1
_SETTINGS = {"primal_tol": 1e-11, "dual_tol": 1e-12, "eps_prox": -1.0, "iter_limit": 1000}

_EQUALITY = 5  # how daqp marks equalities
_NONE = 1e30  # daqp's infinity


@dataclass(frozen=True)
class ClarabelSolver:
    """Clarabel, interior point; `tolerance` is relative, in scaled units."""

    tolerance: float = 1e-9
    max_iterations: int = 100

    def solve(self, program: ConeProgram) -> Solution:
        """A certified optimum; see `Solver.solve`.

        Raises:
            InfeasibleError: there is no feasible point.
            SolverError: Clarabel stopped elsewhere than at an optimum.
        """
        scaled = program.scaled()
        kept = _independent(program, scaled)
        failure: InfeasibleError | SolverError | None = None
        # Where the last digits are not to be had, Clarabel may take a program for infeasible that is none.
        for settings in (self, replace(self, tolerance=_LOOSER * self.tolerance)):
            x, z, status = settings._run(scaled, kept)
            if len(scaled.b):  # the nearest point on the equalities
                x = x - np.linalg.lstsq(scaled.A, scaled.A @ x - scaled.b, rcond=1e-10)[0]
            try:
                return certify(program, x * program.units, duals(program, kept, z))
            except SolverError as error:
                stopped = SolverError(f"Clarabel stopped with {status}", _ADVICE.get(status, ""))
                failure = failure or (error if status == "Solved" else stopped)
            # Rows that contradict each other by little are solved, as it seems, by a point that breaks them.
            if status == "PrimalInfeasible" or (
                status == "Solved"
                and any((s < -FEASIBLE).any() for s in (scaled.slacks(x), x - scaled.lower, scaled.upper - x))
            ):
                failure = self._infeasible(program)
                if isinstance(failure, InfeasibleError):
                    break
        assert failure is not None
        raise failure

    def proposed(self, program: ConeProgram) -> Array:
        """Where Clarabel stops (n,), for callers that check by themselves that the point does."""
        scaled = program.scaled()
        return np.asarray(self._run(scaled, _independent(program, scaled))[0] * program.units)

    def _run(self, scaled: ConeProgram, kept: Indices) -> tuple[Array, Array, str]:
        M, rhs, cones = standard_form(scaled, kept)
        answer = _solver(self, M, cones, rhs, np.append(-scaled.c, np.zeros(len(scaled.norms)))).solve()
        return np.array(answer.x)[: len(scaled.c)], np.array(answer.z), str(answer.status)

    def _infeasible(self, program: ConeProgram) -> InfeasibleError | SolverError:
        relaxed = program.relaxed()
        none = np.zeros(0, dtype=np.intp)
        x, z, status = self._run(relaxed.scaled(), none)
        if status != "Solved":
            return SolverError(f"infeasible as it seems, but the shortfall is unknown: Clarabel stopped with {status}")
        proven = -certify(relaxed, x, duals(relaxed, none, z)).bound  # by weak duality no point is short by less
        if proven <= FEASIBLE:
            return SolverError(f"infeasible as it seems, but only a shortfall of {proven:.3g} scaled units is proven")
        shortfall = proven * program.size.objective
        return InfeasibleError(f"no feasible point: the rows contradict by {shortfall:.6g}", shortfall)


def _independent(program: ConeProgram, scaled: ConeProgram) -> Indices:
    """Indices of equalities that span them all; the others must follow from these.

    Raises:
        InfeasibleError: the equalities contradict each other.
    """
    from scipy.linalg import qr

    if not len(scaled.b):
        return np.zeros(0, dtype=np.intp)
    x = np.linalg.lstsq(scaled.A, scaled.b, rcond=1e-10)[0]
    residual = float(np.abs(scaled.A @ x - scaled.b).max())
    if residual > FEASIBLE * (1.0 + float(np.abs(scaled.b).max())):
        shortfall = residual * program.size.objective
        raise InfeasibleError(f"no feasible point: the equalities contradict by {shortfall:.6g}", shortfall)
    R, pivots = qr(scaled.A.T, mode="r", pivoting=True)
    diagonal = np.abs(np.diag(R))
    return np.sort(pivots[: int((diagonal > 1e-10 * diagonal[0]).sum())])


def standard_form(scaled: ConeProgram, kept: Indices) -> tuple[Array, Array, tuple[int, ...]]:
    """Clarabel's M v + s = rhs over v = (x, r), r_k ≥ |F_k x + g_k|: zero cone, non-negative cone, one cone a norm."""
    n, K, p, m = len(scaled.c), len(scaled.norms), len(kept), len(scaled.h)
    low, high = np.flatnonzero(np.isfinite(scaled.lower)), np.flatnonzero(np.isfinite(scaled.upper))
    stack = scaled.stacked
    flat = p + m + len(low) + len(high)
    tips = flat + stack.begins + np.arange(K)
    rest = flat + np.arange(len(stack.g)) + np.repeat(np.arange(1, K + 1), stack.widths)
    M = np.zeros((flat + K + len(stack.g), n + K))
    rhs = np.zeros(len(M))
    M[:p, :n], M[p : p + m, :n], M[p : p + m, n:] = scaled.A[kept], -scaled.G, scaled.W
    rhs[:p], rhs[p : p + m] = scaled.b[kept], scaled.h
    at = p + m + np.arange(len(low) + len(high))
    M[at, np.append(low, high)] = np.repeat([-1.0, 1.0], [len(low), len(high)])
    rhs[at] = np.append(-scaled.lower[low], scaled.upper[high])
    M[tips, n + np.arange(K)], M[rest, :n], rhs[rest] = -1.0, -stack.F, stack.g
    return M, rhs, (p, flat - p, *(1 + stack.widths).tolist())


def duals(program: ConeProgram, kept: Indices, z: Array) -> Duals:
    """Clarabel's multipliers, in the order of `standard_form`, of the scaled program, in the program's own units."""
    size = program.size
    p, m, width = len(kept), len(program.h), len(program.norms) + len(program.stacked.g)
    y = np.zeros(len(program.b))
    y[kept] = z[:p]
    norms = np.zeros(0)
    if program.norms:
        stack = program.stacked
        inside = np.arange(len(stack.g)) + np.repeat(np.arange(1, len(program.norms) + 1), stack.widths)
        norms = -z[len(z) - width + inside] / np.repeat(size.norms, stack.widths)
    rows = z[p : p + m] / size.rows
    return Duals(y / size.equalities * size.objective, rows * size.objective, norms * size.objective)


def _solver(settings: ClarabelSolver, M: Array, widths: tuple[int, ...], rhs: Array, q: Array) -> Any:
    """This thread's solver for the pattern of M, with the new numbers in it."""
    kept: OrderedDict[Any, Any] = _local.__dict__.setdefault("solvers", OrderedDict())
    # Transposed, since Clarabel has its numbers column by column.
    mask = np.ascontiguousarray((M != 0.0).T)
    key = (settings, M.shape, widths, mask.tobytes())
    if key in kept:
        kept.move_to_end(key)
        kept[key].update(A=np.ascontiguousarray(M.T[mask]), b=rhs, q=q)
    else:
        kept[key] = _build(settings, M, widths, rhs, q)
        if len(kept) > _REMEMBERED:
            kept.popitem(last=False)
    return kept[key]


def _build(settings: ClarabelSolver, M: Array, widths: tuple[int, ...], rhs: Array, q: Array) -> Any:
    import clarabel
    from scipy.sparse import csc_matrix

    options = clarabel.DefaultSettings()
    options.verbose = False
    options.presolve_enable = False  # what presolve reduced takes no new numbers
    options.equilibrate_enable = False
    options.max_threads = 1
    options.direct_solve_method = "qdldl"
    options.max_iter = settings.max_iterations
    options.tol_feas = options.tol_gap_abs = options.tol_gap_rel = settings.tolerance
    zero, positive, *second = widths
    cones = [clarabel.ZeroConeT(zero), clarabel.NonnegativeConeT(positive)]
    cones += [clarabel.SecondOrderConeT(width) for width in second]
    return clarabel.DefaultSolver(csc_matrix((len(q), len(q))), q, csc_matrix(M), rhs, cones, options)


def least_vertex(cost: Array, rows: Pair, equations: Pair, limits: Pair) -> Array | None:
    """The x (n,) with the least cost·x over A x ≤ b, C x = d, lower ≤ x ≤ upper, re-checked; None where no x is.

    The cost (n,) is of order 1 as rows A (k, n), b (k,) and equations C (p, n), d (p,) are; limits may be infinite.

    Raises:
        SolverError: no solver settles it, or the answer breaks its rows.
    """
    x = _daqp(cost, rows, equations, limits)
    if x is None and not _contradict(rows, equations, limits):
        return _highs(cost, rows, equations, limits)
    return x


def nearest_point(point: Array, rows: Array, least: float | Array) -> Array | None:
    """The point (n,) nearest to one, with rows·x ≥ least; None where there is none, or daqp does not find it."""
    import daqp

    none, kinds = np.full(len(rows), _NONE), np.zeros(len(rows), dtype=np.int32)
    found, _, flag, _ = daqp.solve(
        np.eye(len(point)), -point, rows, none, np.full(len(rows), least), kinds, primal_tol=_SETTINGS["primal_tol"]
    )
    return np.asarray(found) if flag == _OPTIMAL else None


def _contradict(rows: Pair, equations: Pair, limits: Pair) -> bool:
    """Whether it is proved that every x breaks a row: the least s by which one does all but them is not small."""
    (A, b), (C, d) = rows, equations
    relaxed = np.vstack([A, C, -C])
    lifted = np.hstack([relaxed, -np.ones((len(relaxed), 1))]), np.concatenate([b, d, -d])
    cost = np.append(np.zeros(A.shape[1]), 1.0)
    none, lifted_limits = np.zeros((0, len(cost))), (np.append(limits[0], 0.0), np.append(limits[1], np.inf))
    s = _daqp(cost, lifted, (none, np.zeros(0)), lifted_limits)
    return s is not None and bool(s[-1] > _CHECK)


def _daqp(cost: Array, rows: Pair, equations: Pair, limits: Pair) -> Array | None:
    """The optimum that daqp finds; None where its multipliers do not prove it, and where it finds none."""
    import daqp

    n, p = len(cost), len(equations[1])
    M = np.concatenate([equations[0], rows[0]])
    lower, upper, sense = np.full(n + len(M), -_NONE), np.full(n + len(M), _NONE), np.zeros(n + len(M), dtype=np.int32)
    lower[:n], upper[:n] = np.maximum(limits[0], -_NONE), np.minimum(limits[1], _NONE)
    lower[n : n + p] = upper[n : n + p] = equations[1]
    upper[n + p :] = rows[1]
    sense[n : n + p] = _EQUALITY
    x, _, flag, info = daqp.solve(np.zeros((n, n)), cost, M, upper, lower, sense, **_SETTINGS)
    if flag != _OPTIMAL:
        return None
    lam = np.asarray(info["lam"])
    if not np.isfinite(x).all() or not np.isfinite(lam).all():
        return None
    reached = np.concatenate([x, M @ x])
    # daqp's multipliers are positive at upper limits, negative at lower ones: the gap of weak duality is theirs, too.
    at = np.where(lam > 0.0, upper, np.where(lam < 0.0, lower, 0.0))
    apart = max(np.abs(cost + lam[:n] + lam[n:] @ M).max(), abs(cost @ x + lam @ at))
    short = max((reached - upper).max(), (lower - reached).max())
    return np.where(np.abs(x) < _ROUNDING, 0.0, x) if max(apart, short) <= _CHECK else None


def _highs(cost: Array, rows: Pair, equations: Pair, limits: Pair) -> Array | None:
    from scipy.optimize import linprog

    (A, b), (C, d) = rows, equations
    bounds: Any = np.column_stack(limits)
    answer: Any = linprog(cost, A_ub=A, b_ub=b, A_eq=C, b_eq=d, bounds=bounds)
    if answer.status == 2:
        return None
    if answer.status != 0:
        raise SolverError(
            f"a linear program stopped: {answer.message}", "check the specification's forces and the errors"
        )
    x = np.asarray(answer.x, dtype=np.float64)
    short = max((A @ x - b).max(initial=0.0), np.abs(C @ x - d).max(initial=0.0))
    if not short <= _CHECK:
        raise SolverError(f"the answer of a linear program breaks its rows by {short:.3g}", "report this problem")
    return x
