"""The rig for presses: many bodies, each at its own press, held stiffly on some axes and damped on the others.

Held axes are springs with critical damping towards a reference that follows the twist; axes that give way are damped
masses under the wrench, integrated implicitly by the engine. Decisions rest on what a robot measures: the pose since
the start and the filtered wrench, each with its noise, as late as the robot's delay.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from math import ceil, exp, pi

import numpy as np
from numpy.typing import NDArray

from fmopt.execution.engines.engine import Engine
from fmopt.execution.rotation import between, from_quaternions, product, quaternions
from fmopt.execution.summary import Fit, reasons_at_rest
from fmopt.plan.evidence import TrialOutcome
from fmopt.plan.press import Attempt, Force, Level, Next, Press, PressPlan, Standstill, Time, Travel
from fmopt.spatial.se3 import cross
from fmopt.spatial.values import Array

THEN: dict[Next, int] = {"next": 0, "seated": 1, "retry": 2, "fail": 3}
NEXT, SEATED, RETRY, FAIL = range(4)
RUNNING, HOLDING, BACKING, DONE = range(4)
_SAMPLE = 0.01  # s between samples of the pose that a standstill is judged by
_WINDOW = 0.4  # s, the longest window of a standstill
_TRAIL = 0.02  # s between the poses that a part backs out along
_REST = 0.2  # s for which a part is held before it is judged, and before it begins anew
_ARRIVED = (1e-3, 1e-2)  # m and rad by which a part may miss its next start
MAX_SECONDS = 90.0  # of a trial
_DAMPED = 0.8  # of the angular momentum that explicit damping takes in a period, at most

Bools = NDArray[np.bool_]


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


@dataclass(frozen=True, eq=False)
class _Table:
    """All presses of a plan as arrays, attempt after attempt; ends that a press does not have are infinite."""

    presses: tuple[Press, ...]
    first: tuple[int, ...]  # press of each attempt
    attempt: NDArray[np.int64]
    gives: Bools
    twist: Array
    wrench: Array
    reference: Array
    ramp: Array
    speed: Array
    reach: Array
    still: Array  # displacement, window, armed, below
    still_then: NDArray[np.int64]  # then, else
    ends: Array  # z of level, distance, angle, force, time
    thens: NDArray[np.int64]

    @staticmethod
    def of(attempts: Sequence[Attempt]) -> _Table:
        presses = tuple(press for attempt in attempts for press in attempt.presses)
        counts = [len(attempt.presses) for attempt in attempts]
        first = tuple(int(sum(counts[:k])) for k in range(len(counts)))
        still, still_then = np.full((len(presses), 4), np.inf), np.zeros((len(presses), 2), np.int64)
        still[:, 0] = -1.0
        ends, thens = np.full((len(presses), 5), np.inf), np.zeros((len(presses), 5), np.int64)
        ends[:, 0] = -np.inf
        for k, press in enumerate(presses):
            for end in press.ends:
                match end:
                    case Standstill():
                        below = np.inf if end.below is None else end.below
                        still[k] = end.displacement, end.window, end.armed, below
                        still_then[k] = THEN[end.then], THEN[end.else_then]
                    case Level():
                        ends[k, 0], thens[k, 0] = end.z, THEN[end.then]
                    case Travel():
                        ends[k, 1] = np.inf if end.distance is None else end.distance
                        ends[k, 2] = np.inf if end.angle is None else end.angle
                        thens[k, 1:3] = THEN[end.then]
                    case Force():
                        ends[k, 3], thens[k, 3] = end.force, THEN[end.then]
                    case Time():
                        ends[k, 4], thens[k, 4] = end.seconds, THEN[end.then]
        rows = {
            name: np.array([getattr(press, name) for press in presses], dtype=np.float64)
            for name in ("twist", "wrench", "reference", "ramp", "speed", "reach")
        }
        gives = np.array([press.gives for press in presses], dtype=bool)
        numbers = np.repeat(np.arange(len(counts)), counts)
        return _Table(
            presses, first, numbers, gives, **rows, still=still, still_then=still_then, ends=ends, thens=thens
        )


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
    since: float = 0.0
    last: int = 0
    stopped: str = ""
    outcome: TrialOutcome | None = None


@dataclass
class _State:
    """Arrays that change in place; rows are bodies."""

    mode: NDArray[np.int64]
    step: NDArray[np.int64]
    time: Array  # s in the press
    p: Array  # reference of held axes
    q: Array
    begun_p: Array  # measured pose at the begin of the press
    begun_q: Array
    wrench: Array  # at the begin of the press
    filtered: Array
    peak: Array
    lowest: Array
    # Of the press that each body is at, worked out as it begins: nothing gives way before and after.
    gives: Bools
    twist: Array  # with its drift
    goal_wrench: Array
    ramp: Array
    reference: Array
    resist: Array
    rocks: Bools


class PressRig:
    """n bodies in a physics engine, each with attempts of its own among those of a plan.

    Args:
        engine: that the bodies are in, at their starts.
        plan: whose attempts they run.
        courses: for each body its attempts in order, by number.
        errors: of each trial.
        fit: what success is measured by.
        noise: source of raw noise, (n, 12) standard normal at each call: of force, torque, position and angle.
        look: shown the rig in every period.
    """

    def __init__(
        self,
        engine: Engine,
        plan: PressPlan,
        courses: Sequence[Sequence[int]],
        errors: Errors,
        fit: Fit,
        noise: Callable[[], Array],
        look: Callable[[PressRig], None] | None = None,
    ) -> None:
        self.engine, self.plan, self.errors, self.fit, self.noise, self.look = engine, plan, errors, fit, noise, look
        self.courses = courses
        self.table, robot = _Table.of(plan.attempts), plan.robot
        self.n = n = len(engine.qpos)
        self.time = 0.0
        self.bodies = [_Body() for _ in range(n)]
        p, q = np.array(engine.qpos[:, :3]), np.array(engine.qpos[:, 3:])
        step, six = np.array([self.table.first[course[0]] for course in courses]), np.zeros((n, 6))
        zero, mode = np.zeros(n), np.zeros(n, np.int64)
        self.state = _State(
            *(mode, step, zero, p, q, p.copy(), q.copy(), six, six.copy(), zero.copy(), p[:, 2].copy()),
            gives=np.zeros((n, 6), bool),
            twist=six.copy(),
            goal_wrench=six.copy(),
            ramp=np.ones(n),
            reference=np.zeros((n, 3)),
            resist=six.copy(),
            rocks=np.zeros(n, bool),
        )
        self._K = np.repeat(robot.stiffness, 3) * errors.stiffness[:, None]
        self._C = 2.0 * np.sqrt(self._K * np.repeat([robot.mass, robot.inertia], 3))
        self._D = np.repeat(robot.damping, 3) / errors.admittance[:, None]
        self._smoothing = 1.0 - exp(-2.0 * pi * robot.cut_off * robot.period)
        late = round(robot.delay / robot.period) + 1
        self._late = np.tile(np.hstack([p, q, six]), (late, 1, 1))  # poses and filtered wrenches, a period apart
        self._seen = np.zeros((round(_WINDOW / _SAMPLE) + 1, n, 6))  # displacements in the press, a sample apart
        self._sample, self._every = 0, round(_SAMPLE / robot.period)
        self._trail: list[Array] = []
        self._keep = round(_TRAIL / robot.period)
        self.ticks, self._damped = 0, False
        self._scale = np.repeat(robot.noise, 3)
        for k in range(n):
            self._load(k)

    def run(self) -> list[TrialOutcome]:
        """Runs all bodies until each has an outcome."""
        while (active := np.flatnonzero(self.state.mode != DONE)).size:
            self._one(active)
            if self.look is not None:
                self.look(self)
        outcomes = [body.outcome for body in self.bodies]
        return [outcome for outcome in outcomes if outcome is not None]

    def _one(self, active: NDArray[np.intp]) -> None:
        """One period of the bodies that are not done."""
        robot, state = self.plan.robot, self.state
        if self.ticks % self._keep == 0:
            self._trail.append(np.array(self.engine.qpos))
        wrench = self._servo(active)
        self.engine.advance(wrench, robot.period, active)
        self.time += robot.period
        self.ticks += 1
        state.time[active] += robot.period
        reaction = self.engine.reaction_over_period
        noise = self.noise()
        scale = self._scale
        raw = reaction + noise[:, :6] * scale[:6]
        state.filtered[active] += self._smoothing * (raw - state.filtered)[active]
        state.peak[active] = np.maximum(state.peak, np.linalg.norm(state.filtered[:, :3], axis=1))[active]
        state.lowest[active] = np.minimum(state.lowest, self.engine.qpos[:, 2])[active]
        newest = self.ticks % len(self._late)
        self._late[newest, :, :7], self._late[newest, :, 7:] = self.engine.qpos, state.filtered
        measured = np.array(self._late[(newest + 1) % len(self._late)])
        measured[:, :3] += noise[:, 6:9] * scale[6:9]
        measured[:, 3:7] = product(quaternions(noise[:, 9:] * scale[9:]), measured[:, 3:7])
        self._decide(active, measured)

    def _load(self, k: int) -> None:
        """Works out what the servo needs of the press that body k begins; a body that runs none is held."""
        state, table, robot = self.state, self.table, self.plan.robot
        step, runs = int(state.step[k]), state.mode[k] == RUNNING
        gives = table.gives[step] & runs
        sizes = np.repeat(np.linalg.norm(table.twist[step].reshape(2, 3), axis=1), 3)
        twist = table.twist[step] + sizes * self.errors.drift[k, :, step]
        limit = np.abs(table.wrench[step]) / np.maximum(table.speed[step], 1e-9)
        resist = np.where(gives, np.maximum(self._D[k], limit), 0.0)
        resist[3:] = np.minimum(resist[3:], _DAMPED * robot.inertia / robot.period)
        state.gives[k], state.twist[k] = gives, np.where(gives | ~runs, 0.0, twist)
        state.goal_wrench[k], state.reference[k] = table.wrench[step] * runs, table.reference[step]
        state.ramp[k] = max(float(table.ramp[step]), robot.period)
        state.resist[k] = resist
        state.rocks[k] = runs and table.presses[step].rocking is not None
        self._damped = False

    def _servo(self, active: NDArray[np.intp]) -> Array:
        """Applied wrenches (n, 6) about the body origins, axes of B; moves the references on."""
        state, period = self.state, self.plan.robot.period
        if not self._damped:  # that of translations goes to the engine
            self.engine.damp(state.resist[:, :3])
            self._damped = True
        wrench = np.zeros((self.n, 6))
        p, q = np.array(self.engine.qpos[active, :3]), np.array(self.engine.qpos[active, 3:])
        R = from_quaternions(q)
        v = self.engine.qvel[active]
        velocity = np.hstack([v[:, :3], np.einsum("nij,nj->ni", R, v[:, 3:])])
        gives, twist = state.gives[active], state.twist[active]
        state.p[active] = np.where(gives[:, :3], p, state.p[active] + twist[:, :3] * period)
        state.q[active] = product(quaternions(twist[:, 3:] * period), state.q[active])
        self._rock(active)
        self._lead_back(active)
        lead = np.hstack([state.p[active] - p, between(state.q[active], q)])
        lead[gives] = 0.0
        state.q[active] = product(quaternions(lead[:, 3:]), q)
        share = np.minimum(state.time[active] / state.ramp[active], 1.0)[:, None]
        given = (1.0 - share) * state.wrench[active] + share * state.goal_wrench[active]
        given[:, 3:] += cross(np.einsum("nij,nj->ni", R, state.reference[active]), given[:, :3])
        given += self.errors.offset[active]
        given[:, 3:] -= state.resist[active, 3:] * velocity[:, 3:]
        held = self._K[active] * lead + self._C[active] * (twist - velocity)
        wrench[active] = self._cut(np.where(gives, given, held))
        return wrench

    def _rock(self, active: NDArray[np.intp]) -> None:
        """Leads the attitude of bodies that rock about the one that their press began with."""
        for k in active[self.state.rocks[active]]:
            rocking, time = self.table.presses[self.state.step[k]].rocking, float(self.state.time[k])
            assert rocking is not None
            gone, phase = min(time / rocking.seconds, 1.0), 2.0 * pi * rocking.rate * time
            angle = rocking.angle * min(1.0, 4.0 * gone) * (1.0 - gone)
            cone = quaternions(angle * np.array([np.cos(phase), np.sin(phase), 0.0]))
            self.state.q[k] = product(cone, self.state.begun_q[k])

    def _lead_back(self, active: NDArray[np.intp]) -> None:
        for k in active[self.state.mode[active] == BACKING]:
            body = self.bodies[k]
            assert body.back is not None
            self.state.p[k], self.state.q[k] = body.back.at(self.time - body.since)

    def _cut(self, wrench: Array) -> Array:
        """Wrenches (n, 6) cut to the greatest force and torque."""
        sizes = np.linalg.norm(wrench.reshape(-1, 2, 3), axis=2)
        return np.asarray(wrench / np.repeat(np.maximum(sizes / np.array(self.plan.robot.limits), 1.0), 3, axis=1))

    def _decide(self, active: NDArray[np.intp], measured: Array) -> None:
        """Ends of presses, of rests and of ways back."""
        state, table = self.state, self.table
        running = active[state.mode[active] == RUNNING]
        if running.size:
            code = self._ends(running, measured)
            for k, ended in zip(running[code >= 0], code[code >= 0], strict=True):
                self._follow(int(k), int(ended), measured)
        for k in active[state.mode[active] == HOLDING]:
            if self.time - self.bodies[k].since >= _REST:
                self._judge(int(k), "")
        if self.time > MAX_SECONDS:
            for k in active[state.mode[active] != DONE]:
                self._judge(int(k), "took too long")
            return
        for k in active[state.mode[active] == BACKING]:
            body = self.bodies[k]
            assert body.back is not None
            if self.time - body.since >= body.back.times[-1] + _REST:
                off = np.linalg.norm(self.engine.qpos[k, :3] - body.back.p[-1])
                turned = np.linalg.norm(between(self.engine.qpos[k, 3:], body.back.q[-1]))
                if off > _ARRIVED[0] or turned > _ARRIVED[1]:
                    self._judge(int(k), "not brought back to a start")
                    continue
                body.trail = len(self._trail)
                state.wrench[k] = 0.0
                body.tried += 1
                self._begin(int(k), table.first[self.courses[k][body.tried]], measured)

    def _ends(self, running: NDArray[np.intp], measured: Array) -> NDArray[np.int64]:
        """What follows for running bodies whose press has ended, −1 for the others."""
        state, table, robot = self.state, self.table, self.plan.robot
        step, time = state.step[running], state.time[running]
        gives = state.gives[running]
        seen = measured[running]
        shift = np.hstack([seen[:, :3] - state.begun_p[running], between(seen[:, 3:7], state.begun_q[running])])
        z = seen[:, 2] - self.errors.start[running, 2]
        ends, thens = table.ends[step], table.thens[step]
        way = np.linalg.norm(np.where(gives[:, :3], shift[:, :3], 0.0), axis=1)
        turned = np.linalg.norm(np.where(gives[:, 3:], shift[:, 3:], 0.0), axis=1)
        led = np.linalg.norm(table.twist[step][:, 3:], axis=1) * time
        force = seen[:, 7:10] + self.errors.offset[running, :3]
        pressed = np.linalg.norm(np.where(gives[:, :3], 0.0, force), axis=1)
        code = np.full(len(running), -1, np.int64)
        ended = ((time >= ends[:, 4]), (pressed >= ends[:, 3]), (led >= ends[:, 2]), (way >= ends[:, 1]))
        for column, over in zip((4, 3, 2, 1), ended, strict=True):
            code = np.where(over, thens[:, column], code)
        code = np.where((way > table.reach[step, 0]) | (turned > table.reach[step, 1]), RETRY, code)
        if self.ticks % self._every == 0:
            self._sample += 1
            moved = np.where(gives, shift * np.repeat([1.0, robot.arm], 3), 0.0)
            self._seen[self._sample % len(self._seen), running] = moved
            then = np.where(z <= table.still[step, 3], *table.still_then[step].T)
            code = np.where(self._stands(running, step, time), then, code)
        return np.asarray(np.where(z <= ends[:, 0], thens[:, 0], code))

    def _stands(self, running: NDArray[np.intp], step: NDArray[np.int64], time: Array) -> Bools:
        """Which bodies have moved by less than the bound within the window."""
        bound, window, armed = self.table.still[step, 0], self.table.still[step, 1], self.table.still[step, 2]
        ready: Bools = (bound > 0.0) & (time >= armed + window)
        if not ready.any():
            return ready
        stands = np.zeros(len(running), bool)
        for k in np.flatnonzero(ready):
            back = np.arange(ceil(window[k] / _SAMPLE - 1e-9) + 1)
            seen = self._seen[(self._sample - back) % len(self._seen), running[k]]
            stands[k] = np.linalg.norm(np.ptp(seen, axis=0)) < bound[k]
        return stands

    def _follow(self, k: int, code: int, measured: Array) -> None:
        """Takes body k to what follows the end of its press."""
        state, body, table = self.state, self.bodies[k], self.table
        body.last = int(state.step[k])
        attempt = int(table.attempt[body.last])
        if code == NEXT and body.last + 1 < len(table.presses) and table.attempt[body.last + 1] == attempt:
            state.wrench[k] = table.wrench[body.last]
            self._begin(k, body.last + 1, measured)
        elif code in (NEXT, SEATED):
            self._hold(k, measured)
        elif code == RETRY and body.tried + 1 < len(self.courses[k]):
            state.mode[k] = BACKING
            body.back, body.since = self._way_back(k, self.courses[k][body.tried + 1]), self.time
            self._load(k)
        else:
            body.stopped = "stopped on the way"
            self._hold(k, measured)

    def _begin(self, k: int, step: int, measured: Array) -> None:
        state = self.state
        state.mode[k], state.step[k], state.time[k] = RUNNING, step, 0.0
        state.p[k] = state.begun_p[k] = measured[k, :3]
        state.q[k] = state.begun_q[k] = measured[k, 3:7]
        self._load(k)

    def _hold(self, k: int, measured: Array) -> None:
        state = self.state
        state.mode[k], self.bodies[k].since = HOLDING, self.time
        state.p[k], state.q[k] = measured[k, :3], measured[k, 3:7]
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
        legs = np.maximum(
            np.linalg.norm(np.diff(poses[:, :3], axis=0), axis=1) / speeds[0],
            np.linalg.norm(between(poses[1:, 3:], poses[:-1, 3:]), axis=1) / speeds[1],
        )
        return _Back(np.concatenate([[0.0], np.cumsum(legs)]), poses[:, :3], poses[:, 3:])

    def _judge(self, k: int, stopped: str) -> None:
        state, body = self.state, self.bodies[k]
        state.mode[k] = DONE
        reasons, off, turned = reasons_at_rest(
            self.fit, np.array(self.engine.qpos[k]), self.engine.qvel[k], state.lowest[k], self.engine.depth[k]
        )
        stopped = stopped or body.stopped
        reasons = [*([stopped] if stopped else []), *reasons]
        if state.peak[k] > self.plan.robot.limits[0]:
            reasons.append(f"force of {state.peak[k]:.1f} N")
        x, y, z = off.tolist()
        rx, ry, rz = turned.tolist()
        body.outcome = TrialOutcome(
            seated=not reasons,
            attempt=body.tried,
            press=self.table.presses[body.last].name,
            seconds=round(self.time, 6),
            peak_force=float(state.peak[k]),
            penetration=float(self.engine.depth[k]),
            reasons=tuple(reasons),
            offset=(x, y, z),
            turn=(rx, ry, rz),
        )
