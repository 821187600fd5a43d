"""Fixed-point arithmetic on Python integers: the numbers in which a plan is checked.

A number x is held as the integer x·2²⁵⁶. The floats of a plan are dyadic rationals and convert exactly (below 2⁻²⁵⁶
the rest is cut off). Sums are exact, a product or quotient is cut off by less than one unit 2⁻²⁵⁶.

Error bound. With coordinates below 2⁴ m, rotation vectors below 8 rad and inverses below 2¹⁶ (all of which the check
demands), a rotation matrix is off by less than 2⁻²³⁰, a row of the check by less than 2⁻²²⁰, an inverse of coupled
rows and directions by less than 2⁻¹⁸⁰ and an image of a shape matrix by less than 2⁻¹⁷⁰. `BLUR` = 2⁻¹⁶⁰, added to the
diagonal of every shape matrix that was computed and under every root, and `SLACK` = 2⁻⁷⁵ m, taken off every lower
bound, are larger than all of them together (√BLUR = 2⁻⁸⁰).
"""

from collections.abc import Sequence
from math import isqrt

BITS = 256
ONE = 1 << BITS
BLUR = 1 << (BITS - 160)
SLACK = 1 << (BITS - 75)
_WIDE_BLUR = BLUR << BITS
_LARGEST_INVERSE = ONE << 16
_UNIT = 2.0**-BITS  # a power of two: products with it are not rounded

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
    # The denominator is a power of two: to divide by it is to shift.
    return (numerator << BITS) >> (denominator.bit_length() - 1)


def doubles(v: Sequence[int]) -> tuple[float, ...]:
    """The floats nearest to fixed-point numbers."""
    return tuple([number(x) for x in v])


def number(x: int) -> float:
    """The float nearest to a fixed-point number."""
    return float(x) * _UNIT


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
    """The quotient, rounded down; b is not 0."""
    return (a << BITS) // b


def root(x: int) -> int:
    """√x, rounded up; x below zero by rounding counts as zero."""
    return isqrt(max(x, 0) << BITS) + 1


def add(u: Vector, v: Vector) -> Vector:
    """u + v."""
    a, b, c = u
    x, y, z = v
    return (a + x, b + y, c + z)


def sub(u: Vector, v: Vector) -> Vector:
    """u − v."""
    a, b, c = u
    x, y, z = v
    return (a - x, b - y, c - z)


def neg(u: Vector) -> Vector:
    """−u."""
    return (-u[0], -u[1], -u[2])


def dot(u: Vector, v: Vector) -> int:
    """u·v."""
    a, b, c = u
    x, y, z = v
    return (a * x + b * y + c * z) >> BITS


def cross(u: Vector, v: Vector) -> Vector:
    """u × v."""
    a, b, c = u
    x, y, z = v
    return ((b * z - c * y) >> BITS, (c * x - a * z) >> BITS, (a * y - b * x) >> BITS)


def length(u: Vector) -> int:
    """|u|, rounded up."""
    a, b, c = u
    return isqrt(a * a + b * b + c * c) + 1


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
    (a, b, c), (d, e, f), (g, h, i) = R
    x, y, z = v
    return ((a * x + b * y + c * z) >> BITS, (d * x + e * y + f * z) >> BITS, (g * x + h * y + i * z) >> BITS)


def transposed(R: Matrix) -> Matrix:
    """Rᵀ."""
    (a, b, c), (d, e, f), (g, h, i) = R
    return ((a, d, g), (b, e, h), (c, f, i))


def product(A: Matrix, B: Matrix) -> Matrix:
    """A B."""
    columns = transposed(B)
    return (turned(columns, A[0]), turned(columns, A[1]), turned(columns, A[2]))


def exponential(r: Vector) -> Matrix:
    """exp([r]×) for |r| ≤ 8, each entry to 2⁻²³⁰: Rodrigues' formula with the Taylor sums of its two coefficients."""
    q = dot(r, r)
    if q > ONE << 6:
        raise ArithmeticRefusal("a rotation vector is longer than 8 rad")
    a, b = _series(q, 2), _series(q, 1)
    x, y, z = r
    K: Matrix = ((0, -z, y), (z, 0, -x), (-y, x, 0))
    rows = [add(e, add(scaled(a, k), scaled(b, kk))) for e, k, kk in zip(IDENTITY, K, product(K, K), strict=True)]
    return (rows[0], rows[1], rows[2])


def _series(q: int, first: int) -> int:
    """Σ (−q)ᵏ / (2k + 3 − first)!, that is sin √q/√q for first = 2 and (1 − cos √q)/q for first = 1."""
    # The sign is kept apart: rounded down, a negative term would never come to zero.
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
    # sin² 1/2 = 0.22985; a turn beyond a quarter may have as small a sine, but its trace is below 1.
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
    a, b, c, d, e, f = g
    u, v, w, x, y, z = n
    return (a * u + b * v + c * w + d * x + e * y + f * z) >> BITS


def spread(generators: Sequence[Row], n: Row) -> int:
    """Σ|g·n| over generators, rounded up."""
    # One shift for all: what it cuts off the sum is less than the unit that is added.
    a, b, c, d, e, f = n
    total = 0
    for u, v, w, x, y, z in generators:
        total += abs(u * a + v * b + w * c + x * d + y * e + z * f)
    return (total >> BITS) + 1


def width(Q: Square, n: Row) -> int:
    """√(nᵀ Q n) of a symmetric Q, rounded up by at most √BLUR; what is below its diagonal counts by what is above."""
    a, b, c, d, e, f = n
    (aa, ab, ac, ad, ae, af), (_, bb, bc, bd, be, bf), (_, _, cc, cd, ce, cf) = Q[0], Q[1], Q[2]
    dd, de, df, ee, ef, ff = Q[3][3], Q[3][4], Q[3][5], Q[4][4], Q[4][5], Q[5][5]
    # In e, in ε, and between the two.
    total = ((dd * d + ((de * e + df * f) << 1)) >> BITS) * d + ((ee * e + ((ef * f) << 1)) >> BITS) * e
    total += ((ff * f) >> BITS) * f
    if a or b or c:
        total += ((aa * a + ((ab * b + ac * c + ad * d + ae * e + af * f) << 1)) >> BITS) * a
        total += ((bb * b + ((bc * c + bd * d + be * e + bf * f) << 1)) >> BITS) * b
        total += ((cc * c + ((cd * d + ce * e + cf * f) << 1)) >> BITS) * c
    # The sum is in units of 2⁻⁵¹²: the root brings it back to those of fixed point.
    return isqrt(max(total, 0) + _WIDE_BLUR) + 1


def inverse(A: Sequence[Sequence[int]]) -> list[list[int]]:
    """A⁻¹ of a small square matrix, exact before the last division (fraction-free elimination).

    Raises:
        ArithmeticRefusal: an entry of the inverse exceeds 2¹⁶, or there is none.
    """
    n = len(A)
    # The power of two that all entries share changes nothing but the last division.
    shift = min((min(x & -x for x in r if x).bit_length() - 1 for r in A if any(r)), default=0)
    M = [[x >> shift for x in r] for r in A]
    order, previous = list(range(n)), 1
    for k in range(n):
        pivot = max(range(k, n), key=lambda i: abs(M[i][k]))
        if M[pivot][k] == 0:
            raise ArithmeticRefusal("contacts and directions are not independent")
        M[k], M[pivot] = M[pivot], M[k]
        order[k], order[pivot] = order[pivot], order[k]
        base = M[k]
        p = base[k]
        for i in range(n):
            if i != k:
                factor = M[i][k]
                # No remainder is left: before and after, entries are minors of the matrix.
                M[i] = [(p * x - factor * y) // previous for x, y in zip(M[i], base, strict=True)]
                # What was eliminated makes room for a column of the inverse.
                M[i][k] = -factor
        base[k] = previous
        previous = p
    result = [[0] * n for _ in range(n)]
    for i, r in enumerate(M):
        for k, x in zip(order, r, strict=True):
            # Entries count 2^(shift − BITS): the inverse has the reciprocal of that, and 2^BITS as fixed point.
            result[i][k] = (x << (2 * BITS - shift)) // previous
    if any(abs(x) > _LARGEST_INVERSE for r in result for x in r):
        raise ArithmeticRefusal("contacts hardly depend on their compliant directions")
    return result
