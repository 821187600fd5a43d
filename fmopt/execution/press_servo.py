"""What the rig for presses does in every period, compiled: the wrench that each body gets, and what ends its press."""

from __future__ import annotations

from collections.abc import Sequence
from math import cos, exp, pi, sin, sqrt
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from fmopt.execution.kernels_rotation import between, product, rotated, row, turn
from fmopt.plan.press import Force, Level, Next, Press, Standstill, Time, Travel
from fmopt.runtime.compiled import compiled
from fmopt.spatial.values import Array, Bits

NEXT, SEATED, RETRY, FAIL, OVER = range(5)  # what follows; OVER is the end of a rest or of a way back
_THEN: dict[Next, int] = {"next": NEXT, "seated": SEATED, "retry": RETRY, "fail": FAIL}
RUNNING, HOLDING, BACKING, DONE = range(4)
LEVEL, DISTANCE, ANGLE, FORCE, TIME = range(5)  # columns of ends but standstills
DISPLACEMENT, WINDOW, ARMED, BELOW = range(4)  # columns of standstills
SAMPLE = 0.01  # s between samples of the pose that a standstill is judged by
_BACKED = 0.7  # of the limits of force and torque, that a part is backed out with: friction and impacts add to it
_EASED = 0.015  # s in which damping passes from that of the press before: put on at once, it knocks parts into walls

Ints: TypeAlias = NDArray[np.int64]


class States(NamedTuple):
    """What is kept of n bodies, a row each; changed in place."""

    mode: Ints  # (n,)
    step: Ints  # (n,), the press among all of the plan
    time: Array  # (n,), s in the press
    due: Array  # (n,), s at the end of a rest or of a way back
    p: Array  # references (n, 3) of held axes
    q: Array  # references (n, 4) of held axes
    begun: Array  # measured poses (n, 7) at the begin of the press
    before: Array  # wrenches (n, 6) at the begin of the press
    filtered: Array  # wrenches (n, 6) as they are measured
    peak: Array  # (n,), N
    lowest: Array  # (n,), m
    gives: Bits  # of the press, as the body gets it; so are twist, wrench, ramp and reference
    twist: Array
    wrench: Array
    ramp: Array
    reference: Array
    resist: Array  # (n, 6) damping of axes that give way, now
    resisted: Array  # likewise, before the press
    resists: Array  # likewise, wanted
    rocking: Array  # of the press: angle, turns a second and seconds, (n, 3)
    stiffness: Array  # (n, 6), of held axes
    damping: Array  # (n, 6), of held axes
    offset: Array  # (n, 6) of the wrench
    above: Array  # (n,), m, by which the start is above its nominal height


class PressEnds(NamedTuple):
    """Ends of all presses of a plan, a row each; those that a press does not have are infinite."""

    still: Array  # a column for each number of a standstill
    still_then: Ints  # what follows at rest below the height, and above it
    at: Array  # a column for each other end
    thens: Ints  # what follows these
    turning: Array  # rad/s, of the twist
    reach: Array  # m and rad


class Sensors(NamedTuple):
    """What is measured: the last poses and filtered wrenches, (periods, n, 13), and samples (k, n, 6) of displacements.

    Noise is standard deviations (12,) of force, torque, position and angle; `measured` (n, 13) is late and noisy.
    """

    late: Array
    samples: Array
    noise: Array
    measured: Array


def ends_of(presses: Sequence[Press]) -> PressEnds:
    """Ends of presses as rows."""
    count = len(presses)
    still, still_then = np.full((count, 4), np.inf), np.zeros((count, 2), np.int64)
    still[:, DISPLACEMENT] = -1.0
    at, thens = np.full((count, 5), np.inf), np.zeros((count, 5), np.int64)
    at[:, LEVEL] = -np.inf
    for k, press in enumerate(presses):
        for end in press.ends:
            match end:
                case Standstill():
                    below = np.inf if end.below is None else end.below
                    still[k] = end.displacement, end.window, end.armed, below
                    still_then[k] = _THEN[end.then], _THEN[end.else_then]
                case Level():
                    at[k, LEVEL], thens[k, LEVEL] = end.z, _THEN[end.then]
                case Travel():
                    at[k, DISTANCE] = np.inf if end.distance is None else end.distance
                    at[k, ANGLE] = np.inf if end.angle is None else end.angle
                    thens[k, [DISTANCE, ANGLE]] = _THEN[end.then]
                case Force():
                    at[k, FORCE], thens[k, FORCE] = end.force, _THEN[end.then]
                case Time():
                    at[k, TIME], thens[k, TIME] = end.seconds, _THEN[end.then]
    turning = np.array([np.linalg.norm(press.twist[3:]) for press in presses])
    return PressEnds(still, still_then, at, thens, turning, np.array([press.reach for press in presses]))


@compiled
def servo(
    bodies: States, active: Ints, qpos: Array, qvel: Array, period: float, limits: tuple[float, float], wrench: Array
) -> None:
    """Applied wrenches (n, 6) about the body origins, axes of B, into `wrench`; moves the references on."""
    spin, lever = np.zeros((1, 3)), np.zeros((1, 3))
    lead, given = np.zeros(6), np.zeros(6)
    for k in active:
        gives, q = bodies.gives[k], row(qpos[k, 3:])
        rotated(qpos[k : k + 1, 3:], qvel[k : k + 1, 3:], False, spin)
        rotated(qpos[k : k + 1, 3:], bodies.reference[k : k + 1], False, lever)
        twist, time, led = bodies.twist[k], bodies.time[k], row(bodies.q[k])
        led = product(turn(twist[3] * period, twist[4] * period, twist[5] * period), led)
        if bodies.rocking[k, 2] > 0.0:
            angle, rate, seconds = bodies.rocking[k]
            gone, phase = min(time / seconds, 1.0), 2.0 * pi * rate * time
            angle *= min(1.0, 4.0 * gone) * (1.0 - gone)
            led = product(turn(angle * cos(phase), angle * sin(phase), 0.0), row(bodies.begun[k, 3:]))
        lead[3], lead[4], lead[5] = between(led, q)
        share = min(time / bodies.ramp[k], 1.0)
        eased = min(time / _EASED, 1.0)
        for i in range(6):
            given[i] = (1.0 - share) * bodies.before[k, i] + share * bodies.wrench[k, i]
            least, wanted = bodies.resisted[k, i], bodies.resists[k, i]
            bodies.resist[k, i] = least * (wanted / least) ** eased if min(least, wanted) > 0.0 else wanted
        for i in range(3):
            bodies.p[k, i] = qpos[k, i] if gives[i] else bodies.p[k, i] + twist[i] * period
            lead[i] = bodies.p[k, i] - qpos[k, i]
            lead[3 + i] = 0.0 if gives[3 + i] else lead[3 + i]
            following, last = (i + 1) % 3, (i + 2) % 3
            given[3 + i] += lever[0, following] * given[last] - lever[0, last] * given[following]
            given[3 + i] -= bodies.resist[k, 3 + i] * spin[0, i]
        led = product(turn(lead[3], lead[4], lead[5]), q)
        bodies.q[k, 0], bodies.q[k, 1], bodies.q[k, 2], bodies.q[k, 3] = led
        for i in range(6):
            speed = qvel[k, i] if i < 3 else spin[0, i - 3]
            held = bodies.stiffness[k, i] * lead[i] + bodies.damping[k, i] * (twist[i] - speed)
            wrench[k, i] = given[i] + bodies.offset[k, i] if gives[i] else held
        most = _BACKED if bodies.mode[k] == BACKING else 1.0
        for first, limit in ((0, most * limits[0]), (3, most * limits[1])):
            size = _length(wrench[k, first : first + 3])
            if size > limit:
                wrench[k, first : first + 3] *= limit / size


@compiled
def _length(v: Array) -> float:
    return sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])


@compiled
def sensed(
    bodies: States, sensors: Sensors, active: Ints, qpos: Array, reaction: Array, noise: Array, tick: int,
    period: float, cut_off: float,
) -> None:  # fmt: skip
    """Filters what the bodies feel, and measures them, late and with noise (n, 12)."""
    count, smoothing = len(sensors.late), 1.0 - exp(-2.0 * pi * cut_off * period)
    newest, oldest = tick % count, (tick + 1) % count
    for k in active:
        bodies.time[k] += period
        for i in range(6):
            raw = reaction[k, i] + noise[k, i] * sensors.noise[i]
            bodies.filtered[k, i] += smoothing * (raw - bodies.filtered[k, i])
        bodies.peak[k] = max(bodies.peak[k], _length(bodies.filtered[k, :3]))
        bodies.lowest[k] = min(bodies.lowest[k], qpos[k, 2])
        sensors.late[newest, k, :7] = qpos[k]
        sensors.late[newest, k, 7:] = bodies.filtered[k]
        sensors.measured[k] = sensors.late[oldest, k]
        for i in range(3):
            sensors.measured[k, i] += noise[k, 6 + i] * sensors.noise[6 + i]
        x, y, z = noise[k, 9] * sensors.noise[9], noise[k, 10] * sensors.noise[10], noise[k, 11] * sensors.noise[11]
        w, x, y, z = product(turn(x, y, z), row(sensors.measured[k, 3:7]))
        sensors.measured[k, 3], sensors.measured[k, 4], sensors.measured[k, 5], sensors.measured[k, 6] = w, x, y, z


@compiled
def ended(
    bodies: States, ends: PressEnds, sensors: Sensors, active: Ints, arm: float, sample: int, follows: Ints
) -> bool:  # fmt: skip
    """Whether a press, rest or way back has ended; what follows for each such body goes into `follows`, else −1.

    Turns are told as displacements by an arm, m; the number of the sample that is due is −1 for none.
    """
    some, shift = False, np.zeros(6)
    for k in active:
        follows[k] = -1
        time, step, gives = bodies.time[k], bodies.step[k], bodies.gives[k]
        if bodies.mode[k] != RUNNING:
            follows[k] = OVER if time >= bodies.due[k] else -1
            some = some or follows[k] >= 0
            continue
        seen, at, thens, still = sensors.measured[k], ends.at[step], ends.thens[step], ends.still[step]
        shift[3], shift[4], shift[5] = between(row(seen[3:7]), row(bodies.begun[k, 3:]))
        way = turned = pressed = 0.0
        for i in range(3):
            shift[i] = seen[i] - bodies.begun[k, i] if gives[i] else 0.0
            shift[3 + i] = shift[3 + i] if gives[3 + i] else 0.0
            way, turned = way + shift[i] ** 2, turned + shift[3 + i] ** 2
            pressed += 0.0 if gives[i] else (seen[7 + i] + bodies.offset[k, i]) ** 2
        code, z = -1, seen[2] - bodies.above[k]
        if time >= at[TIME]:
            code = thens[TIME]
        if sqrt(pressed) >= at[FORCE]:
            code = thens[FORCE]
        if ends.turning[step] * time >= at[ANGLE]:
            code = thens[ANGLE]
        if sqrt(way) >= at[DISTANCE]:
            code = thens[DISTANCE]
        if sqrt(way) > ends.reach[step, 0] or sqrt(turned) > ends.reach[step, 1]:
            code = RETRY
        if sample >= 0:
            for i in range(6):
                sensors.samples[sample % len(sensors.samples), k, i] = shift[i] * (1.0 if i < 3 else arm)
            if (
                still[DISPLACEMENT] > 0.0
                and time >= still[WINDOW] + still[ARMED]
                and _stands(sensors.samples, k, sample, still)
            ):
                code = ends.still_then[step, 0 if z <= still[BELOW] else 1]
        follows[k] = thens[LEVEL] if z <= at[LEVEL] else code
        some = some or follows[k] >= 0
    return some


@compiled
def _stands(samples: Array, k: int, sample: int, still: Array) -> bool:
    """Whether body k has moved by less than the bound within the window."""
    spread, count = 0.0, int(np.ceil(still[WINDOW] / SAMPLE - 1e-9)) + 1
    for i in range(6):
        low, high = np.inf, -np.inf
        for back in range(count):
            value = samples[(sample - back) % len(samples), k, i]
            low, high = min(low, value), max(high, value)
        spread += (high - low) ** 2
    return bool(spread < still[DISPLACEMENT] ** 2)
