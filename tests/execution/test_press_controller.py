"""The controller of presses in MuJoCo alone, and a robot that runs the exported program, on draws of the evidence."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

import fmopt.press
from fmopt.execution.engines.engine import Bodies
from fmopt.execution.mjcf import mjcf
from fmopt.execution.press_controller import Errors
from fmopt.plan import Plan
from fmopt.plan.export.press_script import program
from fmopt.spatial.se3 import Pose
from tests.shared.plans.press_plan import BASE, drawn, press_plan
from tests.shared.urscript.language import faults
from tests.shared.urscript.language import parsed as syntax
from tests.shared.urscript.press_robot import PressModeRobot


def in_mujoco(plan: Plan, errors: Errors) -> tuple[bool, float]:
    """Whether one part is seated, and after how many seconds, in a scene of MuJoCo that nothing of fmopt steps."""
    model = mujoco.MjModel.from_xml_string(mjcf(plan))
    model.geom_friction[:, 0] = errors.friction[0]
    data, presses = mujoco.MjData(model), press_plan()
    controller = fmopt.press.Controller(presses, errors=errors)
    data.qpos[:] = controller.starts[0]
    substeps, reaction, R = round(presses.robot.period / model.opt.timestep), np.zeros((1, 6)), np.zeros(9)
    while not controller.done[0]:
        command = controller.step(data.qpos[None], reaction, data.qvel[None])
        model.dof_damping[:3] = command.damping[0]
        mujoco.mju_quat2Mat(R, data.qpos[3:])
        turn, reaction = R.reshape(3, 3), np.zeros((1, 6))
        data.qfrc_applied[:] = np.concatenate([command.wrench[0, :3], turn.T @ command.wrench[0, 3:]])
        for _ in range(substeps):
            mujoco.mj_step(model, data)
            reaction[0] += data.qfrc_constraint / substeps
        reaction[0, 3:] = turn @ reaction[0, 3:]
    return bool(controller.seated[0]), controller.time


def test_the_controller_seats_the_part_in_mujoco_alone_as_the_plan_does(plan: Plan) -> None:
    errors, outcomes = drawn(2)
    for k, one in enumerate(outcomes):
        seated, seconds = in_mujoco(plan, errors.of([k]))
        assert seated == one.seated
        assert seconds == pytest.approx(one.seconds, abs=0.5)


@pytest.mark.parametrize("tcp", [(0.0,) * 6, (0.02, -0.01, 0.15, 0.3, 0.1, 0.8)])
def test_the_program_seats_the_part_as_the_plan_does(plan: Plan, tcp: tuple[float, ...]) -> None:
    held = replace(plan, description=replace(plan.description, tcp=tcp))
    text = program(held, press_plan(), BASE)
    assert faults(syntax(text)) == []
    errors, outcomes = drawn(2)
    for k, one in enumerate(outcomes):
        robot = PressModeRobot(Bodies.of(plan), press_plan(), BASE, errors.of([k]), k, Pose.from_vector(tcp))
        assert robot.run(text).seated == one.seated == (robot.outcome == 0.0)
        assert robot.log == ["fmopt: seated"]


def test_a_part_beside_the_hole_is_brought_back_and_the_outcome_told(plan: Plan) -> None:
    presses = replace(press_plan(), attempts=press_plan().attempts[:1])
    errors, _ = drawn(1)
    errors.start[0, :2] = 0.015, 0.001
    robot = PressModeRobot(Bodies.of(plan), presses, BASE, errors, 0)
    assert not robot.run(program(plan, presses, BASE)).seated
    assert (robot.outcome, robot.log) == (2.0, ["fmopt: no attempt seated the part"])
    assert robot.believed.vector() == pytest.approx(np.array(presses.attempts[0].start), abs=3e-4)
