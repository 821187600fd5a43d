"""Kernels of ellipsoids in twists: how far one reaches, what a map makes of it, and one around a sum of two.

An ellipsoid {F u: |u| ≤ 1} is held as its root F (6, k), m and rad; with generators (k, 6) it is a set of errors.
"""

import math

import numpy as np

from fmopt.runtime.compiled import part
from fmopt.spatial.values import Array


@part
def extent(N: Array, generators: Array, slide: Array, swing: Array) -> float:
    """How far generators (k, 6) and ellipsoids with roots (6, …), added up, reach along a row (6,)."""
    total = 0.0
    for k in range(len(generators)):
        along = 0.0
        for i in range(6):
            along += generators[k, i] * N[i]
        total += abs(along)
    return total + radius(N, slide) + radius(N, swing)


@part
def radius(N: Array, F: Array) -> float:
    """How far an ellipsoid with a root (6, g) reaches along a row (6,)."""
    square = 0.0
    for k in range(F.shape[1]):
        along = 0.0
        for i in range(6):
            along += F[i, k] * N[i]
        square += along * along
    return math.sqrt(square)


@part
def spread(slide: Array, swing: Array, projector: Array, rho: float) -> Array:
    """Diagonals (6,) and, last, traces, (2, 2, 7): in translation and in angle of the carried drift and of a unit's."""
    found = np.zeros((2, 2, 7))
    for i in range(6):
        for k in range(slide.shape[1]):
            found[0, 0, i] += slide[i, k] * slide[i, k]
        for k in range(swing.shape[1]):
            found[1, 0, i] += swing[i, k] * swing[i, k]
        for n in range(2):
            for k in range(3):
                found[n, 1, i] += projector[i, 3 * n + k] * projector[i, 3 * n + k]
            for m in range(2):
                found[n, m, 6] += (1.0 if i < 3 else rho * rho) * found[n, m, i]
    return found


@part
def ball(projector: Array, first: int, radius: float) -> Array:
    """A root (6, 3) of what a projector makes of a ball in the three coordinates from `first` on."""
    found = np.empty((6, 3))
    for i in range(6):
        for k in range(3):
            found[i, k] = radius * projector[i, first + k]
    return found


@part
def mapped(P: Array, F: Array) -> Array:
    """P F (6, k)."""
    found = np.zeros((6, F.shape[1]))
    for i in range(6):
        for j in range(6):
            for k in range(F.shape[1]):
                found[i, k] += P[i, j] * F[j, k]
    return found


@part
def trace(F: Array, rho: float) -> float:
    """The trace of the shape matrix of a root (6, k) in the metric of ρ."""
    found = 0.0
    for i in range(6):
        weight = 1.0 if i < 3 else rho * rho
        for k in range(F.shape[1]):
            found += weight * F[i, k] * F[i, k]
    return found


@part
def outer_sum(F1: Array, F2: Array, rho: float) -> Array:
    """Root of the ellipsoid of least trace around the sum of two; see `ellipsoid.outer_sum`."""
    s1, s2 = math.sqrt(trace(F1, rho)), math.sqrt(trace(F2, rho))
    if s1 == 0.0:
        return F2
    if s2 == 0.0:
        return F1
    k, one, two = F1.shape[1], math.sqrt(1.0 + s2 / s1), math.sqrt(1.0 + s1 / s2)
    found = np.empty((6, k + F2.shape[1]))
    for i in range(6):
        for j in range(k):
            found[i, j] = one * F1[i, j]
        for j in range(F2.shape[1]):
            found[i, k + j] = two * F2[i, j]
    return found


@part
def narrow(F: Array) -> Array:
    """A root (6, k) of the same ellipsoid as F (6, m) with k ≤ 6, by Householder reflections of Fᵀ."""
    m = F.shape[1]
    if m <= 6:
        return F
    M = np.empty((m, 6))
    for i in range(6):
        for k in range(m):
            M[k, i] = F[i, k]
    for j in range(6):
        below = 0.0
        for k in range(j + 1, m):
            below += M[k, j] * M[k, j]
        if below == 0.0:
            continue
        head = M[j, j]
        size = math.sqrt(head * head + below)
        end = -size if head >= 0.0 else size
        M[j, j] = head - end
        for i in range(j + 1, 6):
            along = 0.0
            for k in range(j, m):
                along += M[k, j] * M[k, i]
            along /= size * (size + abs(head))
            for k in range(j, m):
                M[k, i] -= along * M[k, j]
        M[j, j] = end
    found = np.empty((6, 6))
    for i in range(6):
        for j in range(6):
            found[i, j] = M[j, i] if j <= i else 0.0
    return found
