"""The papers' placement, for comparison: reciprocal cost and steepest descent on the goal state's affine space.

    cost = Σ 1/(dist_j − C),  C < 0                                      [DakinPopplestone1993] eq. 2, section 3

with dist_j the clearance of obstacle j in the scaled metric and C the overlap at which the cost becomes infinite.
(The paper prints C − dist.) Rows that must hold and bounds enter with C = 0 and a small factor.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from fmopt.errors import InfeasibleError, SolverError
from fmopt.placement.clearance import Placement
from fmopt.placement.program import ConeProgram, Solution
from fmopt.values import Array

_WALL = 1e-3
_INTERIOR = 1e-6


@dataclass(frozen=True)
class Descent:
    """Settings: overlap C in clearances (negative), largest number of steps, and the step that ends it."""

    asymptote: float = -0.1
    max_steps: int = 2000
    smallest_step: float = 1e-9


def descend(problem: Placement, guess: ArrayLike | None = None, settings: Descent | None = None) -> Solution:
    """Perturbs the poses along the state's surface until the reciprocal cost has a minimum; proves no optimum.

    Args:
        problem: as for `max_min_clearance`.
        guess: start of the descent, poses (ends, 6), else the least-squares point of the affine spaces.
        settings: asymptote and step limits.

    Raises:
        InfeasibleError: the affine spaces contradict each other.
        SolverError: the first pose oversteps a bound or a row of weight 0.
    """
    settings = Descent() if settings is None else settings
    scaled, n = problem.program().scaled(), len(problem.program().c) - 1
    y = np.zeros(n) if guess is None else np.ravel(guess) / problem.program().units[:n]
    y, Z = _state(scaled, y, problem.metric.clearance)
    cost = _Cost.of(scaled, y, settings.asymptote)
    if not np.isfinite(cost(y)):
        raise SolverError("the descent starts outside its bounds", "start from a pose strictly inside them")
    step = 1.0
    for _ in range(settings.max_steps):
        downhill = -Z @ (Z.T @ cost.gradient(y))
        length = float(np.linalg.norm(downhill))
        if length == 0.0:
            break
        step, y = _line_search(cost, y, downhill / length, 2.0 * step, length)
        if step < settings.smallest_step:
            break
    return problem.at(np.reshape(y * problem.program().units[:n], (-1, 6)))


def _state(scaled: ConeProgram, y: Array, unit: float) -> tuple[Array, Array]:
    """The point of the affine spaces nearest to y, and an orthonormal basis (n, r) of their directions."""
    n = len(y)
    if not len(scaled.b):
        return y, np.eye(n)
    A = scaled.A[:, :n]
    U, s, Vt = np.linalg.svd(A)
    rank = int((s > 1e-10 * s[0]).sum())
    y = y + Vt[:rank].T @ ((U[:, :rank].T @ (scaled.b - A @ y)) / s[:rank])
    short = float(np.abs(A @ y - scaled.b).max())
    if short > 1e-9:
        raise InfeasibleError(f"the contacts of the state contradict by {short:.3g} clearances", short * unit)
    return y, Vt[rank:].T


def _line_search(cost: _Cost, y: Array, direction: Array, step: float, slope: float) -> tuple[float, Array]:
    """Backtracking to Armijo's rule; returns the step taken and the point."""
    here = cost(y)
    while step > 1e-14:
        there = y + step * direction
        if cost(there) <= here - 1e-4 * step * slope:
            return step, there
        step *= 0.5
    return 0.0, y


@dataclass(frozen=True, eq=False)
class _Cost:
    """Σ 1/(dist − C) over the rows of a scaled program in (y, t), walls and bounds with C = 0."""

    program: ConeProgram
    weights: Array
    factors: Array
    asymptotes: Array

    @staticmethod
    def of(program: ConeProgram, y: Array, asymptote: float) -> _Cost:
        weights = -program.G[:, -1]
        counted = weights > 0.0
        weights = np.where(counted, weights, 1.0)
        distances = program.slacks(np.append(y, 0.0)) / weights
        # A pose deeper in the overlap than C moves the asymptote below itself.
        C = min(asymptote, 1.5 * float(distances[counted].min(initial=0.0)))
        return _Cost(program, weights, np.where(counted, 1.0, _WALL), np.where(counted, C, -_INTERIOR))

    def __call__(self, y: Array) -> float:
        rows, low, high = self._room(y)
        room = np.concatenate([rows, low, high])
        if not (room > 0.0).all():
            return float("inf")
        return float(np.sum(self.factors / rows) + _WALL * (np.sum(1.0 / low) + np.sum(1.0 / high)))

    def gradient(self, y: Array) -> Array:
        rows, low, high = self._room(y)
        slopes = self.program.G[:, :-1].copy()
        for k, norm in enumerate(self.program.norms):
            v = norm.F[:, :-1] @ y + norm.g
            length = float(np.linalg.norm(v))
            if length > 0.0:
                slopes -= np.outer(self.program.W[:, k], norm.F[:, :-1].T @ v / length)
        inner = -(self.factors / rows**2 / self.weights) @ slopes
        return np.asarray(inner - _WALL / low**2 + _WALL / high**2)

    def _room(self, y: Array) -> tuple[Array, Array, Array]:
        rows = self.program.slacks(np.append(y, 0.0)) / self.weights - self.asymptotes
        return rows, y - self.program.lower[:-1] + _INTERIOR, self.program.upper[:-1] - y + _INTERIOR
