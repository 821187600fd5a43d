"""A plan as a URScript program: one `force_mode` call for each segment, and a guarded move while it holds.

`force_mode(task_frame, selection_vector, wrench, type, limits)` takes the task frame as a pose in the base, 1 in the
selection vector for a compliant axis, the wrench that the robot applies to its environment in the task frame, type 2
for a frame that stays as it is, and limits: the greatest speed on compliant axes, the greatest deviation from the
programmed motion on stiff ones. `get_tcp_force` returns the reaction on the tool in axes of the base.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from fmopt.export.frame import TaskFrame, task_frame
from fmopt.guarded.moves import Move, moves
from fmopt.se3 import Pose
from fmopt.values import Array

_HEADER = """\
# {title}
# Plan {digest}, verdict {verdict}, written by fmopt {version}
#
# Units: m, rad, N, N m, s. Poses p[x, y, z, rx, ry, rz] are in the robot's base, the rotation as a rotation vector.
# The TCP has to be the moving part's frame: {moving}.
# The frame of the hole ({hole}) is at {base} in the base.
# Selection: 1 compliant, 0 stiff. Wrenches of force_mode are what the robot applies to its environment.
# get_tcp_force is taken as the reaction of the environment on the tool, in axes of the base, torque about the TCP.
# Limits: m/s and rad/s on compliant axes, m and rad of deviation on stiff ones.
"""

_FUNCTIONS = """\
def fmopt_leave(reason):
  stopl({stop}, {stop_angular})
  end_force_mode()
  textmsg("fmopt: ", reason)
  halt
end

def fmopt_extra(held):
  local w = get_tcp_force()
  return [w[0] + held[0], w[1] + held[1], w[2] + held[2], w[3] + held[3], w[4] + held[4], w[5] + held[5]]
end

def fmopt_guarded(twist, gain, force, held, travel, timeout):
  local step = get_steptime()
  local elapsed = 0.0
  local felt = 0
  local still = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
  while elapsed < timeout:
    if elapsed < travel:
      speedl(twist, {acceleration}, step, {acceleration_angular})
    else:
      speedl(still, {acceleration}, step, {acceleration_angular})
    end
    elapsed = elapsed + step
    local w = get_tcp_force()
    local k = held[0] + (held[1] - held[0]) * elapsed / travel
    if elapsed >= travel:
      k = held[1]
    end
    k = k + gain[0] * (w[0] - tare[0]) + gain[1] * (w[1] - tare[1]) + gain[2] * (w[2] - tare[2])
    k = k + gain[3] * (w[3] - tare[3]) + gain[4] * (w[4] - tare[4]) + gain[5] * (w[5] - tare[5])
    if k >= force:
      felt = felt + 1
    else:
      felt = 0
    end
    if felt >= {debounce}:
      stopl({stop}, {stop_angular})
      return True
    end
  end
  return False
end

def fmopt_move(twist, travel):
  local step = get_steptime()
  local elapsed = 0.0
  while elapsed < travel:
    speedl(twist, {acceleration}, step, {acceleration_angular})
    elapsed = elapsed + step
  end
end
"""


@dataclass(frozen=True)
class Settings:
    """What the program states explicitly and the plan does not know.

    Args:
        damping: of force mode, 0 to 1.
        gain: scaling of force mode's gain, 0 to 2.
        acceleration, acceleration_angular: of the moves, m/s² and rad/s².
        stop, stop_angular: decelerations at a stop, m/s² and rad/s².
        debounce: samples in a row above the force that ends a guarded move.
        settling: s in which the held contacts settle before a move starts and the sensor's reading is noted.
        reach: greatest distance from the start pose at which the program may begin, m.
        compliant_speed: limit on compliant axes, in speeds of the plan.
    """

    damping: float = 0.1
    gain: float = 0.5
    acceleration: float = 1.2
    acceleration_angular: float = 60.0
    stop: float = 5.0
    stop_angular: float = 250.0
    debounce: int = 3
    settling: float = 0.15
    reach: float = 0.02
    compliant_speed: float = 5.0


def program(document: Mapping[str, Any], base: Pose, settings: Settings | None = None) -> str:
    """The program as text.

    Args:
        document: plan.
        base: pose of the hole's frame B in the robot's base.
        settings: what the plan does not know; none for the defaults.

    Raises:
        PlanFormatError: a segment cannot be run, or its force axes are not orthogonal in any one frame.
    """
    settings = settings or Settings()
    rho, speed = float(document["uncertainty"]["rho"]), float(document["specification"]["speed"])
    rows = moves(document)
    lines = [_head(document, base), _functions(settings), "def fmopt_insert():"]
    lines += _indented(_beginning(base.compose(rows[0].start), speed, settings))
    for move, before in zip(rows, [None, *rows], strict=False):
        first = before is None or before.last
        lines += _indented(_segment(move, first, task_frame(move, rho), base, rho, settings))
    lines += _indented(["end_force_mode()", 'textmsg("fmopt: ", "seated")'])
    return "\n".join([*lines, "end", "", "fmopt_insert()", ""])


def _head(document: Mapping[str, Any], base: Pose) -> str:
    return _HEADER.format(
        title=" ".join(str(document["problem"]["title"]).split()),
        digest=document["sha256"],
        verdict=document["verdict"],
        version=document["fmopt_version"],
        moving=document["frames"]["moving"],
        hole=document["frames"]["B"],
        base=_pose(base),
    )


def _functions(settings: Settings) -> str:
    names = ("acceleration", "acceleration_angular", "stop", "stop_angular")
    return _FUNCTIONS.format(debounce=settings.debounce, **{name: _number(getattr(settings, name)) for name in names})


def _beginning(start: Pose, speed: float, settings: Settings) -> list[str]:
    pose = _pose(start)
    return [
        f"if point_dist(get_actual_tcp_pose(), {pose}) > {_number(settings.reach)}:",
        f'  textmsg("fmopt: ", "bring the part to within {_number(settings.reach)} m of {pose} first")',
        "  halt",
        "end",
        f"movel({pose}, {_number(settings.acceleration)}, {_number(speed)}, 0, 0)",
        "sleep(0.5)",
        "zero_ftsensor()",
        f"force_mode_set_damping({_number(settings.damping)})",
        f"force_mode_set_gain_scaling({_number(settings.gain)})",
        "global touched = False",
        "global tare = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0]",
    ]


def _segment(move: Move, first: bool, task: TaskFrame, base: Pose, rho: float, settings: Settings) -> list[str]:
    """A move's pieces follow each other without a stop; once the contact that ends it is felt, the rest is left out."""
    lines = [f"# segment {move.segment}, move {move.number}, held: {', '.join(move.state) or 'nothing'}"]
    call = _force_mode(move, task, base, rho, settings)
    twist = _turned(base, move.twist)
    if move.stop is None:
        return [*lines, call, f"fmopt_move({_list(twist)}, {_number(move.duration)})"]
    gain, held = _turned(base, move.stop.gain), _turned(base, move.hold_start)
    speed = _speed(move, rho)
    expected = move.stop.gain @ np.column_stack([move.hold_start, move.hold])
    travel, timeout = (move.stop.max_travel / speed, move.stop.timeout) if move.last else (move.duration,) * 2
    guarded = [
        call,
        *([f"sleep({_number(settings.settling)})", f"tare = fmopt_extra({_list(held)})"] if first else []),
        f"touched = fmopt_guarded({_list(twist)}, {_list(gain)}, {_number(move.stop.force)}, {_list(expected)}, "
        f"{_number(travel)}, {_number(timeout)})",
    ]
    lines += ["if not touched:", *("  " + line for line in guarded), "end"]
    if move.last:
        missed = f"segment {move.segment}: {', '.join(move.stop.contacts)} not felt"
        lines += ["if not touched:", f'  fmopt_leave("{missed}")', "end", "touched = False"]
    return lines


def _turned(base: Pose, six: Array) -> Array:
    """A twist or wrench (6,) in axes of B, in axes of the base."""
    return np.concatenate([base.R @ six[:3], base.R @ six[3:]])


def _speed(move: Move, rho: float) -> float:
    """m/s in the metric of ρ."""
    return float(np.linalg.norm(move.twist * np.array([1.0, 1.0, 1.0, rho, rho, rho])))


def _force_mode(move: Move, task: TaskFrame, base: Pose, rho: float, settings: Settings) -> str:
    scale = np.array([1.0, 1.0, 1.0, rho, rho, rho])
    speed = _speed(move, rho)
    deviation = speed * (move.stop.timeout if move.stop else 2.0 * move.duration)
    sizes = np.where(np.array(task.selection) == 1, settings.compliant_speed * speed, deviation) / scale
    selection = ", ".join(str(value) for value in task.selection)
    return f"force_mode({_pose(base.compose(task.pose))}, [{selection}], {_list(task.wrench)}, 2, {_list(sizes)})"


def _indented(lines: Sequence[str]) -> Iterable[str]:
    return ["  " + line for line in lines]


def _number(value: float) -> str:
    """Fixed point, a picometre fine: the language has no exponents."""
    text = f"{value:.12f}".rstrip("0")
    return "0.0" if text in ("-0.", "0.") else text + "0" * text.endswith(".")


def _list(values: Array) -> str:
    return "[" + ", ".join(_number(float(value)) for value in values) + "]"


def _pose(pose: Pose) -> str:
    return "p" + _list(pose.vector())
