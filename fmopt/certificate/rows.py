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

from fmopt.compiled import compiled
from fmopt.se3 import Pose, cross, lengths
from fmopt.values import Array

Mask = NDArray[np.bool_]
Places = NDArray[np.intp]

_NORMAL, _PUSH, _LEVER, _BODY, _ACROSS, _SHIFT = (slice(3 * k, 3 * k + 3) for k in range(6))
_OFFSET, _SIGN, _REACH, _WIDTH = 18, 19, 20, 21


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
    def places(self) -> Places:
        """Indices (m,) of those that are."""
        return np.flatnonzero(self.bilinear)

    @property
    def push(self) -> Array:
        """u (k, 3) of each row."""
        return self.table[:, _PUSH]

    @property
    def reach(self) -> Array:
        """|u||k| (k,), m."""
        return self.table[:, _REACH]

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
        found = _at(self.table, self.places, p.reshape(-1, 3), R.reshape(-1, 3, 3))
        f, N, turned = (part.reshape(*lead, *part.shape[1:]) for part in found[:3])
        return Rows(f, N, self, turned, found[3].reshape(2, *lead, -1, 3))


@compiled
def _at(table: Array, places: Places, p: Array, R: Array) -> tuple[Array, Array, Array, Array]:
    """Values and gradients of rows at poses, and the vectors that turn; see `Rows`.

    Args:
        table: (k, 21), of the forms.
        places: of the bilinear rows among them (m,).
        p: positions (e, 3).
        R: rotations (e, 3, 3).

    Returns:
        f (e, k), N (e, k, 6), R k (e, k, 3), and R b and y (2, e, m, 3) of the bilinear rows.
    """
    poses, k, m = len(p), len(table), len(places)
    f, N, turned, bent = (
        np.empty((poses, k)),
        np.empty((poses, k, 6)),
        np.empty((poses, k, 3)),
        np.empty((2, poses, m, 3)),
    )
    for e in range(poses):
        Q = R[e]
        x, y, z = p[e, 0], p[e, 1], p[e, 2]
        for i in range(k):
            T = table[i]
            for c in range(3):
                N[e, i, c] = T[c]
                turned[e, i, c] = Q[c, 0] * T[6] + Q[c, 1] * T[7] + Q[c, 2] * T[8]
            w = turned[e, i]
            f[e, i] = T[0] * x + T[1] * y + T[2] * z + (T[3] * w[0] + T[4] * w[1] + T[5] * w[2]) - T[18]
            N[e, i, 3] = w[1] * T[5] - w[2] * T[4]
            N[e, i, 4] = w[2] * T[3] - w[0] * T[5]
            N[e, i, 5] = w[0] * T[4] - w[1] * T[3]
        for j in range(m):
            i = places[j]
            T = table[i]
            beta, v = bent[0, e, j], bent[1, e, j]
            for c in range(3):
                beta[c] = Q[c, 0] * T[9] + Q[c, 1] * T[10] + Q[c, 2] * T[11]
            # y = σ p + a × p + s; N gains Aᵀ β = σ β − a × β for the translation, β × y for the rotation
            v[0] = T[19] * x + (T[13] * z - T[14] * y) + T[15]
            v[1] = T[19] * y + (T[14] * x - T[12] * z) + T[16]
            v[2] = T[19] * z + (T[12] * y - T[13] * x) + T[17]
            f[e, i] += beta[0] * v[0] + beta[1] * v[1] + beta[2] * v[2]
            N[e, i, 0] += T[19] * beta[0] - (T[13] * beta[2] - T[14] * beta[1])
            N[e, i, 1] += T[19] * beta[1] - (T[14] * beta[0] - T[12] * beta[2])
            N[e, i, 2] += T[19] * beta[2] - (T[12] * beta[1] - T[13] * beta[0])
            N[e, i, 3] += beta[1] * v[2] - beta[2] * v[1]
            N[e, i, 4] += beta[2] * v[0] - beta[0] * v[2]
            N[e, i, 5] += beta[0] * v[1] - beta[1] * v[0]
    return f, N, turned, bent


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
