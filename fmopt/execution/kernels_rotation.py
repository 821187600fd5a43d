"""Rotations of one body as numbers, for kernels; `rotation` has those of many bodies at once."""

from math import atan2, cos, sin, sqrt
from typing import TypeAlias

from fmopt.runtime.compiled import compiled
from fmopt.spatial.values import Array

Quaternion: TypeAlias = tuple[float, float, float, float]


@compiled
def product(a: Quaternion, b: Quaternion) -> Quaternion:
    """The quaternion of the rotation a after b."""
    return (
        a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
        a[0] * b[1] + b[0] * a[1] + a[2] * b[3] - a[3] * b[2],
        a[0] * b[2] + b[0] * a[2] + a[3] * b[1] - a[1] * b[3],
        a[0] * b[3] + b[0] * a[3] + a[1] * b[2] - a[2] * b[1],
    )


@compiled
def turn(x: float, y: float, z: float) -> Quaternion:
    """The quaternion of a rotation vector, rad."""
    half = 0.5 * sqrt(x * x + y * y + z * z)
    share = 0.5 * sin(half) / half if half > 1e-9 else 0.5
    return cos(half), share * x, share * y, share * z


@compiled
def between(a: Quaternion, b: Quaternion) -> tuple[float, float, float]:
    """The rotation vector, rad, that turns b into a, by at most π."""
    w, x, y, z = product(a, (b[0], -b[1], -b[2], -b[3]))
    sine = sqrt(x * x + y * y + z * z)
    share = 2.0 * atan2(sine, abs(w)) / sine if sine > 1e-9 else 2.0
    share = -share if w < 0.0 else share
    return share * x, share * y, share * z


@compiled
def row(q: Array) -> Quaternion:
    """A quaternion (4,) of an array."""
    return q[0], q[1], q[2], q[3]


@compiled
def rotated(q: Array, v: Array, inverse: bool, out: Array) -> None:
    """Vectors (n, 3) turned by quaternions (n, 4), or by their inverses, into `out`."""
    for k in range(len(q)):
        w, sign = q[k, 0], -1.0 if inverse else 1.0
        x, y, z = sign * q[k, 1], sign * q[k, 2], sign * q[k, 3]
        a, b, c = v[k, 0], v[k, 1], v[k, 2]
        i, j, h = 2.0 * (y * c - z * b), 2.0 * (z * a - x * c), 2.0 * (x * b - y * a)
        out[k, 0] = a + w * i + y * h - z * j
        out[k, 1] = b + w * j + z * i - x * h
        out[k, 2] = c + w * h + x * j - y * i
