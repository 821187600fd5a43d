"""Rows: signed distances as functions of the pose error, with gradient and second-order remainder.

Around a nominal pose (p, R) a real pose is p + e, exp([ε]×)R. Every distance that a certificate needs has the form

    f = n·p + u·(R k) + (R b)·(σ p + a × p + s) − c,

so that one gradient and one remainder formula serve them all: N = ∂f/∂(e, ε) at zero error. Rows with b are bilinear:
|b| = 1, and σ = −1, a = 0 or σ = 0, |a| = 1.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from fmopt.se3 import Pose, cross, lengths
from fmopt.values import Array

Mask = NDArray[np.bool_]

_NORMAL, _PUSH, _LEVER, _BODY, _ACROSS, _SHIFT = (slice(3 * k, 3 * k + 3) for k in range(6))
_OFFSET, _SIGN, _REACH, _WIDTH = 18, 19, 20, 21
_EYE = np.eye(3)
_TURN = np.cross(_EYE[:, None], _EYE[None])  # (a × b)_c = Σ _TURN[i, j, c] a_i b_j


@dataclass(frozen=True, eq=False)
class Rows:
    """Distances at one pose: values f (k,) and gradients N (k, 6), in m and m/rad, and the vectors that turn.

    At several poses all of them have leading axes; of `bent` these come after the first.

    Args:
        f: values.
        N: gradients.
        forms: the functions (k).
        turned: R k (k, 3) of each row, m.
        bent: R b and σ p + a × p + s (2, m, 3) of the m bilinear rows.
    """

    f: Array
    N: Array
    forms: Forms
    turned: Array
    bent: Array

    def end(self, k: int) -> Rows:
        """Those at poses k, of rows at several with a leading axis."""
        return Rows(self.f[k], self.N[k], self.forms, self.turned[k], self.bent[:, k])

    def kept(self, which: Mask) -> Rows:
        """The rows of a mask (k,)."""
        bent, forms = self.bent[..., which[self.forms.bilinear], :], Forms(self.forms.table[which])
        return Rows(self.f[..., which], self.N[..., which, :], forms, self.turned[..., which, :], bent)

    def beside(self, other: Rows) -> Rows:
        """These rows and others at the same pose."""
        both = (self.f, other.f), (self.N, other.N), (self.turned, other.turned)
        f, N, turned = (np.concatenate(pair) for pair in both)
        return Rows(f, N, stacked(self.forms, other.forms), turned, np.concatenate([self.bent, other.bent], axis=1))


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
    def bilinear(self) -> Mask:
        """Which rows (k,) are bilinear."""
        return np.asarray((self.table[:, _BODY] != 0.0).any(axis=1))

    @cached_property
    def _curved(self) -> bool:
        return bool(self.bilinear.any())

    @property
    def push(self) -> Array:
        """u (k, 3) of each row."""
        return self.table[:, _PUSH]

    @property
    def reach(self) -> Array:
        """|u||k| (k,), m."""
        return self.table[:, _REACH]

    @cached_property
    def moves(self) -> Array:
        """The maps (m, 3, 3) from a translation to the change of σ p + a × p + s, of the m bilinear rows."""
        T = self.table[self.bilinear]
        return np.asarray(T[:, _SIGN, None, None] * _EYE + np.einsum("iac,ki->kca", _TURN, T[:, _ACROSS]))

    @cached_property
    def _linear(self) -> Array:
        """What takes (R row by row, p, 1) (13,) to f, N and R k of each row, and to R b and y when one is bilinear.

        All of these are linear in the pose but for (R b)·y in f and (R b) × y in the turns' part of N, with
        y = σ p + a × p + s. Shape (13, 10 k) or (13, 16 k).
        """
        T, k, wide = self.table, len(self.table), 16 if self._curved else 10
        found = np.zeros((13, k, wide))
        turning = found[:9].reshape(3, 3, k, wide)
        turning[..., 0] = np.einsum("ki,kj->ijk", T[:, _PUSH], T[:, _LEVER])
        turning[..., 4:7] = np.einsum("aic,ki,kj->ajkc", _TURN, T[:, _PUSH], T[:, _LEVER])
        turning[..., 7:10] = np.einsum("ac,kj->ajkc", _EYE, T[:, _LEVER])
        found[9:12, :, 0], found[12, :, 0] = T[:, _NORMAL].T, -T[:, _OFFSET]
        found[12, :, 1:4] = T[:, _NORMAL]
        if self._curved:
            along, turned = T[:, _SIGN, None, None] * _EYE, np.einsum("aic,ki->kac", _TURN, T[:, _ACROSS])
            turning[..., 1:4] = np.einsum("kac,kj->ajkc", along + turned, T[:, _BODY])
            turning[..., 10:13] = np.einsum("ac,kj->ajkc", _EYE, T[:, _BODY])
            found[9:12, :, 13:] = np.moveaxis(along - turned, 1, 0)
            found[12, :, 13:] = T[:, _SHIFT]
        return found.reshape(13, k * wide)

    def along(self, p: Array, R: Array) -> tuple[Array, Array]:
        """Distances (e, k) and gradients (e, k, 6) at poses with positions p (e, 3) and rotations R (e, 3, 3)."""
        f, N, _ = self._at(p, R)
        return f, N

    def _at(self, p: Array, R: Array) -> tuple[Array, Array, Array]:
        """Values, gradients, and R k, then R b and y when one is bilinear (e, k, 3 or 9), of rows."""
        at = np.empty((len(p), 13))
        at[:, :9], at[:, 9:12], at[:, 12] = R.reshape(-1, 9), p, 1.0
        found = (at @ self._linear).reshape(len(p), len(self.table), 16 if self._curved else 10)
        f, N = found[..., 0], found[..., 1:7]
        if self._curved:
            Rb, y = found[..., 10:13], found[..., 13:]
            f = f + np.vecdot(Rb, y)
            N[..., 3:] += cross(Rb, y)
        return f, N, found[..., 7:]

    def over(self, start: Pose, goal: Pose) -> tuple[Rows, Rows]:
        """The rows at both ends of a piece of motion."""
        return self.ends(np.array([start.p, goal.p]), np.array([start.R, goal.R]))

    def ends(self, p: Array, R: Array) -> tuple[Rows, Rows]:
        """The rows at both ends of pieces of motion, positions p (2, …, 3) and rotations R (2, …, 3, 3)."""
        both = self.rows(p, R)
        return both.end(0), both.end(1)

    def at(self, pose: Pose) -> Rows:
        """The rows at a pose."""
        return self.rows(pose.p, pose.R)

    def rows(self, p: Array, R: Array) -> Rows:
        """The rows at poses with positions p (…, 3) and rotations R (…, 3, 3), their axes leading."""
        lead = p.shape[:-1]
        f, N, rest = (found.reshape(*lead, *found.shape[1:]) for found in self._at(p.reshape(-1, 3), R))
        turned, bent = rest[..., :3], np.zeros((2, *lead, 0, 3))
        if self._curved:
            bent = np.moveaxis(rest[..., self.bilinear, 3:].reshape(*lead, -1, 2, 3), -2, 0)
        return Rows(f, N, self, turned, bent)


def stacked(*parts: Forms) -> Forms:
    """All rows one after the other."""
    return Forms(np.concatenate([np.zeros((0, _WIDTH)), *(part.table for part in parts)]))


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
    u, k = np.broadcast_arrays(np.atleast_2d(u), np.atleast_2d(k))
    return _filled(len(u), push=u, lever=k)


def faces_above(normals: Array, offsets: Array | float, points: Array) -> Forms:
    """(R n)·(w − p) − a for body planes n (k, 3) or (3,), a (k,) or one, and world points w (k, 3)."""
    return _filled(len(points), body=normals, offset=offsets, shift=points, sign=-1.0)


def edges_apart(e_m: Array, e_f: Array, q: Array, points: Array) -> Forms:
    """m·(p + R v − q) with m = R e_m × e_f, not normalised, for body points v (k, 3).

    The plane runs through the fixed edge (point q, unit e_f) and along the moving edge (unit body vector e_m).
    Written as (R e_m)·(e_f × (p − q)) + e_f·R(v × e_m): bilinear in the pose, linear in the rotation.
    """
    k = cross(points, e_m)
    return _filled(len(points), push=e_f, lever=k, body=e_m, across=e_f, shift=-cross(e_f, q))
