"""Ellipsoids by roots of their shape matrices: images, shadows, sums, and what they must contain."""

from itertools import product

import numpy as np
import pytest

from fmopt.errors import InfeasibleError
from fmopt.spatial import ellipsoid
from fmopt.spatial.values import Array
from fmopt.verify.arithmetic.rational import ArithmeticRefusal, fixed, inverse
from tests.shared.in_ellipsoid import contains


def reach(F: Array, N: Array) -> Array:
    """How far the ellipsoid reaches along rows N (k, n)."""
    return np.asarray(np.linalg.norm(N @ F, axis=1))


def random_root(rng: np.random.Generator, n: int, rank: int) -> Array:
    return rng.normal(size=(n, rank)) * 10.0 ** rng.uniform(-2.0, 0.0, rank)


def unit_vectors(rng: np.random.Generator, k: int, n: int) -> Array:
    u = rng.normal(size=(k, n))
    return np.asarray(u / np.linalg.norm(u, axis=1, keepdims=True))


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(7)


@pytest.mark.parametrize("rank", [0, 1, 3, 6, 11])
def test_roots_are_of_the_same_ellipsoid(rng: np.random.Generator, rank: int) -> None:
    F = random_root(rng, 6, rank)
    N = rng.normal(size=(50, 6))
    for root in (ellipsoid.root(F @ F.T), ellipsoid.narrow(F, 6)):
        assert root.shape[1] <= 6
        np.testing.assert_allclose(root @ root.T, F @ F.T, atol=1e-13)
        np.testing.assert_allclose(reach(root, N), reach(F, N), atol=1e-7)
        assert contains(F, root @ unit_vectors(rng, 1000, root.shape[1]).T, 1e-7).all()
    assert ellipsoid.root(np.diag([4.0, 0.0, 9.0])).tolist() == [[2.0, 0.0], [0.0, 0.0], [0.0, 3.0]]


def test_membership_knows_inside_and_outside(rng: np.random.Generator) -> None:
    F = random_root(rng, 6, 6)
    surface = F @ unit_vectors(rng, 1000, 6).T
    assert contains(F, surface, 1e-12).all()
    assert not contains(F, 1.001 * surface, 1e-12).any()
    flat = random_root(rng, 6, 3)
    off = np.linalg.svd(flat)[0][:, -1:]
    assert contains(flat, flat @ unit_vectors(rng, 10, 3).T, 1e-9).all()
    assert not contains(flat, flat @ unit_vectors(rng, 10, 3).T + 1e-6 * off, 1e-9).any()


def test_image_is_exact(rng: np.random.Generator) -> None:
    F, A, N = random_root(rng, 6, 6), rng.normal(size=(4, 6)), rng.normal(size=(20, 4))
    turned = ellipsoid.root(ellipsoid.image(F @ F.T, A))
    np.testing.assert_allclose(reach(turned, N), reach(F, N @ A), rtol=1e-9)


def test_the_shadow_of_a_slanted_ellipse_is_not_its_section() -> None:
    """The sound cross-section of a tube along x is the shadow; that of [DakinPopplestone1993] eq. 9 lies inside."""
    turn = np.array([[1.0, -1.0], [1.0, 1.0]]) / np.sqrt(2.0)
    Q = turn @ np.diag([1.0, 0.01]) @ turn.T
    radius = float(np.sqrt(ellipsoid.image(Q, np.array([[0.0, 1.0]]))[0, 0]))
    assert radius == pytest.approx(np.sqrt(0.505), rel=1e-12)
    assert round(radius, 2) == 0.71


@pytest.mark.parametrize("r", [0, 1, 3, 6])
def test_oblique_projector_laws(rng: np.random.Generator, r: int) -> None:
    N, C = rng.normal(size=(r, 6)), rng.normal(size=(6, r))
    projector, correction = ellipsoid.oblique_projector(N, C)
    np.testing.assert_allclose(projector @ projector, projector, atol=1e-10)
    np.testing.assert_allclose(N @ projector, 0.0, atol=1e-10)
    np.testing.assert_allclose(projector @ C, 0.0, atol=1e-10)
    np.testing.assert_allclose(N @ correction, np.eye(r), atol=1e-10)


def test_points_slide_into_the_image_on_a_facet(rng: np.random.Generator) -> None:
    F, N, V = random_root(rng, 6, 6), rng.normal(size=6), rng.normal(size=6)
    points = F @ unit_vectors(rng, 5000, 6).T
    slid = points - np.outer(V, N @ points / (N @ V))
    projector, _ = ellipsoid.oblique_projector(N[None], V[:, None])
    assert contains(projector @ F, slid, 1e-12).all()
    assert float(np.linalg.norm(N @ projector @ F)) < 1e-14


def test_directions_that_miss_a_contact_are_refused() -> None:
    N = np.eye(6)[:2]
    with pytest.raises(InfeasibleError, match=r"do not reach all contact rows.*pass independent contact rows"):
        ellipsoid.oblique_projector(N, np.eye(6)[:, :1] @ np.ones((1, 2)))
    with pytest.raises(ValueError, match="zero"):
        ellipsoid.oblique_projector(np.zeros((1, 6)), np.eye(6)[:, :1])
    with pytest.raises(ValueError, match="expected"):
        ellipsoid.oblique_projector(N, np.eye(6))


@pytest.mark.parametrize(("rank1", "rank2"), [(6, 6), (2, 6), (1, 1), (3, 2), (14, 8)])
def test_outer_sum_contains_sums_and_has_least_trace(rng: np.random.Generator, rank1: int, rank2: int) -> None:
    weights = ellipsoid.metric(0.3)
    F1, F2 = random_root(rng, 6, rank1), random_root(rng, 6, rank2)
    total = ellipsoid.outer_sum(F1, F2, weights)
    u, v = unit_vectors(rng, 20000, rank1).T, unit_vectors(rng, 20000, rank2).T
    assert contains(total, F1 @ u + F2 @ v, 1e-9).all()
    N = rng.normal(size=(1000, 6))
    assert (reach(total, N) >= reach(F1, N) + reach(F2, N) - 1e-12).all()
    least = ((weights[:, None] * total) ** 2).sum()
    for p in np.geomspace(1e-3, 1e3, 61):
        Q = (1.0 + 1.0 / p) * F1 @ F1.T + (1.0 + p) * F2 @ F2.T
        assert np.diag(Q) @ weights**2 >= least * (1.0 - 1e-12)


def test_outer_sum_with_a_point_and_in_any_order(rng: np.random.Generator) -> None:
    weights = ellipsoid.metric(0.02)
    F1, F2, F3 = (random_root(rng, 6, rank) for rank in (1, 6, 2))
    for point in (np.zeros((6, 6)), np.zeros((6, 0))):
        np.testing.assert_array_equal(ellipsoid.outer_sum(F1, point, weights), F1)
        np.testing.assert_array_equal(ellipsoid.outer_sum(point, F1, weights), F1)
    left = ellipsoid.outer_sum(ellipsoid.outer_sum(F1, F2, weights), F3, weights)
    right = ellipsoid.outer_sum(F1, ellipsoid.outer_sum(F2, F3, weights), weights)
    np.testing.assert_allclose(left @ left.T, right @ right.T, rtol=1e-10, atol=1e-13)


def test_sums_keep_flat_directions_flat(rng: np.random.Generator) -> None:
    N = rng.normal(size=6)
    P = np.eye(6) - np.outer(N, N) / (N @ N)
    F, G = P @ (rng.normal(size=(6, 6)) * 1e-3), P @ (rng.normal(size=(6, 8)) * 1e-4)
    total = ellipsoid.outer_sum(F, G, ellipsoid.metric(0.014))
    assert total.shape[1] <= 18
    assert np.linalg.norm(N @ total) < 1e-17
    # The control: the same direction through the shape matrix is noise.
    assert abs(float(N @ (total @ total.T) @ N)) > np.linalg.norm(N @ total) ** 2


@pytest.mark.parametrize("half_widths", [[1.0, 2.0, 0.5, 1e-3, 2e-3, 3e-3], [1.0, 0.0, 0.5, 0.0, 0.0, 3e-3]])
def test_box_touches_its_ellipsoid_at_the_corners(half_widths: list[float]) -> None:
    a = np.array(half_widths)
    F = ellipsoid.box_root(a)
    corners = np.array(list(product((-1.0, 1.0), repeat=6))).T * a[:, None]
    assert F.shape == (6, int((a > 0.0).sum()))
    assert contains(F, corners, 1e-12).all()
    assert not contains(F, 1.0001 * corners, 1e-12).any()


def test_box_refuses_negative_half_widths() -> None:
    with pytest.raises(ValueError, match="negative"):
        ellipsoid.box_root([1.0, -1.0])


@pytest.mark.parametrize("far", [0.9, 0.98, 0.995, 1.01, 30.0])
def test_directions_that_reach_contacts_go_no_farther_than_the_check_allows(far: float) -> None:
    """What the check refuses is refused, and next to nothing besides."""
    lever = 1.0 / (far * 2.0**16)  # m of a row for a rad of its direction
    rows, directions = np.array([[0.0, 0.0, 0.0, lever, 0.0, 0.0]]), np.eye(6)[:, 3:4]
    if far > 1.0:
        with pytest.raises(ArithmeticRefusal, match="hardly depend"):
            inverse([[fixed(lever)]])
    else:
        assert len(inverse([[fixed(lever)]])) == 1
    if far > 0.99:
        with pytest.raises(InfeasibleError, match="hardly reach"):
            ellipsoid.coupling_inverse(rows, directions)
    else:
        assert ellipsoid.coupling_inverse(rows, directions) == pytest.approx(1.0 / lever)
