"""Half-spaces {q: rows·q ≥ levels}, compiled: their corners, which of them are equal, and what their normals span."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fmopt.runtime.compiled import compiled, part
from fmopt.spatial.values import Array

INCIDENCE = 1e-8  # scaled units; a point this close to a unit half-space's plane lies on it


@compiled
def corners_of(equations: Array, rows: Array, levels: Array) -> tuple[Array, NDArray[np.bool_], bool]:
    """Vertices and rays of {q: rows·q ≥ levels} from the facets of its dual, and what lies on which plane.

    With s ≥ 0 homogenising, the polyhedron is the cone {(q, s): rows·q − levels s ≥ 0}; a facet n·u + b ≤ 0 of the
    dual is its ray (q, s) = (−n, −b), cut where s = 1 or at infinity.

    Args:
        equations: facets (n, b) of the dual (m, r + 1).
        rows: unit normals (k, r).
        levels: (k,).

    Returns:
        vertices and rays (m, r), and which planes hold each (m, k + 1), the last that at infinity; whether just r
        do.
    """
    m, (k, r) = len(equations), rows.shape
    corners, incidence = np.empty((m, r)), np.empty((m, k + 1), np.bool_)
    across, residual, simple = np.empty((r, k)), np.empty(k), True
    for i in range(r):
        for row in range(k):
            across[i, row] = rows[row, i]
    for corner in range(m):
        s = -equations[corner, r]
        finite = s > 1e-9
        square = 0.0
        for row in range(k):
            residual[row] = -levels[row] if finite else 0.0
        for i in range(r):
            x = -equations[corner, i] / s if finite else -equations[corner, i]
            corners[corner, i] = x
            square += x * x
            for row in range(k):
                residual[row] += x * across[i, row]
        tolerance = INCIDENCE * max(1.0, np.sqrt(square))
        held = 0 if finite else 1
        for row in range(k):
            on = residual[row] <= tolerance
            incidence[corner, row] = on
            held += on
        incidence[corner, k] = not finite
        simple &= held == r
    return corners, incidence, simple


@compiled
def first_equal(rows: Array) -> NDArray[np.intp]:
    """For each row (n, k) the index (n,) of the first row equal to it within the incidence tolerance."""
    n, k = rows.shape
    first, tolerance = np.empty(n, np.intp), np.zeros(n)
    for row in range(n):
        for i in range(k):
            tolerance[row] = max(tolerance[row], INCIDENCE * abs(rows[row, i]))
        first[row] = row
        for other in range(row):
            i = 0
            while i < k and abs(rows[row, i] - rows[other, i]) <= tolerance[other]:
                i += 1
            if i == k:
                first[row] = other
                break
    return first


@part
def row_space(rows: Array) -> Array:
    """Orthonormal columns (n, r) spanning the rows (k, n), the axes where these span everything.

    By the longest remainder of a row each time, down to 1e-7.
    """
    k, n = rows.shape
    left, basis = rows.copy(), np.empty((n, n))
    for r in range(n):
        longest, square = -1, 1e-14
        for row in range(k):
            own = 0.0
            for i in range(n):
                own += left[row, i] * left[row, i]
            if own > square:
                longest, square = row, own
        if longest < 0:
            return basis[:, :r].copy()
        # Taken off once more: what is left of a row that is nearly spanned is not quite orthogonal.
        for done in range(r):
            along = 0.0
            for i in range(n):
                along += left[longest, i] * basis[i, done]
            for i in range(n):
                left[longest, i] -= along * basis[i, done]
        square = 0.0
        for i in range(n):
            square += left[longest, i] * left[longest, i]
        for i in range(n):
            basis[i, r] = left[longest, i] / np.sqrt(square)
        for row in range(k):
            along = 0.0
            for i in range(n):
                along += left[row, i] * basis[i, r]
            for i in range(n):
                left[row, i] -= along * basis[i, r]
    return np.eye(n)


@compiled
def pointed(
    rows: Array, levels: Array, equal: NDArray[np.bool_], interior: Array, flat: Array
) -> tuple[Array, Array, NDArray[np.intp], NDArray[np.bool_], Array]:
    """A polyhedron {x: rows·x ≥ levels} around a point within it, flat and without its lines.

    Args:
        rows: unit normals (k, n).
        levels: (k,).
        equal: which rows hold with equality everywhere (k,).
        interior: the point (n,).
        flat: orthonormal columns (n, f) normal to those rows.

    Returns:
        unit normals (q, r) of those of the other rows that count, each of another plane, and their levels (q,); which
        of these each row is equal to (k,), −1 where none; which rows hold everywhere (k,); orthonormal axes (n, r).
    """
    k, (n, f) = len(rows), flat.shape
    within, slack, count = np.empty((k, f)), np.empty(k), 0
    everywhere, which = equal.copy(), np.empty(k, np.intp)
    for row in range(k):
        slack[count], square = levels[row], 0.0
        for i in range(n):
            slack[count] -= rows[row, i] * interior[i]
        for j in range(f):
            within[count, j] = 0.0
            for i in range(n):
                within[count, j] += rows[row, i] * flat[i, j]
            square += within[count, j] * within[count, j]
        if equal[row] or square <= 1e-14:
            everywhere[row] |= abs(slack[count]) <= INCIDENCE
        else:
            which[count] = row
            count += 1
    basis = row_space(within[:count])
    r = basis.shape[1]
    inner, dual = np.zeros((count, r)), np.zeros((count, r))
    for row in range(count):
        length = 0.0
        for j in range(f):
            length += within[row, j] * within[row, j]
        length = np.sqrt(length)
        slack[row] /= length
        for i in range(r):
            for j in range(f):
                inner[row, i] += within[row, j] * basis[j, i] / length
            dual[row, i] = inner[row, i] / -slack[row]
    first, q = first_equal(dual), 0
    kinds = np.full(k, -1)
    for row in range(count):
        kinds[which[row]] = q if first[row] == row else kinds[which[first[row]]]
        if first[row] == row:
            for i in range(r):
                inner[q, i] = inner[row, i]
            slack[q] = slack[row]
            q += 1
    axes = np.zeros((n, r))
    for i in range(n):
        for j in range(r):
            for m in range(f):
                axes[i, j] += flat[i, m] * basis[m, j]
    return inner[:q], slack[:q], kinds, everywhere, axes
