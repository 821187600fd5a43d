"""The programs that whole plans ask: who solves them, what their prices say, and what CVXPY makes of them."""

from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from fmopt.errors import InfeasibleError, SolverError
from fmopt.planning.optimise.cone_program import ConeProgram, Solution, as_cvxpy
from fmopt.planning.optimise.solvers import ClarabelSolver
from fmopt.planning.pipeline import synthesise
from fmopt.planning.placement import goal_refinement
from fmopt.task.problem import load
from tests import PROBLEMS

NAMES = ("lee_huang_peg", "mit_planar_slot", "square_peg", "octagon_prism")
ASKED = 10


@cache
def solves(name: str) -> tuple[tuple[tuple[ConeProgram, Solution], ...], int]:
    """The cone programs that a plan asked, with their solutions, and how many poses it placed on true surfaces."""
    found, placed = list[tuple[ConeProgram, Solution]](), list[object]()
    own, place = ClarabelSolver.solve, goal_refinement.place_on_surfaces

    def kept(self: ClarabelSolver, program: ConeProgram) -> Solution:
        found.append((program, own(self, program)))
        return found[-1][1]

    def watched(*arguments: Any) -> Solution:
        placed.append(arguments)
        return place(*arguments)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(ClarabelSolver, "solve", kept)
        patch.setattr(goal_refinement, "place_on_surfaces", watched)
        problem = load(PROBLEMS / f"{name}.toml")
        certified = replace(problem.settings, evidence="certified")
        assert synthesise(replace(problem, settings=certified)).proved
    return tuple(found), len(placed)


def programs() -> Iterator[tuple[ConeProgram, Solution]]:
    """Ten programs of several plans, no two the same."""
    kept = dict[bytes, tuple[ConeProgram, Solution]]()
    for name in NAMES[1:]:
        for program, solution in solves(name)[0]:
            kept.setdefault(program.h.tobytes() + program.upper.tobytes(), (program, solution))
    yield from list(kept.values())[:: max(1, len(kept) // ASKED)][:ASKED]


def test_plans_place_all_poses_together_and_single_ones_that_bind_on_true_surfaces() -> None:
    asked, placed = zip(*map(solves, NAMES), strict=True)
    assert all(asked)
    assert any(placed)


def test_prices_of_rows_are_what_the_margin_gains() -> None:
    rng, seen, smooth = np.random.default_rng(0), 0, 0
    for program, solution in programs():
        rows = rng.uniform(0.0, 1.0, len(program.h))
        step = 1e-4 * max(abs(solution.value), 1e-5)
        try:
            less, more = (ClarabelSolver().solve(replace(program, h=program.h + s * rows)).value for s in (-step, step))
        except (SolverError, InfeasibleError):
            continue
        price = float(solution.duals.rows @ rows)
        # Where several sets of rows bind, the margin has a kink, and prices lie between its slopes.
        low, high = (more - solution.value) / step, (solution.value - less) / step
        assert low - 0.05 * abs(price) <= price <= high + 0.05 * abs(price)
        seen += 1
        smooth += high - low <= 0.05 * abs(price)
    assert seen >= ASKED - 2
    assert smooth >= ASKED // 2


def test_cvxpy_finds_the_same_margins() -> None:
    pytest.importorskip("cvxpy")
    for program, solution in list(programs())[::3]:
        problem, _ = as_cvxpy(program.scaled())
        problem.solve(solver="CLARABEL")
        assert problem.value * program.size.objective == pytest.approx(solution.value, rel=1e-6, abs=1e-12)
