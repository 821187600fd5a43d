"""No lie passes the check: forged plans, in which every other number was derived anew, and random mutants."""

import copy
import json
import random
from collections.abc import Callable, Sequence
from itertools import product
from typing import Any

import pytest

from fmopt.planning.same_problem import differences
from fmopt.task.problem import load
from fmopt.verify import PlanError, verify
from fmopt.verify.reading.parse import parse
from tests import PROBLEMS
from tests.shared.executions.model import execute
from tests.shared.lies.edge import edge_plan
from tests.shared.lies.forger import LIES, Court, Differences, forged
from tests.shared.lies.forging import Account, run
from tests.shared.lies.lie import PROBLEM, Lie
from tests.shared.lies.restate import restated
from tests.shared.plans.table_plan import table_plan

Plan = dict[str, Any]


@pytest.fixture(scope="module")
def table() -> Plan:
    return table_plan()


@pytest.fixture(scope="module")
def square_peg_differences() -> Differences:
    problem = load(PROBLEMS / "square_peg.toml")
    return lambda plan: differences(parse(plan), problem)


def _nothing(plan: Plan) -> None:
    pass


def _surer_start(plan: Plan) -> None:
    """Smaller start errors; the boxes of retries would leave gaps."""
    plan["uncertainty"]["start_box"] = [0.9 * x for x in plan["uncertainty"]["start_box"]]
    plan.pop("recovery", None)


def _surer_drift(plan: Plan) -> None:
    plan["uncertainty"]["velocity_error"] = [0.5 * x for x in plan["uncertainty"]["velocity_error"]]


def _heavier_turns(plan: Plan) -> None:
    plan["uncertainty"]["rho"] *= 1.1


LARGER = (_surer_start, _heavier_turns)
HONEST = (_nothing, _surer_drift, *LARGER)


@pytest.mark.parametrize(
    ("plan", "change"), [*(("table", change) for change in HONEST), *(("square_peg_plan", change) for change in LARGER)]
)
def test_what_is_true_is_certified_once_its_numbers_are_derived_anew(
    plan: str, change: Callable[[Plan], None], request: pytest.FixtureRequest
) -> None:
    altered = copy.deepcopy(request.getfixturevalue(plan))
    change(altered)
    assert verify(restated(altered)).findings == ()


def test_the_edge_plan_claims_what_executions_refute() -> None:
    """Its pair of pieces alone is short, and by what executions see."""
    plan = restated(edge_plan())
    assert {finding.segment for finding in verify(plan).findings} == {3}
    broken = execute(plan, 200, seed=0).broken
    assert broken["overlap", 3] < -1e-5


def _offenders(plan: Plan, differences: Differences | None, lies: Sequence[Lie], seeds: range) -> list[str]:
    """The lies that pass although they are false, all that are told being of the plan given."""
    court, found = Court(plan, differences, executions=12), []
    for lie, seed in product(lies, seeds):
        try:
            lied = forged(plan, lie, seed)
        except PlanError:
            continue
        if lied is None:
            continue
        judged = court.judge(lied, lie.oracle)
        if judged.false:
            found.append(f"{lie.name}, seed {seed}: {judged.false}")
    return found


def _told(plan: Plan, lies: Sequence[Lie]) -> set[str]:
    """The names of lies that a plan has something to lie about for."""
    return {lie.name for lie in lies if lie.tell(json.loads(json.dumps(plan)), random.Random(0))}


def test_there_are_many_lies_to_tell(table: Plan, square_peg_plan: Plan) -> None:
    assert len({lie.name for lie in LIES}) == len(LIES) > 55
    assert len(_told(table, LIES)) > 30
    assert len(_told(square_peg_plan, LIES)) > 50


def test_no_lie_about_the_table_plan_passes(table: Plan) -> None:
    lies = [lie for lie in LIES if lie.oracle != PROBLEM]
    assert _offenders(table, None, lies, range(3)) == []


def test_no_lie_about_the_square_peg_passes(square_peg_plan: Plan, square_peg_differences: Differences) -> None:
    """Those that need a problem, or more than the table plan has."""
    simple = _told(table_plan(), [lie for lie in LIES if lie.oracle != PROBLEM])
    lies = [lie for lie in LIES if lie.name not in simple]
    assert _offenders(square_peg_plan, square_peg_differences, lies, range(1)) == []


def test_forged_plans_and_mutants_break_no_command(table: Plan) -> None:
    account = Account()
    run(table, None, 40, seed=7, account=account)
    assert (account.false, account.faults) == ([], [])


@pytest.mark.wide
def test_nor_do_those_of_the_square_peg(square_peg_plan: Plan, square_peg_differences: Differences) -> None:
    account = Account()
    run(square_peg_plan, square_peg_differences, 10, seed=3, account=account)
    assert (account.false, account.faults) == ([], [])
