"""The square peg with a tested plan asked for: from the problem to the plan, its page and what is printed."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from fmopt.cli.console import print_solved
from fmopt.plan import Plan, canonical, parsed, write
from fmopt.planning.pipeline import synthesise
from fmopt.report.figures import figures
from fmopt.report.page import report_page
from tests.shared.commands import ended
from tests.shared.plans.press_plan import DRAWS, MIN_RATE, press_plan_document, press_problem

BASE = ("--base", *"000000")


def check_solved(found: Plan) -> None:
    assert (found.verdict, found.press_plan is not None) == ("TESTED", True)
    assert found.trials is not None
    assert (found.trials.draws, found.trials.min_rate, found.trials.vertices) == (DRAWS, MIN_RATE, 64)
    assert found.trials.bound >= MIN_RATE
    assert found.description.trace


def test_the_square_peg_is_tested() -> None:
    made = synthesise(press_problem())
    assert (str(made.verdict.verdict), made.verdict.findings, made.verdict.margin) == ("TESTED", (), None)
    check_solved(made.plan)


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
        assert "10 of 10 draws seat in the physics engine, 10 at the first attempt: a rate of at least 69.2 %" in text
        assert "63 of 64 vertices" in text
    assert "TESTED" in printed
    assert "margin" not in printed
    assert "margin" not in page.split("<body", 1)[1].split("<script", 1)[0].replace("margin:", "").lower()


@pytest.mark.parametrize("to", ["urscript", "ros2"])
def test_presses_are_not_exported(
    to: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "plan.json"
    write(press_plan_document(), file)
    monkeypatch.setattr(sys, "argv", ["fmopt", "export", str(file), "--to", to, *BASE, "--out", "made"])
    code, out, words = ended(capfd)
    assert (code, out) == (2, "")
    assert "a plan of presses is not exported yet" in words
    assert not (tmp_path / "made").exists()
