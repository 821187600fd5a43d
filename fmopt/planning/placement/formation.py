"""The functions of a placement on true surfaces as CasADi builds them: once for each contact formation.

Numbers are parameters, so that one formation, so many rows of each kind, serves all placements that have it.

Distance rows of placements: the C-surface functions of contacts, and hyperplanes.

Each row has a kind and its numbers, so that one optimiser serves every formation of the same counts.
[DakinPopplestone1993] section 2 and appendix I.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from functools import lru_cache
from itertools import accumulate
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fmopt.contact.algebra import Definition
from fmopt.contact.c_surface import Records, definition, over, parameters, stacked
from fmopt.contact.primitive import Kind, PrimitiveContact
from fmopt.geometry.polyhedron import Polyhedron
from fmopt.spatial.se3 import Pose
from fmopt.spatial.values import Array, Value, frozen

_SERIES = 13  # terms of the series of a rotation
_SMOOTH = 1e-12  # added under the root of a travel, which has no derivative where it begins

Counts = tuple[int, ...]
"""How many rows there are of each kind."""

_FIXED = (("units", 6), ("p0", 3), ("R0", 9), ("start", 6), ("unit", 1))


def counts(rows: Sequence[Row]) -> Counts:
    """How many rows there are of each kind."""
    kinds = [row.kind for row in rows]
    return tuple(kinds.count(kind) for kind in RowKind)


class Derivatives:
    """Values of all rows at t = 0, their gradients, and the Hessian of their weighted sum, in scaled variables.

    It owns the arrays that CasADi reads and writes: one thread at a time.
    """

    def __init__(self, function: Any, rows: int, parameters: int) -> None:
        self._arguments = [np.zeros(6), np.zeros(parameters), np.zeros(rows)]
        self._results = [np.zeros(rows), np.zeros(6 * rows), np.zeros(36)]
        self._buffer, self._evaluate = function.buffer()
        # CasADi keeps the addresses of these arrays: they are filled in place, never replaced.
        for i, array in enumerate(self._arguments):
            self._buffer.set_arg(i, array.data)
        for i, array in enumerate(self._results):
            self._buffer.set_res(i, array.data)

    def __call__(self, x: Array, parameters: Array, weights: Array) -> tuple[Array, Array, Array]:
        """Values (k,), gradients (k, 6) and Hessian (6, 6), rows weighed by (k,), at x = X / units (6,)."""
        for array, values in zip(self._arguments, (x, parameters, weights), strict=True):
            array[:] = values
        self._evaluate()
        g, J, H = self._results
        return g.copy(), J.reshape(6, -1).T.copy(), H.reshape(6, 6).copy()  # by columns; the next call overwrites them


@lru_cache(maxsize=64)
def formation_derivatives(contacts: Counts, obstacles: Counts) -> Derivatives:
    """The derivatives of this many rows of each kind, contacts then obstacles."""
    import casadi as ca

    x, rows, parameters = _symbols(ca, contacts, obstacles)
    weights = ca.SX.sym("weights", rows.shape[0])
    hessian = ca.hessian(ca.dot(weights, rows), x)[0]
    results = [ca.densify(found) for found in (rows, ca.jacobian(rows, x), hessian)]
    function = ca.Function("derivatives", [x, parameters, weights], results)
    return Derivatives(function, rows.shape[0], parameters.shape[0])


@lru_cache(maxsize=64)
def formation_solver(contacts: Counts, obstacles: Counts) -> Any:
    """IPOPT for this many rows of each kind, contacts then obstacles; call it under the lock of `nonlinear_program`."""
    import casadi as ca

    x, rows, parameters = _symbols(ca, contacts, obstacles)
    t, total = ca.SX.sym("t"), rows.shape[0]
    # The last parameters are four numbers a row, of which the second is its weight.
    weights = ca.reshape(parameters[parameters.shape[0] - 4 * total :], 4, total)[1, :].T
    p = sum(contacts)
    options: dict[str, Any] = {
        "print_time": False,
        "ipopt": {
            "print_level": 0,
            "sb": "yes",
            "max_iter": 100,
            "tol": 1e-9,
            "constr_viol_tol": 1e-9,
            "acceptable_iter": 0,  # none: what is only acceptable is not solved
            "bound_relax_factor": 0.0,  # bounds are checked as they are stated
            "mu_strategy": "adaptive",
        },
    }
    name = "placement_" + "_".join(str(n) for n in (*contacts, p, *obstacles))
    program = {"x": ca.vertcat(x, t), "f": -t, "g": rows - weights * t, "p": parameters}
    return ca.nlpsol(name, "ipopt", program, options)


def _symbols(ca: Any, contacts: Counts, obstacles: Counts) -> tuple[Any, Any, Any]:
    """The scaled pose (6), the rows at t = 0, and the parameters: fixed, then numbers, scale (4) of rows."""
    repeats = [*zip(RowKind, contacts, strict=True), *zip(RowKind, obstacles, strict=True)]
    kinds = [kind for kind, n in repeats for _ in range(n)]
    total = len(kinds)
    x = ca.SX.sym("x", 6)
    units, p0, R0, start, unit = (ca.SX.sym(name, n) for name, n in _FIXED)
    widths = [kind.width for kind in kinds]
    numbers, scale = ca.SX.sym("numbers", sum(widths)), ca.SX.sym("scale", 4, total)
    X = units * x
    R = _rotation(ca, X[3:]) @ ca.reshape(R0, 3, 3)
    ends = [*accumulate(widths)]
    own = [numbers[end - width : end] for end, width in zip(ends, widths, strict=True)]
    f = [_expression(kind, mine, X, p0 + X[:3], R) for kind, mine in zip(kinds, own, strict=True)]
    travel = unit * ca.sqrt(ca.sumsqr((X - start) / units) + _SMOOTH)
    rows = [scale[0, i] * (f[i] - scale[2, i] - scale[3, i] * travel) for i in range(total)]
    return x, ca.vertcat(*rows), ca.vertcat(units, p0, R0, start, unit, numbers, ca.vec(scale))


def _rotation(ca: Any, r: Any) -> Any:
    """exp([r]×) by its power series in |r|², smooth at 0; 1e-15 accurate up to half a turn."""
    square = ca.sumsqr(r)
    a = b = 0.0
    for k in reversed(range(_SERIES)):
        a = 1.0 - a * square / ((2 * k + 2) * (2 * k + 3))
        b = 1.0 - b * square / ((2 * k + 3) * (2 * k + 4))
    K = ca.skew(r)
    return ca.SX.eye(3) + a * K + 0.5 * b * (K @ K)


def _expression(kind: RowKind, numbers: Any, X: Any, p: Any, R: Any) -> Any:
    contact = kind.contact
    if contact is None:
        return sum((numbers[i] * X[i] for i in range(6)), -numbers[6])
    return contact(p, R, **contact.split(numbers))


class RowKind(StrEnum):
    """Which function a row is; contacts carry the names of primitive contacts."""

    VERTEX_FACE = "vertex-face"
    FACE_VERTEX = "face-vertex"
    EDGE_EDGE = "edge-edge"
    BALL_FACE = "ball-face"
    PLANE = "plane"

    @property
    def contact(self) -> Definition | None:
        """The contact's definition; None of a plane."""
        return None if self is RowKind.PLANE else definition(Kind(self.value))

    @property
    def width(self) -> int:
        """How many numbers a row has."""
        return 7 if self.contact is None else self.contact.width


@dataclass(frozen=True, eq=False)
class Row(Value):
    """One function f of the pose, positive in free space.

    numbers: a contact's, in the order of its definition; a plane's N (6) and D: N·X − D in local coordinates.
    """

    kind: RowKind
    numbers: Array

    def __post_init__(self) -> None:
        kind = RowKind(self.kind)
        object.__setattr__(self, "kind", kind)
        object.__setattr__(self, "numbers", frozen(self.numbers, kind.width, name="numbers"))

    @staticmethod
    def of(contact: PrimitiveContact, moving: Polyhedron, fixed: Polyhedron) -> Row:
        """The function of a contact between two parts."""
        return Row(RowKind(contact.kind.value), parameters(moving, fixed, contact))


def vertex_face(v: ArrayLike, n: ArrayLike, a: ArrayLike) -> Row:
    """n·(R v + p − a): v in the body and a on the face, (3,), m, n (3,) the outward unit normal, axes of B."""
    offset = float(np.dot(np.asarray(n), np.asarray(a)))
    return Row(RowKind.VERTEX_FACE, np.concatenate([v, n, [offset]]))


def ball_face(v: ArrayLike, radius: float, n: ArrayLike, a: ArrayLike) -> Row:
    """n·(R v + p − a) − r: as `vertex_face`, v the centre of a ball of radius r, m."""
    offset = float(np.dot(np.asarray(n), np.asarray(a)))
    return Row(RowKind.BALL_FACE, np.concatenate([v, n, [offset, radius]]))


def face_vertex(n: ArrayLike, offset: float, w: ArrayLike) -> Row:
    """(R n)·(w − p) − offset: n the outward unit normal, body axes, w a vertex, (3,), offset in m."""
    return Row(RowKind.FACE_VERTEX, np.concatenate([n, w, [offset]]))


def edge_edge(moving: ArrayLike, fixed: ArrayLike, sign: int) -> Row:
    """m·(R b + p − q), m = sign (R e × e′)/|…| out of the fixed part; ends (2, 3) of both edges, m, in their frames."""
    b, q = np.asarray(moving, dtype=np.float64), np.asarray(fixed, dtype=np.float64)
    e, g = b[1] - b[0], q[1] - q[0]
    return Row(RowKind.EDGE_EDGE, np.concatenate([sign * e / np.linalg.norm(e), b[0], g / np.linalg.norm(g), q[0]]))


def plane(N: ArrayLike, D: float) -> Row:
    """N·X − D in local coordinates about the reference pose, N (6,)."""
    return Row(RowKind.PLANE, np.concatenate([N, [D]]))


@dataclass(frozen=True, eq=False)
class Table:
    """Rows sorted by kind once, to be evaluated often.

    Args:
        contacts: places of the contacts among them (k,), stacked by kinds.
        flat: places of the planes (n,).
        planes: their numbers (n, 7).
    """

    count: int
    contacts: NDArray[np.intp]
    tables: tuple[Records, ...]
    flat: NDArray[np.intp]
    planes: Array

    @staticmethod
    def of(rows: Sequence[Row]) -> Table:
        """The table of some rows."""
        contacts, tables = stacked([row.kind.contact for row in rows], [row.numbers for row in rows])
        flat = np.array([i for i, row in enumerate(rows) if row.kind is RowKind.PLANE], dtype=np.intp)
        planes = np.array([rows[i].numbers for i in flat]).reshape(-1, 7)
        return Table(len(rows), contacts, tables, flat, planes)

    def at(self, reference: Pose, X: Array) -> tuple[Array, Array]:
        """Values (k,) and gradients (k, 6) of the rows at X (6,), m and rad, about a reference pose, see `evaluate`."""
        pose, f, N = reference.moved(X), np.zeros(self.count), np.zeros((self.count, 6))
        own, wrenches = np.empty((1, len(self.contacts))), np.empty((1, len(self.contacts), 6))
        # Copies, since kernels are compiled for arrays that can be written to, and poses cannot.
        over(self.tables, pose.p[None].copy(), pose.R[None].copy(), own, wrenches)
        f[self.contacts], N[self.contacts] = own[0], wrenches[0]
        f[self.flat], N[self.flat] = self.planes[:, :6] @ X - self.planes[:, 6], self.planes[:, :6]
        return f, N


def evaluate(rows: Sequence[Row], reference: Pose, X: Array) -> tuple[Array, Array]:
    """Values f (k,) in m at the pose X around the reference, and their gradients (k, 6) there.

    Gradients are with respect to local coordinates about the *reached* pose, where they are contact wrenches. A plane's
    gradient is its N, with respect to X itself.
    """
    return Table.of(rows).at(reference, X)
