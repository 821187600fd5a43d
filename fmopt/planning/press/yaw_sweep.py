"""Outlines with several arms: one arm is pressed into its corner, then yaw is swept until the other arms drop in."""

from __future__ import annotations

import math
from collections.abc import Iterator

from fmopt.errors import SearchError
from fmopt.plan.field_types import numbers
from fmopt.plan.press import Attempt
from fmopt.planning.press.entry import corner_entry
from fmopt.planning.press.library import (
    FORCE,
    SWEEP_SPEED,
    come_down,
    corner_distance,
    direction,
    press_aside,
    six,
    sweep_yaw,
    to_the_goal,
    turn_upright,
)
from fmopt.planning.press.task import Corner, PressTask
from fmopt.planning.press.touch_top import touching_first

_ARMS = 0.9  # of the area of its convex hull, below which a mouth has arms
_TILTS = ((math.radians(18.0), 0.05), (math.radians(13.0), 0.06))  # and depth of the tip before it is pressed, in sizes
_SWEPT = math.radians(4.0)  # tilt while yaw is swept: the tip is still in the mouth, the other arms are on the rim
_DISTANCE = 1.65  # lateral errors, from the walls of the corner
_YAW = 1.6  # errors of yaw that the sweep begins at
_KAPPA = 1.3  # axial over lateral force
_END = 0.05  # lateral over axial force of the last press


def yaw_sweeps(task: PressTask) -> Iterator[Attempt]:
    """Attempts from a few corners, either way about the axis; none where the mouth has no arms, or yaw no error."""
    if task.box[5] == 0.0 or task.mouth.area >= _ARMS * task.mouth.convex_hull.area:
        return
    for tilt, down in _TILTS:
        for corner in task.few_corners:
            for sign in (-1.0, 1.0):
                try:
                    yield _sweep(task, corner, tilt, down * task.size, sign)
                except SearchError:  # another corner, or yaw turned back the other way, may have room
                    continue


def _sweep(task: PressTask, corner: Corner, tilt: float, below: float, sign: float) -> Attempt:
    yaw, lean, u = _YAW * float(task.box[5]), corner.angle, direction(corner.angle)
    distance = corner_distance(task, corner, _DISTANCE)
    pose, descent, _ = corner_entry(task, corner, tilt, lean, distance, below, -sign * yaw)
    wrench = six(FORCE * u, -_KAPPA * FORCE)
    turning = (*wrench[:5], sign * FORCE * 0.5 * task.size)
    lower, _ = turn_upright(task, tilt - _SWEPT, lean, wrench, yaw=False)
    sweep = sweep_yaw(task, turning, 5.0 * yaw / SWEEP_SPEED + 1.0)
    presses = (
        come_down(descent + below), press_aside(task, u, _KAPPA), lower, sweep,
        *turn_upright(task, _SWEPT, lean, turning, yaw=True), *to_the_goal(task, u, _END, rocked=False),
    )  # fmt: skip
    attempt = Attempt(numbers(pose.vector()), presses, "yaw sweep")
    return touching_first(task, attempt, corner.at, corner.walls, below)
