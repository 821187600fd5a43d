"""Ellipsoids by shape matrix: Q (n, n) positive semidefinite stands for {c + Q^½ u, |u| ≤ 1}.

Q may be singular, which makes the ellipsoid flat: after a contact it usually is. The centre is kept by the caller.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from fmopt.errors import InfeasibleError
from fmopt.values import Array

_SINGULAR = 1e-12


def support(Q: Array, directions: ArrayLike) -> Array:
    """How far the ellipsoid reaches along each direction, h(N) = √(NᵀQN).

    Args:
        Q: shape matrix (n, n).
        directions: rows N (k, n), or one direction (n,).

    Returns:
        (k,), or a scalar array for one direction, in the unit of N·x.
    """
    N = np.asarray(directions, dtype=np.float64)
    return np.asarray(np.sqrt(np.maximum(np.sum((N @ Q) * N, axis=-1), 0.0)))


def root(Q: Array) -> Array:
    """The symmetric root Q^½ (n, n); eigenvalues within rounding of zero count as zero."""
    w, B = np.linalg.eigh(Q)
    noise = len(Q) * float(np.finfo(np.float64).eps) * max(w[-1], 0.0)
    return np.asarray((B * np.sqrt(np.where(w > noise, w, 0.0))) @ B.T)


def contains(Q: Array, points: ArrayLike, tolerance: float = 1e-9) -> Array:
    """Whether each point lies in the ellipsoid around the origin.

    Args:
        Q: shape matrix (n, n).
        points: (k, n), relative to the centre.
        tolerance: how far outside still passes, as a fraction of the largest radius.

    Returns:
        Booleans (k,).
    """
    w, B = np.linalg.eigh(Q)
    radii = np.sqrt(np.maximum(w, 0.0)) + tolerance * np.sqrt(max(w[-1], 0.0))
    if radii[-1] == 0.0:
        return np.asarray(~np.any(np.asarray(points), axis=-1))
    y = np.asarray(points, dtype=np.float64) @ (B / radii)
    return np.asarray(np.einsum("ij,ij->i", y, y) <= 1.0)


def image(Q: Array, A: Array) -> Array:
    """Shape matrix A Q Aᵀ (m, m) of the image under the linear map A (m, n), exact."""
    shape = A @ Q @ A.T
    return np.asarray(0.5 * (shape + shape.T))


def complement(V: ArrayLike) -> Array:
    """An orthonormal basis U (n, n−1) of V⊥ as columns, by Householder reflection of V onto an axis."""
    v = np.asarray(V, dtype=np.float64)
    k = int(np.argmax(np.abs(v)))
    length = float(np.linalg.norm(v))
    if length == 0.0:
        raise ValueError("a zero direction has no complement")
    w = v / length
    w[k] += np.copysign(1.0, w[k])
    reflection = np.eye(len(v)) - 2.0 * np.outer(w, w) / (w @ w)
    return np.asarray(np.delete(reflection, k, axis=1))


def shadow(Q: Array, V: ArrayLike) -> Array:
    """Shape matrix UᵀQU (n−1, n−1) of the shadow along V, in the basis U of `complement(V)`.

    This is the sound cross-section of the forward projection; the one of [DakinPopplestone1993] eq. 9 is a
    section, which lies inside.
    """
    return image(Q, complement(V).T)


def coupling_inverse(N: ArrayLike, C: ArrayLike) -> Array:
    """(N C)⁻¹ (r, r): how far to go along each direction so that N x changes as wanted.

    Args:
        N: rows (r, n).
        C: directions as columns (n, r).

    Raises:
        InfeasibleError: moving along C cannot set N x, because N C is singular.
    """
    rows, columns = np.asarray(N, dtype=np.float64), np.asarray(C, dtype=np.float64)
    if rows.shape != columns.T.shape:
        raise ValueError(f"rows have shape {rows.shape}, directions {columns.shape}; expected (r, n) and (n, r)")
    lengths, widths = np.linalg.norm(rows, axis=1), np.linalg.norm(columns, axis=0)
    if not (lengths.all() and widths.all()):
        raise ValueError("a contact row or a direction is zero")
    unit = (rows / lengths[:, None]) @ (columns / widths)
    smallest = float(np.linalg.svd(unit, compute_uv=False)[-1]) if len(rows) else 1.0
    if smallest < _SINGULAR:
        raise InfeasibleError(
            f"the directions do not reach all contact rows (smallest singular value {smallest:.1e})",
            advice="pass independent contact rows, and one direction for each that is not tangent to it",
        )
    return np.asarray(np.linalg.inv(unit) / np.outer(widths, lengths))


def oblique_projector(N: ArrayLike, C: ArrayLike) -> tuple[Array, Array]:
    """The projector Π = I − C (N C)⁻¹ N along C onto {x : N x = 0}, and its correction C̃ = C (N C)⁻¹.

    x = Πx + C̃ (N x), so column i of C̃ is the displacement that changes N_i·x by one and no other row.

    Args:
        N: rows (r, n).
        C: directions as columns (n, r).

    Returns:
        Π (n, n) and C̃ (n, r).

    Raises:
        InfeasibleError: see `coupling_inverse`.
    """
    C_tilde = np.asarray(C, dtype=np.float64) @ coupling_inverse(N, C)
    return np.asarray(np.eye(len(C_tilde)) - C_tilde @ np.asarray(N, dtype=np.float64)), np.asarray(C_tilde)


def facet_image(Q: Array, N: ArrayLike, V: ArrayLike) -> Array:
    """Shape matrix ΠQΠᵀ of the image on the facet with normal N along V, Π = I − V Nᵀ/(NᵀV), exact."""
    projector, _ = oblique_projector(np.reshape(N, (1, -1)), np.reshape(V, (-1, 1)))
    return image(Q, projector)


def metric(rho: float) -> Array:
    """The weights (1, 1, 1, ρ, ρ, ρ) that make angles (rad) lengths (m), ρ in m."""
    return np.array([1.0, 1.0, 1.0, rho, rho, rho])


def outer_sum(Q1: Array, Q2: Array, weights: Array) -> Array:
    """The ellipsoid of least trace (1 + 1/p) Q1 + (1 + p) Q2 around the Minkowski sum of two.

    With traces tᵢ = tr(W Qᵢ W), W = diag(weights), the least is at p = √(t₁/t₂). A summand that is a point
    leaves the other unchanged. The operation is associative.

    Args:
        Q1: shape matrix (n, n).
        Q2: shape matrix (n, n).
        weights: metric (n,) in which the trace is taken, positive.
    """
    s1, s2 = _trace_root(Q1, weights), _trace_root(Q2, weights)
    if s1 == 0.0 or s2 == 0.0:
        return np.asarray(Q2 if s1 == 0.0 else Q1)
    return np.asarray((1.0 + s2 / s1) * Q1 + (1.0 + s1 / s2) * Q2)


def _trace_root(Q: Array, weights: Array) -> float:
    return float(np.sqrt(np.diag(Q) @ weights**2))


def box_shape(half_widths: ArrayLike) -> Array:
    """Shape matrix k·diag(a²) of the smallest ellipsoid around the box |xᵢ| ≤ aᵢ.

    k is the number of half-widths that are not zero, so that a flat box gets a flat ellipsoid through its corners.

    Args:
        half_widths: a (n,), not negative.
    """
    a = np.asarray(half_widths, dtype=np.float64)
    if (a < 0.0).any():
        raise ValueError("half-widths must not be negative")
    return np.asarray(np.count_nonzero(a) * np.diag(a**2))


def zonotope_shape(generators: Array, weights: Array) -> Array:
    """The ellipsoid of least trace around {Σ uᵢ gᵢ, |uᵢ| ≤ 1}: the outer sum of the segments ±gᵢ.

    Args:
        generators: rows gᵢ (k, n).
        weights: metric (n,) in which the trace is taken, positive.
    """
    lengths = np.linalg.norm(generators * weights, axis=1)
    G = generators[lengths > 0.0]
    lengths = lengths[lengths > 0.0]
    return np.asarray(lengths.sum() * (G.T / lengths) @ G)
