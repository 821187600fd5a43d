"""Rotations of many bodies at once: exponentials, logarithms, quaternions, along the last axes."""

import numpy as np

from fmopt.spatial.se3 import cross
from fmopt.spatial.values import Array


def hats(w: Array) -> Array:
    """[w]× (…, 3, 3) of vectors (…, 3)."""
    zero = np.zeros(w.shape[:-1])
    x, y, z = w[..., 0], w[..., 1], w[..., 2]
    return np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1).reshape(*w.shape[:-1], 3, 3)


def from_quaternions(q: Array) -> Array:
    """Rotation matrices (…, 3, 3) of unit quaternions (…, 4), w first."""
    w, v = q[..., 0], q[..., 1:]
    K = hats(v)
    return np.asarray(np.eye(3) + 2.0 * (w[..., None, None] * K + K @ K))


def quaternions(r: Array) -> Array:
    """Unit quaternions (…, 4), w first, of rotation vectors (…, 3), rad."""
    half = 0.5 * np.linalg.norm(r, axis=-1, keepdims=True)
    # sin(half)/half, at 0, too; NumPy's sinc has the π in it.
    return np.concatenate([np.cos(half), 0.5 * np.sinc(half / np.pi) * r], axis=-1, dtype=np.float64)


def product(a: Array, b: Array) -> Array:
    """Quaternions (…, 4) of the rotation a after b."""
    wa, va, wb, vb = a[..., :1], a[..., 1:], b[..., :1], b[..., 1:]
    real = wa * wb - np.sum(va * vb, axis=-1, keepdims=True)
    return np.concatenate([real, wa * vb + wb * va + cross(va, vb)], axis=-1)


def between(a: Array, b: Array) -> Array:
    """Rotation vectors (…, 3), rad, that turn unit quaternions (…, 4), real part first, b into a, by at most π."""
    w, v = np.split(product(a, b * np.array([1.0, -1.0, -1.0, -1.0])), [1], axis=-1)
    sine = np.linalg.norm(v, axis=-1, keepdims=True)
    # q and −q are the same rotation: that with w ≥ 0 is the shorter way.
    v, w = np.where(w < 0.0, -v, v), np.abs(w)
    angle = 2.0 * np.arctan2(sine, w)  # at small angles an arccosine would lose half of the digits
    return np.asarray(v * np.where(sine > 1e-9, angle / np.maximum(sine, 1e-9), 2.0))
