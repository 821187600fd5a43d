"""Where there is no plan: what is said of it, what is drawn, and whether the advice works."""

import json
import pickle
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import fmopt
from fmopt.cli.entry import command
from fmopt.errors import InfeasibleError, InterferenceError, SearchError
from fmopt.notebook.problem import Problem
from fmopt.planning.posed import Posed
from fmopt.report.attempt import Failure
from fmopt.task.sources import Contribution, framing, total
from tests.shared.files.prisms import prism, rectangle, regular


@pytest.fixture(scope="module")
def failed(tmp_path_factory: pytest.TempPathFactory) -> tuple[Problem, SearchError]:
    """A rectangle of nearly thirty to one under errors of many clearances, in a time in which there is no plan."""
    folder = tmp_path_factory.mktemp("rectangle")
    problem = fmopt.load(prism(folder, rectangle(25, 0.9), rectangle(25.06, 0.96), limit=24))
    with pytest.raises(SearchError) as caught:
        fmopt.solve(problem)
    return problem, caught.value


def test_a_failure_says_what_is_missing_and_what_would_work(failed: tuple[Problem, SearchError]) -> None:
    _, error = failed
    failure: Failure = error.failure
    assert failure.stage in {"search", "placement", "control", "begin"}
    assert failure.steps
    assert 1 <= failure.lack.move <= len(failure.steps) + 1
    if failure.lack.short is not None:
        assert 0.0 < failure.lack.short < 0.05  # m: a length of the parts, no stand-in for one
        assert "µm" in failure.reason or "mm" in failure.reason
    for step in failure.steps:
        assert step.margin is None or abs(step.margin) < 0.1
    for before, after in zip(failure.steps, failure.steps[1:], strict=False):
        np.testing.assert_allclose(before.goal, after.start, atol=1e-12)
    assert error.advice == "; or ".join(failure.advice)
    assert "time_limit" in error.advice or not failure.late
    record = json.loads(json.dumps(failure.record(), allow_nan=False))
    assert (record["reason"], len(record["moves"])) == (failure.reason, len(failure.steps))
    assert pickle.loads(pickle.dumps(error)).failure.reason == failure.reason


def test_the_advice_works(failed: tuple[Problem, SearchError]) -> None:
    problem, error = failed
    near = error.failure.nearest
    assert 0.0 < near.share < 1.0
    plan = fmopt.solve(replace(problem, start_box=np.array(near.box)))
    assert plan.proved
    assert plan.margin >= 0.5 * near.margin  # there is more time for it than there was for the share
    assert any(f"{100.0 * near.share:.3g} %" in words for words in error.failure.advice)


def test_errors_of_velocity_are_lowered_too_where_they_alone_forbid_any_plan(tmp_path: Path) -> None:
    task = prism(tmp_path, regular(12, 5), regular(12, 5.05), limit=16, error=0.1)
    problem = fmopt.load(task).with_(uncertainty_velocity_translation=0.01, uncertainty_velocity_rotation=0.01)
    with pytest.raises(SearchError) as caught:
        fmopt.solve(problem)
    near = caught.value.failure.nearest
    assert near.velocity == pytest.approx((0.01 * near.share, 0.01 * near.share))
    advice = caught.value.failure.advice[0]
    assert advice.startswith(f"lower all start errors and errors of velocity to {100.0 * near.share:.3g} %")
    along, about = near.velocity
    lower = problem.with_(
        **{f"uncertainty_start_{axis}": f"{1e3 * near.box[k]} mm" for k, axis in enumerate("xyz")},
        **{f"uncertainty_start_r{axis}": f"{np.degrees(near.box[3 + k])} deg" for k, axis in enumerate("xyz")},
        uncertainty_velocity_translation=along,
        uncertainty_velocity_rotation=about,
    )
    assert fmopt.solve(lower).proved
    assert caught.value.failure.record()["nearest"]["velocity_error"] == [along, about]


def test_what_facets_leave_out_stays_where_stated_errors_are_lowered() -> None:
    problem = fmopt.load(fmopt.example("square_peg"))
    assert np.array_equal(problem.stated_box, problem.start_box)
    np.testing.assert_allclose(problem.under(0.25).start_box, 0.25 * problem.start_box, rtol=1e-12)
    stated = Contribution("as stated", "", problem.start_box)
    facets = Contribution("facets", "ε_v", np.array([1e-5, 1e-5, 1e-5, 0.0, 0.0, 0.0]), "hole", False)
    both = (stated, facets)
    round_ = replace(problem, budget=both, start_box=total(both), framing=framing(both))
    lower = round_.under(0.25)
    np.testing.assert_allclose(lower.start_box, 0.25 * stated.box + facets.box, rtol=1e-12)
    np.testing.assert_allclose(round_.stated_box, stated.box, rtol=1e-12)
    assert [one.stated for one in lower.budget] == [True, False]
    assert lower.framing.hole[0] > round_.framing.hole[0]


def test_a_failure_is_drawn(failed: tuple[Problem, SearchError], tmp_path: Path) -> None:
    _, error = failed
    page = error.failure.page()
    assert error.failure.moving.name in page
    assert "No plan" in page
    assert "http" not in page.replace("http-equiv", "")
    assert page.count("<figure>") == 1
    assert "1000000" not in page
    assert "1e+06" not in page
    figure = error.failure.figures["attempt"]
    assert figure.svg() == figure.svg()
    assert figure.png(30.0).startswith(b"\x89PNG")
    assert f"end of move {len(error.failure.steps)}" in figure.alt


def test_more_time_is_advised_where_time_was_short_and_helps() -> None:
    short = fmopt.load(fmopt.example("square_peg")).with_(settings_time_limit="1e-3 s")
    with pytest.raises(SearchError) as caught:
        fmopt.solve(short)
    assert caught.value.failure.late
    assert "raise settings.time_limit" in caught.value.advice
    assert fmopt.solve(short.with_(settings_time_limit="60 s")).proved


def test_a_start_is_said_to_be_too_low_where_errors_could_bring_the_part_to_the_top() -> None:
    peg = fmopt.load(fmopt.example("square_peg")).with_(settings_time_limit="1e-3 s", uncertainty_start_z="0.2 mm")
    for height, low in (("0.25 mm", True), ("1 mm", False)):
        with pytest.raises(SearchError) as caught:
            fmopt.solve(peg.with_(start_height=height))
        assert ("raise start.height to 1 mm: it is 250 µm" in caught.value.advice) is low
        assert ("start.height" in caught.value.advice) is low
    advised = peg.with_(start_height="1 mm", settings_time_limit="60 s")
    assert fmopt.solve(advised).proved


def test_the_command_writes_page_and_figure(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys) -> None:  # type: ignore[no-untyped-def]
    task = prism(tmp_path, rectangle(25, 2.5), rectangle(25.1, 2.6), limit=4)
    out = tmp_path / "out"
    out.mkdir()
    (out / "plan.json").write_text("of an earlier run")
    monkeypatch.setattr("sys.argv", ["fmopt", "solve", str(task), "--out", str(out), "--json"])
    assert command() == 3
    said = json.loads(capsys.readouterr().out)
    assert said["exit_code"] == 3
    failure = said["error"]["failure"]
    assert failure["start_box"][:2] == pytest.approx([1e-3, 1e-3])
    assert failure["advice"]
    assert (out / "attempt.html").read_text(encoding="utf-8").startswith("<!DOCTYPE html>")
    if failure["moves"]:
        assert (out / "figures" / "attempt.svg").is_file()
        assert (out / "figures" / "attempt.png").is_file()
    assert not (out / "plan.json").exists()
    assert (out / "earlier-plan.json").read_text() == "of an earlier run"


def test_only_parts_that_interfere_prove_that_there_is_no_motion() -> None:
    assert (InterferenceError.exit_code, InfeasibleError.exit_code, SearchError.exit_code) == (1, 3, 3)


@pytest.mark.parametrize("n", [4, 5, 8, 24])
@pytest.mark.parametrize("clearance", [0.0, -0.02, 1e-7])
def test_a_fit_without_clearance_is_refused_with_number_and_place(n: int, clearance: float, tmp_path: Path) -> None:
    problem = fmopt.load(prism(tmp_path, regular(n, 10.0), regular(n, 10.0 + clearance), stated=0))
    with pytest.raises(InterferenceError) as caught:
        Posed.of(problem)
    assert caught.value.exit_code == 1
    assert caught.value.interference == pytest.approx(1e-3 * max(-clearance, 0.0), abs=1e-8)
    said = "no clearance" if clearance > -1e-3 else "too thick by 0.020000 mm"
    assert said in str(caught.value)
    assert "of the hole" in str(caught.value)
