"""Rows: signed distances as functions of the pose error, with gradient and second-order remainder.

Around a nominal pose (p, R) a real pose is p + e, exp([ε]×)R. Every distance that a certificate needs has the form

    f = n·p + u·(R k) + (R b)·(σ p + a × p + s) − c,

so that one gradient and one remainder formula serve them all: N = ∂f/∂(e, ε) at zero error, `reach` = |u||k|
and `swing` = |σ p + a × p + s| (with |b| = 1; σ = −1, a = 0 or σ = 0, |a| = 1).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from fmopt.se3 import Pose
from fmopt.values import Array

Mask = NDArray[np.bool_]

_NORMAL, _PUSH, _LEVER, _BODY, _ACROSS, _SHIFT = (slice(3 * k, 3 * k + 3) for k in range(6))
_OFFSET, _SIGN, _REACH, _WIDTH = 18, 19, 20, 21
_EYE = np.eye(3)


def crossed(a: Array, b: Array) -> Array:
    """a × b along the last axis, for arrays that broadcast."""
    found = np.empty(np.broadcast(a, b).shape)
    ax, ay, az = a[..., 0], a[..., 1], a[..., 2]
    bx, by, bz = b[..., 0], b[..., 1], b[..., 2]
    found[..., 0] = ay * bz - az * by
    found[..., 1] = az * bx - ax * bz
    found[..., 2] = ax * by - ay * bx
    return found


def lengths(vectors: Array) -> Array:
    """Euclidean lengths along the last axis."""
    return np.asarray(np.sqrt(np.einsum("...i,...i->...", vectors, vectors)))


def length(vector: Array) -> float:
    """Euclidean length of one vector."""
    return math.sqrt(float(vector @ vector))


@dataclass(frozen=True, eq=False)
class Rows:
    """Distances at one pose: values f (k,), gradients N (k, 6), reach (k,) and swing (k,), in m and m/rad.

    `across` (k, 3) is the unit direction along which a bilinear row does not feel a translation, zero for none;
    `bilinear` (k,) says which rows are, and is None when none is.
    """

    f: Array
    N: Array
    reach: Array
    swing: Array
    across: Array
    bilinear: Mask | None

    def kept(self, which: Mask) -> Rows:
        """The rows of a mask (k,)."""
        bilinear = None if self.bilinear is None else self.bilinear[which]
        return Rows(self.f[which], self.N[which], self.reach[which], self.swing[which], self.across[which], bilinear)


@dataclass(frozen=True, eq=False)
class Forms:
    """Distances as functions of the pose, row by row.

    Args:
        table: (k, 21), in each row the module's n, u, k, b, a, s, then c, σ and the reach |u||k|.
    """

    table: Array

    def __len__(self) -> int:
        return len(self.table)

    @cached_property
    def bilinear(self) -> Mask | None:
        """Which rows (k,) are bilinear, None when none is."""
        found = np.asarray((self.table[:, _BODY] != 0.0).any(axis=1))
        return found if found.any() else None

    def over(self, start: Pose, goal: Pose) -> tuple[Rows, Rows]:
        """The rows at both ends of a piece of motion."""
        T = self.table
        push, Rt, p = T[:, _PUSH], np.array([start.R.T, goal.R.T]), np.array([start.p, goal.p])
        arm = T[:, _LEVER] @ Rt
        f = p @ T[:, _NORMAL].T + np.einsum("eki,ki->ek", arm, push) - T[:, _OFFSET]
        N = np.empty((2, len(T), 6))
        N[..., :3] = T[:, _NORMAL]
        N[..., 3:] = crossed(arm, push)
        swing = np.zeros((2, len(T)))
        if self.bilinear is not None:
            Rb = T[:, _BODY] @ Rt
            across, sign = T[:, _ACROSS], T[:, _SIGN, None]
            y = sign * p[:, None] + crossed(across, p[:, None]) + T[:, _SHIFT]
            f += np.einsum("eki,eki->ek", Rb, y)
            N[..., :3] += sign * Rb + crossed(Rb, across)
            N[..., 3:] += crossed(Rb, y)
            swing = np.where(self.bilinear, lengths(y), 0.0)
        reach, across = T[:, _REACH], T[:, _ACROSS]
        first, second = (Rows(f[k], N[k], reach, swing[k], across, self.bilinear) for k in (0, 1))
        return first, second

    def at(self, pose: Pose) -> Rows:
        """The rows at a pose."""
        return self.over(pose, pose)[0]


def stacked(*parts: Forms) -> Forms:
    """All rows one after the other."""
    return Forms(np.concatenate([part.table for part in parts]))


def _filled(count: int, **columns: Array | float) -> Forms:
    places = {"normal": _NORMAL, "push": _PUSH, "lever": _LEVER, "body": _BODY, "across": _ACROSS, "shift": _SHIFT}
    singles = {"offset": _OFFSET, "sign": _SIGN}
    table = np.zeros((count, _WIDTH))
    for name, values in columns.items():
        table[:, places[name] if name in places else singles[name]] = values
    table[:, _REACH] = lengths(table[:, _PUSH]) * lengths(table[:, _LEVER])
    return Forms(table)


def points_above(points: Array, normals: Array, offsets: Array | float) -> Forms:
    """n·(p + R v) − a for body points v (k, 3) and planes with unit normals n (k, 3) or (3,), a (k,) or one."""
    return _filled(len(points), normal=normals, push=normals, lever=points, offset=offsets)


def directions_along(u: Array, k: Array) -> Forms:
    """u·(R k) for world vectors u and body vectors k, (r, 3) or one for all: rows that only the rotation moves."""
    return _filled(max(len(np.atleast_2d(u)), len(np.atleast_2d(k))), push=u, lever=k)


def faces_above(normals: Array, offsets: Array | float, points: Array) -> Forms:
    """(R n)·(w − p) − a for body planes n (k, 3) or (3,), a (k,) or one, and world points w (k, 3)."""
    return _filled(len(points), body=normals, offset=offsets, shift=points, sign=-1.0)


def edges_apart(e_m: Array, e_f: Array, q: Array, points: Array) -> Forms:
    """m·(p + R v − q) with m = R e_m × e_f, not normalised, for body points v (k, 3).

    The plane runs through the fixed edge (point q, unit e_f) and along the moving edge (unit body vector e_m).
    Written as (R e_m)·(e_f × (p − q)) + e_f·R(v × e_m): bilinear in the pose, linear in the rotation.
    """
    k = crossed(points, e_m)
    return _filled(len(points), push=e_f, lever=k, body=e_m, across=e_f, shift=-crossed(e_f, q))


@dataclass(frozen=True, eq=False)
class Extent:
    """How far a piece of motion and its errors reach.

    Args:
        turn: angle τ of the nominal turn, rad.
        travel: nominal translation (3,), m.
        theta: bound θ of |ε|, rad.
        offset: half-widths (3,) of a box around the translation error, m.
    """

    turn: float
    travel: Array
    theta: float
    offset: Array

    @property
    def kappa(self) -> float:
        """κ = ½θ² + τ²/8 + ½τθ, what a row of unit reach leaves."""
        return 0.5 * self.theta**2 + self.turn**2 / 8.0 + 0.5 * self.turn * self.theta

    def standing(self) -> Extent:
        """The same errors without the motion."""
        return Extent(0.0, np.zeros(3), self.theta, self.offset)


@dataclass(frozen=True, eq=False)
class Curvature:
    """What the remainders of rows depend on besides the errors: the larger reach and swing of both ends, the travel.

    `felt` (k, 3, 3) maps the half-widths of the translation error's box to a vector as long as its part that a
    bilinear row feels, `seen` (k,) is the part of the nominal translation, m; None when no row is bilinear.
    """

    turn: float
    distance: float
    size: Array
    bilinear: Mask | None
    felt: Array
    seen: Array

    @staticmethod
    def of(start: Rows, goal: Rows, turn: float, travel: Array) -> Curvature:
        """The curvature of rows over a piece that turns by `turn` and travels `travel` (3,)."""
        distance = length(travel)
        if start.bilinear is None:
            return Curvature(turn, distance, start.reach, None, _EYE, travel)
        size = start.reach + np.maximum(start.swing, goal.swing)
        free = start.bilinear & ~start.across.any(axis=1)
        x, y, z = np.abs(start.across).T
        felt = np.zeros((len(size), 3, 3))
        felt[:, 0, 1] = felt[:, 1, 0] = z
        felt[:, 0, 2] = felt[:, 2, 0] = y
        felt[:, 1, 2] = felt[:, 2, 1] = x
        felt[free] = _EYE
        seen = lengths(crossed(start.across, travel))
        seen[free] = distance
        return Curvature(turn, distance, size, start.bilinear, felt, seen)

    def bound(self, theta: float, offset: Array) -> Array:
        """Bound (k,) of |f − (linear in the error, interpolated between the ends)|, m.

        With κ = ½θ² + τ²/8 + ½τθ a row leaves (reach + swing)·κ, a bilinear one θD + τΔ/4 + ½τD + ½Δθ more: second
        order in the error, chord against arc of the nominal path, and the gradient's own turn along it.

        Args:
            theta: bound of |ε|, rad.
            offset: half-widths (3,) of the box around the translation error, m.
        """
        tau = self.turn
        left = (0.5 * theta**2 + tau**2 / 8.0 + 0.5 * tau * theta) * self.size
        if self.bilinear is not None:
            left = left + (theta + 0.5 * tau) * lengths(self.felt @ offset) + (0.25 * tau + 0.5 * theta) * self.seen
        return np.asarray(left)

    def variation(self, theta: float, offset: Array, motion: Array) -> Array:
        """Bound (k,) of how much N·v may differ between poses of the piece, errors included.

        Args:
            theta: bound of |ε|, rad.
            offset: half-widths (3,) of the box around the translation error, m.
            motion: v (6,).
        """
        slide, spin = length(motion[:3]), length(motion[3:])
        wander = theta + self.turn
        left = wander * spin * self.size
        if self.bilinear is not None:
            left = left + np.where(self.bilinear, wander * slide + (length(offset) + self.distance) * spin, 0.0)
        return np.asarray(left)


def remainders(start: Rows, goal: Rows, extent: Extent) -> Array:
    """The remainders (k,) of rows over a piece of motion, see `Curvature`."""
    return Curvature.of(start, goal, extent.turn, extent.travel).bound(extent.theta, extent.offset)
