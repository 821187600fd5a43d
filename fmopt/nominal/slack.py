"""Whether contact is possible within the box of pose errors: small linear programs, by the simplex method.

Contact is possible when a candidate's bounds can hold with f ≤ 0 and also with f ≥ 0, that is, when

    φ = min over both signs of  max_e min(∓N·e ∓ f₀ + ρ, cₖ + Bₖ·e + ρ)

over |eᵢ| ≤ aᵢ is not negative.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from fmopt.compiled import compiled, part
from fmopt.errors import SolverError
from fmopt.nominal.touch import Linear
from fmopt.values import Array

Indices = NDArray[np.intp]

_SMALL = 1e-13  # a rate below which a variable is not worth moving, or does not move another
_GREEDY = 40  # steps along the steepest variable; from then on the first that gains, which cannot go round in circles
_MOST = 400  # steps


def slack(made: Linear, half_widths: Array, remainder: float, unit: float) -> Array:
    """φ (n,) of linearised candidates with `remainder` (m) for the ρ of f, divided by `unit` (m).

    Where that is negative, its bound min_k (c_k + |B_k|₁), with u = e / a, may stand for it.

    Raises:
        SolverError: a program did not end.
    """
    n, k = made.heights.shape
    c, B = np.empty((2, n, k + 1)), np.empty((2, n, k + 1, 6))
    for sign, values, rows in zip((-1.0, 1.0), c, B, strict=True):
        values[:, 0], values[:, 1:] = sign * made.distance, made.heights
        rows[:, 0], rows[:, 1:] = sign * made.gradient, made.rows
    c[:, :, 0] += remainder
    c[:, :, 1:] += made.remainder[:, 1:]
    value = maximin((c / unit).reshape(2 * n, k + 1), (B * half_widths / unit).reshape(2 * n, k + 1, 6))
    if np.any(np.isnan(value)):
        raise SolverError("the touch programs did not end", "check the half-widths of the pose error")
    return np.asarray(value.reshape(2, n).min(axis=0))


@compiled
def maximin(c: Array, B: Array) -> Array:
    """max over |u| ≤ 1 of min_k (c_k + B_k·u), (n,), for c (n, k) and B (n, k, 6); its bound where that is negative.

    Rows that no other can fall below, or that repeat the one before, are left out. nan where the method did not end.
    """
    count, rows = c.shape
    found, reach = np.empty(count), np.empty(rows)
    some, those = np.empty(rows), np.empty((rows, 6))
    for i in range(count):
        most = math.inf
        for k in range(rows):
            reach[k] = 0.0
            for j in range(6):
                reach[k] += abs(B[i, k, j])
            most = min(most, c[i, k] + reach[k])
        kept = 0
        for k in range(rows):
            if c[i, k] - reach[k] < most and not (k > 0 and _same(c[i], B[i], k)):
                some[kept] = c[i, k]
                for j in range(6):
                    those[kept, j] = B[i, k, j]
                kept += 1
        found[i] = most
        if most >= 0.0 and kept > 1:
            value = _highest(some, those, kept)
            found[i] = value if math.isnan(value) else min(most, value)
    return found


@part
def _same(c: Array, B: Array, k: int) -> bool:
    """Whether a row repeats the one before."""
    apart = abs(c[k] - c[k - 1])
    for j in range(6):
        apart += abs(B[k, j] - B[k - 1, j])
    return bool(apart == 0.0)


@part
def _highest(c: Array, B: Array, rows: int) -> float:
    """max over |u| ≤ 1 of t = min_k (c_k + B_k·u) over the first rows, by the simplex method for bounded variables.

    Variables lie between 0 and a limit: 0 to 5 are the ways of the u from where the bound of one row is reached, with
    limit 2, the others the slacks s_k = c_k + B_k·u − t. Columns of T are the variables that are 0, and what is then
    left; its rows are the others, in which t stands for the slack of the row that is lowest at first.
    """
    T, limit = np.empty((rows, 8)), np.full(6 + rows, np.inf)
    free, kept = np.arange(7), np.arange(6, 6 + rows)
    limit[:6] = 2.0
    goal = _begun(c, B, rows, T)
    free[6] = 6 + goal
    for step in range(_MOST):
        column = _entering(T, goal, free, step < _GREEDY)
        if column < 0:
            return float(T[goal, 7])
        _moved(T, goal, column, free, kept, limit)
    return math.nan


@part
def _begun(c: Array, B: Array, rows: int, T: Array) -> int:
    """Fills T for the corner of |u| ≤ 1 where the lowest of all bounds is reached; returns the lowest row there."""
    first, least = 0, math.inf
    for k in range(rows):
        most = c[k]
        for j in range(6):
            most += abs(B[k, j])
        if most < least:
            first, least = k, most
    lowest = 0
    for k in range(rows):
        T[k, 6], T[k, 7] = 1.0, c[k]
        for j in range(6):
            T[k, j] = B[k, j] if B[first, j] < 0.0 else -B[k, j]
            T[k, 7] -= T[k, j]
        if T[k, 7] < T[lowest, 7]:
            lowest = k
    T[lowest, 6] = -1.0
    for k in range(rows):
        if k != lowest:
            T[k, 7] -= T[lowest, 7]
            for j in range(6):
                T[k, j] -= T[lowest, j]
    return lowest


@part
def _entering(T: Array, goal: int, free: Indices, greedy: bool) -> int:
    """The column along which t grows most, or the first variable along which it does; −1 when there is none."""
    best = -1
    for j in range(7):
        if T[goal, j] <= _SMALL:
            continue
        if best < 0 or (T[goal, j] > T[goal, best] if greedy else free[j] < free[best]):
            best = j
    return best


@part
def _moved(T: Array, goal: int, column: int, free: Indices, kept: Indices, limit: Array) -> None:
    """Moves the variable of a column until it, or one that moves with it, is 0 or at its limit; these change places."""
    step, row = limit[free[column]], -1
    for i in range(len(T)):
        if i == goal or abs(T[i, column]) <= _SMALL:
            continue
        room = T[i, 7] if T[i, column] < 0.0 else limit[kept[i]] - T[i, 7]
        room = max(room, 0.0) / abs(T[i, column])
        if room < step or (room == step and row >= 0 and kept[i] < kept[row]):
            step, row = room, i
    if row < 0:  # it is at its limit: what is left of that takes its place
        for i in range(len(T)):
            T[i, 7] += step * T[i, column]
            T[i, column] = -T[i, column]
        return
    if T[row, column] > 0.0:  # likewise for the other
        for j in range(8):
            T[row, j] = -T[row, j]
        T[row, 7] += limit[kept[row]]
    rate = -T[row, column]
    T[row, column] = -1.0
    for j in range(8):
        T[row, j] /= rate
    for i in range(len(T)):
        if i != row:
            rate = T[i, column]
            T[i, column] = 0.0
            for j in range(8):
                T[i, j] += rate * T[row, j]
    free[column], kept[row] = kept[row], free[column]
