"""Rows: signed distances of a real pose, linear in its error up to a bounded remainder.

Around a nominal pose (p, R) a real pose is p + e, exp([ε]×)R. Every distance is

    f = n·p + u·(R k) + (R b)·(M p + s) + c,

with value and gradient N in (e, ε) at zero error, `reach` = |u||k| and, for rows with b (bilinear ones, |b| = 1,
|M| ≤ 1), `swing` = |M p + s|. Over a piece of motion from S to G that turns by τ and travels Δ, with |ε| ≤ θ and
|M e| ≤ D all along, f differs from its linear part, interpolated between the ends, by at most

    κ·(reach + swing) + [bilinear] (θD + τΔ/4 + τD/2 + Δθ/2),   κ = θ²/2 + τ²/8 + τθ/2:

exp([ε]×) against 1 + [ε]×: θ²/2; the arc of the nominal turn against its chord: τ²/8; the turn of the gradient between
the ends, weighted 2s(1−s) ≤ 1/2: τθ/2; and the same three for the product of a turning and a moving factor.
"""

from __future__ import annotations

from typing import NamedTuple

from fmopt.verify.rational import (
    Matrix,
    Row,
    Vector,
    add,
    cross,
    dot,
    exponential,
    length,
    neg,
    scaled,
    sub,
    times,
    turned,
    vector,
)
from fmopt.verify.solids import Line, Plane

FREE: Vector = (0, 0, 0)


class Pose(NamedTuple):
    """A nominal pose: position, m, and rotation matrix."""

    p: Vector
    R: Matrix

    def apply(self, v: Vector) -> Vector:
        """The world point of a body point."""
        return add(self.p, turned(self.R, v))


def pose(x: tuple[float, ...]) -> Pose:
    """The pose of six floats (x, y, z, rotation vector)."""
    return Pose(vector(x[:3]), exponential(vector(x[3:])))


class Distance(NamedTuple):
    """A distance at one pose.

    Attributes:
        f: value.
        N: gradient (6,) in (e, ε).
        reach: |u||k|.
        swing: |M p + s| of a bilinear row, else 0.
        across: for a bilinear row the direction e_f across which it feels translations (M = [e_f]×), `FREE` when it
            feels them all.
        bilinear: whether the row is bilinear.
    """

    f: int
    N: Row
    reach: int
    swing: int
    across: Vector
    bilinear: bool


def point_above(X: Pose, v: Vector, reach: int, plane: Plane) -> Distance:
    """n·(p + R v) − a for a body point at distance `reach` from the origin."""
    Rv = turned(X.R, v)
    n = plane.normal
    return Distance(plane.height(add(X.p, Rv)), n + cross(Rv, n), reach, 0, FREE, False)


def direction_along(X: Pose, u: Vector, k: Vector, reach: int) -> Distance:
    """u·(R k) for a world vector u and a body vector k, reach ≥ |u||k|."""
    Rk = turned(X.R, k)
    return Distance(dot(u, Rk), (0, 0, 0, *cross(Rk, u)), reach, 0, FREE, False)


def face_above(X: Pose, plane: Plane, w: Vector) -> Distance:
    """(R n)·(w − p) − a for a body plane and a world point."""
    Rn = turned(X.R, plane.normal)
    y = sub(w, X.p)
    return Distance(dot(Rn, y) - plane.offset, neg(Rn) + cross(Rn, y), 0, length(y), FREE, True)


def edges_apart(X: Pose, moving: Line, fixed: Line, v: Vector) -> Distance:
    """(R e_m × e_f)·(p + R v − q), q on the fixed line: height of a body point over the plane along both edges.

    Written as (R e_m)·(e_f × (p − q)) + e_f·R(v × e_m).
    """
    e_f = fixed.direction
    Re = turned(X.R, moving.direction)
    y = cross(e_f, sub(X.p, fixed.point))
    k = cross(v, moving.direction)
    Rk = turned(X.R, k)
    N = cross(Re, e_f) + add(cross(Re, y), cross(Rk, e_f))
    return Distance(dot(Re, y) + dot(e_f, Rk), N, length(k), length(y), e_f, True)


class Extent(NamedTuple):
    """How far a piece of motion and its errors reach: τ, Δ, θ, half-widths of the box of e; and κ.

    Attributes:
        turn: τ, rad.
        travel: Δ (3,), m.
        theta: bound of |ε|, rad.
        box: half-widths (3,) around the translation error, m.
    """

    turn: int
    travel: Vector
    theta: int
    box: Vector

    @property
    def kappa(self) -> int:
        """κ."""
        t, a = self.turn, self.theta
        return (times(a, a) >> 1) + (times(t, t) >> 3) + (times(t, a) >> 1) + 3

    def standing(self) -> Extent:
        """The same errors without the motion."""
        return Extent(0, (0, 0, 0), self.theta, self.box)

    def product(self, across: Vector) -> int:
        """The second bracket of the remainder, for a row that feels translations across a direction."""
        if across == FREE:
            D, travel = length(self.box), length(self.travel)
        else:
            x, y, z = abs(across[0]), abs(across[1]), abs(across[2])
            a, b, c = self.box
            D = length((times(z, b) + times(y, c), times(z, a) + times(x, c), times(y, a) + times(x, b)))
            travel = length(cross(across, self.travel))
        t, a = self.turn, self.theta
        return times(a, D) + (times(t, travel) >> 2) + (times(t, D) >> 1) + (times(travel, a) >> 1) + 8


def remainder(start: Distance, goal: Distance, extent: Extent, kappa: int) -> int:
    """The bound of the module's formula, rounded up; reach and swing the larger of both ends."""
    size = max(start.reach, goal.reach) + max(start.swing, goal.swing)
    extra = extent.product(start.across) if start.bilinear else 0
    return times(kappa, size) + extra + 1


def weighed(d: Distance, factor: int) -> Distance:
    """A distance times a positive factor."""
    N = scaled(factor, d.N[:3]) + scaled(factor, d.N[3:])
    return d._replace(f=times(factor, d.f), N=N, reach=times(factor, d.reach) + 1)
