"""That a contact being made comes nearer all along a piece of motion, on every execution.

Its distance then has one zero on each execution's way, at which the execution stops, and progress can be measured on
that way.
"""

from __future__ import annotations

from fmopt.verify.linear import seen
from fmopt.verify.motion import Motion
from fmopt.verify.rational import SLACK, length, row_dot, times
from fmopt.verify.rows import Distance


def approach(motion: Motion) -> int:
    """A lower bound, in fixed point, of how fast the made contact comes nearer; positive: on every execution it does.

    The row turns along the piece; the velocity error adds to the motion; and the held rows turn as well, so that the
    motion inside them changes (their share counted twice, which covers the second order).
    """
    if motion.made_rows is None:
        return 0
    start, goal = motion.made_rows
    change = _turned(motion, start, goal) + times(motion.cone(seen(goal.N, motion.hold)), motion.length)
    for s, g, column in zip(motion.held_start, motion.held_goal, motion.held_dual, strict=True):
        change += 2 * times(abs(row_dot(goal.N, column)), _turned(motion, s, g))
    return min(-row_dot(goal.N, motion.motion), -row_dot(start.N, motion.motion)) - change - SLACK


def _turned(motion: Motion, start: Distance, goal: Distance) -> int:
    """A bound of how much a row's product with the motion differs between poses of the piece."""
    straight, round_ = length(motion.motion[:3]), length(motion.motion[3:])
    angle = motion.task.theta + motion.extent.turn
    change = times(angle, times(max(start.reach, goal.reach) + max(start.swing, goal.swing), round_))
    if start.bilinear:
        change += times(angle, straight) + times(length(motion.task.box) + length(motion.extent.travel), round_)
    return change
