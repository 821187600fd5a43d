"""Corners and what lies on them from the facets of the dual, and which planes are the same."""

from __future__ import annotations

from typing import Any, cast

import numpy as np
import pytest

from fmopt.contact.half_spaces import INCIDENCE, corners_of, first_equal, row_space


@pytest.mark.parametrize(("m", "k", "r"), [(1, 4, 1), (30, 17, 5), (50, 80, 6)])
def test_corners_and_their_incidences_follow_the_formula(m: int, k: int, r: int) -> None:
    rng = np.random.default_rng(k)
    rows, equations = rng.normal(size=(k, r)), rng.normal(size=(m, r + 1))
    rows /= np.linalg.norm(rows, axis=1)[:, None]
    equations[:, r] = np.where(rng.random(m) < 0.3, 0.0, -np.abs(equations[:, r]))
    levels = np.where(rng.random(k) < 0.5, -1.0, rows @ (-equations[0, :r] / (-equations[0, r] or 1.0)))
    corners, incidence, simple = corners_of(equations, rows, levels)
    finite = equations[:, r] < 0.0
    expected = -equations[:, :r] / np.where(finite, -equations[:, r], 1.0)[:, None]
    slack = expected @ rows.T - np.where(finite[:, None], levels, 0.0)
    on = slack <= INCIDENCE * np.maximum(1.0, np.linalg.norm(expected, axis=1))[:, None]
    np.testing.assert_allclose(corners, expected, rtol=1e-14)
    assert np.array_equal(incidence, np.column_stack([on, ~finite]))
    assert simple == (incidence.sum(axis=1) == r).all()


def test_corners_on_as_many_planes_as_dimensions_are_simple() -> None:
    square = np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]])
    facets = np.array([[x, y, -1.0] for x in (-1.0, 1.0) for y in (-1.0, 1.0)])
    assert corners_of(facets, square, -np.ones(4))[2]
    cut = np.vstack([square, np.full(2, np.sqrt(0.5))])
    assert not corners_of(facets, cut, np.append(-np.ones(4), -np.sqrt(2.0)))[2]


def test_rows_that_are_equal_are_told_by_the_first_of_them() -> None:
    rng = np.random.default_rng(2)
    kinds = rng.normal(size=(9, 6)) * 10.0 ** rng.integers(-3, 4, size=(9, 1))
    of = rng.integers(9, size=40)
    rows = kinds[of] * (1.0 + 1e-10 * rng.uniform(-1.0, 1.0, size=(40, 1)))
    expected = np.array([np.flatnonzero(of == kind)[0] for kind in of])
    assert np.array_equal(first_equal(rows), expected)
    assert np.array_equal(cast("Any", first_equal).py_func(rows), expected)
    assert len(first_equal(np.empty((0, 6)))) == 0


@pytest.mark.parametrize(("k", "n", "rank"), [(1, 6, 1), (16, 6, 5), (40, 6, 2), (3, 7, 3), (9, 6, 0)])
def test_the_row_space_has_orthonormal_columns_that_hold_the_rows(k: int, n: int, rank: int) -> None:
    rng = np.random.default_rng(k)
    rows = rng.normal(size=(k, rank)) @ rng.normal(size=(rank, n)) * 10.0 ** rng.integers(-2, 3, size=(k, 1))
    basis = row_space(rows)
    assert basis.shape == (n, rank)
    np.testing.assert_allclose(basis.T @ basis, np.eye(rank), atol=1e-14)
    np.testing.assert_allclose(rows @ basis @ basis.T, rows, atol=1e-11)


def test_rows_that_span_everything_keep_their_axes() -> None:
    assert np.array_equal(row_space(np.random.default_rng(0).normal(size=(9, 4))), np.eye(4))
    nearly = np.array([[1.0, 0.0], [1.0, 1e-8]])
    assert row_space(nearly).shape == (2, 1)
