"""The kernels of nearest twists against quadratic programs of another solver, the plain functions, and refusals."""

from typing import Any, cast

import daqp
import numpy as np
import pytest

from fmopt.planning.control.friction_cones import nearest, nearest_opening
from fmopt.spatial.values import Array


def held_rows() -> tuple[Array, Any, Array]:
    """A twist yet to be moved, no row that holds, no multipliers."""
    return np.zeros(6), np.zeros(7, dtype=np.intp), np.zeros(6)


def contacts(rng: np.random.Generator, count: int, friction: float = 0.3) -> tuple[Array, Array]:
    """Rows (m, 6) and (m, 2, 6) of contacts whose normals are not far apart."""
    normals = rng.normal(size=(count, 3)) + np.array([1.5, 1.5, 0.5])
    frames = np.array([np.linalg.svd(n[None])[2] for n in normals])
    frames[:, 0] *= np.sign(np.vecdot(frames[:, 0], normals))[:, None]
    arms = rng.normal(size=(count, 3))
    rows = np.concatenate([frames, np.cross(arms[:, None], frames)], axis=2)
    return np.ascontiguousarray(rows[:, 0]), np.ascontiguousarray(friction * rows[:, 1:])


@pytest.mark.parametrize("seed", range(30))
def test_the_nearest_twist_is_that_of_a_quadratic_program(seed: int) -> None:
    rng = np.random.default_rng(seed)
    point, rows, least = rng.normal(size=6), rng.normal(size=(int(rng.integers(1, 12)), 6)), float(rng.integers(0, 2))
    rows[-1] = rows[0]
    none, kinds = np.full(len(rows), 1e30), np.zeros(len(rows), dtype=np.int32)
    x, _, flag, _ = daqp.solve(np.eye(6), -point, rows, none, np.full(len(rows), least), kinds, primal_tol=1e-11)
    twist, held, force = held_rows()
    twist[:] = point
    settled = nearest(point, rows, least, twist, held, force)
    assert settled == (flag == 1)
    if settled:
        assert np.allclose(twist, x, rtol=0.0, atol=1e-9)
        number = held[6]
        assert (force[:number] >= 0.0).all()
        assert np.allclose(point + force[:number] @ rows[held[:number]], twist, rtol=0.0, atol=1e-12)
        assert np.allclose(rows[held[:number]] @ twist, least, rtol=0.0, atol=1e-11)


def test_rows_that_come_later_join_those_that_hold_already() -> None:
    rng = np.random.default_rng(7)
    for _ in range(20):
        point, rows = rng.normal(size=6), rng.normal(size=(9, 6))
        rows[:, 0] = np.abs(rows[:, 0]) + 0.2
        twist, held, force = held_rows()
        twist[:] = point
        for count in (3, 6, 9):
            assert nearest(point, rows[:count], 1.0, twist, held, force)
        once, at, by = held_rows()
        once[:] = point
        assert nearest(point, rows, 1.0, once, at, by)
        assert np.allclose(once, twist, rtol=0.0, atol=1e-10)


def test_rows_that_contradict_each_other_are_not_settled() -> None:
    row = np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    twist, held, force = held_rows()
    assert not nearest(np.zeros(6), np.array([row, -row]), 1.0, twist, held, force)


@pytest.mark.parametrize("count", [1, 2, 4, 8])
def test_the_kernel_does_what_its_function_says(count: int) -> None:
    rng = np.random.default_rng(count)
    plain = cast("Any", nearest_opening).py_func
    for _ in range(10):
        normal, tangent = contacts(rng, count)
        for wrench, least in ((rng.normal(size=6), 0.0), (np.zeros(6), 1.0)):
            (twist, settled), (other, also) = (f(wrench, normal, tangent, least) for f in (nearest_opening, plain))
            assert settled == also
            assert not settled or np.allclose(twist, other, rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("count", [1, 3, 6])
def test_what_is_settled_opens_and_lies_where_friction_leaves_it(count: int) -> None:
    """By Moreau's theorem: v opens all contacts, and v − w is a sum of rays across v."""
    rng = np.random.default_rng(20 + count)
    for _ in range(20):
        (normal, tangent), wrench = contacts(rng, count), rng.normal(size=6)
        twist, settled = nearest_opening(wrench, normal, tangent, 0.0)
        assert settled
        assert (normal @ twist - np.linalg.norm(tangent @ twist, axis=1)).min() >= -1e-9 * np.linalg.norm(wrench)
        assert abs(float(twist @ (twist - wrench))) <= 1e-9 * float(wrench @ wrench)


def test_contacts_that_face_each_other_open_by_no_twist() -> None:
    normal, tangent = contacts(np.random.default_rng(1), 1)
    both = np.vstack([normal, -normal]), np.concatenate([tangent, tangent])
    assert not nearest_opening(np.zeros(6), *both, 1.0)[1]
    assert nearest_opening(np.ones(6), *both, 0.0)[1]
