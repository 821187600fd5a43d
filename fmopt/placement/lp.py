"""Placement programs without norms as linear programs: daqp, and HiGHS without presolve where daqp gives up."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from fmopt.errors import InfeasibleError, SolverError
from fmopt.placement.program import ConeProgram, Duals, Solution, certify
from fmopt.values import Array

_EQUALITY = 5
_NONE = 1e30


@dataclass(frozen=True)
class LinearSolver:
    """An active-set solver for programs whose W is zero; exact vertices, a tenth of the time of a cone solver."""

    max_iterations: int = 1000

    def solve(self, program: ConeProgram) -> Solution:
        """A certified optimum; see `Solver.solve`.

        Raises:
            ValueError: the program has norms.
        """
        if program.W.any():
            raise ValueError("a program with norms is no linear program")
        try:
            return certify(program, *_original(program, *self._daqp(program.scaled())))
        except SolverError:
            return self._highs(program)

    def _daqp(self, scaled: ConeProgram) -> tuple[Array, Array, Array]:
        """Point, equality and row multipliers."""
        import daqp

        n, p, m = len(scaled.c), len(scaled.b), len(scaled.h)
        rows = np.ascontiguousarray(np.vstack([scaled.A, scaled.G]))
        upper = np.concatenate([np.minimum(scaled.upper, _NONE), scaled.b, np.full(m, _NONE)])
        lower = np.concatenate([np.maximum(scaled.lower, -_NONE), scaled.b, -scaled.h])
        sense = np.concatenate([np.zeros(n), np.full(p, _EQUALITY), np.zeros(m)]).astype(np.int32)
        # Without a Hessian daqp needs its automatic proximal term: with any fixed small one, three in four fail.
        settings = {"iter_limit": self.max_iterations, "primal_tol": 1e-10, "dual_tol": 1e-12, "eps_prox": -1.0}
        x, _, flag, info = daqp.solve(np.zeros((n, n)), -scaled.c, rows, upper, lower, sense, **settings)
        if flag != 1:
            raise SolverError(f"daqp stopped with flag {flag}")
        lam = np.asarray(info["lam"])
        return np.asarray(x), lam[n : n + p], -lam[n + p :]

    def _highs(self, program: ConeProgram) -> Solution:
        answer = _linprog(program.scaled())
        if answer.status == 2:
            relaxed = program.relaxed()
            shortfall = -_read(relaxed, _linprog(relaxed.scaled())).bound * program.size.objective
            raise InfeasibleError(f"no feasible point: the rows contradict by {shortfall:.6g}", shortfall)
        if answer.status != 0:
            raise SolverError(f"HiGHS stopped: {answer.message}")
        return _read(program, answer)


def _read(program: ConeProgram, answer: Any) -> Solution:
    return certify(program, *_original(program, answer.x, -answer.eqlin.marginals, -answer.ineqlin.marginals))


def _linprog(scaled: ConeProgram) -> Any:
    from scipy.optimize import linprog

    return linprog(
        -scaled.c,
        A_ub=-scaled.G,
        b_ub=scaled.h,
        A_eq=scaled.A,
        b_eq=scaled.b,
        bounds=[(low, high) for low, high in zip(scaled.lower, scaled.upper, strict=True)],
        method="highs",
        options={"presolve": False},
    )


def _original(program: ConeProgram, x: Array, equalities: Array, rows: Array) -> tuple[Array, Duals]:
    size = program.size
    y, lam = equalities / size.equalities * size.objective, np.maximum(rows, 0.0) / size.rows * size.objective
    return x * program.units, Duals(y, lam, np.zeros(sum(len(norm.g) for norm in program.norms)))
