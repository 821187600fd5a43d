"""Distance rows of placements: the C-surface functions of contacts, and hyperplanes.

Each row has a kind and its numbers, so that one optimiser serves every formation of the same counts.
[DakinPopplestone1993] section 2 and appendix I.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fmopt.contact.algebra import Definition
from fmopt.contact.primitive import Kind, PrimitiveContact
from fmopt.contact.surface import Records, definition, over, parameters, stacked
from fmopt.geometry.polyhedron import Polyhedron
from fmopt.se3 import Pose
from fmopt.values import Array, Value, frozen


class RowKind(StrEnum):
    """Which function a row is; contacts carry the names of primitive contacts."""

    VERTEX_FACE = "vertex-face"
    FACE_VERTEX = "face-vertex"
    EDGE_EDGE = "edge-edge"
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
    """n·(R v + p − a): body point v, unit world normal n, world point a of the face (m)."""
    offset = float(np.dot(np.asarray(n), np.asarray(a)))
    return Row(RowKind.VERTEX_FACE, np.concatenate([v, n, [offset]]))


def face_vertex(n: ArrayLike, offset: float, w: ArrayLike) -> Row:
    """(R n)·(w − p) − offset: unit body normal n and offset of the face, world point w (m)."""
    return Row(RowKind.FACE_VERTEX, np.concatenate([n, w, [offset]]))


def edge_edge(moving: ArrayLike, fixed: ArrayLike, sign: int) -> Row:
    """m·(R b + p − q), m = sign (R e × e′)/|…|: two body points, two world points, (2, 3) each (m)."""
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
        count: how many rows there are.
        contacts: places of the contacts among them (k,), stacked by kinds.
        tables: records of the contacts of each kind.
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
        """Values (k,) and gradients (k, 6) of the rows, see `evaluate`."""
        pose, f, N = reference.moved(X), np.zeros(self.count), np.zeros((self.count, 6))
        own, wrenches = np.empty((1, len(self.contacts))), np.empty((1, len(self.contacts), 6))
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
