"""Placement as a cone program against hand-made optima, brute force and fresh solvers."""

from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise

import numpy as np
import pytest

from fmopt.errors import InfeasibleError, SolverError
from fmopt.planning.optimise import solvers
from fmopt.planning.placement.largest_clearance import Flat, Metric, Placement, lexicographic
from tests.shared.placement_instances import (
    CLEARANCE,
    METRIC,
    max_min_clearance,
    random_placement,
    random_program,
    translations,
    vertex_enumeration,
)


def close(one: float, other: float, unit: float = CLEARANCE) -> bool:
    return abs(one - other) <= 1e-6 * unit


@pytest.mark.parametrize("contacts", [3, 4, 5])
@pytest.mark.parametrize("seed", range(6))
def test_cone_program_and_brute_force_agree(seed: int, contacts: int) -> None:
    problem = random_placement(seed, rows=8, contacts=contacts, spare=seed % 2)
    assert close(max_min_clearance(problem).value, vertex_enumeration(problem))


def test_between_walls_by_hand() -> None:
    solution = max_min_clearance(translations([[1, 0, 0], [-1, 0, 0]], [0, -3]))
    assert (solution.x[0], solution.value) == pytest.approx((1.5, 1.5), abs=1e-8)


def test_distance_is_measured_in_the_scaled_metric() -> None:
    # N = (1, …, 1)/√2 in one translation and one rotation, D = 1, σ = (2, 1): D′ = 1.265, not the printed 0.949.
    N = np.array([[0.0, 0.0, 0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5)]]) * [1, 1, 1, 1, 1, 1]
    metric = Metric(2.0, 1.0)
    assert 1.0 / metric.dual_norm(N)[0] == pytest.approx(2.0)
    mixed = np.array([np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5), 0.0, 0.0])
    assert 1.0 / metric.dual_norm(mixed) == pytest.approx(1.265, abs=5e-4)
    nearest = METRIC.units * 3.0
    row = nearest * METRIC.sigma**2 / METRIC.dual_norm(nearest * METRIC.sigma**2)
    free = Flat(np.zeros((0, 6)), np.zeros(0))
    single = Placement([row], [row @ nearest], free, metric=METRIC, lower=-np.ones(6), upper=np.zeros(6) + 1e-12)
    distance = -single.at(np.zeros(6)).value
    assert distance == pytest.approx(np.linalg.norm(METRIC.sigma * nearest), rel=1e-9)


def test_negative_clearance_is_reported_and_contradictions_raise() -> None:
    assert max_min_clearance(translations([[1, 0, 0], [-1, 0, 0]], [2, -1])).value == pytest.approx(-0.5, abs=1e-8)
    twice = Flat(np.eye(6)[[0, 0]], np.array([0.0, 1e-8]))
    with pytest.raises(InfeasibleError, match="equalities contradict"):
        max_min_clearance(translations([[1, 0, 0]], [0], goal=twice))


def test_lexicographic_centres_what_max_min_leaves_open() -> None:
    # x between ±1, y between −1 and 3, z between −4 and 4 with a roof at z = 2: least clearances 1, 2, 3.
    walls = [[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1], [0, 0, -1]]
    solution = lexicographic(translations(walls, [-1, -1, -1, -3, -4, -4, -2]))
    assert solution.value == pytest.approx(1.0, abs=1e-7)
    assert solution.x[:3] == pytest.approx([0.0, 1.0, -1.0], abs=1e-6)
    assert abs(solution.gap) < 1e-6


@pytest.mark.parametrize("seed", range(5))
def test_lexicographic_never_loses_the_minimum_and_raises_the_rest(seed: int) -> None:
    problem = random_placement(seed, rows=14, contacts=2)
    first, refined = max_min_clearance(problem), lexicographic(problem)
    assert close(first.value, refined.value)
    a, b = (np.sort(problem.clearances(found.x[:6])) for found in (first, refined))
    differ = np.flatnonzero(np.abs(a - b) > 1e-5 * CLEARANCE)
    assert not len(differ) or b[differ[0]] > a[differ[0]]


def test_persistent_solvers_return_the_bits_of_fresh_ones() -> None:
    programs = [random_program(seed, 0.02, rows=9, contacts=2) for seed in range(12)]
    warm = [solvers.ClarabelSolver().solve(program).x for program in programs]
    for program, x in zip(programs, warm, strict=True):
        solvers._local.__dict__.clear()
        assert np.array_equal(solvers.ClarabelSolver().solve(program).x, x)


def test_one_solver_serves_a_shape_and_threads_have_their_own() -> None:
    solvers._local.__dict__.clear()
    problems = [random_placement(seed, rows=9, contacts=2) for seed in range(6)]
    serial = [max_min_clearance(problem, solvers.ClarabelSolver()).x for problem in problems]
    assert len(solvers._local.solvers) == 1
    with ThreadPoolExecutor(2) as pool:
        parallel = list(pool.map(lambda problem: max_min_clearance(problem, solvers.ClarabelSolver()).x, problems))
    assert all(np.array_equal(one, other) for one, other in zip(serial, parallel, strict=True))


@pytest.mark.parametrize("status", ["AlmostSolved", "MaxIterations", "NumericalError", "InsufficientProgress"])
def test_every_status_but_solved_raises(status: str, monkeypatch: pytest.MonkeyPatch) -> None:
    problem = random_placement(3)
    good = max_min_clearance(problem, solvers.ClarabelSolver())

    def run(*_: object) -> tuple[object, object, str]:
        scaled = problem.program().scaled()
        M, _rhs, _cones = solvers.standard_form(scaled, np.arange(len(scaled.b)))
        return good.x / problem.program().units, np.zeros(len(M)), status  # a good point, which nothing proves

    monkeypatch.setattr(solvers.ClarabelSolver, "_run", run)
    with pytest.raises(SolverError, match=status):
        max_min_clearance(problem, solvers.ClarabelSolver())


def test_every_status_of_clarabel_is_in_the_table() -> None:
    import clarabel

    known = {name for name in dir(clarabel.SolverStatus) if name[0].isupper()}
    assert known == {*solvers._ADVICE, "Solved", "PrimalInfeasible"}


def test_more_iterations_are_not_hidden() -> None:
    with pytest.raises(SolverError, match="MaxIterations"):
        max_min_clearance(random_placement(4), solvers.ClarabelSolver(max_iterations=2))


def test_more_room_never_hurts() -> None:
    values = []
    for wall in np.linspace(0.5, 3.0, 6):
        values.append(max_min_clearance(translations([[1, 0, 0], [-1, 1, 0]], [0, -wall])).value)
    assert all(b > a for a, b in pairwise(values))
