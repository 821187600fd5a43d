"""What people do without a plan, and the controls: what does not fit must fail, whatever the method."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from fmopt.cli import app
from fmopt.execution import execute as running
from fmopt.execution.baselines import BASELINES, BaselineTask, tilt
from fmopt.execution.program import DONE, FAILED
from fmopt.execution.robot import Robot
from fmopt.execution.trials import Trials, grown, run
from fmopt.plan import parsed


def exact(document: dict[str, Any], error: float = 0.0) -> dict[str, Any]:
    """The plan with another start error, m in x and y, nothing else."""
    uncertainty = {**document["uncertainty"], "start_box": [error, error, 0.0, 0.0, 0.0, 0.0]}
    return {**document, "uncertainty": uncertainty}


@pytest.mark.parametrize("name", BASELINES)
def test_steps_lead_to_steps_and_to_the_end(square_peg_plan: dict[str, Any], name: str) -> None:
    program = BASELINES[name](parsed(square_peg_plan), Robot())
    seen: set[int] = set()
    ahead = {0}
    while ahead:
        step = program.steps[ahead.pop()]
        ways = {step.on_stop, step.on_end, step.on_late}
        ahead |= {way for way in ways - seen if way >= 0}
        seen |= ways
    assert seen == {DONE, FAILED, *range(1, len(program.steps))}


@pytest.mark.parametrize(("name", "error"), [("push", 5e-5), ("spiral", 2e-4), ("tilt", 5e-4)])
def test_each_method_seats_a_part_that_is_not_far_off(square_peg_plan: dict[str, Any], name: str, error: float) -> None:
    [record] = run(parsed(exact(square_peg_plan, error)), Trials(1, method=name), [0])
    assert record["reasons"] == []
    assert record["departures"] == []


def test_the_tilt_starts_with_one_corner_in_the_hole_whatever_the_error(square_peg_plan: dict[str, Any]) -> None:
    task, program = BaselineTask.of(parsed(square_peg_plan)), tilt(parsed(square_peg_plan), Robot())
    corner = program.start.apply(np.array([[-task.half[0], -task.half[1], 0.0]]))[0]
    walls = np.array(task.half) + task.fit.clearance
    error = np.array(square_peg_plan["uncertainty"]["start_box"])[:2]
    assert corner[2] == pytest.approx(0.001)
    assert (corner[:2] - error > -walls).all()
    assert (corner[:2] + error < walls).all()


@pytest.mark.wide
@pytest.mark.parametrize("method", ["plan", "push"])
def test_an_interference_of_10_micrometres_keeps_the_part_out(square_peg_plan: dict[str, Any], method: str) -> None:
    document = square_peg_plan if method == "plan" else exact(square_peg_plan, 2e-5)
    growth = document["parts"]["moving"]["measured_clearance"] + 1e-5
    [record] = run(parsed(document), Trials(1, method=method, growth=growth), [0])
    assert not record["success"]
    assert record["offset"][2] > 0.9 * -square_peg_plan["goal"][2]


@pytest.mark.parametrize("offset", [-3e-3, 3e-3])
def test_a_start_far_beyond_what_the_plan_allows_for_fails(square_peg_plan: dict[str, Any], offset: float) -> None:
    [record] = run(parsed(square_peg_plan), Trials(1, offset=offset), [0])
    assert record["reasons"][0] == "stopped on the way"


def test_growing_moves_the_sides_out_and_nothing_else(square_peg_plan: dict[str, Any]) -> None:
    before = np.array(square_peg_plan["parts"]["moving"]["pieces"][0]["vertices"])
    after = np.array(grown(parsed(square_peg_plan), 1e-4).moving.pieces[0].vertices)
    assert len(after) == len(before) == 8
    for low, high, sides in ((before.min(0), after.min(0), -1.0), (before.max(0), after.max(0), 1.0)):
        assert high - low == pytest.approx([sides * 1e-4, sides * 1e-4, 0.0], abs=1e-12)


def test_the_command_compares_methods_in_one_table(
    square_peg_plan_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def canned(_: Any, trials: Trials, numbers: list[int], told: Callable[[list[Any]], None]) -> None:
        seated = {"plan": 4, "push": 1}.get(trials.method, 2)
        common = {"size": 0.5, "reasons": ["tilted"], "departures": [], "seconds": 4.0, "retries": []}
        forces = {"peak_force": 1.0, "impact_force": 2.0, "penetration": 1e-6}
        told([{"trial": n, "success": n < seated, **common, **forces} for n in numbers])

    monkeypatch.setattr(running, "run", canned)
    arguments = ["compare", str(square_peg_plan_file), "--trials", "4", "--out", str(tmp_path), "--workers", "1"]
    ran = CliRunner().invoke(app, arguments)
    assert ran.exit_code == 0, ran.output
    [row] = json.loads((tmp_path / "comparison.json").read_text())
    successes = {name: part["successes"] for name, part in row["methods"].items()}
    assert successes == {"plan": 4, "push": 1, "spiral": 2, "dither": 2, "tilt": 2}
    told = " ".join(ran.stdout.split())
    for word in ("fit", "plan", "push", "spiral", "dither", "tilt", "100.0 %", "25.0 %", "50.0 %", "4.0 s"):
        assert word in told
