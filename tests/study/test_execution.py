"""Plans of a study executed: the same trials as of the plan alone, with the interval of their share."""

from __future__ import annotations

import json
import zlib
from dataclasses import replace
from pathlib import Path

import pytest

from fmopt.execution import trials
from fmopt.plan import parsed
from fmopt.study import evaluation
from fmopt.study.results.shares import share
from fmopt.study.running.batch import Question, Run
from tests.shared.studies.problems import straight


def test_a_run_says_how_often_its_plan_succeeds(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(evaluation, "TRIALS", 4)
    straight(tmp_path)
    row = evaluation.evaluate(Run("key", (), Question("base.toml", ("plan", "execution"), ("plan",))), tmp_path)
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
    asked = Question("base.toml", ("plan", "margins", "execution"))
    bare = evaluation.evaluate(Run("key", (), asked), tmp_path)
    kept = evaluation.evaluate(Run("key", (), replace(asked, keep=("plan",))), tmp_path)
    assert kept.answers == bare.answers
    assert kept.answers["verdict"] == "CERTIFIED"
    assert "nominal" in json.loads(zlib.decompress(kept.kept))["description"]
    assert bare.kept == b""
