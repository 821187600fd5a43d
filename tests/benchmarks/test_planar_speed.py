"""Planar uncertainty sets: one boundary, and Cc of polygons as vertices and orientations grow."""

from __future__ import annotations

import math

import numpy as np
import pytest
from pytest_benchmark.fixture import BenchmarkFixture

from fmopt.papers.basanez_suarez.c_obstacle import PossibleContacts
from fmopt.papers.basanez_suarez.motion import classify
from fmopt.papers.basanez_suarez.profile import Profile
from fmopt.papers.basanez_suarez.sources import Deviations


def gon(n: int, radius: float) -> Profile:
    theta = 2.0 * math.pi * np.arange(n) / n
    return Profile.of(radius * np.stack([np.cos(theta), np.sin(theta)], axis=-1))


def total(n: int) -> Deviations:
    return Deviations(np.full(n, 1e-4), 2e-4, 0.005, 2e-5)


def all_round(n: int, orientations: int) -> float:
    """Area of Cc of two n-gons, 20 mm and 60 mm across, over a full turn, from nothing, to 50 µm."""
    possible = PossibleContacts.between(gon(n, 0.01), gon(n, 0.03), total(n))
    phi = 2.0 * math.pi * np.arange(orientations) / orientations
    return sum(polygon.area for polygon in possible.polygons(phi, 5e-5))


@pytest.mark.benchmark(group="Cc of two n-gons, 360 orientations")
@pytest.mark.parametrize("n", [5, 10, 20, 40])
def test_vertices(benchmark: BenchmarkFixture, n: int) -> None:
    assert benchmark.pedantic(all_round, (n, 360), rounds=3) > 0.0


@pytest.mark.benchmark(group="Cc of two 20-gons")
@pytest.mark.parametrize("orientations", [90, 180, 360, 720])
def test_orientations(benchmark: BenchmarkFixture, orientations: int) -> None:
    assert benchmark.pedantic(all_round, (20, orientations), rounds=3) > 0.0


@pytest.mark.benchmark(group="one CUl")
def test_exact_boundary(benchmark: BenchmarkFixture) -> None:
    cu = PossibleContacts.between(gon(20, 0.01), gon(20, 0.03), total(20)).sets[-1]
    assert benchmark(cu.at(0.3).boundary)


@pytest.mark.benchmark(group="one CUl")
def test_thousand_memberships(benchmark: BenchmarkFixture) -> None:
    cu = PossibleContacts.between(gon(20, 0.01), gon(20, 0.03), total(20)).sets[-1]
    points = np.random.default_rng(1).normal(size=(1000, 2)) * 0.03
    assert benchmark(cu.at(0.3).contains, points).shape == (1000,)


@pytest.mark.benchmark(group="one motion past a 20-gon")
def test_classification(benchmark: BenchmarkFixture) -> None:
    path = [(-0.1, 0.0395, 0.0), (0.1, 0.0395, 1.0)]
    assert len(benchmark(classify, path, gon(20, 0.03), gon(20, 0.01), total(20), 1e-5)) > 1
