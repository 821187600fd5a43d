"""The face lattice from incidences: two ways to it agree, its counts follow Euler, its order is that of faces."""

from __future__ import annotations

from itertools import combinations, pairwise

import numpy as np
import pytest

from fmopt.contact.closed_sets import closed_sets
from fmopt.contact.face_lattice import (
    Bits,
    closed_faces,
    covers,
    distinct,
    ordered,
    simple_faces,
    subset_rows,
    subset_tree,
)
from fmopt.contact.polytope import enumerate_faces
from fmopt.spatial.values import Array


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
    found = distinct(bits)
    listed = [tuple(row) for row in bits.tolist()]
    assert [listed[i] for i in found] == sorted(set(listed))
    assert all(listed.index(listed[i]) == i for i in found)


def subsets_of(incidence: Bits) -> list[tuple[int, ...]]:
    """All subsets of the rows of each corner but those at infinity, by size and then in order."""
    end = incidence.shape[1] - 1
    held = [np.flatnonzero(row).tolist() for row in incidence]
    found = {some for rows in held for size in range(len(rows) + 1) for some in combinations(rows, size)}
    return sorted((some for some in found if end not in some), key=lambda some: (len(some), some))


@pytest.mark.parametrize(("m", "k", "r"), [(1, 5, 3), (40, 9, 2), (200, 12, 6), (50, 130, 7)])
def test_the_tree_holds_every_subset_and_who_has_it(m: int, k: int, r: int) -> None:
    rng = np.random.default_rng(k)
    incidence = np.array([np.isin(np.arange(k + 1), rng.choice(k + 1, r, replace=False)) for _ in range(m)])
    parents, columns, begins, rows = subset_tree(incidence, r)
    active, sizes = subset_rows(parents, columns, k)
    expected = subsets_of(incidence)
    assert [tuple(np.flatnonzero(row).tolist()) for row in active] == expected
    assert sizes.tolist() == [len(some) for some in expected]
    for i, some in enumerate(expected):
        assert rows[begins[i] : begins[i + 1]].tolist() == np.flatnonzero(incidence[:, some].all(axis=1)).tolist()


@pytest.mark.parametrize(("m", "q"), [(1, 1), (12, 6), (64, 9), (150, 12), (300, 16)])
def test_closed_sets_are_all_intersections(m: int, q: int) -> None:
    incidence = np.random.default_rng(m).random((m, q)) < np.append(np.full(q - 1, 0.7), 0.0 if q < 9 else 0.2)
    own = [frozenset(np.flatnonzero(column).tolist()) for column in incidence.T]
    expected = {frozenset(range(m))}
    for column in own:
        expected |= {some & column for some in expected}
    active, dimensions, begins, rows = closed_sets(incidence)
    found = [frozenset(rows[begin:end].tolist()) for begin, end in pairwise(begins)]
    assert len(found) == len(set(found))
    assert set(found) == {some for some in expected if not some <= own[-1]}
    for i, some in enumerate(found):
        assert active[i].tolist() == [some <= column for column in own]
        dimension, rest = -1, some
        while rest:
            smaller = (rest & column for column in own if rest & column < rest)
            dimension, rest = dimension + 1, max(smaller, key=len, default=frozenset[int]())
        assert dimensions[i] == dimension


def test_covers_are_pairs_one_dimension_apart() -> None:
    normals = np.random.default_rng(9).normal(size=(70, 4))
    faces = enumerate_faces(normals, -np.linalg.norm(normals, axis=1))
    sons, son, fathers, father = covers(faces.active, faces.dimensions)
    more = faces.active @ faces.active.T.astype(np.float64) == faces.active.sum(axis=1)
    expected = more & (faces.dimensions[:, None] + 1 == faces.dimensions)
    for i in range(len(faces.points)):
        assert son[sons[i] : sons[i + 1]].tolist() == np.flatnonzero(expected[:, i]).tolist()
        assert father[fathers[i] : fathers[i + 1]].tolist() == np.flatnonzero(expected[i]).tolist()
