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
from functools import cached_property
from typing import Any

import numpy as np

from fmopt.certificate.rows import Forms, Rows
from fmopt.se3 import cross, length, lengths
from fmopt.values import Array

_EYE = np.eye(3)
_NEXT, _AFTER = np.array([1, 2, 0]), np.array([2, 0, 1])


def _size(vectors: Array) -> Any:
    """The length of one vector as a float; of several (…, 3) lengths (…)."""
    return length(vectors) if vectors.ndim == 1 else lengths(vectors)


def _applied(matrices: Array, vectors: Array) -> Array:
    """Matrices (…, i, j) times vectors (…, j) or one for all."""
    return np.asarray((matrices @ vectors[..., None])[..., 0])


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
        turned: R k (2, k, 3) at both ends.
        bends: of the bilinear rows, None without any.
    """

    twist: Array
    forms: Forms
    turned: Array
    bends: Bends | None

    @staticmethod
    def of(start: Rows, goal: Rows, twist: Array) -> Curvature:
        """The curvature of rows over a piece with a twist (6,)."""
        bends = Bends.of(start, goal, twist) if start.bent.size else None
        return Curvature(twist, start.forms, np.array([start.turned, goal.turned]), bends)

    @cached_property
    def _parts(self) -> tuple[Turned, Swung, Array]:
        """Planes and points of the rows (m) without b, and what the nominal turn leaves of both (m,), m."""
        push, turned, turn = self.forms.push, self.turned, self.twist[..., 3:]
        if self.bends is not None:
            push, turned = push[~self.forms.bilinear], turned[..., ~self.forms.bilinear, :]
        points = Swung.of(turn, turned)
        return Turned.of(push), points, lengths(cross(turn, push)) * points.arc

    def bound(self, half: Array) -> Array:
        """Bound (k,) of |f − (linear in the error, interpolated between the ends)|, m.

        Args:
            half: half-widths (6,) of a box around the errors.
        """
        if self.bends is None:
            return self._turning(half)
        left, which = np.empty(self.turned.shape[1:-1]), self.forms.bilinear
        left[..., which] = self.bends.bound(half)
        if not which.all():
            left[..., ~which] = self._turning(half)
        return left

    def _turning(self, half: Array) -> Array:
        """The bounds (m,) of the rows without b."""
        planes, points, arc = self._parts
        return np.asarray(planes.by(half[..., 3:]) * points.left(half[..., 3:]) + arc)

    def power(self) -> Array:
        """How N·V, V the twist, changes with the error at the start, to first order: rows (k, 6)."""
        push, turn = self.forms.push, self.twist[3:]
        found = np.hstack([np.zeros(push.shape), cross(self.turned[0], cross(push, turn))])
        if self.bends is not None:
            found[self.forms.bilinear] = self.bends.power
        return found

    def variation(self, half: Array, motion: Array) -> Array:
        """Bound (k,) of how much N·v may differ between poses of the piece, errors included.

        Args:
            half: half-widths (6,) of a box around the errors.
            motion: v (6,).
        """
        slide, spin, wander = length(motion[:3]), length(motion[3:]), length(half[3:]) + length(self.twist[3:])
        left = wander * spin * self.forms.reach
        if self.bends is not None:
            moved = length(half[:3]) + length(self.twist[:3])
            left[self.forms.bilinear] = wander * (spin * self.bends.size + slide) + moved * spin
        return np.asarray(left)


@dataclass(frozen=True, eq=False)
class Bends:
    """How bilinear rows (m) bend over a piece of motion.

    Args:
        turn: |τ|, rad.
        size: |u||k| + |y|, the larger of both ends (m,), m.
        felt: sizes of A (m, 3, 3).
        seen: |AΔ| (m,), m.
        second: sizes (2, m, 3, 3) of G at both ends.
        mixed: sizes (2, m, 3, 3) of [β]× A at both ends.
        turning: sizes of J (m, 6), both ends together.
        chord: how far the nominal path is off its chord (m,), m.
        power: how N·V, V the twist, changes with the error at the start (m, 6).
    """

    turn: float
    size: Array
    felt: Array
    seen: Array
    second: Array
    mixed: Array
    turning: Array
    chord: Array
    power: Array

    @staticmethod
    def of(start: Rows, goal: Rows, twist: Array) -> Bends:
        """The bends of those rows that are bilinear, for a twist (6,)."""
        forms, which = start.forms, start.forms.bilinear
        u, A, turn = forms.push[which], forms.moves, twist[..., 3:]
        w = np.array([start.turned[..., which, :], goal.turned[..., which, :]])
        beta, y = np.stack([start.bent, goal.bent], axis=1)
        size, tau = forms.reach[which] + lengths(y).max(axis=0), _size(turn)
        slid = _applied(A, twist[..., :3])
        seen = lengths(slid)
        outer = w[..., :, None] * u[:, None, :] + beta[..., :, None] * y[..., None, :]
        G = np.trace(outer, axis1=-2, axis2=-1)[..., None, None] * _EYE - outer
        pulled, carried = (cross(turn, beta)[..., None, :] @ A)[..., 0, :], cross(beta, slid)
        J, K = (np.concatenate([pulled, carried - _applied(H, turn)], axis=-1) for H in (G, np.swapaxes(G, -1, -2)))
        chord = 0.125 * np.abs(np.vecdot(J, twist)).max(axis=0) + tau**2 * (tau * size + 3.0 * seen) / 16.0
        mixed = cross(beta[..., None, :], np.swapaxes(A, -1, -2))
        second, mixed = 0.5 * np.abs(G + np.swapaxes(G, -1, -2)), np.abs(np.swapaxes(mixed, -1, -2))
        turning, power = np.abs(J).sum(axis=0), K[0]
        return Bends(tau, size, np.abs(A), seen, second, mixed, turning, chord, power)

    def bound(self, half: Array) -> Array:
        """The remainders (m,), see `Curvature.bound`."""
        offset, angles = half[..., :3], half[..., 3:]
        theta, tau, size, seen = _size(angles), self.turn, self.size, self.seen
        felt = lengths(_applied(self.felt, offset))
        drawn = 0.5 * _applied(self.second, angles) + _applied(self.mixed, offset)
        second = np.vecdot(drawn, angles).max(axis=0)
        third = theta**2 * ((theta / 6.0 + 0.25 * tau) * size + 0.5 * felt + 0.25 * seen) + 0.5 * theta * tau * felt
        third += 0.125 * tau * (theta * tau * size + tau * felt + 2.0 * theta * seen)
        fine = second + self.chord + 0.25 * np.vecdot(self.turning, half) + third
        coarse = (0.5 * theta**2 + tau**2 / 8.0 + 0.5 * tau * theta) * size
        coarse += (theta + 0.5 * tau) * felt + (0.25 * tau + 0.5 * theta) * seen
        return np.asarray(np.minimum(fine, coarse))


def remainders(start: Rows, goal: Rows, extent: Extent) -> Array:
    """The remainders (k,) of rows over a piece of motion, see `Curvature`."""
    return Curvature.of(start, goal, extent.twist).bound(extent.half)
