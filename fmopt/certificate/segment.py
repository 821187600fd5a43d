"""One piece of motion with its errors: how the error set moves on, and what is certified along the way.

The moving part goes from pose S to pose G. A real execution starts at an error e₀ of the start set, moves along the
commanded direction with a velocity error inside its cone, keeps the held contacts (the compliant directions give way)
and, when a contact m is being made, goes on until it touches. Measured on its own way, at every fraction s,

    e(s) = (1 − s)(ẽ₀ + Σ T^S_i tᵢ) + s (ẽ₁ + Σ T^G_i tᵢ),   |tᵢ| ≤ thicknessᵢ,

with ẽ₀ in the start set without its old thickness, ẽ₁ = Π(ẽ₀ + drift), and T^S, T^G dual to the contacts' rows at
either end. A row that is affine in the error needs its bound at both ends only. [DakinPopplestone1993] section 4, with
exact images in place of the paper's sections.

The pieces of a move share one twist per unit of progress, but for what the compliance takes up: an execution that
touches late has then gone farther in each of them alike, whichever piece it was commanded in.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fmopt import ellipsoid
from fmopt.certificate.assembly import Assembly
from fmopt.certificate.curvature import Extent
from fmopt.certificate.layers import Layers, layers_of
from fmopt.certificate.piece import Compliance, Piece, Tolerance
from fmopt.certificate.separation import Ends
from fmopt.certificate.way import Way, approach, cone, departure, way_of
from fmopt.errors import InfeasibleError
from fmopt.se3 import length, lengths
from fmopt.uncertainty.error_set import ErrorSet, Support
from fmopt.values import Array

__all__ = ["Advance", "Compliance", "Piece", "Tolerance", "advance"]

_ROUNDS = 80
_FAR = 0.5  # m or rad; errors as wide as this certify nothing
_ALLOWANCE = 4e-15  # m or rad; what the independent check adds to the bounds of errors before it uses them
_SETTLED = 2e-13  # relative rounding of the computed bounds of errors
_TIGHT = 5e-11  # relative: bounds as near to the computed ones as the check asks
_ABOVE = 1e-11  # stated bounds of errors exceed the computed ones by about this share


@dataclass(frozen=True, eq=False)
class Advance:
    """The outcome of a step.

    Args:
        ends: both ends with their sets.
        basis: the held basis, with the contact being made and its direction added.
        motion: displacement (6,) of the piece inside the held contacts.
        length: length of the piece in the metric of ρ, m.
        approach: how much the contact being made comes nearer at least, whatever the error, m; infinite without one.
        departure: how much farther away the contacts given up get at least, m; infinite without any.
        overtravel: how much longer or shorter the piece is at most until its move's contact is made, as a share of it.
    """

    ends: Ends
    basis: tuple[Compliance, ...]
    motion: Array
    length: float
    approach: float = np.inf
    departure: float = np.inf
    overtravel: float = 0.0


def advance(assembly: Assembly, piece: Piece, errors: ErrorSet, tolerance: Tolerance) -> Advance:
    """Carries an error set through a piece of motion.

    Args:
        assembly: the two parts.
        piece: the piece of motion.
        errors: error set at its start.
        tolerance: velocity error and metric.

    Raises:
        InfeasibleError: the contact to be made cannot be reached along the motion, one cannot be given up alone,
            contacts do not determine their compliant directions, or errors outgrow the bounds in which the certificate
            holds.
    """
    way = way_of(assembly, piece, tolerance)
    core = errors.core(way.directions)
    layers = layers_of(piece, way, Support.of(core, errors))
    basis = piece.basis
    if piece.made is not None:
        size = length(way.motion * ellipsoid.metric(tolerance.rho))
        basis = (*basis, Compliance(piece.made, way.motion / size))
    step = _Step(piece, way, layers, tolerance, errors, core)
    extent, goal_set, slack, overtravel = step.outcome(basis)
    ends = Ends(piece.start, piece.goal, errors, goal_set, extent, slack, core)
    nearer, farther = approach(tolerance, way, extent), departure(assembly, piece, tolerance, way, extent)
    return Advance(ends, basis, way.motion, way.length, nearer, farther, overtravel)


@dataclass(frozen=True, eq=False)
class _Step:
    """Carries the errors on.

    Everything is evaluated with one bound θ of the angle and one box around the translation of all errors of the
    piece; these are the fixed point of `_widths`.
    """

    piece: Piece
    way: Way
    layers: Layers
    tolerance: Tolerance
    start: ErrorSet
    core: Array

    @cached_property
    def _carried(self) -> tuple[Array, Array, Array]:
        """Core and roots of growth and shape under the projection."""
        P = self.way.projector
        return self.core @ P.T, P @ self.start.growth_root, P @ self.start.shape_root

    @cached_property
    def _rates(self) -> tuple[float, float]:
        """Velocity errors per unit of length, in translation and in angle (1/m)."""
        t, r = self.tolerance.velocity_error
        return t, r / self.tolerance.rho

    @cached_property
    def _late(self) -> tuple[float, float]:
        """How much farther than planned the start errors, and the drift, let the part go, as shares of the piece."""
        way = self.way
        reach = float(np.abs(self.core @ way.seen).sum()) + length(way.seen @ self.start.growth_root)
        return reach / way.rate, cone(self.tolerance, way, way.seen) / way.rate

    def _grown(self, half: Array) -> tuple[Array, Array, tuple[float, float, float], float]:
        """Thickness of contacts at both ends, radii of the drift and overtravel, for half-widths (6,) of all errors."""
        half = half + _ALLOWANCE
        (t, r), theta, far = self._rates, length(half[3:]), self.way.length
        # Bounds of translation and angle with their drift, before contacts take it up.
        wide = length(half[:3]) + 2.0 * t * far, theta + 2.0 * r * far
        own, final = self.layers.thicknesses(half, wide)
        beyond = self._overtravel(wide[1], final)
        return own, final, self._radii(theta, beyond), beyond

    def _overtravel(self, wide: float, thickness: Array) -> float:
        """How much longer or shorter the piece is at most, as a share of it; 0 where its move makes no contact."""
        way = self.way
        if self.piece.made is None:
            return 0.0
        late, eta = self._late
        zeta = 0.75 * wide * way.turn * length(way.seen[3:]) / way.rate
        rest = 1.0 - self.piece.share * (eta + zeta)
        if rest < 0.5:
            raise InfeasibleError("the velocity error could carry the part past the contact that it is to make")
        return (self.piece.share * (late + eta) + float(self.layers.delay @ thickness)) / rest

    def _radii(self, theta: float, beyond: float) -> tuple[float, float, float]:
        """Radii of the drift: of the translation, of the angle, and of the turn's second order (m, rad, rad)."""
        way = self.way
        far = way.length * (1.0 + beyond)
        a, b = self._rates[0] * far, self._rates[1] * far
        swung = beyond * way.turn
        if beyond > 1.0 or theta + b + swung > _FAR:
            raise InfeasibleError("errors are too large for this piece of motion", advice="make it shorter or steadier")
        return a, b, 0.5 * (theta + b) * swung * (1.0 + theta + b + swung)

    def _settled(self) -> Array:
        """Half-widths (6,) of a box around the errors all along, such that those computed with them are no wider.

        What the errors are at the start is a good first guess, and too wide where the motion takes much of their growth
        away: then from below.
        """
        first = np.maximum(self.start.half_widths(self.core), self.start.half_widths(self._carried[0]))
        half, own = self._fixed_point(first)
        tight = bool(np.all(half <= own * (1.0 + _TIGHT)))
        return half if tight else self._fixed_point(np.maximum(*self._boxes))[0]

    def _fixed_point(self, half: Array) -> tuple[Array, Array]:
        """The first half-widths (6,) from these up that are their own, and those computed with them."""
        for _ in range(_ROUNDS):
            wider = self._widths(half)
            short = wider > half * (1.0 - _SETTLED)
            if not short.any():
                return half, wider
            # Close to the fixed point a little is added, that rounding does not matter.
            close = bool(np.all(wider <= half * (1.0 + 10.0 * _ABOVE)))
            half = np.where(short, np.maximum(half, wider) * (1.0 + _ABOVE if close else 1.0), half)
            if half.max() > _FAR:
                break
        raise InfeasibleError("the contact surfaces are too thick for this piece of motion")

    def _widths(self, half: Array) -> Array:
        """Half-widths (6,) of the box around the errors at both ends, computed with stated ones."""
        own, final, radii, _ = self._grown(half)
        core, goal = self._boxes
        start_dual, goal_dual = self._duals
        after = goal + goal_dual @ final + np.sqrt(self._squares(radii))
        return np.maximum(core + start_dual @ own, after)

    @cached_property
    def _duals(self) -> tuple[Array, Array]:
        """Sizes of the dual twists (6, h) and (6, r) at both ends."""
        return np.abs(self.way.start_dual), np.abs(self.layers.goal_dual)

    @cached_property
    def _boxes(self) -> tuple[Array, Array]:
        """Half-widths (6,) of the start set without thickness, and of the carried core alone."""
        return self.start.half_widths(self.core), np.abs(self._carried[0]).sum(axis=0)

    @cached_property
    def _diagonals(self) -> tuple[Array, list[float]]:
        """Diagonals (3, 6) of the carried growth, and of unit drifts in translation and angle, and their traces (3)."""
        P = self.way.projector
        D = np.array([lengths(self._carried[1]), lengths(P[:, :3]), lengths(P[:, 3:])]) ** 2
        return D, (D @ ellipsoid.metric(self.tolerance.rho) ** 2).tolist()

    def _squares(self, radii: tuple[float, float, float]) -> Array:
        """Diagonal (6,) of the growth at the goal, for radii of the drift."""
        (D, (carried, sliding, turning)), (a, b, c) = self._diagonals, radii
        total, trace = (1.0, 0.0, 0.0), carried
        for more in ((0.0, a * a, b * b), (0.0, 0.0, c * c)):
            s1, s2 = math.sqrt(trace), math.sqrt(more[1] * sliding + more[2] * turning)
            if s1 == 0.0 or s2 == 0.0:
                total = more if s1 == 0.0 else total
            else:
                one, two = 1.0 + s2 / s1, 1.0 + s1 / s2
                total = one * total[0], one * total[1] + two * more[1], one * total[2] + two * more[2]
            trace = (s1 + s2) ** 2
        return np.asarray(np.array(total) @ D)

    def outcome(self, basis: tuple[Compliance, ...]) -> tuple[Extent, ErrorSet, Array, float]:
        """Extent, error set at the goal, slack columns (6, h) at the start, and overtravel."""
        half = self._settled()
        own, final, (a, b, c), beyond = self._grown(half)
        core, growth, shape = self._carried
        P, weights = self.way.projector, ellipsoid.metric(self.tolerance.rho)
        for drift in (P * np.array([a, a, a, b, b, b]), P[:, 3:] * c):
            if drift.any():
                growth, shape = (ellipsoid.outer_sum(F, drift, weights) for F in (growth, shape))
        thick = self.layers.goal_dual * final
        if thick.size:
            shape = ellipsoid.outer_sum(shape, np.sqrt(thick.shape[1]) * thick, weights)
        directions = np.array([c.direction for c in basis[: thick.shape[1]]]).reshape(-1, 6)
        goal = ErrorSet(shape, np.vstack([core, thick.T]), growth, thick.shape[1], directions)
        return Extent(self.way.twist, half), goal, self.way.start_dual * own, beyond
