"""Distance rows as numbers: the three C-surface functions and the hyperplane, evaluated in plain NumPy.

Each row has a kind and twelve numbers, so that one optimiser serves every formation of the same counts.
[DakinPopplestone1993] section 2 and appendix I.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import assert_never

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fmopt.se3 import Pose, cross
from fmopt.values import Array, Value, frozen


class RowKind(StrEnum):
    """Which function a row is; the three contacts carry the names of primitive contacts."""

    VERTEX_FACE = "vertex-face"
    FACE_VERTEX = "face-vertex"
    EDGE_EDGE = "edge-edge"
    PLANE = "plane"


@dataclass(frozen=True, eq=False)
class Row(Value):
    """One function f of the pose, positive in free space.

    numbers (12,): vertex–face v, n, offset and zeros (body, world, world); face–vertex n, w, offset and zeros (body,
    world, body); edge–edge direction and point of the moving line (body), direction and point of the fixed line
    (world), run so that (R e) × e′ points out of the fixed part; plane N, D and zeros: N·X − D in local coordinates.
    """

    kind: RowKind
    numbers: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "kind", RowKind(self.kind))
        object.__setattr__(self, "numbers", frozen(self.numbers, 12, name="numbers"))


def vertex_face(v: ArrayLike, n: ArrayLike, a: ArrayLike) -> Row:
    """n·(R v + p − a): body point v, unit world normal n, world point a of the face (m)."""
    offset = float(np.dot(np.asarray(n), np.asarray(a)))
    return Row(RowKind.VERTEX_FACE, np.concatenate([v, n, [offset], np.zeros(5)]))


def face_vertex(n: ArrayLike, offset: float, w: ArrayLike) -> Row:
    """(R n)·(w − p) − offset: unit body normal n and offset of the face, world point w (m)."""
    return Row(RowKind.FACE_VERTEX, np.concatenate([n, w, [offset], np.zeros(5)]))


def edge_edge(moving: ArrayLike, fixed: ArrayLike, sign: int) -> Row:
    """m·(R b + p − q), m = sign (R e × e′)/|…|: two body points, two world points, (2, 3) each (m)."""
    b, q = np.asarray(moving, dtype=np.float64), np.asarray(fixed, dtype=np.float64)
    e, g = b[1] - b[0], q[1] - q[0]
    return Row(RowKind.EDGE_EDGE, np.concatenate([sign * e / np.linalg.norm(e), b[0], g / np.linalg.norm(g), q[0]]))


def plane(N: ArrayLike, D: float) -> Row:
    """N·X − D in local coordinates about the reference pose, N (6,)."""
    return Row(RowKind.PLANE, np.concatenate([N, [D], np.zeros(5)]))


@dataclass(frozen=True, eq=False)
class Table:
    """Rows sorted by kind once, to be evaluated often.

    Args:
        count: how many rows there are.
        groups: for each kind that there is the places of its rows, and their numbers (n, 12).
    """

    count: int
    groups: tuple[tuple[RowKind, NDArray[np.intp], Array], ...]

    @staticmethod
    def of(rows: Sequence[Row]) -> Table:
        """The table of some rows."""
        groups = []
        for kind in RowKind:
            places = [i for i, row in enumerate(rows) if row.kind is kind]
            if places:
                groups.append((kind, np.array(places), np.array([rows[i].numbers for i in places])))
        return Table(len(rows), tuple(groups))

    def at(self, reference: Pose, X: Array) -> tuple[Array, Array]:
        """Values (k,) and gradients (k, 6) of the rows, see `evaluate`."""
        pose, f, N = reference.moved(X), np.zeros(self.count), np.zeros((self.count, 6))
        for kind, places, numbers in self.groups:
            f[places], N[places] = _evaluate(kind, numbers, pose, X)
        return f, N


def evaluate(rows: Sequence[Row], reference: Pose, X: Array) -> tuple[Array, Array]:
    """Values f (k,) in m at the pose X around the reference, and their gradients (k, 6) there.

    Gradients are with respect to local coordinates about the *reached* pose, where they are contact wrenches:
    (n, Rv × n), (−Rn, Rn × (w − p)), (m, Rc × m) with c the point of the moving line closest to the fixed one.
    A plane's gradient is its N, with respect to X itself.
    """
    return Table.of(rows).at(reference, X)


def _evaluate(kind: RowKind, c: Array, pose: Pose, X: Array) -> tuple[Array, Array]:
    """Values and gradients of k rows of one kind, c (k, 12)."""
    one, two, three, four = c[:, :3], c[:, 3:6], c[:, 6:9], c[:, 9:]
    match kind:
        case RowKind.VERTEX_FACE:
            arm = one @ pose.R.T
            return _dot(two, arm + pose.p) - c[:, 6], np.hstack([two, cross(arm, two)])
        case RowKind.FACE_VERTEX:
            n, reach = one @ pose.R.T, two - pose.p
            return _dot(n, reach) - c[:, 6], np.hstack([-n, cross(n, reach)])
        case RowKind.EDGE_EDGE:
            e, arm = one @ pose.R.T, two @ pose.R.T
            m, gap = cross(e, three), pose.p + arm - four
            sine = np.sqrt(_dot(m, m))[:, None]
            m = m / sine
            along = (_dot(e, three) * _dot(gap, three) - _dot(gap, e))[:, None] / sine**2
            return _dot(m, gap), np.hstack([m, cross(arm + along * e, m)])
        case RowKind.PLANE:
            return c[:, :6] @ X - c[:, 6], c[:, :6]
        case _:
            assert_never(kind)


def _dot(a: Array, b: Array) -> Array:
    return np.asarray(np.einsum("ij,ij->i", a, b))
