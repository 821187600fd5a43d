"""Contacts in space under the same sources: the interval of C-surface values over all deviations.

A point of the grasped part is off by up to ε in position, anywhere in a ball, and by a turn of up to ε_φ about the
reference point, about any axis or, for a planar motion, about one. The contact is possible only where the interval
holds 0. [BasanezSuarez] stops at the plane; for a prism in planar motion the intervals are the planar ones.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from fmopt.papers.basanez_suarez.sources import require
from fmopt.spatial.se3 import Pose, cross
from fmopt.spatial.values import Array, Value, frozen


@dataclass(frozen=True)
class Interval:
    """Least and greatest value, m."""

    low: float
    high: float

    @property
    def possible(self) -> bool:
        """Whether the contact is possible: the interval holds 0."""
        return self.low <= 0.0 <= self.high

    def widened(self, by: float) -> Interval:
        """The interval with `by` (m) more on both sides."""
        return Interval(self.low - by, self.high + by)


@dataclass(frozen=True, eq=False)
class Turns(Value):
    """All turns by up to `angle` (rad) about any axis, or about the given one (3,).

    Args:
        angle: ε_φrφg, rad; π or more is every turn.
        axis: unit vector (3,), or None.
    """

    angle: float
    axis: Array | None = None

    def __post_init__(self) -> None:
        require(angle=self.angle)
        if self.axis is not None:
            axis = frozen(self.axis, 3, name="axis")
            object.__setattr__(self, "axis", frozen(axis / np.linalg.norm(axis)))

    def values(self, M: ArrayLike) -> Interval:
        """Least and greatest value of tr(RᵀM) over the turns R, for a matrix M (3, 3); with M = n uᵀ that of n·(R u).

        In the unit quaternion q of R it is qᵀBq, with q₀² ≥ cos²(ε/2). Two quadratic forms on a sphere have a convex
        joint range, so that the greatest value is exactly its dual bound, λ_max(B) where that turn is allowed, else
        min over σ > λ_max(C) of cos²(ε/2) B₀₀ + sin²(ε/2) σ + cos²(ε/2) bᵀ(σI − C)⁻¹b, b and C the blocks of B. Every σ
        gives a bound from above.
        """
        # tr(Rᵀ M) is a quadratic form of the unit quaternion: turns of at most an angle are a cap about the first axis.
        B = _quaternion_form(np.asarray(M, dtype=np.float64))
        angle = min(self.angle, math.pi)
        if self.axis is not None:
            return _about_axis(B, self.axis, angle)
        return Interval(-_greatest(-B, angle), _greatest(B, angle))


def vertex_face(
    pose: Pose, vertex: ArrayLike, normal: ArrayLike, offset: float, turns: Turns, radius: float
) -> Interval:
    """Values of n·(p + R v) − offset, a vertex of the moving part on a fixed face; exact.

    Args:
        pose: of the moving part's frame, whose origin is the reference point.
        vertex: v (3,) in that frame, m.
        normal: unit outward normal n (3,) of the face.
        offset: n·a of a point a of the face, m.
        radius: ε_prpgv + ε_a, m.
    """
    n, v = frozen(normal, 3, name="normal"), frozen(vertex, 3, name="vertex")
    turned = turns.values(np.outer(n, pose.R @ v))
    base = float(n @ pose.p) - offset
    return Interval(base + turned.low, base + turned.high).widened(radius)


def face_vertex(
    pose: Pose, normal: ArrayLike, offset: float, vertex: ArrayLike, turns: Turns, radius: float
) -> Interval:
    """Values of (R n)·(w − p) − offset, a face of the moving part on a fixed vertex; exact.

    Args:
        pose: of the moving part's frame, whose origin is the reference point.
        normal: unit outward normal n (3,) of the face in that frame.
        offset: of the face in that frame, m.
        vertex: w (3,), m.
        radius: ε_prpgv + ε_a, m.
    """
    n, w = frozen(normal, 3, name="normal"), frozen(vertex, 3, name="vertex")
    turned = turns.values(np.outer(w - pose.p, pose.R @ n))
    return Interval(turned.low - offset, turned.high - offset).widened(radius)


def edge_edge(pose: Pose, moving: ArrayLike, fixed: ArrayLike, turns: Turns, radius: float) -> Interval:
    """Bounds of m·(p + R c − q), an edge of the moving part across a fixed one, m along (R e_moving) × e_fixed.

    The function is a triple product, linear in R and bounded exactly, over the sine between the edges, bounded by the
    turn. The interval holds all values; it is exact to first order where the edges nearly touch, exact without a turn,
    and wider by about |value| × ε_φ × cot(angle between the edges) elsewhere.

    Args:
        pose: of the moving part's frame, whose origin is the reference point.
        moving: ends (2, 3) in that frame, m, run so that m points out of the fixed part.
        fixed: ends (2, 3), m.
        radius: ε_prpgv + ε_a, m.

    Raises:
        ValueError: an edge has no length.
    """
    (u, u_end), (q, q_end) = frozen(moving, 2, 3, name="moving edge"), frozen(fixed, 2, 3, name="fixed edge")
    a, e, u = pose.R @ _direction(u_end - u), _direction(q_end - q), pose.R @ u
    # (Ra × e)·(p + Ru − q) = Ra·(e × (p − q)) + R(u × a)·e.
    product = turns.values(np.outer(cross(e, pose.p - q), a) + np.outer(e, cross(u, a)))
    angle = math.atan2(float(np.linalg.norm(cross(a, e))), float(a @ e))
    # The sine of the angle between the edges over all turns: its least and greatest value, π/2 if it is among them.
    sines = [math.sin(angle - min(turns.angle, angle)), math.sin(min(angle + turns.angle, math.pi))]
    least = min(sines)
    most = 1.0 if abs(angle - 0.5 * math.pi) <= turns.angle else max(sines)
    # The quotient is least with the larger sine where it is positive, with the smaller where it is negative.
    return Interval(_over(product.low, least, most), -_over(-product.high, least, most)).widened(radius)


def _over(low: float, least: float, most: float) -> float:
    """A lower bound of value / sine for value ≥ low and sine in [least, most]."""
    sine = least if low < 0.0 else most
    return low / sine if sine > 0.0 else -math.inf


def _direction(edge: Array) -> Array:
    length = float(np.linalg.norm(edge))
    if length == 0.0:
        raise ValueError("an edge has no length")
    return np.asarray(edge / length)


def _quaternion_form(M: Array) -> Array:
    """B (4, 4) with tr(RᵀM) = qᵀBq for the unit quaternion q, real part first, of R."""
    v = np.array([M[2, 1] - M[1, 2], M[0, 2] - M[2, 0], M[1, 0] - M[0, 1]])
    B = np.empty((4, 4))
    B[0, 0] = np.trace(M)
    B[0, 1:] = B[1:, 0] = v
    B[1:, 1:] = M + M.T - np.trace(M) * np.eye(3)
    return B


def _greatest(B: Array, angle: float) -> float:
    """Greatest qᵀBq over |q| = 1, q₀² ≥ cos²(angle / 2)."""
    cosine, sine = math.cos(0.5 * angle), math.sin(0.5 * angle)
    if sine == 0.0:
        return float(B[0, 0])
    values, vectors = np.linalg.eigh(B)
    # The eigenvector of the largest value is within the cap: it is the answer without any constraint.
    if abs(vectors[0, -1]) >= cosine:
        return float(values[-1])
    c, axes = np.linalg.eigh(B[1:, 1:])
    # On the rim of the cap: a secular equation in the multiplier, monotonic, solved by halving.
    b = (axes.T @ B[1:, 0]) ** 2
    top = float(c[-1])
    c, b = c[b > 0.0], b[b > 0.0]
    low, high = top, top + (math.sqrt(float(b.sum())) * cosine / sine)
    for _ in range(100):
        middle = 0.5 * (low + high)
        if not low < middle < high:
            break
        low, high = (middle, high) if (b / (middle - c) ** 2).sum() * cosine**2 > sine**2 else (low, middle)
    # What rounds to the multiplier itself would divide by nothing.
    b, c = b[c < high], c[c < high]
    return float(cosine**2 * B[0, 0] + sine**2 * high + cosine**2 * (b / (high - c)).sum())


def _about_axis(B: Array, axis: Array, angle: float) -> Interval:
    """The range of qᵀBq over turns by up to `angle` about an axis: c + a cos δ + b sin δ."""
    k = np.concatenate([[0.0], axis])
    cc, ss, sc = float(B[0, 0]), float(k @ B @ k), float(B[0] @ k)
    centre, amplitude, phase = 0.5 * (cc + ss), math.hypot(0.5 * (cc - ss), sc), math.atan2(sc, 0.5 * (cc - ss))
    # A sinusoid of the half-angle: greatest and least at the phases nearest to, and farthest from, its peak.
    nearest = max(abs(phase) - angle, 0.0)
    farthest = max(abs(math.remainder(phase + math.pi, 2.0 * math.pi)) - angle, 0.0)
    return Interval(centre - amplitude * math.cos(farthest), centre + amplitude * math.cos(nearest))
