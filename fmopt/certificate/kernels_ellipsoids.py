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
    for generator in generators:
        total += abs((generator * N).sum())
    return total + radius(N, slide) + radius(N, swing)


@part
def radius(N: Array, F: Array) -> float:
    """How far an ellipsoid with a root (6, g) reaches along a row (6,)."""
    square = 0.0
    for column in F.T:
        along = (column * N).sum()
        square += along * along
    return math.sqrt(square)


@part
def spread(slide: Array, swing: Array, projector: Array, rho: float) -> Array:
    """Diagonals (6,) and, last, traces, (2, 2, 7): in translation and in angle of the carried drift and of a unit's."""
    found = np.zeros((2, 2, 7))
    for i in range(6):
        found[0, 0, i], found[1, 0, i] = (slide[i] * slide[i]).sum(), (swing[i] * swing[i]).sum()
        for n in range(2):
            across = projector[i, 3 * n : 3 * n + 3]
            found[n, 1, i] = (across * across).sum()
            found[n, :, 6] += (1.0 if i < 3 else rho * rho) * found[n, :, i]
    return found


@part
def mapped(P: Array, F: Array) -> Array:
    """P F (6, k)."""
    found = np.empty((6, F.shape[1]))
    for i in range(6):
        for k in range(F.shape[1]):
            found[i, k] = (P[i] * F[:, k]).sum()
    return found


@part
def trace(F: Array, rho: float) -> float:
    """The trace of the shape matrix of a root (6, k) in the metric of ρ."""
    found = 0.0
    for i in range(6):
        for entry in F[i]:
            found += (1.0 if i < 3 else rho * rho) * entry * entry
    return found


@part
def outer_sum(F1: Array, F2: Array, rho: float) -> Array:
    """Root of the ellipsoid of least trace around the sum of two; see `ellipsoid.outer_sum`."""
    s1, s2 = math.sqrt(trace(F1, rho)), math.sqrt(trace(F2, rho))
    if s1 == 0.0:
        return F2
    if s2 == 0.0:
        return F1
    return np.concatenate((math.sqrt(1.0 + s2 / s1) * F1, math.sqrt(1.0 + s1 / s2) * F2), axis=1)


@part
def narrow(F: Array) -> Array:
    """A root (6, k) of the same ellipsoid as F (6, m) with k ≤ 6, by Householder reflections of Fᵀ."""
    m = F.shape[1]
    if m <= 6:
        return F
    M = F.T.copy()
    for j in range(6):
        below = (M[j + 1 :, j] * M[j + 1 :, j]).sum()
        if below == 0.0:
            continue
        head = M[j, j]
        size = math.sqrt(head * head + below)
        end = -size if head >= 0.0 else size
        M[j, j] = head - end
        for i in range(j + 1, 6):
            along = (M[j:, j] * M[j:, i]).sum() / (size * (size + abs(head)))
            M[j:, i] -= along * M[j:, j]
        M[j, j] = end
    return np.triu(M[:6]).T.copy()
