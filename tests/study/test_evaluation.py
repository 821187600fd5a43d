"""What a run answers: the trials of its plan, or why there is no motion, found out once and told in words."""

import json
import zlib
from dataclasses import replace
from pathlib import Path

import pytest

from fmopt.errors import SearchError
from fmopt.execution import trials
from fmopt.plan import parsed
from fmopt.planning import pipeline
from fmopt.study import evaluation
from fmopt.study.results.shares import share
from fmopt.study.running.batch import Run, StudyContext
from tests import ROOT
from tests.shared.studies.problems import straight


@pytest.fixture(autouse=True)
def _no_motion_known(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(evaluation, "_MOTIONS", {})


def test_a_search_that_fails_is_made_once_and_says_why(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    searches = []

    def moved(*_: object) -> None:
        searches.append(1)
        raise SearchError("no motion was found:\n  state v4 ends", "lower the errors")

    monkeypatch.setattr(pipeline, "certified_motion", moved)
    straight(tmp_path)
    question = StudyContext("base.toml", ("clearance", "plan", "margins", "tolerated_error", "bias"), ("plan",))
    first = evaluation.evaluate(Run("a", (), question), tmp_path)
    assert len(searches) == 1
    assert (first.outcome, first.reason) == ("done", "no motion was found: state v4 ends")
    assert first.answers["verdict"] == "NOT_FOUND"
    assert first.answers["clearance"] is not None
    assert first.answers["margin"] is None
    assert first.kept == b""
    weaker = Run("b", ((("specification", "contact_force"), "30.0 N"),), question)
    assert evaluation.evaluate(weaker, tmp_path).reason == first.reason
    assert len(searches) == 1  # a motion does not depend on the specification, nor does there being none
    wider = Run("c", ((("uncertainty", "start", "x"), "0.00002 m"),), question)
    evaluation.evaluate(wider, tmp_path)
    assert len(searches) == 2


def test_a_search_out_of_time_says_nothing_of_the_machine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def moved(*_: object) -> None:
        raise SearchError("nothing among 17 states", "raise settings.time_limit", late=True)

    monkeypatch.setattr(pipeline, "certified_motion", moved)
    straight(tmp_path)
    row = evaluation.evaluate(Run("a", (), StudyContext("base.toml", ("margins",))), tmp_path)
    assert row.reason == "no motion was found before settings.time_limit"


def test_parts_that_overlap_are_a_row_that_says_where() -> None:
    question = StudyContext("problems/square_peg.toml", ("clearance", "margins"))
    row = evaluation.evaluate(Run("key", ((("fixed", "parameters", "width"), "0.0199 m"),), question), ROOT)
    assert (row.outcome, row.answers["verdict"]) == ("done", "INFEASIBLE")
    assert row.answers["shortfall"] == pytest.approx(5e-5, rel=1e-3)
    assert "too thick by 0.05" in row.reason
    assert "\n" not in row.reason


def test_a_run_says_how_often_its_plan_succeeds(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(evaluation, "TRIALS", 4)
    straight(tmp_path)
    row = evaluation.evaluate(Run("key", (), StudyContext("base.toml", ("plan", "execution"), ("plan",))), tmp_path)
    assert row.outcome == "done"
    seen = trials.run(parsed(json.loads(zlib.decompress(row.kept))), trials.Trials(4), range(4))
    successes = sum(record["success"] for record in seen)
    found = share(successes, 4)
    answers = {name: row.answers[name] for name in ("trials", "successes", "success", "success_low", "success_high")}
    assert list(answers.values()) == [4, successes, found.value, found.low, found.high]
    assert row.answers["verdict"] == "CERTIFIED"


def test_answers_are_the_same_whether_plans_are_kept_or_not(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(evaluation, "TRIALS", 2)
    straight(tmp_path)
    asked = StudyContext("base.toml", ("plan", "margins", "execution"))
    bare = evaluation.evaluate(Run("key", (), asked), tmp_path)
    kept = evaluation.evaluate(Run("key", (), replace(asked, keep=("plan",))), tmp_path)
    assert kept.answers == bare.answers
    assert kept.answers["verdict"] == "CERTIFIED"
    assert "nominal" in json.loads(zlib.decompress(kept.kept))["description"]
    assert bare.kept == b""
