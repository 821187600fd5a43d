"""Faces of local contact spaces: counts known from the literature and by hand, Euler's relation, refusals."""

from math import comb

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fmopt.contact.polytope import PolytopeFaces, enumerate_faces, first_equal
from fmopt.contact.primitive import near_contacts
from fmopt.contact.state_graph import LocalSpace, Scale, faces, local_space
from fmopt.errors import InfeasibleError
from tests.shared.parts.square import MID_DEPTH, block, peg

WALLS = np.array([(0, 0, 1), (0, 1, 0), (1, 0, 0), (-1, 0, 0), (0, -1, 0)], dtype=float)
CUBE = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
RHO = 0.5 * np.hypot(0.02, 0.02)


def corner(walls: int) -> np.ndarray:
    return np.array([[*n, *np.cross(v, n)] for n in WALLS[:walls] for v in CUBE if v @ n == -1.0])


def mid_depth(x: float = 0.0202, y: float = 0.0202) -> LocalSpace:
    fixed = block(x, y)
    contacts = near_contacts(peg(), fixed, MID_DEPTH, reach=1e-3, angle=0.02)
    return local_space(contacts, peg(), fixed, MID_DEPTH, Scale(1e-4, RHO))


@pytest.mark.parametrize(("walls", "modes"), [(1, 10), (2, 46), (3, 136), (4, 10), (5, 2)])
def test_contact_modes_of_a_cube_in_a_corner(walls: int, modes: int) -> None:
    found = enumerate_faces(corner(walls), np.zeros(4 * walls))
    assert len(found.active) == modes
    check(found, corner(walls), np.zeros(4 * walls))


def test_mid_depth_square_peg_has_243_faces() -> None:
    found = faces(mid_depth())
    assert (found.lineality, found.count()) == (1, {6: 1, 5: 16, 4: 56, 3: 88, 2: 64, 1: 18})
    check(found, mid_depth().normals, mid_depth().offsets)


def test_unequal_clearances_give_259_faces() -> None:
    assert len(faces(mid_depth(0.0202, 0.02024)).active) == 259


def test_the_count_does_not_depend_on_units_or_on_repeated_rows() -> None:
    space = mid_depth()
    N, D = np.repeat(space.normals, 2, axis=0), np.repeat(space.offsets, 2)
    factors = np.random.default_rng(1).uniform(0.1, 10.0, len(D))
    found = enumerate_faces(N * factors[:, None], D * factors)
    assert len(found.active) == 243
    np.testing.assert_array_equal(found.active[:, ::2], found.active[:, 1::2])


def test_linear_distances_are_the_true_ones_in_clearances() -> None:
    np.testing.assert_allclose(mid_depth().offsets * -1e-4, 1e-4 / row_sizes(), rtol=1e-12)


def row_sizes() -> np.ndarray:
    # Wall contacts: lever 10 mm along the wall; mouth contacts: also 15 mm up.
    clearance_per_angle = 1.0 / RHO
    wall = np.sqrt(1.0 + (0.01 * clearance_per_angle) ** 2)
    mouth = np.sqrt(1.0 + (0.01 * clearance_per_angle) ** 2 + (0.015 * clearance_per_angle) ** 2)
    return np.array([wall] * 8 + [mouth] * 8)


@pytest.mark.parametrize("n", [1, 2, 3, 4])
def test_cubes_and_simplices(n: int) -> None:
    cube = enumerate_faces(np.vstack([np.eye(n), -np.eye(n)]), -np.ones(2 * n))
    assert cube.count() == {d: comb(n, d) * 2 ** (n - d) for d in range(n + 1)}
    simplex = enumerate_faces(np.vstack([np.eye(n), -np.ones(n)]), -np.ones(n + 1))
    assert simplex.count() == {d: comb(n + 1, d + 1) for d in range(n + 1)}


def test_degenerate_and_unbounded_polyhedra() -> None:
    cross = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
    assert enumerate_faces(cross, -np.ones(8)).count() == {0: 6, 1: 12, 2: 8, 3: 1}
    assert enumerate_faces(np.eye(3), np.ones(3)).count() == {0: 1, 1: 3, 2: 3, 3: 1}
    assert enumerate_faces(np.array([[0.0, 0.0, 2.0]]), np.ones(1)).count() == {2: 1, 3: 1}
    slab = enumerate_faces(np.array([[1.0, 0.0], [-1.0, 0.0]]), np.array([1.0, -1.0]))
    assert slab.count() == {1: 1}
    assert slab.active.all()


def test_a_row_that_touches_in_one_vertex_belongs_to_it() -> None:
    square = np.array([[1, 0], [0, 1], [-1, 0], [0, -1], [1, 1]], dtype=float)
    found = enumerate_faces(square, np.array([0.0, 0.0, -1.0, -1.0, 0.0]))
    assert found.count() == {0: 4, 1: 4, 2: 1}
    assert found.active.tolist().count([True, True, False, False, True]) == 1


def test_rows_that_are_equal_are_told_by_the_first_of_them() -> None:
    rng = np.random.default_rng(2)
    kinds = rng.normal(size=(9, 6)) * 10.0 ** rng.integers(-3, 4, size=(9, 1))
    of = rng.integers(9, size=40)
    rows = kinds[of] * (1.0 + 1e-10 * rng.uniform(-1.0, 1.0, size=(40, 1)))
    assert np.array_equal(first_equal(rows), [np.flatnonzero(of == kind)[0] for kind in of])
    assert len(first_equal(np.empty((0, 6)))) == 0


@pytest.mark.parametrize("seed", range(3))
def test_corners_that_rounding_tells_apart_are_one(seed: int) -> None:
    cross = np.stack(np.meshgrid(*[[-1.0, 1.0]] * 4), axis=-1).reshape(-1, 4)
    levels = -1.0 + 2e-8 * np.random.default_rng(seed).uniform(-1.0, 1.0, 16)
    assert enumerate_faces(cross, levels).count() == {0: 8, 1: 24, 2: 32, 3: 16, 4: 1}


@pytest.mark.parametrize("seed", range(5))
def test_lines_in_a_polyhedron_change_nothing_but_dimensions(seed: int) -> None:
    rng = np.random.default_rng(seed)
    rows, levels = rng.integers(-1, 2, size=(9, 3)) + 0.0, -rng.integers(0, 2, size=9) - 0.0
    rows, levels = np.vstack([np.eye(3), rows[rows.any(axis=1)]]), np.append(-np.ones(3), levels[rows.any(axis=1)])
    within, found = enumerate_faces(rows, levels), enumerate_faces(rows @ rng.normal(size=(3, 6)), levels)
    assert (found.lineality, found.active.tolist()) == (3, within.active.tolist())
    assert found.dimensions.tolist() == (within.dimensions + 3).tolist()


def test_no_common_point_is_refused() -> None:
    with pytest.raises(InfeasibleError, match="no common point") as caught:
        enumerate_faces(np.array([[1.0], [-1.0]]), np.array([1.0, 1.0]))
    assert caught.value.shortfall == pytest.approx(1.0)


@settings(max_examples=40, deadline=None, derandomize=True)
@given(st.integers(2, 4), st.integers(0, 12), st.integers(0, 2**31), st.booleans())
def test_euler_on_random_polytopes(n: int, extra: int, seed: int, lattice: bool) -> None:
    rng = np.random.default_rng(seed)
    # Small whole numbers make degenerate vertices, real ones simple polytopes; the box keeps both bounded.
    rows = rng.integers(-2, 3, (extra, n)).astype(float) if lattice else rng.normal(size=(extra, n))
    rows = rows[np.any(rows != 0.0, axis=1)]
    N = np.vstack([np.eye(n), -np.eye(n), rows])
    D = -np.ones(len(N)) * np.where(np.arange(len(N)) < 2 * n, 2.0, 1.0)
    found = enumerate_faces(N, D)
    counts = found.count()
    assert sum((-1) ** d * counts[d] for d in counts) == 1
    check(found, N, D)


def check(found: PolytopeFaces, N: np.ndarray, D: np.ndarray) -> None:
    """Each face holds exactly its active rows at its point, has the right dimension, and no two are equal."""
    slack = found.points @ N.T - D
    assert np.all(np.abs(slack[found.active]) < 1e-9)
    assert np.all(slack[~found.active] > 1e-7)
    for active, dimension in zip(found.active, found.dimensions, strict=True):
        assert dimension == N.shape[1] - np.linalg.matrix_rank(N[active], tol=1e-9)
    assert len(np.unique(found.active, axis=0)) == len(found.active)
    assert np.all(np.diff(found.dimensions) <= 0)


def test_scaling() -> None:
    np.testing.assert_allclose(Scale(1e-4, 0.01).units, [1e-4] * 3 + [0.01] * 3)
