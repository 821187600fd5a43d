"""What to know before a robot runs a plan: whether base and rate can be meant, which way is in, how fast it turns."""

import math
from collections.abc import Sequence

import numpy as np

from fmopt.errors import PlanFormatError
from fmopt.plan import Plan
from fmopt.spatial.se3 import Pose
from fmopt.spatial.values import Array

_FARTHEST = 10.0  # m; no robot that inserts parts reaches as far
_MOST = 1e6  # samples in one file
_UPRIGHT = math.cos(math.radians(30.0))  # least |z| of a unit direction that counts as vertical


def check_rate(rate: float, seconds: float) -> None:
    """Refuses a rate, Hz, that is not positive or gives more samples of a motion than a file should hold.

    Raises:
        PlanFormatError: it is such a rate.
    """
    # Put so that NaN is refused as well, here and below.
    if not 0.0 < rate < math.inf:
        raise PlanFormatError(f"{rate:g} samples a second are none", "give a positive --rate, in Hz")
    if rate * seconds > _MOST:
        count = f"{rate:g} samples a second of a motion of {seconds:.3g} s are {rate * seconds:.3g}"
        raise PlanFormatError(f"{count}, more than {_MOST:.0e}", f"give a --rate of at most {_MOST / seconds:.3g} Hz")


def base_pose(base: Sequence[float]) -> Pose:
    """The pose of the hole's frame in the robot's base from six numbers, m and rotation vector in rad.

    Raises:
        ValueError: the position is more than 10 m away, the rotation vector longer than 2π, or a number not finite.
    """
    away, turn = math.hypot(*base[:3]), math.hypot(*base[3:])
    if not away <= _FARTHEST:
        raise ValueError(f"the position of --base is {away:.6g} m away: give metres, not millimetres, at most 10 m")
    if not turn <= math.tau:
        raise ValueError(
            f"the rotation vector of --base is {turn:.6g} rad long: give an axis times its angle in rad, not degrees, "
            "at most 6.28 (2π)"
        )
    return Pose.from_vector(base)


def insertion_words(base: Pose) -> str:
    """Which way the part goes in, the base's z pointing up; z of the hole's frame points out of the hole."""
    x, y, z = (-base.R[:, 2]).tolist()
    way = "down" if z <= -_UPRIGHT else "up" if z >= _UPRIGHT else "sideways"
    along = ", ".join(f"{round(value, 3) + 0.0:g}" for value in (x, y, z))  # + 0.0: no minus zero
    return f"insertion goes {way} in the base frame, along [{along}]"


def turning_words(twists: Sequence[Array], numbers: Sequence[int]) -> str:
    """The greatest rate at which a program turns the part, by twists (6,), rad/s in the last three, and where."""
    rates = [float(np.linalg.norm(twist[3:])) for twist in twists]
    fastest = int(np.argmax(rates))
    return (
        f"the part turns with up to {rates[fastest]:.3g} rad/s ({math.degrees(rates[fastest]):.0f} deg/s), "
        f"in move {numbers[fastest] + 1}: check that the robot may"
    )


def failing_words(plan: Plan, base: Pose) -> str:
    """What may be done when a move fails, as the plan says it, for B in the robot's base; nothing where it does not."""
    if plan.recovery is None or plan.recovery.lift is None:
        return ""
    up = ", ".join(f"{round(value, 3) + 0.0:g}" for value in base.R[:, 2].tolist())
    return (
        f"when a move fails the part may be lifted along [{up}] in the base while its lowest point is above "
        f"z = {round(plan.recovery.lift.above, 6) + 0.0:g} m in the frame of the hole"
    )
