"""Cut-diagrams and expansions as the instances grow in number: a drilled plate, and a heap of tilted bodies."""

from __future__ import annotations

import math

import numpy as np
import pytest
from pytest_benchmark.fixture import BenchmarkFixture

from fmopt.geometry.csg import Box, Cone, Cylinder, Difference, Placed, Solid, Union
from fmopt.geometry.plane.curve import Arc
from fmopt.geometry.plane.region import Region, polygon_region
from fmopt.papers.lee_huang.cut_diagram import cut_diagram
from fmopt.papers.lee_huang.shrink_expand import expanded, expanded_turning
from fmopt.spatial.se3 import Pose, exp

COUNTS = [10, 100, 1000]
PLANE = Pose(np.array([0.0, 0.0, 0.05]), np.eye(3))
SQUARE = polygon_region([(-0.1, -0.1), (0.1, -0.1), (0.1, 0.1), (-0.1, 0.1)])
DISC = Region(((Arc(np.zeros(2), 0.12, 0.0, math.tau),),))


def plate(count: int, bore: Solid) -> Solid:
    """A plate with a bore in every field of a grid."""
    side = math.ceil(math.sqrt(count))
    places = [np.array([k % side + 0.5, k // side + 0.5, -0.1]) for k in range(count)]
    body = Placed(Box((side, side, 0.2)), Pose(np.array([0.5 * side, 0.5 * side, 0.0]), np.eye(3)))
    return Difference(body, tuple(Placed(bore, Pose(p, exp([0.0, 0.0, 0.1 * k]))) for k, p in enumerate(places)))


def heap(count: int) -> Solid:
    """Boxes, cylinders and cones, tilted, as dense whatever their number, so that most overlap some others."""
    rng = np.random.default_rng(1)
    kinds = [Box((0.8, 0.6, 1.0)), Cylinder(0.4, 1.0), Cone(0.5, 0.2, 1.0)]
    places = [np.array([*rng.uniform(0.0, math.sqrt(count), 2), -0.4]) for _ in range(count)]
    return Union(tuple(Placed(kinds[k % 3], Pose(p, exp(0.3 * rng.normal(size=3)))) for k, p in enumerate(places)))


def row(count: int) -> list[Region]:
    """Sections of a moving operand's instances, side by side."""
    return [SQUARE.moved(np.eye(2), (0.15 * k / count, 0.05 * math.sin(k))) for k in range(count)]


@pytest.mark.benchmark(group="cut-diagram of a drilled plate")
@pytest.mark.parametrize("count", COUNTS)
def test_cut_diagram_of_a_plate(benchmark: BenchmarkFixture, count: int) -> None:
    assert len(benchmark.pedantic(cut_diagram, (plate(count, Cylinder(0.3, 0.4)), PLANE), rounds=3).loops) == count + 1


@pytest.mark.benchmark(group="cut-diagram of a heap")
@pytest.mark.parametrize("count", COUNTS)
def test_cut_diagram_of_a_heap(benchmark: BenchmarkFixture, count: int) -> None:
    assert benchmark.pedantic(cut_diagram, (heap(count), PLANE), rounds=3).area > 0.3 * count


@pytest.mark.benchmark(group="expansion of a drilled plate by a disc")
@pytest.mark.parametrize("count", COUNTS)
def test_round_expansion(benchmark: BenchmarkFixture, count: int) -> None:
    G = cut_diagram(plate(count, Cylinder(0.3, 0.4)), PLANE)
    assert len(benchmark.pedantic(expanded, (G, [DISC]), rounds=3).loops) == count + 1


@pytest.mark.benchmark(group="expansion of a plate with square holes by a square")
@pytest.mark.parametrize("count", COUNTS)
def test_polygonal_expansion(benchmark: BenchmarkFixture, count: int) -> None:
    G = cut_diagram(plate(count, Box((0.4, 0.4, 0.4))), PLANE)
    assert len(benchmark.pedantic(expanded, (G, [SQUARE]), rounds=3).loops) == count + 1


@pytest.mark.benchmark(group="expansion of a heap by a square")
@pytest.mark.parametrize("count", [10, 100, 300])
def test_expansion_of_a_heap(benchmark: BenchmarkFixture, count: int) -> None:
    G = cut_diagram(heap(count), PLANE)
    assert benchmark.pedantic(expanded, (G, [SQUARE]), rounds=3).area > G.area


@pytest.mark.benchmark(group="expansion of a hole by moving instances")
@pytest.mark.parametrize("count", COUNTS)
def test_expansion_by_many_instances(benchmark: BenchmarkFixture, count: int) -> None:
    G = cut_diagram(plate(1, Box((0.8, 0.8, 0.4))), PLANE)
    assert len(benchmark.pedantic(expanded, (G, row(count)), rounds=3).loops) == 2


@pytest.mark.benchmark(group="expansion of a plate with square holes by a turning square")
@pytest.mark.parametrize("count", COUNTS)
def test_turning_expansion(benchmark: BenchmarkFixture, count: int) -> None:
    G = cut_diagram(plate(count, Box((0.4, 0.4, 0.4))), PLANE)
    assert benchmark.pedantic(expanded_turning, (G, [SQUARE], (-0.1, 0.2)), rounds=3).area > G.area
