"""Narrow mouths, of less than four errors: come down beside one, leaning along it, and slide over until a drop."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from fmopt.plan.field_types import numbers
from fmopt.plan.press import Attempt, Force, Press, Time, Travel
from fmopt.planning.press.entry import attitude, low_vertex, lowest_height
from fmopt.planning.press.library import COME_DOWN, ONLY_Z, XYZ_YAW, CornerPress, come_down, direction, into_the_mouth
from fmopt.planning.press.task import PressTask
from fmopt.spatial.se3 import Pose

_NARROW = 4.0  # errors across the mouth, of its ends with their turn; a wider mouth is entered at once
_LOWER = 1.5  # errors of tilt, by which the side that leads is lower: it drops as soon as it is over the mouth
_SPEED = 0.004  # m/s
_DROP = 1e-4  # m
_TOUCH = 8.0  # N on held axes
_ALONG, _BESIDE = 1.9, 1.3  # lateral errors that the tip keeps from its seat along the mouth, and beside it
_NUMBERS = (
    CornerPress(math.radians(8.0), 0.0, 0.06, 0.39, 0.89, 0.90, True, 0.12),
    CornerPress(math.radians(5.0), 0.0, 0.06, 0.39, 0.89, 0.90, True, 0.12),
    CornerPress(math.radians(8.0), 0.0, 0.03, 0.60, 0.60, 0.60, True, 0.12),
)


def crossings(task: PressTask) -> Iterator[Attempt]:
    """Attempts that cross a narrow mouth, from either end of it; none where it is wide."""
    if task.width >= _NARROW * (task.lateral + 0.5 * task.size * float(task.box[5])):
        return
    for lean in (task.long_axis, task.long_axis + math.pi):
        for chosen in _NUMBERS:
            yield _crossing(task, lean, chosen)


def _crossing(task: PressTask, lean: float, chosen: CornerPress) -> Attempt:
    along, across = direction(lean), direction(lean + 0.5 * math.pi)
    roll = _LOWER * float(task.box[3:5].max())
    low_side = lean + math.atan2(roll, chosen.tilt)
    R = attitude(low_side, chosen.tilt) @ task.goal.R
    tips = task.tip @ R.T
    low = tips[:, 2] <= tips[:, 2].min() + 0.02 * task.size * math.sin(chosen.tilt) + 2.0 * roll * task.width
    middle = task.tip[low].mean(axis=0)
    seat = task.goal.R @ middle + task.goal.p
    place = (seat - _ALONG * task.lateral * along - _BESIDE * task.lateral * across)[:2]
    height = lowest_height(task, R, low_vertex(task, R, along[:2]))
    pose = Pose(np.append(place, height) - R @ middle, R)
    beside = come_down(height + chosen.down * task.size)
    way = 2.6 * _BESIDE * task.lateral + 0.3 * task.size
    slide = Press(
        "cross the mouth", ONLY_Z, (*(_SPEED * across).tolist(), 0.0, 0.0, 0.0),
        (0.0, 0.0, -COME_DOWN[0], 0.0, 0.0, 0.0),
        (0.02, 0.02, 0.02, 1.0, 1.0, 1.0), (0.02, 1.0),
        (Travel(distance=_DROP), Force(_TOUCH), Time(way / _SPEED, "retry")),
    )  # fmt: skip
    u = direction(lean + 0.25 * math.pi)
    # Yaw gives way: in a narrow mouth its error would wedge the part before it is at the end.
    pressed = into_the_mouth(task, u, low_side, chosen, XYZ_YAW)
    return Attempt(numbers(pose.vector()), (beside, slide, *pressed), "crossing")
