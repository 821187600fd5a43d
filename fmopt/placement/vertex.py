"""Linear programs of some twenty variables, in plain numbers: daqp, and HiGHS where it proves no optimum."""

from __future__ import annotations

from typing import Any

import numpy as np

from fmopt.errors import SolverError
from fmopt.values import Array

_EQUALITY = 5
_NONE = 1e30
_OPTIMAL = 1
_CHECK = 1e-7  # by which a solver's answer may break rows, or miss the bound that its multipliers prove
_ROUNDING = 1e-15  # of numbers of order 1
_SETTINGS = {"primal_tol": 1e-11, "dual_tol": 1e-12, "eps_prox": -1.0, "iter_limit": 1000}


def least_vertex(
    cost: Array, rows: tuple[Array, Array], equations: tuple[Array, Array], limits: tuple[Array, Array]
) -> Array | None:
    """The x (n,) with the least cost·x over A x ≤ b, C x = d, lower ≤ x ≤ upper, re-checked; None where no x is.

    Args:
        cost: c (n,), of order 1 as the rows are.
        rows: A (k, n) and b (k,).
        equations: C (p, n) and d (p,).
        limits: lower and upper (n,), which may be infinite.

    Raises:
        SolverError: no solver settles it, or the answer breaks its rows.
    """
    x = _daqp(cost, rows, equations, limits)
    if x is None and not _contradict(rows, equations, limits):
        return _highs(cost, rows, equations, limits)
    return x


def _contradict(rows: tuple[Array, Array], equations: tuple[Array, Array], limits: tuple[Array, Array]) -> bool:
    """Whether it is proved that every x breaks a row: the least s by which one does all but them is not small."""
    (A, b), (C, d) = rows, equations
    relaxed = np.vstack([A, C, -C])
    lifted = np.hstack([relaxed, -np.ones((len(relaxed), 1))]), np.concatenate([b, d, -d])
    cost = np.append(np.zeros(A.shape[1]), 1.0)
    s = _daqp(
        cost, lifted, (np.zeros((0, len(cost))), np.zeros(0)), (np.append(limits[0], 0.0), np.append(limits[1], np.inf))
    )
    return s is not None and bool(s[-1] > _CHECK)


def _daqp(
    cost: Array, rows: tuple[Array, Array], equations: tuple[Array, Array], limits: tuple[Array, Array]
) -> Array | None:
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
    at = np.where(lam > 0.0, upper, np.where(lam < 0.0, lower, 0.0))
    apart = max(np.abs(cost + lam[:n] + lam[n:] @ M).max(), abs(cost @ x + lam @ at))
    short = max((reached - upper).max(), (lower - reached).max())
    return np.where(np.abs(x) < _ROUNDING, 0.0, x) if max(apart, short) <= _CHECK else None


def _highs(
    cost: Array, rows: tuple[Array, Array], equations: tuple[Array, Array], limits: tuple[Array, Array]
) -> Array | None:
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
