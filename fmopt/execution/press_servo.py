"""What the rig for presses does in every period, compiled: the wrench that each body gets, and what ends its press."""

from __future__ import annotations

from math import atan2, cos, exp, pi, sin, sqrt
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from fmopt.runtime.compiled import compiled
from fmopt.spatial.values import Array

NEXT, SEATED, RETRY, FAIL, OVER = range(5)  # what follows; OVER is the end of a rest or of a way back
RUNNING, HOLDING, BACKING, DONE = range(4)
SAMPLE = 0.01  # s between samples of the pose that a standstill is judged by
_EASED = 0.015  # s in which damping passes from that of the press before: put on at once, it knocks parts into walls

Bools: TypeAlias = NDArray[np.bool_]
Ints: TypeAlias = NDArray[np.int64]
Vector: TypeAlias = tuple[float, float, float]
Quaternion: TypeAlias = tuple[float, float, float, float]


class Bodies(NamedTuple):
    """What is kept of n bodies, a row each; changed in place.

    Attributes:
        mode, step: (n,), and the press among all of the plan.
        time, due: (n,), s in the press, and at the end of a rest or of a way back.
        p, q: references (n, 3), (n, 4) of held axes.
        begun: measured poses (n, 7) at the begin of the press.
        before, filtered: wrenches (n, 6) at the begin of the press, and as they are measured.
        peak, lowest: (n,), N and m.
        gives, twist, wrench, ramp, reference, rocking: of the press, as the body gets it; rocking is angle, turns a
            second and seconds, (n, 3).
        resist, resisted, resists: (n, 6) damping of axes that give way, now, before the press, and wanted.
        stiffness, damping: (n, 6), of held axes.
        offset: (n, 6) of the wrench.
        above: (n,), m, by which the start is above its nominal height.
    """

    mode: Ints
    step: Ints
    time: Array
    due: Array
    p: Array
    q: Array
    begun: Array
    before: Array
    filtered: Array
    peak: Array
    lowest: Array
    gives: Bools
    twist: Array
    wrench: Array
    ramp: Array
    reference: Array
    resist: Array
    resisted: Array
    resists: Array
    rocking: Array
    stiffness: Array
    damping: Array
    offset: Array
    above: Array


class Ends(NamedTuple):
    """Ends of all presses of a plan, a row each; those that a press does not have are infinite.

    Attributes:
        still: displacement, window, armed, below.
        still_then: what follows at rest below the height, and above it.
        at: z of a level, distance, angle, force, time; `thens` is what follows.
        turning: rad/s, of the twist.
        reach: m and rad.
    """

    still: Array
    still_then: Ints
    at: Array
    thens: Ints
    turning: Array
    reach: Array


class Sensors(NamedTuple):
    """What is measured: the last poses and filtered wrenches, (periods, n, 13), and samples (k, n, 6) of displacements.

    Attributes:
        noise: standard deviations (12,) of force, torque, position and angle.
        measured: (n, 13), late and noisy.
    """

    late: Array
    samples: Array
    noise: Array
    measured: Array


@compiled
def _product(a: Quaternion, b: Quaternion) -> Quaternion:
    return (
        a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
        a[0] * b[1] + b[0] * a[1] + a[2] * b[3] - a[3] * b[2],
        a[0] * b[2] + b[0] * a[2] + a[3] * b[1] - a[1] * b[3],
        a[0] * b[3] + b[0] * a[3] + a[1] * b[2] - a[2] * b[1],
    )


@compiled
def _turn(x: float, y: float, z: float) -> Quaternion:
    """The quaternion of a rotation vector, rad."""
    half = 0.5 * sqrt(x * x + y * y + z * z)
    share = 0.5 * sin(half) / half if half > 1e-9 else 0.5
    return cos(half), share * x, share * y, share * z


@compiled
def _between(a: Quaternion, b: Quaternion) -> Vector:
    """The rotation vector, rad, that turns b into a, by at most π."""
    w, x, y, z = _product(a, (b[0], -b[1], -b[2], -b[3]))
    sine = sqrt(x * x + y * y + z * z)
    share = 2.0 * atan2(sine, abs(w)) / sine if sine > 1e-9 else 2.0
    share = -share if w < 0.0 else share
    return share * x, share * y, share * z


@compiled
def _row(q: Array) -> Quaternion:
    return q[0], q[1], q[2], q[3]


@compiled
def rotated(q: Array, v: Array, inverse: bool, out: Array) -> None:
    """Vectors (n, 3) turned by quaternions (n, 4), or by their inverses, into `out`."""
    for k in range(len(q)):
        w, sign = q[k, 0], -1.0 if inverse else 1.0
        x, y, z = sign * q[k, 1], sign * q[k, 2], sign * q[k, 3]
        a, b, c = v[k, 0], v[k, 1], v[k, 2]
        i, j, h = 2.0 * (y * c - z * b), 2.0 * (z * a - x * c), 2.0 * (x * b - y * a)
        out[k, 0] = a + w * i + y * h - z * j
        out[k, 1] = b + w * j + z * i - x * h
        out[k, 2] = c + w * h + x * j - y * i


@compiled
def servo(
    bodies: Bodies, active: Ints, qpos: Array, qvel: Array, period: float, limits: tuple[float, float], wrench: Array
) -> None:
    """Applied wrenches (n, 6) about the body origins, axes of B, into `wrench`; moves the references on."""
    spin, lever = np.zeros((1, 3)), np.zeros((1, 3))
    lead, given = np.zeros(6), np.zeros(6)
    for k in active:
        gives, q = bodies.gives[k], _row(qpos[k, 3:])
        rotated(qpos[k : k + 1, 3:], qvel[k : k + 1, 3:], False, spin)
        rotated(qpos[k : k + 1, 3:], bodies.reference[k : k + 1], False, lever)
        twist, time, led = bodies.twist[k], bodies.time[k], _row(bodies.q[k])
        led = _product(_turn(twist[3] * period, twist[4] * period, twist[5] * period), led)
        if bodies.rocking[k, 2] > 0.0:
            angle, rate, seconds = bodies.rocking[k]
            gone, phase = min(time / seconds, 1.0), 2.0 * pi * rate * time
            angle *= min(1.0, 4.0 * gone) * (1.0 - gone)
            led = _product(_turn(angle * cos(phase), angle * sin(phase), 0.0), _row(bodies.begun[k, 3:]))
        lead[3], lead[4], lead[5] = _between(led, q)
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
        led = _product(_turn(lead[3], lead[4], lead[5]), q)
        bodies.q[k, 0], bodies.q[k, 1], bodies.q[k, 2], bodies.q[k, 3] = led
        for i in range(6):
            speed = qvel[k, i] if i < 3 else spin[0, i - 3]
            held = bodies.stiffness[k, i] * lead[i] + bodies.damping[k, i] * (twist[i] - speed)
            wrench[k, i] = given[i] + bodies.offset[k, i] if gives[i] else held
        for first, limit in ((0, limits[0]), (3, limits[1])):
            size = _length(wrench[k, first : first + 3])
            if size > limit:
                wrench[k, first : first + 3] *= limit / size


@compiled
def _length(v: Array) -> float:
    return sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])


@compiled
def sensed(
    bodies: Bodies, sensors: Sensors, active: Ints, qpos: Array, reaction: Array, noise: Array, tick: int,
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
        w, x, y, z = _product(_turn(x, y, z), _row(sensors.measured[k, 3:7]))
        sensors.measured[k, 3], sensors.measured[k, 4], sensors.measured[k, 5], sensors.measured[k, 6] = w, x, y, z


@compiled
def ended(
    bodies: Bodies, ends: Ends, sensors: Sensors, active: Ints, arm: float, sample: int, follows: Ints
) -> bool:  # fmt: skip
    """What follows for each body whose press, rest or way back has ended, −1 for others, into `follows`.

    Args:
        arm: m, that turns are told as displacements by.
        sample: number of the sample that is due; −1 for none.

    Returns:
        Whether any has ended.
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
        shift[3], shift[4], shift[5] = _between(_row(seen[3:7]), _row(bodies.begun[k, 3:]))
        way = turned = pressed = 0.0
        for i in range(3):
            shift[i] = seen[i] - bodies.begun[k, i] if gives[i] else 0.0
            shift[3 + i] = shift[3 + i] if gives[3 + i] else 0.0
            way, turned = way + shift[i] ** 2, turned + shift[3 + i] ** 2
            pressed += 0.0 if gives[i] else (seen[7 + i] + bodies.offset[k, i]) ** 2
        code, z = -1, seen[2] - bodies.above[k]
        if time >= at[4]:
            code = thens[4]
        if sqrt(pressed) >= at[3]:
            code = thens[3]
        if ends.turning[step] * time >= at[2]:
            code = thens[2]
        if sqrt(way) >= at[1]:
            code = thens[1]
        if sqrt(way) > ends.reach[step, 0] or sqrt(turned) > ends.reach[step, 1]:
            code = RETRY
        if sample >= 0:
            for i in range(6):
                sensors.samples[sample % len(sensors.samples), k, i] = shift[i] * (1.0 if i < 3 else arm)
            if still[0] > 0.0 and time >= still[1] + still[2] and _stands(sensors.samples, k, sample, still):
                code = ends.still_then[step, 0 if z <= still[3] else 1]
        follows[k] = thens[0] if z <= at[0] else code
        some = some or follows[k] >= 0
    return some


@compiled
def _stands(samples: Array, k: int, sample: int, still: Array) -> bool:
    """Whether body k has moved by less than the bound within the window."""
    spread, count = 0.0, int(np.ceil(still[1] / SAMPLE - 1e-9)) + 1
    for i in range(6):
        low, high = np.inf, -np.inf
        for back in range(count):
            value = samples[(sample - back) % len(samples), k, i]
            low, high = min(low, value), max(high, value)
        spread += (high - low) ** 2
    return bool(spread < still[0] ** 2)
