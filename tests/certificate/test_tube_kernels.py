"""The compiled kernels of the error tube: as they are written, and as the plain formulas have them."""

from typing import Any

import numpy as np
import pytest

from fmopt.certificate import rows, tube
from fmopt.certificate.kernels_ellipsoids import narrow, outer_sum
from fmopt.certificate.remainder import Curvature
from fmopt.certificate.rows import Forms, edges_apart, faces_above, points_above, stacked
from fmopt.spatial import ellipsoid
from fmopt.spatial.se3 import Pose
from fmopt.spatial.values import Array

RHO = 0.014


def written(kernel: Any) -> Any:
    """A kernel as it is written, not compiled."""
    return kernel.py_func


def unit(rng: np.random.Generator, count: int) -> Array:
    found = rng.normal(size=(count, 3))
    return np.asarray(found / np.linalg.norm(found, axis=1)[:, None])


def mixed(rng: np.random.Generator) -> Forms:
    """Rows of all kinds."""
    (e_m, e_f), points = unit(rng, 2), rng.uniform(-0.02, 0.02, (4, 3))
    above, below = points_above(points, unit(rng, 4), 0.01), faces_above(unit(rng, 4), 0.01, points)
    return stacked(above, edges_apart(e_m, e_f, points[0], points), below)


def bent(seed: int) -> tuple[Curvature, Array]:
    """How mixed rows bend along a piece of motion, and its twist."""
    rng = np.random.default_rng(seed)
    forms, start = mixed(rng), Pose.from_vector(rng.uniform(-0.02, 0.02, 6))
    twist = rng.uniform(-0.01, 0.01, 6)
    return Curvature.of(*forms.over(start, start.moved(twist)), twist), twist


@pytest.mark.parametrize("seed", range(4))
def test_kernels_of_rows_do_what_is_written(seed: int) -> None:
    curvature, twist = bent(seed)
    bending = curvature.bending
    rng = np.random.default_rng(seed)
    half, motion = rng.uniform(0.0, 0.01, 6), rng.normal(size=6)
    links = np.append(rng.uniform(0.0, 0.01, 4), 0.1)
    turn = float(np.linalg.norm(twist[3:]))
    coupling = tube.coupled(links, half, turn)
    np.testing.assert_allclose(coupling, written(tube.coupled)(links, half, turn), rtol=1e-13)
    calls = (tube.left, (bending, half, coupling)), (tube.varied, (bending, half, motion)), (tube.powers, (bending,))
    for kernel, arguments in calls:
        np.testing.assert_allclose(kernel(*arguments), written(kernel)(*arguments), rtol=1e-12, atol=1e-18)
    poses = [Pose.from_vector(rng.normal(size=6)) for _ in range(3)]
    at = np.array([pose.p for pose in poses]), np.array([pose.R for pose in poses])
    for compiled, plain in zip(rows._at(bending.table, *at), written(rows._at)(bending.table, *at), strict=True):
        np.testing.assert_allclose(compiled, plain, rtol=1e-13, atol=1e-17)


@pytest.mark.parametrize(("first", "second"), [(6, 6), (3, 2), (6, 0), (0, 4)])
def test_sums_of_ellipsoids_are_those_of_the_plain_formula(first: int, second: int) -> None:
    rng = np.random.default_rng(first)
    F1, F2 = rng.normal(size=(6, first)), rng.normal(size=(6, second)) * 1e-3
    found = narrow(outer_sum(F1, F2, RHO))
    expected = ellipsoid.outer_sum(F1, F2, ellipsoid.metric(RHO))
    assert found.shape[1] <= 6
    np.testing.assert_allclose(found @ found.T, expected @ expected.T, rtol=1e-12, atol=1e-18)
    np.testing.assert_allclose(found, written(narrow)(written(outer_sum)(F1, F2, RHO)), rtol=1e-12, atol=1e-18)


def test_a_flat_ellipsoid_stays_flat_when_its_root_is_narrowed() -> None:
    """Along a direction without extent the reach stays at rounding of the root, not of the shape matrix."""
    F = np.random.default_rng(3).normal(size=(6, 14))
    N = np.array([0.6, 0.0, 0.8, 0.0, 0.0, 0.0])
    F -= np.outer(N, N @ F)
    assert np.linalg.norm(N @ narrow(F)) < 1e-14
