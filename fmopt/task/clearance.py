"""The clearance of a problem as measured on its parts, held against the declared one."""

from __future__ import annotations

import math

import numpy as np

from fmopt.errors import GeometryError
from fmopt.geometry.clearance import Clearance, checked_clearance
from fmopt.se3 import Pose
from fmopt.task.problem import Problem
from fmopt.values import Array

LEAST_LEVER = 2.0**-10  # m: what the check of a plan takes
_FAR = 10.0  # times the declared clearance: no tolerance, but another part or another unit


def measured_clearance(problem: Problem) -> Clearance:
    """The clearance as measured on the parts, m.

    Raises:
        InterferenceError: the parts overlap when assembled, or their clearance is not positive.
        GeometryError: along x or y it is not of the size that the problem declares.
    """
    seated = Pose.from_vector(problem.goal)
    found = checked_clearance(problem.moving, problem.fixed, seated, -float(problem.goal[2]))
    for axis, declared, play in zip("xy", problem.declared_clearance, found.play, strict=True):
        side = 0.5 * play
        if declared > 0.0 and math.isfinite(side) and not declared / _FAR <= side <= declared * _FAR:
            raise GeometryError(
                f"along {axis} the parts leave {1e3 * side:.6g} mm a side, where [clearance] declares "
                f"{1e3 * declared:.6g} mm",
                "check the units of the model files, [mesh] unit among them, and which features are to mate; or "
                "correct [clearance]",
            )
    return found


def characteristic_length(problem: Problem, clearance: Clearance) -> float:
    """The length ρ that weighs angles against lengths, m: stated, or half the diagonal of the mating section.

    Of a small section, the least that the check of a plan takes.
    """
    return problem.settings.characteristic_length or max(clearance.half_diagonal, LEAST_LEVER)


def drift(problem: Problem, clearance: Clearance) -> Array:
    """How far velocity errors carry the part at most on its way down to the mouth (6,), m and rad.

    Zero where that is a clearance or less, next to which it does not count.
    """
    t, r = problem.velocity_error.translation, problem.velocity_error.rotation
    if problem.approach * max(t, r) <= clearance.per_side:
        return np.zeros(6)
    return problem.approach * np.array([t, t, t, *[r / characteristic_length(problem, clearance)] * 3])
