"""Linear algebra in error coordinates (e, ε): rows and columns of six, square matrices of six rows."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from fmopt.verify.rational import BITS, BLUR, ONE, Row, Square, inverse, over, root, row_dot, times

SIX = range(6)
_LEAST, _MOST = ONE >> 50, ONE << 50  # proportions of two ellipsoids, beyond which one is but rounding


def row_of(values: Iterable[int]) -> Row:
    """Six numbers as a row."""
    a, b, c, d, e, f = values
    return (a, b, c, d, e, f)


def square_of(rows: Iterable[Iterable[int]]) -> Square:
    """Six rows as a matrix."""
    a, b, c, d, e, f = (row_of(r) for r in rows)
    return (a, b, c, d, e, f)


NO_ROW: Row = (0, 0, 0, 0, 0, 0)
NOTHING: Square = square_of([NO_ROW] * 6)


def diagonal(entries: Sequence[int]) -> Square:
    """The matrix with these six diagonal entries."""
    return square_of([entries[a] if a == b else 0 for b in SIX] for a in SIX)


def stretched(factor: int, g: Row) -> Row:
    """factor · g."""
    return row_of((factor * x) >> BITS for x in g)


def image(A: Square, g: Row) -> Row:
    """A g."""
    return row_of(row_dot(r, g) for r in A)


def seen(n: Row, A: Square) -> Row:
    """Aᵀ n: the row n as it is felt before the map A."""
    return row_of(sum(n[a] * A[a][b] for a in SIX) >> BITS for b in SIX)


def congruent(A: Square, Q: Square) -> Square:
    """A Q Aᵀ for a symmetric Q."""
    half = [image(A, q) for q in Q]
    columns = [row_of(q[a] for q in half) for a in SIX]
    return square_of([row_dot(r, c) for c in columns] for r in A)


def gram(columns: Sequence[Row]) -> Square:
    """Σ c cᵀ."""
    return square_of([sum(c[a] * c[b] for c in columns) >> BITS for b in SIX] for a in SIX)


def blurred(Q: Square) -> Square:
    """Q with its diagonal raised by more than rounding can have lowered it."""
    return square_of([x + BLUR if a == b else x for b, x in enumerate(r)] for a, r in enumerate(Q))


def dual(directions: Sequence[Row], rows: Sequence[Row]) -> tuple[list[Row], list[list[int]]]:
    """The columns of C (N C)⁻¹, and (N C)⁻¹, for directions C and rows N.

    Raises:
        ArithmeticRefusal: see `inverse`.
    """
    if not directions:
        return [], []
    solved = inverse([[row_dot(n, c) for c in directions] for n in rows])
    columns = [
        row_of(sum(r[i] * c[a] for r, c in zip(solved, directions, strict=True)) >> BITS for a in SIX)
        for i in range(len(rows))
    ]
    return columns, solved


def complement(columns: Sequence[Row], rows: Sequence[Row]) -> Square:
    """I − Σ cᵢ nᵢᵀ."""
    return square_of(
        [(ONE if a == b else 0) - (sum(c[a] * n[b] for c, n in zip(columns, rows, strict=True)) >> BITS) for b in SIX]
        for a in SIX
    )


def without(A: Square, column: Row, row: Row) -> Square:
    """A − c nᵀ."""
    return square_of(
        [x - ((c * n) >> BITS) for x, n in zip(r, row, strict=True)] for r, c in zip(A, column, strict=True)
    )


def metric(rho: int) -> Row:
    """The diagonal of the metric |e|² + ρ²|ε|²."""
    square = times(rho, rho)
    return (ONE, ONE, ONE, square, square, square)


def measure(v: Row, rho: int) -> int:
    """√(|e|² + ρ²|ε|²)."""
    return root(sum(times(w, times(x, x)) for w, x in zip(metric(rho), v, strict=True)))


def outer_sum(Q1: Square, Q2: Square, weights: Row) -> Square:
    """An ellipsoid around the sum of two: (1 + 1/p)Q₁ + (1 + p)Q₂, p = √tr Q₁/√tr Q₂ in the metric.

    A summand without extent is left out. Both are blurred first: a factor may be large where a summand is small, though
    not so large that what is but blur would count.
    """
    if Q1 == NOTHING or Q2 == NOTHING:
        return Q1 if Q2 == NOTHING else Q2
    Q1, Q2 = blurred(Q1), blurred(Q2)
    s1, s2 = (root(sum(times(weights[a], Q[a][a]) for a in SIX)) for Q in (Q1, Q2))
    p = min(max(over(s1, s2), _LEAST), _MOST)
    # Rounded up, so that 1/α + 1/β ≤ 1 holds of the two factors whatever p is.
    alpha, beta = ONE + (ONE << BITS) // p + 1, ONE + p
    return square_of(
        [(alpha * x + beta * y) >> BITS for x, y in zip(r1, r2, strict=True)] for r1, r2 in zip(Q1, Q2, strict=True)
    )
