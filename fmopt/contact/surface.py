"""C-surface functions f(X) of primitive contacts between two parts: signed distances, f < 0 inside the forbidden zone.

The functions are those of `definitions`; here they get the numbers of two parts, and are evaluated, many contacts and
poses at once, by the kernels that were generated from them. [DakinPopplestone1993] section 2 and Appendix I.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import chain
from typing import TYPE_CHECKING, TypeAlias, assert_never

import numpy as np
from numpy.typing import NDArray

from fmopt.compiled import compiled
from fmopt.contact.algebra import Definition
from fmopt.contact.definitions import CONTACTS
from fmopt.contact.kernels_generated import Tables, height, regularity, wrench
from fmopt.contact.primitive import Kind, PrimitiveContact
from fmopt.geometry.polyhedron import Polyhedron
from fmopt.memory import remembered
from fmopt.se3 import Pose
from fmopt.values import Array, Value, frozen

if TYPE_CHECKING:
    from fmopt.contact.derive import Derived

_MEMORY, _NUMBERS = 1024, 8192

Records: TypeAlias = NDArray[np.void]


@dataclass(frozen=True, eq=False)
class Surfaces(Value):
    """The C-surface functions of k contacts.

    Args:
        contacts: the contacts.
        order: (k,), sends contacts stacked by kinds back to their own order.
        tables: for each kind the records of its contacts, in the order of `CONTACTS`.
    """

    contacts: tuple[PrimitiveContact, ...]
    order: NDArray[np.intp]
    tables: tuple[Records, ...]

    @staticmethod
    def of(contacts: Sequence[PrimitiveContact], moving: Polyhedron, fixed: Polyhedron) -> Surfaces:
        """The functions of the contacts between these parts."""
        return _surfaces(moving, fixed, tuple(contacts))

    def values(self, pose: Pose) -> Array:
        """Signed distances f (k,) in m; not a number where edges are parallel and cross in no one point."""
        return self.heights(pose.p, pose.R)

    def heights(self, p: Array, R: Array) -> Array:
        """Signed distances f (…, k) at poses with positions p (…, 3), R (…, 3, 3); see `values`."""
        lead, k = p.shape[:-1], len(self.contacts)
        f = np.empty((math.prod(lead), k))
        heights(self.tables, _rows(p, 3), _rows(R, 3, 3), f)
        return f.take(self.order, axis=1).reshape(*lead, k)

    def values_and_rows(self, pose: Pose) -> tuple[Array, Array]:
        """Signed distances f (k,) in m and gradients N (k, 6) in local coordinates X = (d, δ) at the pose."""
        return self.over(pose.p, pose.R)

    def over(self, p: Array, R: Array) -> tuple[Array, Array]:
        """Signed distances f (…, k) in m and gradients N (…, k, 6) at poses with positions p (…, 3), R (…, 3, 3).

        A gradient is the wrench of a unit contact force. Level edges have neither: nan.
        """
        lead, k = p.shape[:-1], len(self.contacts)
        f, N = np.empty((math.prod(lead), k)), np.empty((math.prod(lead), k, 6))
        over(self.tables, _rows(p, 3), _rows(R, 3, 3), f, N)
        return f.take(self.order, axis=1).reshape(*lead, k), N.take(self.order, axis=1).reshape(*lead, k, 6)

    def sines(self, pose: Pose) -> Array:
        """Sines (k,) of the angles between the edges of contacts; 1 where a vertex touches a face."""
        found = np.empty(len(self.contacts))
        regularities(self.tables, pose.p.copy(), pose.R.copy(), found)
        return np.sqrt(found).take(self.order)


def _rows(values: Array, *shape: int) -> Array:
    """Numbers one pose after the other, such as kernels are compiled for."""
    found = np.ascontiguousarray(values).reshape(-1, *shape)
    return found if found.flags.writeable else found.copy()


def values_and_rows(
    contacts: Sequence[PrimitiveContact], moving: Polyhedron, fixed: Polyhedron, pose: Pose
) -> tuple[Array, Array]:
    """Signed distances f (k,) in m and gradients N (k, 6) of the contacts at a pose; see `Surfaces`."""
    return Surfaces.of(contacts, moving, fixed).values_and_rows(pose)


@remembered(_MEMORY)
def _surfaces(moving: Polyhedron, fixed: Polyhedron, contacts: tuple[PrimitiveContact, ...]) -> Surfaces:
    kinds, numbers = [definition(c.kind) for c in contacts], [parameters(moving, fixed, c) for c in contacts]
    places, tables = stacked(kinds, numbers)
    order = np.argsort(places, kind="stable").astype(np.intp)
    order.setflags(write=False)
    return Surfaces(contacts, order, tables)


def stacked(
    kinds: Sequence[Definition | None], numbers: Sequence[Array]
) -> tuple[NDArray[np.intp], tuple[Records, ...]]:
    """Contacts by kinds: which they are, one kind after the other (k,), and the records of each kind.

    Args:
        kinds: of things, None for those that are no contacts.
        numbers: of each (n,), in the order of its definition.
    """
    places = [[i for i, own in enumerate(kinds) if own is kind] for kind in CONTACTS.values()]
    groups = zip(CONTACTS.values(), places, strict=True)
    tables = tuple(records(kind, np.array([numbers[i] for i in group])) for kind, group in groups)
    return np.array([*chain(*places)], dtype=np.intp), tables


def records(kind: Definition, numbers: Array) -> Records:
    """Numbers (k, width) of contacts of one kind as records (k,)."""
    found = np.array(numbers, dtype=np.float64).reshape(-1, kind.width).view(kind.dtype)[:, 0]
    found.setflags(write=False)
    return found


def symbolic_surface(kind: Kind) -> Derived:
    """The C-surface function of a kind of contact as SymPy has it, with its wrench and its second derivatives."""
    from fmopt.contact.derive import derived

    return derived(definition(kind).name)


def definition(kind: Kind) -> Definition:
    """The definition of a kind of contact."""
    return CONTACTS[kind.value.replace("-", "_")]


@remembered(_NUMBERS)
def parameters(moving: Polyhedron, fixed: Polyhedron, contact: PrimitiveContact) -> Array:
    """The numbers (n,) of a contact's C-surface function, in the order of its definition."""
    match contact.kind:
        case Kind.VERTEX_FACE:
            face = fixed.faces[contact.fixed_feature]
            return frozen([*moving.vertices[contact.moving[0]], *face.normal, face.offset])
        case Kind.FACE_VERTEX:
            face = moving.faces[contact.moving_feature]
            return frozen([*face.normal, *fixed.vertices[contact.fixed[0]], face.offset])
        case Kind.EDGE_EDGE:
            a, b = moving.vertices[list(contact.moving)]
            q, r = fixed.vertices[list(contact.fixed)]
            return frozen([*(b - a) / np.linalg.norm(b - a), *a, *(r - q) / np.linalg.norm(r - q), *q])
        case _:
            assert_never(contact.kind)


@compiled
def heights(tables: Tables, p: Array, R: Array, f: Array) -> None:
    """Fills in the distances f (m, k) of all contacts at poses p (m, 3), R (m, 3, 3)."""
    for n in range(len(p)):
        for i in range(f.shape[1]):
            f[n, i] = height(tables, i, p[n], R[n])


@compiled
def over(tables: Tables, p: Array, R: Array, f: Array, N: Array) -> None:
    """Fills in distances f (m, k) and wrenches N (m, k, 6) of all contacts at poses p (m, 3), R (m, 3, 3)."""
    for n in range(len(p)):
        for i in range(f.shape[1]):
            f[n, i] = wrench(tables, i, p[n], R[n], N[n, i])


@compiled
def regularities(tables: Tables, p: Array, R: Array, found: Array) -> None:
    """Fills in how regular contacts (k,) are at a pose p (3,), R (3, 3); see `kernels_generated.regularity`."""
    for i in range(len(found)):
        found[i] = regularity(tables, i, p, R)
