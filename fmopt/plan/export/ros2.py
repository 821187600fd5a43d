"""A plan of guarded moves for ROS 2: its segments, with the force-mode request and the stop of each, and parameters.

`segments.yaml` has, for each segment, start and goal of the moving frame and the wrenches that the controller applies
there, in the robot's base, which axes are stiff, a request for `ur_msgs/srv/SetForceMode`, and when the move ends.
`controllers.yaml` has the parameters of the Cartesian compliance controller.
"""

import json
from collections.abc import Mapping, Sequence
from itertools import accumulate
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from fmopt.errors import PlanFormatError
from fmopt.plan import Plan
from fmopt.plan.export.cautions import insertion_words, turning_words
from fmopt.plan.export.frame import TaskFrame, task_frame
from fmopt.plan.export.urscript import in_axes_of
from fmopt.plan.guarded_moves import PlanMove, moves
from fmopt.plan.position_force import AXES
from fmopt.runtime import output
from fmopt.runtime.escape import one_line
from fmopt.spatial.se3 import Pose
from fmopt.spatial.values import Array

CONTROLLER = "cartesian_compliance_controller"
BASE_LINK, TOOL_LINK, SENSOR_LINK = "base_link", "moving_part", "ft_sensor_link"
AXIS_NAMES = ("trans_x", "trans_y", "trans_z", "rot_x", "rot_y", "rot_z")
UPDATE_RATE, ERROR_SCALE = 500, 0.5  # Hz of the controller, and what it scales its net force by
_GAINS = {name: {"p": 0.05 if k < 3 else 1.5, "d": 0.005 if k < 3 else 0.0} for k, name in enumerate(AXIS_NAMES)}
_STIFF = (20000.0, 200.0)  # N/m and N·m/rad of a stiff axis
_LEAST = 0.002  # m in the metric of ρ, limit of deviation at least: short moves begin pressed by those before them
_SOFT = (0.0, 0.0)
_DEBOUNCE = 3
_LINE = 1000  # characters, from which a value goes on in the next line
_NOTES = (
    "SI units; poses and wrenches in the base frame; moving_part is the plan's moving frame, compliance_ref_link too",
    "wrench_start, wrench_goal: what the controller applies to the moving part about its origin, minus the reaction",
    "stiffness: along and about the axes of the segment's task frame; 0 where the axis is compliant",
)


def export(plan: Plan, base: Pose, folder: Path, caution: str = "") -> tuple[Path, ...]:
    """Write `controllers.yaml` and `segments.yaml` into a folder.

    Raises:
        PlanFormatError: a segment cannot be run, or its force axes fit no frame.
        ResourceError: a file cannot be written.
    """
    rows = moves(plan)
    frames = [task_frame(move, plan.rho) for move in rows]  # where none fits, no file is written
    notes = ((f"WARNING: {one_line(caution)}",) if caution else ()) + _NOTES
    first = controllers(_stiffness(frames[0]), _GAINS, (*notes, "change the stiffness at each segment"))
    parameters, segments = folder / "controllers.yaml", folder / "segments.yaml"
    output.prepare(folder)
    output.save(first.encode(), parameters)
    output.save(_segments(plan, rows, frames, base, notes).encode(), segments)
    return parameters, segments


def _quaternion(pose: Pose) -> tuple[float, float, float, float]:
    """(x, y, z, w), w not negative."""
    r = pose.vector()[3:]
    angle = float(np.linalg.norm(r))
    x, y, z = (0.5 * np.sinc(0.5 * angle / np.pi) * r).tolist()
    return x, y, z, float(np.cos(0.5 * angle))


def pose_message(pose: Pose) -> dict[str, dict[str, float]]:
    """A pose as `geometry_msgs/msg/Pose`, field by field."""
    return {"position": _xyz(pose.p), "orientation": dict(zip("xyzw", _quaternion(pose), strict=True))}


def _stiffness(task: TaskFrame) -> dict[str, float]:
    return {name: (_SOFT if task.selection[k] else _STIFF)[k // 3] for k, name in enumerate(AXIS_NAMES)}


def controllers(stiffness: Mapping[str, float], gains: Mapping[str, Any], notes: tuple[str, ...]) -> str:
    """Parameters of FZI's Cartesian compliance controller, with stiffness and gains of each axis."""
    parameters = {
        "end_effector_link": TOOL_LINK,
        "robot_base_link": BASE_LINK,
        "ft_sensor_ref_link": SENSOR_LINK,
        "compliance_ref_link": TOOL_LINK,
        "joints": [f"joint{k}" for k in range(1, 7)],
        "command_interfaces": ["position"],
        "hand_frame_control": False,
        "stiffness": stiffness,
        "solver": {"error_scale": ERROR_SCALE, "iterations": 1, "publish_state_feedback": True},
        "pd_gains": gains,
    }
    manager = {"update_rate": UPDATE_RATE, CONTROLLER: {"type": f"{CONTROLLER}/CartesianComplianceController"}}
    return yaml_text(
        {"controller_manager": {"ros__parameters": manager}, CONTROLLER: {"ros__parameters": parameters}},
        (*notes, "links and joints are placeholders: give your robot's names"),
    )


def _segments(
    plan: Plan, rows: tuple[PlanMove, ...], frames: list[TaskFrame], base: Pose, notes: tuple[str, ...]
) -> str:
    begun = accumulate((move.duration for move in rows[:-1]), initial=0.0)
    listed = [_segment(*row, base, plan.rho) for row in zip(rows, frames, begun, strict=True)]
    turning = turning_words([move.twist for move in rows], [move.number for move in rows])
    count = "segment and move count from 0, as in the plan file"
    said = (*notes, insertion_words(base), turning, count)
    return yaml_text({"plan": plan.sha256, "frame_id": BASE_LINK, "segments": listed}, said)


def _segment(move: PlanMove, task: TaskFrame, begun: float, base: Pose, rho: float) -> dict[str, Any]:
    return {
        "segment": move.segment,
        "move": move.number,
        "begins": begun,
        "duration": move.duration,
        "start": pose_message(base.compose(move.start)),
        "goal": pose_message(base.compose(move.goal)),
        # As arms change on the way: what is right for a part that is all the way in tips one that is not.
        "wrench_start": _wrench(base, move.hold_start),
        "wrench_goal": _wrench(base, move.hold),
        "held": list(move.state),
        "stiffness": _stiffness(task),
        "set_force_mode": _request(move, task, base, rho),
        "stop": None if move.stop is None else _stop(move, base),
    }


def _request(move: PlanMove, task: TaskFrame, base: Pose, rho: float) -> dict[str, Any]:
    scale = np.array([1.0, 1.0, 1.0, rho, rho, rho])
    speed = float(np.linalg.norm(move.twist * scale))
    reach = max(speed * (move.stop.timeout if move.stop else 2.0 * move.duration), _LEAST)
    return request(base.compose(task.pose), task.selection, task.wrench, 5.0 * speed / scale, reach / scale)


def request(frame: Pose, gives: Sequence[float], wrench: Array, speed: Array, deviation: Array) -> dict[str, Any]:
    """Request of `ur_msgs/srv/SetForceMode`, field by field; for `ros2 service call`.

    Args:
        frame: the task frame in the base.
        gives: (6,) which of its axes are compliant.
        wrench: (6,) to apply, N and N·m.
        speed, deviation: limits (6,) of compliant and of stiff axes, m/s and rad/s, m and rad.
    """
    return {
        "task_frame": {"header": {"frame_id": BASE_LINK}, "pose": pose_message(frame)},
        **{f"selection_vector_{axis}": bool(one) for axis, one in zip(AXES, gives, strict=True)},
        "wrench": _wrench(Pose.identity(), wrench),
        "type": 2,
        "speed_limits": {"linear": _xyz(speed[:3]), "angular": _xyz(speed[3:])},
        "deviation_limits": deviation.tolist(),
        "damping_factor": 0.1,
        "gain_scaling": 0.5,
    }


def _stop(move: PlanMove, base: Pose) -> dict[str, Any]:
    assert move.stop is not None
    return {
        "contacts": list(move.stop.contacts),
        "gain": in_axes_of(base, move.stop.gain).tolist(),
        "force": move.stop.force,
        "debounce": _DEBOUNCE,
        "max_travel": move.stop.max_travel,
        "timeout": move.stop.timeout,
    }


def _wrench(base: Pose, wrench: Array) -> dict[str, dict[str, float]]:
    """A wrench (6,), N and N·m, in the axes of the base, as `geometry_msgs/msg/Wrench`, field by field."""
    return dict(zip(("force", "torque"), map(_xyz, np.split(in_axes_of(base, wrench), 2)), strict=True))


def _xyz(values: Array) -> dict[str, float]:
    return dict(zip("xyz", map(float, values), strict=True))


def yaml_text(value: Mapping[str, Any], notes: tuple[str, ...]) -> str:
    """Block YAML below comments; floats have a point before the exponent, as YAML 1.1 reads them.

    Raises:
        PlanFormatError: a number is not finite.
    """
    try:
        plain = json.loads(json.dumps(value, allow_nan=False))
    except ValueError as error:
        message = "a number of the motion is not finite"
        raise PlanFormatError(message, "give a plan.json that fmopt solve wrote") from error
    comments = "".join(f"# {one_line(note)}\n" for note in notes)
    return comments + str(yaml.safe_dump(plain, sort_keys=False, width=_LINE))
