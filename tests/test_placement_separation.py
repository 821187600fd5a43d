"""Segments and facets: separating hyperplanes that hold, exact distances, clearance that never falls."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from placement_instances import translations

from fmopt.errors import InfeasibleError
from fmopt.placement.clearance import Flat, Metric, max_min_clearance
from fmopt.placement.separation import Facet, distance, place_among, separator

METRIC = Metric(0.5, 1.0)
EYE = np.eye(6)


def box_facet(half: np.ndarray) -> Facet:
    return Facet(Flat.everything(), np.vstack([EYE, -EYE]), np.concatenate([half, half]))


def corner(x: float, y: float) -> Facet:
    """What lies left of x and below y."""
    return Facet(Flat.everything(), EYE[:2], np.array([x, y]))


@pytest.mark.parametrize("seed", range(8))
def test_point_to_box_is_exact(seed: int) -> None:
    rng = np.random.default_rng(seed)
    half, pose = rng.uniform(0.5, 2.0, 6), 3.0 * rng.normal(size=6)
    exact = np.linalg.norm(METRIC.sigma * np.maximum(np.abs(pose) - half, 0.0))
    assert distance(pose[None], box_facet(half), METRIC).room(pose[None]) == pytest.approx(exact, abs=1e-6)


@pytest.mark.parametrize("seed", range(8))
def test_separators_hold_for_the_whole_facet(seed: int) -> None:
    rng = np.random.default_rng(seed)
    half = rng.uniform(0.5, 2.0, 6)
    poses = 3.0 * rng.normal(size=(2, 6))
    found = distance(poses, box_facet(half), METRIC)
    corners = half * rng.choice([-1.0, 1.0], size=(200, 6))
    assert (corners @ found.a).max() <= found.beta + 1e-12
    assert METRIC.dual_norm(found.a) == pytest.approx(1.0, abs=1e-12)
    nearest = min(
        float(np.linalg.norm(METRIC.sigma * np.maximum(np.abs(p) - half, 0.0)))
        for p in poses[0] + np.linspace(0, 1, 401)[:, None] * (poses[1] - poses[0])
    )
    assert found.room(poses) <= nearest + 1e-9
    assert nearest < 1e-2 or found.room(poses) == pytest.approx(nearest, rel=1e-3)


def test_the_interior_of_a_segment_counts() -> None:
    # From (2, −1) to (−1, 2) past the corner (0, 0): nearest at (½, ½), though both ends are farther.
    poses = np.zeros((2, 6))
    poses[:, :2] = [[2.0, -1.0], [-1.0, 2.0]]
    assert distance(poses, corner(0.0, 0.0), METRIC).room(poses) == pytest.approx(np.sqrt(0.5), abs=1e-7)


def test_overlap_is_negative() -> None:
    pose = np.zeros((1, 6))
    pose[0, :2] = [-0.5, -2.0]
    assert distance(pose, corner(0.0, 0.0), METRIC).room(pose) == pytest.approx(-0.5, abs=1e-9)


def test_distance_is_measured_within_the_state() -> None:
    # On the line x = y the obstacle x ≤ 0 is √2 times as far.
    facet = Facet(Flat(EYE[[0]] - EYE[[1]], np.zeros(1)), EYE[[0]], np.zeros(1))
    pose = np.zeros((1, 6))
    pose[0, :2] = 1.0
    assert distance(pose, facet, METRIC).room(pose) == pytest.approx(np.sqrt(2.0), abs=1e-7)


def test_an_empty_facet_and_a_constant_one_are_refused() -> None:
    with pytest.raises(InfeasibleError):
        distance(np.full((1, 6), 5.0), Facet(Flat.everything(), np.vstack([EYE[0], -EYE[0]]), [0.0, -1.0]), METRIC)
    with pytest.raises(ValueError, match="constant"):
        distance(np.zeros((1, 6)), Facet(Flat(EYE[[0]], [0.0]), EYE[[0]], [0.0]), METRIC)


def test_multipliers_that_cancel_give_no_separator() -> None:
    facet = Facet(Flat.everything(), np.vstack([EYE[0], -EYE[0]]), [1.0, 1.0])
    assert separator(facet, np.zeros(0), np.ones(2), METRIC) is None


def test_placing_round_a_corner_reaches_the_optimum_by_hand() -> None:
    # Corner obstacle at the origin, walls at 3: (a, a) with a √2 = 3 − a; its own planes alone give 1.5.
    problem = translations([[-1, 0, 0], [0, -1, 0]], [-3, -3])
    assert place_among(problem, [corner(0.0, 0.0)])[0].value == pytest.approx(1.5, abs=1e-7)
    guess = np.array([[1.0, 0.5, 0.0, 0.0, 0.0, 0.0]])
    solution, kept = place_among(problem, [corner(0.0, 0.0)], guess=guess, rounds=60)
    a = 3.0 / (1.0 + np.sqrt(2.0))
    assert solution.value == pytest.approx(3.0 - a, abs=1e-4)
    assert solution.x[:2] == pytest.approx([a, a], abs=1e-2)
    assert kept[0].a[:2] == pytest.approx([np.sqrt(0.5)] * 2, abs=1e-2)


@pytest.mark.parametrize("seed", range(5))
def test_clearance_never_falls_over_the_rounds(seed: int) -> None:
    rng = np.random.default_rng(seed)
    facets = [corner(*rng.uniform(-2.0, 0.0, 2)), Facet(Flat.everything(), -EYE[:2], rng.uniform(-4.0, -2.0, 2))]
    start = np.concatenate([rng.uniform(0.0, 2.0, 3), np.zeros(3)])
    problem = translations([[-1, 0, 0], [0, 1, 0]], [-5, -5], start=Flat.point(start))
    values = [place_among(problem, facets, rounds=n)[0].value for n in (1, 2, 4, 8)]
    assert all(b >= a - 1e-9 for a, b in pairwise(values))
    solution, kept = place_among(problem, facets, rounds=8)
    ends = solution.x[:-1].reshape(2, 6)
    assert min(s.room(ends) for s in kept) >= solution.value - 1e-8


def test_without_facets_it_is_max_min() -> None:
    problem = translations([[1, 0, 0], [-1, 0, 0]], [0, -3])
    assert place_among(problem, [])[0].value == max_min_clearance(problem).value
