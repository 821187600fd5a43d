"""Rows: signed distances as functions of the pose error, with gradient and second-order remainder.

Around a nominal pose (p, R) a real pose is p + e, exp([ε]×)R. Every distance that a certificate needs has the form

    f = n·p + u·(R k) + (R b)·(σ p + a × p + s) − c,

so that one gradient and one remainder formula serve them all: N = ∂f/∂(e, ε) at zero error. Rows with b are bilinear:
|b| = 1, and σ = −1, a = 0 or σ = 0, |a| = 1. All vectors may be many at once, (r, 3).
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from fmopt.certificate.kernels_rows import ROW, Table, Turned, value
from fmopt.runtime.compiled import compiled
from fmopt.spatial.kernels import vector
from fmopt.spatial.se3 import Pose, cross, lengths
from fmopt.spatial.values import Array, Bits, fixed


@dataclass(frozen=True, eq=False)
class Rows:
    """Distances at one pose: values f (k,), gradients N (k, 6), in m and m/rad, and the vectors that turn (k, 3).

    At several poses all of them have leading axes.
    """

    f: Array
    N: Array
    forms: "Forms"
    turned: Turned

    def end(self, k: int) -> "Rows":
        """Those at poses k, of rows at several with a leading axis."""
        w, b, y = self.turned
        return Rows(self.f[k], self.N[k], self.forms, Turned(w[k], b[k], y[k]))


@dataclass(frozen=True, eq=False)
class Forms:
    """Distances as functions of the pose: rows (k,), records of `kernels_rows.ROW`."""

    table: Table

    def __len__(self) -> int:
        return len(self.table)

    @property
    def bilinear(self) -> Bits:
        """Which rows (k,) are bilinear."""
        return np.asarray(self.table["bilinear"] != 0)

    @property
    def directed(self) -> Bits:
        """Which rows (k,) measure a direction, whatever the position."""
        return np.asarray((self.table["bilinear"] == 0) & ~self.table["n"].any(axis=1))

    @property
    def lever(self) -> Array:
        """|u||k| (k,), m."""
        return np.asarray(self.table["lever"])

    def over(self, start: Pose, goal: Pose) -> tuple[Rows, Rows]:
        """The rows at both ends of a piece of motion."""
        return self.ends(np.array([start.p, goal.p]), np.array([start.R, goal.R]))

    def ends(self, p: Array, R: Array) -> tuple[Rows, Rows]:
        """The rows at both ends of pieces of motion: starts and goals p (2, …, 3), m, and R (2, …, 3, 3)."""
        both = self.rows(p, R)
        return both.end(0), both.end(1)

    def at(self, pose: Pose) -> Rows:
        """The rows at a pose."""
        return self.rows(pose.p, pose.R)

    def rows(self, p: Array, R: Array) -> Rows:
        """The rows at poses p (…, 3), m, and R (…, 3, 3), whose axes lead."""
        # Kernels see one list of poses; the leading axes are put back afterwards.
        lead = p.shape[:-1]
        found = _at(self.table, fixed(p.reshape(-1, 3)), fixed(R.reshape(-1, 3, 3)))
        f, N, *turned = (part.reshape(*lead, *part.shape[1:]) for part in found)
        return Rows(f, N, self, Turned(*turned))


@compiled
def _at(table: Table, p: Array, R: Array) -> tuple[Array, Array, Array, Array, Array]:
    """Values f (e, k) and gradients N (e, k, 6) of rows (k,) at poses p (e, 3), R (e, 3, 3), and w, b, y (e, k, 3)."""
    poses, k = len(p), len(table)
    f, N = np.empty((poses, k)), np.empty((poses, k, 6))
    w, b, y = np.empty((poses, k, 3)), np.empty((poses, k, 3)), np.empty((poses, k, 3))
    for e in range(poses):
        at = vector(p[e])
        for i in range(k):
            f[e, i], moving, turning, end = value(table[i], at, R[e])
            for c in range(3):
                N[e, i, c], N[e, i, 3 + c] = moving[c], turning[c]
                w[e, i, c], b[e, i, c], y[e, i, c] = end[0][c], end[1][c], end[2][c]
    return f, N, w, b, y


def stacked(*parts: Forms) -> Forms:
    """All rows one after the other."""
    ends = np.cumsum([0, *(len(part) for part in parts)])
    table = np.empty(ends[-1], ROW)  # NumPy would find out anew for each part of what type all of them are
    for part, first, last in zip(parts, ends, ends[1:], strict=False):
        table[first:last] = part.table
    return Forms(table)


def points_above(points: Array, normals: Array, offsets: Array | float) -> Forms:
    """n·(p + R v) − a: body points v (k, 3), unit normals n (k, 3) or one in axes of B, offsets a (k,) or one, m."""
    return _forms(n=normals, u=normals, k=points, c=offsets)


def balls_above(points: Array, normals: Array, offsets: Array | float, radii: Array) -> Forms:
    """n·(p + R v) − a − r, as `points_above`, with radii r (k,), m."""
    return points_above(points, normals, offsets + radii)


def directions_along(u: Array, k: Array) -> Forms:
    """u·(R k): rows that only the rotation moves, u in axes of B and k in those of the body, (r, 3) or one each.

    |u||k| is the arm on which an angle counts.
    """
    return _forms(u=u, k=k)


def faces_above(normals: Array, offsets: Array | float, points: Array) -> Forms:
    """(R n)·(w − p) − a: unit normals n (k, 3) or one in body axes, offsets a (k,) or one, points w (k, 3) in B, m."""
    return _forms(b=normals, s=points, sign=-1.0, c=offsets, bilinear=1.0)


def edges_apart(e_m: Array, e_f: Array, q: Array, points: Array) -> Forms:
    """m·(p + R v − q) with m = R e_m × e_f, not normalised.

    The plane runs through the fixed edge and along the moving edge.

    Unit vectors e_m, body axes, and e_f, axes of B, and a point q of the fixed edge, m, are (3,) or (k, 3); points v of
    the body are (k, 3), m.
    """
    # (R e_m)·(e_f × (p − q)) + e_f·R(v × e_m), the point's own part in axes of the body.
    return _forms(b=e_m, a=e_f, s=cross(e_f, -q), u=e_f, k=cross(points, e_m), bilinear=1.0)


def _forms(**columns: Array | float) -> Forms:
    """Rows (r,) by columns of `ROW`, vectors (r, 3) or one for all (3,), numbers (r,) or one; others are zero."""
    given = {name: np.asarray(column, dtype=np.float64) for name, column in columns.items()}
    leading = (column.shape[: column.ndim - len(ROW[name].shape)] for name, column in given.items())
    table = np.zeros(np.broadcast_shapes((1,), *leading), ROW)
    for name, column in given.items():
        table[name] = column
    # The length of u·(R k) at most, on which an angle counts.
    table["lever"] = lengths(table["u"]) * lengths(table["k"])
    return Forms(table)


class Questions:
    """Rows asked for while a table of bounds is built: of body points, of directions, and of world points."""

    def __init__(self) -> None:
        self._kinds: dict[Callable[..., Forms], list[tuple[int, tuple[Array | float, ...]]]] = {}
        self._count = 0

    def _ask(self, kind: Callable[..., Forms], *parameters: Array | float) -> int:
        self._kinds.setdefault(kind, []).append((self._count, parameters))
        self._count += 1
        return self._count - 1

    def above(self, v: Array, normal: Array, offset: float) -> int:
        """The number of the row of how far a body point (3,) is above a fixed plane, m."""
        return self._ask(points_above, v, normal, offset)

    def along(self, u: Array, k: Array) -> int:
        """The number of the row of how far a body vector k (3,), m, goes along a unit direction u (3,) of the world."""
        return self._ask(directions_along, u, k)

    def beneath(self, normal: Array, offset: float, w: Array) -> int:
        """The number of the row of how far a fixed point (3,) is above a body plane, m."""
        return self._ask(faces_above, normal, offset, w)

    def forms(self) -> Forms:
        """All rows by their numbers."""
        numbers = [number for asked in self._kinds.values() for number, _ in asked]
        parts = (
            kind(*map(np.array, zip(*(own for _, own in asked), strict=True))) for kind, asked in self._kinds.items()
        )
        return Forms(stacked(*parts).table[np.argsort(numbers)])
