"""C-surface functions f(X) of primitive contacts: signed distances, f < 0 inside the forbidden zone.

vertex–face n·(v(X) − a), face–vertex (R n)·(w − p(X)), edge–edge m·(c(X) − q), with m the unit cross product of the
edges, out of the fixed part. [DakinPopplestone1993] section 2 and Appendix I. Numbers go through NumPy with one
rotation for all contacts; the symbolic forms, for optimisers and for reading, are in SymPy and CasADi.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from itertools import chain
from typing import Any, assert_never

import numpy as np
from numpy.typing import NDArray

from fmopt.contact.primitive import Kind, PrimitiveContact
from fmopt.geometry.polyhedron import Polyhedron
from fmopt.memory import remembered
from fmopt.se3 import Pose, cross
from fmopt.values import Array, Value, frozen

_MEMORY, _NUMBERS = 1024, 8192


@dataclass(frozen=True, eq=False)
class Surfaces(Value):
    """The C-surface functions of k contacts, tabulated: rows of (vertex v, normal n, offset) and of edge lines.

    `order` sends the stacked kinds (vertex–face, face–vertex, edge–edge) back to the contacts' own order.
    """

    contacts: tuple[PrimitiveContact, ...]
    order: NDArray[np.intp]
    vertex_face: Array
    face_vertex: Array
    edge_edge: Array

    @staticmethod
    def of(contacts: Sequence[PrimitiveContact], moving: Polyhedron, fixed: Polyhedron) -> Surfaces:
        """The table of the contacts between these parts."""
        return _surfaces(moving, fixed, tuple(contacts))

    def values(self, pose: Pose) -> Array:
        """Signed distances f (k,) in m; not a number where edges are parallel and cross in no one point."""
        return self.heights(pose.p, pose.R)

    def heights(self, p: Array, R: Array) -> Array:
        """Signed distances f (…, k) at poses with positions p (…, 3), R (…, 3, 3); see `values`."""
        p, Rt = p[..., None, :], np.swapaxes(R, -1, -2)
        f = []
        if len(self.vertex_face):
            v, n, offset = _point_normal(self.vertex_face)
            f.append(_dot(n, v @ Rt + p) - offset)
        if len(self.face_vertex):
            g, w, level = _point_normal(self.face_vertex)
            f.append(_dot(g @ Rt, w - p) - level)
        if len(self.edge_edge):
            a, u, e, q = _lines(self.edge_edge, Rt)
            m = cross(a, e)
            size = np.sqrt(_dot(m, m))
            f.append(np.divide(_dot(m, p + u - q), size, out=np.full(size.shape, np.nan), where=size > 0.0))
        return self._in_order(f, np.zeros((*R.shape[:-2], 0)), -1)

    def _in_order(self, of_kinds: Sequence[Array], nothing: Array, axis: int) -> Array:
        """What there is of each kind, in the order of the contacts along an axis; `nothing` without any."""
        if len(of_kinds) < 2:
            return of_kinds[0] if of_kinds else nothing
        return np.concatenate(of_kinds, axis=axis).take(self.order, axis)

    def sines(self, pose: Pose) -> Array:
        """Sines (k,) of the angles between the edges of contacts; 1 where a vertex touches a face."""
        a, _, e, _ = _lines(self.edge_edge, pose.R.T)
        m = cross(a, e)
        others = np.ones(len(self.order) - len(m))
        return np.asarray(np.concatenate([others, np.sqrt(_dot(m, m))])[self.order])

    def values_and_rows(self, pose: Pose) -> tuple[Array, Array]:
        """Signed distances f (k,) in m and gradients N (k, 6) in local coordinates X = (d, δ) at the pose."""
        return self.over(pose.p, pose.R)

    def over(self, p: Array, R: Array) -> tuple[Array, Array]:
        """Signed distances f (…, k) in m and gradients N (…, k, 6) at poses with positions p (…, 3), R (…, 3, 3).

        vertex–face (n, Rv × n); face–vertex (−Rn, Rn × (w − p)); edge–edge (m, Rc × m) with c the point of the moving
        edge's line closest to the fixed line. Level edges have neither: nan.
        """
        p, Rt = p[..., None, :], np.swapaxes(R, -1, -2)
        found = list[tuple[Array, Array]]()
        if len(self.vertex_face):
            v, n, offset = _point_normal(self.vertex_face)
            arm = v @ Rt
            found.append((_dot(n, arm + p) - offset, _beside(np.broadcast_to(n, arm.shape), cross(arm, n))))
        if len(self.face_vertex):
            g, w, level = _point_normal(self.face_vertex)
            h, reach = g @ Rt, w - p
            found.append((_dot(h, reach) - level, _beside(-h, cross(h, reach))))
        if len(self.edge_edge):
            found.append(_edges(self.edge_edge, p, Rt))
        none = np.zeros((*R.shape[:-2], 0))
        return (
            self._in_order([f for f, _ in found], none, -1),
            self._in_order([N for _, N in found], none[..., None].repeat(6, axis=-1), -2),
        )


def values_and_rows(
    contacts: Sequence[PrimitiveContact], moving: Polyhedron, fixed: Polyhedron, pose: Pose
) -> tuple[Array, Array]:
    """Signed distances f (k,) in m and gradients N (k, 6) of the contacts at a pose; see `Surfaces`."""
    return Surfaces.of(contacts, moving, fixed).values_and_rows(pose)


@remembered(_MEMORY)
def _surfaces(moving: Polyhedron, fixed: Polyhedron, contacts: tuple[PrimitiveContact, ...]) -> Surfaces:
    kinds = (Kind.VERTEX_FACE, Kind.FACE_VERTEX, Kind.EDGE_EDGE)
    stacked = [[i for i, contact in enumerate(contacts) if contact.kind is kind] for kind in kinds]
    rows = [[parameters(moving, fixed, contacts[i]) for i in group] for group in stacked]
    order = np.argsort(list(chain(*stacked)), kind="stable").astype(np.intp)
    order.setflags(write=False)
    tables = [frozen(np.reshape(row, (len(row), 12))) for row in rows]
    return Surfaces(contacts, order, *tables)


@remembered(_NUMBERS)
def parameters(moving: Polyhedron, fixed: Polyhedron, contact: PrimitiveContact) -> Array:
    """The twelve numbers (12,) of a contact's C-surface function.

    vertex–face: body point v, normal n, offset n·a, zeros; face–vertex: body normal n, point w, body offset, zeros;
    edge–edge: moving unit direction and point (body frame), fixed unit direction and point.
    """
    match contact.kind:
        case Kind.VERTEX_FACE:
            face = fixed.faces[contact.fixed_feature]
            return frozen([*moving.vertices[contact.moving[0]], *face.normal, face.offset, *np.zeros(5)])
        case Kind.FACE_VERTEX:
            face = moving.faces[contact.moving_feature]
            return frozen([*face.normal, *fixed.vertices[contact.fixed[0]], face.offset, *np.zeros(5)])
        case Kind.EDGE_EDGE:
            a, b = moving.vertices[list(contact.moving)]
            q, r = fixed.vertices[list(contact.fixed)]
            return frozen([*(b - a) / np.linalg.norm(b - a), *a, *(r - q) / np.linalg.norm(r - q), *q])
        case _:
            assert_never(contact.kind)


def _point_normal(table: Array) -> tuple[Array, Array, Array]:
    return table[:, :3], table[:, 3:6], table[:, 6]


def _lines(table: Array, Rt: Array) -> tuple[Array, Array, Array, Array]:
    """Turned moving directions and arms (…, k, 3), fixed directions and points (k, 3)."""
    return table[:, :3] @ Rt, table[:, 3:6] @ Rt, table[:, 6:9], table[:, 9:]


def _edges(table: Array, p: Array, Rt: Array) -> tuple[Array, Array]:
    """Signed distances (…, k) and gradients (…, k, 6) of edges at poses with p (…, 1, 3) and transposed rotations."""
    a, u, e, q = _lines(table, Rt)
    gap = p + u - q
    cosine = _dot(a, e)
    m = cross(a, e)
    with np.errstate(divide="ignore", invalid="ignore"):
        m /= np.sqrt(_dot(m, m))[..., None]
        along = (cosine * _dot(gap, e) - _dot(gap, a)) / (1.0 - cosine**2)
        c = u + along[..., None] * a
        turned = cross(c, m)
    return _dot(m, gap), _beside(m, turned)


def _dot(a: Array, b: Array) -> Array:
    return np.asarray(np.vecdot(a, b))


def _beside(a: Array, b: Array) -> Array:
    return np.concatenate([a, b], axis=-1)


# Symbolic forms.


@dataclass(frozen=True)
class SymbolicSurface:
    """f(X) of one kind as a SymPy expression.

    Symbols: the pose `p` (3,) and rotation matrix `R` (9, row by row), and the twelve `parameters` of a contact.
    """

    expression: Any
    p: tuple[Any, ...]
    R: tuple[Any, ...]
    parameters: tuple[Any, ...]


@cache
def symbolic_surface(kind: Kind) -> SymbolicSurface:
    """The C-surface function of a kind, symbolic in the pose and in the contact's numbers."""
    import sympy

    p, R, c = sympy.symbols("p:3"), sympy.symbols("R:9"), sympy.symbols("c:12")
    P, T = sympy.Matrix(p), sympy.Matrix(3, 3, R)
    one, two, three, four = (sympy.Matrix(c[i : i + 3]) for i in (0, 3, 6, 9))
    match kind:
        case Kind.VERTEX_FACE:
            expression = two.dot(T * one + P) - c[6]
        case Kind.FACE_VERTEX:
            expression = (T * one).dot(two - P) - c[6]
        case Kind.EDGE_EDGE:
            m = (T * one).cross(three)
            expression = m.dot(P + T * two - four) / sympy.sqrt(m.dot(m))
        case _:
            assert_never(kind)
    return SymbolicSurface(expression, p, R, c)


def surface_expression(
    contact: PrimitiveContact, moving: Polyhedron, fixed: Polyhedron, reference: Pose, X: Sequence[Any]
) -> Any:
    """f as a SymPy expression of six symbols X = (d, δ), local coordinates around the reference pose."""
    import sympy

    from fmopt.symbolic import rotation

    surface = symbolic_surface(contact.kind)
    T = rotation(sympy.Matrix(X[3:])) * sympy.Matrix(reference.R.tolist())
    P = sympy.Matrix(reference.p.tolist()) + sympy.Matrix(X[:3])
    numbers = parameters(moving, fixed, contact).tolist()
    return surface.expression.subs(
        dict(zip((*surface.p, *surface.R, *surface.parameters), (*P, *T, *numbers), strict=True)), simultaneous=True
    )


@cache
def pose_function() -> Any:
    """CasADi function (X (6,), reference p and R row by row (12,)) ↦ p and R row by row (12,), once per process."""
    import sympy

    from fmopt.symbolic import casadi_function, rotation

    X, reference = sympy.symbols("X:6"), sympy.symbols("T:12")
    T = rotation(sympy.Matrix(X[3:])) * sympy.Matrix(3, 3, reference[3:])
    P = [a + b for a, b in zip(reference[:3], X[:3], strict=True)]
    return casadi_function("pose", {"X": X, "reference": reference}, [*P, *T])


@cache
def kind_function(kind: Kind) -> Any:
    """CasADi function (p and R row by row (12,), parameters (12,)) ↦ f, once per process."""
    from fmopt.symbolic import casadi_function

    surface = symbolic_surface(kind)
    name = kind.value.replace("-", "_")
    inputs = {"pose": (*surface.p, *surface.R), "parameters": surface.parameters}
    return casadi_function(name, inputs, [surface.expression])


def surfaces_function(kinds: Sequence[Kind]) -> Any:
    """CasADi function (X (6,), reference (12,), parameters (12, k)) ↦ f (k,), all contacts sharing one rotation.

    Numbers enter as parameters, so a solver built on it serves every formation with these kinds.
    """
    import casadi

    X, reference, numbers = casadi.SX.sym("X", 6), casadi.SX.sym("reference", 12), casadi.SX.sym("c", 12, len(kinds))
    pose = pose_function()(X, reference)
    f = [kind_function(kind)(pose, numbers[:, i]) for i, kind in enumerate(kinds)]
    names = ["X", "reference", "parameters"], ["f"]
    return casadi.Function("surfaces", [X, reference, numbers], [casadi.vertcat(*f)], *names)


def reference_vector(pose: Pose) -> Array:
    """The twelve numbers (p, R row by row) of a reference pose for the CasADi functions."""
    return np.concatenate([pose.p, pose.R.ravel()])
