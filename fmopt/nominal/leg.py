"""A straight leg of the nominal centre on a plane, and where it crosses lines and circles, in closed form."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from fmopt.values import Array, Value


@dataclass(frozen=True, eq=False)
class Leg(Value):
    """Φ₀ on a straight leg from `start` (2,) by `travel` (2,) in m, r in m, s in rad, size of the section in m."""

    start: Array
    travel: Array
    radius: float
    half_angle: float
    size: float

    def at(self, share: Array) -> Array:
        """Φ₀ (n, 2) at shares (n,) of the leg."""
        return np.asarray(self.start + share[:, None] * self.travel)

    def on_level(self, n: Array, levels: Array) -> Array:
        """Shares at which n·Φ₀ has the values (k,)."""
        rate = float(n @ self.travel)
        return (levels - n @ self.start) / rate if abs(rate) > 1e-300 else np.zeros(0)

    def on_circle(self, centre: Array, radius: float) -> Array:
        """Shares (k,) at which Φ₀ is on a circle about a centre (2,), m."""
        offset = self.start - centre
        a, b, c = float(self.travel @ self.travel), float(offset @ self.travel), float(offset @ offset) - radius**2
        inside = b * b - a * c
        if a == 0.0 or inside < 0.0:
            return np.zeros(0)
        q = -(b + math.copysign(math.sqrt(inside), b))
        return np.array([q / a, c / q] if q != 0.0 else [0.0])
