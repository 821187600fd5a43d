"""Heights unknown by more than the tip goes into the mouth: touch the top beside it, lift, and come down from there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fmopt.plan.field_types import numbers
from fmopt.plan.press import Attempt, Press, Time
from fmopt.planning.press.entry import low_vertex, support
from fmopt.planning.press.library import DELAY, LATERAL_SPEED, SPEEDS, come_down
from fmopt.planning.press.task import PressTask
from fmopt.spatial.se3 import Pose
from fmopt.spatial.values import Array

_UNKNOWN = 1.4  # times the depth of the tip below the mouth, from which the error of its height counts
_OUTSIDE = 1.3  # times its support that the tip keeps outside of the corner's walls
_LIFT, _LEAST_LIFT = 0.03, 5e-4  # of the size, and m
_UP = np.array([0.0, 0.0, 1.0])


def touching_first(task: PressTask, attempt: Attempt, at: Array, walls: Array, below: float) -> Attempt:
    """The attempt by way of the top beside the mouth; as it is where the height is known or there is no top.

    The tip comes down beside walls with unit normals (k, 2) outwards, `at` a place (2,) on them, m; the first press
    leads it so far `below` the mouth, m.
    """
    from shapely import Point

    pose, u = Pose.from_vector(attempt.start), np.append(walls.sum(axis=0), 0.0)
    u /= np.linalg.norm(u)
    arm = pose.R @ low_vertex(task, pose.R, u[:2])
    if support(task, _UP, arm) < _UNKNOWN * below:
        return attempt
    place, lift = (pose.p + arm)[:2], max(_LIFT * task.size, _LEAST_LIFT)
    outside = [_OUTSIDE * support(task, np.append(wall, 0.0), arm) for wall in walls]
    way = float(np.max(((at - place) @ walls.T + outside) / (walls @ u[:2])))
    reach = max(support(task, direction, arm) for direction in (u, np.cross(_UP, u)))
    if not task.top.contains(Point(place + way * u[:2]).buffer(reach)):
        return attempt
    down = come_down(2.0 * float((pose.p + arm)[2]))
    touch = replace(down, name="touch the top", ends=down.ends[1:])
    over = _led("lift", lift * _UP), _led("go over the mouth", -way * u), come_down(lift + below)
    beside = Pose(pose.p + way * u, pose.R)
    return replace(attempt, start=numbers(beside.vector()), presses=(touch, *over, *attempt.presses[1:]))


def _led(name: str, way: Array) -> Press:
    """A way (3,), m, with all axes held; the next press begins where the part is measured, which is a delay ago."""
    seconds = float(np.linalg.norm(way)) / LATERAL_SPEED
    twist = numbers(np.append(way / seconds, np.zeros(3)))
    return Press(name, (False,) * 6, twist, (0.0,) * 6, SPEEDS, (1.0, 1.0), (Time(seconds + DELAY, "next"),))
