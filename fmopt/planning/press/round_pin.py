"""Round parts: tilted, pressed forward and down to three contacts, turned upright, rocked, pressed down."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from fmopt.plan.field_types import numbers
from fmopt.plan.press import Attempt
from fmopt.planning.press.entry import attitude, low_vertex, lowest_height
from fmopt.planning.press.library import CornerPress, come_down, direction, into_the_mouth
from fmopt.planning.press.task import PressTask
from fmopt.planning.press.touch_top import touching_first
from fmopt.spatial.se3 import Pose

_DIRECTIONS = (0.0, 2.0 * math.pi / 3.0, 4.0 * math.pi / 3.0)
_SHORT = 0.5  # depth over size, below which a part that is tilted far has its other side on the block
_NUMBERS = (
    CornerPress(math.radians(19.0), 2.5, 0.2, 1.1, 0.43, 0.2, False, 0.05, rock=True),
    CornerPress(math.radians(12.0), 2.5, 0.12, 1.1, 0.43, 0.2, False, 0.05, rock=True),
    CornerPress(math.radians(8.0), 2.5, 0.08, 1.1, 0.43, 0.2, False, 0.05, rock=True),
)


def is_short(task: PressTask) -> bool:
    """Whether a round part is no longer than half its diameter."""
    return task.depth <= _SHORT * task.size


def round_presses(task: PressTask) -> Iterator[Attempt]:
    """Attempts for a round part in a round hole; none for any other."""
    if not task.round:
        return
    rim = np.array(task.mouth.exterior.coords)
    for angle in _DIRECTIONS:
        u = direction(angle)
        edge = rim[int(np.argmax(rim @ u[:2]))]
        for chosen in _NUMBERS[2:] if is_short(task) else _NUMBERS:
            R = attitude(angle, chosen.tilt) @ task.goal.R
            tip = low_vertex(task, R, u[:2])
            seat = task.goal.R @ tip + task.goal.p
            place = (seat - min(chosen.distance * task.lateral, 0.5 * task.size) * u)[:2]
            height = lowest_height(task, R, tip)
            pose = Pose(np.append(place, height) - R @ tip, R)
            below = chosen.down * task.size
            presses = come_down(height + below), *into_the_mouth(task, u, angle, chosen)
            yield touching_first(task, Attempt(numbers(pose.vector()), presses, "round"), edge, u[None, :2], below)
