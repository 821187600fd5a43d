"""Fixed-point arithmetic on Python integers: the numbers in which a plan is checked.

A number x is held as the integer x·2²⁵⁶. The floats of a plan are dyadic rationals and convert exactly (below 2⁻²⁵⁶
the rest is cut off). Sums are exact, a product or quotient is cut off by less than one unit 2⁻²⁵⁶.

Error bound. With coordinates below 2⁴ m, rotation vectors below 8 rad and inverses below 2¹⁶ (all of which the check
demands), a rotation matrix is off by less than 2⁻²³⁰, a row of the check by less than 2⁻²²⁰, an inverse of coupled
rows and directions by less than 2⁻¹⁸⁰ and an image of a shape matrix by less than 2⁻¹⁷⁰. `BLUR` = 2⁻¹⁶⁰, added to the
diagonal of every shape matrix that was computed and under every root, and `SLACK` = 2⁻⁷⁵ m, taken off every lower
bound, are larger than all of them together (√BLUR = 2⁻⁸⁰).
"""

from __future__ import annotations

from collections.abc import Sequence
from math import isqrt

BITS = 256
ONE = 1 << BITS
BLUR = 1 << (BITS - 160)
SLACK = 1 << (BITS - 75)
_WIDE_BLUR = BLUR << BITS
_LARGEST_INVERSE = ONE << 16

Vector = tuple[int, int, int]
Matrix = tuple[Vector, Vector, Vector]
Row = tuple[int, int, int, int, int, int]
Square = tuple[Row, Row, Row, Row, Row, Row]
ZERO3: Vector = (0, 0, 0)
IDENTITY: Matrix = ((ONE, 0, 0), (0, ONE, 0), (0, 0, ONE))


class ArithmeticRefusal(ValueError):
    """A computation left the range in which its error bound holds."""


def fixed(x: float) -> int:
    """The float x in fixed point."""
    numerator, denominator = x.as_integer_ratio()
    return (numerator << BITS) // denominator


def number(x: int) -> float:
    """The float nearest to a fixed-point number."""
    return x / ONE


def vector(x: Sequence[float]) -> Vector:
    """Three floats in fixed point."""
    return (fixed(x[0]), fixed(x[1]), fixed(x[2]))


def row(x: Sequence[float]) -> Row:
    """Six floats in fixed point."""
    return (fixed(x[0]), fixed(x[1]), fixed(x[2]), fixed(x[3]), fixed(x[4]), fixed(x[5]))


def times(a: int, b: int) -> int:
    """The product."""
    return (a * b) >> BITS


def over(a: int, b: int) -> int:
    """The quotient."""
    return (a << BITS) // b


def root(x: int) -> int:
    """√x, rounded up; x below zero by rounding counts as zero."""
    return isqrt(max(x, 0) << BITS) + 1


def add(u: Vector, v: Vector) -> Vector:
    """u + v."""
    return (u[0] + v[0], u[1] + v[1], u[2] + v[2])


def sub(u: Vector, v: Vector) -> Vector:
    """u − v."""
    return (u[0] - v[0], u[1] - v[1], u[2] - v[2])


def neg(u: Vector) -> Vector:
    """−u."""
    return (-u[0], -u[1], -u[2])


def dot(u: Vector, v: Vector) -> int:
    """u·v."""
    return (u[0] * v[0] + u[1] * v[1] + u[2] * v[2]) >> BITS


def cross(u: Vector, v: Vector) -> Vector:
    """u × v."""
    return (
        (u[1] * v[2] - u[2] * v[1]) >> BITS,
        (u[2] * v[0] - u[0] * v[2]) >> BITS,
        (u[0] * v[1] - u[1] * v[0]) >> BITS,
    )


def length(u: Vector) -> int:
    """|u|, rounded up."""
    return isqrt(u[0] * u[0] + u[1] * u[1] + u[2] * u[2]) + 1


def scaled(s: int, u: Vector) -> Vector:
    """s u."""
    return ((s * u[0]) >> BITS, (s * u[1]) >> BITS, (s * u[2]) >> BITS)


def unit(u: Vector) -> Vector:
    """u/|u|; refuses vectors shorter than 2⁻³² (0.2 nm)."""
    n = length(u)
    if n < ONE >> 32:
        raise ArithmeticRefusal("a direction has no length")
    return (over(u[0], n), over(u[1], n), over(u[2], n))


def turned(R: Matrix, v: Vector) -> Vector:
    """R v."""
    return (dot(R[0], v), dot(R[1], v), dot(R[2], v))


def transposed(R: Matrix) -> Matrix:
    """Rᵀ."""
    (a, b, c), (d, e, f), (g, h, i) = R
    return ((a, d, g), (b, e, h), (c, f, i))


def product(A: Matrix, B: Matrix) -> Matrix:
    """A B."""
    columns = transposed(B)
    rows = [(dot(r, columns[0]), dot(r, columns[1]), dot(r, columns[2])) for r in A]
    return (rows[0], rows[1], rows[2])


def exponential(r: Vector) -> Matrix:
    """exp([r]×) for |r| ≤ 8, each entry to 2⁻²³⁰: Rodrigues' formula with the Taylor sums of its two coefficients."""
    q = dot(r, r)
    if q > ONE << 6:
        raise ArithmeticRefusal("a rotation vector is longer than 8 rad")
    a, b = _series(q, 2), _series(q, 1)
    x, y, z = r
    K: Matrix = ((0, -z, y), (z, 0, -x), (-y, x, 0))
    KK = product(K, K)
    rows = [add(e, add(scaled(a, k), scaled(b, kk))) for e, k, kk in zip(IDENTITY, K, KK, strict=True)]
    return (rows[0], rows[1], rows[2])


def _series(q: int, first: int) -> int:
    """Σ (−q)ᵏ / (2k + 3 − first)!, that is sin √q/√q for first = 2 and (1 − cos √q)/q for first = 1."""
    total = term = ONE if first == 2 else ONE >> 1
    n, sign = 3 - first, 1
    while term:
        term = times(term, q) // ((n + 1) * (n + 2))
        n, sign = n + 2, -sign
        total += sign * term
    return total


def logarithm(R: Matrix) -> Vector:
    """The rotation vector of R, at most 1/2 rad long, to 2⁻²²⁰: the antisymmetric part times arcsin(x)/x."""
    s: Vector = ((R[2][1] - R[1][2]) >> 1, (R[0][2] - R[2][0]) >> 1, (R[1][0] - R[0][1]) >> 1)
    q = dot(s, s)
    if q > fixed(0.2298) or R[0][0] + R[1][1] + R[2][2] < ONE:
        raise ArithmeticRefusal("a piece of motion turns by more than 0.5 rad")
    total, power, k = 0, ONE, 0
    while power:
        total += power // (2 * k + 1)
        power = times(power, q) * (2 * k + 1) // (2 * k + 2)
        k += 1
    return scaled(total, s)


def row_dot(g: Row, n: Row) -> int:
    """g·n for six numbers each."""
    return (g[0] * n[0] + g[1] * n[1] + g[2] * n[2] + g[3] * n[3] + g[4] * n[4] + g[5] * n[5]) >> BITS


def spread(generators: Sequence[Row], n: Row) -> int:
    """Σ|g·n| over generators, rounded up."""
    a, b, c, d, e, f = n
    total = 0
    for g in generators:
        total += abs(g[0] * a + g[1] * b + g[2] * c + g[3] * d + g[4] * e + g[5] * f)
    return (total >> BITS) + 1


def width(Q: Square, n: Row) -> int:
    """√(nᵀ Q n), rounded up by at most √BLUR."""
    a, b, c, d, e, f = n
    total = 0
    for q, x in zip(Q, n, strict=True):
        if x:
            total += ((q[0] * a + q[1] * b + q[2] * c + q[3] * d + q[4] * e + q[5] * f) >> BITS) * x
    return isqrt(max(total, 0) + _WIDE_BLUR) + 1


def inverse(A: Sequence[Sequence[int]]) -> list[list[int]]:
    """A⁻¹ of a small square matrix, exact before the last division (fraction-free elimination).

    Raises:
        ArithmeticRefusal: an entry of the inverse exceeds 2¹⁶, or there is none.
    """
    n = len(A)
    M = [[*r, *(1 if i == j else 0 for j in range(n))] for i, r in enumerate(A)]
    previous = 1
    for k in range(n):
        pivot = max(range(k, n), key=lambda i: abs(M[i][k]))
        if M[pivot][k] == 0:
            raise ArithmeticRefusal("contacts and directions are not independent")
        M[k], M[pivot] = M[pivot], M[k]
        p, base = M[k][k], M[k]
        for i in range(n):
            if i != k:
                factor = M[i][k]
                M[i] = [(p * x - factor * y) // previous for x, y in zip(M[i], base, strict=True)]
        previous = p
    result = [[(x << (2 * BITS)) // M[i][i] for x in M[i][n:]] for i in range(n)]
    if any(abs(x) > _LARGEST_INVERSE for r in result for x in r):
        raise ArithmeticRefusal("contacts hardly depend on their compliant directions")
    return result
