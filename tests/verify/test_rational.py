"""Fixed-point arithmetic of the check: its laws, and its functions against decimals of many digits."""

import math
import random
from decimal import Decimal, localcontext
from fractions import Fraction

import mpmath as mp
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fmopt.verify.arithmetic import rational as q
from fmopt.verify.certificate import error_set
from tests.shared.plans.table_plan import exp, vector

ULP = Fraction(1, q.ONE)
floats = st.floats(-8.0, 8.0, allow_subnormal=False).filter(lambda x: x == 0.0 or abs(x) > 1e-30)
small = st.floats(-0.25, 0.25, allow_subnormal=False).filter(lambda x: x == 0.0 or abs(x) > 1e-30)


def exact(n: int) -> Fraction:
    return Fraction(n, q.ONE)


@given(floats, floats)
def test_floats_convert_exactly_and_products_are_off_by_less_than_a_unit(x: float, y: float) -> None:
    assert exact(q.fixed(x)) == Fraction(x) or abs(x) < 1e-50
    assert q.number(q.fixed(x)) == x
    product = Fraction(x) * Fraction(y)
    assert 0 <= product - exact(q.times(q.fixed(x), q.fixed(y))) < ULP
    if y:
        assert 0 <= Fraction(x) / Fraction(y) - exact(q.over(q.fixed(x), q.fixed(y))) < ULP


@given(st.floats(1e-30, 100.0))
def test_roots_are_upper_bounds_within_two_units(x: float) -> None:
    n = q.root(q.fixed(x))
    with localcontext() as context:
        context.prec = 120
        gap = Decimal(n) / Decimal(q.ONE) - Decimal(x).sqrt()
        assert Decimal(0) <= gap <= Decimal(2) / Decimal(q.ONE)


@given(st.tuples(floats, floats, floats))
def test_lengths_and_units(v: tuple[float, float, float]) -> None:
    u = q.vector(v)
    assert exact(q.length(u)) ** 2 >= sum(Fraction(x) ** 2 for x in v)
    if math.hypot(*v) > 1e-6:
        assert abs(exact(q.dot(q.unit(u), q.unit(u))) - 1) < Fraction(1, 2**220)
    assert q.cross(u, u) == (0, 0, 0)


def test_directions_without_length_are_refused() -> None:
    with pytest.raises(q.ArithmeticRefusal, match="no length"):
        q.unit(q.vector((0.0, 1e-12, 0.0)))


def rotation(r: tuple[float, ...]) -> mp.matrix:
    mp.mp.dps = 110
    return exp(vector(r))


@given(st.tuples(*[st.floats(-3.5, 3.5, allow_subnormal=False)] * 3))
def test_rotations_keep_their_error_bound(r: tuple[float, float, float]) -> None:
    R, expected = q.exponential(q.vector(r)), rotation(r)
    worst = max(abs(mp.mpf(R[i][j]) / q.ONE - expected[i, j]) for i in range(3) for j in range(3))
    assert worst < mp.mpf(2) ** -230
    identity = q.product(R, q.transposed(R))
    assert max(abs(identity[i][j] - q.IDENTITY[i][j]) for i in range(3) for j in range(3)) < 1 << 24


@given(st.tuples(small, small, small))
def test_logarithms_undo_exponentials(r: tuple[float, float, float]) -> None:
    found = q.logarithm(q.exponential(q.vector(r)))
    assert max(abs(exact(a) - Fraction(b)) for a, b in zip(found, r, strict=True)) < Fraction(1, 2**220)


@pytest.mark.parametrize("r", [(0.6, 0.0, 0.0), (0.0, 2.8, 0.0), (3.1, 0.0, 0.0)])
def test_logarithms_of_large_turns_are_refused(r: tuple[float, float, float]) -> None:
    with pytest.raises(q.ArithmeticRefusal, match=r"0\.5 rad"):
        q.logarithm(q.exponential(q.vector(r)))


@given(st.lists(floats, min_size=9, max_size=9))
def test_inverses(entries: list[float]) -> None:
    A = [[q.fixed(x) for x in entries[3 * i : 3 * i + 3]] for i in range(3)]
    try:
        B = q.inverse(A)
    except q.ArithmeticRefusal:
        (a, b, c), (d, e, f), (g, h, i) = ([exact(x) for x in row] for row in A)
        assert abs(a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)) < Fraction(200, 2**16)
        return
    for i in range(3):
        for j in range(3):
            found = sum(exact(A[i][k]) * exact(B[k][j]) for k in range(3))
            assert abs(found - (i == j)) < Fraction(1, 2**245)


rows = st.lists(small, min_size=6, max_size=6)


@given(rows, st.lists(rows, min_size=1, max_size=5))
def test_supports_are_upper_bounds(n: list[float], generators: list[list[float]]) -> None:
    N, G = q.row(n), [q.row(g) for g in generators]
    zonotope = sum(abs(sum(Fraction(a) * Fraction(b) for a, b in zip(n, g, strict=True))) for g in generators)
    assert 0 <= exact(q.spread(G, N)) - zonotope < 4 * ULP
    Q = error_set.square_of([sum(q.times(g[a], g[b]) for g in G) for b in range(6)] for a in range(6))
    square = sum(sum(Fraction(a) * Fraction(b) for a, b in zip(n, g, strict=True)) ** 2 for g in generators)
    assert square <= exact(q.width(Q, N)) ** 2 <= square + Fraction(1, 2**70)


@given(st.lists(st.floats(1e-6, 1.0), min_size=12, max_size=12), rows)
def test_the_outer_sum_contains_the_sum(radii: list[float], n: list[float]) -> None:
    A, B = (error_set.diagonal([q.times(q.fixed(x), q.fixed(x)) for x in radii[k : k + 6]]) for k in (0, 6))
    N = q.row(n)
    total = error_set.outer_sum(A, B, error_set.metric(q.fixed(0.014)))
    assert q.width(total, N) + (1 << (q.BITS - 70)) >= q.width(A, N) + q.width(B, N) - (1 << (q.BITS - 70))
    assert error_set.outer_sum(A, error_set.NOTHING, error_set.metric(q.ONE)) == A
    assert error_set.outer_sum(error_set.NOTHING, B, error_set.metric(q.ONE)) == B


def test_rounding_does_not_grow_in_a_sum() -> None:
    rounding = error_set.diagonal([q.BLUR] * 6)
    line = error_set.diagonal([q.times(q.fixed(1e-4), q.fixed(1e-4)), 0, 0, 0, 0, 0])
    for total in (
        error_set.outer_sum(rounding, line, error_set.metric(q.ONE)),
        error_set.outer_sum(line, rounding, error_set.metric(q.ONE)),
    ):
        along, across = (
            q.number(q.width(total, error_set.row_of(q.ONE if a == k else 0 for a in range(6)))) for k in (0, 1)
        )
        assert 1e-4 <= along < 1e-4 * (1.0 + 1e-14)
        assert across < 1e-16


@given(st.lists(rows, min_size=6, max_size=6), rows, st.integers(1, 10**6))
def test_symmetric_forms_are_the_plain_ones_but_for_rounding(A: list[list[float]], n: list[float], t: int) -> None:
    M, N = error_set.square_of(q.row(r) for r in A), q.row(n)
    Q = error_set.square_of([q.row_dot(a, b) for b in M] for a in M)
    for map_, shape, found in (
        (M, Q, error_set.congruent(M, Q)),
        (M, error_set.diagonal([t] * 3 + [0] * 3), error_set.magnified(t, error_set.spheres(M)[0])),
        (M, error_set.diagonal([0] * 3 + [t] * 3), error_set.magnified(t, error_set.spheres(M)[1])),
    ):
        for a in range(6):
            for b in range(6):
                plain = sum(map_[a][i] * shape[i][j] * map_[b][j] for i in range(6) for j in range(6)) >> (2 * q.BITS)
                assert abs(found[a][b] - plain) < 64
                assert found[a][b] == found[b][a]
    plain = sum(N[i] * Q[i][j] * N[j] for i in range(6) for j in range(6)) >> q.BITS
    assert abs(q.width(Q, N) ** 2 - plain) <= (1 << (2 * q.BITS - 150)) + (plain >> 120)


@given(st.integers(2, 6), st.integers(0, 10**6))
def test_inverses_of_any_size_and_order_of_rows(n: int, seed: int) -> None:
    pick = random.Random(seed)
    A = [[q.fixed(pick.choice((0.0, 1.0, pick.uniform(-1.0, 1.0)))) for _ in range(n)] for _ in range(n)]
    try:
        B = q.inverse(A)
    except q.ArithmeticRefusal:
        return
    for i in range(n):
        for j in range(n):
            assert abs(sum(A[i][k] * B[k][j] for k in range(n)) - (q.ONE**2 if i == j else 0)) <= n * q.ONE


def test_dual_columns_and_congruence() -> None:
    C = (q.row([1.0, 0.5, 0.0, 0.0, 2.0, 0.0]), q.row([0.0, 1.0, 0.25, 3.0, 0.0, 0.0]))
    N = (q.row([1.0, 0.0, 0.0, 0.0, 0.125, 0.0]), q.row([0.0, 0.5, 1.0, 0.0, 0.0, 1.0]))
    columns, _ = error_set.dual(C, N)
    for i, n in enumerate(N):
        for j, c in enumerate(columns):
            assert abs(q.row_dot(n, c) - (q.ONE if i == j else 0)) < 1 << 12
    double = error_set.diagonal([2 * q.ONE] * 6)
    assert error_set.congruent(double, double) == error_set.diagonal([8 * q.ONE] * 6)
    with pytest.raises(q.ArithmeticRefusal, match="not independent"):
        error_set.dual((C[0], C[0]), N)
    with pytest.raises(q.ArithmeticRefusal, match="hardly depend"):
        error_set.dual((error_set.row_of(x >> 20 for x in C[0]),), (N[0],))
