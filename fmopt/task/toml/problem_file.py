"""The tables of a problem file: the task attributes of [LeeHuang1985] section 3, uncertainty, and settings.

Its short forms, spelled out: a model by its name alone, a start error as text; their keys have the place of the text.
"""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Annotated, Any, Literal, TypeAlias

from pydantic import BeforeValidator, Field

from fmopt.errors import Fault
from fmopt.task.toml.model_file import ModelUnits, PlacedTable, Primitive
from fmopt.task.toml.source import Key, Source
from fmopt.task.toml.tables import (
    Beside,
    Distance,
    Duration,
    ErrorAngle,
    File,
    Force,
    Friction,
    Lever,
    Mass,
    Measured,
    Name,
    Ratio,
    Rotation,
    Shift,
    Short,
    Speed,
    Stiffness,
    Table,
    Tilt,
    Title,
    Torque,
    Values,
    Vector,
    Way,
    fault,
)
from fmopt.task.toml.units import ANGLE, LENGTH, QuantityError, evaluate


class ProblemUnits(ModelUnits):
    """The units of the plain numbers of this file; what has its unit beside it needs none here."""

    speed: Literal["m/s", "mm/s"] = "m/s"
    force: Literal["N", "mN", "kN"] = "N"
    torque: Literal["N*m", "N*mm"] = "N*m"
    time: Literal["s", "ms", "min"] = "s"


class Units(ProblemUnits):
    """The units of the plain numbers of this file."""

    length: Literal["m", "cm", "mm", "um", "in"]
    angle: Literal["rad", "mrad", "deg"]


class OfFile(Table):
    """A solid by its file."""

    model: File
    """Model file (TOML), or a mesh or STEP file itself, relative to this file."""
    unit: Literal["m", "cm", "mm", "um", "in"] | None = None
    """Unit of the numbers of a mesh file that is named itself; mm if not given."""
    body: Annotated[str, Field(min_length=1, max_length=200)] | Annotated[int, Field(ge=1, le=10_000)] | None = None
    """Which body of a STEP or mesh file that is named itself, by name or number, where it holds several. Two bodies of
    one file stand there as the goal has them."""
    parameters: Values = Field(default_factory=dict)
    """Values that replace the model's; plain numbers are lengths."""


class OperandTable(OfFile):
    """One of the two parts, and its feature that mates."""

    feature: Name | None = None
    """The mating feature: one solid and one hollow; where the hollow part moves, the operands are exchanged. Not given:
    the pair of features that fits best."""


class FileSolid(OfFile, PlacedTable):
    """A solid of a model, mesh or STEP file, its frame put where `at` and `turn` say."""

    shape: Literal["file"]
    """Understood where `model` is given."""


Solids: TypeAlias = Annotated[
    dict[Name, Annotated[Primitive | FileSolid, Field(discriminator="shape"), Short()]], Field(max_length=32)
]
Depth: TypeAlias = Annotated[float | None, Measured(LENGTH, 1e-9, 1e3, words=("full", "free"))]
Angle: TypeAlias = Annotated[float | None, Measured(ANGLE, -2.0 * math.pi, 2.0 * math.pi, words=("free",))]
Pair: TypeAlias = Literal["cylindrical", "prismatic", "planar", "screw", "spherical", "revolute"]


def _inserting(value: object) -> object:
    """Refuses the pairs that are made in other ways."""
    if value in ("planar", "screw", "spherical"):
        message = f"a {value} pair is not made by an insertion along the axis"
        raise fault("no-insertion", message, "the knowledge base answers such tasks; describe it in an assembly file")
    return value


Inserted: TypeAlias = Annotated[Literal["cylindrical", "prismatic", "revolute"], BeforeValidator(_inserting)]


class Goal(Table):
    """Where the moving part ends, on the mating axis, and the pair that it then makes with the fixed one."""

    depth: Depth = None
    """How far the peg's leading face goes below the mouth; "full" or "free" is as deep as hole and peg allow, as it is
    where nothing is given."""
    turn: Angle = None
    """Angle about the axis, of the moving feature against the fixed one; "free" is as the start has it, nearest to it.
    Not given: free where the pair leaves it free and the peg is round; that of the best fit, where the frame of a
    feature was found; else 0."""
    attachment: Inserted | None = None
    """The lower pair that the task makes; not given: cylindrical for a round peg, prismatic for any other."""


class FrameTable(Table):
    """A frame in another one: where its origin is, and how it is turned, as a rotation vector."""

    at: Vector = (0.0, 0.0, 0.0)
    turn: Rotation = (0.0, 0.0, 0.0)


class ClearanceTable(Table):
    """Clearance on each side as the drawing declares it; measured on the parts if not given, and in any case."""

    x: Distance
    """On each side along the x axis of the hole's frame."""
    y: Distance | None = None
    """On each side along its y axis; left out in a planar problem."""


class Start(Table):
    """Where the motion starts: above the mouth, beside the axis and tilted as the plan chooses."""

    height: Way | None = None
    """Height of the tilted part's lowest point above the mouth; the start error holds in that pose. Not given: 1 mm, or
    as much more as the errors could bring it down by."""
    at: tuple[Beside, Beside, Beside] | None = None
    """Where the nominal trajectory P(t) begins: the moving feature's origin in the fixed feature's frame; not given:
    on the axis, the peg's leading face at `height`."""
    turn: Rotation = (0.0, 0.0, 0.0)
    """How the moving feature is turned there: a rotation vector."""


class ErrorBoxTable(Table):
    """Half-widths of the error in the tilted start pose: shift of the leading face's centre, rotation about it."""

    frame: Literal["world", "hole", "hand"] = "world"
    """Where the error is fixed: in the world (the robot's own), in the hole (the fixture's, which is askew), or in the
    hand (the grasp's, which turns with the part)."""
    position: Shift | None = None
    """Along each axis for which nothing else is given."""
    angle: ErrorAngle | None = None
    """About each axis for which nothing else is given."""
    x: Shift | None = None
    y: Shift | None = None
    """Left out in a planar problem, as rx and rz."""
    z: Shift | None = None
    rx: ErrorAngle | None = None
    ry: ErrorAngle | None = None
    rz: ErrorAngle | None = None


class DeviationTable(Table):
    """Greatest deviation in position (a distance) and in orientation (an angle about any axis)."""

    position: Distance
    angle: ErrorAngle = 0.0


class Handling(Table):
    """A robot that grasped the part and put it down."""

    robot: DeviationTable
    """Deviation of its end effector, ε_pr and ε_φr; it counts twice."""
    slide: DeviationTable | None = None
    """Slide in its gripper, ε_td and ε_φd."""
    at: Vector = (0.0, 0.0, 0.0)
    """Grasping point, in the frame of the mating feature."""


class Observed(Table):
    """Three points of the part whose places were observed: position and orientation follow from them."""

    points: Annotated[tuple[Vector, ...], Field(min_length=3, max_length=3)]
    """In the frame of the mating feature, not on a line."""
    deviation: Distance
    """Of each point, ε_m."""


class Configuration(Table):
    """Where a part lies: known a priori, or observed by position and angle or by points; put down by robots or not."""

    position: Distance | None = None
    """Deviation of its position, ε_pp, observed beside its orientation."""
    angle: ErrorAngle = 0.0
    """Deviation of its orientation, ε_φp, with `position`."""
    about: Vector | None = None
    """The point that has that position, in the frame of the mating feature; if not given, the feature's own point."""
    known: Distance | None = None
    """Deviation of every one of its points from its place, ε_pp, in place of `position` and `angle`."""
    observed: Observed | None = None
    """Points that were observed, in place of `position` and `angle`."""
    placed: Annotated[tuple[Handling, ...], Field(min_length=1, max_length=64)] | None = None
    """Robots that handled the part after that, in turn; the rest then says where it lay before."""


class Grasp(Table):
    """How far the moving part may slide in the gripper, and where the gripper holds it."""

    position: Distance = 0.0
    """Greatest slide, ε_td."""
    angle: ErrorAngle = 0.0
    """Greatest rotation about the grasping point, ε_φd."""
    height: Distance
    """Distance of the grasping point from the leading face: rotation there moves the leading face."""


class Sources(Table):
    """Where the start error comes from, combined as [BasanezSuarez] combine the sources."""

    shape: Distance = 0.0
    """Deviation of any point of either part from its model, ε_v."""
    measurement: Distance | None = None
    """Deviation of the fixed part as a sensor sees it, ε_m; in place of its shape and configuration."""
    configuration: Configuration | None = None
    """Of the fixed part as it was put down, ε_pp and ε_φp."""
    feeder: Configuration | None = None
    """Of the moving part before it was grasped, ε_pp and ε_φp."""
    robot: DeviationTable
    """Deviation of the robot's end effector, ε_pr and ε_φr."""
    grasp: Grasp


class Velocity(Table):
    """Velocity error as a fraction of the speed."""

    translation: Ratio = 0.01
    rotation: Ratio = 0.01


class TrapezoidTable(Table):
    """Ball and cone of the nominal trajectory's S(t), [LeeHuang1985] section 4.1.2, on all three planes."""

    ball: Distance
    """Radius r of the ball (max norm) of the peg's leading face's centre."""
    cone: Tilt
    """Half-angle s of the cone of its direction."""


class Uncertainty(Table):
    """Errors: at the start, either as a box or by their sources, and of the velocity."""

    start: Annotated[ErrorBoxTable, Short()] | None = None
    """Text such as "1 mm, 1 deg" stands for position and angle."""
    sources: Sources | None = None
    trapezoid: TrapezoidTable | None = None
    """For what errors S(t) says what stops the part; those of the start when not given. Nothing is proved for them."""
    velocity: Velocity = Field(default_factory=Velocity)


class MotionSpecificationTable(Table):
    """Speed, forces and friction of the motion."""

    speed: Speed = 0.02
    """Greatest speed of the leading face's centre, 20 mm/s if not given."""
    contact_force: Force = 20.0
    """Force with which a wanted contact is held, 20 N if not given."""
    torque_limit: Torque = 1.0
    """Greatest torque about the leading face's centre, 1 N*m if not given."""
    friction: Friction = None
    """Coefficient of friction between the parts, or the interval that it lies in. Guarded moves are planned for the
    greatest, 0.3 if not given; trials draw from the interval, 0.1 to 0.5 if not given."""
    termination_force: Force = 2.0
    """Change of contact force that ends a guarded move, 2 N if not given; at most contact_force, best well below."""
    impact_force: Force | None = None
    """Greatest force with which a contact that ends a move may be met, on top of the push; moves are slowed for it. It
    takes apparent_mass and contact_stiffness; not limited if not given."""
    apparent_mass: Mass | None = None
    """Mass of robot and part as it is felt at their contact; plain numbers are in kg."""
    contact_stiffness: Stiffness | None = None
    """Stiffness of contact, part, sensor and robot in series; plain numbers are in N/m."""


@cache
def _presets() -> dict[str, dict[str, float]]:
    return tomllib.loads(Path(__file__).with_name("robots.toml").read_text("utf-8"))


class RobotTable(Table):
    """The robot that carries presses out, as it is felt at the moving part; what is not given is of its preset."""

    preset: Literal["generic", "ur5e", "ur10e", "franka"] = "generic"
    """Text stands for it alone."""
    stiffness: Stiffness | None = None
    """Of axes held in position; plain numbers are in N/m."""
    turning: Torque | None = None
    """Torque that turns a held axis by one radian."""
    mass: Mass | None = None
    """Apparent mass; plain numbers are in kg."""
    gyration: Distance | None = None
    """Radius of gyration of that mass about the leading face's centre."""
    force_offset: Force | None = None
    """Accuracy of the force that it applies after zeroing, as [Trochimczuk2026]: evidence is drawn from this."""
    torque_offset: Torque | None = None
    """The same of the torque."""
    force_noise: Force | None = None
    torque_noise: Torque | None = None
    """Standard deviations of a raw sample."""
    delay: Duration | None = None
    """Of its measurements."""
    max_force: Force | None = None
    max_torque: Torque | None = None
    """The greatest that it can control; contact_force and torque_limit are at most as much."""

    def properties(self) -> dict[str, Any]:
        """All of its values, in SI units."""
        return {**_presets()[self.preset], **self.model_dump(exclude_none=True)}


class ToolTable(Table):
    """The tool that holds the moving part."""

    tcp: FrameTable | None = None
    """The tool's centre point in the model frame of the moving part, for which programs are exported; the centre of the
    leading face, z back into the part, if not given."""
    solids: Solids = Field(default_factory=dict)
    """Solids by name, shapes or files, in that frame: they move with the part, and are kept clear of the fixed part and
    of all obstacles. Text stands for a file."""


class SettingsTable(Table):
    """How the plan is computed."""

    method: Literal["sound", "dakin1993"] = "sound"
    """How uncertainty propagates; "dakin1993" is the paper's recipe, which under-covers, for comparison."""
    placement: Literal["socp+nlp", "descent"] = "socp+nlp"
    """How goal poses are placed; "descent" is the paper's steepest descent, for comparison."""
    max_tilt: Tilt = Field(default_factory=lambda: math.radians(25.0))
    """Greatest tilt about each of x and y in which the part starts, 25 deg if not given; moves may turn it further.
    With small errors the part is tilted less by itself."""
    characteristic_length: Lever | None = None
    """Length that makes rotation comparable with translation; half the diagonal of the mating section if not given."""
    reduce_errors: bool = False
    """Whether to plan for the largest share of the start errors for which there is a plan, in steps of 5 %, where there
    is none for all of them; the verdict is NOT_PROVED then. Half of the time limit is for all of
    the errors, the other half for shares of them, the same for each."""
    time_limit: Duration = Field(default_factory=lambda: 600.0)
    """Time for search, placement and what a plan tells besides, 600 s if not given; what there is by then counts."""
    evidence: Literal["tested", "certified"] = "tested"
    """What is asked for: "tested", a plan of presses that seats in the physics engine, or "certified", guarded moves
    with a proof. Planar problems are always planned for a proof."""
    max_time: Duration | None = None
    """Within which 95 % of the draws of a tested plan that seat have to be through; not limited if not given."""
    min_rate: Ratio = 0.9
    """Rate with which a tested plan has to seat, by the lower bound that its trials give."""
    draws: Annotated[int, Field(ge=10, le=10_000)] = 96
    """Trials of that bound, fixed beforehand; the 64 vertices of the start errors come on top."""
    vertices: bool = True
    """Whether these vertices are tried. Without them no plan is TESTED; a study of many variants gains time."""
    seed: Annotated[int, Field(ge=0, le=2**31)] = 1
    """Of all that is drawn."""


class ProblemFile(Table):
    """An insertion for fmopt: two parts and how far off they start; what else is not stated is found, or as usual.

    Two models that are profiles make a planar problem: motion in x and z, turning about y, without error out of it.
    """

    title: Title | None = None
    """For people; the names of the parts if not given."""
    units: ProblemUnits | None = None
    moving: Annotated[OperandTable, Short()]
    """Text stands for the model alone."""
    fixed: Annotated[OperandTable, Short()]
    """Text stands for the model alone."""
    goal: Goal = Field(default_factory=Goal)
    clearance: ClearanceTable | None = None
    start: Start = Field(default_factory=Start)
    grasp: FrameTable = Field(default_factory=FrameTable)
    """The frame of the moving feature in the frame of the hand."""
    tool: ToolTable = Field(default_factory=ToolTable)
    obstacles: Solids = Field(default_factory=dict)
    """Solids by name in the model frame of the fixed part, as [tool] solids: neighbours that part and tool keep clear
    of."""
    uncertainty: Uncertainty = Field(default_factory=Uncertainty)
    """How far off the part may start, which nobody but you can know: [uncertainty] start, or its sources."""
    specification: MotionSpecificationTable = Field(default_factory=MotionSpecificationTable)
    robot: Annotated[RobotTable, Short()] = Field(default_factory=RobotTable)
    """Text stands for the preset alone."""
    settings: SettingsTable = Field(default_factory=SettingsTable)

    def operand(self, side: str) -> OperandTable:
        """The part that moves, or the fixed one."""
        return self.moving if side == "moving" else self.fixed

    @property
    def solids(self) -> dict[Key, Primitive | FileSolid]:
        """Tool and obstacles by their places in the file."""
        held, standing = self.tool.solids.items(), self.obstacles.items()
        found: dict[Key, Primitive | FileSolid] = {("tool", "solids", name): one for name, one in held}
        return found | {("obstacles", name): one for name, one in standing}

    def feature(self, side: str) -> str:
        """The mating feature of a part, which is stated or was found."""
        return self.operand(side).feature or ""


EXAMPLE = '"1 mm, 1 deg"'
_ADVICE = f"write a distance and an angle with their units, such as {EXAMPLE}: how far off the part may start"
_SIGN = re.compile(r"^\s*(?:±|\+-|\+/-)\s*")


def solid_tables(data: Mapping[str, Any]) -> Iterator[tuple[Key, Any]]:
    """Keys of tool and obstacles with what stands there, right or wrong."""
    tool = data.get("tool")
    held = tool.get("solids") if isinstance(tool, Mapping) else None
    for above, solids in ((("tool", "solids"), held), (("obstacles",), data.get("obstacles"))):
        if isinstance(solids, Mapping):
            yield from (((*above, name), one) for name, one in solids.items())


def spelled_out(source: Source) -> tuple[Source, list[Fault]]:
    """The document with its short forms as tables, and the faults of those that stand for nothing.

    >>> from pathlib import Path
    >>> data = {"moving": "peg.stl", "fixed": "plate.stl", "uncertainty": {"start": "1 mm, 1 deg"}}
    >>> whole, faults = spelled_out(Source(Path("problem.toml"), data, {}, {}))
    >>> whole.data["moving"], whole.data["uncertainty"]["start"]
    ({'model': 'peg.stl'}, {'position': '1 mm', 'angle': '1 deg'})
    """
    # Copies: the hash of a problem is of its document as the file has it.
    data, values, faults = dict(source.data), dict(source.values), list[Fault]()

    def put(key: Key, table: dict[str, Any]) -> None:
        if key in values:
            values.update({(*key, name): values[key] for name in table})

    for key, name in (("moving", "model"), ("fixed", "model"), ("robot", "preset")):
        if isinstance(data.get(key), str):
            data[key] = {name: data[key]}
            put((key,), data[key])
    named: dict[Key, dict[str | int, Any]] = {}
    for where, solid in solid_tables(data):
        if isinstance(solid, str):
            solid = {"model": solid}
            put(where, solid)
        file = isinstance(solid, Mapping) and "model" in solid and "shape" not in solid
        named.setdefault(where[:-1], {})[where[-1]] = {**solid, "shape": "file"} if file else solid
    for above, solids in named.items():
        data[str(above[0])] = solids if len(above) == 1 else {**data["tool"], "solids": solids}
    errors = data.get("uncertainty")
    if isinstance(errors, Mapping) and isinstance(errors.get("start"), str):
        place = ("uncertainty", "start")
        try:
            start = error_of(errors["start"])
        except QuantityError as error:
            faults.append(source.place(place).fault(error.code, error.message, error.advice))
            start = {"position": 0, "angle": 0}  # so that it is not told as missing, too
        data["uncertainty"] = {**errors, "start": start}
        put(place, start)
    return replace(source, data=data, values=values), faults


def error_of(text: str) -> dict[str, Any]:
    """A start error that is stated as text, as the table [uncertainty.start].

    >>> error_of("± 0.2 mm, 30 mrad")
    {'position': '0.2 mm', 'angle': '30 mrad'}

    Raises:
        QuantityError: it is not a distance and an angle.
    """
    parts = [_SIGN.sub("", part).strip() for part in re.split(r"[,;]|\band\b", text) if part.strip()]
    found: dict[str, Any] = {}
    for part in parts:
        try:
            kind = evaluate(part).dimension
        except QuantityError as error:
            raise QuantityError(error.code, f"{text!r}: {error.message}", _ADVICE) from None
        name = {LENGTH: "position", ANGLE: "angle"}.get(kind)
        if name is None or name in found:
            what = f"{part!r} is {kind}" if name is None else f"there are two of {part!r}'s kind"
            raise QuantityError("wrong-unit", f"{text!r}: {what}", _ADVICE)
        found[name] = part
    if len(found) != 2:
        missing = "angle" if "position" in found else "distance" if found else "distance and no angle"
        raise QuantityError("expression", f"{text!r} states no {missing}", _ADVICE)
    return found
