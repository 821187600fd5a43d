"""C-surface functions f(X) of primitive contacts between two parts: signed distances, f < 0 inside the forbidden zone.

The functions are those of `definitions`; here they get the numbers of two parts, and are evaluated, many contacts and
poses at once, by the kernels that were generated from them. [DakinPopplestone1993] section 2 and Appendix I.

Frictionless contact wrenches of primitive contacts.

Virtual work makes the wrench of a unit force along the surface's normal equal to ∇f: it does the work ∇f·X.

Friction cones of contacts as wrenches, and the angle between two: how well a force sensor tells them apart.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias, assert_never

import numpy as np
from numpy.typing import NDArray

from fmopt.contact.algebra import Definition
from fmopt.contact.definitions import CONTACTS
from fmopt.contact.kernels_generated import Tables, height, regularity, wrench
from fmopt.contact.primitive import Kind, PrimitiveContact
from fmopt.errors import InfeasibleError
from fmopt.geometry.polyhedron import Polyhedron, plane_basis
from fmopt.runtime.compiled import compiled
from fmopt.spatial.se3 import Pose, cross
from fmopt.spatial.values import Array, Indices, Value, remembered

if TYPE_CHECKING:
    from fmopt.contact.derive import Derived


_MEMORY = 1024

Records: TypeAlias = NDArray[np.void]

LEVEL = 1e-4  # sine of the angle between edges below which their wrench is not right to 1e-9

_SIDES = 8  # of the pyramid in a friction cone: more sides lose less of it
_ROUNDS = 60  # of projections to and fro, which come closer by a factor each
_STARTS = 3  # nearest pairs of generators that are tried; the nearest vectors need not be near the nearest generators
_SETTLED = 1e-9  # cosine by which a round has to come nearer
_NOTHING = 1e-9  # length of a wrench that is left of a unit one and counts as none


@dataclass(frozen=True, eq=False)
class Surfaces(Value):
    """The C-surface functions of k contacts.

    The tables hold the records of the contacts of each kind, in the order of `CONTACTS`; `order` (k,) sends contacts
    stacked by kinds back to their own order.
    """

    contacts: tuple[PrimitiveContact, ...]
    order: Indices
    tables: tuple[Records, ...]

    @staticmethod
    def of(contacts: Sequence[PrimitiveContact], moving: Polyhedron, fixed: Polyhedron) -> "Surfaces":
        """The functions of the contacts between these parts, in their order."""
        return _surfaces(moving, fixed, tuple(contacts))

    def values(self, pose: Pose) -> Array:
        """Signed distances f (k,) in m; not a number where edges are parallel and cross in no one point."""
        return self.heights(pose.p, pose.R)

    def heights(self, p: Array, R: Array) -> Array:
        """Signed distances f (…, k), m, at positions p (…, 3), m, and rotations R (…, 3, 3); see `values`."""
        lead, k = p.shape[:-1], len(self.contacts)
        f = np.empty((math.prod(lead), k))
        heights(self.tables, _rows(p, 3), _rows(R, 3, 3), f)
        return f.take(self.order, axis=1).reshape(*lead, k)

    def values_and_rows(self, pose: Pose) -> tuple[Array, Array]:
        """Signed distances f (k,) in m and gradients N (k, 6) in local coordinates X = (d, δ) at the pose."""
        return self.over(pose.p, pose.R)

    def over(self, p: Array, R: Array) -> tuple[Array, Array]:
        """Signed distances f (…, k) in m and gradients N (…, k, 6) at poses.

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


@remembered(_MEMORY)
def _surfaces(moving: Polyhedron, fixed: Polyhedron, contacts: tuple[PrimitiveContact, ...]) -> Surfaces:
    places, tables = list[int](), list[Records]()
    for kind in sorted(Kind, key=lambda kind: [*CONTACTS.values()].index(definition(kind))):
        group = [n for n, contact in enumerate(contacts) if contact.kind is kind]
        places += group
        tables.append(records(definition(kind), _numbers(moving, fixed, kind, [contacts[n] for n in group])))
    order = np.argsort(places, kind="stable").astype(np.intp)
    order.setflags(write=False)
    return Surfaces(contacts, order, tuple(tables))


def _numbers(moving: Polyhedron, fixed: Polyhedron, kind: Kind, contacts: Sequence[PrimitiveContact]) -> Array:
    """The numbers (k, n) of contacts of one kind, in the order of its definition."""
    one = np.array([contact.moving_feature for contact in contacts], dtype=np.intp)
    other = np.array([contact.fixed_feature for contact in contacts], dtype=np.intp)
    match kind:
        case Kind.VERTEX_FACE:
            return np.column_stack([moving.vertices[one], fixed.normals[other], fixed.offsets[other]])
        case Kind.BALL_FACE:
            plane = fixed.normals[other], fixed.offsets[other]
            return np.column_stack([moving.vertices[one], *plane, moving.radii[one]])
        case Kind.FACE_VERTEX:
            return np.column_stack([moving.normals[one], fixed.vertices[other], moving.offsets[one]])
        case Kind.EDGE_EDGE:
            first = np.array([contact.moving[0] for contact in contacts], dtype=np.intp)
            begun = np.array([contact.fixed[0] for contact in contacts], dtype=np.intp)
            (a, e), (b, f) = _along_edges(moving), _along_edges(fixed)
            e = np.where((first == a[one])[:, None], e[one], -e[one]) + 0.0  # no negative zeros
            f = np.where((begun == b[other])[:, None], f[other], -f[other]) + 0.0
            return np.column_stack([e, moving.vertices[first], f, fixed.vertices[begun]])
        case _:
            assert_never(kind)


@remembered(1)
def _along_edges(body: Polyhedron) -> tuple[Indices, Array]:
    """The first vertex (e,) of each edge, and unit vectors (e, 3) along them."""
    ends = [body.vertices[list(edge.vertices)] for edge in body.edges]
    ways = np.array([(b - a) / np.linalg.norm(b - a) for a, b in ends])
    return np.array([edge.vertices[0] for edge in body.edges], dtype=np.intp), ways


def records(kind: Definition, numbers: Array) -> Records:
    """Numbers (k, width) of contacts of one kind as records (k,)."""
    found = np.array(numbers, dtype=np.float64).reshape(-1, kind.width).view(kind.dtype)[:, 0]
    found.setflags(write=False)
    return found


def symbolic_surface(kind: Kind) -> "Derived":
    """The C-surface function of a kind of contact as SymPy has it, with its wrench and its second derivatives."""
    from fmopt.contact.derive import derived

    return derived(definition(kind).name)


def definition(kind: Kind) -> Definition:
    """The definition of a kind of contact."""
    return CONTACTS[kind.value.replace("-", "_")]


@compiled
def heights(tables: Tables, p: Array, R: Array, f: Array) -> None:
    """Fills in the distances f (m, k), m, of all contacts at poses p (m, 3), m, R (m, 3, 3)."""
    for n in range(len(p)):
        for i in range(f.shape[1]):
            f[n, i] = height(tables, i, p[n], R[n])


@compiled
def over(tables: Tables, p: Array, R: Array, f: Array, N: Array) -> None:
    """Fills in distances f (m, k), m, and wrenches N (m, k, 6) of all contacts at poses p (m, 3), m, R (m, 3, 3)."""
    for n in range(len(p)):
        for i in range(f.shape[1]):
            f[n, i] = wrench(tables, i, p[n], R[n], N[n, i])


@compiled
def regularities(tables: Tables, p: Array, R: Array, found: Array) -> None:
    """Fills in how regular contacts (k,) are at a pose p (3,), m, R (3, 3); see `kernels_generated.regularity`."""
    for i in range(len(found)):
        found[i] = regularity(tables, i, p, R)


def contact_point(contact: PrimitiveContact, moving: Polyhedron, fixed: Polyhedron, pose: Pose) -> Array:
    """The point (3,) of the moving part's feature, in m, at which the fixed part pushes; the contact touches at `pose`.

    Raises:
        InfeasibleError: edges are parallel.
    """
    match contact.kind:
        case Kind.VERTEX_FACE:
            return pose.apply(moving.vertices[contact.moving[0]])
        case Kind.BALL_FACE:
            centre, normal = contact.moving[0], fixed.faces[contact.fixed_feature].normal
            return np.asarray(pose.apply(moving.vertices[centre]) - moving.radii[centre] * normal)
        case Kind.FACE_VERTEX:
            return np.asarray(fixed.vertices[contact.fixed[0]])
        case Kind.EDGE_EDGE:
            a, b = pose.apply(moving.vertices[list(contact.moving)])
            wrench = contact_wrench(contact, moving, fixed, pose)
            across = cross(b - a, wrench[:3])
            beside = wrench[3:] - cross(a - pose.p, wrench[:3])
            return np.asarray(a + (beside @ across) / (across @ across) * (b - a))
        case _:
            assert_never(contact.kind)


def contact_normal(contact: PrimitiveContact, moving: Polyhedron, fixed: Polyhedron, pose: Pose) -> Array:
    """The unit normal (3,), axes of B, along which the fixed part pushes; arguments as for `contact_point`.

    Raises:
        InfeasibleError: edges are parallel.
    """
    return contact_wrench(contact, moving, fixed, pose)[:3]


def contact_wrench(contact: PrimitiveContact, moving: Polyhedron, fixed: Polyhedron, pose: Pose) -> Array:
    """The wrench (f, τ) (6,) on the moving part of a unit contact force, about its body origin, in N and N·m.

    Arguments as for `contact_point`.

    Raises:
        InfeasibleError: edges are parallel.
    """
    surface = Surfaces.of([contact], moving, fixed)
    sine = float(surface.sines(pose)[0])
    if not sine >= LEVEL:
        raise InfeasibleError(f"contact {contact.id} has no wrench: its edges are parallel, to a sine of {sine:.2g}")
    return np.asarray(surface.values_and_rows(pose)[1][0])


def friction_cone(normal: Array, arm: Array, friction: float) -> Array:
    """Generators (8, 6) of the wrenches that a contact can put on the part: a pyramid inside its friction cone.

    It pushes along a unit normal (3,), with its point at an arm (3,) from the part's reference point, m.
    """
    first, second = plane_basis(normal).T
    turns = 2.0 * math.pi * np.arange(_SIDES) / _SIDES
    forces = normal + friction * (np.cos(turns)[:, None] * first + np.sin(turns)[:, None] * second)
    return np.hstack([forces, cross(arm, forces)])


def sliding_maps(normals: Array, arms: Array) -> Array:
    """Maps (k, 2, 6) from a twist to the velocity along surfaces with unit normals (k, 3), at arms (k, 3), m."""
    sides = np.array([plane_basis(normal).T for normal in normals]).reshape(-1, 2, 3)
    return np.concatenate([sides, cross(arms[:, None], sides)], axis=2)


def angle_between(one: Array, other: Array) -> float | None:
    """The least angle (rad) between vectors of two cones; None where one is {0}.

    Each is the cone of sums of its generators, (k, n) and (m, n), of any length, with weights that are not negative;
    rows of 0 do not count. The greatest cosine is sought by projecting onto the cones in turn, from the generators that
    are nearest to the other cone: each projection brings the two nearer.
    """
    A, B = _directions(one), _directions(other)
    if not len(A) or not len(B):
        return None
    cosines = A @ B.T
    best = float(cosines.max())
    for i in np.argsort(-cosines.max(axis=1), kind="stable")[:_STARTS]:
        best = max(best, _nearest(A[i], A, B))
    return math.acos(min(max(best, -1.0), 1.0))


def _nearest(u: Array, A: Array, B: Array) -> float:
    """The cosine between a unit vector of cone A and the nearest of cone B, both moved until they come no nearer."""
    best = -1.0
    for _ in range(_ROUNDS):
        v = _onto(B, u)
        if v is None:
            return max(best, float((B @ u).max()))
        w = _onto(A, v)
        if w is None:
            return max(best, float(u @ v))
        u, cosine = w, float(w @ v)
        if cosine - best < _SETTLED:
            return max(best, cosine)
        best = cosine
    return best


def _onto(generators: Array, x: Array) -> Array | None:
    """The unit vector along the projection of x onto a cone; None where that is 0."""
    from scipy.optimize import nnls

    y = generators.T @ nnls(generators.T, x)[0]
    size = float(np.linalg.norm(y))
    return y / size if size > _NOTHING else None


def _directions(generators: Array) -> Array:
    size = np.linalg.norm(generators, axis=1)
    return np.asarray(generators[size > _NOTHING] / size[size > _NOTHING, None])
