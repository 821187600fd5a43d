"""Where lines and circles meet."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fmopt.plane.curve import Arc, Segment
from fmopt.values import Array


def meetings(curves: Sequence[Segment | Arc]) -> Array:
    """All points (k, 2) in m where the lines and circles of the curves meet."""
    lines = [(c.start, c.end - c.start) for c in curves if isinstance(c, Segment)]
    rounds = sorted({(*map(float, c.centre), c.radius) for c in curves if isinstance(c, Arc)})
    L = np.reshape([np.concatenate(line) for line in lines], (-1, 4))
    C = np.reshape(rounds, (-1, 3))
    with np.errstate(divide="ignore", invalid="ignore"):
        found = [_lines_meet(L), _line_circle_meet(L, C), _circles_meet(C)]
    points = np.vstack(found)
    return points[np.isfinite(points).all(axis=1)]


def _lines_meet(L: Array) -> Array:
    i, j = np.triu_indices(len(L), 1)
    d, e, gap = L[i, 2:], L[j, 2:], L[j, :2] - L[i, :2]
    t = cross(gap, e) / cross(d, e)
    return np.asarray(L[i, :2] + t[:, None] * d)


def _line_circle_meet(L: Array, C: Array) -> Array:
    start, d = L[:, None, :2] - C[None, :, :2], L[:, None, 2:]
    square = np.sum(d * d, axis=-1)
    middle = -np.sum(start * d, axis=-1) / square
    aside = np.abs(cross(start, d)) / np.sqrt(square)
    half = _half_chord(C[None, :, 2], aside) / np.sqrt(square)
    points = [L[:, None, :2] + (middle + side * half)[..., None] * d for side in (-1.0, 1.0)]
    return np.reshape(points, (-1, 2))


def _circles_meet(C: Array) -> Array:
    i, j = np.triu_indices(len(C), 1)
    between = C[j, :2] - C[i, :2]
    apart = np.hypot(between[:, 0], between[:, 1])
    along = 0.5 * (apart + (C[i, 2] - C[j, 2]) * (C[i, 2] + C[j, 2]) / apart)
    half = _half_chord(C[i, 2], np.abs(along))
    u = between / apart[:, None]
    normal = np.stack([-u[:, 1], u[:, 0]], axis=-1)
    points = [C[i, :2] + along[:, None] * u + (side * half)[:, None] * normal for side in (-1.0, 1.0)]
    return np.reshape(points, (-1, 2))


def _half_chord(radius: Array, aside: Array) -> Array:
    """Half the chord of a circle at a distance from its centre; touching within rounding counts as touching."""
    square = (radius - aside) * (radius + aside)
    return np.sqrt(np.where(np.abs(square) <= 1e-14 * radius**2, 0.0, square))


def cross(a: Array, b: Array) -> Array:
    """a × b along the last axis, of vectors (…, 2)."""
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])
