"""Linear equations, solved for as many of their unknowns as there are independent ones, as a compiled kernel."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fmopt.compiled import compiled
from fmopt.values import Array

Indices = NDArray[np.intp]

_ROUNDED = 1e-14  # coefficients below this are what rounding left


@compiled
def eliminated(A: Array, b: Array, least: float) -> tuple[Array, Indices, Indices, float]:
    """Solves A x = b for as many unknowns as it has independent rows, by Gauss and Jordan with full pivoting.

    Args:
        A: coefficients (p, n).
        b: right-hand sides (p,).
        least: coefficients up to this are no pivots.

    Returns:
        A table (r, n + 1), whose row i says x[columns[i]] + table[i, :n]·x = table[i, n]; the rows (r,) of A that are
        independent, and those columns (r,); and the largest right-hand side of an equation that has nothing left.
    """
    p, n = A.shape
    table = np.empty((p, n + 1))
    table[:, :n], table[:, n] = A, b
    rows, columns = np.arange(p), np.empty(min(p, n), dtype=np.intp)
    r = 0
    while r < min(p, n):
        most, i, j = least, -1, -1
        for row in range(r, p):
            for column in range(n):
                if abs(table[row, column]) > most:
                    most, i, j = abs(table[row, column]), row, column
        if i < 0:
            break
        for column in range(n + 1):
            table[r, column], table[i, column] = table[i, column], table[r, column]
        rows[r], rows[i], columns[r] = rows[i], rows[r], j
        table[r] /= table[r, j]
        for row in range(p):
            factor = table[row, j]
            if row != r and factor != 0.0:
                for column in range(n + 1):
                    table[row, column] -= factor * table[r, column]
                table[row, j] = 0.0
        r += 1
    left = 0.0
    for row in range(r, p):
        left = max(left, abs(table[row, n]))
    for i in range(r):
        table[i, columns[i]] = 0.0
        for column in range(n):
            if abs(table[i, column]) < _ROUNDED:
                table[i, column] = 0.0
    return table[:r], rows[:r], columns[:r], left
