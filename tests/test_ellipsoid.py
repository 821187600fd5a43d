"""Ellipsoids by shape matrix: images, shadows, sums, and what they must contain."""

from itertools import product

import numpy as np
import pytest

from fmopt import ellipsoid
from fmopt.errors import InfeasibleError


def random_shape(rng: np.random.Generator, n: int, rank: int) -> np.ndarray:
    factor = rng.normal(size=(n, rank)) * 10.0 ** rng.uniform(-2.0, 0.0, rank)
    return factor @ factor.T


def unit_vectors(rng: np.random.Generator, k: int, n: int) -> np.ndarray:
    u = rng.normal(size=(k, n))
    return u / np.linalg.norm(u, axis=1, keepdims=True)


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(7)


@pytest.mark.parametrize("rank", [0, 1, 3, 6])
def test_root_support_and_membership_agree(rng: np.random.Generator, rank: int) -> None:
    Q = random_shape(rng, 6, rank)
    root = ellipsoid.root(Q)
    np.testing.assert_allclose(root @ root, Q, atol=1e-14)
    N = rng.normal(size=(50, 6))
    np.testing.assert_allclose(ellipsoid.support(Q, N), np.linalg.norm(N @ root, axis=1), atol=1e-7)
    np.testing.assert_allclose(ellipsoid.support(Q, N[0]), ellipsoid.support(Q, N)[0], rtol=1e-14)
    surface = unit_vectors(rng, 1000, 6) @ root
    assert ellipsoid.contains(Q, surface).all()
    if rank == 6:
        assert not ellipsoid.contains(Q, 1.001 * surface).any()
    if rank < 6:
        off = np.linalg.svd(Q)[0][:, -1]
        assert not ellipsoid.contains(Q, surface + 1e-6 * off).any()


def test_image_is_exact(rng: np.random.Generator) -> None:
    Q, A, N = random_shape(rng, 6, 6), rng.normal(size=(4, 6)), rng.normal(size=(20, 4))
    np.testing.assert_allclose(ellipsoid.support(ellipsoid.image(Q, A), N), ellipsoid.support(Q, N @ A), rtol=1e-12)


@pytest.mark.parametrize("n", [2, 3, 6])
def test_complement_is_an_orthonormal_basis(rng: np.random.Generator, n: int) -> None:
    for V in [*rng.normal(size=(20, n)), *np.eye(n), *-np.eye(n)]:
        U = ellipsoid.complement(V)
        np.testing.assert_allclose(U.T @ U, np.eye(n - 1), atol=1e-14)
        np.testing.assert_allclose(U.T @ V, 0.0, atol=1e-14)
    with pytest.raises(ValueError, match="zero direction"):
        ellipsoid.complement(np.zeros(n))


def test_shadow_of_a_slanted_ellipse_is_not_its_section() -> None:
    turn = np.array([[1.0, -1.0], [1.0, 1.0]]) / np.sqrt(2.0)
    Q = turn @ np.diag([1.0, 0.01]) @ turn.T
    radius = float(np.sqrt(ellipsoid.shadow(Q, [1.0, 0.0])[0, 0]))
    assert radius == pytest.approx(np.sqrt(0.505), rel=1e-12)
    assert round(radius, 2) == 0.71


def test_shadow_holds_every_projected_point(rng: np.random.Generator) -> None:
    Q, V = random_shape(rng, 6, 6), rng.normal(size=6)
    U = ellipsoid.complement(V)
    points = unit_vectors(rng, 5000, 6) @ ellipsoid.root(Q)
    assert ellipsoid.contains(ellipsoid.shadow(Q, V), points @ U).all()


@pytest.mark.parametrize("r", [0, 1, 3, 6])
def test_oblique_projector_laws(rng: np.random.Generator, r: int) -> None:
    N, C = rng.normal(size=(r, 6)), rng.normal(size=(6, r))
    projector, correction = ellipsoid.oblique_projector(N, C)
    np.testing.assert_allclose(projector @ projector, projector, atol=1e-10)
    np.testing.assert_allclose(N @ projector, 0.0, atol=1e-10)
    np.testing.assert_allclose(projector @ C, 0.0, atol=1e-10)
    np.testing.assert_allclose(N @ correction, np.eye(r), atol=1e-10)


def test_facet_image_slides_every_point_onto_the_facet(rng: np.random.Generator) -> None:
    Q, N, V = random_shape(rng, 6, 6), rng.normal(size=6), rng.normal(size=6)
    points = unit_vectors(rng, 5000, 6) @ ellipsoid.root(Q)
    slid = points - np.outer(points @ N / (N @ V), V)
    assert ellipsoid.contains(ellipsoid.facet_image(Q, N, V), slid).all()
    assert float(ellipsoid.support(ellipsoid.facet_image(Q, N, V), N)) < 1e-7


def test_directions_that_miss_a_contact_are_refused() -> None:
    N = np.eye(6)[:2]
    with pytest.raises(InfeasibleError, match=r"do not reach all contact rows.*pass independent contact rows"):
        ellipsoid.oblique_projector(N, np.eye(6)[:, :1] @ np.ones((1, 2)))
    with pytest.raises(ValueError, match="zero"):
        ellipsoid.oblique_projector(np.zeros((1, 6)), np.eye(6)[:, :1])
    with pytest.raises(ValueError, match="expected"):
        ellipsoid.oblique_projector(N, np.eye(6))


@pytest.mark.parametrize(("rank1", "rank2"), [(6, 6), (2, 6), (1, 1), (3, 2)])
def test_outer_sum_contains_sums_and_has_least_trace(rng: np.random.Generator, rank1: int, rank2: int) -> None:
    weights = ellipsoid.metric(0.3)
    Q1, Q2 = random_shape(rng, 6, rank1), random_shape(rng, 6, rank2)
    total = ellipsoid.outer_sum(Q1, Q2, weights)
    u, v = unit_vectors(rng, 20000, 6), unit_vectors(rng, 20000, 6)
    assert ellipsoid.contains(total, u @ ellipsoid.root(Q1) + v @ ellipsoid.root(Q2)).all()
    N = rng.normal(size=(1000, 6))
    assert (ellipsoid.support(total, N) >= ellipsoid.support(Q1, N) + ellipsoid.support(Q2, N) - 1e-12).all()
    least = np.diag(total) @ weights**2
    for p in np.geomspace(1e-3, 1e3, 61):
        assert np.diag((1.0 + 1.0 / p) * Q1 + (1.0 + p) * Q2) @ weights**2 >= least * (1.0 - 1e-12)


def test_outer_sum_with_a_point_and_in_any_order(rng: np.random.Generator) -> None:
    weights = ellipsoid.metric(0.02)
    Q1, Q2, Q3 = (random_shape(rng, 6, rank) for rank in (1, 6, 2))
    np.testing.assert_array_equal(ellipsoid.outer_sum(Q1, np.zeros((6, 6)), weights), Q1)
    np.testing.assert_array_equal(ellipsoid.outer_sum(np.zeros((6, 6)), Q1, weights), Q1)
    left = ellipsoid.outer_sum(ellipsoid.outer_sum(Q1, Q2, weights), Q3, weights)
    right = ellipsoid.outer_sum(Q1, ellipsoid.outer_sum(Q2, Q3, weights), weights)
    np.testing.assert_allclose(left, right, rtol=1e-12, atol=1e-15)


@pytest.mark.parametrize("half_widths", [[1.0, 2.0, 0.5, 1e-3, 2e-3, 3e-3], [1.0, 0.0, 0.5, 0.0, 0.0, 3e-3]])
def test_box_touches_its_ellipsoid_at_the_corners(half_widths: list[float]) -> None:
    a = np.array(half_widths)
    Q = ellipsoid.box_shape(a)
    corners = np.array(list(product((-1.0, 1.0), repeat=6))) * a
    axes = a > 0.0
    np.testing.assert_allclose(np.sum(corners[:, axes] ** 2 / np.diag(Q)[axes], axis=1), 1.0, rtol=1e-14)
    assert np.linalg.matrix_rank(Q) == axes.sum()


def test_box_refuses_negative_half_widths() -> None:
    with pytest.raises(ValueError, match="negative"):
        ellipsoid.box_shape([1.0, -1.0])


def test_zonotope_shape_holds_every_corner_and_touches_orthogonal_ones(rng: np.random.Generator) -> None:
    weights = ellipsoid.metric(0.02)
    signs = np.array(list(product((-1.0, 1.0), repeat=5)))
    G = rng.normal(size=(5, 6))
    assert ellipsoid.contains(ellipsoid.zonotope_shape(G, weights), signs @ G).all()
    box = ellipsoid.zonotope_shape(np.diag([1.0, 2.0, 3.0, 0.0, 0.1, 0.2]), weights)
    corner = np.array([1.0, 2.0, 3.0, 0.0, 0.1, 0.2])
    assert ellipsoid.contains(box, corner[None]).all()
    assert not ellipsoid.contains(box, 1.0001 * corner[None]).any()
    np.testing.assert_array_equal(ellipsoid.zonotope_shape(np.zeros((0, 6)), weights), np.zeros((6, 6)))
