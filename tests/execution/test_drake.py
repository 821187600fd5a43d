"""Drake's point contact as the rig's engine: it seats what fits, keeps out what does not, and is named in the files."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial import ConvexHull
from typer.testing import CliRunner

import fmopt
from fmopt.cli import app
from fmopt.errors import FmoptError, ResourceError, SettingsError
from fmopt.execution import execute as running
from fmopt.execution.engines.catalogue import ENGINES
from fmopt.execution.engines.drake_engine import DRAKE, with_corners
from fmopt.execution.engines.engine import Bodies, Engine, Setup
from fmopt.execution.engines.mujoco_engine import MUJOCO
from fmopt.execution.execute import run_all
from fmopt.execution.robot import Robot
from fmopt.execution.rotation import quaternions
from fmopt.execution.trials import Trials, run
from fmopt.plan import parsed
from fmopt.spatial.values import Array

Plan = dict[str, Any]
THREE = Trials(3, seed=1, engine="drake")
BOX = np.array([[x, y, z] for x in (-0.01, 0.01) for y in (-0.01, 0.01) for z in (0.0, 0.04)])


@pytest.fixture(scope="module")
def records(square_peg_plan: Plan) -> list[Any]:
    return run(parsed(square_peg_plan), THREE, range(3))


def setup(document: Plan, time_step: float | None = None) -> Setup:
    clearance = float(document["parts"]["moving"]["measured_clearance"])
    return Setup(Bodies.of(parsed(document)), clearance, Robot(), 0.3, time_step)


def placed(document: Plan, shifts: Array, name: str) -> Engine:
    """Parts at the goal, shifted by (n, 3), m."""
    goal = np.array(document["goal"])
    q = np.tile(quaternions(goal[3:]), (len(shifts), 1))
    return ENGINES[name].scene(setup(document))((goal[:3] + shifts, q))


def test_the_plan_seats_the_peg_in_a_second_engine(records: list[Any]) -> None:
    assert [record["reasons"] for record in records] == [[]] * 3
    # Contacts are where the plan has them; which trials lose one for a moment hangs on the last digits of the plan.
    assert sum(not record["departures"] for record in records) >= 2


def test_a_trial_is_its_seed_and_number_in_every_company(square_peg_plan: Plan, records: list[Any]) -> None:
    [alone] = run(parsed(square_peg_plan), THREE, [2])
    assert json.dumps(alone) == json.dumps(records[2])


@pytest.mark.wide
def test_an_interference_of_10_micrometres_keeps_the_part_out(square_peg_plan: Plan) -> None:
    growth = square_peg_plan["parts"]["moving"]["measured_clearance"] + 1e-5
    [record] = run(parsed(square_peg_plan), Trials(1, growth=growth, recovery=False, engine="drake"), [0])
    assert not record["success"]
    assert record["offset"][2] > 0.9 * -square_peg_plan["goal"][2]


def test_a_start_far_beyond_what_the_plan_allows_for_fails(square_peg_plan: Plan) -> None:
    [record] = run(parsed(square_peg_plan), Trials(1, offset=3e-3, recovery=False, engine="drake"), [0])
    assert record["reasons"][0] == "stopped on the way"


@pytest.mark.parametrize("name", ENGINES)
def test_what_presses_a_part_at_rest_is_what_its_contacts_bear(square_peg_plan: Plan, name: str) -> None:
    engine, wrench = placed(square_peg_plan, np.zeros((2, 3)), name), np.zeros((2, 6))
    wrench[:, :3] = [[-3.0, -4.0, -10.0], [0.0, 0.0, -5.0]]
    engine.qvel[1, :3] = [0.0, 0.0, 0.01]
    for _ in range(200):
        engine.advance(wrench, 1e-3)
    assert np.abs(engine.reaction + wrench)[:, :3].max() < 0.05
    assert np.abs(engine.qvel[:, :3]).max() < 1e-4
    assert (engine.depth < 1e-5).all()


def test_contacts_add_up_to_the_reaction_and_are_at_the_corners(square_peg_plan: Plan) -> None:
    engine = placed(square_peg_plan, np.zeros((1, 3)), "drake")
    for _ in range(100):
        engine.advance(np.array([[-3.0, -4.0, -10.0, 0.0, 0.0, 0.0]]), 1e-3)
    found = engine.contacts[0][engine.contacts[0, :, 0] > 0.0]
    assert len(found) >= 6
    assert found[:, 1:4].sum(axis=0) == pytest.approx(engine.reaction[0, :3], abs=1e-6)
    moments = np.cross(found[:, 5:] - engine.qpos[0, :3], found[:, 1:4]).sum(axis=0)
    assert moments == pytest.approx(engine.reaction[0, 3:], abs=1e-4)
    assert ((found[:, 4] < 0.0) & (found[:, 4] >= -engine.depth[0])).all()
    # The floor bears at the corners of the part.
    floor = found[np.abs(found[:, 7] - engine.qpos[0, 2]) < 1e-5, 5:]
    corners = BOX[BOX[:, 2] == 0.0] + engine.qpos[0, :3]
    assert len(floor) >= 3
    assert np.linalg.norm(floor[:, None] - corners, axis=2).min(axis=1).max() < 2e-3


@pytest.mark.parametrize("name", ENGINES)
def test_a_free_part_moves_as_its_wrench_says(square_peg_plan: Plan, name: str) -> None:
    engine, robot = placed(square_peg_plan, np.array([[0.0, 0.0, 0.2]]), name), Robot()
    engine.advance(np.array([[1.0, 0.0, 2.0, 0.0, 0.01, 0.0]]), robot.period)
    assert engine.qvel[0, :3] == pytest.approx(np.array([1.0, 0.0, 2.0]) * robot.period / robot.mass, rel=1e-9)
    assert engine.qvel[0, 3:] == pytest.approx(np.array([0.0, 0.01, 0.0]) * robot.period / robot.inertia, rel=1e-6)
    assert not engine.contacts.any()
    assert not engine.reaction.any()


def test_corners_leave_the_solid_as_it_is() -> None:
    whole, *others = with_corners(BOX)
    assert whole is BOX
    assert len(others) == 8 + 4
    planes = ConvexHull(BOX).equations
    for points in others:
        assert (points @ planes[:, :3].T + planes[:, 3]).max() < 1e-12
        assert ConvexHull(points).volume > 0.0
    held = [sum(point in BOX.tolist() for point in points.tolist()) for points in others]
    assert held == [1] * 8 + [2] * 4
    assert sorted(round(1e3 * np.ptp(points[:, 2])) for points in others) == [1] * 8 + [40] * 4


def test_a_contact_query_that_gives_up_is_asked_again_beside(square_peg_plan: Plan) -> None:
    engine: Any = placed(square_peg_plan, np.zeros((1, 3)), "drake")
    real, failures = engine._found, [1, 0]

    class GivesUp:
        def Eval(self, context: Any) -> Any:
            if failures:
                failures.pop()
                raise RuntimeError("origin outside the polytope")
            return real.Eval(context)

    engine._found = GivesUp()
    engine.advance(np.array([[0.0, 0.0, -5.0, 0.0, 0.0, 0.0]]), 1e-3)
    assert failures == []
    failures.extend(range(9))
    with pytest.raises(FmoptError, match=r"finds no contacts at .* origin outside the polytope"):
        engine.advance(np.zeros((1, 6)), 1e-3)


def test_files_name_the_engine_and_are_not_gone_on_with_by_another(square_peg_plan: Plan, tmp_path: Path) -> None:
    for name, other in (("drake", "mujoco"), ("mujoco", "drake")):
        file = tmp_path / f"{name}.jsonl"
        running._keep(file, running._head(parsed(square_peg_plan), Trials(0, engine=name)), {})
        assert run_all(parsed(square_peg_plan), Trials(0, engine=name), file, 1, lambda _: None) == []
        with pytest.raises(ResourceError, match="holds trials with another engine; choose another folder"):
            run_all(parsed(square_peg_plan), Trials(0, engine=other), file, 1, lambda _: None)
    assert json.loads((tmp_path / "drake.jsonl").read_text())["engine"] == "drake"
    # Files that were written before there was a choice go on.
    assert "engine" not in json.loads((tmp_path / "mujoco.jsonl").read_text())


def test_a_time_step_that_is_too_long_is_refused(square_peg_plan: Plan) -> None:
    for maker in (MUJOCO, DRAKE):
        with pytest.raises(SettingsError, match=r"time step 0\.002"):
            maker.scene(setup(square_peg_plan, 0.002))


def test_the_command_names_the_missing_extra_in_one_line(
    square_peg_plan_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("pydrake", "pydrake.multibody.plant"):
        monkeypatch.setitem(sys.modules, name, None)
    arguments = ["execute", str(square_peg_plan_file), "--engine", "drake", "--out", str(tmp_path / "new")]
    with pytest.raises(ResourceError) as caught:
        CliRunner().invoke(app, arguments, catch_exceptions=False)
    assert str(caught.value) == "execution in Drake needs the extra drake; install fmopt[drake]"
    assert caught.value.exit_code == 4
    assert not (tmp_path / "new").exists()


@pytest.mark.wide
def test_from_python_each_engine_has_its_own_folder(square_peg_plan_file: Path, records: list[Any]) -> None:
    plan = fmopt.read(square_peg_plan_file)
    found = plan.execute(Trials(1, seed=1, engine="drake"), workers=1)
    assert found.folder.name == f"trials-{plan.document['sha256'][:12]}-drake"
    assert found.records == json.loads(json.dumps(records[:1]))
    with pytest.raises(ValueError, match="'bullet' is none of mujoco, drake"):
        plan.execute(fmopt.Trials(1, engine="bullet"))


def test_an_engine_that_is_none_is_bad_input(square_peg_plan_file: Path) -> None:
    done = CliRunner().invoke(app, ["execute", str(square_peg_plan_file), "--engine", "bullet"])
    assert done.exit_code == 2
    assert "'bullet' is none of mujoco, drake" in done.output
