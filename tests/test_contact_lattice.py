"""The face lattice from incidences: two ways to it agree, its counts follow Euler, its order is that of faces."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

from fmopt.contact import lattice
from fmopt.contact.lattice import Bits, closed_faces, different, numberable, ordered, simple_faces
from fmopt.contact.polytope import enumerate_faces
from fmopt.values import Array


def corners_of(rows: int, r: int, seed: int, bounded: bool) -> tuple[Array, Bits]:
    """Corners (m, r) and incidences (m, rows + 1) of half-spaces in general position, found by trying all of them."""
    rng = np.random.default_rng(seed)
    normals = rng.normal(size=(rows, r))
    normals = np.vstack([normals, -normals.sum(axis=0)]) if bounded else np.abs(normals)
    levels = -rng.uniform(0.5, 2.0, len(normals))
    found, incidence = [], []
    k = len(normals)
    for chosen in combinations(range(k), r):
        x = np.linalg.solve(normals[list(chosen)], levels[list(chosen)])
        if (normals @ x >= levels - 1e-9).all():
            found.append(x)
            incidence.append(np.isin(np.arange(k + 1), chosen))
    for chosen in combinations(range(k), r - 1):
        ray = np.linalg.svd(normals[list(chosen)])[2][-1]
        for way in (ray, -ray):
            if (normals @ way >= -1e-9).all():
                found.append(way)
                incidence.append(np.isin(np.arange(k + 1), [*chosen, k]))
    return np.array(found), np.array(incidence)


@pytest.mark.parametrize("bounded", [True, False])
@pytest.mark.parametrize(("rows", "r"), [(5, 2), (7, 3), (8, 4)])
def test_subsets_and_closed_sets_are_the_same_faces(rows: int, r: int, bounded: bool) -> None:
    corners, incidence = corners_of(rows, r, seed=rows, bounded=bounded)
    active, dimensions, points = simple_faces(corners, incidence)
    other, orders, centres = closed_faces(corners, incidence)
    order = ordered(other, orders)
    assert np.array_equal(active, other[order])
    assert np.array_equal(dimensions, r - active.sum(axis=1))
    assert np.array_equal(dimensions, orders[order])
    np.testing.assert_allclose(points, centres[order], atol=1e-12)


@pytest.mark.parametrize("table", [0, 10**9])
def test_a_table_and_a_sort_number_alike(table: int, monkeypatch: pytest.MonkeyPatch) -> None:
    corners, incidence = corners_of(8, 4, seed=1, bounded=True)
    found = simple_faces(corners, incidence)
    monkeypatch.setattr(lattice, "_TABLE", table)
    for one, other in zip(found, simple_faces(corners, incidence), strict=True):
        assert np.array_equal(one, other)


@pytest.mark.parametrize("seed", range(1, 5))
def test_faces_follow_euler_and_come_in_order(seed: int) -> None:
    normals = np.random.default_rng(seed).normal(size=(24, 6))
    faces = enumerate_faces(normals, -np.linalg.norm(normals, axis=1))
    bounded = not faces.lineality and sum((-1) ** int(d) for d in faces.dimensions) == 1
    assert bounded
    assert np.array_equal(ordered(faces.active, faces.dimensions), np.arange(len(faces.points)))
    for active, dimension, point in zip(faces.active, faces.dimensions, faces.points, strict=True):
        slack = normals @ point + np.linalg.norm(normals, axis=1)
        assert active.sum() == 6 - dimension
        assert np.abs(slack[active]).max(initial=0.0) < 1e-7
        assert slack[~active].min() > 0.0


def test_different_rows_come_in_their_order_and_first() -> None:
    bits = np.random.default_rng(0).random((200, 70)) < 0.02
    found = different(bits)
    listed = [tuple(row) for row in bits.tolist()]
    assert [listed[i] for i in found] == sorted(set(listed))
    assert all(listed.index(listed[i]) == i for i in found)


def test_numbers_too_large_to_hold_their_place_are_sorted_by_it(monkeypatch: pytest.MonkeyPatch) -> None:
    digits = np.array([[1, 5, 9], [2, 5, 9], [1, 5, 7]], dtype=np.float64)
    subsets = lattice._subsets(3)
    monkeypatch.setattr(lattice, "_TABLE", 0)
    narrow, wide = (lattice._numbered(digits, subsets, base) for base in (10, 2**20 - 1))
    for one, other in zip(narrow, wide, strict=True):
        assert np.array_equal(one, other)


def test_numbers_that_would_not_be_exact_are_not_used() -> None:
    assert numberable(200, 6)
    assert not numberable(500, 6)
