"""The exact plane: meetings of curves, winding numbers, and the laws of regularised operators."""

import math

import numpy as np
import pytest
import shapely

from fmopt.errors import GeometryError
from fmopt.geometry.plane.boolean import difference, intersection, positive, union
from fmopt.geometry.plane.conic import ConicArc
from fmopt.geometry.plane.convolution import components
from fmopt.geometry.plane.curve import Arc, Curve, LineSegment
from fmopt.geometry.plane.meet import meet
from fmopt.geometry.plane.region import Region, polygon_region
from fmopt.spatial.values import Array
from tests.shared.plane_shapes import box, disc, ellipse_arcs, polygon

TOLERANCE = 1e-12


def ellipse(x: float, y: float, a: float, b: float, turn: float = 0.0) -> Region:
    major, minor = np.array([math.cos(turn), math.sin(turn)]), np.array([-math.sin(turn), math.cos(turn)])
    return Region((ellipse_arcs((x, y), a * major, b * minor),))


def star(rng: np.random.Generator) -> Region:
    count = int(rng.integers(5, 12))
    angles = (np.arange(count) + rng.uniform(0.1, 0.9, count)) * math.tau / count
    corners = rng.uniform(0.3, 1.0, count)[:, None] * np.column_stack([np.cos(angles), np.sin(angles)])
    return polygon_region(corners + rng.uniform(-0.5, 0.5, 2))


def shape(rng: np.random.Generator) -> Region:
    x, y, a, b, turn = rng.uniform(-0.4, 0.4), rng.uniform(-0.4, 0.4), *rng.uniform(0.3, 0.8, 2), rng.uniform(0.0, 3.0)
    return [star(rng), disc(x, y, a), ellipse(x, y, a, b, turn), box(x - a, y - b, 2.0 * a, 1.5 * b)][rng.integers(4)]


def random_curve(rng: np.random.Generator) -> Curve:
    kind = int(rng.integers(3))
    if kind == 0:
        return LineSegment(*rng.uniform(-1.0, 1.0, (2, 2)))
    if kind == 1:
        return Arc(rng.uniform(-0.5, 0.5, 2), *rng.uniform([0.2, 0.0, -6.0], [1.0, 6.0, 6.0]).tolist())
    return ConicArc(*rng.uniform(-1.0, 1.0, (3, 2)), float(rng.uniform(0.3, 2.5)))


def crossings_by_polylines(a: Curve, b: Curve) -> Array:
    """Points (n, 2) where fine polylines of two curves cross."""
    t = np.linspace(0.0, 1.0, 4001)
    met = shapely.intersection(shapely.linestrings(a.point(t)), shapely.linestrings(b.point(t)))
    return np.asarray(shapely.get_coordinates(met))


@pytest.mark.parametrize("seed", range(24))
def test_meetings_are_all_the_crossings(seed: int) -> None:
    rng = np.random.default_rng(seed)
    a, b = random_curve(rng), random_curve(rng)
    pairs = np.array(meet(a, b, TOLERANCE)).reshape(-1, 2)
    points = a.point(pairs[:, 0])
    assert np.linalg.norm(points - b.point(pairs[:, 1]), axis=1).max(initial=0.0) <= 2.0 * TOLERANCE
    wanted = crossings_by_polylines(a, b)
    for one, other in ((wanted, points), (points, wanted)):
        gaps = np.linalg.norm(one[:, None] - other, axis=2).min(axis=1, initial=np.inf)
        assert gaps.max(initial=0.0) <= 1e-4
    np.testing.assert_allclose(
        np.sort(pairs, axis=0), np.sort(np.array(meet(b, a, TOLERANCE)).reshape(-1, 2)[:, ::-1], axis=0), atol=1e-9
    )


def test_tangent_curves_meet_once() -> None:
    circle = Arc(np.zeros(2), 1.0, 0.3, math.tau)
    assert [round(s * 2.0 - 1.0, 9) for s, _ in meet(LineSegment((-1.0, 1.0), (1.0, 1.0)), circle, TOLERANCE)] == [0.0]
    for x, radius in ((3.0, 2.0), (0.5, 0.5)):
        met = meet(circle, Arc(np.array([x, 0.0]), radius, 0.3, math.tau), TOLERANCE)
        np.testing.assert_allclose(circle.point([s for s, _ in met]), [(1.0, 0.0)], atol=1e-6)
    arch = ConicArc((-1.0, 0.0), (0.0, 2.0), (1.0, 0.0), 1.0)
    (met,) = meet(arch, LineSegment((-1.0, 1.0), (1.0, 1.0)), TOLERANCE)
    assert met == pytest.approx((0.5, 0.5), abs=1e-6)


@pytest.mark.parametrize("d", [0.01, 0.3, 1.0, 1.7, 2.4, 2.499])
def test_the_lens_of_two_discs(d: float) -> None:
    r, s = 1.5, 1.0
    one, two = disc(0.2, -0.1, r), disc(0.2 + d * 0.6, -0.1 + d * 0.8, s)
    if d <= r - s:
        lens = math.pi * s**2
    else:
        a, b = (d**2 + r**2 - s**2) / (2.0 * d * r), (d**2 + s**2 - r**2) / (2.0 * d * s)
        lens = r**2 * (math.acos(a) - a * math.sqrt(1.0 - a**2)) + s**2 * (math.acos(b) - b * math.sqrt(1.0 - b**2))
    assert intersection(one, two).area == pytest.approx(lens, rel=1e-9)
    assert union([one, two]).area == pytest.approx(math.pi * (r**2 + s**2) - lens, rel=1e-12)
    assert difference(one, two).area == pytest.approx(math.pi * r**2 - lens, rel=1e-12)


@pytest.mark.parametrize("seed", range(6))
def test_areas_add_up_and_de_morgan(seed: int) -> None:
    rng = np.random.default_rng(1000 + seed)
    a, b, c = shape(rng), shape(rng), shape(rng)
    ab, bc, ca = intersection(a, b), intersection(b, c), intersection(c, a)
    whole = a.area + b.area + c.area - ab.area - bc.area - ca.area + intersection(ab, c).area
    assert union([a, b, c]).area == pytest.approx(whole, rel=1e-11)
    assert difference(a, b).area == pytest.approx(a.area - ab.area, rel=1e-11, abs=1e-12)
    room = box(-3.0, -3.0, 6.0, 6.0)
    outside = [difference(room, one) for one in (a, b)]
    assert intersection(*outside).area == pytest.approx(difference(room, union([a, b])).area, rel=1e-12)
    assert union(outside).area == pytest.approx(difference(room, ab).area, rel=1e-12)
    assert union([ab, difference(a, b)]).area == pytest.approx(a.area, rel=1e-11)
    assert difference(a, a).empty
    assert union([a, a]).area == pytest.approx(a.area, rel=1e-13)


def test_what_lies_in_a_hole_is_a_part_of_the_polygon() -> None:
    rings = [box(-k, -k, 2.0 * k, 2.0 * k).loops[0] for k in (4.0, 3.0, 2.0, 1.0)]
    nested = difference(union([Region((rings[0],))]), Region((rings[1],)))
    nested = union([nested, difference(Region((rings[2],)), Region((rings[3],)))])
    assert polygon(nested, 1e-6).area == pytest.approx(nested.area) == pytest.approx(64.0 - 36.0 + 16.0 - 4.0)


@pytest.mark.parametrize("seed", range(6))
def test_membership_follows_the_operators(seed: int) -> None:
    rng = np.random.default_rng(2000 + seed)
    a, b = shape(rng), shape(rng)
    points = rng.uniform(-1.5, 1.5, (200, 2))
    clear = np.minimum(a.boundary_distance(points), b.boundary_distance(points)) > 1e-9
    points = points[clear]
    ina, inb = a.contains(points), b.contains(points)
    np.testing.assert_array_equal(union([a, b]).contains(points), ina | inb)
    np.testing.assert_array_equal(intersection(a, b).contains(points), ina & inb)
    np.testing.assert_array_equal(difference(a, b).contains(points), ina & ~inb)


@pytest.mark.parametrize("seed", range(6))
def test_polygons_agree_with_shapely(seed: int) -> None:
    rng = np.random.default_rng(3000 + seed)
    a, b = star(rng), star(rng)
    p, q = polygon(a, 1e-9), polygon(b, 1e-9)
    made = (union([a, b]), p.union(q)), (intersection(a, b), p.intersection(q)), (difference(a, b), p.difference(q))
    for found, wanted in made:
        assert found.area == pytest.approx(wanted.area, rel=1e-12, abs=1e-14)
        if not found.empty:
            assert polygon(found, 1e-9).hausdorff_distance(wanted) <= 1e-10


@pytest.mark.parametrize("seed", range(4))
def test_winding_of_loops_that_cross_themselves(seed: int) -> None:
    """Points round which a closed chain of curves turns at least once, by the angle that they see it run through."""
    rng = np.random.default_rng(4000 + seed)
    corners = rng.uniform(-1.0, 1.0, (6, 2))
    chain: list[Curve] = []
    for k, (a, b) in enumerate(zip(corners, np.roll(corners, -1, axis=0), strict=True)):
        shoulder = 0.5 * (a + b) + rng.uniform(-0.3, 0.3, 2)
        chain.append(LineSegment(a, b) if k % 2 else ConicArc(a, shoulder, b, float(rng.uniform(0.4, 1.8))))
    region = positive(chain)
    points = rng.uniform(-1.0, 1.0, (200, 2))
    run = np.vstack([curve.point(np.linspace(0.0, 1.0, 400, endpoint=False)) for curve in chain])
    x, y = (np.vstack([run, run[:1]])[:, None] - points).transpose(2, 0, 1)
    angles = np.arctan2(y, x)
    turns = np.round(np.sum(np.angle(np.exp(1j * np.diff(angles, axis=0))), axis=0) / math.tau)
    near = np.min(np.hypot(x, y), axis=0) < 0.02
    np.testing.assert_array_equal(region.contains(points)[~near], turns[~near] >= 1.0)


def test_touching_operands() -> None:
    """Common edges vanish, a touching corner or disc joins nothing, and internal contact leaves a cusp."""
    joined = union([box(0.0, 0.0, 1.0, 1.0), box(1.0, 0.0, 1.0, 1.0)])
    assert (len(joined.loops), len(joined.curves)) == (1, 4)
    assert len(union([box(0.0, 0.0, 1.0, 1.0), box(1.0, 1.0, 1.0, 1.0)]).loops) == 2
    assert intersection(disc(0.0, 0.0, 1.0), disc(2.0, 0.0, 1.0)).empty
    assert union([disc(0.0, 0.0, 1.0), disc(2.0, 0.0, 1.0)]).area == pytest.approx(math.tau, rel=1e-14)
    crescent = difference(disc(0.0, 0.0, 1.0), disc(0.5, 0.0, 0.5))
    assert crescent.area == pytest.approx(0.75 * math.pi, rel=1e-14)
    assert difference(disc(0.0, 0.0, 1.0), disc(0.0, 0.0, 1.0)).empty


def test_components_own_their_holes() -> None:
    ring = difference(disc(0.0, 0.0, 3.0), disc(0.0, 0.0, 2.0))
    islands = union([ring, difference(disc(0.0, 0.0, 1.0), disc(0.1, 0.0, 0.5)), disc(5.0, 0.0, 1.0)])
    parts = components(islands)
    areas = sorted(part.area / math.pi for part in parts)
    assert areas == pytest.approx([0.75, 1.0, 5.0], rel=1e-14)
    assert components(Region(())) == []


def test_open_loops_are_refused() -> None:
    with pytest.raises(GeometryError, match=r"loop 0 of a region is open by 1 m"):
        Region(((LineSegment((0.0, 0.0), (1.0, 0.0)), LineSegment((1.0, 0.0), (1.0, 1.0))),))
    with pytest.raises(GeometryError, match="has no bounding box"):
        _ = Region(()).box
