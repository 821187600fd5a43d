"""Real roots of polynomials on [0, 1], touching ones included, by bracketing between the roots of the derivative."""

from __future__ import annotations

import math
from collections.abc import Sequence


def unit_roots(coefficients: Sequence[float], touch: float) -> list[float]:
    """Roots in [0, 1] of c₀ + c₁t + …, ascending.

    Between two roots of the derivative a polynomial is monotone, so a bracket holds at most one root and nothing is
    missed; a turning point where the value is at most `touch` counts as a (double) root.

    Args:
        coefficients: c₀, c₁, … of any degree.
        touch: values of this size and less are zero.

    Returns:
        The roots; none when the whole polynomial is at most `touch` in size.
    """
    if sum(abs(c) for c in coefficients) <= touch:
        return []
    if len(coefficients) == 1:
        return []
    if len(coefficients) == 2:
        root = -coefficients[0] / coefficients[1] if coefficients[1] != 0.0 else math.nan
        return [root] if 0.0 <= root <= 1.0 else _touching_ends(coefficients, touch)
    derivative = [k * c for k, c in enumerate(coefficients)][1:]
    stops = [0.0, *unit_roots(derivative, 0.0), 1.0]
    values = [_value(coefficients, stop) for stop in stops]
    found = [stop for stop, value in zip(stops, values, strict=True) if abs(value) <= touch]
    for a, b, fa, fb in zip(stops, stops[1:], values, values[1:], strict=False):
        if abs(fa) > touch and abs(fb) > touch and (fa < 0.0) != (fb < 0.0):
            found.append(_bracketed(coefficients, a, b, fa))
    return sorted(set(found))


def _touching_ends(coefficients: Sequence[float], touch: float) -> list[float]:
    return [t for t in (0.0, 1.0) if abs(_value(coefficients, t)) <= touch]


def _value(coefficients: Sequence[float], t: float) -> float:
    value = 0.0
    for c in reversed(coefficients):
        value = value * t + c
    return value


def _bracketed(coefficients: Sequence[float], a: float, b: float, fa: float) -> float:
    """The root in [a, b] by Newton's method kept inside a shrinking bracket."""
    slope = [k * c for k, c in enumerate(coefficients)][1:]
    t = 0.5 * (a + b)
    for _ in range(80):
        value = _value(coefficients, t)
        if value == 0.0:
            return t
        if (value < 0.0) == (fa < 0.0):
            a = t
        else:
            b = t
        rate = _value(slope, t)
        following = t - value / rate if rate != 0.0 else a
        if not a < following < b:
            following = 0.5 * (a + b)
        if abs(following - t) <= 1e-17 + 1e-16 * abs(t):
            return following
        t = following
    return t
