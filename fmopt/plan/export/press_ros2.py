"""A plan of presses for ROS 2: requests, ways and ends of the presses, the controller's parameters, and an executor."""

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from fmopt.plan import Plan
from fmopt.plan.export import ros2
from fmopt.plan.export.cautions import insertion_words
from fmopt.plan.export.press_script import DEVIATION, over
from fmopt.plan.export.urscript import ProgramSettings
from fmopt.plan.press import Press, PressPlan
from fmopt.runtime import output
from fmopt.runtime.escape import one_line
from fmopt.spatial.se3 import Pose

_ORDER = ("level", "standstill", "travel", "force", "time")  # of ends that are reached at once the first counts
# In each cycle the controller's model, of 1 kg and 1 kg·m², moves on by v T and takes the velocity 0.9 (v + a T), with
# T = 0.02 s and a = error_scale p F. Under a constant force F it comes to v = 9 a T, which is p F / GAIN a second.
GAIN = 1.0 / (9.0 * 0.02**2 * ros2.ERROR_SCALE * ros2.UPDATE_RATE)
_NOTES = (
    "SI units; poses in the base frame, the hole's and the part's; all else in axes of the hole, as the task frames",
    "wrench: what the controller applies to the moving part, about the reference, opposite to the reaction",
    "task_frame is where the reference is at the start of the attempt: the executor has it move with the part",
    "sensor: the pose of the frame of wrenches in that of the moving part; give that of your robot",
)


def export(plan: Plan, presses: PressPlan, base: Pose, folder: Path, caution: str) -> tuple[Path, ...]:
    """Write `presses.yaml`, `controllers.yaml` and `executor.py` into a folder.

    Raises:
        PlanFormatError: a number is not finite.
        ResourceError: a file cannot be written.
    """
    robot = presses.robot
    notes = (f"WARNING: {one_line(caution or 'nothing is proved of presses')}", *_NOTES, insertion_words(base))
    held = [2.0 * float(np.sqrt(k * m)) for k, m in zip(robot.stiffness, (robot.mass, robot.inertia), strict=True)]
    whole = {
        "plan": plan.sha256,
        "frame_id": ros2.BASE_LINK,
        "hole": ros2.pose_message(base),
        "sensor": ros2.pose_message(Pose.identity()),
        "near": ProgramSettings().reach,
        "gain": GAIN,
        "robot": {
            **{key: getattr(robot, key) for key in ("stiffness", "damping", "limits", "arm", "back", "cut_off")},
            "held_damping": held,
        },
        "attempts": [
            {
                "source": one.source,
                "way": [ros2.pose_message(base.compose(pose)) for pose in over(presses, k, Pose.identity())],
                "presses": [_press(press, base, one.start) for press in one.presses],
            }
            for k, one in enumerate(presses.attempts)
        ],
    }
    stiffness = {name: robot.stiffness[k // 3] for k, name in enumerate(ros2.AXIS_NAMES)}
    gains = {name: {"p": GAIN / held[k // 3], "d": 0.0} for k, name in enumerate(ros2.AXIS_NAMES)}
    texts = {
        "presses.yaml": ros2.yaml_text(whole, notes),
        "controllers.yaml": ros2.controllers(stiffness, gains, notes[:1]),
        "executor.py": Path(__file__).with_name("executor.py").read_text("utf-8"),
    }
    output.prepare(folder)
    for name, text in texts.items():
        output.save(text.encode(), folder / name)
    return tuple(folder / name for name in texts)


def _press(press: Press, base: Pose, start: Sequence[float]) -> dict[str, Any]:
    begun, limits = Pose.from_vector(start), np.repeat(DEVIATION, 3)
    frame = base.compose(Pose(begun.p + begun.R @ np.array(press.reference), np.eye(3)))
    ends = sorted((asdict(end) for end in press.ends), key=lambda end: _ORDER.index(end["kind"]))
    return {
        "name": press.name,
        "set_force_mode": ros2.request(frame, press.gives, np.array(press.wrench), np.array(press.speed), limits),
        **{key: getattr(press, key) for key in ("twist", "ramp", "reference", "reach", "keeps")},
        "rocking": None if press.rocking is None else asdict(press.rocking),
        "ends": [{key: value for key, value in end.items() if value is not None} for end in ends],
    }
