"""Exact incidence: points, directions and planes in integers, where what is on a plane satisfies its equation.

A point is held as integers (x, y, z, w), w > 0, and stands for (x, y, z)/w; a plane as (a, b, c, d) without a common
factor, the points with a x + b y + c z = d w, its normal (a, b, c) pointing to its front. Of directions only where they
point counts: they have integer components and no unit. Nothing is rounded here, and nothing has a tolerance.
"""

from collections.abc import Iterable, Sequence
from itertools import pairwise
from math import gcd, isqrt

from fmopt.verify.arithmetic.rational import BITS, ONE, Vector, over, sub

Point = tuple[int, int, int, int]
Level = tuple[int, int, int, int]
_SHARP = BITS + 64  # bits of the longest component of a direction before it is made a unit vector


def point(v: Vector) -> Point:
    """The point of a vector in fixed point."""
    x, y, z = v
    # The lowest bit of all four together is the largest power of two that they share: without it integers stay short.
    shared = x | y | z | ONE
    shift = (shared & -shared).bit_length() - 1
    return (x >> shift, y >> shift, z >> shift, ONE >> shift)


def rounded(p: Point) -> Vector:
    """A point in fixed point, rounded to 2⁻²⁵⁶ m."""
    x, y, z, w = p
    return ((x << BITS) // w, (y << BITS) // w, (z << BITS) // w)


def inner(u: Sequence[int], v: Sequence[int]) -> int:
    """u·v of directions."""
    return u[0] * v[0] + u[1] * v[1] + u[2] * v[2]


def outer(u: Sequence[int], v: Sequence[int]) -> Vector:
    """u × v of directions."""
    return (u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0])


def way(p: Point, q: Point) -> Vector:
    """The direction from p to q; (0, 0, 0) when they coincide."""
    a, b, c, v = p
    x, y, z, w = q
    # With one denominator the difference points the same way, by shorter integers.
    return (x - a, y - b, z - c) if v == w else (x * v - a * w, y * v - b * w, z * v - c * w)


def parallel(u: Sequence[int], v: Sequence[int]) -> bool:
    """Whether two directions are one or opposite; (0, 0, 0) is parallel to every direction."""
    a, b, c = u[0], u[1], u[2]
    x, y, z = v[0], v[1], v[2]
    return a * y == b * x and b * z == c * y and c * x == a * z


def one_way(u: Sequence[int], v: Sequence[int]) -> bool:
    """Whether two directions that are not (0, 0, 0) are one."""
    return parallel(u, v) and inner(u, v) > 0


def level(normal: Sequence[int], p: Point) -> Level:
    """The plane across a direction through a point."""
    a, b, c = normal[0], normal[1], normal[2]
    w = p[3]
    # Times w > 0, so that the front stays the front.
    found = (a * w, b * w, c * w, a * p[0] + b * p[1] + c * p[2])
    # One plane has one form then: planes are compared as tuples.
    shared = gcd(*found) or 1
    return (found[0] // shared, found[1] // shared, found[2] // shared, found[3] // shared)


def turned_over(plane: Level) -> Level:
    """The same plane seen from behind."""
    return (-plane[0], -plane[1], -plane[2], -plane[3])


def height(plane: Level, p: Point) -> int:
    """A number of the sign of a point's height over a plane, whose normal is no unit vector: 0 on it."""
    return plane[0] * p[0] + plane[1] * p[1] + plane[2] * p[2] - plane[3] * p[3]


def through(points: Iterable[Point]) -> Level | None:
    """The plane of the first three points that are not in line, seen from either side; None without any."""
    base: Point | None = None
    arm: Vector | None = None
    for p in points:
        if base is None:
            base = p
        elif arm is None:
            arm = way(base, p) if any(way(base, p)) else None
        elif any(normal := outer(arm, way(base, p))):
            return level(normal, base)
    return None


def area(points: Sequence[Vector], loops: Iterable[Sequence[int]]) -> Vector:
    """The direction of the area that loops of points in fixed point, m, enclose (Newell): across their plane if any.

    Loops are indices, counter-clockwise as seen from where the area points; holes the other way round.
    """
    x = y = z = 0
    for loop in loops:
        # From a corner of the loop: its first and last edge span nothing, so that the loop need not be closed.
        base = points[loop[0]]
        arms = [sub(points[i], base) for i in loop]
        for one, two in pairwise(arms):
            a, b, c = outer(one, two)
            x, y, z = x + a, y + b, z + c
    return (x, y, z)


def unit_of(direction: Sequence[int]) -> Vector:
    """The unit vector along a direction, each component to 2⁻²⁵⁵."""
    most = max(abs(x) for x in direction).bit_length()
    # Short directions are lengthened first, as their length is rounded to a whole number.
    shift = max(0, _SHARP - most)
    a, b, c = (x << shift for x in direction[:3])
    size = isqrt(a * a + b * b + c * c) or 1
    return (over(a, size), over(b, size), over(c, size))


def balanced(a: int, b: int, c: int, p: tuple[int, int], q: tuple[int, int]) -> bool:
    """Whether a √p + b √q + c √(p q) = 0, decided by integers alone.

    With s = a √p + b √q it has to be −c √(p q): of the other sign than c, and of the same square. The squares are
    equal when 2 a b √(p q) = c² p q − a² p − b² q, which again is a matter of signs and squares.
    """
    (u, v), (x, y) = p, q
    # Over the common denominator v y: p = u y / (v y), q = x v / (v y), p q = u x / (v y).
    p_, q_, pq = u * y, x * v, u * x
    t = c * c * pq - a * a * p_ - b * b * q_  # times 1 / (v y)
    # (2 a b)² u x / (v y) = t² / (v y)²
    if 4 * a * a * b * b * pq * v * y != t * t or _sign(t) != _sign(a * b):
        return False
    square = a * a * p_ - b * b * q_  # which of a √p and b √q is longer
    s = _sign(a) if square > 0 else _sign(b) if square < 0 else (_sign(a) if a * b > 0 else 0)
    return s == -_sign(c)


def _sign(x: int) -> int:
    return (x > 0) - (x < 0)
