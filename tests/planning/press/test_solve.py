"""The square peg with a tested plan asked for: from the problem to the plan, its page and what is printed."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from fmopt.cli.console import print_solved
from fmopt.errors import SearchError
from fmopt.execution.confidence import lower_bound
from fmopt.plan import canonical, parsed
from fmopt.plan.export.sampled import csv_text, samples
from fmopt.planning import pipeline
from fmopt.planning.pipeline import synthesise
from fmopt.planning.press.choice import Choosing
from fmopt.planning.press.propose import proposals
from fmopt.planning.press.solve import PressSolution, conditions_of, robot_for, weakness
from fmopt.report.figures import figures
from fmopt.report.page import report_page
from fmopt.report.presses import carried_words, evidence_words
from fmopt.task.problem import Problem
from fmopt.verify import verify
from tests.shared.plans.press_plan import DRAWS, MIN_RATE, press_plan_document, press_problem, press_task


def test_the_square_peg_is_tested() -> None:
    made = synthesise(press_problem())
    assert (str(made.verdict.verdict), made.verdict.findings, made.verdict.margin) == ("TESTED", (), None)
    found = made.plan
    assert (found.verdict, found.press_plan is not None) == ("TESTED", True)
    assert found.trials is not None
    assert (found.trials.draws, found.trials.min_rate, found.trials.vertices) == (DRAWS, MIN_RATE, 64)
    assert found.trials.bound >= MIN_RATE
    assert found.description.trace
    assert "# it is of the first attempt" in csv_text(found, 10.0)
    assert found.press_plan is not None
    first = found.press_plan.attempts[0].presses[0]
    reaction = [-force if gives else 0.0 for force, gives in zip(first.wrench, first.gives, strict=True)]
    assert samples(found, 10.0).fa[0].tolist() == reaction


def warning(problem: Problem) -> str:
    task = press_task(problem)
    robot, conditions = robot_for(task), conditions_of(problem)
    return weakness(Choosing(task.bodies, task.seat, robot, conditions, 0), proposals(task), problem)


def test_a_press_near_the_accuracy_of_the_robot_is_told_before_planning() -> None:
    problem = press_problem()
    assert warning(problem) == ""
    rough = replace(problem, robot=replace(problem.robot, force_offset=3.0, max_force=50.0))
    told = re.search(r"contact_force to (\d+) N and torque_limit to (\S+) N m", warning(rough))
    assert told is not None
    force, torque = map(float, told.groups())
    wanted = replace(rough.specification, contact_force=force, torque_limit=torque)
    assert warning(replace(rough, specification=wanted)) == ""
    rougher = replace(problem, robot=replace(problem.robot, force_offset=20.0, max_force=50.0))
    assert "take a sensor that is accurate to" in warning(rougher)


@pytest.mark.wide
def test_the_same_problem_gives_the_same_bytes() -> None:
    first, second = (synthesise(press_problem()).document for _ in range(2))
    assert canonical(first) == canonical(second)


def test_page_and_terminal_state_counts_and_bound_and_no_margin(capfd: pytest.CaptureFixture[str]) -> None:
    found = parsed(press_plan_document())
    capfd.readouterr()
    print_solved(found, [], Path("out"), report=False)
    printed = " ".join(capfd.readouterr().out.split())
    page = " ".join(report_page(found, figures(found)).split())
    for text in (printed, page):
        words = "10 of 10 draws seat in the physics engine, 10 at the first attempt, in 8.0 s, 95 % within 8.0 s: "
        assert f"{words}a rate of at least 69.2 %" in text
        assert "63 of 64 vertices" in text
    assert "TESTED" in printed
    assert "margin" not in printed
    assert "margin" not in page.split("<body", 1)[1].split("<script", 1)[0].replace("margin:", "").lower()


class Presses:
    """In place of the search for presses: a plan that stays below the rate asked for, or none."""

    def __init__(self, level: str) -> None:
        self.level = level

    def __call__(self, *_: Any) -> PressSolution:
        if self.level == "none":
            raise SearchError("no press was found")
        found = parsed(press_plan_document())
        assert found.press_plan is not None
        assert found.trials is not None
        return PressSolution(found.press_plan, replace(found.trials, level="below", min_rate=0.9), ())


@pytest.mark.parametrize(("level", "certified"), [("below", True), ("none", True), ("below", False), ("none", False)])
def test_where_presses_stay_below_guarded_moves_are_looked_for(
    level: str, certified: bool, square_peg_plan: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    problem = press_problem()
    monkeypatch.setattr("fmopt.planning.press.solve.press_solution", Presses(level))
    share = pipeline.CertifiedShare(0.35, 1e-5, False, problem.velocity_error)
    monkeypatch.setattr(pipeline, "nearest", lambda *_: share)
    if certified:
        answer = pipeline.Synthesis(square_peg_plan, verify(square_peg_plan), {})
        monkeypatch.setattr(pipeline, "certified_motion", lambda *_: None)
        monkeypatch.setattr(pipeline, "_completed", lambda *_: answer)
        found = synthesise(problem).plan
        assert (found.verdict, found.press_plan) == ("CERTIFIED", None)
        assert (found.description.carried_out is None) is (
            level == "none"
        )  # where there is no other, whatever it comes to
        return
    monkeypatch.setattr(pipeline, "certified_motion", Presses("none"))
    if level == "none":
        with pytest.raises(SearchError, match="no press was found"):
            synthesise(problem)
        return
    found = synthesise(problem).plan
    assert (found.verdict, found.description.certified_share) == ("NOT_PROVED", 0.35)
    assert "Guarded moves are certified for 35% of the start errors." in evidence_words(found)


def test_a_certified_plan_says_what_its_trials_came_to(square_peg_plan: dict[str, Any]) -> None:
    made = pipeline.Synthesis(square_peg_plan, verify(square_peg_plan), {})
    settings = press_problem().settings
    assert made.carried_out(replace(settings, draws=0)) is made
    assert carried_words(made.plan) == "not carried out"
    found = made.carried_out(replace(settings, draws=2, min_rate=0.9))
    assert str(verify(found.document).verdict) == "CERTIFIED"
    carried = found.plan.description.carried_out
    assert carried is not None
    assert (carried.draws, carried.seated, carried.bound) == (2, 2, pytest.approx(lower_bound(2, 2)))
    assert carried_words(found.plan).startswith("BUT 2 of 2 draws seat")  # two draws show no rate of 0.9
