"""Sources of uncertainty, each its own type, and what they add up to for a point, [BasanezSuarez] eqs. (1)-(11).

A problem states sources; the sums ε_a, ε_pg, ε_φg, ε_prpgv, ε_φrφg come from here, with the share of each source.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import TypeAlias, assert_never

import numpy as np
from numpy.typing import ArrayLike

from fmopt.errors import GeometryError
from fmopt.spatial.values import Array, Value, frozen


def require(**numbers: float) -> None:
    """Refuses numbers that are negative or not finite.

    Raises:
        ValueError: one is; the message has its name.
    """
    for name, number in numbers.items():
        if not (math.isfinite(number) and number >= 0.0):
            raise ValueError(f"{name} is {number}, expected a finite number that is not negative")


@dataclass(frozen=True)
class Shape:
    """ε_v (m): any point of an object lies within this of its model, eq. (1)."""

    epsilon_v: float = 0.0

    def __post_init__(self) -> None:
        require(epsilon_v=self.epsilon_v)


@dataclass(frozen=True)
class Measurement:
    """ε_m (m): a point of a static object lies within this of where a sensor saw it, eq. (2)."""

    epsilon_m: float = 0.0

    def __post_init__(self) -> None:
        require(epsilon_m=self.epsilon_m)


@dataclass(frozen=True)
class KnownConfiguration:
    """ε_pp (m): an object's configuration is known a priori; each of its points lies within this of its place.

    The orientation needs no bound of its own.
    """

    epsilon_pp: float = 0.0

    def __post_init__(self) -> None:
        require(epsilon_pp=self.epsilon_pp)


@dataclass(frozen=True, eq=False)
class ObservedConfiguration(Value):
    """ε_pp (m) and ε_φp (rad), independent: position of the point `about` (2,), and orientation about it.

    It also describes an object that a robot has put down; `about` is the grasping point then.
    """

    epsilon_pp: float = 0.0
    epsilon_phi_p: float = 0.0
    about: Array = field(default_factory=lambda: frozen((0.0, 0.0)))

    def __post_init__(self) -> None:
        require(epsilon_pp=self.epsilon_pp, epsilon_phi_p=self.epsilon_phi_p)
        object.__setattr__(self, "about", frozen(self.about, 2, name="about"))


@dataclass(frozen=True, eq=False)
class ObservedPoints(Value):
    """ε_m (m) at two points of an object (2,), from which position and orientation follow: dependent parameters.

    Raises:
        GeometryError: the two points are one.
    """

    first: Array
    second: Array
    epsilon_m: float = 0.0

    def __post_init__(self) -> None:
        require(epsilon_m=self.epsilon_m)
        for name in ("first", "second"):
            object.__setattr__(self, name, frozen(getattr(self, name), 2, name=f"{name} observed point"))
        if not self.length > 0.0:
            raise GeometryError(f"both observed points are {self.first.tolist()} m", "observe two different points")

    @property
    def length(self) -> float:
        """Distance between the points, m."""
        return math.hypot(*(self.second - self.first))


@dataclass(frozen=True)
class Robot:
    """ε_pr (m) and ε_φr (rad) of the end effector, eqs. (3), (4)."""

    epsilon_pr: float = 0.0
    epsilon_phi_r: float = 0.0

    def __post_init__(self) -> None:
        require(epsilon_pr=self.epsilon_pr, epsilon_phi_r=self.epsilon_phi_r)


@dataclass(frozen=True)
class Slide:
    """ε_td (m) and ε_φd (rad): the object's slide in the gripper, along and about the grasping point."""

    epsilon_td: float = 0.0
    epsilon_phi_d: float = 0.0

    def __post_init__(self) -> None:
        require(epsilon_td=self.epsilon_td, epsilon_phi_d=self.epsilon_phi_d)


Configuration: TypeAlias = KnownConfiguration | ObservedConfiguration | ObservedPoints


@dataclass(frozen=True)
class StaticSources:
    """What makes a static object uncertain: its shape and configuration, or each point measured by itself."""

    shape: Shape = Shape()
    configuration: Configuration | Measurement = KnownConfiguration()


@dataclass(frozen=True, eq=False)
class GraspedSources(Value):
    """What makes a grasped object uncertain; the robot counts when it grasps and again when it moves.

    Args:
        shape: of the object.
        grasp: grasping point (2,) in the frame of `configuration`, m.
    """

    shape: Shape = Shape()
    configuration: Configuration = KnownConfiguration()
    robot: Robot = Robot()
    slide: Slide = Slide()
    grasp: Array = field(default_factory=lambda: frozen((0.0, 0.0)))

    def __post_init__(self) -> None:
        object.__setattr__(self, "grasp", frozen(self.grasp, 2, name="grasping point"))


@dataclass(frozen=True)
class Share:
    """What one source adds to the deviation of a position (m) and of an orientation (rad)."""

    source: str
    symbol: str
    position: float
    angle: float = 0.0


@dataclass(frozen=True)
class Budget:
    """Shares that add up to a deviation."""

    shares: tuple[Share, ...]

    @property
    def position(self) -> float:
        """Sum of the positions, m."""
        return math.fsum(share.position for share in self.shares)

    @property
    def angle(self) -> float:
        """Sum of the orientations, rad."""
        return math.fsum(share.angle for share in self.shares)

    def fractions(self) -> tuple[tuple[str, float, float], ...]:
        """For each share its symbol and its part of both sums, 0 where a sum is 0."""
        p, a = self.position, self.angle
        return tuple((s.symbol, s.position / p if p else 0.0, s.angle / a if a else 0.0) for s in self.shares)


@dataclass(frozen=True, eq=False)
class Deviations(Value):
    """The sums that contact sets are made of.

    Args:
        static: ε_a (n,) of each vertex of the static object, m.
        position: ε_prpgv of any point of the grasped object, m.
        angle: ε_φrφg, rad.
        shape: ε_v of the grasped object, which alone turns its edges beyond ε_φrφg, m.
    """

    static: Array
    position: float
    angle: float
    shape: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "static", frozen(self.static, None, name="ε_a"))
        require(position=self.position, angle=self.angle, shape=self.shape, static=float(self.static.min(initial=0.0)))


def deviations(static: StaticSources, vertices: ArrayLike, grasped: GraspedSources) -> Deviations:
    """The sums of all sources for a static object with these vertices (n, 2) in m and a grasped object.

    The deviation of a point of an edge is at most the greater one of its ends.

    Args:
        vertices: (n, 2), m, of that object.
    """
    points = frozen(vertices, None, 2, name="vertices of the static object")
    moving = grasped_budget(grasped)
    epsilon_a = [static_budget(static, point).position for point in points]
    return Deviations(np.array(epsilon_a), moving.position, moving.angle, grasped.shape.epsilon_v)


def static_budget(static: StaticSources, point: ArrayLike) -> Budget:
    """Shares of ε_a at a point (2,) of the static object: ε_v + ε_pp, with what a turn moves it by, or ε_m alone.

    Args:
        point: (2,), m, of that object.
    """
    match static.configuration:
        case Measurement(epsilon_m):
            return Budget((Share("measurement", "ε_m", epsilon_m),))
        case configuration:
            shares = _configuration_shares(configuration, frozen(point, 2, name="point"))
            # A turn of the static object is in where it moves the point: nothing else of it is asked of a point.
            return Budget((Share("shape", "ε_v", static.shape.epsilon_v), *(_unturned(share) for share in shares)))


def gripper_budget(grasped: GraspedSources) -> Budget:
    """Shares of ε_pg and ε_φg, of the object in the gripper: ε_pr + ε_pp + ε_td, and ε_φr + ε_φp + ε_φd.

    The paper leaves ε_φp out, as it takes the object's configuration as known a priori.
    """
    robot, slide = grasped.robot, grasped.slide
    return Budget(
        (
            Share("robot, grasping", "ε_pr, ε_φr", robot.epsilon_pr, robot.epsilon_phi_r),
            *_configuration_shares(grasped.configuration, grasped.grasp),
            Share("slide in the gripper", "ε_td, ε_φd", slide.epsilon_td, slide.epsilon_phi_d),
        )
    )


def grasped_budget(grasped: GraspedSources) -> Budget:
    """Shares of ε_prpgv = ε_pr + ε_pg + ε_v, eq. (10), and of ε_φrφg = ε_φr + ε_φg, eq. (11)."""
    robot = grasped.robot
    return Budget(
        (
            Share("robot, moving", "ε_pr, ε_φr", robot.epsilon_pr, robot.epsilon_phi_r),
            *gripper_budget(grasped).shares,
            Share("shape", "ε_v", grasped.shape.epsilon_v),
        )
    )


def placed(grasped: GraspedSources) -> ObservedConfiguration:
    """The configuration of an object that the robot grasped as stated and then put down, about the grasping point.

    Position ε_pr + ε_pg, orientation ε_φr + ε_φg. An object that the robot handles several times goes through this
    once for each; where it is grasped at another point, turns about the former one add to its position there.
    """
    in_gripper, robot = gripper_budget(grasped), grasped.robot
    # Putting down adds the robot's own deviation once more, after what the gripper holds.
    position, angle = in_gripper.position + robot.epsilon_pr, in_gripper.angle + robot.epsilon_phi_r
    return ObservedConfiguration(position, angle, grasped.grasp)


def placed_in_turn(first: Configuration, handlings: Iterable[GraspedSources]) -> Configuration:
    """The configuration after several handlings in turn; what each states as its configuration does not count.

    Args:
        handlings: in order.
    """
    configuration = first
    for handling in handlings:
        configuration = placed(
            GraspedSources(handling.shape, configuration, handling.robot, handling.slide, handling.grasp)
        )
    return configuration


def _configuration_shares(configuration: Configuration, point: Array) -> tuple[Share, ...]:
    """How far a configuration's deviations move a point (2,), and turn the object about it."""
    match configuration:
        case KnownConfiguration(epsilon_pp):
            return (Share("configuration, known a priori", "ε_pp", epsilon_pp),)
        case ObservedConfiguration(epsilon_pp, epsilon_phi_p, about):
            # A turn by up to ε_φp moves the point along an arc, its chord is what it moves by.
            lever = math.hypot(*(point - about))
            chord = 2.0 * lever * math.sin(0.5 * min(epsilon_phi_p, math.pi))
            return (
                Share("configuration, position", "ε_pp", epsilon_pp),
                Share("configuration, orientation", "ε_φp", chord, epsilon_phi_p),
            )
        case ObservedPoints(first, second, epsilon_m):
            # A rigid motion is complex affine: x moves by (1 − z) d₁ + z d₂ with z = (x − q₁) / (q₂ − q₁).
            levers = math.hypot(*(point - first)) + math.hypot(*(point - second))
            turn = edge_turn(epsilon_m, configuration.length)
            return (Share("configuration, observed points", "ε_m", epsilon_m * levers / configuration.length, turn),)
    assert_never(configuration)


def edge_turn(epsilon: float, length: float) -> float:
    """Greatest turn (rad) of an edge of this length whose ends each move by up to ε: arcsin(2ε/L), π once 2ε ≥ L.

    Eqs. (31)-(33) have 2ε/L, which is less. From 2ε = L on the ends can change places.

    Args:
        epsilon: of each end, m.
        length: of the edge, m.
    """
    # Two ends displaced against each other by 2 ε at right angles to the chord; from L on they may change places.
    return math.asin(2.0 * epsilon / length) if 2.0 * epsilon < length else math.pi


def _unturned(share: Share) -> Share:
    return Share(share.source, share.symbol, share.position)
