"""The face lattice from incidences: it agrees with sets of numbers, follows Euler, and comes in order."""

import numpy as np
import pytest

from fmopt.contact.face_lattice import closed_sets, covers
from fmopt.contact.polytope import enumerate_faces


@pytest.mark.parametrize("seed", range(1, 5))
def test_faces_follow_euler_and_come_in_order(seed: int) -> None:
    normals = np.random.default_rng(seed).normal(size=(24, 6))
    faces = enumerate_faces(normals, -np.linalg.norm(normals, axis=1))
    bounded = not faces.lineality and sum((-1) ** int(d) for d in faces.dimensions) == 1
    assert bounded
    order = [(-d, *~active) for d, active in zip(faces.dimensions.tolist(), faces.active, strict=True)]
    assert order == sorted(order)
    for active, dimension, point in zip(faces.active, faces.dimensions, faces.points, strict=True):
        slack = normals @ point + np.linalg.norm(normals, axis=1)
        assert active.sum() == 6 - dimension
        assert np.abs(slack[active]).max(initial=0.0) < 1e-7
        assert slack[~active].min() > 0.0


@pytest.mark.parametrize(("m", "q"), [(1, 1), (12, 6), (64, 9), (150, 12), (300, 16)])
def test_closed_sets_are_all_intersections(m: int, q: int) -> None:
    incidence = np.random.default_rng(m).random((m, q)) < np.append(np.full(q - 1, 0.7), 0.0 if q < 9 else 0.2)
    planes = [frozenset(np.flatnonzero(column).tolist()) for column in incidence.T]
    expected = {frozenset(range(m))}
    for plane in planes:
        expected |= {some & plane for some in expected}
    members, active, dimensions = closed_sets(incidence)
    sets = [frozenset(np.flatnonzero(row).tolist()) for row in members]
    assert len(sets) == len(set(sets))
    assert set(sets) == {some for some in expected if not some <= planes[-1]}
    for i, some in enumerate(sets):
        assert active[i].tolist() == [some <= plane for plane in planes[:-1]]
        dimension, rest = -1, some
        while rest:
            smaller = (rest & plane for plane in planes if rest & plane < rest)
            dimension, rest = dimension + 1, max(smaller, key=len, default=frozenset[int]())
        assert dimensions[i] == dimension


def test_covers_are_pairs_one_dimension_apart() -> None:
    normals = np.random.default_rng(9).normal(size=(20, 4))
    faces = enumerate_faces(normals, -np.linalg.norm(normals, axis=1))
    planes = [frozenset(np.flatnonzero(row).tolist()) for row in faces.active]
    expected = [
        [high < low and d == e + 1 for low, e in zip(planes, faces.dimensions.tolist(), strict=True)]
        for high, d in zip(planes, faces.dimensions.tolist(), strict=True)
    ]
    assert covers(faces.active, faces.dimensions).tolist() == expected
