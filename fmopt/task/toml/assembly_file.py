"""The tables of an assembly file: objects in a workcell, the links between them, and tasks one after the other.

[objects.plate] model = "plate.toml"      at, turn: its frame in the global reference frame
[links.seat]    kind = "attached"         one, other: an object, or "object.feature"
[tasks.first]   moving = "bush.shank"     the five attributes of [LeeHuang1985] section 3
"""

from typing import Annotated, Literal, TypeAlias

from pydantic import Field, StringConstraints

from fmopt.task.toml.problem_file import Angle, FrameTable, Pair, Units
from fmopt.task.toml.tables import File, Force, Measured, Name, Rotation, Speed, Table, Title, Torque, Values, Vector
from fmopt.task.toml.units import LENGTH

_PART = r"[A-Za-z][A-Za-z0-9_-]{0,63}"
FeatureRef: TypeAlias = Annotated[str, StringConstraints(pattern=rf"^{_PART}\.{_PART}$")]
NodeRef: TypeAlias = Annotated[str, StringConstraints(pattern=rf"^{_PART}(\.{_PART})?$")]
Shift: TypeAlias = Annotated[float | None, Measured(LENGTH, -1e3, 1e3, words=("free",))]


class Object(Table):
    """An object of the workcell."""

    model: File
    """Model file, relative to this file."""
    parameters: Values = Field(default_factory=dict)
    """Values that replace the model's; plain numbers are lengths."""
    at: Vector = (0.0, 0.0, 0.0)
    """Where the model's frame is in the global reference frame."""
    turn: Rotation = (0.0, 0.0, 0.0)
    """How it is turned there: a rotation vector (axis times angle)."""


class LinkTable(Table):
    """A link of two objects or features that is there from the beginning."""

    kind: Literal["cylindrical", "prismatic", "planar", "screw", "spherical", "revolute", "attached"]
    """The lower pair, or "attached" for a rigid joint."""
    one: NodeRef
    other: NodeRef


class SpecificationTable(Table):
    """Speed and forces of a task."""

    speed: Speed
    """Greatest speed of the moving feature's origin."""
    contact_force: Force
    """Force with which a wanted contact is held."""
    torque_limit: Torque
    """Greatest torque about the moving feature's origin."""


class TaskTable(Table):
    """A task by its five attributes."""

    moving: FeatureRef
    """Feature-operand of the object that is grasped, as "object.feature"."""
    fixed: FeatureRef
    """Feature-operand of the object that stays."""
    attachment: Pair
    """The lower pair that the task makes."""
    goal: tuple[Shift, Shift, Shift, Angle, Angle, Angle]
    """Pose of the moving feature in the frame of the fixed one: position and rotation vector; entries may be "free"."""
    grasp: FrameTable = Field(default_factory=FrameTable)
    specification: SpecificationTable


class AssemblyFile(Table):
    """An assembly for fmopt: a workcell and the tasks to be done in it, in the order of the file."""

    title: Title
    units: Units
    objects: Annotated[dict[Name, Object], Field(min_length=1, max_length=64)]
    """The objects by name."""
    links: Annotated[dict[Name, LinkTable], Field(max_length=256)] = Field(default_factory=dict)
    """Links that are there from the beginning, by any name."""
    tasks: Annotated[dict[Name, TaskTable], Field(min_length=1, max_length=64)]
    """The tasks by name."""
