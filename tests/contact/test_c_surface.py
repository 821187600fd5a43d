"""C-surfaces: symbolic, CasADi and NumPy agree; gradients, wrenches, remainders and bounds."""

import casadi
import mpmath
import numpy as np
import pytest
import sympy

from fmopt.contact import generate
from fmopt.contact.algebra import Definition
from fmopt.contact.c_surface import Surfaces, contact_wrench, definition, over, records
from fmopt.contact.definitions import CONTACTS
from fmopt.contact.derive import derived, latex
from fmopt.contact.facet_bounds import BoundTable, bounds
from fmopt.contact.primitive import Kind, PrimitiveContact, near_contacts, vertex_face
from fmopt.errors import InfeasibleError
from fmopt.geometry.polyhedron import Polyhedron
from fmopt.spatial.se3 import Pose, exp
from tests.shared.parts.contact_cases import BLOCK, CASES, LEANING, PEG
from tests.shared.parts.square import MID_DEPTH


def test_all_kinds_are_under_test() -> None:
    assert {contact.kind for _, contacts, _ in CASES for contact in contacts} == set(Kind)


@pytest.mark.parametrize(("fixed", "contacts", "pose"), CASES)
def test_gradients_against_differences(fixed: Polyhedron, contacts: tuple[PrimitiveContact, ...], pose: Pose) -> None:
    surfaces = Surfaces.of(contacts, PEG, fixed)
    f, N = surfaces.values_and_rows(pose)
    np.testing.assert_allclose(f, surfaces.values(pose), rtol=0.0, atol=1e-17)
    h = 1e-6
    steps = h * np.eye(6)
    measured = [(surfaces.values(pose.moved(s)) - surfaces.values(pose.moved(-s))) / (2 * h) for s in steps]
    np.testing.assert_allclose(N, np.transpose(measured), rtol=0.0, atol=1e-9)


@pytest.mark.parametrize(("fixed", "contacts", "pose"), CASES)
def test_the_gradient_is_the_wrench(fixed: Polyhedron, contacts: tuple[PrimitiveContact, ...], pose: Pose) -> None:
    for contact in contacts:
        # Virtual work: the unit contact force does the work df in every small displacement.
        wrench = contact_wrench(contact, PEG, fixed, pose)
        surfaces = Surfaces.of([contact], PEG, fixed)
        for X in 1e-6 * np.eye(6):
            work = (surfaces.values(pose.moved(X)) - surfaces.values(pose.moved(-X)))[0]
            assert work == pytest.approx(2 * float(wrench @ X), abs=1e-15)


@pytest.mark.parametrize(("fixed", "contacts", "pose"), CASES)
def test_definitions_in_numpy_sympy_and_casadi_agree_with_the_kernels(
    fixed: Polyhedron, contacts: tuple[PrimitiveContact, ...], pose: Pose
) -> None:
    f, N = Surfaces.of(contacts, PEG, fixed).values_and_rows(pose)
    for contact, value, row in zip(contacts, f, N, strict=True):
        kind = definition(contact.kind)
        (record,) = next(table for table in Surfaces.of([contact], PEG, fixed).tables if len(table))
        numbers = {name: record[name] for name in kind.roles}
        assert float(kind(pose.p, pose.R, **numbers)) == pytest.approx(value, abs=1e-16)
        assert float(kind(casadi.DM(pose.p), casadi.DM(pose.R), **numbers)) == pytest.approx(value, abs=1e-16)
        found = derived(kind.name)
        values = dict(zip(found.p, map(sympy.Float, pose.p), strict=True))
        for name, symbol in found.parameters.items():
            given = pose.R @ numbers[name] if name in found.turned else numbers[name]
            values |= dict(zip(np.ravel(symbol), map(sympy.Float, np.ravel(given)), strict=True))
        assert float(found.f.evalf(30, values)) == pytest.approx(value, abs=1e-16)
        np.testing.assert_allclose([float(x.evalf(30, values)) for x in found.N], row, rtol=0.0, atol=1e-15)


@pytest.mark.parametrize("kind", CONTACTS.values(), ids=list(CONTACTS))
def test_second_derivatives_against_differences_of_the_wrench(kind: Definition) -> None:
    rng = np.random.default_rng(7)
    found = derived(kind.name)
    symbols = [*found.p, *(s for symbol in found.parameters.values() for s in np.ravel(symbol))]
    hessian = sympy.lambdify(symbols, found.H)
    for _ in range(5):
        pose = Pose(rng.normal(size=3), exp(rng.normal(size=3)))
        numbers = {key: unit(rng.normal(size=role.width)) for key, role in kind.roles.items()}
        tables = tuple(
            records(other, np.concatenate([*numbers.values()]) if other is kind else np.zeros((0, other.width)))
            for other in CONTACTS.values()
        )
        f, N, h = np.empty((12, 1)), np.empty((12, 1, 6)), 1e-5
        moved = [pose.moved(sign * h * e) for e in np.eye(6) for sign in (1.0, -1.0)]
        over(tables, np.array([at.p for at in moved]), np.array([at.R for at in moved]), f, N)
        measured = (N[::2, 0] - N[1::2, 0]) / (2 * h)
        turned = [pose.R @ numbers[key] if key in found.turned else numbers[key] for key in kind.roles]
        H = hessian(*pose.p, *np.concatenate(turned))
        np.testing.assert_allclose(0.5 * (measured + measured.T), H, rtol=0.0, atol=1e-8 * (1.0 + np.abs(H).max()))


def unit(numbers: np.ndarray) -> np.ndarray:
    return numbers / np.linalg.norm(numbers) if len(numbers) == 3 else numbers


@pytest.mark.parametrize("sine", [1e-2, 1e-3, 1e-4])
def test_wrenches_between_nearly_level_edges_are_right(sine: float) -> None:
    """Against fifty digits: what stands off by a millimetre, with arms of centimetres."""
    rng = np.random.default_rng(3)
    worst = 0.0
    with mpmath.workdps(50):
        for _ in range(20):
            e = unit(rng.normal(size=3))
            aside = unit(np.cross(e, rng.normal(size=3)))
            a = np.sqrt(1.0 - sine**2) * e + sine * aside
            v, q = 0.01 * rng.normal(size=3), 0.01 * rng.normal(size=3)
            p = q - v + 1e-3 * np.cross(e, aside) + 1e-6 * rng.normal(size=3)
            tables = tuple(
                records(kind, np.concatenate([a, v, e, q]) if name == "edge_edge" else np.zeros((0, kind.width)))
                for name, kind in CONTACTS.items()
            )
            f, N = np.empty((1, 1)), np.empty((1, 1, 6))
            over(tables, p[None], np.eye(3)[None], f, N)
            exact = wrench_in_fifty_digits(p, a, v, e, q)
            worst = max(worst, *(abs(float(x - y)) for x, y in zip(exact, N[0, 0], strict=True)))
    assert worst <= 1e-9


def wrench_in_fifty_digits(p: np.ndarray, *numbers: np.ndarray) -> list[mpmath.mpf]:
    found = derived("edge_edge")
    symbols = [*found.p, *(s for symbol in found.parameters.values() for s in np.ravel(symbol))]
    given = [mpmath.mpf(float(x)) for x in np.concatenate([p, *numbers])]
    return list(sympy.lambdify(symbols, list(found.N), "mpmath")(*given))


def test_edges_that_are_level_have_no_wrench_and_are_told_by_name() -> None:
    crossing = [c for c in near_contacts(PEG, BLOCK, LEANING, reach=3e-3, angle=0.05) if c.kind is Kind.EDGE_EDGE]
    sines = Surfaces.of(crossing, PEG, BLOCK).sines(Pose(LEANING.p, exp([1e-6, 2e-6, 0.0])))
    contact = crossing[int(sines.argmin())]
    with pytest.raises(InfeasibleError, match=f"contact {contact.id} has no wrench"):
        contact_wrench(contact, PEG, BLOCK, Pose(LEANING.p, exp([1e-6, 2e-6, 0.0])))


def test_a_formula_is_written_in_vectors() -> None:
    assert latex(CONTACTS["vertex_face"]) == r"n \cdot \left(p + R\,v\right) - c"
    assert r"|R\,a \times e|" in latex(CONTACTS["edge_edge"])


def test_the_generated_kernels_are_current() -> None:
    assert generate.FILE.read_text() == generate.written()


@pytest.mark.parametrize(("fixed", "contacts", "pose"), CASES)
def test_poses_at_once_are_as_one_by_one(fixed: Polyhedron, contacts: tuple[PrimitiveContact, ...], pose: Pose) -> None:
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
        assert named == ({(1, 1), (1, -1)} if contact.kind is Kind.EDGE_EDGE else {(1, 1)})
    inside = BoundTable.of(contacts, PEG, BLOCK, MID_DEPTH).insides(MID_DEPTH)
    # The middle of the ball is 1 mm further up than the tip.
    deep = [0.014 if contact.kind is Kind.BALL_FACE else 0.015 for contact in contacts]
    np.testing.assert_allclose(inside, deep, atol=1e-15)


def test_bounds_of_a_face_with_a_hole_offer_a_choice() -> None:
    table = BoundTable.of([vertex_face(BLOCK, 2, 1)], PEG, BLOCK, MID_DEPTH)
    assert sorted(len(clause) for clause in table.clauses[0]) == [1, 1, 1, 1, 4]
    for shift, inside in (((0.0, 0.0), -1e-4), ((3e-4, 0.0), 2e-4), ((2e-4, 3e-4), 2e-4), ((0.03, 0.0), -0.01)):
        found = table.insides(Pose(np.array([*shift, 0.0]), np.eye(3)))[0]
        assert found == pytest.approx(inside, abs=1e-12)


@pytest.mark.parametrize(("fixed", "contacts", "pose"), CASES)
def test_edges_cross_at_their_angle(fixed: Polyhedron, contacts: tuple[PrimitiveContact, ...], pose: Pose) -> None:
    for contact, sine in zip(contacts, Surfaces.of(contacts, PEG, fixed).sines(pose), strict=True):
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
