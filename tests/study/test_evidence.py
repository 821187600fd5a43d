"""Evidence of presses in studies: one plan carried out as it is over variants, the same draws in each."""

import json
import zlib
from pathlib import Path
from typing import Any

import pytest

from fmopt import plan
from fmopt.errors import InputError
from fmopt.execution.confidence import lower_bound, success_interval
from fmopt.planning.press import solve
from fmopt.study import evaluation
from fmopt.study.design import load_study
from fmopt.study.results.shares import difference
from fmopt.study.running.batch import Run, StudyContext
from fmopt.verify import verify
from tests import PROBLEMS, ROOT
from tests.shared.plans.press_plan import press_plan, press_plan_document

FRICTION = ("specification", "friction")
STUDY = """title = "t"
problem = "base.toml"
plan = "plan.json"
compute = ["evidence"]
axes = [{ name = "mu", sets = ["specification.friction"], values = [0.2, 0.4] }]
[units]
length = "mm"
angle = "deg"
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with the square peg, ten draws asked for, a plan of presses for it, and a study of both."""
    text = (PROBLEMS / "square_peg.toml").read_text("utf-8").replace("../models", str(ROOT / "models"))
    changed = text.replace('evidence = "certified"', 'evidence = "tested"\ndraws = 10\nmin_rate = 0.3')
    (tmp_path / "base.toml").write_text(changed, "utf-8")
    plan.write(press_plan_document(), tmp_path / "plan.json")
    (tmp_path / "study.toml").write_text(STUDY, "utf-8")
    return tmp_path


@pytest.mark.parametrize("vertices", [64, 0])
def test_a_known_plan_is_tried_with_parts_and_errors_of_each_run(
    vertices: int, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[Any] = []
    real = solve.examine

    def examined(*arguments: Any) -> Any:
        asked.append(arguments)
        return real(*arguments)

    monkeypatch.setattr(solve, "examine", examined)
    asked_for = load_study(folder / "study.toml").question
    assert [Path(name).name for name in (asked_for.problem, asked_for.plan)] == ["base.toml", "plan.json"]
    wide = (("fixed", "parameters", "width"), "20.3 mm"), *((("clearance", axis), "0.15 mm") for axis in "xy")
    question = StudyContext("base.toml", ("evidence",), ("plan",), "plan.json")
    assigned = (FRICTION, "0.2"), (("settings", "vertices"), vertices > 0), *wide
    row = evaluation.evaluate(Run("a", assigned, question), folder)
    ((_, carried, conditions, request, _),) = asked
    assert carried.attempts == press_plan().attempts
    assert (carried.seat.clearance, press_plan().seat.clearance) == pytest.approx((1.5e-4, 1e-4))
    assert (conditions.friction, request.draws, request.seed) == ((0.2, 0.2), 10, 1)
    answers = row.answers
    assert answers["bound"] == lower_bound(int(answers["seated"] or 0), 10)
    assert str(answers["seats"]).count("1") == answers["seated"]
    kept = json.loads(zlib.decompress(row.kept))
    assert kept["evidence"]["vertices"] == vertices
    assert vertices or kept["verdict"] == "NOT_PROVED"
    assert str(verify(kept).verdict) == kept["verdict"] == answers["verdict"]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('["evidence"]', '["evidence", "margins"]', "'evidence' is of presses, 'margins' of guarded moves"),
        ('["evidence"]', '["clearance"]', "a plan is named, but no evidence is computed"),
        ("plan.json", "base.toml", "no JSON"),
        ("plan.json", "none.json", "none.json"),
    ],
)
def test_what_cannot_be_tried_is_refused(folder: Path, old: str, new: str, message: str) -> None:
    (folder / "study.toml").write_text(STUDY.replace(old, new), "utf-8")
    with pytest.raises(InputError, match=message):
        load_study(folder / "study.toml")


def test_differences_are_told_from_draws_that_both_runs_have() -> None:
    found = difference("11110", "10100")
    more, none = (success_interval(count, 5, 0.975) for count in (2, 0))
    assert (found.value, found.low, found.high) == (0.4, more[0] - none[1], more[1] - none[0])
    same = difference("1" * 96, "1" * 96)
    assert (same.value, -same.low) == (0.0, same.high)
    assert same.high < 0.05
