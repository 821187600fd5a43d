"""Error sets: carried in two ways, of which the smaller bound counts; and the published recipe, formula by formula."""

import pickle
from itertools import product

import numpy as np
import pytest
from scipy.linalg import null_space

from fmopt.certificate.error_set import ErrorSet
from fmopt.papers.dakin_popplestone import section, step_in_the_paper
from fmopt.spatial import ellipsoid

RHO = 0.02


def test_a_box_is_exact_in_its_zonotope() -> None:
    rng = np.random.default_rng(1)
    a = np.array([1e-3, 2e-3, 1e-3, 0.01, 0.02, 0.01])
    box = ErrorSet.from_box(a)
    np.testing.assert_allclose(box.support(np.eye(6)), a, rtol=1e-14)
    np.testing.assert_allclose(np.sqrt(np.diag(box.shape)), np.sqrt(6.0) * a, rtol=1e-14)
    np.testing.assert_array_equal(box.half_widths(box.generators), a)
    corners = np.array(list(product((-1.0, 1.0), repeat=6))) * a
    N = rng.normal(size=(40, 6))
    np.testing.assert_allclose(box.support(N), (corners @ N.T).max(axis=0), rtol=1e-12)
    assert box.support(N[0]) == pytest.approx(box.support(N)[0])


def test_the_smaller_of_two_bounds_counts() -> None:
    rng = np.random.default_rng(5)
    F, A, B, generators = (rng.normal(size=(6, k)) * 1e-4 for k in (6, 4, 3, 9))
    N = rng.normal(size=(200, 6))
    errors = ErrorSet(F, generators.T, A, B)
    outer = np.linalg.norm(N @ F, axis=1)
    both = np.abs(N @ generators).sum(axis=1) + np.linalg.norm(N @ A, axis=1) + np.linalg.norm(N @ B, axis=1)
    np.testing.assert_allclose(errors.support(N), np.minimum(outer, both), rtol=1e-12)
    assert (errors.support(np.eye(6)) <= errors.half_widths(errors.generators) + 1e-18).all()


def test_wide_roots_are_narrowed() -> None:
    F = np.random.default_rng(2).normal(size=(6, 18))
    errors = ErrorSet(F, np.zeros((0, 6)), F, F)
    assert errors.shape_root.shape == errors.slide_root.shape == errors.swing_root.shape == (6, 6)
    np.testing.assert_allclose(errors.shape, F @ F.T, rtol=1e-12)


def test_thickness_is_left_only_while_its_twists_give_way() -> None:
    twists = np.eye(6)[:2]
    errors = ErrorSet(np.eye(6), np.eye(6)[:5], np.zeros((6, 0)), thick=2, compliant=twists)
    assert len(errors.core(twists)) == 3
    assert len(errors.core(np.eye(6)[:3])) == 3
    assert len(errors.core(twists[:1])) == 5


def test_error_sets_stay_read_only_and_refuse_bad_arrays() -> None:
    box = pickle.loads(pickle.dumps(ErrorSet.from_box(np.ones(6))))
    for array in (box.shape, box.shape_root, box.generators, box.slide_root, box.swing_root, box.compliant):
        assert not array.flags.writeable
    with pytest.raises(ValueError, match="shape has shape"):
        ErrorSet.from_ellipsoid(np.eye(3))
    with pytest.raises(ValueError, match="not finite"):
        ErrorSet.from_box(np.full(6, np.nan))
    with pytest.raises(ValueError, match="generators has shape"):
        ErrorSet(np.eye(6), np.zeros((2, 5)), np.eye(6))


def test_section_is_the_ellipse_through_the_published_points() -> None:
    turn = np.array([[1.0, -1.0], [1.0, 1.0]]) / np.sqrt(2.0)
    radius = float(np.sqrt(section(turn @ np.diag([1.0, 0.01]) @ turn.T, np.array([1.0, 0.0]))[1, 1]))
    assert radius == pytest.approx(1.0 / np.sqrt(50.5), rel=1e-12)
    assert round(radius, 2) == 0.14
    rng = np.random.default_rng(8)
    factor = rng.normal(size=(3, 3))
    Q3, V = factor @ factor.T, rng.normal(size=3)
    U = null_space(V[None]).T
    lateral = [U[0], U[1], (U[0] + U[1]) / 2.0]
    surface = np.array([u / np.sqrt(u @ np.linalg.solve(Q3, u)) for u in lateral]) @ U.T
    a, b, c = np.linalg.solve(
        np.column_stack([surface[:, 0] ** 2, 2.0 * surface[:, 0] * surface[:, 1], surface[:, 1] ** 2]), np.ones(3)
    )
    np.testing.assert_allclose(U @ section(Q3, V) @ U.T, np.linalg.inv([[a, b], [b, c]]), rtol=1e-9)


def test_most_of_the_surface_leaves_the_published_cylinder() -> None:
    """Over random ellipsoids in six dimensions: the section of the ellipsoid by V⊥ lies inside its shadow."""
    rng = np.random.default_rng(12)
    outside = []
    for _ in range(50):
        F = rng.normal(size=(6, 6)) * 10.0 ** rng.uniform(-1.0, 0.0, 6)
        V = rng.normal(size=6)
        U = null_space(V[None])
        u = rng.normal(size=(6, 2000))
        lateral = U.T @ (F @ (u / np.linalg.norm(u, axis=0)))
        for Q, share in ((section(F @ F.T, V), outside), (F @ F.T, [])):
            level = np.einsum("ik,ik->k", lateral, np.linalg.solve(ellipsoid.image(Q, U.T), lateral))
            share.append(float((level > 1.0 + 1e-9).mean()))
        assert share == [0.0]
    assert 0.6 < np.mean(outside) < 0.95


def test_published_growth_stretches_the_radii() -> None:
    move, rows = np.array([0.0, 0.0, -2e-3, 0.0, 0.0, 0.0]), np.eye(6)[2:3]
    errors = ErrorSet.from_ellipsoid(np.diag([1e-6, 4e-6, 1e-6, 0.0, 0.0, 0.0]))
    goal = step_in_the_paper(errors, move, rows, move[:, None], (0.1, 0.2), RHO)
    expected = [1e-3 + 2e-4, 2e-3 + 2e-4, 0.0, *[4e-4 / RHO] * 3]
    np.testing.assert_allclose(goal.support(np.eye(6)), expected, atol=1e-12)
