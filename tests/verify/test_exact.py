"""Exact incidence: laws of its predicates, and what points that are only near a line or a plane are good for."""

from fractions import Fraction
from typing import Any

import mpmath as mp
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from fmopt.verify import CERTIFIED, NOT_PROVED, PlanError, verify
from fmopt.verify.arithmetic import exact, rational
from fmopt.verify.parts.assembly import PartPair, Touch
from fmopt.verify.parts.incidence import Turn, about, cancel, image_of
from fmopt.verify.parts.solids import Plane, Shape
from tests.shared.parts.held import LEFT, PEG, V0, V3, V3_LEFT, A, facts, same, vertex_on
from tests.shared.parts.solid_bodies import shape
from tests.shared.plans.table_plan import box_body, sealed, table_plan

INTEGERS = st.integers(-(10**6), 10**6)
DIRECTIONS = st.tuples(INTEGERS, INTEGERS, INTEGERS).filter(any)
POINTS = st.tuples(INTEGERS, INTEGERS, INTEGERS, st.integers(1, 10**6))
COORDINATES = st.floats(-4.0, 4.0, allow_nan=False, allow_subnormal=False).map(lambda x: x if abs(x) > 1e-30 else 0.0)


@given(st.tuples(COORDINATES, COORDINATES, COORDINATES))
def test_a_float_is_the_point_that_it_is(x: tuple[float, float, float]) -> None:
    at = exact.point(rational.vector(x))
    assert exact.rounded(at) == rational.vector(x)
    assert all(p / at[3] == y for p, y in zip(at, x, strict=False))


@given(POINTS, POINTS, POINTS)
def test_a_plane_holds_what_spans_it_and_has_two_sides(a: exact.Point, b: exact.Point, c: exact.Point) -> None:
    normal = exact.outer(exact.way(a, b), exact.way(a, c))
    assume(any(normal))
    plane = exact.level(normal, a)
    assert [exact.height(plane, p) for p in (a, b, c)] == [0, 0, 0]
    assert plane == exact.level(tuple(3 * x for x in normal), c)
    beyond = (a[0] + normal[0] * a[3], a[1] + normal[1] * a[3], a[2] + normal[2] * a[3], a[3])
    assert exact.height(plane, beyond) > 0 > exact.height(exact.turned_over(plane), beyond)


@given(POINTS, DIRECTIONS, st.integers(-50, 50), st.integers(1, 50))
def test_points_along_a_direction_are_in_line(a: exact.Point, d: rational.Vector, p: int, q: int) -> None:
    assume(p != 0)
    b = (a[0] * q + d[0] * p * a[3], a[1] * q + d[1] * p * a[3], a[2] * q + d[2] * p * a[3], a[3] * q)
    assert exact.parallel(exact.way(a, b), d)
    assert (exact.inner(exact.way(a, b), d) > 0) == (p > 0)
    assert not exact.parallel(exact.way(a, (b[0], b[1], b[2], b[3] + 1)), d) or exact.parallel(b[:3], d)


@given(DIRECTIONS)
def test_unit_vectors_are_as_long_and_as_directed(d: rational.Vector) -> None:
    u = exact.unit_of(d)
    assert abs(rational.length(u) - rational.ONE) <= 8
    assert rational.length(rational.cross(u, exact.unit_of(tuple(x << 300 for x in d)))) <= 8
    first, second = about(d)
    assert any(first)
    assert any(second)
    assert exact.inner(first, d) == exact.inner(second, d) == exact.inner(first, second) == 0


@given(POINTS, st.lists(st.tuples(INTEGERS, INTEGERS), min_size=3, max_size=6), DIRECTIONS)
def test_the_area_of_a_loop_is_across_its_plane(a: exact.Point, at: list[tuple[int, int]], d: rational.Vector) -> None:
    u, v = about(d)
    points: list[rational.Vector] = []
    for s, t in at:
        x, y, z = (a[k] + s * u[k] + t * v[k] for k in range(3))
        points.append((x, y, z))
    found = exact.area(points, [range(len(points))])
    assert exact.parallel(found, d)
    plane = exact.through((*p, 1) for p in points)
    assert plane is not None or not any(found)
    assert plane is None or all(exact.height(plane, (*p, 1)) == 0 for p in points)


@given(INTEGERS, INTEGERS, INTEGERS, *(st.integers(1, 10**4),) * 4)
def test_sums_of_roots_vanish_only_when_they_do(a: int, b: int, c: int, u: int, v: int, x: int, y: int) -> None:
    with mp.workdps(80):
        p, q = mp.mpf(u) / v, mp.mpf(x) / y
        value = a * mp.sqrt(p) + b * mp.sqrt(q) + c * mp.sqrt(p * q)
        assert exact.balanced(a, b, c, (u, v), (x, y)) == (abs(value) < mp.mpf(10) ** -40)


@given(*(st.integers(-20, 20),) * 3, *(st.integers(1, 5),) * 4)
def test_sums_of_rational_roots_are_told_as_well(a: int, b: int, c: int, u: int, v: int, x: int, y: int) -> None:
    whole = a * u * y + b * x * v + c * u * x
    assert exact.balanced(a, b, c, (u * u, v * v), (x * x, y * y)) == (whole == 0)


@given(st.integers(-20, 20), st.integers(-20, 20), st.integers(2, 50))
def test_equal_roots_take_each_other_away(a: int, b: int, n: int) -> None:
    assert exact.balanced(a, -a, 0, (n, 3), (n, 3))
    assert exact.balanced(a, b, 0, (n, 3), (n, 3)) == (a + b == 0)
    # a √n + b √n + c n with c n = −(a + b) √n needs √n to be whole.
    assert exact.balanced(a, b, -(a + b), (1, 1), (1, 1))


@given(DIRECTIONS, DIRECTIONS, DIRECTIONS, DIRECTIONS)
def test_directions_cancel_when_the_turned_one_is_level(
    n1: rational.Vector, n2: rational.Vector, normal: rational.Vector, d: rational.Vector
) -> None:
    """Under the identity what is across a normal is so exactly, and nothing else is."""
    assume(any(exact.outer(n1, n2)))
    one, two = (Turn(exact.unit_of(n), exact.unit_of(n), n, n, None) for n in (n1, n2))
    level_with = exact.outer(normal, d)
    assert cancel(one, two, normal, level_with)
    assert cancel(one, two, normal, d) == (exact.inner(normal, d) == 0)
    sine = rational.number(rational.length(rational.cross(one.body, two.body)))
    if sine > 0.125:
        image = image_of(one, two, exact.unit_of(d))
        assert rational.length(rational.sub(image, exact.unit_of(d))) < rational.ONE >> 230


# A line through points a fraction of a nanometre apart, the second of which is not quite where it should be: it would
# turn the wall by milliradians.
FRACTIONS = [3e-10, 1e-12, 1e-10, 1e-9, 2e-7]


def notched(along: float, off: float) -> Shape:
    """The peg with a vertex of no face beside v0, so far up its edge and so far off that."""
    body = box_body((-0.01, -0.01, 0.0), (0.01, 0.01, 0.04))
    x, y, z = body["vertices"][V0]
    return shape([*body["vertices"], [x + off, y, z + along]], body["faces"])


def with_peg(assembly: PartPair, peg: Shape) -> PartPair:
    assembly.moving, assembly.moving_pieces, assembly.body_points = peg, (peg,), peg.vertices
    return assembly


@pytest.mark.parametrize("along", FRACTIONS)
@pytest.mark.parametrize("off", [1e-17, 1e-13, 9e-13, 2e-12, 9e-12, 1e-10, 1e-9])
def test_a_vertex_beside_an_edge_in_a_wall_is_not_in_it(assembly: PartPair, along: float, off: float) -> None:
    peg = notched(along, off)
    known = facts(with_peg(assembly, peg), vertex_on(V0, LEFT), A)
    assert len(known.on(LEFT).points) == 2  # the ends of the edge
    assert (known.turns, known.on(LEFT).flush) == ([], [])
    # It may well be on or above the wall up to a picometre, from which nothing follows.
    done = known.not_below(LEFT, peg.vertices, [])
    assert (8 in done) == (off < 1e-12)
    assert V3 not in done


@pytest.mark.parametrize("along", [3e-10, 1e-9, 2e-7])
@pytest.mark.parametrize("off", [1e-13, 1e-12, 9e-12, 1e-10])
def test_a_line_through_two_close_points_holds_what_is_on_it(assembly: PartPair, along: float, off: float) -> None:
    """Both points are exactly in the wall: so is their line, however close they are, and no other point."""
    peg = notched(along, off)
    known = facts(with_peg(assembly, peg), vertex_on(V0, LEFT), beside_on(peg, 8))
    assert known.on(LEFT).points == [peg.vertices[V0], peg.vertices[8]]
    (line,) = known.on(LEFT).lines(assembly)
    assert known.turns == []
    x, y, z = (c << 16 for c in rational.sub(line.far, line.point))
    far = rational.add(line.point, (x, y, z))
    assert known.not_below(LEFT, [*peg.vertices, far], []) == {V0, 8, 9}
    assert not known.implies(V3_LEFT)


def test_points_too_close_for_a_direction_are_refused(assembly: PartPair) -> None:
    peg = notched(1e-10, 1e-12)
    with pytest.raises(rational.ArithmeticRefusal, match="no length"):
        facts(with_peg(assembly, peg), vertex_on(V0, LEFT), beside_on(peg, 8))


def beside_on(peg: Shape, k: int) -> Touch:
    return Touch(f"v{k}", "vertex-face", (peg.vertices[k],), (), LEFT, (LEFT,), 0, ((k,), ()))


@pytest.mark.parametrize("off", [1e-13, 1e-10, 1e-9])
def test_a_corner_off_a_flush_is_not_in_its_wall(assembly: PartPair, off: float) -> None:
    body = box_body((-0.01, -0.01, 0.0), (0.01, 0.01, 0.04))
    body["vertices"][V3][0] += off
    peg = shape(body["vertices"], body["faces"])
    third = Touch("v3", "vertex-face", (peg.vertices[V3],), (), LEFT, (LEFT,), 0, ((V3,), ()))
    known = facts(with_peg(assembly, peg), vertex_on(V0, LEFT), A, third)
    top = next(k for k, v in enumerate(peg.vertices) if same(v, PEG.vertices[V3 + 1]))
    assert peg.vertices[V3] in known.on(LEFT).points
    assert peg.vertices[top] not in known.on(LEFT).points  # it is off the plane through the three others


@pytest.mark.parametrize("off", [1e-10, 1e-13, 1e-16])
def test_walls_that_nearly_coincide_are_two(assembly: PartPair, off: float) -> None:
    body = box_body((-0.01 + off, -0.02, -0.03), (0.01, 0.02, 0.0))
    other = next(f.plane for f in shape(body["vertices"], body["faces"]).faces if f.plane.normal[0] < 0)
    beside = Plane(rational.neg(other.normal), -other.offset)
    assembly._levels[beside] = exact.level((1, 0, 0), exact.point((rational.fixed(-0.01 + off), 0, 0)))
    assert not assembly.agree(LEFT, beside)
    touch = Touch("w", "vertex-face", V3_LEFT.moving, (), beside, (beside,), 0, ((V3,), ()))
    known = facts(assembly, vertex_on(V0, LEFT), touch)
    assert (len(known.walls), known.on(LEFT).lines(assembly)) == (2, ())


@pytest.fixture(scope="module")
def honest() -> dict[str, Any]:
    return table_plan()


def with_exact(plan: dict[str, Any], *at: str, vertex: int = 0) -> dict[str, Any]:
    """The plan with exact coordinates of a vertex of the table, which is at (−0.05, −0.05, −0.02)."""
    fixed_part = {**plan["parts"]["fixed"], "exact": [{"vertex": vertex, "at": list(at)}]}
    return sealed({**plan, "parts": {**plan["parts"], "fixed": fixed_part}})


def as_stated(plan: dict[str, Any]) -> list[str]:
    return [str(Fraction(x)) for x in plan["parts"]["fixed"]["vertices"][0]]


def test_exact_coordinates_may_be_those_of_the_floats(honest: dict[str, Any]) -> None:
    verdict = verify(with_exact(honest, *as_stated(honest)))
    assert (verdict.verdict, verdict.margin) == (CERTIFIED, verify(honest).margin)


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("off", [Fraction(1, 10**30), Fraction(1, 10**13)])
def test_exact_coordinates_off_a_face_are_refused(honest: dict[str, Any], axis: int, off: Fraction) -> None:
    at = as_stated(honest)
    at[axis] = str(Fraction(at[axis]) + off)
    verdict = verify(with_exact(honest, *at))
    assert verdict.verdict == NOT_PROVED
    assert any("is not flat" in finding.message for finding in verdict.findings)


@pytest.mark.parametrize("off", [Fraction(1, 10**11), Fraction(1), Fraction(10**500)])
def test_exact_coordinates_far_from_the_floats_are_refused(honest: dict[str, Any], off: Fraction) -> None:
    at = as_stated(honest)
    at[2] = str(Fraction(at[2]) + off)
    with pytest.raises(PlanError, match="exact coordinates are not those stated"):
        verify(with_exact(honest, *at))


@pytest.mark.parametrize("text", ["", "1/0", "0.5", "1e3", "+1", "1/-2", "١", "1/2\n", " 1", "1" * 900, "1/02", None])
def test_what_is_no_fraction_is_refused(honest: dict[str, Any], text: Any) -> None:
    with pytest.raises(PlanError, match=r"exact\[0\]\.at\[0\]: must be a fraction"):
        verify(with_exact(honest, text, "0", "0"))


def test_a_vertex_has_one_exact_place(honest: dict[str, Any]) -> None:
    twice = with_exact(honest, *as_stated(honest))
    twice["parts"]["fixed"]["exact"] *= 2
    with pytest.raises(PlanError, match="repeats a vertex"):
        verify(sealed(twice))
    with pytest.raises(PlanError, match=r"exact\[0\]\.vertex"):
        verify(with_exact(honest, *as_stated(honest), vertex=8))
