"""Cone programs by compiled interior points, and by Clarabel where those come to no certified optimum.

Equalities, and variables whose bounds are equal, are solved for as many variables first; the rest is a program over
the others, whose interior points start where those are zero.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fmopt.errors import SolverError
from fmopt.placement.equalities import eliminated
from fmopt.placement.interior import optimum
from fmopt.placement.program import FEASIBLE, ConeProgram, Solution, certify
from fmopt.placement.socp import ClarabelSolver, duals, standard_form
from fmopt.values import Array

_NONE = np.zeros(0, dtype=np.intp)
_PIVOT = 1e-10  # least coefficient by which an equality is solved for a variable, scaled
_STEPS = 50


@dataclass(frozen=True)
class ConeSolver:
    """Interior points of programs with some hundred variables; `tolerance` is relative, in scaled units."""

    tolerance: float = 1e-9

    def solve(self, program: ConeProgram) -> Solution:
        """A certified optimum; see `Solver.solve`.

        Raises:
            InfeasibleError: there is no feasible point.
            SolverError: neither method came to an optimum.
        """
        try:
            return self.by_interior_points(program)
        except SolverError:
            return ClarabelSolver(self.tolerance).solve(program)

    def by_interior_points(self, program: ConeProgram) -> Solution:
        """A certified optimum, without Clarabel.

        Raises:
            SolverError: the interior points came to none, as they do where no point is feasible.
        """
        scaled = program.scaled()
        n, p = len(scaled.c), len(scaled.b)
        M, h, (_, flat, *widths) = standard_form(scaled, _NONE)
        q = np.append(-scaled.c, np.zeros(len(widths)))
        fixed = np.flatnonzero(scaled.lower == scaled.upper)
        if p or len(fixed):
            A, b = np.vstack([scaled.A, np.eye(n)[fixed]]), np.append(scaled.b, scaled.lower[fixed])
            x, y, z = self._on_equalities(A, b, M, h, q, flat, widths)
        else:
            (x, z), y = self._optimum(M, h, q, flat, widths), np.zeros(0)
        return certify(program, x[:n] * program.units, duals(program, np.arange(p), np.append(y[:p], z)))

    def _on_equalities(
        self, A: Array, b: Array, M: Array, h: Array, q: Array, flat: int, widths: list[int]
    ) -> tuple[Array, Array, Array]:
        """Optimum of min q·v, M v + s = h on A x = b, x the first of v, with the multipliers of A x = b and of s."""
        n = A.shape[1]
        table, rows, held, left = eliminated(A, b, _PIVOT)
        free = np.delete(np.arange(len(q)), held)
        B = np.zeros((len(held), len(free)))
        B[:, : n - len(held)] = table[:, free[: n - len(held)]]
        inside, room = M[:, free] - M[:, held] @ B, h - M[:, held] @ table[:, n]
        open_ = np.asarray(inside.any(axis=1))
        open_[flat:] = True
        if max(left, -room[~open_].min(initial=0.0)) > FEASIBLE:
            raise SolverError("the equalities contradict each other, or the rows")
        v, z = np.empty(len(q)), np.zeros(len(h))
        cost = q[free] - q[held] @ B
        v[free], z[open_] = self._optimum(inside[open_], room[open_], cost, int(open_[:flat].sum()), widths)
        v[held] = table[:, n] - B @ v[free]
        y = np.zeros(len(b))
        y[rows] = np.linalg.solve(A[np.ix_(rows, held)].T, -(q + z @ M)[held])
        return v, y, z

    def _optimum(self, M: Array, h: Array, q: Array, flat: int, widths: list[int]) -> tuple[Array, Array]:
        v, z, done = optimum(M, h, q, flat, np.array(widths, dtype=np.intp), self.tolerance, _STEPS)
        if not done:
            raise SolverError("the interior points came to no optimum")
        return v, z
