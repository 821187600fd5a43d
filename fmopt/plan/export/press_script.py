"""A plan of presses as a URScript program: `force_mode` in each step of a press, until one of its ends is reached.

The program measures poses and forces in the frame of the hole as the base knows it. `presses.script` has its functions.
"""

import math
from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from fmopt.plan import Plan
from fmopt.plan.export.urscript import ProgramSettings, heading, in_axes_of, list_of, number, of_tcp, pose_of, templates
from fmopt.plan.press import Force, Level, Next, Press, PressPlan, Standstill, Time, Travel
from fmopt.runtime.escape import one_line
from fmopt.spatial.se3 import Pose, exp, log
from fmopt.spatial.values import Array

_STILL = list_of(np.zeros(6))
_CODES: dict[Next, int] = {"next": 1, "seated": 2, "retry": 3, "fail": 4}
_NEVER = 1000.0  # m, rad, N, s: what no end comes to
DEVIATION = (0.01, 0.2)  # m and rad, limits on stiff axes
_BEND = 5e-4  # m, by which the part's origin is beside a straight line between two attempts
_TRAIL = 100  # poses along which the part goes back


def program(plan: Plan, presses: PressPlan, base: Pose, caution: str = "nothing is proved of presses") -> str:
    """The program as text, with the hole's frame B in the robot's base and what is to be said of the plan.

    Raises:
        PlanFormatError: a number is not finite.
    """
    whole, attempt, again = templates("presses.script")
    settings, robot, body = ProgramSettings(), presses.robot, plan.moving.body
    fans = [(loop[0], a, b) for loops in body.faces for loop in loops for a, b in pairwise(loop[1:])]
    corners = np.array(body.vertices)[fans]
    volumes = np.linalg.det(corners) / 6.0
    centroid = volumes @ corners.sum(axis=1) / (4.0 * volumes.sum())
    tcp, attempts, tries = Pose.from_vector(plan.description.tcp), list[str](), list[str]()
    first = base.compose(Pose.from_vector(presses.attempts[0].start)).compose(tcp)
    for k, one in enumerate(presses.attempts):
        calls = "\n".join(f"  {line}" for press in one.presses for line in _press(press, base))
        attempts.append(attempt.format(number=k + 1, source=one_line(one.source), still=_STILL, presses=calls))
        poses = (pose_of(base.compose(one).compose(tcp)) for one in over(presses, k, tcp))
        tries += [f"  movel({pose}, fmopt_acceleration, fmopt_speed_back, 0, 0)\n" for pose in poses]
        tries.append(again.format(number=k + 1))
    said = {
        **heading(plan, base, f"WARNING: {caution}."),
        "volume": f"{1e9 * volumes.sum():.6g}",
        "centroid": list_of(tcp.inverse().apply(centroid)),
        "of_tcp": of_tcp(plan),
        "into_hole": pose_of(base.inverse()),
        "still": _STILL,
        "start": pose_of(first),
        "trail": ", ".join([f"p{_STILL}"] * _TRAIL),
    }
    sizes = ("reach", "damping", "gain", "acceleration", "acceleration_angular")
    numbers = {name: number(getattr(settings, name)) for name in sizes}
    numbers |= {"arm": number(robot.arm), "back": number(robot.back[0])}
    return whole.format(attempts="\n".join(attempts), tries="".join(tries), **said, **numbers)


def _press(press: Press, base: Pose) -> Iterator[str]:
    """The call of a press, and what returns from the attempt where no other press follows."""
    selection = [int(gives) for gives in press.gives]
    limits = np.where(press.gives, press.speed, np.repeat(DEVIATION, 3))
    rocking = press.rocking
    given = (
        str(selection),
        list_of(np.where(press.gives, press.wrench, 0.0)),
        number(max(press.ramp, 1e-3)),
        list_of(in_axes_of(base, np.where(press.gives, 0.0, press.twist))),
        list_of(limits),
        list_of(press.reach),
        "p" + list_of([*press.reference, 0.0, 0.0, 0.0]),
        list_of([0.0] * 3 if rocking is None else [rocking.angle, rocking.rate, rocking.seconds]),
        list_of(_ends(press)),
    )
    yield f"# {one_line(press.name)}"
    if not press.keeps:
        yield "end_force_mode()"  # stiff axes go on from where they are
    yield f"code = fmopt_press({', '.join(given)})"
    yield from ("if code > 1:", "  return code", "end")


def _ends(press: Press) -> Array:
    ends = np.array([-_NEVER, 1, _NEVER, 1, _NEVER, 1, _NEVER, 1, _NEVER, 3, 0.0, _NEVER, _NEVER, _NEVER, 1, 1])
    for end in press.ends:
        match end:
            case Level():
                ends[:2] = end.z, _CODES[end.then]
            case Travel():
                turning = float(np.linalg.norm(press.twist[3:]))
                angle = _NEVER if end.angle is None or turning == 0.0 else end.angle / turning
                ends[2:6] = end.distance or _NEVER, _CODES[end.then], angle, _CODES[end.then]
            case Force():
                ends[6:8] = end.force, _CODES[end.then]
            case Time():
                ends[8:10] = end.seconds, _CODES[end.then]
            case Standstill():
                ends[10:14] = end.displacement, end.window, end.armed, _NEVER if end.below is None else end.below
                ends[14:] = _CODES[end.then], _CODES[end.else_then]
    return ends


def over(presses: PressPlan, following: int, tcp: Pose) -> Iterator[Pose]:
    """From the start of an attempt up, across, and down to that of the following one; to the first as it is.

    Across in so many steps that the part's origin goes straight, too, where the tool's centre point is far from it.
    """
    if following == 0:
        yield Pose.from_vector(presses.attempts[0].start)
        return
    one, other = (Pose.from_vector(presses.attempts[k].start) for k in (following - 1, following))
    high = max(presses.clear, float(one.p[2]), float(other.p[2]))
    up, across = (Pose(np.array([*pose.p[:2], high]), pose.R) for pose in (one, other))
    turn = log(up.R.T @ across.R)
    # A chord of the arc that a turn by θ takes the point on lies r θ²/8 off it.
    bend = float(np.linalg.norm(tcp.p) * (turn @ turn)) / (8.0 * _BEND)
    for share in np.linspace(0.0, 1.0, max(math.ceil(math.sqrt(bend)), 1) + 1):
        yield Pose(up.p + share * (across.p - up.p), up.R @ exp(share * turn))
    yield other
