"""Linear algebra in error coordinates (e, ε): rows and columns of six, square matrices of six rows."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import lru_cache
from operator import mul

from fmopt.verify.rational import BITS, BLUR, ONE, Row, Square, inverse, over, root, row_dot, times

SIX = range(6)
_UPPER = [(a, b) for a in SIX for b in range(a, 6)]  # places on and above the diagonal
_LEAST, _MOST = ONE >> 50, ONE << 50  # proportions of two ellipsoids, beyond which one is but rounding


def row_of(values: Iterable[int]) -> Row:
    """Six numbers as a row."""
    a, b, c, d, e, f = values
    return (a, b, c, d, e, f)


def square_of(rows: Iterable[Iterable[int]]) -> Square:
    """Six rows as a matrix."""
    a, b, c, d, e, f = [row_of(r) for r in rows]
    return (a, b, c, d, e, f)


def symmetric(upper: Iterable[int]) -> Square:
    """The symmetric matrix with these 21 entries on and above its diagonal, row by row."""
    aa, ab, ac, ad, ae, af, bb, bc, bd, be, bf, cc, cd, ce, cf, dd, de, df, ee, ef, ff = upper
    return (
        (aa, ab, ac, ad, ae, af),
        (ab, bb, bc, bd, be, bf),
        (ac, bc, cc, cd, ce, cf),
        (ad, bd, cd, dd, de, df),
        (ae, be, ce, de, ee, ef),
        (af, bf, cf, df, ef, ff),
    )


NO_ROW: Row = (0, 0, 0, 0, 0, 0)
NOTHING: Square = square_of([NO_ROW] * 6)


def diagonal(entries: Sequence[int]) -> Square:
    """The matrix with these six diagonal entries."""
    return symmetric([entries[a] if a == b else 0 for a, b in _UPPER])


def stretched(factor: int, g: Row) -> Row:
    """factor · g."""
    return row_of([(factor * x) >> BITS for x in g])


def flipped(A: Square) -> Square:
    """Aᵀ."""
    return square_of(zip(*A, strict=True))


def image(A: Square, g: Row) -> Row:
    """A g."""
    a, b, c, d, e, f = g
    return row_of([(a * u + b * v + c * w + d * x + e * y + f * z) >> BITS for u, v, w, x, y, z in A])


def seen(n: Row, A: Square) -> Row:
    """Aᵀ n: the row n as it is felt before the map A."""
    return image(flipped(A), n)


def congruent(A: Square, Q: Square) -> Square:
    """A Q Aᵀ for a symmetric Q."""
    if Q == NOTHING:
        return NOTHING
    half = flipped(square_of([image(A, q) for q in Q]))
    return symmetric([row_dot(A[a], half[b]) for a, b in _UPPER])


def spheres(A: Square) -> tuple[Square, Square]:
    """A D Aᵀ with D = diag(1, 1, 1, 0, 0, 0) and with D = diag(0, 0, 0, 1, 1, 1)."""
    columns = flipped(A)
    return gram(columns[:3]), gram(columns[3:])


def magnified(s: int, P: Square) -> Square:
    """s P of a symmetric P."""
    return symmetric([(s * P[a][b]) >> BITS for a, b in _UPPER])


def gram(columns: Sequence[Row]) -> Square:
    """Σ c cᵀ."""
    return symmetric([sum([c[a] * c[b] for c in columns]) >> BITS for a, b in _UPPER])


def blurred(Q: Square) -> Square:
    """A symmetric Q with its diagonal raised by more than rounding can have lowered it."""
    return symmetric([Q[a][b] + BLUR if a == b else Q[a][b] for a, b in _UPPER])


@lru_cache(maxsize=4)
def dual(directions: tuple[Row, ...], rows: tuple[Row, ...]) -> tuple[tuple[Row, ...], tuple[tuple[int, ...], ...]]:
    """The columns of C (N C)⁻¹, and (N C)⁻¹, for directions C and rows N.

    Where a piece of motion starts, they are those of the end of the piece before.

    Raises:
        ArithmeticRefusal: see `inverse`.
    """
    if not directions:
        return (), ()
    solved = inverse([[row_dot(n, c) for c in directions] for n in rows])
    along = list(zip(*directions, strict=True))
    columns = [row_of([sum(map(mul, shares, c)) >> BITS for c in along]) for shares in zip(*solved, strict=True)]
    return tuple(columns), tuple(tuple(r) for r in solved)


def complement(columns: Sequence[Row], rows: Sequence[Row]) -> Square:
    """I − Σ cᵢ nᵢᵀ."""
    if not columns:
        return diagonal([ONE] * 6)
    across = list(zip(*rows, strict=True))
    return square_of(
        [(ONE if a == b else 0) - (sum(map(mul, shares, n)) >> BITS) for b, n in enumerate(across)]
        for a, shares in enumerate(zip(*columns, strict=True))
    )


def without(A: Square, column: Row, row: Row) -> Square:
    """A − c nᵀ."""
    return square_of(
        [[x - ((c * n) >> BITS) for x, n in zip(r, row, strict=True)] for r, c in zip(A, column, strict=True)]
    )


def metric(rho: int) -> Row:
    """The diagonal of the metric |e|² + ρ²|ε|²."""
    square = times(rho, rho)
    return (ONE, ONE, ONE, square, square, square)


def measure(v: Row, rho: int) -> int:
    """√(|e|² + ρ²|ε|²)."""
    return root(sum([times(w, times(x, x)) for w, x in zip(metric(rho), v, strict=True)]))


def outer_sum(Q1: Square, Q2: Square, weights: Row) -> Square:
    """An ellipsoid around the sum of two: (1 + 1/p)Q₁ + (1 + p)Q₂, p = √tr Q₁/√tr Q₂ in the metric.

    A summand without extent is left out. Both are blurred first: a factor may be large where a summand is small, though
    not so large that what is but blur would count.
    """
    if Q1 == NOTHING or Q2 == NOTHING:
        return Q1 if Q2 == NOTHING else Q2
    s1, s2 = (root(sum([times(weights[a], Q[a][a] + BLUR) for a in SIX])) for Q in (Q1, Q2))
    p = min(max(over(s1, s2), _LEAST), _MOST)
    # Rounded up, so that 1/α + 1/β ≤ 1 holds of the two factors whatever p is.
    alpha, beta = ONE + (ONE << BITS) // p + 1, ONE + p
    blur = (alpha + beta) * BLUR
    return symmetric([(alpha * Q1[a][b] + beta * Q2[a][b] + (blur if a == b else 0)) >> BITS for a, b in _UPPER])
