"""Rows: signed distances of a real pose, linear in its error up to a bounded remainder.

Around a nominal pose (p, R) a real pose is p + e, exp([ε]×)R. Every distance is

    f = n·p + u·(R k) + (R b)·(M p + s) + c,

with value and gradient N in (e, ε) at zero error; rows with b are bilinear (|b| = 1, |M| ≤ 1). What f differs by from
its linear part, interpolated between the ends of a piece of motion, is bounded in `remainder`.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from typing import NamedTuple

from fmopt.verify.document import Numbers
from fmopt.verify.doubles import doubles
from fmopt.verify.rational import (
    ONE,
    Matrix,
    Row,
    Vector,
    add,
    cross,
    dot,
    exponential,
    length,
    neg,
    sub,
    turned,
    vector,
)
from fmopt.verify.solids import Line, Plane

FREE: Vector = (0, 0, 0)


@dataclass(frozen=True, eq=False)
class Pose:
    """A nominal pose: position, m, and rotation matrix; it remembers the vectors and points that it has turned."""

    p: Vector
    R: Matrix
    _images: dict[Vector, Vector] = field(default_factory=dict, repr=False)
    _placed: dict[Vector, Vector] = field(default_factory=dict, repr=False)

    def turned(self, v: Vector) -> Vector:
        """R v."""
        image = self._images.get(v)
        if image is None:
            image = self._images[v] = turned(self.R, v)
        return image

    @cached_property
    def in_doubles(self) -> tuple[Numbers, tuple[Numbers, ...]]:
        """The nearest floats: p and the rows of R."""
        return doubles(self.p), tuple(doubles(line) for line in self.R)

    def apply(self, v: Vector) -> Vector:
        """The world point of a body point."""
        point = self._placed.get(v)
        if point is None:
            point = self._placed[v] = add(self.p, self.turned(v))
        return point


@lru_cache(maxsize=256)
def pose(x: tuple[float, ...]) -> Pose:
    """The pose of six floats (x, y, z, rotation vector)."""
    return Pose(vector(x[:3]), exponential(vector(x[3:])))


class Bend(NamedTuple):
    """What makes a row bilinear.

    Attributes:
        body: β = R b, a unit vector.
        arm: y = M p + s, m.
        across: the direction e_f across which it feels translations (M = [e_f]×), `FREE` when it feels them all
            (M = −1).
    """

    body: Vector
    arm: Vector
    across: Vector

    def moved(self, x: Vector) -> Vector:
        """M x."""
        return neg(x) if self.across == FREE else cross(self.across, x)

    def columns(self) -> Matrix:
        """M x for the unit vectors x along the axes."""
        if self.across == FREE:
            return ((-ONE, 0, 0), (0, -ONE, 0), (0, 0, -ONE))
        x, y, z = self.across
        return ((0, z, -y), (-z, 0, x), (y, -x, 0))

    def pulled(self, x: Vector) -> Vector:
        """Mᵀ x."""
        return neg(x) if self.across == FREE else cross(x, self.across)


class Distance(NamedTuple):
    """A distance at one pose.

    Attributes:
        f: value.
        N: gradient (6,) in (e, ε).
        reach: |u||k|.
        push: u.
        turned: R k.
        bend: R b, M p + s and M of a bilinear row, None of others.
    """

    f: int
    N: Row
    reach: int
    push: Vector
    turned: Vector
    bend: Bend | None = None


# The functions that distances are taken of. As tuples they differ in their form: none is taken for another.
class PointAbove(NamedTuple):
    """n·(p + R v) − a for a body point at distance `reach` from the origin."""

    plane: Plane
    v: Vector
    reach: int

    def value(self, X: Pose) -> int:
        """The value alone."""
        return self.plane.height(X.apply(self.v))

    def at(self, X: Pose) -> Distance:
        """The distance at a pose."""
        Rv, n = X.turned(self.v), self.plane.normal
        return Distance(self.plane.height(add(X.p, Rv)), n + cross(Rv, n), self.reach, n, Rv)


class DirectionAlong(NamedTuple):
    """u·(R k) for a world vector u and a body vector k, reach ≥ |u||k|."""

    u: Vector
    k: Vector
    reach: int

    def value(self, X: Pose) -> int:
        """The value alone."""
        return dot(self.u, X.turned(self.k))

    def at(self, X: Pose) -> Distance:
        """The distance at a pose."""
        u, Rk = self.u, X.turned(self.k)
        return Distance(dot(u, Rk), (0, 0, 0, *cross(Rk, u)), self.reach, u, Rk)


class FaceAbove(NamedTuple):
    """(R n)·(w − p) − a for a body plane and a world point."""

    plane: Plane
    w: Vector

    def value(self, X: Pose) -> int:
        """The value alone."""
        return dot(X.turned(self.plane.normal), sub(self.w, X.p)) - self.plane.offset

    def at(self, X: Pose) -> Distance:
        """The distance at a pose."""
        Rn, y = X.turned(self.plane.normal), sub(self.w, X.p)
        return Distance(dot(Rn, y) - self.plane.offset, neg(Rn) + cross(Rn, y), 0, FREE, FREE, Bend(Rn, y, FREE))


class EdgesApart(NamedTuple):
    """(R e_m × e_f)·(p + R v − q), q on the fixed line: height of a body point over the plane along both edges.

    Written as (R e_m)·(e_f × (p − q)) + e_f·R(v × e_m).
    """

    moving: Line
    fixed: Line
    v: Vector

    def value(self, X: Pose) -> int:
        """The value alone."""
        e_f, Re, y, Rk = self._terms(X)
        return dot(Re, y) + dot(e_f, Rk)

    def at(self, X: Pose) -> Distance:
        """The distance at a pose."""
        e_f, Re, y, Rk = self._terms(X)
        N = cross(Re, e_f) + add(cross(Re, y), cross(Rk, e_f))
        return Distance(dot(Re, y) + dot(e_f, Rk), N, length(self._k), e_f, Rk, Bend(Re, y, e_f))

    @property
    def _k(self) -> Vector:
        return cross(self.v, self.moving.direction)

    def _terms(self, X: Pose) -> tuple[Vector, Vector, Vector, Vector]:
        e_f = self.fixed.direction
        return e_f, X.turned(self.moving.direction), cross(e_f, sub(X.p, self.fixed.point)), X.turned(self._k)


Function = PointAbove | DirectionAlong | FaceAbove | EdgesApart
