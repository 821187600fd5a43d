"""The library of corner presses: six sets of dimensionless numbers, from which sequences are made for any mouth."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fmopt.plan import Numbers
from fmopt.plan.field_types import numbers as numbers_of
from fmopt.plan.press import Attempt, End, Gives, Level, Point, Press, PressRobot, Rocking, Standstill, Time, Travel
from fmopt.planning.press.entry import corner_entry
from fmopt.planning.press.placed.placement import stroke
from fmopt.planning.press.task import Corner, PressTask, Shelf
from fmopt.spatial.values import Array

FORCE, AXIAL = 8.0, 20.0  # N, lateral force of a press at strength 1, and axial force of the last one
TURNING, SWEEP_SPEED = 0.25, 0.06  # rad/s, upright, and about the axis
LATERAL_SPEED, AXIAL_SPEED, TURN_SPEED = 0.01, 0.012, 1.0  # m/s and rad/s, limits of axes that give way
COME_DOWN = 4.0, 0.01  # N and m/s
DATUM, SLIDE = (10.0, 2.0), 4.0  # N: lateral and axial; axial
_DROPPING, _SLIDING = 0.08, 0.005  # s for which a part that slides stays in its play, and m/s at most
_FLUSH = 0.4  # of the size: the part stands flush against walls that are higher
_BEYOND = 1.05  # times the way to the middle that it slides
_DROP = 1.5e-4  # m by which it is off the shelf
_BENT = 8e-4  # m by which friction holds the part back on its way, at most
_ASIDE = 0.15  # lateral over axial force with which the part comes down to a shelf
ROCK, ROCK_FORCE = Rocking(math.radians(3.0), 2.0, 2.0), 5.0  # N
_LONGEST = 6.0  # s, of the last presses to no great depth
_LOWER_FROM, _LOWER_SPEED, _LOWER_TO = 4.5e-4, 4e-4, 0.4  # into a through hole: m above the goal, m/s, and clearances
_LIFTED = 2.0  # times the offset of the force that is pressed down at least: the offset would lift the part out
_HELD_SPEED = 0.008  # m/s, down with the attitude held: a part that cannot turn lands harder
_SWEPT, _YAW = math.radians(2.5), 1.5  # tilt while yaw is led, and errors of yaw that it is led through
_ROCKED, _ROCKED_TIME, _ROCKED_FORCE = 1.3, 6.0, 12.0  # errors of tilt that a part is rocked through, s, and N down
_SHAKE = Rocking(math.radians(1.0), 2.0, 4.0)  # about the attitude that the mouth has led a part to
_TURNED = 0.1  # offset of the torque over the last force times the width, from which it turns the part
_SINKS = 2.0  # axial over lateral force while turning upright, at most, in a sharp corner
_ARM = 0.01  # m, least lever that turns count by
_LOST = 0.35, 4.0  # rad, and times the start errors: a part that turns by more has slipped off
_DAMPING, _LEVER = 400.0, 0.02  # N·s/m; m, least that damping of turns is made of
DELAY = PressRobot.delay  # s, of measurements

ALL, XYZ, XYZ_YAW = (True,) * 6, (True,) * 3 + (False,) * 3, (True,) * 3 + (False, False, True)
NO_YAW = (True,) * 5 + (False,)
ONLY_Z = (False, False, True, False, False, False)


@dataclass(frozen=True)
class CornerPress:
    """Dimensionless numbers of a corner press."""

    tilt: float  # of the start, rad
    distance: float  # of the tip from the corner's walls, in lateral errors
    down: float  # depth of the tip below the mouth before it is pressed, in sizes
    kappa: float  # axial over lateral force of the press
    hold: float  # lateral force while turning upright, in that of the press
    axial: float  # axial force then, in that lateral one
    yaw: bool  # whether yaw gives way then
    end: float  # lateral over axial force of the last press
    rock: bool = False  # whether the part is rocked before it
    strokes: bool = False  # whether the tip is led along each wall of the corner even where one direction does


LIBRARY = (
    CornerPress(math.radians(4.5), 1.65, 0.115, 0.39, 0.89, 0.90, True, 0.12),
    CornerPress(math.radians(8.0), 1.65, 0.100, 0.39, 0.89, 0.90, True, 0.12, rock=True),
    CornerPress(math.radians(13.0), 1.75, 0.054, 0.48, 0.91, 0.49, False, 0.05, strokes=True),
    CornerPress(math.radians(12.0), 1.45, 0.050, 0.22, 0.66, 0.45, True, 0.05, strokes=True),
    CornerPress(math.radians(6.0), 1.85, 0.120, 0.60, 0.60, 0.90, True, 0.20, rock=True),
    CornerPress(math.radians(4.5), 1.65, 0.115, 0.39, 0.89, 0.90, False, 0.12),
)
_CORNER = 2.3  # lateral errors from the corner along its bisector, at least


def robot_of(task: PressTask, stiffness: tuple[float, float], mass: tuple[float, float]) -> PressRobot:
    """The robot of a task at strength 1: stiffness of held axes, N/m, N·m/rad, apparent mass and inertia, kg, kg·m²."""
    damping = _DAMPING, _DAMPING * max(0.5 * task.size, _LEVER) ** 2
    limits = task.problem.specification.contact_force, task.problem.specification.torque_limit
    return PressRobot(stiffness, damping, *mass, limits, arm=max(0.5 * task.size, _ARM))


def corner_attempt(task: PressTask, corner: Corner, numbers: CornerPress, lean: float | None = None) -> Attempt:
    """The sequence of a corner: come down tilted, press into it, turn upright, datum and slide at shelves, go in.

    The low side is in direction `lean`, rad, that of the corner if not given.

    Raises:
        SearchError: the mouth leaves no place for the tip.
    """
    lean, below = corner.angle if lean is None else lean, numbers.down * task.size
    distance = corner_distance(task, corner, numbers.distance)
    pose, descent, _ = corner_entry(task, corner, numbers.tilt, lean, distance, below)
    # Friction on both walls, and their lean, do not hold the part up while it is turned upright.
    sinks = min(task.problem.friction[1] / math.cos(0.5 * corner.turn) + math.tan(numbers.tilt), _SINKS)
    numbers, aside = replace(numbers, axial=max(numbers.axial, sinks)), strokes(task, corner, numbers.strokes)
    pressed = into_the_mouth(task, direction(corner.angle), lean, numbers, aside=aside)
    return Attempt(numbers_of(pose.vector()), (come_down(descent + below), *pressed), "corner")


def lifted(task: PressTask) -> float:
    """The force down, N at strength 1, that an offset of the force does not lift the part against."""
    return _LIFTED * (task.problem.robot.force_offset / task.steady_force) * AXIAL


def strokes(task: PressTask, corner: Corner, always: bool) -> tuple[Array, ...]:
    """Directions (3,) of lateral forces that lead the tip along either wall into a corner.

    One is enough where it leads away from each wall at the largest friction; else, or `always`, each wall has its own.
    """
    enough, off = stroke(round(corner.turn, 9), task.problem.friction[1])
    return tuple(direction(corner.angle + turn) for turn in ((0.0,) if enough and not always else (off, -off)))


def corner_distance(task: PressTask, corner: Corner, least: float) -> float:
    """How far from the walls of a corner its tip comes down, m; at least so many lateral errors."""
    return task.lateral * max(least, _CORNER * math.sin(0.5 * (math.pi - corner.turn)))


def into_the_mouth(
    task: PressTask, u: Array, lean: float, numbers: CornerPress, gives: Gives = XYZ, aside: Sequence[Array] = ()
) -> tuple[Press, ...]:
    """Press towards a direction u (3,) with the tip inside the mouth, turn upright under the press, settle, and go in.

    The low side is in direction `lean`, rad; `gives` are axes that give way to the first presses, `aside` the
    directions (3,) of these, u if there is one alone.
    """
    hold = numbers.hold * FORCE
    axial = max(numbers.axial * hold, lifted(task))
    wrench = six(hold * u, -axial)
    pressed = (press_aside(task, one, numbers.kappa, gives) for one in aside or (u,))
    if task.round or task.keeps_attitude or not turned_by_offset(task):
        upright = turn_upright(task, numbers.tilt, lean, wrench, numbers.yaw)
        return (*pressed, *upright, *to_the_goal(task, u, numbers.end, numbers.rock))
    lower, _ = turn_upright(task, numbers.tilt - _SWEPT, lean, wrench, yaw=False)
    upright = turn_upright(task, _SWEPT, lean, wrench, yaw=False)
    led = _yaw_led(task, wrench) if task.box[5] > 0.0 else ()
    return (*pressed, lower, *led, *upright, *to_the_goal(task, u, numbers.end, rocked=False))


def _yaw_led(task: PressTask, wrench: Numbers) -> Iterator[Press]:
    """Turn about the axis one way and the other, the attitude held, until the part drops into the mouth."""
    inside, error = Level(-float(task.box[2]) - 2.0 * _DROP), _YAW * float(task.box[5])
    for angle in (-error, 2.0 * error):
        twist = (*(0.0,) * 5, math.copysign(SWEEP_SPEED, angle))
        ends = (*levels(task), inside, Travel(distance=_DROP), Time(abs(angle) / SWEEP_SPEED, "next"))
        yield Press("sweep yaw", XYZ, twist, wrench, SPEEDS, in_the_mouth(task), ends)


def press_aside(task: PressTask, u: Array, kappa: float, gives: Gives = XYZ) -> Press:
    """Press the tip towards a direction (3,), with `kappa` of that force downwards, until it stands."""
    return Press(
        "press into the corner", gives, (0.0,) * 6, six(FORCE * u, -max(kappa * FORCE, lifted(task))),
        (*SPEEDS[:2], kappa * LATERAL_SPEED, *SPEEDS[3:]), (3.0 * task.lateral + 0.5 * task.size, 1.0),
        (standstill(), Time(3.0, "next")),
    )  # fmt: skip


def direction(angle: float) -> Array:
    """Unit vector (3,) across the axis."""
    return np.array([math.cos(angle), math.sin(angle), 0.0])


SPEEDS = (LATERAL_SPEED, LATERAL_SPEED, AXIAL_SPEED) + (TURN_SPEED,) * 3
_LOWERING = (*SPEEDS[:2], _LOWER_SPEED, *SPEEDS[3:])  # close above the depth of a through hole


def six(lateral: Array, axial: float) -> Numbers:
    """A wrench of a lateral force (3,) and an axial one."""
    return float(lateral[0]), float(lateral[1]), float(axial), 0.0, 0.0, 0.0


def standstill(displacement: float = 3e-5, window: float = 0.15) -> Standstill:
    """Standstill after the ramp of the wrench."""
    return Standstill(displacement, window, 0.1)


def come_down(way: float) -> Press:
    """Come down by a way, m, or until the part stands, under a light force, the other axes held."""
    force, speed = COME_DOWN
    speeds = (*SPEEDS[:2], speed, *SPEEDS[3:])
    ends = (Travel(distance=way), standstill(5e-5, 0.1), Time(4.0 * way / speed + 1.0, "retry"))
    return Press("come down", ONLY_Z, (0.0,) * 6, (0.0, 0.0, -force, 0.0, 0.0, 0.0), speeds, (2.0 * way, 1.0), ends)


def turn_upright(task: PressTask, tilt: float, lean: float, wrench: Numbers, yaw: bool) -> tuple[Press, Press]:
    """Turn upright about the corner while the force holds, then settle."""
    rx, ry, _ = (-TURNING * np.array([-math.sin(lean), math.cos(lean), 0.0])).tolist()
    gives = XYZ_YAW if yaw else XYZ
    reach, floor = in_the_mouth(task), levels(task)
    turn = Press(
        "turn upright", gives, (0.0, 0.0, 0.0, rx, ry, 0.0), wrench, SPEEDS, reach,
        (*floor, Travel(angle=tilt), Time(3.0 * tilt / TURNING + 1.0, "retry")),
    )  # fmt: skip
    settle = Press("settle", gives, (0.0,) * 6, wrench, SPEEDS, reach, (*floor, standstill(), Time(6.0, "next")))
    return turn, settle


def in_the_mouth(task: PressTask) -> tuple[float, float]:
    """The reach of presses from the mouth on, m and rad; a part that slips off the rim goes farther."""
    return task.depth + 4.0 * task.lateral + 0.25 * task.size, _most_turned(task)


def _most_turned(task: PressTask) -> float:
    """How far a part may turn about axes that give way, rad; a round one may spin."""
    return max(min(1.0 if task.round else _LOST[0], task.room_to_turn), _LOST[1] * float(max(task.box[3:])))


def levels(task: PressTask) -> tuple[End, ...]:
    """The end of presses on the way in a through hole, close above the goal, from where the part is lowered slowly."""
    return (Level(_LOWER_FROM - task.depth),) if task.through else ()


def to_the_goal(task: PressTask, u: Array, end: float, rocked: bool) -> tuple[Press, ...]:
    """What follows once the part is upright in the mouth: shelves, rocking, if wanted, the last press.

    The lateral force is in direction u (3,), and the share `end` of the axial one in the last press.
    """
    presses = [press_on(task, XYZ, six(_ASIDE * FORCE * u, -FORCE))] if task.shelves else []
    presses += [press for one in task.shelves for press in at_shelf(task, u, one)]
    if rocked:
        presses.append(rock(task, ROCK, six(end * ROCK_FORCE * u, -ROCK_FORCE)))
    return (*presses, *go_in(task, u, end))


def go_in(task: PressTask, u: Array, end: float) -> tuple[Press, ...]:
    """The last presses: the attitude is held where the play leaves room for its error, and let go on the floor.

    Small parts, which an offset of the torque turns and jams, are rocked down with the attitude held, about the
    commanded one and then about the one that the mouth has led them to, before it gives way.
    """
    wrench, light = six(end * AXIAL * u, -AXIAL), six(end * FORCE * u, -FORCE)
    reach, gives, pressed = down_and_more(task), ALL, six(end * _ROCKED_FORCE * u, -_ROCKED_FORCE)
    before: tuple[Press, ...] = ()
    if task.keeps_attitude:
        held = XYZ if task.round else XYZ_YAW  # a round part that an offset of the torque turns would not stand still
        gives = (*XYZ[:3], *task.turned_flat, held[5])
        slow = press_on(task, held, light if all(task.turned_flat) else wrench)
        slow = replace(slow, speed=(*SPEEDS[:2], _HELD_SPEED, *SPEEDS[3:]))
        before = () if gives == held else (slow, press_on(task, gives, light))
    elif turned_by_offset(task):
        gives = NO_YAW if task.round else ALL
        cone = Rocking(_ROCKED * math.hypot(*task.box[3:5]), 1.0, _ROCKED_TIME)
        before = rock(task, cone, pressed), press_on(task, NO_YAW, wrench), rock(task, _SHAKE, pressed)
    time = Time(long_enough(task), "retry")
    if not task.through:
        deepest = -task.depth + task.clearance.per_side + float(task.box[2]) + 1e-4  # measured z of a seated part
        stands = replace(standstill(5e-5, 0.3), then="seated", below=deepest)
        down = Press("go in", gives, (0.0,) * 6, wrench, SPEEDS, reach, (stands, time))
        first = replace(down, ends=(replace(stands, else_then="next"), time))
        return (*before, first, *work_free(task, pressed), down)
    stuck = replace(standstill(5e-5, 0.3), then="retry")
    down = Press("go in", gives, (0.0,) * 6, wrench, SPEEDS, reach, (*levels(task), stuck, time))
    ends = (_seated(task), replace(standstill(2e-5, 0.3), then="retry"), Time(4.0, "retry"))
    lower = Press("lower to the depth", gives, (0.0,) * 6, wrench, _LOWERING, reach, ends)
    first, lowered = (
        replace(one, ends=tuple(replace(end, then="next") if isinstance(end, Standstill) else end for end in one.ends))
        for one in (down, lower)
    )
    return (*before, first, lowered, *work_free(task, pressed), down, lower)


def work_free(task: PressTask, wrench: Numbers) -> tuple[Press, Press, Press]:
    """Rock a stuck part about the attitude that it has, press on with yaw held, and rock it again from there."""
    shaken, down = replace(rock(task, _SHAKE, wrench), name="work free"), press_on(task, NO_YAW, wrench)
    if task.through:
        shaken, down = (replace(one, speed=_LOWERING, ends=(_seated(task), *one.ends[1:])) for one in (shaken, down))
    return shaken, down, shaken


def rock(task: PressTask, cone: Rocking, wrench: Numbers) -> Press:
    """Rock the part, its attitude held about where it is."""
    ends = (*levels(task), Time(cone.seconds, "next"))
    return Press("rock", XYZ, (0.0,) * 6, wrench, SPEEDS, down_and_more(task), ends, rocking=cone)


def turned_by_offset(task: PressTask) -> bool:
    """Whether an offset of the torque turns the part against its walls."""
    return task.problem.robot.torque_offset / task.steady_force > _TURNED * task.narrow


def _seated(task: PressTask) -> Level:
    """The depth of a through hole; the part goes on for as long as the measurement takes."""
    return Level(_LOWER_SPEED * DELAY + _LOWER_TO * task.clearance.per_side - task.depth, "seated")


def sweep_yaw(task: PressTask, wrench: Numbers, seconds: float) -> Press:
    """Turn about the axis by a torque, all else but the tilt giving way, until the part stands."""
    ends = (*levels(task), standstill(), Time(seconds, "next"))
    return Press("sweep yaw", XYZ_YAW, (0.0,) * 6, wrench, (*SPEEDS[:5], SWEEP_SPEED), in_the_mouth(task), ends)


def down_and_more(task: PressTask) -> tuple[float, float]:
    """The reach of presses that may go to the depth, m and rad."""
    return task.depth + 0.02, _most_turned(task)


def long_enough(task: PressTask) -> float:
    """How long the last presses may take, s."""
    return max(_LONGEST, 3.0 * task.depth / AXIAL_SPEED)


def press_on(task: PressTask, gives: Gives, wrench: Numbers) -> Press:
    """Down until the part stands, on the floor or on a shelf."""
    ends = (*levels(task), standstill(5e-5, 0.3), Time(2.0 + long_enough(task), "next"))
    return Press("press on", gives, (0.0,) * 6, wrench, SPEEDS, down_and_more(task), ends)


def at_shelf(task: PressTask, u: Array, shelf: Shelf) -> tuple[Press, Press, Press]:
    """Datum, slide, down: two walls and the shelf fix the part, then it is led to the middle, drops, and is pressed on.

    The walls are in direction u (3,). The way is led, not pushed: an offset of the wrench would turn it aside.
    """
    line: Point = (0.0, 0.0, shelf.lever)
    floor = levels(task)
    gives = ALL if shelf.height > _FLUSH * task.size else XYZ_YAW
    datum = Press(
        "datum on the shelf", gives, (0.0,) * 6, six(DATUM[0] * u, -DATUM[1]), SPEEDS, (0.05, down_and_more(task)[1]),
        (*floor, standstill(2e-5, 0.25), Time(4.0, "next")), line,
    )  # fmt: skip
    speed = min(task.clearance.per_side / _DROPPING, _SLIDING)
    x, y, _ = (-speed * u).tolist()
    ends = (*floor, Travel(distance=_DROP), Time((_BEYOND * task.way_to_walls(shelf, u) + _BENT) / speed, "next"))
    slide = Press(
        "slide off the shelf", ONLY_Z, (x, y, 0.0, 0.0, 0.0, 0.0), six(0.0 * u, -SLIDE), SPEEDS,
        down_and_more(task), ends,
    )  # fmt: skip
    return datum, slide, press_on(task, ONLY_Z, six(0.0 * u, -FORCE))
