"""The shortest route through convex sets with a bound on it: the answer, and the relaxation that bounds it, whole."""

from __future__ import annotations

import numpy as np
import pytest
from pydrake.geometry.optimization import GraphOfConvexSets, GraphOfConvexSetsOptions, VPolytope
from pydrake.solvers import Binding, Cost, L2NormCost
from pytest_benchmark.fixture import BenchmarkFixture

from fmopt.planning.optimise.convex_route import ConvexSets, shortest_route
from tests.shared.parts.convex_sets import in_space

SETS = [in_space(50, seed) for seed in range(8)]


def relaxed(sets: ConvexSets) -> float:
    """The relaxation as Drake poses it, solved by Clarabel."""
    graph = GraphOfConvexSets()
    vertices = [graph.AddVertex(VPolytope(corners.T), str(i)) for i, corners in enumerate(sets.corners)]
    apart = np.hstack([np.eye(6), -np.eye(6)])
    for u, v in sets.arcs[(sets.arcs[:, 1] != 0) & (sets.arcs[:, 0] != len(vertices) - 1)]:
        edge = graph.AddEdge(vertices[u], vertices[v])
        distance = L2NormCost(apart, np.zeros(6))
        edge.AddCost(Binding[Cost](distance, np.concatenate([edge.xu(), edge.xv()])))
    options = GraphOfConvexSetsOptions()
    options.convex_relaxation, options.preprocessing, options.max_rounded_paths = True, False, 0
    found = graph.SolveShortestPath(vertices[0], vertices[-1], options)
    assert found.is_success()
    return float(found.get_optimal_cost())


@pytest.mark.benchmark(group="a route through 50 convex sets in six dimensions")
@pytest.mark.parametrize("gap", [0.05, 0.03, 0.01])
def test_route_and_bound(benchmark: BenchmarkFixture, gap: float) -> None:
    found = benchmark(lambda: [shortest_route(sets, 0, 49, gap) for sets in SETS])
    benchmark.extra_info["gaps"] = [route.gap for route in found]
    assert max(route.gap for route in found) <= gap + 1e-9


@pytest.mark.benchmark(group="a route through 50 convex sets in six dimensions")
def test_the_relaxation_whole(benchmark: BenchmarkFixture) -> None:
    few = SETS if benchmark.enabled else SETS[:1]
    bounds = benchmark.pedantic(lambda: [relaxed(sets) for sets in few], rounds=1)
    for sets, bound in zip(few, bounds, strict=True):
        found = shortest_route(sets, 0, 49)
        assert found.lower_bound <= bound * (1.0 + 1e-6) <= found.cost * (1.0 + 2e-6)
