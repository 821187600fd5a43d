"""Rows of distances: gradients against differences, remainders against samples, supports against their definition."""

import numpy as np
import pytest

from fmopt.certificate.rows import (
    Extent,
    Forms,
    directions_along,
    edges_apart,
    faces_above,
    points_above,
    remainders,
    stacked,
)
from fmopt.se3 import Pose, exp, turns
from fmopt.values import Array

KINDS = ("points", "directions", "faces", "edges")
SAMPLES = 120


def unit(rng: np.random.Generator, count: int) -> Array:
    vectors = rng.normal(size=(count, 3))
    return np.asarray(vectors / np.linalg.norm(vectors, axis=1, keepdims=True))


def forms(kind: str, rng: np.random.Generator, count: int = 6) -> Forms:
    points = rng.uniform(-0.03, 0.03, (count, 3))
    if kind == "points":
        return points_above(points, unit(rng, count), rng.uniform(-0.03, 0.03, count))
    if kind == "directions":
        return directions_along(unit(rng, count) * 0.7, points)
    if kind == "faces":
        return faces_above(unit(rng, count), rng.uniform(-0.03, 0.03, count), points)
    return edges_apart(unit(rng, 1)[0], unit(rng, 1)[0], rng.uniform(-0.03, 0.03, 3), points)


def pose(rng: np.random.Generator) -> Pose:
    return Pose(rng.uniform(-0.02, 0.02, 3), exp(rng.normal(size=3)))


def test_many_poses_at_once_and_kinds_mixed_are_what_each_is_alone() -> None:
    rng = np.random.default_rng(7)
    parts, poses = [forms(kind, rng) for kind in KINDS], [pose(rng) for _ in range(5)]
    mixed = stacked(*parts)
    f, N = mixed.along(np.array([X.p for X in poses]), np.array([X.R for X in poses]))
    assert turns(np.array([[0.1, 0.2, 0.3], [0.0, 0.0, 0.0]])) == pytest.approx(
        np.array([exp([0.1, 0.2, 0.3]), np.eye(3)]), abs=1e-15
    )
    for k, X in enumerate(poses):
        alone = [part.at(X) for part in parts]
        assert f[k] == pytest.approx(np.concatenate([rows.f for rows in alone]), abs=1e-15)
        assert N[k] == pytest.approx(np.vstack([rows.N for rows in alone]), abs=1e-15)


@pytest.mark.parametrize("kind", KINDS)
def test_gradients_are_those_of_differences(kind: str) -> None:
    rng = np.random.default_rng(1)
    rows, X, h = forms(kind, rng), pose(rng), 1e-6
    N = rows.at(X).N
    for axis, step in enumerate(np.eye(6) * h):
        slope = (rows.at(X.moved(step)).f - rows.at(X.moved(-step)).f) / (2.0 * h)
        np.testing.assert_allclose(N[:, axis], slope, atol=1e-9)


def test_edge_rows_are_the_distance_to_the_plane_along_both_edges() -> None:
    rng = np.random.default_rng(2)
    e_m, e_f = unit(rng, 2)
    q, points, X = rng.normal(size=3), rng.normal(size=(4, 3)), pose(rng)
    expected = (X.apply(points) - q) @ np.cross(X.R @ e_m, e_f)
    np.testing.assert_allclose(edges_apart(e_m, e_f, q, points).at(X).f, expected, atol=1e-14)


def excesses(kind: str, turn: float, theta: float, seed: int) -> Array:
    """|f − linear prediction| over the remainder, for sampled errors at sampled places of a piece; (samples, rows)."""
    rng = np.random.default_rng(seed)
    rows, start = forms(kind, rng), pose(rng)
    w = unit(rng, 1)[0] * turn
    travel = rng.uniform(-2e-3, 2e-3, 3) * (turn > 0.0)
    goal = Pose(start.p + travel, exp(w) @ start.R)
    offset = np.array([4e-4, 1e-4, 0.0])
    at_start, at_goal = rows.over(start, goal)
    allowed = remainders(at_start, at_goal, Extent(turn, travel, theta, offset))
    found = []
    for _ in range(SAMPLES):
        errors = np.hstack([rng.choice([-1.0, 1.0], (2, 3)) * offset, unit(rng, 2) * theta])
        s = rng.choice([0.0, 0.5, 1.0, rng.uniform()])
        e = (1.0 - s) * errors[0] + s * errors[1]
        real = Pose(start.p + s * travel + e[:3], exp(e[3:]) @ exp(s * w) @ start.R)
        linear = (1.0 - s) * (at_start.f + at_start.N @ errors[0]) + s * (at_goal.f + at_goal.N @ errors[1])
        found.append(np.abs(rows.at(real).f - linear) / allowed)
    return np.array(found)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(("turn", "theta"), [(0.02, 0.012), (0.1, 0.02), (0.0, 0.03), (0.05, 0.0)])
def test_no_sample_leaves_the_remainder(kind: str, turn: float, theta: float) -> None:
    assert max(excesses(kind, turn, theta, seed).max() for seed in range(3)) <= 1.0 + 1e-9


@pytest.mark.parametrize("kind", KINDS)
def test_half_the_remainder_would_not_do(kind: str) -> None:
    worst = max(
        excesses(kind, turn, theta, seed).max() for turn, theta in ((0.0, 0.03), (0.05, 0.0)) for seed in range(3)
    )
    assert worst > 0.5
