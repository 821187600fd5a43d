"""Trials: what is drawn, runs taken up again, intervals, and the command."""

from __future__ import annotations

import json
import re
import signal
import sys
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from PIL import Image, ImageSequence
from typer.testing import CliRunner

from fmopt import plan
from fmopt.cli import app
from fmopt.errors import Interruption, ResourceError, SettingsError
from fmopt.execution import execute as running
from fmopt.execution.confidence import success_interval
from fmopt.execution.execute import run_all
from fmopt.execution.noise import Noise
from fmopt.execution.program import FAILED, planned
from fmopt.execution.replay import SLOWER, replay
from fmopt.execution.rig import Event, Rig
from fmopt.execution.robot import Robot
from fmopt.execution.summary import Fit, Log, failures, lines, note, summary
from fmopt.execution.trials import Trials, draw, run
from fmopt.plan import parsed
from fmopt.spatial.se3 import Pose
from tests.shared.trial_records import record

FOUR = Trials(4, seed=1)


def test_draws_are_of_their_numbers_alone_and_of_their_size(square_peg_plan: dict[str, Any]) -> None:
    plan = parsed(square_peg_plan)
    program = planned(plan, Robot())
    wanted = Trials(40, 40, reach=2.0, seed=3)
    box = np.array(square_peg_plan["uncertainty"]["start_box"])
    draws = [draw(plan, program, wanted, n) for n in range(80)]
    again = draw(plan, program, wanted, 57)
    assert np.array_equal(again.start, draws[57].start)
    assert np.array_equal(again.drift, draws[57].drift)
    assert not np.array_equal(draw(plan, program, Trials(40, 40, seed=4), 57).start, again.start)
    for n, one in enumerate(draws):
        share = np.abs(one.start[box > 0.0] / box[box > 0.0]).max()
        assert one.size == pytest.approx(share, rel=1e-12)
        assert (share <= 1.0) if n < 40 else (1.0 <= share <= 2.0)
        assert not one.start[box == 0.0].any()
    t, r = square_peg_plan["uncertainty"]["velocity_error"]
    drift = np.concatenate([one.drift for one in draws]) / program.speed
    assert 0.9 * t < np.linalg.norm(drift[:, :3], axis=1).max() <= t
    assert 0.9 * r < program.rho * np.linalg.norm(drift[:, 3:], axis=1).max() <= r


def test_noise_of_a_trial_does_not_depend_on_its_company() -> None:
    alone, together = Noise(5, [7]), Noise(5, [1, 7, 9])
    for _ in range(300):
        assert np.array_equal(alone()[0], together()[1])


@pytest.fixture(scope="module")
def written(square_peg_plan: dict[str, Any], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The file of four trials of the plan."""
    file = tmp_path_factory.mktemp("trials") / "trials.jsonl"
    run_all(parsed(square_peg_plan), FOUR, file, 1, lambda _: None)
    return file


def test_the_plan_seats_the_peg_as_planned(written: Path) -> None:
    head, *records = [json.loads(line) for line in written.read_text().splitlines()]
    assert head["seed"] == FOUR.seed
    # One trial in some ten to a hundred fails, and which ones do hangs on the last digits of the plan.
    seated = [one for one in records if one["success"]]
    assert len(records) == 4
    assert len(seated) >= 2
    assert [one["departures"] for one in seated] == [[]] * len(seated)


def test_a_run_goes_on_to_the_same_bytes(square_peg_plan: dict[str, Any], written: Path, tmp_path: Path) -> None:
    (tmp_path / "part.jsonl").write_text("".join(written.read_text().splitlines(keepends=True)[:4]))
    told: list[int] = []
    run_all(parsed(square_peg_plan), FOUR, tmp_path / "part.jsonl", 1, told.append)
    assert (tmp_path / "part.jsonl").read_text() == written.read_text()
    assert told == [3, 1]


def test_more_trials_go_on_with_those_that_are_there(
    square_peg_plan: dict[str, Any], written: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "t.jsonl"
    file.write_text(written.read_text())
    asked: list[list[int]] = []

    def made(_: Any, trials: Trials, numbers: list[int], told: Callable[[list[Any]], None]) -> None:
        asked.append(list(numbers))
        told([record(n, 0.5 if n < trials.inside else 1.5) for n in numbers])

    monkeypatch.setattr(running, "run", made)
    records = run_all(parsed(square_peg_plan), Trials(6, 2, seed=1), file, 1, lambda _: None)
    assert asked == [[4, 5, 6, 7]]
    assert [json.dumps(one, sort_keys=True) for one in records[:4]] == written.read_text().splitlines()[1:]
    assert run_all(parsed(square_peg_plan), Trials(6, 3, seed=1), file, 1, lambda _: None)[:8] == records
    assert asked[1:] == [[8]]
    kept = file.read_bytes()
    for inside, beyond in ((5, 4), (7, 3), (9, 0), (6, 2)):
        with pytest.raises(ResourceError, match=f"--trials {inside} --beyond {beyond} does not ask for, of --trials 6"):
            run_all(parsed(square_peg_plan), Trials(inside, beyond, seed=1), file, 1, lambda _: None)
    assert file.read_bytes() == kept


def test_a_file_of_other_trials_is_not_gone_on_with(square_peg_plan: dict[str, Any], tmp_path: Path) -> None:
    run_all(parsed(square_peg_plan), Trials(0, seed=1), tmp_path / "t.jsonl", 1, lambda _: None)
    running._keep(tmp_path / "t.jsonl", {"seed": 2}, {})
    with pytest.raises(ResourceError, match="another plan, reach, seed"):
        run_all(parsed(square_peg_plan), Trials(0, seed=1), tmp_path / "t.jsonl", 1, lambda _: None)
    (tmp_path / "t.jsonl").write_text("what?\n")
    with pytest.raises(ResourceError, match="no file of trials"):
        run_all(parsed(square_peg_plan), Trials(0, seed=1), tmp_path / "t.jsonl", 1, lambda _: None)


@pytest.mark.parametrize("error", [KeyboardInterrupt(), Interruption(signal.SIGTERM)])
def test_an_interrupt_keeps_what_has_ended_and_tells_how_to_go_on(
    square_peg_plan: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: BaseException
) -> None:
    def interrupted(_: Any, __: Trials, numbers: list[int], told: Callable[[list[Any]], None]) -> None:
        told([record(numbers[1], 0.5)])
        raise error

    monkeypatch.setattr(running, "run", interrupted)
    with pytest.raises(type(error)) as caught:
        run_all(parsed(square_peg_plan), Trials(3), tmp_path / "t.jsonl", 1, lambda _: None)
    assert re.search(r"1 of 3 trials are done, and kept in .*t\.jsonl; run it again", caught.value.__notes__[0])
    assert [json.loads(line)["trial"] for line in (tmp_path / "t.jsonl").read_text().splitlines()[1:]] == [1]


def test_records_come_as_trials_end_and_are_those_of_the_run(square_peg_plan: dict[str, Any], written: Path) -> None:
    told: list[Any] = []
    records = run(parsed(square_peg_plan), FOUR, [1, 3], told.extend)
    assert sorted(told, key=lambda one: one["trial"]) == records
    lines = written.read_text().splitlines()[1:]
    assert [json.dumps(one, sort_keys=True) for one in records] == [lines[1], lines[3]]


def test_numbers_that_cannot_be_meant_are_refused_from_python_too() -> None:
    for wrong in ({"growth": np.inf}, {"offset": np.nan}, {"time_step": 0.0}, {"friction": -1.0}, {"reach": 0.5}):
        with pytest.raises(SettingsError, match="give a number from"):
            Trials(1, **wrong)


def test_moves_that_failed_are_counted_from_one() -> None:
    steps = [SimpleNamespace(move=0), SimpleNamespace(move=1)]
    rig = SimpleNamespace(program=SimpleNamespace(steps=steps), state=SimpleNamespace(step=[FAILED]))
    log = Log()
    note(log, Event(0, 1, 0.5), cast(Rig, rig), (), {}, Fit(1e-4, 0.03, 0.01, Pose.identity(), 0.0))
    assert log.departures == ["move 2: contact not felt"]


def test_what_touches_where_the_parts_are_to_touch_is_as_planned(square_peg_plan: dict[str, Any]) -> None:
    read = parsed(square_peg_plan)
    fit, rng = Fit.of(read), np.random.default_rng(3)
    seated, clearance = Pose.from_vector(read.goal), Fit.of(read).clearance
    tip = np.array([corner for corner in read.moving.body.vertices if corner[2] < 1e-9])
    for _ in range(20):
        # Anywhere under a tip that stands on the ground of its hole, wherever the part is now; not where it would not.
        now = Pose.from_vector([*rng.uniform(-1e-3, 1e-3, 3), *rng.uniform(-0.1, 0.1, 3)])
        point = now.apply(rng.dirichlet(np.ones(len(tip))) @ tip)
        assert fit.meet(point, now, seated)
        assert fit.meet(point, now, seated.moved([0.0, 0.0, 0.2 * clearance, 0.0, 0.0, 0.0]))
        assert not fit.meet(point, now, seated.moved([0.0, 0.0, 5.0 * clearance, 0.0, 0.0, 0.0]))


def test_summaries_tell_inside_from_beyond_and_group_failures_by_what_went_wrong_first() -> None:
    records = [record(0, 0.9), record(1, 0.2, True, ("move 1: a open",)), record(2, 1.0, False, ("move 2: b open",))]
    records += [record(3, 1.1), record(4, 1.6, False), record(5, 1.7, False, ("move 2: b open", "move 3: c open"))]
    found = summary(records)
    assert (found["inside"]["successes"], found["beyond"]["successes"]) == (2, 1)
    assert found["inside"]["as_planned"] == pytest.approx(1.0 / 3.0)
    assert found["departures"] == {"move 1: a open": 1, "move 2: b open": 1}
    assert [(row["size"], row["trials"], row["share"]) for row in found["by_size"]] == [
        ([0.0, 0.25], 1, 1.0),
        ([0.75, 1.0], 2, 0.5),
        ([1.0, 1.25], 1, 1.0),
        ([1.5, 1.75], 2, 0.0),
    ]
    assert failures(records) == [
        {"departure": "move 2: b open", "count": 2, "trials": [2, 5]},
        {"departure": "tilted", "count": 1, "trials": [4]},
    ]
    text = "\n".join(lines({**found, "contact_force": 15.0}))
    assert lines({**found, "contact_force": 15.0, "verdict": "NOT_PROVED"})[0].startswith("the plan is NOT_PROVED")
    assert "force up to 10.0 N filtered, impact 20.0 N, penetration up to 10.0 µm; asked for 15 N of contact" in text
    assert "inside the certified set: 2 of 3 seated, 66.7 %" in text
    assert "errors of 0.75 to 1.00 boxes (inside): 50.0 % of 2 seated" in text
    assert "errors of 1.50 to 1.75 boxes (beyond): 0.0 % of 2 seated" in text
    assert "2 failed, first: move 2: b open; such as trial 2" in text


def test_no_trials_are_refused(square_peg_plan_file: Path) -> None:
    done = CliRunner().invoke(app, ["execute", str(square_peg_plan_file), "--trials", "0"])
    assert done.exit_code == 2
    assert "no trials" in done.stderr


def test_the_command_tells_and_keeps_the_summary(square_peg_plan_file: Path, written: Path, tmp_path: Path) -> None:
    (tmp_path / "trials.jsonl").write_text(written.read_text())
    arguments = ["execute", str(square_peg_plan_file), "--trials", "4", "--seed", "1", "--out", str(tmp_path)]
    ran = CliRunner().invoke(app, [*arguments, "--json", "--workers", "1"])
    assert ran.exit_code == 0, ran.output
    found = json.loads(ran.stdout)
    seated = sum(json.loads(line)["success"] for line in written.read_text().splitlines()[1:])
    assert found["inside"]["successes"] == seated >= 2
    assert found["contact_force"] == plan.read_document(square_peg_plan_file)["specification"]["contact_force"]
    assert json.loads((tmp_path / "summary.json").read_text()) == found
    told = CliRunner().invoke(app, arguments).stdout
    low, high = (100.0 * share for share in success_interval(seated, 4))
    interval = f"(95 % interval {low:.1f} to {high:.1f} %)"
    words = f"inside the certified set: {seated} of 4 seated, {25.0 * seated:.1f} % {interval}"
    assert words in told


def test_the_command_names_the_missing_extra_in_one_line(
    square_peg_plan_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(ResourceError) as caught:
        CliRunner().invoke(app, ["execute", str(square_peg_plan_file), "--out", str(tmp_path)], catch_exceptions=False)
    assert caught.value.exit_code == 4
    assert str(caught.value).count("\n") == 0
    assert "install mujoco" in str(caught.value)


def test_a_replay_is_the_trial_and_moves(square_peg_plan: dict[str, Any], written: Path, tmp_path: Path) -> None:
    record = replay(parsed(square_peg_plan), FOUR, 2, tmp_path / "trial.gif")
    assert json.loads(json.dumps(record)) == json.loads(written.read_text().splitlines()[3])
    with Image.open(tmp_path / "trial.gif") as picture:
        every = ImageSequence.Iterator(picture)
        shown = [(np.asarray(one.convert("RGB"), dtype=float), one.info["duration"]) for one in every]
    frames = [frame for frame, _ in shown]
    # Pictures in which nothing moved are one, shown the longer.
    assert sum(time for _, time in shown) == pytest.approx(1e3 * SLOWER * record["seconds"], rel=0.05)
    assert np.abs(frames[0] - frames[-1]).mean() > 1.0
    reddest = np.max(frames[0][..., 0] - frames[0][..., 2])
    assert np.median(frames[0]) > 150.0  # on a bright ground
    assert reddest > 100.0  # the moving part, orange, is lit
