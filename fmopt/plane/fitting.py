"""Conic arcs beside a smooth curve that has no conic form, such as the offset of an ellipse.

All conics with the same end tangents lie one outside the other as their weight grows, so that the weights of the conics
through points of the curve bound it from both sides.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise
from typing import TypeAlias

import numpy as np

from fmopt.plane.conic import ConicArc
from fmopt.plane.curve import Curve, Segment
from fmopt.values import Array

Support: TypeAlias = Callable[[Array], Array]

_INNER = np.linspace(0.0, 1.0, 17)[1:-1]
_MARGIN = 0.5
_LEAST_TURN = 1e-4  # rad


def fitted(points: Support, low: float, high: float, ahead: bool, tolerance: float) -> list[Curve]:
    """Curves on the right of a given one with its ends and end tangents, within `tolerance` of it.

    The fit is halved until the weights at 15 points differ by less than the tolerance, and half as much is added.

    Args:
        points: of the curve (n, 2) in m, whose tangents run in the directions (n,) in rad or against them all.
        low: first direction in rad.
        high: last direction, at most 90° further.
        ahead: whether to travel from low to high, which turns left; the other way turns right.
        tolerance: in m.
    """
    p0, p2 = points(np.array([low, high]))
    t0, t2 = ((math.cos(angle), math.sin(angle)) for angle in (low, high))
    chord = p2 - p0
    reach = float(chord[0] * t2[1] - chord[1] * t2[0]) / math.sin(high - low)
    p1 = p0 + reach * np.array(t0)
    bulge = p1 - 0.5 * (p0 + p2)
    height = float(np.hypot(*bulge))
    if height <= tolerance or high - low <= _LEAST_TURN:
        run = [p0, p1, p2] if ahead else [p0, p2]
        return [Segment(a, b) for a, b in pairwise(run if ahead else run[::-1])]
    weights = _weights(points(low + (high - low) * _INNER), p0, p1, p2)
    least, most = float(weights.min()), float(weights.max())
    if least > 0.0 and height * (most / (1.0 + most) - least / (1.0 + least)) * (1.0 + 2.0 * _MARGIN) <= tolerance:
        spread = _MARGIN * (most - least)
        weight = most + spread if ahead else max(least - spread, 0.5 * least)
        return [ConicArc(p0, p1, p2, weight) if ahead else ConicArc(p2, p1, p0, weight)]
    middle = 0.5 * (low + high)
    halves = [fitted(points, low, middle, ahead, tolerance), fitted(points, middle, high, ahead, tolerance)]
    return [curve for half in (halves if ahead else halves[::-1]) for curve in half]


def _weights(points: Array, p0: Array, p1: Array, p2: Array) -> Array:
    """Weights (n,) of the conics with given end tangents through points (n, 2), 0 for points outside the triangle."""
    u, v, d = p1 - p0, p2 - p0, points - p0
    area = u[0] * v[1] - u[1] * v[0]
    shoulder = (d[:, 0] * v[1] - d[:, 1] * v[0]) / area
    last = (u[0] * d[:, 1] - u[1] * d[:, 0]) / area
    inside = (shoulder > 0.0) & (last > 0.0) & (shoulder + last < 1.0)
    product = np.where(inside, (1.0 - shoulder - last) * last, 1.0)
    return np.where(inside, 0.5 * shoulder / np.sqrt(product), 0.0)
