"""The tables of a problem file: the task attributes of [LeeHuang1985] section 3, uncertainty, and settings."""

from __future__ import annotations

import math
from typing import Annotated, Literal, TypeAlias

from pydantic import Field

from fmopt.task.tables import (
    Beside,
    Distance,
    Duration,
    File,
    Force,
    Friction,
    Lever,
    Mass,
    Measured,
    Name,
    Parameter,
    ParameterName,
    Ratio,
    Rotation,
    Shift,
    Speed,
    Stiffness,
    Table,
    Tilt,
    Title,
    Torque,
    Vector,
    Way,
)
from fmopt.task.units import ANGLE, LENGTH


class Units(Table):
    """The units of the plain numbers of this file."""

    length: Literal["m", "cm", "mm", "um", "in"]
    angle: Literal["rad", "mrad", "deg"]
    speed: Literal["m/s", "mm/s"] = "m/s"
    force: Literal["N", "mN", "kN"] = "N"
    torque: Literal["N*m", "N*mm"] = "N*m"
    time: Literal["s", "ms", "min"] = "s"


class Operand(Table):
    """One of the two parts, and its feature that mates."""

    model: File
    """Model file, relative to this file."""
    feature: Name
    """The mating feature: one solid and one hollow; where the hollow part moves, the operands are exchanged."""
    parameters: Annotated[dict[ParameterName, Parameter], Field(max_length=256)] = Field(default_factory=dict)
    """Values that replace the model's; plain numbers are lengths."""


Depth: TypeAlias = Annotated[float | None, Measured(LENGTH, 1e-9, 1e3, words=("full", "free"))]
Angle: TypeAlias = Annotated[float | None, Measured(ANGLE, -6.3, 6.3, words=("free",))]
Pair: TypeAlias = Literal["cylindrical", "prismatic", "planar", "screw", "spherical", "revolute"]


class Goal(Table):
    """Where the moving part ends, on the mating axis, and the pair that it then makes with the fixed one."""

    depth: Depth
    """How far the peg's leading face goes below the mouth; "full" or "free" is as deep as hole and peg allow."""
    turn: Angle = None
    """Angle about the axis, of the moving feature against the fixed one; "free" is as the start has it, nearest to it.
    Not given: free where the pair leaves it free and the peg is round, else 0."""
    attachment: Pair | None = None
    """The lower pair that the task makes; not given: cylindrical for a round peg, prismatic for any other."""


class GraspTable(Table):
    """The frame of the moving feature in the frame of the hand."""

    at: Vector = (0.0, 0.0, 0.0)
    turn: Rotation = (0.0, 0.0, 0.0)


class Clearance(Table):
    """Clearance on each side as the drawing declares it; the measured one is printed beside it."""

    x: Distance
    """On each side along the x axis of the hole's frame."""
    y: Distance | None = None
    """On each side along its y axis; left out in a planar problem."""


class Start(Table):
    """Where the motion starts: above the mouth, beside the axis and tilted as the plan chooses."""

    height: Way
    """Height of the tilted part's lowest point above the mouth; the start error holds in that pose."""
    at: tuple[Beside, Beside, Beside] | None = None
    """Where the nominal trajectory P(t) begins: the moving feature's origin in the fixed feature's frame; not given:
    on the axis, the peg's leading face at `height`."""
    turn: Rotation = (0.0, 0.0, 0.0)
    """How the moving feature is turned there: a rotation vector."""


class Box(Table):
    """Half-widths of the error in the tilted start pose: shift of the leading face's centre, rotation about it."""

    frame: Literal["world", "hole", "hand"] = "world"
    """Where the error is fixed: in the world (the robot's own), in the hole (the fixture's, which is askew), or in the
    hand (the grasp's, which turns with the part)."""
    x: Shift
    y: Shift | None = None
    """Left out in a planar problem, as rx and rz."""
    z: Shift
    rx: Tilt | None = None
    ry: Tilt
    rz: Tilt | None = None


class Deviation(Table):
    """Greatest deviation in position (a distance) and in orientation (an angle about any axis)."""

    position: Distance
    angle: Tilt = 0.0


class Handling(Table):
    """A robot that grasped the part and put it down."""

    robot: Deviation
    """Deviation of its end effector, ε_pr and ε_φr; it counts twice."""
    slide: Deviation | None = None
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
    angle: Tilt = 0.0
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
    angle: Tilt = 0.0
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
    robot: Deviation
    """Deviation of the robot's end effector, ε_pr and ε_φr."""
    grasp: Grasp


class Velocity(Table):
    """Velocity error as a fraction of the speed."""

    translation: Ratio
    rotation: Ratio


class Trapezoid(Table):
    """Ball and cone of the nominal trajectory's S(t), [LeeHuang1985] section 4.1.2, on all three planes."""

    ball: Distance
    """Radius r of the ball (max norm) of the peg's leading face's centre."""
    cone: Tilt
    """Half-angle s of the cone of its direction."""


class Uncertainty(Table):
    """Errors: at the start, either as a box or by their sources, and of the velocity."""

    start: Box | None = None
    sources: Sources | None = None
    trapezoid: Trapezoid | None = None
    """For what errors S(t) says what stops the part; those of the start when not given. Nothing is proved for them."""
    velocity: Velocity


class Specification(Table):
    """Speed, forces and friction of the motion."""

    speed: Speed
    """Greatest speed of the leading face's centre."""
    contact_force: Force
    """Force with which a wanted contact is held."""
    torque_limit: Torque
    """Greatest torque about the leading face's centre."""
    friction: Friction
    """Coefficient of friction between the parts."""
    termination_force: Force
    """Change of contact force that ends a guarded move; at most contact_force, and best well below."""
    impact_force: Force | None = None
    """Greatest force with which a contact that ends a move may be met, on top of the push; moves are slowed for it. It
    takes apparent_mass and contact_stiffness; not limited if not given."""
    apparent_mass: Mass | None = None
    """Mass of robot and part as it is felt at their contact; plain numbers are in kg."""
    contact_stiffness: Stiffness | None = None
    """Stiffness of contact, part, sensor and robot in series; plain numbers are in N/m."""


class Settings(Table):
    """How the plan is computed."""

    method: Literal["sound", "dakin1993"] = "sound"
    """How uncertainty propagates; "dakin1993" is the paper's recipe, which under-covers, for comparison."""
    placement: Literal["socp+nlp", "descent"] = "socp+nlp"
    """How goal poses are placed; "descent" is the paper's steepest descent, for comparison."""
    max_tilt: Tilt = Field(default_factory=lambda: math.radians(12.0))
    """Greatest tilt about each of x and y in which the part starts, 12 deg if not given; moves may turn it further."""
    characteristic_length: Lever | None = None
    """Length that makes rotation comparable with translation; half the diagonal of the mating section if not given."""
    reduce_errors: bool = False
    """Whether to plan for the largest share of the start errors for which there is a plan, in steps of 5 %, where there
    is none for all of them; the verdict is NOT_PROVED then. Each share has the time limit for itself."""
    time_limit: Duration = Field(default_factory=lambda: 600.0)
    """Time after which no further sequence is searched for, 600 s if not given; placing and checking come on top."""


class ProblemFile(Table):
    """An insertion for fmopt: two parts, a goal, clearance, errors, and settings.

    Two models that are profiles make a planar problem: motion in x and z, turning about y, without error out of it.
    """

    title: Title
    units: Units
    moving: Operand
    fixed: Operand
    goal: Goal
    clearance: Clearance
    start: Start
    grasp: GraspTable = Field(default_factory=GraspTable)
    uncertainty: Uncertainty
    specification: Specification
    settings: Settings = Field(default_factory=Settings)
