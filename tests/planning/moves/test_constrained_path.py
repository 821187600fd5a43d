"""Kernels that keep contacts along a motion, against the plain formulas; compiled and as they are written."""

from typing import Any

import numpy as np
import pytest

from fmopt.certificate.kernels_rows import ROW
from fmopt.certificate.rows import Forms, points_above, stacked
from fmopt.contact.c_surface import Surfaces, heights, records
from fmopt.contact.definitions import CONTACTS
from fmopt.planning.moves import constrained_path as keeping
from fmopt.planning.moves.constrained_path import KEPT, LOST, SINGULAR
from fmopt.spatial.se3 import Pose, turns
from fmopt.spatial.values import Array
from tests.shared.parts.contact_cases import CASES, PEG
from tests.shared.random_rows import KINDS, forms, pose

Kernel = Any
# An edge of each part, both along x, the fixed one a metre below.
PAIR = np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, 0.0, -1.0])
LEVEL = tuple(records(one, PAIR if name == "edge_edge" else np.zeros((0, one.width))) for name, one in CONTACTS.items())


def both(kernel: Kernel) -> tuple[Kernel, Kernel]:
    """A kernel, compiled and as it is written."""
    return kernel, kernel.py_func


def state(rng: np.random.Generator, count: int) -> tuple[Forms, Array, Pose]:
    """Functions of mixed kinds that vanish at a pose, twists that they determine, and the pose."""
    here = pose(rng)
    table = stacked(*(forms(kind, rng, 1) for kind in KINDS)).table[rng.permutation(4)[:count]]
    table["c"] += Forms(table).at(here).f
    return Forms(table), Forms(table).at(here).N + 0.2 * rng.normal(size=(count, 6)), here


@pytest.mark.parametrize("seed", range(6))
def test_poses_are_put_back_along_the_twists_until_the_functions_vanish(seed: int) -> None:
    rng = np.random.default_rng(seed)
    held, C, here = state(rng, 1 + seed % 4)
    off = [here.moved(1e-3 * rng.normal(size=6)) for _ in range(3)]
    for kernel in both(keeping.onto):
        p, R = np.array([X.p for X in off]), np.array([X.R for X in off])
        assert kernel(held.table, C, p, R) == KEPT
        assert np.abs(held.rows(p, R).f).max() < 1e-15
        for n, X in enumerate(off):
            there = X
            for _ in range(8):
                rows = held.at(there)
                there = there.moved(-C.T @ np.linalg.solve(rows.N @ C.T, rows.f))
            assert p[n] == pytest.approx(there.p, abs=1e-14)
            assert R[n] == pytest.approx(there.R, abs=1e-14)


def test_what_cannot_be_kept_is_said() -> None:
    height = points_above(np.zeros((1, 3)), np.array([0.0, 0.0, 1.0]), 0.01).table
    for kernel in both(keeping.onto):
        for twist, expected in (((0.0, 0.0, 1.0), KEPT), ((1.0, 0.0, 0.0), SINGULAR), ((1.0, 0.0, 1e-3), LOST)):
            C = np.array([[*twist, 0.0, 0.0, 0.0]])
            assert kernel(height, C, np.zeros((1, 3)), np.eye(3)[None].copy()) == expected
    for kernel in both(keeping.repeated):
        C, p, R = np.array([[1.0, 0.0, 0.0, 0.0, 0.0, 0.0]]), np.zeros((2, 3)), np.array([np.eye(3)] * 2)
        assert kernel((height, C), np.zeros(6), np.zeros((1, 1)), True, p, R) == SINGULAR


@pytest.mark.parametrize("seed", range(4))
def test_pieces_share_a_twist_but_for_the_compliance(seed: int) -> None:
    rng = np.random.default_rng(seed)
    held, C, here = state(rng, seed)
    twist = 1e-3 * rng.normal(size=6)
    for kernel in both(keeping.repeated):
        p, R, gives = np.empty((5, 3)), np.empty((5, 3, 3)), np.zeros((4, seed))
        p[0], R[0] = here.p, here.R
        for fresh in (True, False):
            assert kernel((held.table, C), twist, gives, fresh, p, R) == KEPT
            for n in range(4):
                there = Pose(p[n], R[n]).moved(twist + C.T @ gives[n])
                assert p[n + 1] == pytest.approx(there.p, abs=1e-16)
                assert R[n + 1] == pytest.approx(there.R, abs=1e-15)
            assert np.abs(held.rows(p, R).f).max(initial=0.0) < 1e-15


@pytest.mark.parametrize("case", CASES)
def test_distances_are_those_of_the_surfaces(case: Any) -> None:
    fixed, contacts, here = case
    surfaces = Surfaces.of(contacts, PEG, fixed)
    X = 1e-2 * np.random.default_rng(0).normal(size=(7, 6))
    p, R = here.p + X[:, :3], turns(X[:, 3:]) @ here.R
    for kernel in both(heights):
        found = np.empty((7, len(contacts)))
        kernel(surfaces.tables, p, R, found)
        np.testing.assert_allclose(found[:, surfaces.order], surfaces.heights(p, R), rtol=0.0, atol=1e-16)


def test_level_edges_have_no_distance() -> None:
    for kernel in both(heights):
        found = np.empty((1, 1))
        kernel(LEVEL, np.zeros((1, 3)), np.eye(3)[None].copy(), found)
        assert np.isnan(found).all()


def test_edges_that_turn_level_jump_from_side_to_side_where_they_do() -> None:
    tables, free = LEVEL, (np.zeros(0, ROW), np.zeros((0, 6)))
    motion = np.eye(3), np.zeros(3), np.zeros(3), np.array([0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
    between, p, R, values = np.array([-0.5, 0.5]), np.empty((2, 3)), np.empty((2, 3, 3)), np.empty((2, 1))
    assert keeping.along(free, motion, between, p, R) == KEPT
    heights(tables, p, R, values)
    ends = values if values[0] > 0.0 else values[::-1].copy()
    for kernel in both(keeping.roots):
        found = np.empty(1)
        assert kernel(free, motion, tables, np.array([0]), (between, ends), found) == KEPT
        assert found[0] == 0.0


@pytest.mark.parametrize("seed", [0, 1, 2, 4])
def test_a_motion_turns_about_its_pivot_and_ends_where_a_distance_vanishes(seed: int) -> None:
    rng = np.random.default_rng(seed)
    fixed, contacts, _ = CASES[0]
    held, C, here = state(rng, seed % 3)
    surfaces = Surfaces.of(contacts, PEG, fixed)
    pivot, twist, amounts = rng.normal(size=3) * 0.01, rng.normal(size=6), np.linspace(0.0, 0.06, 5)
    motion = np.array(here.R), pivot, here.apply(pivot), twist
    p, R = np.empty((5, 3)), np.empty((5, 3, 3))
    for kernel in both(keeping.along):
        assert kernel((held.table, C), motion, amounts, p, R) == KEPT
        assert np.abs(held.rows(p, R).f).max(initial=0.0) < 1e-15
        for n, amount in enumerate(amounts if not seed % 3 else amounts[:1]):
            turned = turns(amount * twist[None, 3:])[0] @ here.R
            assert R[n] == pytest.approx(turned, abs=1e-15)
            assert p[n] == pytest.approx(here.apply(pivot) + amount * twist[:3] - turned @ pivot, abs=1e-16)
    values = np.empty((5, len(contacts)))
    heights(surfaces.tables, p, R, values)
    crossing = np.flatnonzero((values[0] > 0.0) & (values[-1] <= 0.0))
    assert len(crossing)
    for kernel in both(keeping.roots):
        found = np.empty(len(crossing))
        bracket = np.array([amounts[0], amounts[-1]]), values[[0, -1]][:, crossing]
        assert kernel((held.table, C), motion, surfaces.tables, crossing, bracket, found) == KEPT
        p, R = np.empty((len(found), 3)), np.empty((len(found), 3, 3))
        keeping.along((held.table, C), motion, found, p, R)
        at = np.empty((len(found), len(contacts)))
        heights(surfaces.tables, p, R, at)
        assert np.abs(np.diagonal(at[:, crossing])).max() < 1e-15
        assert ((found >= amounts[0]) & (found <= amounts[-1])).all()
