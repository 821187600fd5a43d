"""What the hand does: the motion of what is grasped, and the wrenches on it, from a plan of operand 1 in operand 2.

Where the hollow part is in the hand the plan moves the peg in the frame of the hole all the same, and the hand makes
the counterpart of that motion. Where the task gives the grasp transform H_ho the poses are those of the hand itself.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from fmopt.knowledge.command import Answer
from fmopt.knowledge.counterpart import grasped_pose, grasped_twist, grasped_wrench
from fmopt.se3 import Pose
from fmopt.values import Array


def hand_record(found: Answer, segments: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """The motion of the hand as plain data, in the frame of the feature that stays; nothing where that is the plan's.

    Args:
        found: the task, answered.
        segments: of the plan, with `start`, `goal` and `hybrid`.

    Returns:
        Names of both features, and for each segment poses (6,) of the hand at its ends, the twist (6,) of the grasped
        feature at the goal about its origin (m/s, rad/s), and the bias wrench (6,) on it about that origin (N, N·m).
    """
    task = found.task
    if not (found.exchanged or task.grasp.vector().any()):
        return {}
    made = [_move(found, segment) for segment in segments]
    names = {"grasped": str(task.moving), "standing": str(task.fixed), "exchanged": found.exchanged}
    return {"hand": {**names, "segments": made}}


def _move(found: Answer, segment: Mapping[str, Any]) -> dict[str, Any]:
    goal, hybrid = segment["goal"], segment["hybrid"]
    velocity = hybrid["speed"] * np.asarray(hybrid["velocity"], dtype=np.float64)
    return {
        "start": _held(found, segment["start"]).vector(),
        "goal": _held(found, goal).vector(),
        "velocity": grasped_twist(found, goal, velocity),
        "bias_wrench": grasped_wrench(found, goal, hybrid["bias_wrench"]),
    }


def _held(found: Answer, X: Array) -> Pose:
    """Pose of the hand in the frame of the feature that stays."""
    return grasped_pose(found, X).compose(found.task.grasp.inverse())
