"""Where the uncertain operand 1 may be on a plane: ball, cone and trapezoid, [LeeHuang1985] section 4.1.2.

On the plane U-V the shrunk operand 1 is a line L with the nominal centre Φ at its lower end. Φ strays in a ball of the
max norm, the line's direction Ψ in a cone, and both together sweep the trapezoid. Angles are counter-clockwise on the
plane, from u to v. The cone's metric d₁ is the wrapped angle; unwrapped, a direction of 359° would be 358° from 1°.
"""

import math
from dataclasses import dataclass
from itertools import product
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from fmopt.spatial.values import Array, Bits, Value, frozen

PlaneName = Literal["xz", "yz", "xy"]


@dataclass(frozen=True)
class BasePlane:
    """A plane of the B-frame.

    Args:
        u, v: indices of its axes.
        turn: index of the degree about its normal, 3 to 5.
        sense: 1 where a counter-clockwise turn on the plane is positive about the frame's axis, else −1.
    """

    name: PlaneName
    u: int
    v: int
    turn: int
    sense: int

    @property
    def degrees(self) -> tuple[int, int, int]:
        """The degrees of freedom that the plane shows: along u, along v, about the normal."""
        return self.u, self.v, self.turn


PLANES = (BasePlane("xz", 0, 2, 4, -1), BasePlane("yz", 1, 2, 3, 1), BasePlane("xy", 0, 1, 5, 1))


@dataclass(frozen=True, eq=False)
class ErrorSquare(Value):
    """B[Φ₀] = {Φ : max(|u − u₀|, |v − v₀|) ≤ r}, a square: centre Φ₀ (2,) and radius r in m."""

    centre: Array
    radius: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "centre", frozen(self.centre, 2, name="centre"))
        _not_negative("radius", self.radius)

    def contains(self, points: ArrayLike) -> Bits:
        """Which points (…, 2) lie in it."""
        return np.asarray(np.abs(np.asarray(points) - self.centre).max(axis=-1) <= self.radius)

    @property
    def corners(self) -> Array:
        """(4, 2), counter-clockwise from the lower left."""
        return self.centre + self.radius * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])


@dataclass(frozen=True)
class ErrorCone:
    """C[Ψ₀] = {Ψ : d₁(Ψ, Ψ₀) ≤ s}: the nominal angle Ψ₀ and the half-angle s, rad."""

    centre: float
    half_angle: float

    def __post_init__(self) -> None:
        _not_negative("half-angle", self.half_angle)
        # From a right angle on the lines would cover the plane.
        if self.half_angle >= 0.5 * math.pi:
            raise ValueError(f"half-angle is {self.half_angle} rad, expected less than a right angle")

    def contains(self, angle: float) -> bool:
        """Whether an angle lies in it."""
        return wrapped_distance(angle, self.centre) <= self.half_angle


@dataclass(frozen=True, eq=False)
class Trapezoid(Value):
    """T[Φ₀, Ψ₀] = {L(Φ, Ψ) : Φ ∈ B[Φ₀], Ψ ∈ C[Ψ₀]} for a line of `length` (m) with its lower end in Φ."""

    ball: ErrorSquare
    cone: ErrorCone
    length: float

    def line(self, centre: ArrayLike, angle: float) -> Array:
        """Both ends (2, 2), m, of L(Φ, Ψ), which goes from Φ (2,), m, in its own direction Ψ, rad."""
        start = np.asarray(centre, dtype=np.float64)
        return np.array([start, start + self.length * np.array([math.cos(angle), math.sin(angle)])])

    @property
    def edges(self) -> tuple[Array, Array]:
        """Its edges (2, 2): the lines that reach farthest clockwise and counter-clockwise of the nominal one."""
        return self._edge(-1.0), self._edge(1.0)

    def _edge(self, side: float) -> Array:
        angle = self.cone.centre + side * self.cone.half_angle
        across = side * np.array([-math.sin(angle), math.cos(angle)])
        reach = self.ball.corners @ across
        # Of corners equally far across the one that lies farthest back: the edge begins there.
        farthest = self.ball.corners[reach >= reach.max() - 1e-12 * (1.0 + self.ball.radius)]
        start = farthest[int(np.argmin(farthest @ np.array([math.cos(angle), math.sin(angle)])))]
        return self.line(start, angle)

    @property
    def outline(self) -> Array:
        """The convex hull (k, 2) of all its lines with a straight cap, counter-clockwise."""
        from scipy.spatial import ConvexHull, QhullError

        angles = (self.cone.centre - self.cone.half_angle, self.cone.centre + self.cone.half_angle)
        points = np.vstack([self.line(corner, angle) for corner, angle in product(self.ball.corners, angles)])
        try:
            return np.asarray(points[ConvexHull(points).vertices])
        # Without any error the trapezoid is its line, which has no hull.
        except QhullError:
            return self.line(self.ball.centre, self.cone.centre)


@dataclass(frozen=True)
class Zone:
    """The radii of ball and cone on a plane: r in m, s in rad."""

    plane: BasePlane
    radius: float
    half_angle: float

    def trapezoid(self, centre: ArrayLike, angle: float, length: float) -> Trapezoid:
        """The trapezoid of a line of a length (m) at its nominal place: Φ₀ (2,), m, and Ψ₀, rad."""
        return Trapezoid(
            ErrorSquare(np.asarray(centre, dtype=np.float64), self.radius),
            ErrorCone(angle, self.half_angle),
            length,
        )


def zones(box: ArrayLike) -> tuple[Zone, Zone, Zone]:
    """Ball and cone on the three planes, the smallest that hold a box of pose errors.

    The box is half-widths (6,) of the pose error (d, δ), m and rad: the support along each axis of the error set that
    the stated sources of uncertainty add up to, or given numbers.
    """
    a = frozen(box, 6, name="half-widths")
    # A square and a symmetric cone hold any box: the larger of two half-widths on each plane.
    x, y, z = (Zone(plane, float(max(a[plane.u], a[plane.v])), float(a[plane.turn])) for plane in PLANES)
    return x, y, z


def wrapped_distance(one: float, other: float) -> float:
    """d₁: the smaller of the two angles between two directions (rad, of any turn), 0 to π, rad."""
    return abs(math.remainder(one - other, 2.0 * math.pi))


def _not_negative(name: str, value: float) -> None:
    if not (math.isfinite(value) and value >= 0.0):
        raise ValueError(f"{name} is {value}, expected a finite number that is not negative")
