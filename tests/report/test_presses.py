"""Presses in words: directions of wrenches, outcomes by press and kind, trials that do not seat."""

from collections.abc import Sequence
from dataclasses import replace

import pytest

import fmopt
from fmopt.cli.console import print_solved
from fmopt.execution.evidence import _with_few_ways
from fmopt.plan import parsed
from fmopt.plan.evidence import MAX_WAYS
from fmopt.report.presses import ENDINGS, OUTCOMES, failure_rows, outcome_rows, press_rows
from tests.shared.plans.press_plan import outcomes, press_plan, press_plan_document


def test_wrenches_and_twists_are_said_as_directions_with_sizes() -> None:
    attempt = press_plan().attempts[0]
    turned = replace(attempt.presses[0], wrench=(1.0, -2.5, 0.0, 0.0, 0.0, -0.3), twist=(1e-9, 0, 4e-3, 0, 0.1, 0))
    ((_, _, twist, wrench, _),) = press_rows(replace(attempt, presses=(turned,)))
    assert twist == "towards +z 4 mm/s; about +y 5.73°/s"
    assert wrench == "towards −y 2.5 N, +x 1 N; about −z 0.3 N m"


@pytest.mark.parametrize(
    ("reasons", "kind"),
    [
        ((), ""),
        (("stopped on the way",), "stopped on the way"),
        (("stopped on the way", "-8.797 mm from its depth"), "from its depth"),
        (("penetration 27.1 µm", "tilted"), "penetration"),
        (("force of 21.2 N",), "force"),
    ],
)
def test_the_kind_of_a_failure_has_no_numbers_of_the_one_trial(reasons: tuple[str, ...], kind: str) -> None:
    assert replace(outcomes([False])[0], reasons=reasons).kind == kind


def test_every_trial_is_counted_at_each_press_that_it_came_to() -> None:
    plan = parsed(press_plan_document())
    assert plan.trials is not None
    rows = outcome_rows(plan, plan.trials)
    assert [row[:2] for row in rows[:2]] == [("1", "come down"), ("1", "press into the corner")]
    assert [row[2:] for row in rows[:3]] == [("10 (64)", "", "", "")] * 2 + [("10 (63)", "0 (1)", "", "")]
    assert rows[6] == ("1", "go in", "", "", "10 (63)", "")
    assert [row[2:] for row in rows[7:]] == [("0 (1)", "", "", "")] * 6 + [("", "", "", "0 (1) tilted")]
    ((name, *rest),) = failure_rows(plan.trials)
    assert "vertex 63" in name
    assert rest == ["2", "go in", "stopped on the way, tilted", "8.0", "14.0"]


def test_terminal_and_notebook_have_the_table_of_outcomes(
    capsys: pytest.CaptureFixture[str], tmp_path: object, monkeypatch: pytest.MonkeyPatch
) -> None:
    plan = fmopt.Plan(press_plan_document())
    monkeypatch.setenv("COLUMNS", "140")
    print_solved(plan.stated, [], tmp_path, False)  # type: ignore[arg-type]
    out = capsys.readouterr().out
    for words in (OUTCOMES, *ENDINGS, "0 (1) tilted", "starts at: (", "towards −z"):
        assert words in out
    cell = plan._repr_html_()
    assert OUTCOMES in cell
    assert "vertex 63, which does not seat" in cell


def few(kinds: Sequence[str]) -> list[int]:
    """Numbers of the trials whose way is kept, of failures of these kinds."""
    bad = outcomes([False])[0]
    found = _with_few_ways([replace(bad, reasons=(kind,)) for kind in kinds])
    return [number for number, one in enumerate(found) if one.way]


def test_few_ways_are_kept_and_each_kind_has_one() -> None:
    assert few(["tilted"] * 3) == [0, 1, 2]
    assert few(["tilted"] * 20 + ["overshot"]) == [*range(MAX_WAYS - 1), 20]
