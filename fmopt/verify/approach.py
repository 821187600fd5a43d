"""That a contact being made comes nearer, and one given up gets farther away, all along a piece, on every execution.

The distance of the one then has one zero on each execution's way, at which the execution stops, and progress can be
measured on that way. The distance of the other is zero when its move starts, and positive ever after.
"""

from __future__ import annotations

from fmopt.verify.linear import seen
from fmopt.verify.motion import Motion
from fmopt.verify.rational import SLACK, Row, length, over, row_dot, times
from fmopt.verify.remainder import size
from fmopt.verify.rows import Distance, Function


def approach(motion: Motion) -> int:
    """A lower bound, in fixed point, of how far the made contact comes nearer; positive: on every execution it does."""
    if motion.made is None:
        return 0
    start, goal = motion.ends(motion.made)
    nearer = min(-row_dot(goal.N, motion.motion), -row_dot(start.N, motion.motion))
    return nearer - _change(motion, motion.made) - SLACK


def departure(motion: Motion, function: Function) -> int:
    """A lower bound, in fixed point, of how much a row grows along the piece; positive: on every execution it does."""
    start, goal = motion.ends(function)
    farther = min(row_dot(goal.N, motion.motion), row_dot(start.N, motion.motion))
    return farther - _change(motion, function) - SLACK


def _change(motion: Motion, function: Function) -> int:
    """By how much a row may grow more or less along the piece than at the nominal poses of its ends.

    The row turns along the piece; the velocity error adds to the motion; and the held rows turn as well, so that the
    motion inside them changes (their share counted twice, which covers the second order). In a hole that is askew by h
    all motion is seen turned by it, and a part that is off by g in the hand swings by its turn across g.
    """
    start, goal = motion.ends(function)
    change = _turned(motion, start, goal) + times(motion.cone(seen(goal.N, motion.hold)), motion.length)
    for held, column in zip(motion.held, motion.held_dual, strict=True):
        change += 2 * times(abs(row_dot(goal.N, column)), _turned(motion, *motion.ends(held)))
    return change + _swung(motion, seen(goal.N, motion.hold))


def _swung(motion: Motion, N: Row) -> int:
    """How much a row grows more or less along the piece for errors that are fixed in the hole and in the hand."""
    if motion.linkage is None:
        return 0
    _, askew, off, _ = motion.linkage.sizes
    rate, turning = motion.task.rates
    slid = length(motion.motion[:3]) + times(rate, motion.length)
    spun = length(motion.motion[3:]) + times(over(turning, motion.task.rho), motion.length)
    for held, column in zip(motion.held, motion.held_dual, strict=True):
        given = 2 * _turned(motion, *motion.ends(held))
        slid, spun = slid + times(given, length(column[:3])), spun + times(given, length(column[3:]))
    return times(length(N[:3]), times(askew, slid) + times(off, spun)) + times(length(N[3:]), times(askew, spun)) + 8


def _turned(motion: Motion, start: Distance, goal: Distance) -> int:
    """A bound of how much a row's product with the motion differs between poses of the piece."""
    straight, round_ = length(motion.motion[:3]), length(motion.motion[3:])
    angle = motion.task.theta + motion.extent.turn
    change = times(angle, times(size(start, goal), round_))
    if start.bend is not None:
        change += times(angle, straight) + times(motion.extent.offset + length(motion.extent.travel), round_)
    return change
