"""`fmopt export`: a plan into one of the formats, where it belongs."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from fmopt.plan import STDIO, Plan
from fmopt.plan.export.cautions import base_pose, insertion_words, turning_words
from fmopt.plan.guarded_moves import moves
from fmopt.runtime import output
from fmopt.spatial.se3 import Pose

FORMATS = ("urscript", "ros2", "csv", "json", "mjcf")
_TABLES = ("csv", "json", "mjcf")
_NAMES = {"urscript": "plan.script", "ros2": "ros2", "csv": "samples.csv", "json": "samples.json", "mjcf": "scene.xml"}


@dataclass(frozen=True)
class Form:
    """How a plan is to be written.

    Args:
        base: pose (x, y, z, rx, ry, rz) of the hole's frame in the robot's base, m and rad; None for tables.
        caution: what is to be said of the plan in all that is written; empty where the check has certified it.
        scene: makes the text of "mjcf", which takes the room of execution.

    Raises:
        ValueError: the format is unknown, or it is for robots and the base is missing or in other units.
    """

    to: str
    base: tuple[float, ...] | None = None
    rate: float = 100.0
    caution: str = ""
    scene: Callable[[Plan], str] | None = None

    def __post_init__(self) -> None:
        if self.to not in FORMATS:
            raise ValueError(f"{self.to!r} is no format; choose from {', '.join(FORMATS)}")
        if self.for_robots:
            _ = self.frame  # a base that is missing or in other units is refused before any work is done

    @property
    def for_robots(self) -> bool:
        """Whether robots run what is written."""
        return self.to not in _TABLES

    @property
    def frame(self) -> Pose:
        """The pose of the hole's frame in the robot's base."""
        if self.base is None:
            advice = "give --base X Y Z RX RY RZ, in m and rad"
            raise ValueError(f"{self.to} needs the hole's frame in the robot's base: {advice}")
        return base_pose(self.base)


class Written(NamedTuple):
    """Files and folders that were written, notes, and the text where it is for standard output."""

    paths: tuple[Path, ...]
    notes: tuple[str, ...]
    text: str = ""


def place(file: Path, to: str, out: Path | None) -> Path:
    """Where a plan of this file goes: beside it unless `out` says where.

    Raises:
        ValueError: `out` is the plan itself.
    """
    target = out if out is not None else (Path() if file == STDIO else file.parent) / _NAMES[to]
    # Resolved, as the plan can be reached by links and detours, too.
    if target != STDIO and target.resolve() == file.resolve():
        raise ValueError(f"--out is {file}, the plan itself, which would be lost")
    return target


def export(plan: Plan, form: Form, target: Path) -> Written:
    """Writes a plan in another format to a file, to a folder for ros2, or as text for "-", with notes.

    Raises:
        ValueError: the format is several files, and `target` no folder.
        FmoptError: the plan cannot be exported or written.
    """
    text = text_of(plan, form) if target == STDIO else ""
    paths = () if target == STDIO else exported(plan, form, target)
    if not form.for_robots:
        notes = () if form.base is None else (f"{form.to} is in the hole's frame: --base is not used",)
        return Written(paths, notes, text)
    turning = (_turning(plan, form.to),) if plan.press_plan is None else ()
    return Written(paths, (insertion_words(form.frame), *turning), text)


def _turning(plan: Plan, to: str) -> str:
    """The greatest turning rate of what was written."""
    from fmopt.plan.export.urscript import commanded

    rows = moves(plan)
    # A program runs guarded moves more slowly than the plan; segments keep the plan's speeds.
    return turning_words(commanded(rows) if to == "urscript" else [m.twist for m in rows], [m.number for m in rows])


def exported(plan: Plan, form: Form, target: Path) -> tuple[Path, ...]:
    """Writes a plan in another format, and says what was written; arguments as for `export`."""
    if form.to == "ros2":
        from fmopt.plan.export import press_ros2, ros2

        if plan.press_plan is not None:
            return press_ros2.export(plan, plan.press_plan, form.frame, target, form.caution)
        return ros2.export(plan, form.frame, target, form.caution)
    output.save(text_of(plan, form).encode(), target)
    return (target,)


def text_of(plan: Plan, form: Form) -> str:
    """A plan as the text of another format; arguments as for `export`."""
    if form.to == "ros2":
        raise ValueError("ros2 is several files: --out has to be a folder")
    if form.to == "mjcf":
        assert form.scene is not None
        return form.scene(plan)
    if form.to == "urscript":
        from fmopt.plan.export import press_script
        from fmopt.plan.export.urscript import program

        if plan.press_plan is not None:
            return press_script.program(plan, plan.press_plan, form.frame, form.caution)
        return program(plan, form.frame, form.caution)
    from fmopt.plan.export.sampled import csv_text, json_text

    return (csv_text if form.to == "csv" else json_text)(plan, form.rate, form.caution)
