"""What tells a robot that a new contact is made: forces on it, by how long they last and whether they slow the part."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fmopt.execution.robot import Robot
from fmopt.values import Array


class Signal(NamedTuple):
    """What n bodies feel.

    Args:
        sensed, slowly: means of the last force (n,) of the new contacts, N, over the robot's shorter and longer time.
        brisk, pace: means of the last speed (n,) along the motion over these times, as shares of the commanded one.
        effort: push (n,), in pushes of the plan.
    """

    sensed: Array
    slowly: Array
    brisk: Array
    pace: Array
    effort: Array


def contact_told(signal: Signal, force: Array, sure: Array, robot: Robot) -> NDArray[np.bool_]:
    """Which of n bodies' last samples speak of the new contact.

    A force that friction could not bring about does, if it slows the part or lasts: faces that rub rattle, which is as
    strong but over in some milliseconds, and a part that pivots about its new contact is hardly slowed. So does a
    smaller one that brakes the part, and a smaller one yet at which the part stands although the push has grown: a
    larger push would pry it off what it holds.

    Args:
        signal: what the bodies feel.
        force: (n,) from which on a force on a part that is braked counts, N.
        sure: (n,) more than all friction brings about, N.
        robot: by whose shares.
    """
    slowed = (signal.brisk <= robot.braked[0]) & (signal.sensed >= sure)
    lasting = signal.slowly >= robot.lasting * sure
    braked = (signal.pace <= robot.braked[1]) & (signal.slowly >= force)
    pushes, share = robot.stuck
    stands = (signal.pace <= robot.standing) & (signal.effort >= pushes) & (signal.slowly >= share * force)
    return np.asarray(slowed | lasting | braked | stands)
