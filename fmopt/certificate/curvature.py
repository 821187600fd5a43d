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

Several pieces of motion go through at once with a leading axis n: twists and half-widths (n, 1, 6), rows (n, k).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from fmopt.certificate.rows import Forms, Rows
from fmopt.certificate.tube import POWER, bend, left, left_over, varied
from fmopt.se3 import cross, length, lengths
from fmopt.values import Array

_NEXT, _AFTER = np.array([1, 2, 0]), np.array([2, 0, 1])


def _size(vectors: Array) -> Any:
    """The length of one vector as a float; of several (…, 3) lengths (…)."""
    return length(vectors) if vectors.ndim == 1 else lengths(vectors)


@dataclass(frozen=True, eq=False)
class Extent:
    """How far a piece of motion and its errors reach.

    Args:
        twist: V = (Δ, τ) (6,) of the nominal motion, m and rad.
        half: half-widths (6,) of a box around the errors all along, m and rad.
    """

    twist: Array
    half: Array

    @staticmethod
    def beside(extents: Sequence[Extent]) -> Extent:
        """Several (n) as one, with twists and half-widths (n, 1, 6)."""
        return Extent(np.array([[e.twist] for e in extents]), np.array([[e.half] for e in extents]))

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
        return self.half[..., 3:]

    @property
    def offset(self) -> Array:
        """Half-widths (3,) of the box around the translation error, m."""
        return self.half[:3]

    def standing(self) -> Extent:
        """The same errors without the motion."""
        return Extent(np.zeros(6), self.half)


@dataclass(frozen=True, eq=False)
class Turned:
    """Vectors that a box of errors turns: what the bounds of |ε × v| take from them, whatever the box.

    Args:
        ahead: sizes (…, 3) of their components, the next one first.
        behind: the same, the one after first.
        size: lengths (…).
    """

    ahead: Array
    behind: Array
    size: Array

    @staticmethod
    def of(vectors: Array) -> Turned:
        """Vectors (…, 3)."""
        size = np.abs(vectors)
        return Turned(size.take(_NEXT, -1), size.take(_AFTER, -1), lengths(vectors))

    def by(self, angles: Array) -> Array:
        """Bounds (…) of |ε × v| for all ε in a box, by its half-widths (3,), rad."""
        sides = self.ahead * angles.take(_AFTER, -1) + self.behind * angles.take(_NEXT, -1)
        return np.asarray(np.minimum(lengths(sides), _size(angles) * self.size))


@dataclass(frozen=True, eq=False)
class Swung:
    """Points that turn with the part along a piece of motion, apart from the errors.

    Args:
        ends: their arms at both ends (2, v, 3).
        size: lengths of the arms at the start (v,), m.
        swept: |τ × w| (v,), m.
    """

    ends: Turned
    size: Array
    swept: Array

    @staticmethod
    def of(turn: Array, arms: Array) -> Swung:
        """Points by their arms (2, v, 3) at both ends, under a turn τ (3,)."""
        ends = Turned.of(arms)
        return Swung(ends, ends.size[0], lengths(cross(turn, arms[0])))

    def by(self, angles: Array) -> Array:
        """Bounds (v,) of |ε × w| all along, for all ε in a box, by its half-widths (3,), rad."""
        theta = _size(angles)
        most = self.ends.by(angles).max(axis=0) + 0.5 * theta * self.swept
        return np.asarray(np.minimum(most, theta * self.size))

    def left(self, angles: Array) -> Array:
        """What errors that turn a plane leave at each point (v,), per their size, m."""
        return 0.5 * (self.by(angles) + self.swept)

    @property
    def arc(self) -> Array:
        """What the nominal turn does at each point (v,), m."""
        return 0.125 * self.swept


@dataclass(frozen=True, eq=False)
class Lever:
    """What turns of points leave of their distances to planes.

    Args:
        extent: of the motion.
        half: what errors that turn a plane leave at each point (v,), per their size, m.
        arc: what the nominal turn does, m.
    """

    extent: Extent
    half: Array
    arc: Array

    @staticmethod
    def of(extent: Extent, arms: Array) -> Lever:
        """Points by their arms (2, v, 3) at both ends."""
        points = Swung.of(extent.twist[..., 3:], arms)
        return Lever(extent, points.left(extent.angles), points.arc)

    def beside(self, normals: Array) -> Array:
        """Remainders (n, v) of the points over planes of unit normals (n, 3), m."""
        tilted = Turned.of(normals).by(self.extent.angles)
        leaned = lengths(cross(self.extent.twist[..., 3:], normals))
        return np.asarray(tilted[..., None] * self.half[..., None, :] + leaned[..., None] * self.arc[..., None, :])


@dataclass(frozen=True, eq=False)
class Curvature:
    """How rows (k) bend over a piece of motion: what of their remainders does not depend on the errors.

    Args:
        twist: V (6,) of the piece.
        forms: the rows.
        turned: R k (k, 3) at the start.
        lines: as `tube.bend` has them.
    """

    twist: Array
    forms: Forms
    turned: Array
    lines: Array

    @staticmethod
    def of(start: Rows, goal: Rows, twist: Array) -> Curvature:
        """The curvature of rows over a piece with a twist (6,)."""
        forms, ends = start.forms, (np.stack([start.turned, goal.turned]), np.stack([start.bent, goal.bent], axis=1))
        return Curvature(twist, forms, start.turned, bend(forms.table, forms.places, *ends, twist))

    def bound(self, half: Array) -> Array:
        """Bound (k,) of |f − (linear in the error, interpolated between the ends)|, m.

        Args:
            half: half-widths (6,) of a box around the errors.
        """
        return left(self.lines, length(self.twist[3:]), half)

    def power(self) -> Array:
        """How N·V, V the twist, changes with the error at the start, to first order: rows (k, 6)."""
        push, turn = self.forms.push, self.twist[3:]
        found = np.hstack([np.zeros(push.shape), cross(self.turned, cross(push, turn))])
        found[self.forms.places] = self.lines[self.forms.places, POWER]
        return found

    def variation(self, half: Array, motion: Array) -> Array:
        """Bound (k,) of how much N·v may differ between poses of the piece, errors included.

        Args:
            half: half-widths (6,) of a box around the errors.
            motion: v (6,).
        """
        return varied(self.lines, self.twist, half, motion)


def remainders(start: Rows, goal: Rows, extent: Extent) -> Array:
    """The remainders (k,) of rows over a piece of motion, or (n, k) over several, see the module."""
    twists, halves, forms = extent.twist.reshape(-1, 6), extent.half.reshape(-1, 6), start.forms
    turned = np.stack([start.turned, goal.turned]).reshape(2, len(twists), len(forms), 3)
    bent = np.stack([start.bent, goal.bent], axis=1).reshape(2, 2, len(twists), len(forms.places), 3)
    return left_over(forms.table, forms.places, turned, bent, twists, halves).reshape(start.f.shape)
