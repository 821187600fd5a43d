"""One placement by each route: persistent and fresh cone solvers, fresh CVXPY; one NLP, built and solved apart."""

from __future__ import annotations

import numpy as np
import pytest
from placement_instances import linearised, peg_placement, random_placement
from pytest_benchmark.fixture import BenchmarkFixture

from fmopt.placement import socp
from fmopt.placement.clearance import max_min_clearance
from fmopt.placement.formation import formation_solver
from fmopt.placement.lp import LinearSolver
from fmopt.placement.nlp import place_on_surfaces
from fmopt.placement.program import as_cvxpy

GROWING = random_placement(0, rows=80, contacts=2, growth=0.02).program()
VALUE = socp.ClarabelSolver().solve(GROWING).value
STATE = ("tipx++", "tipx+-")


@pytest.mark.benchmark(group="placement as SOCP")
def test_socp_with_a_persistent_solver(benchmark: BenchmarkFixture) -> None:
    assert benchmark(socp.ClarabelSolver().solve, GROWING).value == pytest.approx(VALUE, rel=1e-7)


@pytest.mark.benchmark(group="placement as SOCP")
def test_socp_with_a_fresh_solver(benchmark: BenchmarkFixture) -> None:
    def solve() -> float:
        socp._local.__dict__.clear()
        return socp.ClarabelSolver().solve(GROWING).value

    assert benchmark(solve) == pytest.approx(VALUE, rel=1e-7)


@pytest.mark.benchmark(group="placement as SOCP")
def test_socp_through_fresh_cvxpy(benchmark: BenchmarkFixture) -> None:
    scaled, unit = GROWING.scaled(), GROWING.size.objective

    def solve() -> float:
        problem, _ = as_cvxpy(scaled)
        problem.solve(solver="CLARABEL")
        return float(problem.value)

    assert benchmark(solve) * unit == pytest.approx(VALUE, rel=1e-6)


@pytest.mark.benchmark(group="placement of the square peg on two contacts")
def test_linear_program(benchmark: BenchmarkFixture) -> None:
    problem = linearised(peg_placement(STATE), np.zeros(6))
    assert benchmark(max_min_clearance, problem, LinearSolver()).value > 0.0


@pytest.mark.benchmark(group="placement of the square peg on two contacts")
def test_cone_program(benchmark: BenchmarkFixture) -> None:
    problem = linearised(peg_placement(STATE), np.zeros(6))
    assert benchmark(max_min_clearance, problem).value > 0.0


@pytest.mark.benchmark(group="placement of the square peg on two contacts")
def test_nlp_solved(benchmark: BenchmarkFixture) -> None:
    problem = peg_placement(STATE)
    place_on_surfaces(problem)
    assert benchmark(place_on_surfaces, problem).value > 0.0


@pytest.mark.benchmark(group="placement of the square peg on two contacts")
def test_nlp_built(benchmark: BenchmarkFixture) -> None:
    contacts, obstacles = (2, 0, 0, 0), (6, 0, 8, 0)  # vertex–face and edge–edge rows of STATE and of what it leaves
    assert benchmark.pedantic(formation_solver.__wrapped__, (contacts, obstacles), rounds=5) is not None
