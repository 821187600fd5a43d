"""The rig for presses led by an exported ROS 2 executor, which is loaded from its folder and knows no more."""

import importlib.util
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import yaml

from fmopt.execution.press_controller import begun
from fmopt.execution.rotation import between, from_quaternions, quaternions
from fmopt.plan.evidence import TrialOutcome
from fmopt.spatial.se3 import Pose
from tests.shared.urscript.press_robot import ONE, REST, PressModeRobot


def loaded(folder: Path) -> ModuleType:
    """The module of an exported folder."""
    spec = importlib.util.spec_from_file_location("exported_executor", folder / "executor.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


class ExecutorRobot(PressModeRobot):
    """One part whose robot is led by target poses and wrenches."""

    def execute(self, folder: Path) -> TrialOutcome:
        """What becomes of the part when the executor of a folder leads it."""
        whole = yaml.safe_load((folder / "presses.yaml").read_text())
        whole["robot"]["damping"] = self.least[[0, 3]].tolist()  # no command comes below that of the robot
        executor, presses = loaded(folder).Executor(whole), [len(one.presses) for one in self.plan.attempts]
        self.at, self.last = (0, -1), np.zeros(7)
        while executor.outcome is None:
            pose, wrench = self.base.compose(self.believed), self._to_base(self.seen[7:])
            q = quaternions(pose.vector()[None, 3:])[0]
            command = executor.step(self.rig.time, np.array([*pose.p, *q[1:], q[0]]), wrench)
            self.obey(command, executor.at, sum(presses[: executor.at[0]]) + executor.at[1])
            self.rig.advance(ONE)
        self.outcome = executor.outcome
        self._held()
        self.state.due[0] = self.state.time[0] + REST
        return self.rig.run()[0]

    def obey(self, command: Any, at: tuple[int, int], press: int) -> None:
        """Takes a command; the speed of held axes is that of the target, and drifts."""
        state, x = self.state, command.pose
        goal = self.base.inverse().compose(Pose(x[:3], from_quaternions(x[[6, 3, 4, 5]])))
        target, period = begun(goal.vector()[None], self.errors.start)[0], self.robot.period
        moved = np.array([*(target[:3] - self.last[:3]), *between(target[3:], self.last[3:])])
        state.twist[0] = 0.0
        if at == self.at and at[1] >= 0:
            twist = np.where(command.gives, 0.0, moved / period)
            sizes = np.repeat(np.linalg.norm(twist.reshape(2, 3), axis=1), 3)
            state.twist[0] = twist + sizes * self.errors.drift[0, :, press]
        else:
            state.p[0], state.q[0] = target[:3], target[3:]
        self.at, self.last = at, target
        state.gives[0] = command.gives
        state.wrench[0] = state.before[0] = self._in_hole(command.wrench)
        resist = np.where(command.gives, command.damping, 0.0)
        resist[3:] = np.minimum(resist[3:], 0.8 * self.robot.inertia / period)
        state.resist[0] = state.resisted[0] = state.resists[0] = resist
