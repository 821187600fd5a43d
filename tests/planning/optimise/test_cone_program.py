"""Laws and refusals of cone programs: scaling, weak duality, and solvers that lie."""

import pickle
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
import pytest

from fmopt.errors import InfeasibleError, SolverError
from fmopt.planning.optimise.cone_program import (
    ConeProgram,
    Duals,
    Norm,
    Solution,
    as_cvxpy,
    certify,
    checked,
    dual_bound,
)
from fmopt.planning.optimise.solvers import ClarabelSolver
from tests.shared.placement_instances import max_min_clearance, random_placement, random_program


@dataclass(frozen=True)
class Liar:
    """Returns Clarabel's solution with some of its fields replaced."""

    lies: dict[str, object]

    def solve(self, program: ConeProgram) -> Solution:
        return replace(ClarabelSolver().solve(program), **self.lies)


def disc() -> ConeProgram:
    """Maximise x + y on the unit disc: √2."""
    return ConeProgram([1.0, 1.0], G=[[0.0, 0.0]], h=[1.0], W=[[1.0]], norms=(Norm(np.eye(2), np.zeros(2)),))


def test_disc_has_its_optimum_by_hand() -> None:
    solution = ClarabelSolver().solve(disc())
    assert solution.value == pytest.approx(np.sqrt(2.0), abs=1e-8)
    assert solution.x == pytest.approx([np.sqrt(0.5)] * 2, abs=1e-7)
    assert abs(solution.gap) < 1e-7


@pytest.mark.parametrize("growth", [0.0, 0.05])
@pytest.mark.parametrize("seed", range(4))
def test_scaling_keeps_feasibility_and_value(seed: int, growth: float) -> None:
    program = random_program(seed, growth)
    scaled = program.scaled()
    x = np.random.default_rng(seed).normal(size=len(program.c)) * program.units
    assert scaled.slacks(x / program.units) * program.size.rows == pytest.approx(program.slacks(x), rel=1e-12)
    assert (scaled.c @ (x / program.units)) * program.size.objective == pytest.approx(program.c @ x, rel=1e-12)
    assert scaled.size.rows == pytest.approx(np.ones(len(program.h)))
    assert scaled.size.norms == pytest.approx(np.ones(len(program.norms)))


@pytest.mark.parametrize("seed", range(6))
def test_any_multipliers_bound_every_feasible_point(seed: int) -> None:
    rng = np.random.default_rng(seed)
    program = random_program(seed, 0.05)
    solution = ClarabelSolver().solve(program)
    boxed = replace(program, lower=np.append(program.lower[:-1], -1.0))
    for _ in range(50):
        noise = [rng.normal(size=n) for n in (len(program.b), len(program.h), sum(len(v.g) for v in program.norms))]
        bound, residual = dual_bound(boxed, Duals(*noise), solution.x)
        assert residual == 0.0
        assert bound >= solution.value - 1e-12


@pytest.mark.parametrize("seed", range(4))
def test_cvxpy_agrees(seed: int) -> None:
    program = random_program(seed, 0.03 * (seed % 2), rows=14, spare=seed % 3)
    problem, x = as_cvxpy(program.scaled())
    problem.solve(solver="CLARABEL")
    mine = ClarabelSolver().solve(program)
    unit = program.size.objective
    assert problem.value * unit == pytest.approx(mine.value, abs=1e-6 * unit)
    certify(program, x.value * program.units, tol=1e-7)


def test_a_point_off_its_rows_is_refused() -> None:
    program = random_program(0)
    good = ClarabelSolver().solve(program)
    certify(program, good.x)
    for i, what in ((0, "equality"), (len(program.c) - 1, "row")):
        step = np.zeros(len(program.c))
        step[i] = 1e-8 * program.units[i] * 10.0
        with pytest.raises(SolverError, match=what):
            certify(program, good.x + step)
    with pytest.raises(SolverError, match="finite"):
        certify(program, np.full(len(program.c), np.nan))


def lies() -> dict[str, dict[str, object]]:
    good = ClarabelSolver().solve(random_program(1))
    worse = np.append(good.x[:-1], good.x[-1] - 1e-10)
    return {
        "better than it is": {"x": good.x + np.eye(len(good.x))[-1] * 1e-10},
        "another value": {"value": good.value + 1e-9},
        "feasible, not optimal": {"x": worse, "value": worse[-1]},
        "no proof": {"duals": None},
        "wrong proof": {"duals": replace(good.duals, rows=1.01 * good.duals.rows)},
        "short proof": {"duals": replace(good.duals, rows=good.duals.rows[:-1])},
        "nothing": {"x": np.zeros(3)},
    }


@pytest.mark.parametrize("name", lies())
def test_a_lying_solver_is_caught(name: str) -> None:
    program = random_program(1)
    with pytest.raises(SolverError):
        checked(program, Liar(lies()[name]))
    with pytest.raises(SolverError):
        max_min_clearance(random_placement(1), Liar(lies()[name]))
    assert checked(program, Liar({})).value == ClarabelSolver().solve(program).value


def test_infeasible_rows_raise_with_their_shortfall() -> None:
    # x ≥ 3 and x ≤ 1 in units of 1e-4: each has to give by one unit.
    program = ConeProgram([0.0], G=[[1.0], [-1.0]], h=[-3e-4, 1e-4], lower=[-1.0], upper=[1.0], units=[1e-4])
    with pytest.raises(InfeasibleError, match="contradict by 1") as caught:
        ClarabelSolver().solve(program)
    assert caught.value.shortfall == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize("gap", [1e-8, 1e-6, 1e-2])
@pytest.mark.parametrize("as_equalities", [False, True])
def test_small_contradictions_do_not_pass(gap: float, as_equalities: bool) -> None:
    unit = 1e-4
    if as_equalities:
        program = ConeProgram([0.0, unit], A=[[1.0, 0.0], [1.0, 0.0]], b=[0.0, gap * unit], units=[unit, 1.0])
    else:
        program = ConeProgram(
            [0.0, unit], G=[[1.0, 0.0], [-1.0, 0.0]], h=[-gap * unit, 0.0], upper=[1.0, 1.0], units=[unit, 1.0]
        )
    with pytest.raises((InfeasibleError, SolverError)) as caught:
        ClarabelSolver().solve(program)
    if isinstance(caught.value, InfeasibleError):
        assert caught.value.shortfall == pytest.approx(0.5 * gap * unit, rel=0.3)


def test_an_unbounded_program_and_bad_shapes_are_refused() -> None:
    with pytest.raises(SolverError, match="add bounds"):
        ClarabelSolver().solve(ConeProgram([1.0], G=[[1.0]], h=[0.0]))
    with pytest.raises(ValueError, match="shape"):
        ConeProgram([1.0, 0.0], G=[[1.0]], h=[0.0])
    with pytest.raises(ValueError, match="negative"):
        ConeProgram([1.0], G=[[1.0]], h=[0.0], W=[[-1.0]], norms=(Norm(np.eye(1), np.zeros(1)),))
    with pytest.raises(ValueError, match="nan"):
        ConeProgram([1.0], lower=[np.nan])
    with pytest.raises(ValueError, match="columns"):
        ConeProgram([1.0], G=[[1.0]], h=[0.0], W=[[1.0]], norms=(Norm(np.eye(2), np.zeros(2)),))


def test_values_stay_read_only_through_pickling() -> None:
    program = pickle.loads(pickle.dumps(random_program(2, 0.1)))
    solution = pickle.loads(pickle.dumps(ClarabelSolver().solve(program)))
    for array in (program.G, program.lower, program.norms[0].F, program.size.rows, solution.x, solution.duals.rows):
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 0.0


def test_equal_bounds_hold_a_variable() -> None:
    # x + y on x² + y² ≤ 1 with x held at 3/5, or by an equality besides: 7/5.
    norm = Norm(np.eye(2), np.zeros(2))
    program = ConeProgram(
        [1.0, 1.0], G=[[0.0, 0.0]], h=[1.0], W=[[1.0]], norms=(norm,), lower=[0.6, -9], upper=[0.6, 9]
    )
    assert ClarabelSolver().solve(program).x == pytest.approx([0.6, 0.8], abs=1e-8)
    twice = replace(program, A=np.array([[2.0, 0.0]]), b=np.array([1.2]))
    assert ClarabelSolver().solve(twice).value == pytest.approx(1.4, abs=1e-8)
    for off in (1.3, 1.2 + 1e-6):
        with pytest.raises(InfeasibleError):
            ClarabelSolver().solve(replace(twice, b=np.array([off])))


def test_the_same_program_has_the_same_bits_after_others_and_in_threads() -> None:
    programs = [random_program(seed, 0.02, rows=20, contacts=2) for seed in range(12)]
    first = [ClarabelSolver().solve(program).x for program in programs]
    with ThreadPoolExecutor(2) as pool:
        again = list(pool.map(lambda program: ClarabelSolver().solve(program).x, programs[::-1]))[::-1]
    assert all(np.array_equal(one, other) for one, other in zip(first, again, strict=True))
