"""Trials on a robot of one's own: read from CSV, put into the plan file, told beside those in the physics engine."""

from collections.abc import Callable
from pathlib import Path

import pytest

from fmopt import plan
from fmopt.errors import InputError, PlanFormatError
from fmopt.execution.confidence import lower_bound, success_interval
from fmopt.notebook.own_trials import own_trials, with_trials
from fmopt.report.presses import evidence_words
from fmopt.verify import verify
from tests.shared.commands import Outcome
from tests.shared.plans.press_plan import press_plan_document


def test_trials_are_added_to_a_plan(tmp_path: Path, command: Callable[..., Outcome]) -> None:
    file, trials = tmp_path / "plan.json", tmp_path / "trials.csv"
    plan.write(press_plan_document(), file)
    trials.write_text("\ufeffOutcome,who,seconds\r\n" + "seated,a,8\r\n" * 3 + "failed,b,60\r\n\r\n1,,\r\n", "utf-8")
    code, out, _ = command("evidence", "add", file, trials)
    assert (code, out.startswith("4 of 5 trials on a robot (trials.csv) seat, at least ")) == (0, True)
    found = plan.read(file)
    (own,) = found.description.own_trials
    assert (own.trials, own.seated, own.bound, own.seconds) == (5, 4, lower_bound(4, 5), 8.0)
    assert ((own.low, own.high), own.contradicts) == (success_interval(4, 5), False)
    assert "4 of 5 trials on a robot" in evidence_words(found)
    assert str(verify(plan.read_document(file)).verdict) == "TESTED"
    with pytest.raises(InputError, match="has these trials already"):
        with_trials(file, trials)


def test_trials_that_seat_too_rarely_contradict_the_engine(tmp_path: Path) -> None:
    plan.write(press_plan_document(), tmp_path / "plan.json")
    (tmp_path / "trials.csv").write_text("outcome\n" + "failed\n" * 12 + "seated\n", "utf-8")
    added = plan.parsed(with_trials(tmp_path / "plan.json", tmp_path / "trials.csv"))
    assert added.description.own_trials[0].contradicts
    assert "CONTRADICTS" in evidence_words(added)


def test_a_plan_that_was_changed_gets_no_trials(tmp_path: Path) -> None:
    whole = press_plan_document()
    plan.write({**whole, "goal": [1e-6, *whole["goal"][1:]]}, tmp_path / "plan.json")
    (tmp_path / "trials.csv").write_text("outcome\nseated\n", "utf-8")
    with pytest.raises(PlanFormatError, match="changed after it was sealed"):
        with_trials(tmp_path / "plan.json", tmp_path / "trials.csv")


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"result\nseated\n", "1:1: missing-key: there is no column 'outcome'"),
        (b"outcome\n", "1:1: missing-key: there are no trials"),
        (b"outcome\nseated\nperhaps\n", "3:1: bad-value: the outcome is 'perhaps'"),
        (b"who,outcome\nbob\n", "2:1: bad-value: the outcome is ''"),
        (b"outcome,seconds\nseated,-1\n", "2:1: bad-value: '-1' are no seconds"),
        (b"outcome\n\xff\n", "it is no CSV file"),
        (b'outcome\n"seated\n', "it is no CSV file"),
    ],
)
def test_files_that_cannot_be_read_are_refused(content: bytes, message: str, tmp_path: Path) -> None:
    (tmp_path / "t.csv").write_bytes(content)
    with pytest.raises(InputError, match=message):
        own_trials(tmp_path / "t.csv")
