"""No lie passes the check: forged plans, in which every other number was derived anew, and random mutants."""

from __future__ import annotations

import copy
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from execution_model import execute
from forger import LIES, Court, Differences, forged
from forging import Account, run
from lies import PROBLEM
from lies_edge import edge_plan
from restate import restated
from table_plan import table_plan

from fmopt.verify import CERTIFIED, PlanError, verify
from fmopt.verify.parse import parse
from fmopt.verify.problem import differences

PROBLEMS = Path(__file__).parent.parent / "problems"
Plan = dict[str, Any]


@pytest.fixture(scope="module")
def table() -> Plan:
    return table_plan()


@pytest.fixture(scope="module")
def square_peg_differences() -> Differences:
    return lambda plan: differences(parse(plan), PROBLEMS / "square_peg.toml")


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


HONEST = (_nothing, _surer_start, _surer_drift, _heavier_turns)


@pytest.mark.parametrize("change", HONEST)
def test_what_is_true_is_certified_once_its_numbers_are_derived_anew(
    table: Plan, change: Callable[[Plan], None]
) -> None:
    altered = copy.deepcopy(table)
    change(altered)
    assert verify(restated(altered)).findings == ()


@pytest.mark.parametrize("change", HONEST)
def test_so_it_is_for_the_square_peg(square_peg_plan: Plan, change: Callable[[Plan], None]) -> None:
    altered = copy.deepcopy(square_peg_plan)
    change(altered)
    assert verify(restated(altered)).findings == ()


def test_the_edge_plan_claims_what_executions_refute() -> None:
    """Its pair of pieces alone is short, and by what executions see."""
    plan = restated(edge_plan())
    assert {finding.segment for finding in verify(plan).findings} == {3}
    broken = execute(plan, 200, seed=0).broken
    assert broken["overlap", 3] < -1e-5


def _offenders(plan: Plan, differences: Differences | None, seeds: range) -> tuple[list[str], set[str]]:
    """The lies that pass although they are false, and the kinds that were told."""
    court, found, told = Court(plan, differences, executions=20), [], set()
    for lie in LIES:
        if differences is None and lie.oracle == PROBLEM:
            continue
        for seed in seeds:
            try:
                lied = forged(plan, lie, seed)
            except PlanError:
                told.add(lie.name)
                continue
            if lied is None:
                continue
            told.add(lie.name)
            judged = court.judge(lied, lie.oracle)
            if judged.false:
                found.append(f"{lie.name}, seed {seed}: {judged.false}")
    return found, told


def test_no_lie_about_the_table_plan_passes(table: Plan) -> None:
    found, told = _offenders(table, None, range(3))
    assert found == []
    assert len(told) > 25


def test_no_lie_about_the_square_peg_passes(square_peg_plan: Plan, square_peg_differences: Differences) -> None:
    found, told = _offenders(square_peg_plan, square_peg_differences, range(1))
    assert found == []
    assert len(told) > 50


def test_forged_plans_and_mutants_break_no_command(table: Plan) -> None:
    account = Account()
    run(table, None, 60, seed=7, account=account)
    assert (account.false, account.faults, account.slow) == ([], [], [])


def test_nor_do_those_of_the_square_peg(square_peg_plan: Plan, square_peg_differences: Differences) -> None:
    account = Account()
    run(square_peg_plan, square_peg_differences, 16, seed=3, account=account)
    assert (account.false, account.faults, account.slow) == ([], [], [])


def test_certified_is_what_the_forger_begins_with(square_peg_plan: Plan, table: Plan) -> None:
    assert {verify(plan).verdict for plan in (square_peg_plan, table)} == {CERTIFIED}
