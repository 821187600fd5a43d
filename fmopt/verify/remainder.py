"""How much rows differ from their linear parts over a piece of motion and its errors.

A row's linear part is interpolated between the ends of the piece; `remainder` bounds what is left, with everything that
it asks of the same vectors remembered by the `Extent` of the piece.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

from fmopt.verify.rational import BITS, Vector, add, cross, dot, length, times
from fmopt.verify.rows import FREE, Bend, Distance


@dataclass(frozen=True, eq=False)
class Extent:
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
    _crossed: dict[Vector, int] = field(default_factory=dict, repr=False)
    _swept: dict[Vector, int] = field(default_factory=dict, repr=False)
    _swings: dict[tuple[Vector, Vector], tuple[int, int]] = field(default_factory=dict, repr=False)

    @cached_property
    def standing(self) -> Extent:
        """The same errors without the motion."""
        return Extent(FREE, 0, FREE, self.theta, self.angles, self.box)

    @cached_property
    def offset(self) -> int:
        """A bound of |e|."""
        return length(self.box)

    @cached_property
    def kappa(self) -> int:
        """θ²/2 + τ²/8 + τθ/2: by what share of a row's size it leaves its linear part, at most."""
        t, a = self.turn, self.theta
        return (times(a, a) >> 1) + (times(t, t) >> 3) + (times(t, a) >> 1) + 3

    @cached_property
    def corner(self) -> tuple[tuple[int, int, int], ...]:
        """Places (i, j ≥ i) of a symmetric matrix A, with what |Aᵢⱼ| adds to ε·A ε / 4, rounded up."""
        h, places = self.angles, ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
        return tuple((i, j, (times(h[i], h[j]) >> (2 if i == j else 1)) + 1) for i, j in places)

    def crossing(self, v: Vector) -> int:
        """A bound of |ε × v|."""
        found = self._crossed.get(v)
        if found is None:
            found = min(length(_box_cross(v, self.angles)), times(self.theta, length(v)) + 1)
            self._crossed[v] = found
        return found

    def swing(self, start: Vector, goal: Vector) -> tuple[int, int]:
        """Bounds of |ε × w| anywhere on the way of a turned body vector w, and of |τ × w|."""
        found = self._swings.get((start, goal))
        if found is None:
            swept = self.swept(start)
            swung = max(self.crossing(start), self.crossing(goal)) + (times(self.theta, swept) >> 1)
            found = min(swung, times(self.theta, length(start)) + 1), swept
            self._swings[start, goal] = found
        return found

    def swept(self, v: Vector) -> int:
        """|τ × v|."""
        found = self._swept.get(v)
        if found is None:
            found = self._swept[v] = length(cross(self.spin, v))
        return found


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
    u, (swung, swept) = start.push, extent.swing(start.turned, goal.turned)
    return (times(extent.crossing(u), swung + swept) >> 1) + (times(extent.swept(u), swept) >> 3) + 8


def coarse(start: Distance, goal: Distance, extent: Extent) -> int:
    """A quick bound of what a row differs by from its linear part, never less than `remainder`.

    κ (|u||k| + |M p + s|) with κ of `Extent`, and θD + τΔ/4 + τD/2 + Δθ/2 of a bilinear row, |M e| ≤ D.
    """
    found = times(extent.kappa, size(start, goal)) + 9
    if start.bend is not None:
        t, a = extent.turn, extent.theta
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
    (u, w), (beta, y) = (d.push, d.turned), (bend.body, bend.arm)
    trace = dot(u, w) + dot(beta, y)
    total = 0
    for i, j, share in extent.corner:
        outer = w[i] * u[j] + w[j] * u[i] + beta[i] * y[j] + beta[j] * y[i]
        total += times(abs((outer >> BITS) - (2 * trace if i == j else 0)) + 2, share)
    for column, width in zip(bend.columns(), extent.box, strict=True):
        total += times(width, _box_dot(cross(beta, column), extent.angles))
    return total


def _rate(d: Distance, bend: Bend, extent: Extent) -> tuple[Vector, Vector]:
    """N′, how the gradient changes along the twist: in e and in ε."""
    swept, leaned = cross(extent.spin, d.turned), cross(extent.spin, bend.body)
    turning = add(cross(swept, d.push), cross(leaned, bend.arm))
    return bend.pulled(leaned), add(turning, cross(bend.body, bend.moved(extent.travel)))


def _felt(bend: Bend, extent: Extent) -> int:
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
