"""The problem: two parts, a goal, errors and settings as one frozen value, read from a file and checked as a whole.

Importing this module loads no solver, mesh library or unit library; `load` imports what the file needs.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from fmopt.spatial.values import Array, Framing, Value
from fmopt.task.sources import Contribution, framing, total

if TYPE_CHECKING:
    from fmopt.geometry.mating_features import Feature
    from fmopt.geometry.part import Part, Profiles
    from fmopt.plan.press import Surroundings
    from fmopt.spatial.se3 import Pose
    from fmopt.task.object_model.tree import ObjectTree
    from fmopt.task.object_model.workcell import LowerPair
    from fmopt.task.pairing import Mated
    from fmopt.task.toml.problem_file import Sources


@dataclass(frozen=True)
class Specification:
    """Greatest speed (m/s), contact force (N), torque limit (N·m), friction, and the force that ends a move (N).

    Where given, the impact of a contact that ends a move stays under a force (N), with what mass (kg) and what
    stiffness (N/m) meet there: all three, or none.
    """

    speed: float
    contact_force: float
    torque_limit: float
    friction: float
    termination_force: float
    impact_force: float | None = None
    apparent_mass: float | None = None
    contact_stiffness: float | None = None

    def record(self) -> dict[str, float]:
        """What is given, by its names."""
        return {name: value for name, value in asdict(self).items() if value is not None}


@dataclass(frozen=True)
class RobotProperties:
    """What presses are carried out with, by the keys of [robot], in SI units."""

    preset: str
    stiffness: float
    turning: float
    mass: float
    gyration: float
    force_offset: float
    torque_offset: float
    force_noise: float
    torque_noise: float
    delay: float
    max_force: float
    max_torque: float


@dataclass(frozen=True)
class Settings:
    """How the plan is computed: methods, greatest tilt (rad), characteristic length (m or None), time (s).

    `evidence`: whether a plan that is tested is asked for or one that is certified; `min_rate` the rate with which a
    tested one seats at least, by so many `draws`, 95 % of those that seat within `max_time` (s). `reduce_errors`:
    whether a plan for a share of the start errors is wanted where there is none for all of them.
    """

    evidence: Literal["tested", "certified"]
    max_time: float | None
    min_rate: float
    draws: int
    vertices: bool
    seed: int
    method: Literal["sound", "dakin1993"]
    placement: Literal["socp+nlp", "descent"]
    max_tilt: float
    characteristic_length: float | None
    reduce_errors: bool
    time_limit: float


@dataclass(frozen=True)
class VelocityError:
    """Velocity error as fractions of the commanded translation and rotation."""

    translation: float
    rotation: float

    def scaled(self, share: float) -> VelocityError:
        """A share of them."""
        return VelocityError(share * self.translation, share * self.rotation)


@dataclass(frozen=True, eq=False)
class Attributes(Value):
    """What [LeeHuang1985] section 3 has among the five attributes of a task and the mating frames do not show.

    Args:
        exchanged: whether the hollow part is in the hand.
        grasp: frame of the grasped feature in the frame of the hand.
        turn: angle of the peg about the axis of the hole at the goal, rad. The peg's mating frame is turned by it, so
            that its goal reads 0.
        free_depth, free_turn: whether the goal leaves the depth, or the angle, free.
    """

    attachment: LowerPair
    exchanged: bool
    grasp: Pose
    turn: float
    free_depth: bool
    free_turn: bool


@dataclass(frozen=True, eq=False)
class Problem(Value, goal=(6,), start=(6,), start_box=(6,), tcp=(6,)):
    """An insertion, in SI units and mating frames.

    The moving part is the one with the peg. Where the task has the hole in the hand the operands are exchanged: the
    errors, speeds and forces are those of the peg's leading face against the hole all the same.

    Args:
        sha256: of the contents of the problem file and its models; comments and layout do not count.
        moving: the moving part; its origin is the centre of the peg's leading face, z back into the part.
        fixed: the fixed part in the B-frame; its origin is the centre of the mouth, z out of the hole.
        mated: how the moving and the fixed part mate, as far as that was found; None for a part whose files state it.
        goal: pose (6,) of the moving part when seated, m and rad.
        start: P(0) (6,), where the nominal trajectory begins, m and rad.
        declared_clearance: on each side along x and y of the B-frame, m; None where the file declares none.
        approach: height of the tilted part's lowest point above the mouth at the start, m.
        start_box: half-widths (6,) of the start error in local coordinates (d, δ), m and rad.
        trapezoid: radius of the ball (m) and half-angle of the cone (rad) of S(t); None for those of the start error.
        sources: where the start box comes from; None when the file gives it outright.
        budget: what each source contributes to the start box; none when the file gives it outright.
        tcp: pose (6,) of the tool's centre point in the frame of the moving part, m and rad.
        cell: what presses are kept clear of.
        plane: the profiles of a planar problem, whose parts are solids of the same contacts; None in space.
    """

    title: str
    path: Path
    sha256: str
    moving: Part
    fixed: Part
    trees: tuple[ObjectTree, ObjectTree]
    moving_feature: str
    fixed_feature: str
    mated: tuple[Mated | None, Mated | None]
    goal: Array
    start: Array
    task: Attributes
    declared_clearance: tuple[float, float] | None
    approach: float
    start_box: Array
    framing: Framing
    trapezoid: tuple[float, float] | None
    sources: Sources | None
    budget: tuple[Contribution, ...]
    tcp: Array
    cell: Surroundings
    plane: Profiles | None
    velocity_error: VelocityError
    specification: Specification
    friction: tuple[float, float]
    robot: RobotProperties
    settings: Settings

    @property
    def stated_box(self) -> Array:
        """Half-widths (6,) of what is stated of the start error: all but what comes with the parts, m and rad."""
        return self.start_box - total([one for one in self.budget if not one.stated])

    def under(self, share: float) -> Problem:
        """The problem with a share of its stated start errors."""
        own = tuple(replace(one, box=share * one.box) if one.stated else one for one in self.budget)
        # Not added up anew: a box that the file gives outright has no budget.
        box = self.start_box - (1.0 - share) * self.stated_box
        # What comes with the parts keeps its size, so that shares of the frames change.
        return replace(self, start_box=box, budget=own, framing=framing(own) if own else self.framing)

    @property
    def peg(self) -> Feature:
        """The mating feature of the moving part."""
        return self.moving.feature(self.moving_feature)

    @property
    def hole(self) -> Feature:
        """The mating feature of the fixed part."""
        return self.fixed.feature(self.fixed_feature)


def load(path: str | PathLike[str]) -> Problem:
    """The problem of a file.

    Raises:
        InputError: with every fault of the file and of its models.
    """
    from fmopt.task.loading import problem_of
    from fmopt.task.toml.source import read

    return problem_of(read(Path(path)))
