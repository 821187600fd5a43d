"""Ellipsoids by a root F (n, a) of their shape matrix Q = F Fᵀ (n, n): {c + F u, |u| ≤ 1}.

Q may be singular, which makes the ellipsoid flat: after a contact it usually is. From a shape matrix in floating point
the reach √(NᵀQN) along a flat direction comes out as 1e-12 m of noise; from a root, |FᵀN|, as 1e-19 m. The centre is
kept by the caller.
"""

import math

import numpy as np
from numpy.typing import ArrayLike

from fmopt.errors import InfeasibleError
from fmopt.runtime.compiled import compiled
from fmopt.spatial.values import Array, fixed

_SINGULAR = 1e-12
_FARTHEST = 0.99 * 2.0**16  # m or rad per m, what the independent check allows of that, but for rounding
_LARGE = 1e11  # inverses no larger than this are of matrices that are not singular
_WIDTH = 18  # columns that a root may have while sums are taken


def root(Q: Array) -> Array:
    """A root F (n, a) of a shape matrix Q (n, n); eigenvalues within rounding of zero count as zero."""
    diagonal = np.diag(Q)
    if np.array_equal(Q, np.diag(diagonal)):
        # Diagonal matrices are exact: their roots keep the zeros that eigenvalues would blur.
        return np.asarray(np.diag(np.sqrt(diagonal))[:, diagonal > 0.0])
    w, B = np.linalg.eigh(Q)
    # Below n ε λ_max an eigenvalue is rounding, and its root would be 1e-8 of the largest, far from nothing.
    noise = len(Q) * float(np.finfo(np.float64).eps) * max(w[-1], 0.0)
    return np.asarray((B * np.sqrt(np.where(w > noise, w, 0.0))) @ B.T)


def narrow(F: Array, most: int) -> Array:
    """A root (n, k) of the same ellipsoid as F (n, m), k at most n where F has more than `most` columns."""
    # F = (Q R)ᵀ with orthonormal Q: F Fᵀ = Rᵀ R, and R has no more rows than F.
    return F if F.shape[1] <= most else np.asarray(np.linalg.qr(F.T).R.T)


def image(Q: Array, A: Array) -> Array:
    """Shape matrix A Q Aᵀ (m, m) of the image of Q (n, n) under the linear map A (m, n), exact."""
    shape = A @ Q @ A.T
    # Symmetric again: products in either order differ by rounding.
    return np.asarray(0.5 * (shape + shape.T))


def coupling_inverse(N: ArrayLike, C: ArrayLike) -> Array:
    """(N C)⁻¹ (r, r): how far to go along columns of C (n, r) so that N x, rows N (r, n), changes as wanted.

    Raises:
        InfeasibleError: moving along C cannot set N x, because N C is singular, or can so only by going too far.
    """
    rows, columns = np.asarray(N, dtype=np.float64), np.asarray(C, dtype=np.float64)
    if rows.shape != columns.T.shape:
        raise ValueError(f"rows have shape {rows.shape}, directions {columns.shape}; expected (r, n) and (n, r)")
    inverse, size = _inverse(fixed(np.ascontiguousarray(rows)), fixed(np.ascontiguousarray(columns.T)))
    if math.isnan(size):
        raise ValueError("a contact row or a direction is zero")
    if size > _LARGE:
        # Only where the inverse is large: a singular value costs more than the inverse itself.
        lengths, widths = np.sqrt(np.vecdot(rows, rows)), np.sqrt(np.vecdot(columns.T, columns.T))
        smallest = float(np.linalg.svd((rows / lengths[:, None]) @ (columns / widths), compute_uv=False)[-1])
        if smallest < _SINGULAR:
            raise InfeasibleError(
                f"the directions do not reach all contact rows (smallest singular value {smallest:.1e})",
                advice="pass independent contact rows, and one direction for each that is not tangent to it",
            )
    if max(inverse.max(initial=0.0), -inverse.min(initial=0.0)) > _FARTHEST:
        raise InfeasibleError("the directions hardly reach all contact rows", advice="hold contacts farther apart")
    return inverse


@compiled
def _inverse(rows: Array, directions: Array) -> tuple[Array, float]:
    """(N C)⁻¹ (r, r) of rows N and Cᵀ (r, n) by Gauss and Jordan, and the Frobenius norm of that of unit ones.

    The norm is infinite where a pivot vanishes, not a number where a row or a direction does.
    """
    r, n = rows.shape
    work, inverse, lengths, widths = np.empty((r, r)), np.zeros((r, r)), np.zeros(r), np.zeros(r)
    for i in range(r):
        for c in range(n):
            lengths[i] += rows[i, c] ** 2
            widths[i] += directions[i, c] ** 2
        if lengths[i] == 0.0 or widths[i] == 0.0:
            return inverse, math.nan
        # Rows and directions of unit length, so that what counts as singular does not hang on their units.
        lengths[i], widths[i], inverse[i, i] = math.sqrt(lengths[i]), math.sqrt(widths[i]), 1.0
    for i in range(r):
        for j in range(r):
            along = 0.0
            for c in range(n):
                along += rows[i, c] * directions[j, c]
            work[i, j] = along / (lengths[i] * widths[j])
    for k in range(r):
        pivot = k
        for i in range(k + 1, r):
            if abs(work[i, k]) > abs(work[pivot, k]):
                pivot = i
        # Partial pivoting: without it a small pivot would spoil rows that are well apart.
        head = work[pivot, k]
        if head == 0.0:
            return inverse, math.inf
        for j in range(r):
            work[k, j], work[pivot, j] = work[pivot, j], work[k, j]
            inverse[k, j], inverse[pivot, j] = inverse[pivot, j], inverse[k, j]
        for j in range(r):
            work[k, j] /= head
            inverse[k, j] /= head
        for i in range(r):
            if i != k:
                share = work[i, k]
                for j in range(r):
                    work[i, j] -= share * work[k, j]
                    inverse[i, j] -= share * inverse[k, j]
    size = 0.0
    for i in range(r):
        for j in range(r):
            size += inverse[i, j] ** 2
            inverse[i, j] /= widths[i] * lengths[j]
    return inverse, math.sqrt(size)


def oblique_projector(N: ArrayLike, C: ArrayLike) -> tuple[Array, Array]:
    """The projector Π = I − C (N C)⁻¹ N along C (n, r) onto {x : N x = 0}, N (r, n), and its correction C̃ = C (N C)⁻¹.

    With Π (n, n) and C̃ (n, r), x = Πx + C̃ (N x): column i of C̃ is the displacement that changes N_i·x by one and no
    other row.

    Raises:
        InfeasibleError: see `coupling_inverse`.
    """
    C_tilde = np.asarray(C, dtype=np.float64) @ coupling_inverse(N, C)
    return np.asarray(np.eye(len(C_tilde)) - C_tilde @ np.asarray(N, dtype=np.float64)), np.asarray(C_tilde)


def metric(rho: float) -> Array:
    """The weights (1, 1, 1, ρ, ρ, ρ) that make angles (rad) lengths (m), ρ in m."""
    return np.array([1.0, 1.0, 1.0, rho, rho, rho])


def outer_sum(F1: Array, F2: Array, weights: Array) -> Array:
    """Root of the ellipsoid of least trace, by weights (n,), around the sum of those with roots F₁, F₂ (n, a).

    (1 + 1/p) Q₁ + (1 + p) Q₂ with p = √(tr Q₁/tr Q₂), traces in the metric of the weights. A summand that is a point
    leaves the other unchanged. The operation is associative, but for rounding.
    """
    s1, s2 = (math.sqrt(float(np.vdot(F, weights[:, None] ** 2 * F))) for F in (F1, F2))
    if s1 == 0.0 or s2 == 0.0:
        return F2 if s1 == 0.0 else F1
    # (1 + s₂/s₁) Q₁ + (1 + s₁/s₂) Q₂ holds the sum for any positive ratio; this one has the least trace.
    return narrow(np.hstack([math.sqrt(1.0 + s2 / s1) * F1, math.sqrt(1.0 + s1 / s2) * F2]), _WIDTH)


def box_root(half_widths: ArrayLike) -> Array:
    """Root of the smallest ellipsoid k·diag(a²) around |xᵢ| ≤ aᵢ, a (n,), a column for each aᵢ that is not zero.

    k is the number of those, so that a flat box gets a flat ellipsoid through its corners.
    """
    a = np.asarray(half_widths, dtype=np.float64)
    if (a < 0.0).any():
        raise ValueError("half-widths must not be negative")
    # k of all n axes: an axis without error takes no share of the others' factor.
    return np.asarray(np.diag(np.sqrt(np.count_nonzero(a) * a**2))[:, a > 0.0])
