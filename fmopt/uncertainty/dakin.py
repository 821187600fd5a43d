"""The published recipe for one step of the tube, kept for comparison only: it under-covers.

[DakinPopplestone1993] section 4.2 takes the section of the error ellipsoid by V⊥ where its shadow is needed, so
that most of the ellipsoid's surface leaves the cylinder. Nothing here may enter a certificate.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import null_space

from fmopt import ellipsoid
from fmopt.uncertainty.error_set import ErrorSet
from fmopt.values import Array

_ACROSS = 0.03  # sine of the angle below which an axis counts as along the motion: eq. 13 is singular there


def section(Q: Array, V: Array) -> Array:
    """Shape matrix Q − (QV)(QV)ᵀ/(VᵀQV) of the section of the ellipsoid by the hyperplane V⊥ through its centre.

    The ellipsoid through the surface points λ_U U of [DakinPopplestone1993] eq. 9 and 28, in closed form and in
    the coordinates of Q.

    Args:
        Q: shape matrix (n, n).
        V: direction (n,).
    """
    QV = Q @ V
    reach = float(V @ QV)
    return np.asarray(Q - np.outer(QV, QV) / reach) if reach > 0.0 else Q


def lateral_rate(U: Array, velocity_error: tuple[float, float]) -> float:
    """λ_U of [DakinPopplestone1993] eq. 6: the point of the cone's base in direction U (6,), scaled by ρ."""
    rates = np.repeat(velocity_error, 3)
    u = U / np.linalg.norm(U)
    if (u[rates == 0.0] != 0.0).any():
        return 0.0
    return float(1.0 / np.linalg.norm(u[rates > 0.0] / rates[rates > 0.0]))


def step(
    errors: ErrorSet,
    move: Array,
    rows: Array,
    directions: Array,
    velocity_error: tuple[float, float],
    rho: float,
) -> ErrorSet:
    """Errors at the goal after one segment, by [DakinPopplestone1993] section 4.4.

    The section by V⊥ is carried onto the goal state, and its radii grow by v/(1 − |B·V|) (eq. 13). The paper
    bounds no curvature.

    Args:
        errors: errors at the start; the paper knows their ellipsoid alone.
        move: V (6,) as (d, δ) in m and rad.
        rows: a basis N (r, 6) of the contacts that hold at the goal.
        directions: C (6, r), for each row the direction in which its contact corrects the pose.
        velocity_error: (λ_t, λ_r), m of drift and ρ·rad of drift per m of travel.
        rho: characteristic length in m.
    """
    M = ellipsoid.metric(rho)
    scaled_move = move * M
    length = float(np.linalg.norm(scaled_move))
    projector, _ = ellipsoid.oblique_projector(rows / M, directions * M[:, None])
    Q = errors.shape * np.outer(M, M)
    if length == 0.0:
        return ErrorSet.from_ellipsoid(ellipsoid.image(Q, projector) / np.outer(M, M))
    V = scaled_move / length
    basis = null_space(rows / M) if len(rows) else np.eye(6)
    squares, axes = np.linalg.eigh(basis.T @ ellipsoid.image(section(Q, V), projector) @ basis)
    radii = np.sqrt(np.maximum(squares, 0.0))
    B = basis @ axes
    for i, axis in enumerate(B.T):
        along = float(axis @ V)
        U = axis - along * V
        if np.linalg.norm(U) > _ACROSS:
            radii[i] += lateral_rate(U, velocity_error) * length / (1.0 - abs(along))
    return ErrorSet.from_ellipsoid((B * radii**2) @ B.T / np.outer(M, M))
