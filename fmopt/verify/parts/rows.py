"""Rows: signed distances of a real pose, linear in its error up to a bounded remainder.

Around a nominal pose (p, R) a real pose is p + e, exp([ε]×)R. Every distance is

    f = n·p + u·(R k) + (R b)·(M p + s) + c,

with value and gradient N in (e, ε) at zero error; rows with b are bilinear (|b| = 1, |M| ≤ 1). What f differs by from
its linear part, interpolated between the ends of a piece of motion, is bounded in `remainder`.

How much rows differ from their linear parts over a piece of motion and its errors.

A row's linear part is interpolated between the ends of the piece; `remainder` bounds what is left, with everything that
it asks of the same vectors remembered by the `Spread` of the piece.
"""

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import NamedTuple

from fmopt.verify.arithmetic.rational import (
    BITS,
    ONE,
    Matrix,
    Row,
    Vector,
    add,
    cross,
    dot,
    doubles,
    exponential,
    length,
    neg,
    sub,
    times,
    turned,
    vector,
)
from fmopt.verify.parts.solids import Line, Plane
from fmopt.verify.reading.reader import Numbers
from fmopt.verify.remembered import remembered

FREE: Vector = (0, 0, 0)


@dataclass(frozen=True, eq=False)
class CheckedPose:
    """A nominal pose: position, m, and rotation matrix; it remembers the vectors and points that it has turned."""

    p: Vector
    R: Matrix

    @remembered
    def turned(self, v: Vector) -> Vector:
        """R v."""
        return turned(self.R, v)

    @cached_property
    def in_doubles(self) -> tuple[Numbers, tuple[Numbers, ...]]:
        """The nearest floats: p and the rows of R."""
        return doubles(self.p), tuple(doubles(line) for line in self.R)

    @remembered
    def apply(self, v: Vector) -> Vector:
        """The world point of a body point."""
        return add(self.p, self.turned(v))


@lru_cache(maxsize=256)
def pose(x: tuple[float, ...]) -> CheckedPose:
    """The pose of six floats (x, y, z, rotation vector)."""
    # Poses come again with each neighbour of a segment: what was turned for one serves the next.
    return CheckedPose(vector(x[:3]), exponential(vector(x[3:])))


class Bend(NamedTuple):
    """What makes a row bilinear."""

    body: Vector  # β = R b, a unit vector
    arm: Vector  # y = M p + s, m
    # The direction e_f across which it feels translations (M = [e_f]×), `FREE` when it feels them all (M = −1)
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
    """A distance at one pose."""

    f: int
    N: Row  # gradient (6,) in (e, ε)
    reach: int  # |u||k|
    push: Vector  # u
    turned: Vector  # R k
    bend: Bend | None = None  # R b, M p + s and M of a bilinear row, None of others


# The functions that distances are taken of. As tuples they differ in their form: none is taken for another.
class PointAbove(NamedTuple):
    """n·(p + R v) − a for a body point at distance `reach` from the origin."""

    plane: Plane
    v: Vector
    reach: int

    def value(self, X: CheckedPose) -> int:
        """The value alone."""
        return self.plane.height(X.apply(self.v))

    def at(self, X: CheckedPose) -> Distance:
        """The distance at a pose."""
        Rv, n = X.turned(self.v), self.plane.normal
        return Distance(self.plane.height(add(X.p, Rv)), n + cross(Rv, n), self.reach, n, Rv)


class DirectionAlong(NamedTuple):
    """u·(R k) for a world vector u and a body vector k, reach ≥ |u||k|."""

    u: Vector
    k: Vector
    reach: int

    def value(self, X: CheckedPose) -> int:
        """The value alone."""
        return dot(self.u, X.turned(self.k))

    def at(self, X: CheckedPose) -> Distance:
        """The distance at a pose."""
        u, Rk = self.u, X.turned(self.k)
        return Distance(dot(u, Rk), (0, 0, 0, *cross(Rk, u)), self.reach, u, Rk)


class FaceAbove(NamedTuple):
    """(R n)·(w − p) − a for a body plane and a world point."""

    plane: Plane
    w: Vector

    def value(self, X: CheckedPose) -> int:
        """The value alone."""
        return dot(X.turned(self.plane.normal), sub(self.w, X.p)) - self.plane.offset

    def at(self, X: CheckedPose) -> Distance:
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

    def value(self, X: CheckedPose) -> int:
        """The value alone."""
        e_f, Re, y, Rk = self._terms(X)
        return dot(Re, y) + dot(e_f, Rk)

    def at(self, X: CheckedPose) -> Distance:
        """The distance at a pose."""
        e_f, Re, y, Rk = self._terms(X)
        N = cross(Re, e_f) + add(cross(Re, y), cross(Rk, e_f))
        return Distance(dot(Re, y) + dot(e_f, Rk), N, length(self._k), e_f, Rk, Bend(Re, y, e_f))

    @property
    def _k(self) -> Vector:
        return cross(self.v, self.moving.direction)

    def _terms(self, X: CheckedPose) -> tuple[Vector, Vector, Vector, Vector]:
        e_f = self.fixed.direction
        return e_f, X.turned(self.moving.direction), cross(e_f, sub(X.p, self.fixed.point)), X.turned(self._k)


Function = PointAbove | DirectionAlong | FaceAbove | EdgesApart


@dataclass(frozen=True, eq=False)
class Spread:
    """How far a piece of motion and its errors reach."""

    spin: Vector  # τ (3,), the nominal turn, rad
    turn: int  # |τ|, rounded up
    travel: Vector  # Δ (3,), m
    theta: int  # bound of |ε|, rad
    angles: Vector  # half-widths (3,) of the box of ε, rad
    box: Vector  # half-widths (3,) of the box of e, m

    @cached_property
    def standing(self) -> "Spread":
        """The same errors without the motion."""
        return Spread(FREE, 0, FREE, self.theta, self.angles, self.box)

    @cached_property
    def offset(self) -> int:
        """A bound of |e|."""
        return length(self.box)

    @cached_property
    def kappa(self) -> int:
        """θ²/2 + τ²/8 + τθ/2: by what share of a row's size it leaves its linear part, at most."""
        t, a = self.turn, self.theta
        return (times(a, a) >> 1) + (times(t, t) >> 3) + (times(t, a) >> 1) + 3  # a unit for each product cut off

    @cached_property
    def corner(self) -> tuple[tuple[int, int, int], ...]:
        """Places (i, j ≥ i) of a symmetric matrix A, with what |Aᵢⱼ| adds to ε·A ε / 4, rounded up."""
        h, places = self.angles, ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))  # off the diagonal twice each
        return tuple((i, j, (times(h[i], h[j]) >> (2 if i == j else 1)) + 1) for i, j in places)

    @remembered
    def crossing(self, v: Vector) -> int:
        """A bound of |ε × v|."""
        # By components of the box, or by lengths: either may be smaller.
        return min(length(_box_cross(v, self.angles)), times(self.theta, length(v)) + 1)

    @remembered
    def swing(self, start: Vector, goal: Vector) -> tuple[int, int]:
        """Bounds of |ε × w| anywhere on the way of a body vector w, m, as it is turned at both ends, and of |τ × w|."""
        swept = self.swept(start)
        # On its arc, which is |τ × w| long, w is no farther from the nearer end than half of that.
        swung = max(self.crossing(start), self.crossing(goal)) + (times(self.theta, swept) >> 1)
        return min(swung, times(self.theta, length(start)) + 1), swept

    @remembered
    def swept(self, v: Vector) -> int:
        """|τ × v|."""
        return length(cross(self.spin, v))


def size(start: Distance, goal: Distance) -> int:
    """The larger |u||k| + |M p + s| of both ends."""
    found = max(start.reach, goal.reach)
    if start.bend is not None and goal.bend is not None:
        found += max(length(start.bend.arm), length(goal.bend.arm))
    return found


def remainder(start: Distance, goal: Distance, extent: Spread) -> int:
    """How much a row may differ from its linear part, interpolated between both ends of a piece, at most.

    A turn by ε adds ε × w and what is left of it, −∫(1 − t)(ε × exp(−tε)u)·(ε × w) dt for u·w: no more than
    |ε × u||ε × w|/2. The nominal arc is off its chord by |τ × u||τ × w|/8 at most, and the gradient's turn, weighted
    2s(1 − s) ≤ 1/2 between the ends, leaves |ε × u||τ × w|/2.
    """
    if start.bend is not None and goal.bend is not None:
        # Both bounds hold; for large errors the quick one may be the smaller.
        return min(_bent(start, goal, start.bend, goal.bend, extent), coarse(start, goal, extent))
    u, (swung, swept) = start.push, extent.swing(start.turned, goal.turned)
    return (times(extent.crossing(u), swung + swept) >> 1) + (times(extent.swept(u), swept) >> 3) + 8


def coarse(start: Distance, goal: Distance, extent: Spread) -> int:
    """A quick bound of what a row differs by from its linear part, never less than `remainder`.

    κ (|u||k| + |M p + s|) with κ of `Spread`, and θD + τΔ/4 + τD/2 + Δθ/2 of a bilinear row, |M e| ≤ D.
    """
    found = times(extent.kappa, size(start, goal)) + 9
    if start.bend is not None:
        t, a = extent.turn, extent.theta
        D, travel = _felt(start.bend, extent), length(start.bend.moved(extent.travel))
        found += times(a, D) + (times(t, travel) >> 2) + (times(t, D) >> 1) + (times(travel, a) >> 1) + 8
    return found


def _bent(start: Distance, goal: Distance, first: Bend, second: Bend, extent: Spread) -> int:
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
    # A sixteenth of the third derivative, by lengths alone.
    arc += times(times(t, t), times(t, far) + 3 * travel) >> 4
    turning = sum(_box_dot(d, extent.box) + _box_dot(e, extent.angles) for d, e in rates) >> 2
    # Third order: the rest of exp(ε); the real y is M e farther; second derivatives between the ends; and N″.
    third = times(times(a, a), times(a // 6 + (t >> 2), far) + (D >> 1) + (travel >> 2)) + (times(times(a, t), D) >> 1)
    third += times(t, times(times(a, t), far) + times(t, D) + 2 * times(a, travel)) >> 3
    return least + arc + turning + third + 64


def _second(d: Distance, bend: Bend, extent: Spread) -> int:
    """What second derivatives at one end come to in the box of errors, at most."""
    (u, w), (beta, y) = (d.push, d.turned), (bend.body, bend.arm)
    trace = dot(u, w) + dot(beta, y)
    total = 0
    for i, j, share in extent.corner:
        outer = w[i] * u[j] + w[j] * u[i] + beta[i] * y[j] + beta[j] * y[i]
        total += times(abs((outer >> BITS) - (2 * trace if i == j else 0)) + 2, share)
    for column, width in zip(bend.columns(), extent.box, strict=True):
        total += times(width, _box_dot(cross(beta, column), extent.angles))
    return total


def _rate(d: Distance, bend: Bend, extent: Spread) -> tuple[Vector, Vector]:
    """N′, how the gradient changes along the twist: in e and in ε."""
    swept, leaned = cross(extent.spin, d.turned), cross(extent.spin, bend.body)
    turning = add(cross(swept, d.push), cross(leaned, bend.arm))
    return bend.pulled(leaned), add(turning, cross(bend.body, bend.moved(extent.travel)))


def _felt(bend: Bend, extent: Spread) -> int:
    """A bound of |M e|."""
    return extent.offset if bend.across == FREE else length(_box_cross(bend.across, extent.box))


def _box_dot(v: Vector, half: Vector) -> int:
    """The largest v·x for x in a box of half-widths."""
    x, y, z = v
    a, b, c = half
    return ((abs(x) * a + abs(y) * b + abs(z) * c) >> BITS) + 1


def _box_cross(v: Vector, half: Vector) -> Vector:
    """Bounds of the sizes of v × x for x in a box of half-widths."""
    x, y, z = abs(v[0]), abs(v[1]), abs(v[2])
    a, b, c = half
    return (((z * b + y * c) >> BITS) + 1, ((z * a + x * c) >> BITS) + 1, ((y * a + x * b) >> BITS) + 1)
