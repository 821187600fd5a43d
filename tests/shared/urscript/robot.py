"""A robot with a force mode in the physics engine, which an exported URScript program drives and knows nothing else of.

Its base is where the program thinks it is; the hole is off by the error drawn, which the program is not told. On stiff
axes of the task frame a spring leads the part along what `speedl` asks for, on compliant ones the spring gives way to
what is missing of the wrench, no faster than the limits. A stiff axis that falls behind by more than its limit ends
the program, as the robot's own protection would.
"""

from typing import Any

import numpy as np

from fmopt.execution.engines.engine import Bodies
from fmopt.execution.engines.physics import Physics
from fmopt.execution.engines.scene import compiled, engine, scene
from fmopt.execution.robot import Robot
from fmopt.execution.rotation import between, from_quaternions, product, quaternions
from fmopt.execution.summary import Fit
from fmopt.plan import Plan
from fmopt.plan.guarded_moves import moves
from fmopt.spatial.se3 import Pose, exp, hat
from fmopt.spatial.values import Array
from tests.shared.urscript.language import Halt, Interpreter, distance, parsed

STEP = 0.002  # s between calls of the program
HELD = Pose.identity()  # the TCP in the frame of the part


class ForceModeRobot:
    """One part in the scene of a plan, held by the robot; the plan's strategies are not looked at.

    The base is the pose of the hole in that of the robot that the program was written for; the error (6,) of the start
    pose, m and rad, is about the part's origin, in axes of B. The tool's centre point is at `tcp` in the part's frame.
    """

    def __init__(self, plan: Plan, base: Pose, error: Array, seed: int, tcp: Pose = HELD) -> None:
        self.robot, self.fit, self.tcp = Robot(), Fit.of(plan), tcp
        robot, friction = self.robot, plan.specification.friction
        physics = Physics.of_fit(self.fit.clearance, robot.period)
        self.model = compiled(scene(Bodies.of(plan), physics, robot.mass, robot.inertia, friction))
        self.data, self.mujoco = engine().MjData(self.model), engine()
        start = moves(plan)[0].start
        real = Pose(start.p + error[:3], exp(error[3:]) @ start.R)
        self.base = base.compose(start).compose(real.inverse())
        self.p, self.q = real.p.copy(), quaternions(real.vector()[3:])
        self.data.qpos[:] = np.concatenate([self.p, self.q])
        self.R = real.R
        self.K, self.D = np.repeat(robot.stiffnesses, 3), np.repeat(robot.dampings, 3)
        self.resistances, self.noise = np.repeat(robot.resistances, 3), np.repeat(robot.noise, 3)
        self.substeps = round(robot.period / physics.time_step)
        self.random = np.random.default_rng(seed)
        self.reaction, self.zero, self.twist = np.zeros(6), np.zeros(6), np.zeros(6)
        self.frame, self.compliant, self.wrench, self.limits = real, np.zeros(6, bool), np.zeros(6), np.full(6, np.inf)
        self.log: list[str] = []

    @property
    def pose(self) -> Pose:
        """Of the part in B."""
        return Pose(self.data.qpos[:3].copy(), self.R)

    def built_in(self) -> dict[str, Any]:
        """The functions of the robot that the exported programs use."""
        return {
            "force_mode": self.force_mode,
            "end_force_mode": lambda: self.compliant.fill(False),
            "force_mode_set_damping": lambda _: None,
            "force_mode_set_gain_scaling": lambda _: None,
            "zero_ftsensor": lambda: setattr(self, "zero", self.reaction.copy()),
            "movel": lambda *_: None,
            "speedl": lambda twist, most, time, turning: self.run_for(time, self._turned(twist), (most, turning)),
            "stopl": lambda most, turning: self.run_for(5 * STEP, np.zeros(6), (most, turning)),
            "get_steptime": lambda: STEP,
            "get_tcp_force": lambda: list(self._to_base(self._of_tcp(self.reaction - self.zero, 3))),
            "get_actual_tcp_pose": lambda: list(self.base.compose(self.pose).compose(self.tcp).vector()),
            "get_actual_tcp_speed": lambda: list(self._to_base(self._of_tcp(self.speed, 0))),
            "point_dist": distance,
            "pose_trans": lambda a, b: list(Pose.from_vector(a).compose(Pose.from_vector(b)).vector()),
            "sleep": lambda time: self.run_for(time, np.zeros(6), (np.inf, np.inf)),
            "textmsg": lambda *words: self.log.append("".join(words)),
        }

    @property
    def speed(self) -> Array:
        """Twist (6,) of the part's origin, axes of B."""
        return np.concatenate([self.data.qvel[:3], self.R @ self.data.qvel[3:]])

    def run(self, text: str) -> bool:
        """Whether the program came to its end and the part is seated."""
        try:
            Interpreter(self.built_in()).run(parsed(text))
        except Halt:
            return False
        off = self.pose.p - self.fit.goal.p
        return bool(abs(off[2]) <= self.fit.clearance and np.abs(off[:2]).max() <= 2.4 * self.fit.clearance)

    def force_mode(self, frame: list[float], selection: list[float], wrench: list[float], *rest: Any) -> None:
        """Sets the task frame, which of its axes are compliant, the wrench to apply along them, and the limits."""
        kind, limits = rest
        assert kind == 2.0
        self.frame = self.base.inverse().compose(Pose.from_vector(frame))
        self.compliant, self.wrench = np.array(selection) == 1.0, np.array(wrench)
        self.limits = np.array(limits)
        self._rest()

    def run_for(self, time: float, twist: Array, most: tuple[float, float]) -> None:
        """Lets time go by, the speed going towards a twist (6,), axes of B, no faster than the accelerations."""
        for _ in range(round(time / self.robot.period)):
            change = np.repeat(most, 3) * self.robot.period
            self.twist = self.twist + np.clip(twist - self.twist, -change, change)
            self._tick()

    def _tick(self) -> None:
        robot, data, p = self.robot, self.data, self.data.qpos[:3].copy()
        T = _adjoint(self.frame, p)
        back = np.linalg.inv(T)
        lead = T @ np.concatenate([self.p - p, between(self.q, data.qpos[3:])])
        given = np.clip((self.wrench + self.reaction @ back) / self.resistances, -self.limits, self.limits)
        wanted = np.where(self.compliant, given, T @ self.twist)
        if np.any(np.abs(np.where(self.compliant, 0.0, lead)) > self.limits):
            self.log.append("a stiff axis fell behind by more than its limit")
            raise Halt
        applied = (self.K * lead + self.D * (wanted - T @ self.speed)) @ T
        data.qfrc_applied[:3], data.qfrc_applied[3:] = applied[:3], applied[3:] @ self.R
        self.mujoco.mj_step(self.model, data, self.substeps)
        self.R = from_quaternions(data.qpos[3:])
        way = back @ wanted * robot.period
        self.p, self.q = self.p + way[:3], product(quaternions(way[3:]), self.q)
        raw = np.concatenate([data.qfrc_constraint[:3], self.R @ data.qfrc_constraint[3:]])
        raw = raw + self.random.standard_normal(6) * self.noise
        self.reaction = self.reaction + robot.smoothing * (raw - self.reaction)

    def _rest(self) -> None:
        """The springs of stiff axes keep their lead, those of compliant ones take up the wrench."""
        here = self.pose
        T = _adjoint(self.frame, here.p)
        lead = T @ np.concatenate([self.p - here.p, between(self.q, self.data.qpos[3:])])
        lead = np.where(self.compliant, self.wrench / self.K, lead)
        back = np.linalg.solve(T, lead)
        self.p, self.q = here.p + back[:3], product(quaternions(back[3:]), self.data.qpos[3:])

    def _turned(self, twist: list[float]) -> Array:
        six = np.concatenate([self.base.R.T @ twist[:3], self.base.R.T @ twist[3:]])
        return self._of_tcp(six, 0, -1.0)

    def _of_tcp(self, six: Array, moved: int, sign: float = 1.0) -> Array:
        """A twist (its half from 0 on) or wrench (from 3 on) of the part's origin for the TCP, axes of B, or back."""
        found, arm = six.copy(), self.R @ self.tcp.p
        found[moved : moved + 3] += sign * np.cross(six[3 - moved : 6 - moved], arm)
        return found

    def _to_base(self, six: Array) -> Array:
        return np.concatenate([self.base.R @ six[:3], self.base.R @ six[3:]])


def _adjoint(frame: Pose, p: Array) -> Array:
    """(6, 6): twists of the point p in axes of B to those of the frame at its origin."""
    T = np.zeros((6, 6))
    T[:3, :3] = T[3:, 3:] = frame.R.T
    T[:3, 3:] = -frame.R.T @ hat(frame.p - p)
    return T
