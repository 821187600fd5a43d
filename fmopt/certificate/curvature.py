"""What a row's linear picture leaves over a piece of motion: second order in the errors, arcs, and turning gradients.

A piece turns by τ and travels Δ, at a constant twist. Its errors (d, ε) stay in a box, |ε| ≤ θ, and are interpolated
between the ends, as are value and gradient of the row. With w = R k, β = R b and y = A p + s, A = σ + [a]×, of a row
n·p + u·w + β·y − c:

A row without b. Turned by ε, u·w changes by u·(ε × w) and, the rest of the exponential as an integral,
−∫(1 − t)(ε × exp(−tε)u)·(ε × w) dt, at most ½|ε × u||ε × w|. On the nominal path it bends off its chord by at most
⅛|τ × u||τ × w|. Its gradient turns along the path, weighted 2s(1 − s) ≤ ½ between the ends: ½|ε × u||τ × w|.

A bilinear row has the Hessian −G in ε, G = (u·w + β·y) − (w uᵀ + β yᵀ) made symmetric, and [β]× A in ε and d.
At a contact u·w + β·y is nearly zero, and the two parts cancel. J = (Aᵀ(τ × β), β × AΔ − G τ) is the derivative of its
gradient along the path, J·(Δ, τ) that of its slope. All are taken at both ends; what they change in between and terms
of third order have closed bounds. A bound by lengths alone serves where it is better.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from fmopt.certificate.kernels_rows import Bending, Turned
from fmopt.certificate.rows import Rows
from fmopt.certificate.tube import left, powers, varied
from fmopt.se3 import length
from fmopt.uncertainty.error_set import UNCOUPLED
from fmopt.values import Array


@dataclass(frozen=True, eq=False)
class Extent:
    """How far a piece of motion and its errors reach.

    Args:
        twist: V = (Δ, τ) (6,) of the nominal motion, m and rad.
        half: half-widths (6,) of a box around the errors all along, m and rad.
        coupling: what the linear picture leaves of errors in different frames (2,), at most, m and rad.
    """

    twist: Array
    half: Array
    coupling: Array = field(default_factory=lambda: UNCOUPLED)

    @property
    def turn(self) -> float:
        """|τ|, rad."""
        return length(self.twist[3:])

    @property
    def theta(self) -> float:
        """Bound θ of |ε|, rad."""
        return length(self.half[3:])

    @property
    def angles(self) -> Array:
        """Half-widths (3,) of the box around ε, rad."""
        return self.half[3:]

    @property
    def offset(self) -> Array:
        """Half-widths (3,) of the box around the translation error, m."""
        return self.half[:3]


@dataclass(frozen=True, eq=False)
class Curvature:
    """How rows (k) bend over a piece of motion: what of their remainders does not depend on the errors."""

    bending: Bending

    @staticmethod
    def of(start: Rows, goal: Rows, twist: Array) -> Curvature:
        """The curvature of rows over a piece with a twist (6,)."""
        w, b, y = (np.array(ends) for ends in zip(start.turned, goal.turned, strict=True))
        return Curvature(Bending(start.forms.table, Turned(w, b, y), np.array(twist)))

    @staticmethod
    def joined(one: Curvature, other: Curvature) -> Curvature:
        """The curvature of the rows of both, over the same piece."""
        (table, turned, twist), (more, ends, _) = one.bending, other.bending
        w, b, y = (np.concatenate(both, axis=1) for both in zip(turned, ends, strict=True))
        return Curvature(Bending(np.concatenate([table, more]), Turned(w, b, y), twist))

    def bound(self, half: Array) -> Array:
        """Bound (k,) of |f − (linear in the error, interpolated between the ends)|, m, errors in one frame.

        Args:
            half: half-widths (6,) of a box around the errors.
        """
        return left(self.bending, half, UNCOUPLED)

    def power(self) -> Array:
        """How N·V, V the twist, changes with the error at the start, to first order: rows (k, 6)."""
        return powers(self.bending)

    def variation(self, half: Array, motion: Array) -> Array:
        """Bound (k,) of how much N·v may differ between poses of the piece, errors included.

        Args:
            half: half-widths (6,) of a box around the errors.
            motion: v (6,).
        """
        return varied(self.bending, half, motion)
