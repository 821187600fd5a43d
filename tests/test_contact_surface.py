"""C-surfaces: symbolic, CasADi and NumPy agree; gradients, wrenches, remainders and bounds."""

import casadi
import numpy as np
import pytest
import sympy
from test_contact_parts import MID_DEPTH, block, peg, spike, tilted

from fmopt.contact.bounds import BoundTable, bounds
from fmopt.contact.primitive import Kind, PrimitiveContact, face_vertex, near_contacts, vertex_face
from fmopt.contact.surface import (
    Surfaces,
    parameters,
    reference_vector,
    surface_expression,
    surfaces_function,
    values_and_rows,
)
from fmopt.contact.wrench import contact_wrench
from fmopt.geometry.polyhedron import Polyhedron, from_faces
from fmopt.se3 import Pose, exp
from fmopt.symbolic import Stumpff, casadi_function, rotation

PEG, BLOCK, SPIKE = peg(), block(), from_faces(*spike())
LEANING = tilted((0.03, -0.05, 0.02))


def cases() -> list[tuple[Polyhedron, tuple[PrimitiveContact, ...], Pose]]:
    mouth = near_contacts(PEG, BLOCK, LEANING, reach=3e-3, angle=0.05)
    above = Pose.from_vector((0.001, -0.002, 0.0003, 0.1, 0.2, -0.3))
    on_spike = tuple(face_vertex(PEG, face, 4) for face in (0, 2, 3))
    return [(BLOCK, mouth, LEANING), (SPIKE, on_spike, above)]


CASES = cases()


def test_all_kinds_are_under_test() -> None:
    assert {contact.kind for _, contacts, _ in CASES for contact in contacts} == set(Kind)


@pytest.mark.parametrize(("fixed", "contacts", "pose"), CASES)
def test_gradients_against_finite_differences(
    fixed: Polyhedron, contacts: tuple[PrimitiveContact, ...], pose: Pose
) -> None:
    surfaces = Surfaces.of(contacts, PEG, fixed)
    f, N = surfaces.values_and_rows(pose)
    np.testing.assert_allclose(f, surfaces.values(pose), rtol=0.0, atol=1e-17)
    h = 1e-6
    steps = h * np.eye(6)
    measured = [(surfaces.values(pose.moved(s)) - surfaces.values(pose.moved(-s))) / (2 * h) for s in steps]
    np.testing.assert_allclose(N, np.transpose(measured), rtol=0.0, atol=1e-9)


@pytest.mark.parametrize(("fixed", "contacts", "pose"), CASES)
def test_the_gradient_is_the_contact_wrench(
    fixed: Polyhedron, contacts: tuple[PrimitiveContact, ...], pose: Pose
) -> None:
    for contact in contacts:
        # Virtual work: the unit contact force does the work df in every small displacement.
        wrench = contact_wrench(contact, PEG, fixed, pose)
        surfaces = Surfaces.of([contact], PEG, fixed)
        for X in 1e-6 * np.eye(6):
            work = (surfaces.values(pose.moved(X)) - surfaces.values(pose.moved(-X)))[0]
            assert work == pytest.approx(2 * float(wrench @ X), abs=1e-15)


@pytest.mark.parametrize(("fixed", "contacts", "pose"), CASES)
def test_sympy_casadi_and_numpy_agree(fixed: Polyhedron, contacts: tuple[PrimitiveContact, ...], pose: Pose) -> None:
    X = np.array([1e-4, -2e-4, 3e-4, 0.02, -0.03, 0.01])
    f, _ = values_and_rows(contacts, PEG, fixed, pose.moved(X))
    function = surfaces_function([contact.kind for contact in contacts])
    numbers = np.column_stack([parameters(PEG, fixed, contact) for contact in contacts])
    np.testing.assert_allclose(function(X, reference_vector(pose), numbers).full().ravel(), f, rtol=0.0, atol=1e-16)
    symbols = sympy.symbols("X:6")
    for contact, value in zip(contacts, f, strict=True):
        expression = surface_expression(contact, PEG, fixed, pose, symbols)
        exact = expression.subs(dict(zip(symbols, X.tolist(), strict=True))).evalf(20)
        assert float(exact) == pytest.approx(value, abs=1e-16)


def test_casadi_jacobian_at_the_reference_is_the_row() -> None:
    fixed, contacts, pose = CASES[0]
    X = casadi.SX.sym("X", 6)
    numbers = np.column_stack([parameters(PEG, fixed, contact) for contact in contacts])
    f = surfaces_function([contact.kind for contact in contacts])(X, reference_vector(pose), numbers)
    jacobian = casadi.Function("jacobian", [X], [casadi.jacobian(f, X)])
    _, N = values_and_rows(contacts, PEG, fixed, pose)
    np.testing.assert_allclose(jacobian(np.zeros(6)).full(), N, rtol=0.0, atol=1e-14)


def test_sympy_gradient_is_the_row() -> None:
    fixed, contacts, pose = CASES[0]
    symbols = sympy.symbols("X:6")
    kinds = {contact.kind: i for i, contact in enumerate(contacts)}
    _, N = values_and_rows(contacts, PEG, fixed, pose)
    for i in kinds.values():
        expression = surface_expression(contacts[i], PEG, fixed, pose, symbols)
        gradient = [expression.diff(x).subs(dict.fromkeys(symbols, 0)).evalf() for x in symbols]
        np.testing.assert_allclose(np.array(gradient, dtype=float), N[i], rtol=0.0, atol=1e-14)


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-3, 1.0, 3.0])
def test_symbolic_rotation_is_the_exponential(angle: float) -> None:
    symbols = sympy.symbols("r:3")
    r = angle * np.array([2.0, -1.0, 2.0]) / 3.0
    function = casadi_function("rotation", {"r": symbols}, list(rotation(sympy.Matrix(symbols))))
    np.testing.assert_allclose(function(r).full().reshape(3, 3), exp(r), rtol=0.0, atol=3e-15)


def test_stumpff_derivative() -> None:
    s = sympy.Symbol("s")
    slope = Stumpff(2, s).diff(s).subs(s, sympy.Rational(1, 2)).evalf(30)
    closed = sympy.diff((1 - sympy.cos(sympy.sqrt(s))) / s, s).subs(s, sympy.Rational(1, 2)).evalf(30)
    assert abs(slope - closed) < 1e-25


def test_nodes_outside_the_table_are_refused() -> None:
    x, y = sympy.symbols("x y")
    with pytest.raises(TypeError, match="tan"):
        casadi_function("f", {"x": [x]}, [sympy.tan(x)])
    with pytest.raises(TypeError, match="Symbol y"):
        casadi_function("f", {"x": [x]}, [x + y])


@pytest.mark.parametrize(("fixed", "contacts", "pose"), CASES)
def test_many_poses_at_once_are_the_same_as_one_by_one(
    fixed: Polyhedron, contacts: tuple[PrimitiveContact, ...], pose: Pose
) -> None:
    rng = np.random.default_rng(4)
    surfaces, table = Surfaces.of(contacts, PEG, fixed), BoundTable.of(contacts, PEG, fixed, pose)
    poses = [pose.moved(rng.normal(size=6) * np.repeat([1e-3, 0.1], 3)) for _ in range(30)]
    f, N = surfaces.over(np.array([at.p for at in poses]), np.array([at.R for at in poses]))
    g, _ = table.surfaces.over(np.array([at.p for at in poses]), np.array([at.R for at in poses]))
    depth, which = table.depths(g)
    for i, at in enumerate(poses):
        np.testing.assert_allclose(f[i], surfaces.values(at), atol=1e-16)
        np.testing.assert_allclose(N[i], surfaces.values_and_rows(at)[1], atol=1e-15)
        np.testing.assert_allclose(depth[i].min(axis=1, initial=np.inf), table.insides(at), atol=1e-16)
        for k, clauses in enumerate(table.clauses):
            for c in range(len(clauses)):
                bound = table.listed[which[i, k, c]]
                value = Surfaces.of([bound.contact], PEG, fixed).values(at)[0]
                assert depth[i, k, c] == pytest.approx(-bound.sign * value, abs=1e-15)


def test_bounds_of_a_wall_are_its_mouth_only() -> None:
    contacts = near_contacts(PEG, BLOCK, MID_DEPTH, reach=1e-3, angle=0.02)
    for contact in contacts:
        clauses = bounds(contact, PEG, BLOCK, MID_DEPTH)
        named = {(b.contact.fixed_feature, b.sign) for clause in clauses for group in clause for b in group}
        # Wall: the tip below the top face. Mouth edge: the tip below, the other end of the edge above.
        assert named == ({(1, 1)} if contact.kind is Kind.VERTEX_FACE else {(1, 1), (1, -1)})
    inside = BoundTable.of(contacts, PEG, BLOCK, MID_DEPTH).insides(MID_DEPTH)
    np.testing.assert_allclose(inside, 0.015, atol=1e-15)


def test_bounds_of_a_face_with_a_hole_offer_a_choice() -> None:
    contact = vertex_face(BLOCK, 2, 1)
    table = BoundTable.of([contact], PEG, BLOCK, MID_DEPTH)
    assert sorted(len(clause) for clause in table.clauses[0]) == [1, 1, 1, 1, 4]
    for shift, inside in (((0.0, 0.0), -1e-4), ((3e-4, 0.0), 2e-4), ((2e-4, 3e-4), 2e-4), ((0.03, 0.0), -0.01)):
        found = table.insides(Pose(np.array([*shift, 0.0]), np.eye(3)))[0]
        assert found == pytest.approx(inside, abs=1e-12)


@pytest.mark.parametrize(("fixed", "contacts", "pose"), CASES)
def test_edges_cross_at_the_angle_between_them(
    fixed: Polyhedron, contacts: tuple[PrimitiveContact, ...], pose: Pose
) -> None:
    sines = Surfaces.of(contacts, PEG, fixed).sines(pose)
    for contact, sine in zip(contacts, sines, strict=True):
        if contact.kind is not Kind.EDGE_EDGE:
            assert sine == 1.0
            continue
        moving, still = (
            np.subtract(*ends) for ends in (PEG.vertices[list(contact.moving)], fixed.vertices[list(contact.fixed)])
        )
        cosine = pose.R @ moving @ still / (np.linalg.norm(moving) * np.linalg.norm(still))
        assert sine**2 == pytest.approx(1.0 - cosine**2, abs=1e-14)


def test_level_edges_have_no_value_and_warn_of_nothing() -> None:
    crossing = [c for c in near_contacts(PEG, BLOCK, LEANING, reach=3e-3, angle=0.05) if c.kind is Kind.EDGE_EDGE]
    upright = Pose(LEANING.p, np.eye(3))
    with np.errstate(all="raise"):
        f, N = Surfaces.of(crossing, PEG, BLOCK).values_and_rows(upright)
    ends = [(PEG.vertices[list(c.moving)], BLOCK.vertices[list(c.fixed)]) for c in crossing]
    level = np.array([np.linalg.norm(np.cross(a[1] - a[0], b[1] - b[0])) == 0.0 for a, b in ends])
    assert 0 < level.sum() < len(level)
    assert (np.isnan(f) == level).all()
    assert (np.isnan(N).any(axis=1) == level).all()
