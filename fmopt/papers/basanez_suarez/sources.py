"""Sources of uncertainty in the plane and what they add up to for a point, [BasanezSuarez] eqs. (1)-(11).

The sums are ε_a of a static object, ε_pg and ε_φg of an object in the gripper, ε_prpgv and ε_φrφg of one that the robot
moves. `fmopt.task.sources` has the same sums in space, with the share of each source.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from fmopt.errors import GeometryError
from fmopt.spatial.values import Array, Value, frozen


def require(**numbers: float) -> None:
    """Refuse numbers that are negative or not finite.

    Raises:
        ValueError: one is; the message has its name.
    """
    for name, number in numbers.items():
        if not (math.isfinite(number) and number >= 0.0):
            raise ValueError(f"{name} is {number}, expected a finite number that is not negative")


@dataclass(frozen=True, eq=False)
class Deviation(Value):
    """ε_p (m) and ε_φ (rad), independent: of a robot, of the slide in a gripper, or of an object's configuration.

    A configuration known a priori has ε_pp alone, for each point of the object. One that was observed, or that a robot
    has put down, has ε_pp of the point `about` (2,), m, and ε_φp.
    """

    position: float = 0.0
    angle: float = 0.0
    about: Array = field(default_factory=lambda: frozen((0.0, 0.0)))

    def __post_init__(self) -> None:
        require(position=self.position, angle=self.angle)
        object.__setattr__(self, "about", frozen(self.about, 2, name="about"))

    def at(self, point: ArrayLike) -> "Deviation":
        """The deviation of another point (2,), m: a turn by up to ε_φ moves it by up to the chord of its arc."""
        lever = math.hypot(*(np.asarray(point) - self.about))
        chord = 2.0 * lever * math.sin(0.5 * min(self.angle, math.pi))
        return Deviation(self.position + chord, self.angle, frozen(point))


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

    def at(self, point: ArrayLike) -> Deviation:
        """The deviation of a point x (2,), m: it moves by (1 − z) d₁ + z d₂, z = (x − q₁) / (q₂ − q₁) complex."""
        levers = sum(math.hypot(*(np.asarray(point) - q)) for q in (self.first, self.second))
        turn = edge_turn(self.epsilon_m, self.length)
        return Deviation(self.epsilon_m * levers / self.length, turn, frozen(point))


Configuration: TypeAlias = Deviation | ObservedPoints


@dataclass(frozen=True, eq=False)
class Grasped(Value):
    """A grasped object; the robot counts when it grasps and again when it moves.

    Args:
        shape: ε_v, m.
        configuration: before the grasp.
        robot: ε_pr and ε_φr, eqs. (3), (4).
        slide: ε_td and ε_φd, along and about the grasping point.
        grasp: grasping point (2,) in the frame of `configuration`, m.
    """

    shape: float = 0.0
    configuration: Configuration = Deviation()
    robot: Deviation = Deviation()
    slide: Deviation = Deviation()
    grasp: Array = field(default_factory=lambda: frozen((0.0, 0.0)))

    def __post_init__(self) -> None:
        require(shape=self.shape)
        object.__setattr__(self, "grasp", frozen(self.grasp, 2, name="grasping point"))

    @property
    def in_gripper(self) -> Deviation:
        """ε_pg = ε_pr + ε_pp + ε_td and ε_φg = ε_φr + ε_φp + ε_φd; the paper has no ε_φp of what it knows a priori."""
        return _total([self.robot, self.configuration.at(self.grasp), self.slide], self.grasp)

    @property
    def placed(self) -> Deviation:
        """Its configuration after the robot has put it down, about the grasping point: ε_pr + ε_pg, ε_φr + ε_φg.

        An object that is handled several times goes through this once for each.
        """
        return _total([self.robot, self.in_gripper], self.grasp)

    @property
    def moved(self) -> Deviation:
        """ε_prpgv = ε_pr + ε_pg + ε_v of any point, eq. (10), and ε_φrφg = ε_φr + ε_φg, eq. (11)."""
        return _total([self.placed, Deviation(self.shape)], self.grasp)


def _total(parts: Sequence[Deviation], about: Array) -> Deviation:
    return Deviation(math.fsum(part.position for part in parts), math.fsum(part.angle for part in parts), about)


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


def deviations(shape: float, configuration: Configuration, vertices: ArrayLike, grasped: Grasped) -> Deviations:
    """The sums of all sources, with ε_a = ε_v + ε_pp at each vertex, eq. (1).

    Where each point is measured by itself, eq. (2), ε_a = ε_m is the `shape` of an exact configuration. The deviation
    of a point of an edge is at most the greater one of its ends. The shape ε_v (m), the configuration and the vertices
    (n, 2), m, are those of the static object.
    """
    points = frozen(vertices, None, 2, name="vertices of the static object")
    epsilon_a = [shape + configuration.at(point).position for point in points]
    return Deviations(np.array(epsilon_a), grasped.moved.position, grasped.moved.angle, grasped.shape)


def edge_turn(epsilon: float, length: float) -> float:
    """Greatest turn (rad) of an edge of this length whose ends each move by up to ε: arcsin(2ε/L), π once 2ε ≥ L.

    Both are in m. Eqs. (31)-(33) have 2ε/L, which is less. From 2ε = L on the ends can change places.
    """
    # Two ends displaced against each other by 2 ε at right angles to the chord; from L on they may change places.
    return math.asin(2.0 * epsilon / length) if 2.0 * epsilon < length else math.pi
