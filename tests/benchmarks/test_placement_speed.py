"""One placement by each route: Clarabel, fresh CVXPY; one NLP, built and solved apart."""

from __future__ import annotations

from itertools import cycle
from typing import Any

import numpy as np
import pytest
from pytest_benchmark.fixture import BenchmarkFixture

from fmopt.planning.optimise import solvers
from fmopt.planning.optimise.cone_program import ConeProgram, Norm, as_cvxpy
from fmopt.planning.optimise.solvers import LinearSolver
from fmopt.planning.placement import nonlinear_program as nlp
from fmopt.planning.placement.formation import Counts, counts, formation_derivatives
from fmopt.planning.placement.largest_clearance import max_min_clearance
from fmopt.planning.placement.nonlinear_program import place_on_surfaces
from tests.shared.placement_instances import linearised, peg_placement, random_placement

GROWING = random_placement(0, rows=80, contacts=2, growth=0.02).program()
VALUE = solvers.ClarabelSolver().solve(GROWING).value
STATE = ("tipx++", "tipx+-")


@pytest.mark.benchmark(group="placement as SOCP")
def test_socp_with_a_persistent_solver(benchmark: BenchmarkFixture) -> None:
    assert benchmark(solvers.ClarabelSolver().solve, GROWING).value == pytest.approx(VALUE, rel=1e-7)


@pytest.mark.benchmark(group="placement as SOCP")
def test_socp_with_a_fresh_solver(benchmark: BenchmarkFixture) -> None:
    def solve() -> float:
        solvers._local.__dict__.clear()
        return solvers.ClarabelSolver().solve(GROWING).value

    assert benchmark(solve) == pytest.approx(VALUE, rel=1e-7)


@pytest.mark.benchmark(group="placement as SOCP")
def test_socp_through_fresh_cvxpy(benchmark: BenchmarkFixture) -> None:
    scaled, unit = GROWING.scaled(), GROWING.size.objective

    def solve() -> float:
        problem, _ = as_cvxpy(scaled)
        problem.solve(solver="CLARABEL")
        return float(problem.value)

    assert benchmark(solve) * unit == pytest.approx(VALUE, rel=1e-6)


def sequence_program(poses: int, rows: int) -> ConeProgram:
    """Poses in a row, each held off its own hyperplanes, with a drift that grows with the way to the next one."""
    rng = np.random.default_rng(poses)
    n = 6 * poses + 1
    G, W, norms = np.zeros((rows, n)), np.zeros((rows, poses)), []
    for row in range(rows):
        normal = rng.normal(size=6)
        G[row, 6 * (row % poses) : 6 * (row % poses) + 6] = normal / np.linalg.norm(normal)
    G[:, -1], W[np.arange(rows), np.arange(rows) % poses] = -1.0, 0.02
    for k in range(poses):
        F = np.zeros((6, n))
        F[:, 6 * k : 6 * k + 6] = np.eye(6)
        if k + 1 < poses:
            F[:, 6 * k + 6 : 6 * k + 12] = -np.eye(6)
        norms.append(Norm(F, rng.normal(size=6)))
    box = np.append(np.full(n - 1, 3.0), np.inf)
    goal = np.append(np.zeros(n - 1), 1.0)
    return ConeProgram(goal, G=G, h=rng.uniform(0.2, 1.2, rows), W=W, norms=tuple(norms), lower=-box, upper=box)


SIZES = {"8 variables": (1, 21), "22 variables": (3, 93), "29 variables": (4, 204)}


@pytest.mark.parametrize("name", SIZES)
def test_cone_program_by_clarabel_alone(benchmark: BenchmarkFixture, name: str) -> None:
    benchmark.group = f"cone program, {name}"
    program = sequence_program(*SIZES[name])
    settings = solvers.ClarabelSolver()
    M, rhs, cones = solvers.standard_form(program.scaled(), np.zeros(0, dtype=np.intp))
    q = np.append(-program.scaled().c, np.zeros(len(program.norms)))
    numbers = np.ascontiguousarray(M.T[M.T != 0.0])
    solver = solvers._build(settings, M, cones, rhs, q)

    def solve() -> float:
        solver.update(A=numbers, b=rhs, q=q)
        return -float(solver.solve().obj_val)

    assert benchmark(solve) * program.size.objective == pytest.approx(settings.solve(program).value, rel=1e-7)


@pytest.mark.parametrize("name", SIZES)
def test_cone_program_of_one_size(benchmark: BenchmarkFixture, name: str) -> None:
    benchmark.group = f"cone program, {name}"
    program = sequence_program(*SIZES[name])
    solution = benchmark(solvers.ClarabelSolver().solve, program)
    assert solution.duals is not None


@pytest.mark.parametrize("name", SIZES)
def test_cone_program_through_fresh_cvxpy(benchmark: BenchmarkFixture, name: str) -> None:
    benchmark.group = f"cone program, {name}"
    program = sequence_program(*SIZES[name])
    scaled = program.scaled()

    def solve() -> float:
        problem, _ = as_cvxpy(scaled)
        problem.solve(solver="CLARABEL")
        return float(problem.value)

    value = solvers.ClarabelSolver().solve(program).value
    assert benchmark(solve) * program.size.objective == pytest.approx(value, rel=1e-6)


def surface_programs(count: int) -> list[tuple[tuple[Counts, Counts], Any]]:
    """Placements of the square peg as both optimisers get them: at random depths, from random poses, in four states."""
    rng = np.random.default_rng(0)
    found: list[tuple[tuple[Counts, Counts], Any]] = []
    states = (STATE[:1], STATE, ("tipx++", "mouthx-+"), ("tipx++", "tipx+-", "mouthx-+", "mouthx--"))
    with pytest.MonkeyPatch.context() as patch:
        largest = nlp.largest

        def noted(functions: Any, *arguments: Any) -> Any:
            found.append((formation[0], arguments))
            return largest(functions, *arguments)

        formation: list[tuple[Counts, Counts]] = [(counts(()), counts(()))]

        def built(contacts: Counts, obstacles: Counts) -> Any:
            formation[0] = contacts, obstacles
            return formation_derivatives(contacts, obstacles)

        patch.setattr(nlp, "largest", noted)
        patch.setattr(nlp, "formation_derivatives", built)
        for n in range(count):
            guess = rng.normal(size=6) * [3e-5, 3e-5, 0.0, 1e-3, 1e-3, 1e-3]
            place_on_surfaces(peg_placement(states[n % len(states)], depth=float(rng.uniform(0.005, 0.03))), guess)
    return found


@pytest.fixture(scope="module")
def programs(request: pytest.FixtureRequest) -> list[tuple[tuple[Counts, Counts], Any]]:
    return surface_programs(200 if request.config.getoption("benchmark_enable") else 8)


@pytest.mark.benchmark(group="nonlinear programs, one after the other")
def test_nonlinear_programs_by_quadratic_ones(
    benchmark: BenchmarkFixture, programs: list[tuple[tuple[Counts, Counts], Any]]
) -> None:
    queue = cycle(programs)

    def solve() -> Any:
        formation, arguments = next(queue)
        return nlp.largest(formation_derivatives(*formation), *arguments)

    assert benchmark.pedantic(solve, rounds=len(programs), warmup_rounds=4) is not None


@pytest.mark.benchmark(group="nonlinear programs, one after the other")
def test_nonlinear_programs_by_interior_points(
    benchmark: BenchmarkFixture, programs: list[tuple[tuple[Counts, Counts], Any]]
) -> None:
    queue = cycle(programs)

    def solve() -> Any:
        formation, (_, _, begin, parameters, bounds) = next(queue)
        return nlp._interior_point(formation, begin, parameters, bounds)

    assert benchmark.pedantic(solve, rounds=len(programs), warmup_rounds=4) is not None


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
    contacts, obstacles = (
        (2, 0, 0, 0, 0),
        (6, 0, 8, 0, 0),
    )  # vertex–face and edge–edge rows of STATE and of what it leaves
    assert benchmark.pedantic(formation_derivatives.__wrapped__, (contacts, obstacles), rounds=5) is not None
