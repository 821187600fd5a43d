"""Membership in an ellipsoid, by least squares."""

import numpy as np

from fmopt.spatial.values import Array


def contains(F: Array, points: Array, tolerance: float) -> Array:
    """Which points (n, k) lie in {F u, |u| ≤ 1}, radii widened by the tolerance."""
    U, s, _ = np.linalg.svd(F)
    radii = np.concatenate([s, np.zeros(len(F) - len(s))]) + tolerance
    y = (U / radii).T @ points
    return np.asarray((y * y).sum(axis=0) <= 1.0)
