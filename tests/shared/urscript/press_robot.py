"""The rig for presses driven by an exported URScript program, which knows nothing of the plan but its own text.

The program believes that the part is at its nominal start; the errors of the trial are those of the robot and the cell.
"""

from typing import Any

import numpy as np

from fmopt.execution.engines.catalogue import ENGINES
from fmopt.execution.engines.engine import Bodies, Setup
from fmopt.execution.noise import Noise
from fmopt.execution.press_controller import Errors, begun
from fmopt.execution.press_rig import PressRig
from fmopt.execution.press_servo import DONE, HOLDING
from fmopt.execution.press_trials import SOFT
from fmopt.execution.rotation import from_quaternions, product, quaternions
from fmopt.plan.evidence import TrialOutcome
from fmopt.plan.press import PressPlan
from fmopt.spatial.se3 import Pose, exp
from fmopt.spatial.values import Array
from tests.shared.urscript.language import Interpreter, distance, parsed

ONE = np.zeros(1, dtype=np.int64)
REST = 0.2  # s
HELD = Pose.identity()  # the TCP in the frame of the part


class PressModeRobot:
    """One part in the scene of a plan of presses, its robot driven by a program for a base pose of the hole.

    The tool's centre point is at `tcp` in the frame of the part.
    """

    def __init__(
        self, bodies: Bodies, plan: PressPlan, base: Pose, errors: Errors, seed: int, tcp: Pose = HELD
    ) -> None:
        self.plan, self.base, self.errors, self.robot, self.tcp = plan, base, errors, plan.robot, tcp
        setup = Setup(bodies, SOFT * plan.seat.clearance, plan.robot, float(errors.friction[0]), None, 1)
        put = ENGINES["mujoco"].scene(setup)
        pose = begun(np.array([plan.attempts[0].start]), errors.start)
        engine = put((pose[:, :3], pose[:, 3:]))
        self.rig = PressRig(engine, plan, [[0]], errors, bodies.penetration, Noise(seed, [0], width=12))
        self.state, self.zero, self.log = self.rig.state, np.zeros(6), list[str]()
        self.state.mode[0], self.state.due[0] = HOLDING, np.inf
        self.least = np.repeat(self.robot.damping, 3) / errors.admittance[0]
        self._held()

    def run(self, text: str) -> TrialOutcome:
        """What becomes of the part when the program runs."""
        program = Interpreter(self.built_in())
        program.run(parsed(text))
        self.outcome = program.globals["fmopt_outcome"]
        self.state.due[0] = self.state.time[0] + REST
        return self.rig.run()[0]

    def built_in(self) -> dict[str, Any]:
        """The functions of the robot that the exported programs use."""
        return {
            "force_mode": self.force_mode,
            "end_force_mode": self._held,
            "force_mode_set_damping": lambda _: None,
            "force_mode_set_gain_scaling": lambda _: None,
            "zero_ftsensor": lambda: setattr(self, "zero", self.seen[7:].copy()),
            "movel": self.movel,
            "speedl": lambda twist, most, time, turning: self.run_for(time, self._in_hole(twist)),
            "get_steptime": lambda: self.robot.period,
            "get_tcp_force": lambda: list(self._to_base(self.seen[7:] - self.zero)),
            "get_actual_tcp_pose": lambda: list(self.base.compose(self.believed).compose(self.tcp).vector()),
            "point_dist": distance,
            "pose_trans": lambda a, b: list(Pose.from_vector(a).compose(Pose.from_vector(b)).vector()),
            "pose_inv": lambda a: list(Pose.from_vector(a).inverse().vector()),
            "sqrt": np.sqrt,
            "pow": pow,
            "cos": np.cos,
            "sin": np.sin,
            "sleep": lambda time: self.run_for(time, np.zeros(6)),
            "textmsg": lambda *words: self.log.append("".join(words)),
        }

    @property
    def seen(self) -> Array:
        """Pose (7,) and wrench (6,) as the robot measures them."""
        return np.asarray(self.rig._sensors.measured[0])

    def force_mode(
        self, frame: list[float], selection: list[float], wrench: list[float], kind: float, limits: list[float]
    ) -> None:
        """Compliant axes, the wrench about the origin of a frame whose axes are those of the hole, and the limits."""
        assert kind == 2.0
        at = self.base.inverse().compose(Pose.from_vector(frame))
        np.testing.assert_allclose(at.R, np.eye(3), atol=1e-9)
        here, state = self.believed, self.state
        state.gives[0] = np.array(selection) == 1.0
        state.wrench[0] = state.before[0] = np.array(wrench)
        state.reference[0] = here.R.T @ (at.p - here.p)
        resist = np.where(state.gives[0], np.maximum(self.least, np.abs(wrench) / np.array(limits)), 0.0)
        resist[3:] = np.minimum(resist[3:], 0.8 * self.robot.inertia / self.robot.period)
        state.resist[0], state.resisted[0], state.resists[0] = resist, resist, resist

    def movel(self, pose: list[float], acceleration: float, speed: float, *_: float) -> None:
        """Leads the part along a straight line."""
        self._held()
        goal = self.base.inverse().compose(Pose.from_vector(pose)).compose(self.tcp.inverse())
        state, (wanted,) = self.state, begun(goal.vector()[None], self.errors.start)
        p, q = wanted[:3], wanted[3:]
        here = state.p[0].copy(), state.q[0].copy()
        turn = from_quaternions(q) @ from_quaternions(here[1]).T
        seconds = max(
            np.linalg.norm(p - here[0]) / speed, np.arccos(np.clip(0.5 * (np.trace(turn) - 1.0), -1, 1)) / 0.5
        )
        way = Pose(np.zeros(3), turn).vector()[3:]
        for share in np.linspace(0.0, 1.0, max(round(seconds / self.robot.period), 2)):
            state.p[0], state.q[0] = (1.0 - share) * here[0] + share * p, product(quaternions(share * way), here[1])
            self.rig.advance(ONE)

    def run_for(self, time: float, twist: Array) -> None:
        """Lets time go by, stiff axes led by a twist (6,), axes of B."""
        sizes = np.repeat(np.linalg.norm(twist.reshape(2, 3), axis=1), 3)
        self.state.twist[0] = np.where(self.state.gives[0], 0.0, twist + sizes * self.errors.drift[0, :, 0])
        for _ in range(round(time / self.robot.period)):
            if self.state.mode[0] != DONE:
                self.rig.advance(ONE)

    def _held(self) -> None:
        """All axes are stiff and go on from where the part is."""
        state, seen = self.state, self.seen
        state.gives[0], state.twist[0], state.wrench[0], state.before[0] = False, 0.0, 0.0, 0.0
        state.resist[0] = state.resisted[0] = state.resists[0] = 0.0
        state.p[0], state.q[0] = seen[:3], seen[3:7]

    @property
    def believed(self) -> Pose:
        """Pose of the part in the hole's frame, as the robot has it."""
        return self._believed(self.seen)

    def _believed(self, seen: Array) -> Pose:
        error = self.errors.start[0]
        return Pose(seen[:3] - error[:3], exp(-error[3:]) @ from_quaternions(seen[3:7]))

    def _in_hole(self, twist: list[float]) -> Array:
        """The twist of the part's origin, axes of B, for one of the tool's centre point in the base."""
        v, w = self.base.R.T @ twist[:3], self.base.R.T @ twist[3:]
        return np.concatenate([v - np.cross(w, self.believed.R @ self.tcp.p), w])

    def _to_base(self, six: Array) -> Array:
        return np.concatenate([self.base.R @ six[:3], self.base.R @ six[3:]])
