"""Chamfers wider than the errors: straight down, the attitude held until the part stands, then all axes giving way."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from fmopt.plan.field_types import numbers
from fmopt.plan.press import Attempt
from fmopt.planning.press.entry import lowest_height, support
from fmopt.planning.press.library import AXIAL, XYZ_YAW, come_down, direction, press_on, to_the_goal
from fmopt.planning.press.task import PressTask
from fmopt.spatial.se3 import Pose

_CHAMFERED = 0.02  # of the size, by which the mouth is wider than the tip all around where there is a chamfer


def straight_presses(task: PressTask) -> Iterator[Attempt]:
    """The attempt that goes straight in, where the mouth holds the tip for every start error or has a chamfer."""
    from shapely import MultiPoint

    tips = (task.goal.R @ task.tip.T).T
    room = float(MultiPoint((tips + task.goal.p)[:, :2]).convex_hull.distance(task.mouth.exterior))
    off = max(support(task, direction(angle), tip) for tip in tips for angle in np.linspace(0.0, np.pi, 8))
    if room < min(off, _CHAMFERED * task.size):
        return
    height = lowest_height(task, task.goal.R, task.tip[0])
    pose = Pose(np.append(task.goal.p[:2], height - float(task.tip[0, 2])), task.goal.R)
    # A funnel turns a part whose attitude gives way, the more the longer it is.
    held = () if task.keeps_attitude or task.round else (press_on(task, XYZ_YAW, (0.0, 0.0, -AXIAL, 0.0, 0.0, 0.0)),)
    for end in (0.0, 0.05):
        presses = come_down(height), *held, *to_the_goal(task, direction(0.0), end, task.round)
        yield Attempt(numbers(pose.vector()), presses, "straight")
