"""What carries presses out, without an engine: the state of each part among its presses, stepped from outside.

Held axes are springs with critical damping towards a reference that follows the twist; axes that give way are damped
masses under the wrench. Decisions rest on what a robot measures, a pose and the wrench of the contacts, which is
low-pass filtered here.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import NamedTuple

import numpy as np

from fmopt.execution import press_servo
from fmopt.execution.press_servo import BACKING, DONE, HOLDING, LEVEL, NEXT, RUNNING, SAMPLE, Ints, Sensors, States
from fmopt.execution.rotation import between, product, quaternions
from fmopt.execution.summary import Fit, reasons_at_rest
from fmopt.plan.press import PressPlan, first_presses
from fmopt.spatial.values import Array, Bits, Indices

_WINDOW = 0.4  # s, the longest window of a standstill
_TRAIL = 0.02  # s between the poses that a part backs out along
_REST = 0.2  # s for which a part is held before it is judged, and before it begins anew
_ARRIVED = (1e-3, 1e-2)  # m and rad by which a part may miss its next start
MAX_SECONDS = 90.0  # of a trial
_DAMPED = 0.8  # of the angular momentum that explicit damping takes in a period, at most


@dataclass(frozen=True, eq=False)
class Errors:
    """What is off in n trials."""

    start: Array  # (n, 6) of the start pose, m and rad
    friction: Array  # (n,) coefficient
    stiffness: Array  # (n,) factor of the robot's
    admittance: Array  # (n,) factor of the robot's
    offset: Array  # (n, 6) of the wrench, N and N·m
    drift: Array  # (n, 6, presses) of the twist of each press, as shares of its translation and of its rotation

    @staticmethod
    def none(count: int, presses: int) -> Errors:
        """Nothing is off in so many trials."""
        nothing, same = np.zeros((count, 6)), np.ones(count)
        return Errors(nothing, 0.3 * same, same, same, nothing, np.zeros((count, 6, presses)))

    def followed_by(self, others: Errors) -> Errors:
        """These, then others."""
        pairs = ((getattr(self, one.name), getattr(others, one.name)) for one in fields(self))
        return Errors(*(np.concatenate(pair) for pair in pairs))

    def of(self, which: Sequence[int] | Indices) -> Errors:
        """Those of some trials."""
        return Errors(*(getattr(self, one.name)[which] for one in fields(self)))


def begun(start: Array, error: Array) -> Array:
    """Poses (n, 7) of starts (n, 6), m and rad, off by errors (n, 6): a turn about the axes of B comes last."""
    return np.hstack([start[:, :3] + error[:, :3], product(quaternions(error[:, 3:]), quaternions(start[:, 3:]))])


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


class Command(NamedTuple):
    """What robots are to do for the next period, in axes of B: wrenches (n, 6) on the reference points, N and N·m.

    A simulator integrates the `damping` (n, 3) of translations implicitly, N·s/m, which the wrench is without. A robot
    that is led in position gets the references `pose` (n, 7) of held axes; `gives` (n, 6) says which axes give way.
    """

    wrench: Array
    damping: Array
    pose: Array
    gives: Bits


class Controller:
    """n parts that are carried through the presses of a plan, each alone, stepped by whoever simulates or drives them.

    Poses (n, 7) are of the moving part's frame in the frame of the hole, B: position, m, and quaternion, w first. Parts
    begin at `starts`; `step` takes a period of the plan's robot forward, `time` in s. A part that is `done` has been
    judged: `reasons` has for each part that is not `seated` why.

    Args:
        courses: for each part its attempts in order, by number; all of the plan if not given.
        errors: what is off in each trial, for a simulation of it.
        late: periods by which measurements are late, at least 1.
        noise: standard deviations of a raw sample: N, N·m, m, rad.
    """

    def __init__(
        self,
        plan: PressPlan,
        count: int = 1,
        courses: Sequence[Sequence[int]] | None = None,
        errors: Errors | None = None,
        late: int = 1,
        noise: Sequence[float] = (0.0,) * 4,
    ) -> None:
        self.plan, self.fit = plan, Fit.of_seat(plan.seat)
        self.courses = courses or [range(len(plan.attempts))] * count
        self.presses = tuple(press for attempt in plan.attempts for press in attempt.presses)
        self.errors = errors or Errors.none(count, len(self.presses))
        robot, n, self._first = plan.robot, count, first_presses(plan.attempts)
        self._ends = press_servo.ends_of(self.presses)
        off = self.errors.start
        q = begun(np.array([plan.attempts[course[0]].start for course in self.courses]), off)
        self.starts, self.reasons = q, [list[str]() for _ in range(n)]
        self.time, self.ticks, self._sample = 0.0, 0, 0
        self._trails, self._backs = np.zeros(n, np.int64), [_Back(np.zeros(1), q[:1], q[:1])] * n
        self.tried, self.stopped = np.zeros(n, np.int64), [""] * n
        K, zero = np.repeat(robot.stiffness, 3) * self.errors.stiffness[:, None], np.zeros(n)
        step = np.array([self._first[course[0]] for course in self.courses])

        def six() -> Array:
            return np.zeros((n, 6))

        self.state = States(
            mode=np.full(n, RUNNING), step=step, time=zero, due=zero.copy(), p=q[:, :3].copy(), q=q[:, 3:].copy(),
            begun=q.copy(), before=six(), filtered=six(), peak=zero.copy(), lowest=q[:, 2].copy(), gives=six() > 0.0,
            twist=six(), wrench=six(), ramp=np.ones(n), reference=np.zeros((n, 3)), resist=six(), resisted=six(),
            resists=six(), rocking=np.zeros((n, 3)), stiffness=K,
            damping=2.0 * np.sqrt(K * np.repeat([robot.mass, robot.inertia], 3)), offset=self.errors.offset,
            above=off[:, 2].copy(),
        )  # fmt: skip
        now, samples = np.hstack([q, six()]), round(_WINDOW / SAMPLE) + 1
        self._sensors = Sensors(np.tile(now, (late, 1, 1)), np.zeros((samples, n, 6)), np.repeat(noise, 3), now)
        self._every, self._keep = round(SAMPLE / robot.period), round(_TRAIL / robot.period)
        self._wrench, self._follows, self._trail = six(), np.full(n, -1), list[Array]()
        self._begins = [list[tuple[int, int, bool]]() for _ in range(n)]  # pose of the trail, press, on the way back
        self._pose, self._speed = q.copy(), six()
        for k in range(n):
            self._load(k)

    @property
    def done(self) -> Bits:
        """Which parts (n,) are at their end."""
        return np.asarray(self.state.mode == DONE)

    @property
    def seated(self) -> Bits:
        """Which of them (n,) are seated."""
        return np.asarray(self.done & [not why for why in self.reasons])

    def step(self, pose: Array, wrench: Array, velocity: Array) -> Command:
        """What to do for the next period.

        Args:
            pose: (n, 7), measured.
            wrench: (n, 6) of the contacts on the parts, about their reference points, axes of B, N and N·m.
            velocity: (n, 6) of the reference points, axes of B, m/s, and of turning, axes of the part, rad/s.
        """
        if self.ticks:
            active = np.flatnonzero(~self.done)
            self.observe(active, pose, velocity, wrench, np.zeros((len(pose), 12)))
        wrench, state = self.command(np.flatnonzero(~self.done), pose, velocity), self.state
        return Command(wrench.copy(), state.resist[:, :3].copy(), np.hstack([state.p, state.q]), state.gives.copy())

    def command(self, active: Ints, pose: Array, velocity: Array) -> Array:
        """The wrenches (n, 6) of the parts that are not done at their true poses; damping is in the state."""
        robot, state, self._pose, self._speed = self.plan.robot, self.state, pose, velocity
        if self.ticks % self._keep == 0:
            self._trail.append(np.array(pose))
        for k in active[state.mode[active] == BACKING]:
            state.p[k], state.q[k] = self._backs[k].at(float(state.time[k]))
        press_servo.servo(state, active, pose, velocity, robot.period, robot.limits, self._wrench)
        self.time += robot.period
        self.ticks += 1
        return self._wrench

    def observe(self, active: Ints, pose: Array, velocity: Array, reaction: Array, noise: Array) -> None:
        """Measures the parts, and takes those on whose press has ended."""
        robot, state, self._pose, self._speed = self.plan.robot, self.state, pose, velocity
        press_servo.sensed(
            state, self._sensors, active, pose, reaction, noise, self.ticks, robot.period, robot.cut_off
        )  # fmt: skip
        due = self.ticks % self._every == 0
        self._sample += due
        sample = self._sample if due else -1
        if press_servo.ended(state, self._ends, self._sensors, active, robot.arm, sample, self._follows):
            for k in active[self._follows[active] >= 0].tolist():
                self._follow(k, int(self._follows[k]))
        if self.time > MAX_SECONDS:
            for k in active[state.mode[active] != DONE].tolist():
                self._finish(k, "took too long")

    def _load(self, k: int) -> None:
        """Works out what the servo needs of the press that body k begins; a body that runs none is held."""
        state, press, robot = self.state, self.presses[self.state.step[k]], self.plan.robot
        self._begins[k].append((len(self._trail), int(state.step[k]), bool(state.mode[k] == BACKING)))
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

    def _follow(self, k: int, code: int) -> None:
        """Takes body k to what follows the end of its press, of its rest or of its way back."""
        state = self.state
        if state.mode[k] == HOLDING:
            self._finish(k, "")
        elif state.mode[k] == BACKING:
            self._again(k)
        elif code == NEXT and state.step[k] + 1 < len(self.presses) and state.step[k] + 1 not in self._first:
            share = min(state.time[k] / state.ramp[k], 1.0)
            state.before[k] = (1.0 - share) * state.before[k] + share * state.wrench[k]
            self._begin(k, int(state.step[k]) + 1)
        elif code == press_servo.RETRY and self.tried[k] + 1 < len(self.courses[k]):
            state.mode[k], self._backs[k] = BACKING, self._way_back(k, self.courses[k][self.tried[k] + 1])
            state.time[k], state.due[k] = 0.0, self._backs[k].times[-1] + _REST
            self._load(k)
        else:
            self.stopped[k] = "" if code in (NEXT, press_servo.SEATED) else "stopped on the way"
            self._hold(k)

    def _again(self, k: int) -> None:
        """Begins the next attempt of body k, which is back at its start."""
        state, pose, back = self.state, self._pose[k], self._backs[k]
        off, turned = np.linalg.norm(pose[:3] - back.p[-1]), np.linalg.norm(between(pose[3:], back.q[-1]))
        if off > _ARRIVED[0] or turned > _ARRIVED[1]:
            self._finish(k, "not brought back to a start")
            return
        self._trails[k], self.tried[k], state.before[k] = len(self._trail), self.tried[k] + 1, 0.0
        self._begin(k, self._first[self.courses[k][self.tried[k]]])

    def _begin(self, k: int, step: int) -> None:
        """Begins a press, or what follows it where the part is below its level already."""
        state, seen = self.state, self._sensors.measured[k, :7].copy()
        state.mode[k], state.step[k], state.time[k] = RUNNING, step, 0.0
        if self.presses[step].keeps:
            seen[3:] = state.q[k]
        state.begun[k], state.p[k], state.q[k] = seen, seen[:3], seen[3:]
        self._load(k)
        if seen[2] - state.above[k] <= self._ends.at[step, LEVEL]:
            self._follow(k, int(self._ends.thens[step, LEVEL]))

    def _hold(self, k: int) -> None:
        state, seen = self.state, self._sensors.measured[k, :7]
        state.mode[k], state.time[k], state.due[k] = HOLDING, 0.0, _REST
        state.p[k], state.q[k] = seen[:3], seen[3:]
        self._load(k)

    def _way_back(self, k: int, following: int) -> _Back:
        """Out along the way in, up, over, and down to the start of the following attempt."""
        trail = np.array([poses[k] for poses in self._trail[self._trails[k] :]])[::-1]
        start, error = np.array(self.plan.attempts[following].start), self.errors.start[k]
        goal = begun(start[None], error[None])[0]
        over = max(self.plan.clear + error[2], trail[-1, 2], goal[2])
        up, across = trail[-1].copy(), goal.copy()
        up[2] = across[2] = over
        poses = np.array([np.array(self._pose[k]), *trail, up, across, goal, goal])
        speeds = self.plan.robot.back
        ways = np.linalg.norm(np.diff(poses[:, :3], axis=0), axis=1) / speeds[0]
        turns = np.linalg.norm(between(poses[1:, 3:], poses[:-1, 3:]), axis=1) / speeds[1]
        return _Back(np.concatenate([[0.0], np.cumsum(np.maximum(ways, turns))]), poses[:, :3], poses[:, 3:])

    def _finish(self, k: int, stopped: str, depth: float = 0.0) -> tuple[Array, Array]:
        """Judges part k; how far it is from its goal, (3,), m, and (3,), rad."""
        state = self.state
        state.mode[k] = DONE
        why, off, turned = reasons_at_rest(self.fit, self._pose[k], self._speed[k], state.lowest[k], depth)
        stopped = stopped or self.stopped[k]
        force = [f"force of {state.peak[k]:.1f} N"] if state.peak[k] > self.plan.robot.limits[0] else []
        self.reasons[k] = [*([stopped] if stopped else []), *why, *force]
        return off, turned
