"""The largest least clearance by sequential quadratic programs in a trust region, each solved by daqp.

    maximise t   s.t.   g_i(x) = 0,   g_j(x) ≥ w_j t,   lower ≤ (x, t) ≤ upper

A step is taken when the merit falls, −t + μ (what rows are short of), with t the best that the rows allow at x. Curved
equalities are followed by solving once more with what the rows came to at the end of the step.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fmopt.placement.formation import Derivatives
from fmopt.values import Array

_EQUALITY = 5
_NONE = 1e30
_ROUNDS = 60
_RADIUS = 2.0  # scaled units of the first step, at most
_LEAST = 1e-9
_FLAT = 1e-5  # least curvature that a quadratic program gets
_SETTLED = 1e-10  # of the merit, scaled units
_EXACT = 1e-10  # of equalities
_GAIN = 1e-4
_SETTINGS = {"primal_tol": 1e-11, "dual_tol": 1e-11, "iter_limit": 300}


@dataclass(frozen=True, eq=False)
class _Program:
    """The program in numbers: its functions, equalities first, how many of them, weights (k,) and bounds (7,)."""

    functions: Derivatives
    equalities: int
    weights: Array
    parameters: Array
    lower: Array
    upper: Array

    def best(self, g: Array) -> float:
        """The largest t that rows with values g (k,) allow."""
        counted = self.weights > 0.0
        return min(float(self.upper[6]), float((g[counted] / self.weights[counted]).min(initial=np.inf)))

    def short(self, g: Array) -> float:
        """What equalities are off, and rows without weight short of, in all."""
        p = self.equalities
        hard = g[p:][self.weights[p:] == 0.0]
        return float(np.abs(g[:p]).sum() - np.minimum(hard, 0.0).sum())


@dataclass(frozen=True, eq=False)
class _Point:
    """A pose x (6,) with the rows' values (k,), gradients (k, 6), and the Hessian (6, 6) of their weighted sum."""

    x: Array
    g: Array
    J: Array
    H: Array


def largest(
    functions: Derivatives,
    equalities: int,
    weights: Array,
    begin: Array,
    parameters: Array,
    bounds: tuple[Array, Array],
) -> Array | None:
    """A local optimum (x, t) (7,) from a start (7,); None where the steps do not come to an end.

    Args:
        functions: values and derivatives of the rows.
        equalities: how many of the rows, the first ones, are to be zero.
        weights: w (k,), zero for equalities and for rows that only have to hold.
        begin: where to start (7,).
        parameters: of the functions.
        bounds: lower and upper (7,).
    """
    program = _Program(functions, equalities, weights, parameters, *bounds)
    at = _Point(begin[:6], *functions(begin[:6], parameters, np.zeros(len(weights))))
    radius, price = _RADIUS, 1.0
    for _ in range(_ROUNDS):
        step = _step(program, at, at.g, radius)
        if step is None:
            radius *= 0.1
            if radius < _LEAST:
                return None
            continue
        d, multipliers = step
        price = max(price, 2.0 * float(np.abs(multipliers).max(initial=0.0)))
        now = price * program.short(at.g) - program.best(at.g)
        ahead = at.g + at.J @ d
        gain = now - price * program.short(ahead) + program.best(ahead)
        if gain <= _SETTLED * (1.0 + abs(now)) and program.short(at.g) <= _EXACT:
            return np.append(at.x, program.best(at.g))
        there = _there(program, at.x + d, multipliers)
        rise = now - price * program.short(there.g) + program.best(there.g)
        if rise < _GAIN * gain:
            there, rise = _corrected(program, at, there, d, radius, multipliers, (now, price, rise))
        if rise >= _GAIN * gain:
            farther = rise >= 0.75 * gain and float(np.abs(d).max()) >= 0.9 * radius
            at, radius = there, 2.0 * radius if farther else radius
        else:
            at = replace(at, H=program.functions(at.x, parameters, multipliers)[2])
            radius = 0.25 * min(radius, float(np.abs(d).max()))
        if radius < _LEAST:
            return None
    return None


def _there(program: _Program, x: Array, multipliers: Array) -> _Point:
    return _Point(x, *program.functions(x, program.parameters, multipliers))


def _corrected(
    program: _Program,
    at: _Point,
    there: _Point,
    d: Array,
    radius: float,
    multipliers: Array,
    merit: tuple[float, float, float],
) -> tuple[_Point, float]:
    """The end of a step that takes into account how rows bend along the first one, where that is better."""
    now, price, rise = merit
    again = _step(program, at, there.g - at.J @ d, radius)
    if again is None:
        return there, rise
    other = _there(program, at.x + again[0], multipliers)
    more = now - price * program.short(other.g) + program.best(other.g)
    return (other, more) if more > rise else (there, rise)


def _step(program: _Program, at: _Point, g: Array, radius: float) -> tuple[Array, Array] | None:
    """The step (6,) of the quadratic program of rows g + J d, and its multipliers (k,); None where daqp finds none.

    With u = t at the end of the step: −u + ½ dᵀB d, B the Hessian of the Lagrangian with flat and falling directions
    bent up, so that the program is convex.
    """
    import daqp

    p, k = program.equalities, len(g)
    w, V = np.linalg.eigh(-0.5 * (at.H + at.H.T))
    quadratic = np.zeros((7, 7))
    quadratic[6, 6] = 1e-7
    rows = np.empty((k, 7))
    rows[:, :6], rows[:, 6] = at.J, -program.weights
    lower, upper = np.empty(7 + k), np.full(7 + k, _NONE)
    lower[:6], upper[:6] = np.maximum(program.lower[:6] - at.x, -radius), np.minimum(program.upper[:6] - at.x, radius)
    lower[6], upper[6] = -_NONE, min(float(program.upper[6]), _NONE)
    lower[7:] = -g
    upper[7 : 7 + p] = -g[:p]
    sense = np.zeros(7 + k, dtype=np.int32)
    sense[7 : 7 + p] = _EQUALITY
    quadratic[:6, :6] = (V * np.maximum(w, _FLAT)) @ V.T
    # Where many rows meet in one point, as in symmetric placements, daqp cycles unless it goes there in short steps.
    for settings in (_SETTINGS, {**_SETTINGS, "eps_prox": 1e-3}, {**_SETTINGS, "eps_prox": 1e-1}):
        z, _, flag, info = daqp.solve(quadratic, np.append(np.zeros(6), -1.0), rows, upper, lower, sense, **settings)
        if flag == 1:
            return np.asarray(z[:6]), -np.asarray(info["lam"])[7:]
    return None
