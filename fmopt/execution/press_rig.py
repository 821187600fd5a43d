"""The rig for presses: many bodies, each at its own press, held stiffly on some axes and damped on the others.

Held axes are springs with critical damping towards a reference that follows the twist; axes that give way are damped
masses under the wrench, integrated implicitly by the engine. Decisions rest on what a robot measures: the pose since
the start and the filtered wrench, each with its noise, as late as the robot's delay.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from fmopt.execution import press_servo
from fmopt.execution.engines.engine import Engine
from fmopt.execution.press_servo import BACKING, DONE, HOLDING, NEXT, RUNNING, SAMPLE, Bodies, Ints, Sensors
from fmopt.execution.rotation import between, product, quaternions
from fmopt.execution.summary import SHARE, Fit, reasons_at_rest
from fmopt.plan.evidence import TrialOutcome
from fmopt.plan.press import PressPlan
from fmopt.runtime.clock import heed
from fmopt.spatial.values import Array

_WINDOW = 0.4  # s, the longest window of a standstill
_TRAIL = 0.02  # s between the poses that a part backs out along
_REST = 0.2  # s for which a part is held before it is judged, and before it begins anew
_ARRIVED = (1e-3, 1e-2)  # m and rad by which a part may miss its next start
MAX_SECONDS = 90.0  # of a trial
_DAMPED = 0.8  # of the angular momentum that explicit damping takes in a period, at most


@dataclass(frozen=True, eq=False)
class Errors:
    """What is off in n trials.

    Attributes:
        start: (n, 6) of the start pose, m and rad.
        friction, stiffness, admittance: (n,) coefficient, and factors of the robot's.
        offset: (n, 6) of the wrench, N and N·m.
        drift: (n, 6, presses) of the twist of each press, as shares of its translation and of its rotation.
    """

    start: Array
    friction: Array
    stiffness: Array
    admittance: Array
    offset: Array
    drift: Array

    def followed_by(self, others: Errors) -> Errors:
        """These, then others."""
        pairs = ((getattr(self, one.name), getattr(others, one.name)) for one in fields(self))
        return Errors(*(np.concatenate(pair) for pair in pairs))

    def of(self, which: Sequence[int] | NDArray[np.intp]) -> Errors:
        """Those of some trials."""
        return Errors(*(getattr(self, one.name)[which] for one in fields(self)))


@dataclass
class _Back:
    """A way back: times (m,), s, positions (m, 3) and quaternions (m, 4)."""

    times: Array
    p: Array
    q: Array

    def at(self, time: float) -> tuple[Array, Array]:
        """Position and quaternion of the reference."""
        k = int(np.clip(np.searchsorted(self.times, time, side="right") - 1, 0, len(self.times) - 2))
        share = float(np.clip((time - self.times[k]) / max(self.times[k + 1] - self.times[k], 1e-9), 0.0, 1.0))
        turn = between(self.q[k + 1], self.q[k])
        return (1.0 - share) * self.p[k] + share * self.p[k + 1], product(quaternions(share * turn), self.q[k])


@dataclass
class _Body:
    """What is kept of one body besides the arrays: where its trail begins, its way back, and its outcome."""

    trail: int = 0
    tried: int = 0  # attempts before this one
    back: _Back | None = None
    last: int = 0
    stopped: str = ""
    outcome: TrialOutcome | None = None


class PressRig:
    """n bodies in a physics engine, each with attempts of its own among those of a plan.

    Args:
        courses: for each body its attempts in order, by number.
        errors: of each trial.
        penetration: of a pose (7,), m, which is asked where the engine's own is more than a trial may have.
        noise: source of raw noise, (n, 12) standard normal at each call: of force, torque, position and angle.
    """

    def __init__(
        self,
        engine: Engine,
        plan: PressPlan,
        courses: Sequence[Sequence[int]],
        errors: Errors,
        fit: Fit,
        penetration: Callable[[Array], float],
        noise: Callable[[], Array],
        look: Callable[[PressRig], None] | None = None,
    ) -> None:
        self.engine, self.plan, self.errors, self.fit, self.noise, self.look = engine, plan, errors, fit, noise, look
        self.penetration, self.courses, robot = penetration, courses, plan.robot
        self.presses = tuple(press for attempt in plan.attempts for press in attempt.presses)
        counts = [len(attempt.presses) for attempt in plan.attempts]
        self._first = [sum(counts[:k]) for k in range(len(counts))]  # press of each attempt
        self._ends = press_servo.ends_of(self.presses)
        n = len(engine.qpos)
        self.time, self.ticks, self._sample = 0.0, 0, 0
        self.bodies = [_Body() for _ in range(n)]
        K = np.repeat(robot.stiffness, 3) * errors.stiffness[:, None]
        q, zero = np.array(engine.qpos), np.zeros(n)
        step = np.array([self._first[course[0]] for course in courses])

        def six() -> Array:
            return np.zeros((n, 6))

        self.state = Bodies(
            mode=np.full(n, RUNNING), step=step, time=zero, due=zero.copy(), p=q[:, :3].copy(), q=q[:, 3:].copy(),
            begun=q, before=six(), filtered=six(), peak=zero.copy(), lowest=q[:, 2].copy(), gives=six() > 0.0,
            twist=six(), wrench=six(), ramp=np.ones(n), reference=np.zeros((n, 3)), resist=six(), resisted=six(),
            resists=six(), rocking=np.zeros((n, 3)), stiffness=K,
            damping=2.0 * np.sqrt(K * np.repeat([robot.mass, robot.inertia], 3)), offset=errors.offset,
            above=errors.start[:, 2].copy(),
        )  # fmt: skip
        late, samples = round(robot.delay / robot.period) + 1, round(_WINDOW / SAMPLE) + 1
        now = np.hstack([q, six()])
        self._sensors = Sensors(np.tile(now, (late, 1, 1)), np.zeros((samples, n, 6)), np.repeat(robot.noise, 3), now)
        self._depth = np.zeros(n)
        self._every, self._keep = round(SAMPLE / robot.period), round(_TRAIL / robot.period)
        self._wrench, self._follows, self._trail = six(), np.full(n, -1), list[Array]()
        for k in range(n):
            self._load(k)

    def run(self) -> list[TrialOutcome]:
        """Runs all bodies until each has an outcome.

        Raises:
            OverdueError: the time limit is used up.
        """
        while (active := np.flatnonzero(self.state.mode != DONE)).size:
            self._one(active)
            if self.look is not None:
                self.look(self)
        return [body.outcome for body in self.bodies if body.outcome is not None]

    def _one(self, active: Ints) -> None:
        """One period of the bodies that are not done."""
        robot, state, engine = self.plan.robot, self.state, self.engine
        if self.ticks % self._keep == 0:
            heed()
            self._trail.append(np.array(engine.qpos))
        for k in active[state.mode[active] == BACKING]:
            state.p[k], state.q[k] = self._back(int(k)).at(float(state.time[k]))
        press_servo.servo(state, active, engine.qpos, engine.qvel, robot.period, robot.limits, self._wrench)
        engine.damp(state.resist[:, :3])
        engine.advance(self._wrench, robot.period, active)
        self.time += robot.period
        self.ticks += 1
        press_servo.sensed(
            *(state, self._sensors, active, engine.qpos, engine.reaction_over_period, self.noise()),
            *(self.ticks, robot.period, robot.cut_off),
        )
        for k in active[engine.deepest[active] > SHARE * self.fit.clearance].tolist():
            self._depth[k] = max(self._depth[k], self.penetration(engine.deepest_at[k]))
        due = self.ticks % self._every == 0
        self._sample += due
        sample = self._sample if due else -1
        if press_servo.ended(state, self._ends, self._sensors, active, robot.arm, sample, self._follows):
            for k in active[self._follows[active] >= 0].tolist():
                self._follow(k, int(self._follows[k]))
        if self.time > MAX_SECONDS:
            for k in active[state.mode[active] != DONE].tolist():
                self._judge(k, "took too long")

    def _load(self, k: int) -> None:
        """Works out what the servo needs of the press that body k begins; a body that runs none is held."""
        state, press, robot = self.state, self.presses[self.state.step[k]], self.plan.robot
        runs = state.mode[k] == RUNNING
        gives, twist, wrench = np.array(press.gives) & runs, np.array(press.twist), np.array(press.wrench)
        sizes = np.repeat(np.linalg.norm(twist.reshape(2, 3), axis=1), 3)
        twist = twist + sizes * self.errors.drift[k, :, state.step[k]]
        least = np.repeat(robot.damping, 3) / self.errors.admittance[k]
        resist = np.where(gives, np.maximum(least, np.abs(wrench) / np.maximum(press.speed, 1e-9)), 0.0)
        resist[3:] = np.minimum(resist[3:], _DAMPED * robot.inertia / robot.period)
        state.gives[k], state.twist[k] = gives, np.where(gives | ~runs, 0.0, twist)
        state.wrench[k], state.reference[k] = wrench * runs, press.reference
        state.ramp[k], state.resisted[k], state.resists[k] = max(press.ramp, robot.period), state.resist[k], resist
        rocking = press.rocking
        state.rocking[k] = (rocking.angle, rocking.rate, rocking.seconds) if runs and rocking is not None else 0.0

    def _back(self, k: int) -> _Back:
        """The way back that body k is on."""
        back = self.bodies[k].back
        assert back is not None
        return back

    def _follow(self, k: int, code: int) -> None:
        """Takes body k to what follows the end of its press, of its rest or of its way back."""
        state, body = self.state, self.bodies[k]
        if state.mode[k] == HOLDING:
            self._judge(k, "")
        elif state.mode[k] == BACKING:
            self._again(k)
        elif code == NEXT and state.step[k] + 1 < len(self.presses) and state.step[k] + 1 not in self._first:
            body.last = int(state.step[k])
            state.before[k] = self.presses[body.last].wrench
            self._begin(k, body.last + 1)
        elif code in (NEXT, press_servo.SEATED):
            self._hold(k)
        elif code == press_servo.RETRY and body.tried + 1 < len(self.courses[k]):
            body.last, state.mode[k] = int(state.step[k]), BACKING
            body.back = self._way_back(k, self.courses[k][body.tried + 1])
            state.time[k], state.due[k] = 0.0, body.back.times[-1] + _REST
            self._load(k)
        else:
            body.stopped = "stopped on the way"
            self._hold(k)

    def _again(self, k: int) -> None:
        """Begins the next attempt of body k, which is back at its start."""
        state, body, pose = self.state, self.bodies[k], self.engine.qpos[k]
        back = self._back(k)
        off, turned = np.linalg.norm(pose[:3] - back.p[-1]), np.linalg.norm(between(pose[3:], back.q[-1]))
        if off > _ARRIVED[0] or turned > _ARRIVED[1]:
            self._judge(k, "not brought back to a start")
            return
        body.trail, body.tried, state.before[k] = len(self._trail), body.tried + 1, 0.0
        self._begin(k, self._first[self.courses[k][body.tried]])

    def _begin(self, k: int, step: int) -> None:
        state, seen = self.state, self._sensors.measured[k, :7].copy()
        state.mode[k], state.step[k], state.time[k] = RUNNING, step, 0.0
        if self.presses[step].keeps:
            seen[3:] = state.q[k]
        state.begun[k], state.p[k], state.q[k] = seen, seen[:3], seen[3:]
        self._load(k)

    def _hold(self, k: int) -> None:
        state, seen = self.state, self._sensors.measured[k, :7]
        self.bodies[k].last = int(state.step[k])
        state.mode[k], state.time[k], state.due[k] = HOLDING, 0.0, _REST
        state.p[k], state.q[k] = seen[:3], seen[3:]
        self._load(k)

    def _way_back(self, k: int, following: int) -> _Back:
        """Out along the way in, up, over, and down to the start of the following attempt."""
        trail = np.array([poses[k] for poses in self._trail[self.bodies[k].trail :]])[::-1]
        start, error = np.array(self.plan.attempts[following].start), self.errors.start[k]
        goal = np.concatenate([start[:3] + error[:3], product(quaternions(error[3:]), quaternions(start[3:]))])
        over = max(self.plan.clear + error[2], trail[-1, 2], goal[2])
        up, across = trail[-1].copy(), goal.copy()
        up[2] = across[2] = over
        poses = np.array([np.array(self.engine.qpos[k]), *trail, up, across, goal, goal])
        speeds = self.plan.robot.back
        ways = np.linalg.norm(np.diff(poses[:, :3], axis=0), axis=1) / speeds[0]
        turns = np.linalg.norm(between(poses[1:, 3:], poses[:-1, 3:]), axis=1) / speeds[1]
        return _Back(np.concatenate([[0.0], np.cumsum(np.maximum(ways, turns))]), poses[:, :3], poses[:, 3:])

    def _judge(self, k: int, stopped: str) -> None:
        state, body = self.state, self.bodies[k]
        state.mode[k] = DONE
        depth = max(float(self._depth[k]), min(float(self.engine.depth[k]), SHARE * self.fit.clearance))
        pose = np.array(self.engine.qpos[k])
        reasons, off, turned = reasons_at_rest(self.fit, pose, self.engine.qvel[k], state.lowest[k], depth)
        stopped = stopped or body.stopped
        reasons = [*([stopped] if stopped else []), *reasons]
        if state.peak[k] > self.plan.robot.limits[0]:
            reasons.append(f"force of {state.peak[k]:.1f} N")
        x, y, z = off.tolist()
        rx, ry, rz = turned.tolist()
        body.outcome = TrialOutcome(
            seated=not reasons,
            attempt=body.tried,
            press=self.presses[body.last].name,
            seconds=round(self.time, 6),
            peak_force=float(state.peak[k]),
            penetration=depth,
            reasons=tuple(reasons),
            offset=(x, y, z),
            turn=(rx, ry, rz),
        )
