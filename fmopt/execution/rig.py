"""The rig: many bodies under one hybrid position/force controller at 1 kHz, each at its own step of a program.

In the compliance frame of its step, each body is led by a reference pose. On the position-controlled axes the reference
runs along the twist of the step; a spring and a damper pull the part after it, and the push along the motion is limited
to a little more than the plan's, so that a part that a contact stops is not pried off the contacts that it holds; the
lead is cut back with the push. Where the part hardly moves and feels no contact, friction holds it, as normal forces
lie elsewhere than planned: then the push grows until the part moves or feels the contact. On the force-controlled axes
the reference gives way to what is missing of the holding wrench, slowly on the way and quickly while the part settles
before each move; the friction there, which would turn the part off what it holds, is made up for.

What tells a robot that a new contact is made: forces on it, by how long they last and whether they slow the part.
"""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fmopt.execution.engines.engine import Engine
from fmopt.execution.program import FAILED, Program, StepTable
from fmopt.execution.recovery import WayBack
from fmopt.execution.robot import Robot
from fmopt.execution.rotation import between, hats, product, quaternions
from fmopt.spatial.values import Array, Bits, Indices

TRAVEL, TIMEOUT, DUE, FORCE, DEEP, PUSH, SOFT, ON_STOP, ON_END, ON_LATE, MOVE, TOUCH, SURE, GENTLE = range(14)
Ints = NDArray[np.int64]


@dataclass
class RigState:
    """Where n bodies are in their programs; the only thing here that changes in place."""

    step: Ints
    shown: Ints
    gone: Array  # way along the twist of the step, m in the metric of ρ
    moving: Array  # s in the move
    p: Array  # position (n, 3) that the servo leads to
    q: Array  # quaternion (n, 4) that the servo leads to
    filtered: Array  # reaction (n, 6) after the filter, about the part's reference point, axes of B
    tare: Array  # reaction (n, 6) beyond the expected one when the move began
    sensed: Array  # mean of the last force of the new contacts, N, over the robot's shorter time
    slowly: Array  # the same over its longer time
    felt: Ints  # samples in a row that said the contact is felt
    stalled: Ints  # samples in a row that said the part stands at the greatest push
    effort: Array  # push in pushes of the step; it grows while the part stands and no contact is felt, and falls again
    friction: Array
    brisk: Array
    pace: Array


@dataclass(frozen=True)
class Event:
    """Body `body` left step `step` at `time`, s, because it stopped or because its travel or time was used up."""

    body: int
    step: int
    time: float


class Rig:
    """n bodies in a physics engine, all running one program.

    Args:
        drift: velocity error (moves, n, 6) on the twist of each move at the plan's speed, m/s and rad/s; of a step that
            is run more slowly it is the same share.
        noise: source of raw noise, (n, 6) standard normal at each call.
    """

    def __init__(self, engine: Engine, program: Program, robot: Robot, drift: Array, noise: Any) -> None:
        self.engine, self.program, self.robot, self.drift, self.noise = engine, program, robot, drift, noise
        self.table, self.scale = StepTable.of(program), np.repeat([1.0, program.rho], 3)  # twists to lengths
        self.qpos, self.qvel, self.depth = engine.qpos, engine.qvel, engine.depth
        self.n = n = len(self.qpos)
        self.time = 0.0
        self.held = np.zeros((n, 6))  # wrench that presses the held contacts, about the reference points
        self.reaction = np.zeros((n, 6))  # of the contacts, about the reference points, axes of B
        self.moved = np.zeros((n, 6))  # in the last period, m and rad, axes of B
        self.back: WayBack | None = None  # on which the bodies are led before they begin
        zero, p, q = np.zeros, np.array(self.qpos[:, :3]), np.array(self.qpos[:, 3:])
        whole, six = zero(n, np.int64), zero((n, 6))  # copied for all but the first: fields change in place
        self.state = RigState(
            *(whole, whole.copy(), zero(n), zero(n), p, q, six, six.copy(), zero(n), zero(n)),
            *(whole.copy(), whole.copy(), np.ones(n), zero(n), np.ones(n), np.ones(n)),
        )

    @property
    def running(self) -> Bits:
        """Which bodies still have a step to do."""
        return np.asarray(self.state.step >= 0)

    def tick(self) -> list[Event]:
        """One period: servo, physics, sensor, decisions."""
        here, before = self.state.shown, self.qpos.copy()  # a copy: the engine writes in place
        wrench = self._servo(here)
        if self.back is not None:
            led = self.time < self.back.ends
            wrench[led] = self._led(self.back)[led]
        self.engine.advance(wrench, self.robot.period)
        self.time += self.robot.period
        self.reaction = self.engine.reaction
        raw = self.reaction + self.noise() * np.repeat(self.robot.noise, 3)
        self.state.filtered += self.robot.smoothing * (raw - self.state.filtered)
        self.moved = np.hstack([self.qpos[:, :3] - before[:, :3], between(self.qpos[:, 3:], before[:, 3:])])
        events = self._decide(here)
        if self.back is not None:
            # In the period of their ends alone: a body that has failed since must not begin once more.
            rested = (self.time >= self.back.ends) & (self.time - self.robot.period < self.back.ends)
            self._begin(np.flatnonzero(rested & self.back.arrived(np.asarray(self.qpos))))
        return events

    def lead_back(self, back: WayBack) -> None:
        """Has all bodies led back to a start, from where they run the program; those that do not get there stay."""
        self.back = back
        self.state.step[:] = FAILED  # not running: on the way back nothing is felt, and nothing ends

    def stranded(self) -> Indices:
        """Bodies that were led back, and are not running."""
        if self.back is None:
            return np.zeros(0, dtype=np.intp)
        return np.flatnonzero((self.time >= self.back.ends) & ~self.running)

    def _led(self, back: WayBack) -> Array:
        """Wrenches (n, 6) that lead the parts along their ways back, as `_servo`."""
        p, q, twist = back.at(self.time)
        lead = np.hstack([p - self.qpos[:, :3], between(q, self.qpos[:, 3:])])
        K, D = np.repeat(self.robot.stiffnesses, 3), np.repeat(self.robot.dampings, 3)
        return self._cut(K * lead + D * (twist - self.moved / self.robot.period))

    def _begin(self, bodies: Indices) -> None:
        """Bodies begin the program, as they do in a new rig, where they are."""
        state = self.state
        for name in ("step", "shown", "felt", "stalled"):
            getattr(state, name)[bodies] = 0
        for name in ("gone", "moving", "tare", "sensed", "slowly", "friction"):
            getattr(state, name)[bodies] = 0.0
        state.effort[bodies] = state.brisk[bodies] = state.pace[bodies] = 1.0
        state.p[bodies], state.q[bodies] = self.qpos[bodies, :3], self.qpos[bodies, 3:]

    def _servo(self, here: Ints) -> Array:
        """Applied wrench (n, 6) about the reference points, axes of B; moves the reference poses on."""
        state, table, robot = self.state, self.table, self.robot
        R, origin, P = table.rotation[here], table.origin[here], table.position[here]
        numbers = table.numbers[here]
        running = (state.step >= 0) & (state.gone < numbers[:, TRAVEL]) & (state.moving >= 0.0)  # < 0: it settles
        move = numbers[:, MOVE].astype(np.int64)
        slowed = (table.speed[here] / self.program.speed)[:, None]
        twist = np.where(running[:, None], table.twist[here] + slowed * self.drift[move, np.arange(self.n)], 0.0)
        A = _adjoint(R, origin)
        lead = np.hstack([state.p - self.qpos[:, :3], between(state.q, self.qpos[:, 3:])])
        error, wanted = _through(A, lead), _through(P, _through(A, twist))
        # The speed over the whole period: by that at its end tight parts rattle.
        actual = _through(A, self.moved / robot.period)
        led, going = _through(P, error), _through(P, actual)
        share = np.clip(state.gone / numbers[:, TRAVEL], 0.0, 1.0)[:, None]
        hold = (1.0 - share) * table.hold[here, 0] + share * table.hold[here, 1]
        felt = np.asarray(np.linalg.solve(np.swapaxes(A, 1, 2), state.filtered[..., None])[..., 0], dtype=np.float64)
        rubbed = self._rubbed(felt, P, wanted)
        giving = self._giving(hold - rubbed + felt, P)
        K = np.repeat(robot.stiffnesses, 3) * numbers[:, SOFT, None]
        D = np.repeat(robot.dampings, 3) * np.sqrt(numbers[:, SOFT, None])  # 2 ζ √(K m): the ratio stays
        push = self._limited(K * led + D * (wanted - going), wanted, self._allowed(here))
        kept = self._cut(K * (error - led))
        press = kept + D * (giving - actual + going) - rubbed
        lead = (push - D * (wanted - going) + kept) / K
        self._lead(slice(None), A, lead + (wanted + giving) * robot.period)
        self.held = _through(np.swapaxes(A, 1, 2), hold)  # by the transpose, which keeps power
        return _through(np.swapaxes(A, 1, 2), push + press)

    def _allowed(self, here: Ints) -> Array:
        """Greatest pushes (n,) along the motion, N in the metric of ρ.

        Where the new contact may be met it is no less than the plan's, with a little leeway, and no less than what
        resisted the motion so far with what makes the contact felt on top; this alone grows further, or the part would
        be pried off what it holds. Where the plan says that its own push would do that, it is only this.
        """
        state, robot, numbers = self.state, self.robot, self.table.numbers[here]
        resisted = -np.sum(state.tare * self.table.twist[here], axis=1) / np.maximum(self.table.speed[here], 1e-12)
        soft = np.maximum(resisted, 0.0) + numbers[:, TOUCH] * state.effort
        near = (numbers[:, TOUCH] > 0.0) & (state.gone >= numbers[:, DUE]) & (state.moving >= robot.starting)
        plan = numbers[:, PUSH] * np.where(near, np.minimum(state.effort, robot.leeway), state.effort)
        least = np.where(numbers[:, GENTLE] > 0.0, 0.0, plan)
        push = np.where(near, np.maximum(soft, least), plan)
        start = np.where(state.moving < robot.starting, robot.mass * self.program.speed / robot.haste, 0.0)
        return np.asarray(np.minimum(push, self.program.limits[0]) + start)

    def _giving(self, missing: Array, P: Array) -> Array:
        """Twists (n, 6) with which the force-controlled axes give way to what is missing of their wrench (n, 6)."""
        missing = missing - _through(np.swapaxes(P, 1, 2), missing)
        settling = (self.state.moving < 0.0)[:, None]
        robot = self.robot
        given = missing / np.where(settling, np.repeat(robot.settled, 3), np.repeat(robot.resistances, 3))
        return np.asarray(given - _through(P, given))

    def _rubbed(self, felt: Array, P: Array, wanted: Array) -> Array:
        """Wrenches (n, 6) of friction on force-controlled axes, by the coefficient that the way there tells of.

        Along the motion nothing but friction resists before the new contact, so that the power of the reaction along
        the twist, as a share of that of friction of coefficient 1, is the coefficient.
        """
        state, robot = self.state, self.robot
        rubbing = self.table.rubbing[state.shown]
        power = np.sum(rubbing * wanted, axis=1)
        told = np.sum(felt * wanted, axis=1) / np.minimum(power, -1e-9)
        told = np.where(power < -1e-9, np.clip(told, 0.0, self.program.friction), 0.0)
        state.friction += robot.period / robot.learning * (told - state.friction)
        rubbed = state.friction[:, None] * rubbing
        return np.asarray(rubbed - _through(np.swapaxes(P, 1, 2), rubbed))

    def _limited(self, push: Array, wanted: Array, limit: Array) -> Array:
        """The servo's wrench with its part along the motion, and then its force and torque, cut to their limits."""
        scale = self.scale
        size = np.linalg.norm(wanted * scale, axis=1, keepdims=True)
        along = wanted * scale / np.maximum(size, 1e-12)
        scaled = push / scale
        over = np.maximum(np.sum(scaled * along, axis=1) - limit, 0.0)
        scaled = scaled - over[:, None] * along
        return self._cut(scaled * scale)

    def _cut(self, wrench: Array) -> Array:
        """Wrenches (n, 6) cut to the greatest force and torque."""
        halves = zip((wrench[:, :3], wrench[:, 3:]), self.program.limits, strict=True)
        sizes = np.maximum(*(np.linalg.norm(half, axis=1) / limit for half, limit in halves))
        return np.asarray(wrench / np.maximum(sizes, 1.0)[:, None])

    def _lead(self, bodies: Indices | slice, A: Array, lead: Array) -> None:
        """Reference poses of bodies: the parts', led by these twists (n, 6) of the frames."""
        back = np.asarray(np.linalg.solve(A, lead[..., None])[..., 0], dtype=np.float64)
        self.state.p[bodies] = self.qpos[bodies, :3] + back[:, :3]
        self.state.q[bodies] = product(quaternions(back[:, 3:]), self.qpos[bodies, 3:])

    def _decide(self, here: Ints) -> list[Event]:
        """Felt, deep or late: bodies that leave their step, and where they go."""
        state, numbers = self.state, self.table.numbers[here]
        scaled = self.scale**2 * self.table.twist[here]  # for ways in the last period, m in the metric of ρ
        way = np.asarray(np.sum(self.moved * scaled, axis=1) / np.maximum(self.table.speed[here], 1e-12))
        running = self.running
        extra, robot = state.filtered + self.held, self.robot
        state.gone += np.where(state.moving >= 0.0, way, 0.0)
        share = way / np.maximum(self.table.speed[here] * robot.period, 1e-12)
        state.moving += robot.period
        going = state.moving > robot.starting
        guarded = going & np.isfinite(numbers[:, FORCE])
        slow, due = guarded & (share <= robot.slow), guarded & (state.gone >= numbers[:, DUE])
        # While the part is slow the level stays: it may be the new contact that slows it.
        follow = np.where(going, np.where(slow, 0.0, robot.period / robot.memory), 1.0)
        state.tare += follow[:, None] * (extra - state.tare)
        force = np.sum(self.table.gain[here] * (extra - state.tare), axis=1)
        fast, slowly = (robot.period / time for time in robot.averaging)
        state.sensed = np.where(going, state.sensed + fast * (force - state.sensed), 0.0)
        state.slowly = np.where(going, state.slowly + slowly * (force - state.slowly), 0.0)
        state.brisk = np.where(going, state.brisk + fast * (share - state.brisk), 1.0)
        state.pace = np.where(going, state.pace + slowly * (share - state.pace), 1.0)
        grown = 2.0 ** (robot.period / robot.doubling)
        sluggish = guarded & (state.pace <= robot.slow)
        signal = Signal(state.sensed, state.slowly, state.brisk, state.pace, state.effort)
        told = contact_told(signal, numbers[:, FORCE], numbers[:, SURE], robot)
        state.felt = np.where(due & told, state.felt + 1, 0)
        state.effort = np.where(sluggish, state.effort * grown, np.maximum(state.effort / grown, 1.0))
        most = self._allowed(here) >= self.program.limits[0]
        state.stalled = np.where(due & most & (share <= robot.standing), state.stalled + 1, 0)
        sure = (state.felt >= robot.debounce) | (state.stalled >= robot.patience)
        stopped = running & (sure | (self.qpos[:, 2] < numbers[:, DEEP]))
        ended = running & ~stopped & (state.gone >= numbers[:, TRAVEL])
        late = running & ~stopped & ~ended & (state.moving >= numbers[:, TIMEOUT])
        ways = [numbers[:, ON_STOP], numbers[:, ON_END]]
        following = np.select([stopped, ended], ways, numbers[:, ON_LATE]).astype(np.int64)
        left = np.flatnonzero(stopped | ended | late)
        events = [Event(int(body), int(here[body]), self.time) for body in left]
        self._enter(left, following[left], numbers[left, MOVE])
        return events

    def _enter(self, bodies: Indices, steps: Ints, moves: Array) -> None:
        """A new move starts where the part is; a piece of the same move goes on from its lead and its way."""
        state = self.state
        # Passed on: a turn of 33 pieces ended 2.5 mrad late by what each of them went too far.
        over = np.maximum(state.gone[bodies] - self.table.numbers[state.shown[bodies], TRAVEL], 0.0)
        state.step[bodies], state.felt[bodies], state.stalled[bodies] = steps, 0, 0
        on = steps >= 0  # as indices DONE and FAILED would mean the last steps
        state.shown[bodies[on]], state.gone[bodies[on]] = steps[on], over[on]
        new = ~on | (self.table.numbers[np.maximum(steps, 0), MOVE] != moves)
        anew = bodies[new]
        state.moving[anew], state.effort[anew] = -self.robot.settling, 1.0
        state.gone[bodies[new & (steps != FAILED)]] = 0.0  # what failed keeps its way, which tells early from late
        self._rest(anew)

    def _rest(self, bodies: Indices) -> None:
        """Reference poses where the parts are, but for the lead that presses what is held."""
        if not len(bodies):
            return
        here = self.state.shown[bodies]
        A = _adjoint(self.table.rotation[here], self.table.origin[here])
        stiffnesses = np.repeat(self.robot.stiffnesses, 3) * self.table.numbers[here, SOFT, None]
        lead = np.asarray(self.table.hold[here, 0] / stiffnesses)
        self._lead(bodies, A, lead - _through(self.table.position[here], lead))


def _adjoint(R: Array, r: Array) -> Array:
    """(n, 6, 6): twists about the reference points in axes of B to those of frames turned by R at offsets r."""
    turned = np.swapaxes(R, 1, 2)
    A = np.zeros((len(R), 6, 6))
    A[:, :3, :3] = A[:, 3:, 3:] = turned
    A[:, :3, 3:] = -turned @ hats(r)
    return A


def _through(A: Array, x: Array) -> Array:
    return np.asarray(np.einsum("nij,nj->ni", A, x))


class Signal(NamedTuple):
    """What n bodies feel."""

    sensed: Array  # mean of the last force (n,) of the new contacts, N, over the robot's shorter time
    slowly: Array  # the same over its longer time
    brisk: Array  # mean of the last speed (n,) along the motion over the shorter time, as a share of the commanded one
    pace: Array  # the same over the longer time
    effort: Array  # push (n,), in pushes of the plan


def contact_told(signal: Signal, force: Array, sure: Array, robot: Robot) -> Bits:
    """Which of n bodies' last samples speak of the new contact.

    A force that friction could not bring about does, if it slows the part or lasts: faces that rub rattle, which is as
    strong but over in some milliseconds, and a part that pivots about its new contact is hardly slowed. So does a
    smaller one that brakes the part, and a smaller one yet at which the part stands although the push has grown: a
    larger push would pry it off what it holds. A force on a part that is braked counts from `force` (n,) on, N; all
    friction brings about less than `sure` (n,), N.
    """
    slowed = (signal.brisk <= robot.braked[0]) & (signal.sensed >= sure)
    lasting = signal.slowly >= robot.lasting * sure
    braked = (signal.pace <= robot.braked[1]) & (signal.slowly >= force)
    pushes, share = robot.stuck
    stands = (signal.pace <= robot.standing) & (signal.effort >= pushes) & (signal.slowly >= share * force)
    return np.asarray(slowed | lasting | braked | stands)
