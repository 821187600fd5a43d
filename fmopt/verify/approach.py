"""That a contact being made comes nearer all along a piece of motion, on every execution.

Its distance then has one zero on each execution's way, at which the execution stops, and progress can be measured on
that way.
"""

from __future__ import annotations

from fmopt.verify.linear import seen
from fmopt.verify.motion import Motion
from fmopt.verify.rational import SLACK, length, row_dot, sub, times
from fmopt.verify.rows import Distance, direction_along


def approach(motion: Motion) -> int:
    """A lower bound, in fixed point, of how fast the made contact comes nearer; positive: on every execution it does.

    When the made contact will turn a held edge contact into a hinge, its vertex's height over the wall is −λ times
    the hinge row as long as that edge is held, λ > 0 the way from the vertex to the crossing: the hinge row may show
    the approach instead.
    """
    task = motion.task
    if motion.made_rows is None or task.made is None:
        return 0
    rates = [_falls(motion, *motion.made_rows)]
    for touch in motion.contacts:
        hinge = motion.assembly.hinge(touch, [task.made])
        if hinge is not None and motion.assembly.hinge(touch, task.state) is None:
            k = sub(hinge[1], hinge[2])
            start, goal = (direction_along(X, hinge[0].normal, k, length(k)) for X in (task.start, task.goal))
            rates.append(_falls(motion, start, goal))
    return max(rates)


def _falls(motion: Motion, start: Distance, goal: Distance) -> int:
    """A lower bound of how fast a row falls along the motion.

    The row turns along the piece; the velocity error adds to the motion; and the held rows turn as well, so that the
    motion inside them changes (their share counted twice, which covers the second order).
    """
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
