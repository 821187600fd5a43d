"""A piece of any conic as a rational quadratic: elliptic, parabolic and hyperbolic arcs in one well-conditioned form.

p(t) = ((1−t)² p₀ + 2 w t (1−t) p₁ + t² p₂) / ((1−t)² + 2 w t (1−t) + t²): p₁ is where the end tangents meet, w < 1 an
ellipse, w = 1 a parabola, w > 1 a hyperbola. Nothing blows up where an ellipse grows into a parabola or a line.

Real roots of polynomials on [0, 1], touching ones included, by bracketing between the roots of the derivative.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from fmopt.spatial.values import Array, Value, frozen

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(32)  # exact for polynomials up to degree 63
_MOST_CHORDS = 2**16  # of a polyline


@dataclass(frozen=True, eq=False)
class ConicArc(Value, first=(2,), shoulder=(2,), last=(2,)):
    """The conic arc from `first` to `last` (2,) in m, of weight w > 0, whose end tangents meet in `shoulder` (2,)."""

    first: Array
    shoulder: Array
    last: Array
    weight: float

    def __post_init__(self) -> None:
        super().__post_init__()
        if not (math.isfinite(self.weight) and self.weight > 0.0):
            raise ValueError(f"a conic arc of weight {self.weight}")

    @property
    def homogeneous(self) -> Array:
        """Power-basis coefficients (3, 3): rows t⁰, t¹, t², columns x ω, y ω, ω."""
        p0, p1, p2 = (np.append(p, 1.0) for p in (self.first, self.shoulder, self.last))
        p1 = self.weight * p1
        return np.stack([p0, 2.0 * (p1 - p0), p0 - 2.0 * p1 + p2])

    def point(self, t: ArrayLike) -> Array:
        """Points (…, 2) in m at parameters t (…)."""
        # Bernstein form, not powers of t: ends are hit exactly, and nothing cancels for any weight.
        t = np.asarray(t, dtype=np.float64)[..., None]
        b0, b1, b2 = (1.0 - t) ** 2, 2.0 * self.weight * t * (1.0 - t), t**2
        return np.asarray((b0 * self.first + b1 * self.shoulder + b2 * self.last) / (b0 + b1 + b2))

    def derivative(self, t: ArrayLike) -> Array:
        """dp/dt, shape (…, 2).

        ω² p′ = 2w(1−t)²(p₁−p₀) + 2t(1−t)(p₂−p₀) + 2w t²(p₂−p₁).
        """
        t = np.asarray(t, dtype=np.float64)[..., None]
        w, s = self.weight, 1.0 - t
        bottom = (s**2 + 2.0 * w * t * s + t**2) ** 2
        top = w * s**2 * (self.shoulder - self.first) + t * s * (self.last - self.first)
        return np.asarray(2.0 * (top + w * t**2 * (self.last - self.shoulder)) / bottom)

    def tangent(self, t: ArrayLike) -> Array:
        """Unit tangents (…, 2); zero where the arc has no length."""
        rate = self.derivative(t)
        size = np.linalg.norm(rate, axis=-1, keepdims=True)
        return np.asarray(rate / np.where(size > 0.0, size, 1.0))

    def curvature(self, t: ArrayLike) -> Array:
        """Signed curvature (…,) in 1/m, positive when turning left: w [p₀p₁p₂] / ω³ |p′|³ times 4."""
        t = np.asarray(t, dtype=np.float64)
        bottom = (1.0 - t) ** 2 + 2.0 * self.weight * t * (1.0 - t) + t**2
        size = np.linalg.norm(self.derivative(t), axis=-1)
        return np.asarray(4.0 * self.weight * self.turn / (bottom * size) ** 3)

    @property
    def turn(self) -> float:
        """(p₁ − p₀) × (p₂ − p₁) in m²: twice the area of the control triangle, positive when turning left."""
        (ax, ay), (bx, by) = self.shoulder - self.first, self.last - self.shoulder
        return float(ax * by - ay * bx)

    def reversed(self) -> ConicArc:
        """The same points run through the other way."""
        return ConicArc(self.last, self.shoulder, self.first, self.weight)

    def part(self, a: float, b: float) -> ConicArc:
        """The piece between the parameters a < b, by blossoming."""
        p0, p1, p2 = (np.append(p, 1.0) for p in (self.first, self.shoulder, self.last))
        p1 = self.weight * p1

        def blossom(s: float, t: float) -> Array:
            return np.asarray((1.0 - s) * (1.0 - t) * p0 + (s * (1.0 - t) + t * (1.0 - s)) * p1 + s * t * p2)

        # Blossoming (de Casteljau's scheme in homogeneous coordinates) gives the control points of the piece at once.
        q0, q1, q2 = blossom(a, a), blossom(a, b), blossom(b, b)
        # Ends that are the arc's own are kept to the bit: neighbours share them.
        first = self.first if a == 0.0 else q0[:2] / q0[2]
        last = self.last if b == 1.0 else q2[:2] / q2[2]
        # Standard form again: both end weights scaled to 1 by a change of parameter, which moves no point.
        return ConicArc(first, q1[:2] / q1[2], last, q1[2] / math.sqrt(q0[2] * q2[2]))

    def moved(self, R: ArrayLike, offset: ArrayLike) -> ConicArc:
        """The image under p ↦ R p + offset, R (2, 2).

        The matrix may have any determinant but 0; the offset is (2,), m.
        """
        R, offset = np.asarray(R, dtype=np.float64), np.asarray(offset, dtype=np.float64)
        return ConicArc(R @ self.first + offset, R @ self.shoulder + offset, R @ self.last + offset, self.weight)

    @property
    def length(self) -> float:
        """Length in m, by Gauss's rule on pieces that are nearly straight."""
        # Halved until weights lie near 1; on such pieces speed varies too little for 32 nodes to miss.
        return sum(float(_WEIGHTS @ np.linalg.norm(p.derivative(0.5 * _NODES + 0.5), axis=1)) / 2 for p in self._even())

    def moment(self) -> float:
        """½ ∫ (x dy − y dx) in m²: the chord's part and the segment between chord and arc, by Gauss's rule."""
        return sum(piece._moment() for piece in self._even())

    def _moment(self) -> float:
        t = 0.5 * _NODES + 0.5
        p, rate = self.point(t) - self.first, self.derivative(t)
        bulge = 0.25 * float(_WEIGHTS @ (p[:, 0] * rate[:, 1] - p[:, 1] * rate[:, 0]))
        return bulge + 0.5 * float(self.first[0] * self.last[1] - self.first[1] * self.last[0])

    def _even(self) -> list[ConicArc]:
        """Pieces whose weight lies in [0.5, 2], on which the integrands are smooth enough for 32 nodes."""
        if 0.5 <= self.weight <= 2.0:
            return [self]
        # Far from weight 1 points crowd together, where a rule with fixed nodes would look past them.
        return [*self.part(0.0, 0.5)._even(), *self.part(0.5, 1.0)._even()]

    def extremum(self, direction: ArrayLike) -> list[float]:
        """Parameters in [0, 1] at which the tangent is square to `direction` (2,)."""
        d = np.asarray(direction, dtype=np.float64)
        w = self.weight
        a, c, e = (float((q - p) @ d) for p, q in _pairs(self))
        a, e = w * a, w * e
        # The numerator of p′·d is a quadratic in Bernstein form; here it stands in powers of t.
        return unit_roots((a, c - 2.0 * a, a - c + e), 0.0)

    def nearest(self, points: ArrayLike) -> Array:
        """Parameters (n,) of the nearest points of the curve to `points` (n, 2).

        The feet of perpendiculars are the roots of a quartic; all of them and the ends are compared.
        """
        points = np.asarray(points, dtype=np.float64)
        return np.array([self._nearest(point) for point in points])

    def _nearest(self, point: Array) -> float:
        # Scaled to about 1, so that the tolerances of the root finder mean the same for parts of any size.
        size = max(float(np.max(np.abs(q - point))) for q in (self.first, self.shoulder, self.last)) or 1.0
        own = self.homogeneous
        offset = (own[:, :2] - own[:, 2:] * point) / size
        w = self.weight
        a, c, e = ((q - p) / size for p, q in _pairs(self))
        rate = np.stack([w * a, c - 2.0 * w * a, w * a - c + w * e])
        # Nearest points have (p − x)·p′ = 0, a quartic in t; ends count, too, as the root may lie outside.
        quartic = np.convolve(offset[:, 0], rate[:, 0]) + np.convolve(offset[:, 1], rate[:, 1])
        t = np.array([0.0, 1.0, *unit_roots(quartic.tolist(), 0.0)])
        return float(t[np.argmin(np.linalg.norm(self.point(t) - point, axis=1))])

    @cached_property
    def box(self) -> tuple[Array, Array]:
        """Lower and upper corner (2,) of the bounding box."""
        t = [0.0, 1.0, *self.extremum((1.0, 0.0)), *self.extremum((0.0, 1.0))]
        points = self.point(t)
        return frozen(points.min(axis=0)), frozen(points.max(axis=0))

    def polyline(self, tolerance: float, side: Literal["on", "left", "right"] = "on") -> Array:
        """Points (n, 2) of a polyline within `tolerance` (m) of the arc.

        With "on" every corner is on the arc; "left" and "right" keep the whole polyline on that side of it.
        """
        size = float(np.hypot(*(self.last - self.first)))
        height = abs(self.turn) / size if size > 0.0 else float(np.hypot(*(self.shoulder - self.first)))
        # A guess for a weight near 1, doubled as long as it does not do.
        count = min(1 + math.ceil(math.sqrt(height / tolerance)), _MOST_CHORDS)
        while True:
            t = np.linspace(0.0, 1.0, count + 1)
            points, tangents = self.point(t), self.tangent(t)
            chord, (a, b) = np.diff(points, axis=0), (tangents[:-1], tangents[1:])
            sine = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
            reach = (chord[:, 0] * b[:, 1] - chord[:, 1] * b[:, 0]) / np.where(sine != 0.0, sine, np.inf)
            length = np.hypot(*chord.T)
            # The height of the triangle of a chord and the tangents at its ends bounds how far chord and arc are apart.
            area = np.abs((a[:, 0] * chord[:, 1] - a[:, 1] * chord[:, 0]) * reach)
            if count >= _MOST_CHORDS or np.all(area <= tolerance * length):
                break
            count *= 2
        if side != "on" and (side == "right") == (self.turn > 0.0):
            # On the side where the arc bulges tangents, so that the curve is left behind.
            corners = np.stack([points[:-1], points[:-1] + reach[:, None] * a], axis=1).reshape(-1, 2)
            return np.vstack([corners, points[-1:]])
        return points

    def implicit(self) -> Array:
        """The symmetric matrix (3, 3) of the conic: (x, y, 1) M (x, y, 1)ᵀ = 0, from 4 w² τ₀ τ₂ = τ₁²."""
        inverse = np.linalg.inv(np.stack([np.append(p, 1.0) for p in (self.first, self.shoulder, self.last)]).T)
        # Rows of the inverse take (x, y, 1) to τ₀, τ₁, τ₂, its barycentric coordinates in the control triangle.
        a, b, c = inverse
        return np.asarray(2.0 * self.weight**2 * (np.outer(a, c) + np.outer(c, a)) - np.outer(b, b))


def _pairs(arc: ConicArc) -> tuple[tuple[Array, Array], tuple[Array, Array], tuple[Array, Array]]:
    return (arc.first, arc.shoulder), (arc.first, arc.last), (arc.shoulder, arc.last)


def unit_roots(coefficients: Sequence[float], touch: float) -> list[float]:
    """Roots in [0, 1] of c₀ + c₁t + …, ascending, and turning points there where the value is at most `touch`.

    Returns:
        The roots; none when the whole polynomial is at most `touch` in size.
    """
    c = np.trim_zeros(np.asarray(coefficients, dtype=np.float64), "b")
    # The whole polynomial is below what counts as touching: the curves coincide, and there is no single root.
    if len(c) < 2 or np.abs(c).sum() <= touch:
        return []
    derivative = np.polynomial.polynomial.polyder(c)
    roots = np.polynomial.polynomial.polyroots(c)
    simple = roots.real[np.abs(roots.imag) <= 1e-9]
    # One step of Newton's method takes rounding off; at a double root, which is a turning point, there is no slope.
    slope = np.polynomial.polynomial.polyval(simple, derivative)
    step = np.polynomial.polynomial.polyval(simple, c) / np.where(slope != 0.0, slope, np.inf)
    simple = simple - np.where(np.abs(step) < 1e-6, step, 0.0)
    turning = np.concatenate([[0.0, 1.0], np.polynomial.polynomial.polyroots(derivative).real])
    flat = turning[np.abs(np.polynomial.polynomial.polyval(turning, c)) <= touch]
    # Rounding makes two simple roots beside a touching one of the double root that it is.
    found = np.concatenate([simple[np.abs(simple[:, None] - flat).min(axis=1, initial=np.inf) > 1e-6], flat])
    return sorted({float(min(max(t, 0.0), 1.0)) for t in found if -1e-12 <= t <= 1.0 + 1e-12})
