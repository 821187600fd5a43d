"""Rows: signed distances as functions of the pose error, with gradient and second-order remainder.

Around a nominal pose (p, R) a real pose is p + e, exp([ε]×)R. Every distance that a certificate needs has the form

    f = n·p + u·(R k) + (R b)·(σ p + a × p + s) − c,

so that one gradient and one remainder formula serve them all: N = ∂f/∂(e, ε) at zero error, `reach` = |u||k|
and `swing` = |σ p + a × p + s| (with |b| = 1; σ = −1, a = 0 or σ = 0, |a| = 1).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from fmopt.se3 import Pose
from fmopt.values import Array

Mask = NDArray[np.bool_]

_NORMAL, _PUSH, _LEVER, _BODY, _ACROSS, _SHIFT = (slice(3 * k, 3 * k + 3) for k in range(6))
_OFFSET, _SIGN, _REACH, _WIDTH = 18, 19, 20, 21
_EYE = np.eye(3)
_NEXT, _AFTER = np.array([1, 2, 0]), np.array([2, 0, 1])
_TURN = np.cross(_EYE[:, None], _EYE[None])  # (a × b)_c = Σ _TURN[i, j, c] a_i b_j


def crossed(a: Array, b: Array) -> Array:
    """a × b along the last axis, for arrays that broadcast."""
    found = a.take(_NEXT, -1) * b.take(_AFTER, -1)
    found -= a.take(_AFTER, -1) * b.take(_NEXT, -1)
    return np.asarray(found)


def lengths(vectors: Array) -> Array:
    """Euclidean lengths along the last axis."""
    return np.asarray(np.sqrt(np.vecdot(vectors, vectors)))


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

    @property
    def _wide(self) -> int:
        return 7 if self.bilinear is None else 13

    @cached_property
    def _linear(self) -> Array:
        """What takes (R row by row, p, 1) (13,) to f and N of each row, and to its R b and y when one is bilinear.

        All of these are linear in the pose but for (R b)·y in f and (R b) × y in the turns' part of N, with
        y = σ p + a × p + s. Shape (13, 7 k) or (13, 13 k).
        """
        T, k = self.table, len(self.table)
        found = np.zeros((13, k, self._wide))
        turning = found[:9].reshape(3, 3, k, self._wide)
        turning[..., 0] = np.einsum("ki,kj->ijk", T[:, _PUSH], T[:, _LEVER])
        turning[..., 4:7] = np.einsum("aic,ki,kj->ajkc", _TURN, T[:, _PUSH], T[:, _LEVER])
        found[9:12, :, 0], found[12, :, 0] = T[:, _NORMAL].T, -T[:, _OFFSET]
        found[12, :, 1:4] = T[:, _NORMAL]
        if self.bilinear is not None:
            along, turned = T[:, _SIGN, None, None] * _EYE, np.einsum("aic,ki->kac", _TURN, T[:, _ACROSS])
            turning[..., 1:4] = np.einsum("kac,kj->ajkc", along + turned, T[:, _BODY])
            turning[..., 7:10] = np.einsum("ac,kj->ajkc", _EYE, T[:, _BODY])
            found[9:12, :, 10:] = np.moveaxis(along - turned, 1, 0)
            found[12, :, 10:] = T[:, _SHIFT]
        return found.reshape(13, k * self._wide)

    def along(self, p: Array, R: Array) -> tuple[Array, Array]:
        """Distances (e, k) and gradients (e, k, 6) at poses with positions p (e, 3) and rotations R (e, 3, 3)."""
        f, N, _ = self._at(p, R)
        return f, N

    def _at(self, p: Array, R: Array) -> tuple[Array, Array, Array | None]:
        """Values, gradients, and y (e, k, 3) of bilinear rows."""
        at = np.empty((len(p), 13))
        at[:, :9], at[:, 9:12], at[:, 12] = R.reshape(-1, 9), p, 1.0
        found = (at @ self._linear).reshape(len(p), len(self.table), self._wide)
        f, N = found[..., 0], found[..., 1:7]
        if self.bilinear is None:
            return f, N, None
        Rb, y = found[..., 7:10], found[..., 10:]
        f = f + np.vecdot(Rb, y)
        N[..., 3:] += crossed(Rb, y)
        return f, N, y

    def over(self, start: Pose, goal: Pose) -> tuple[Rows, Rows]:
        """The rows at both ends of a piece of motion."""
        first, second = self._rows(np.array([start.p, goal.p]), np.array([start.R, goal.R]))
        return first, second

    def at(self, pose: Pose) -> Rows:
        """The rows at a pose."""
        return self._rows(pose.p[None], pose.R[None])[0]

    def _rows(self, p: Array, R: Array) -> list[Rows]:
        f, N, y = self._at(p, R)
        bilinear, reach, across = self.bilinear, self.table[:, _REACH], self.table[:, _ACROSS]
        swing = np.zeros(f.shape) if y is None or bilinear is None else np.where(bilinear, lengths(y), 0.0)
        return [Rows(f[k], N[k], reach, swing[k], across, bilinear) for k in range(len(p))]


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

    def beside(self, other: Curvature) -> Curvature:
        """The curvature of these rows and of others over the same piece."""
        size = np.concatenate([self.size, other.size])
        if self.bilinear is None and other.bilinear is None:
            return replace(self, size=size)
        parts = [part._full() for part in (self, other)]
        bilinear, felt, seen = (np.concatenate(column) for column in zip(*parts, strict=True))
        return Curvature(self.turn, self.distance, size, bilinear, felt, seen)

    def _full(self) -> tuple[Mask, Array, Array]:
        """Which rows are bilinear, and what they feel, also where none is."""
        if self.bilinear is not None:
            return self.bilinear, self.felt, self.seen
        k = len(self.size)
        return np.zeros(k, dtype=np.bool_), np.zeros((k, 3, 3)), np.zeros(k)

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
