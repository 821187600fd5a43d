"""The cone program of a plan's goal poses: solved as it is, with constraints of one's own, and what follows."""

import cvxpy
import numpy as np
import pytest

import fmopt
from fmopt.notebook.placing import Placing
from tests import PROBLEMS

CERTAIN = 1e-9  # m


@pytest.fixture(scope="module", params=["square_peg", "mit_planar_slot", "lee_huang_peg"])
def solved(request: pytest.FixtureRequest) -> tuple[fmopt.Problem, fmopt.Plan]:
    problem = fmopt.load(PROBLEMS / f"{request.param}.toml")
    return problem, fmopt.solve(problem)


@pytest.fixture(scope="module")
def placing(solved: tuple[fmopt.Problem, fmopt.Plan]) -> Placing:
    problem, plan = solved
    return plan.placement(problem)


def test_the_motion_of_a_plan_is_certified_alike(solved: tuple[fmopt.Problem, fmopt.Plan], placing: Placing) -> None:
    _, plan = solved
    claims = placing.now.claims
    assert [claim.margin for claim in claims] == pytest.approx([piece.margin for piece in plan.segments], abs=CERTAIN)
    assert [{c.id for c in one.piece.goal_contacts} for one in claims] == [set(one.goal_state) for one in plan.segments]


def test_undisplaced_the_margin_is_the_plans(solved: tuple[fmopt.Problem, fmopt.Plan], placing: Placing) -> None:
    _, plan = solved
    still = cvxpy.Problem(placing.program.objective, [*placing.program.constraints, placing.shift == 0.0])
    still.solve(solver="CLARABEL")
    assert float(placing.margin.value) == pytest.approx(plan.margin, rel=1e-4)
    assert placing.motion().placed.margin == pytest.approx(plan.margin, abs=CERTAIN)


def test_own_constraints_hold_in_the_plan_after(solved: tuple[fmopt.Problem, fmopt.Plan], placing: Placing) -> None:
    problem, plan = solved
    lower = placing.shift[1, 2] <= -2e-6  # m: the first goal pose
    least = placing.margin >= 0.9 * plan.margin
    wish = cvxpy.Problem(cvxpy.Minimize(cvxpy.norm(placing.shift, "fro")), [*placing.program.constraints, lower, least])
    wish.solve(solver="CLARABEL")
    if wish.status != cvxpy.OPTIMAL:  # the only move of a peg that goes straight in ends in the seat, which stays
        assert len(placing.now.placed.moves) == 1
        return
    motion = placing.motion()
    moved = motion.placed.moves[0].goal.p - placing.now.placed.moves[0].goal.p
    assert moved[2] == pytest.approx(-2e-6, rel=0.05)
    made = fmopt.stages.plan(problem, motion)
    assert made.verdict == "CERTIFIED"
    assert made.margin >= 0.85 * plan.margin


def test_what_has_no_answer_yet_says_so(solved: tuple[fmopt.Problem, fmopt.Plan]) -> None:
    problem, plan = solved
    fresh = plan.placement(problem)
    with pytest.raises(fmopt.SolverError, match="no solution yet"):
        fresh.motion()


def test_a_plan_of_another_problem_is_refused(solved: tuple[fmopt.Problem, fmopt.Plan]) -> None:
    _, plan = solved
    with pytest.raises(fmopt.ChoiceError):
        plan.placement(fmopt.load(PROBLEMS / "octagon_prism.toml"))


def test_more_room_never_lowers_what_the_program_says(solved: tuple[fmopt.Problem, fmopt.Plan]) -> None:
    problem, plan = solved
    margins = []
    for radius in (5e-6, 1e-5, 2e-5):
        wider = plan.placement(problem, radius)
        wider.program.solve(solver="CLARABEL")
        margins.append(float(wider.margin.value))
    assert np.all(np.diff(margins) >= -1e-3 * plan.margin)
