"""Rows: signed distances of a real pose, linear in its error up to a bounded remainder.

Around a nominal pose (p, R) a real pose is p + e, exp([ε]×)R. Every distance is

    f = n·p + u·(R k) + (R b)·(M p + s) + c,

with value and gradient N in (e, ε) at zero error; rows with b are bilinear (|b| = 1, |M| ≤ 1). What f differs by from
its linear part, interpolated between the ends of a piece of motion, is bounded in `remainder`.
"""

from __future__ import annotations

from typing import NamedTuple

from fmopt.verify.rational import (
    BITS,
    IDENTITY,
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


def point_above(X: Pose, v: Vector, reach: int, plane: Plane) -> Distance:
    """n·(p + R v) − a for a body point at distance `reach` from the origin."""
    Rv = turned(X.R, v)
    n = plane.normal
    return Distance(plane.height(add(X.p, Rv)), n + cross(Rv, n), reach, n, Rv)


def direction_along(X: Pose, u: Vector, k: Vector, reach: int) -> Distance:
    """u·(R k) for a world vector u and a body vector k, reach ≥ |u||k|."""
    Rk = turned(X.R, k)
    return Distance(dot(u, Rk), (0, 0, 0, *cross(Rk, u)), reach, u, Rk)


def face_above(X: Pose, plane: Plane, w: Vector) -> Distance:
    """(R n)·(w − p) − a for a body plane and a world point."""
    Rn = turned(X.R, plane.normal)
    y = sub(w, X.p)
    return Distance(dot(Rn, y) - plane.offset, neg(Rn) + cross(Rn, y), 0, FREE, FREE, Bend(Rn, y, FREE))


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
    return Distance(dot(Re, y) + dot(e_f, Rk), N, length(k), e_f, Rk, Bend(Re, y, e_f))


class Extent(NamedTuple):
    """How far a piece of motion and its errors reach.

    Attributes:
        spin: τ (3,), the nominal turn, rad.
        turn: |τ|, rounded up.
        travel: Δ (3,), m.
        theta: bound of |ε|, rad.
        angles: half-widths (3,) of the box of ε, rad.
        box: half-widths (3,) of the box of e, m.
    """

    spin: Vector
    turn: int
    travel: Vector
    theta: int
    angles: Vector
    box: Vector

    def standing(self) -> Extent:
        """The same errors without the motion."""
        return self._replace(spin=FREE, turn=0, travel=FREE)

    def crossing(self, v: Vector) -> int:
        """A bound of |ε × v|."""
        return min(length(_box_cross(v, self.angles)), times(self.theta, length(v)) + 1)


def size(start: Distance, goal: Distance) -> int:
    """The larger |u||k| + |M p + s| of both ends."""
    found = max(start.reach, goal.reach)
    if start.bend is not None and goal.bend is not None:
        found += max(length(start.bend.arm), length(goal.bend.arm))
    return found


def remainder(start: Distance, goal: Distance, extent: Extent) -> int:
    """How much a row may differ from its linear part, interpolated between both ends of a piece, at most.

    A turn by ε adds ε × w and what is left of it, −∫(1 − t)(ε × exp(−tε)u)·(ε × w) dt for u·w: no more than
    |ε × u||ε × w|/2. The nominal arc is off its chord by |τ × u||τ × w|/8 at most, and the gradient's turn, weighted
    2s(1 − s) ≤ 1/2 between the ends, leaves |ε × u||τ × w|/2.
    """
    if start.bend is not None and goal.bend is not None:
        return min(_bent(start, goal, start.bend, goal.bend, extent), coarse(start, goal, extent))
    u, swept = start.push, length(cross(extent.spin, start.turned))
    swung = max(extent.crossing(start.turned), extent.crossing(goal.turned)) + (times(extent.theta, swept) >> 1)
    swung = min(swung, times(extent.theta, length(start.turned)) + 1)
    leaned = length(cross(extent.spin, u))
    return (times(extent.crossing(u), swung + swept) >> 1) + (times(leaned, swept) >> 3) + 8


def coarse(start: Distance, goal: Distance, extent: Extent) -> int:
    """A quick bound of what a row differs by from its linear part, never less than `remainder`.

    κ (|u||k| + |M p + s|) with κ = θ²/2 + τ²/8 + τθ/2, and θD + τΔ/4 + τD/2 + Δθ/2 of a bilinear row, |M e| ≤ D.
    """
    t, a = extent.turn, extent.theta
    kappa = (times(a, a) >> 1) + (times(t, t) >> 3) + (times(t, a) >> 1) + 3
    found = times(kappa, size(start, goal)) + 9
    if start.bend is not None:
        D, travel = _felt(start.bend, extent), length(start.bend.moved(extent.travel))
        found += times(a, D) + (times(t, travel) >> 2) + (times(t, D) >> 1) + (times(travel, a) >> 1) + 8
    return found


def _bent(start: Distance, goal: Distance, first: Bend, second: Bend, extent: Extent) -> int:
    """The bound of a bilinear row u·w + β·y by its second derivatives, w = R k.

    In ε these are w uᵀ + β yᵀ, made symmetric, less the trace on the diagonal; in ε and e, ε·(β × M e). Both are taken
    at the ends. Between an end and the middle of the piece β and w turn by τ/2, y moves by MΔ/2. The path's slope f′
    and the gradient N change at the rate N′ along the twist.
    """
    t, a, far = extent.turn, extent.theta, size(start, goal)
    D, travel = _felt(first, extent), length(first.moved(extent.travel))
    ends = ((start, first), (goal, second))
    least = max(_second(d, b, extent) for d, b in ends)
    rates = [_rate(d, b, extent) for d, b in ends]
    arc = max(abs(dot(d, extent.travel) + dot(e, extent.spin)) for d, e in rates) >> 3
    arc += times(times(t, t), times(t, far) + 3 * travel) >> 4
    turning = sum(_box_dot(d, extent.box) + _box_dot(e, extent.angles) for d, e in rates) >> 2
    # Third order: the rest of exp(ε); the real y is M e farther; second derivatives between the ends; and N″.
    third = times(times(a, a), times(a // 6 + (t >> 2), far) + (D >> 1) + (travel >> 2)) + (times(times(a, t), D) >> 1)
    third += times(t, times(times(a, t), far) + times(t, D) + 2 * times(a, travel)) >> 3
    return least + arc + turning + third + 64


def _second(d: Distance, bend: Bend, extent: Extent) -> int:
    """What second derivatives at one end come to in the box of errors, at most."""
    (u, w), (beta, y), h = (d.push, d.turned), (bend.body, bend.arm), extent.angles
    trace = dot(u, w) + dot(beta, y)
    total = 0
    for i in range(3):
        for j in range(3):
            outer = w[i] * u[j] + w[j] * u[i] + beta[i] * y[j] + beta[j] * y[i]
            entry = abs((outer >> BITS) - (2 * trace if i == j else 0)) + 2
            total += times(times(entry, h[i]), h[j]) >> 2
    for axis, width in zip(IDENTITY, extent.box, strict=True):
        total += times(width, _box_dot(cross(beta, bend.moved(axis)), h))
    return total


def _rate(d: Distance, bend: Bend, extent: Extent) -> tuple[Vector, Vector]:
    """N′, how the gradient changes along the twist: in e and in ε."""
    swept, leaned = cross(extent.spin, d.turned), cross(extent.spin, bend.body)
    turning = add(cross(swept, d.push), cross(leaned, bend.arm))
    return bend.pulled(leaned), add(turning, cross(bend.body, bend.moved(extent.travel)))


def _felt(bend: Bend, extent: Extent) -> int:
    """A bound of |M e|."""
    return length(extent.box) if bend.across == FREE else length(_box_cross(bend.across, extent.box))


def _box_dot(v: Vector, half: Vector) -> int:
    """The largest v·x for x in a box of half-widths."""
    return times(abs(v[0]), half[0]) + times(abs(v[1]), half[1]) + times(abs(v[2]), half[2]) + 3


def _box_cross(v: Vector, half: Vector) -> Vector:
    """Bounds of the sizes of v × x for x in a box of half-widths."""
    x, y, z = abs(v[0]), abs(v[1]), abs(v[2])
    a, b, c = half
    return (times(z, b) + times(y, c) + 2, times(z, a) + times(x, c) + 2, times(y, a) + times(x, b) + 2)
