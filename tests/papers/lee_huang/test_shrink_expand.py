"""Expansions of cut-diagrams against Shapely, closed forms and sampling."""

import math
from itertools import product

import numpy as np
import pytest
import shapely
from shapely.geometry.base import BaseGeometry

from fmopt.geometry.plane.boolean import difference, intersection, union
from fmopt.geometry.plane.region import Region, polygon_region
from fmopt.geometry.plane.turning import turn_swept, turned
from fmopt.papers.lee_huang.shrink_expand import expanded
from fmopt.spatial.values import Array
from tests.shared.plane_shapes import box, disc, ellipse_arcs, polygon


def ellipse(x: float, y: float, a: float, b: float) -> Region:
    return Region((ellipse_arcs((x, y), (a, 0.0), (0.0, b)),))


def round_tree(rng: np.random.Generator) -> Region:
    """A disc or an ellipse, with a bite and a hole, and a bar."""
    body = disc(0.0, 0.0, 0.6) if rng.random() < 0.5 else ellipse(0.0, 0.0, 0.7, 0.5)
    bite = disc(*rng.uniform(0.3, 0.7, 2), float(rng.uniform(0.2, 0.5)))
    hole = disc(*rng.uniform(-0.25, 0.05, 2), float(rng.uniform(0.15, 0.25)))
    return union([difference(difference(body, bite), hole), box(-1.0, -0.6, float(rng.uniform(0.3, 1.5)), 0.15)])


def overlaps(G: Region, section: Region, centres: Array) -> Array:
    """How deep (n,), at least, the section placed at each centre (n, 2) reaches into G, in m: 0 or sampled."""
    low, high = section.box
    grid = np.stack(np.meshgrid(*np.linspace(low, high, 9).T), axis=-1).reshape(-1, 2)
    edges = np.vstack([curve.point(np.linspace(0.0, 1.0, 7)) for curve in section.curves])
    probes = np.vstack([grid[section.contains(grid)], edges])
    depths = G.depth((centres[:, None] + probes).reshape(-1, 2)).reshape(len(centres), -1)
    return np.asarray(np.maximum(depths.max(axis=1), 0.0))


def random_convex(rng: np.random.Generator, size: float) -> Region:
    angles = np.sort(rng.uniform(0.0, math.tau, int(rng.integers(3, 8))))
    corners = rng.uniform(-0.6, 0.6, 2) + size * np.column_stack([np.cos(angles), np.sin(angles)])
    return polygon_region(corners)


def random_tree(rng: np.random.Generator, depth: int) -> Region:
    """A polygon of unions and differences, convex or not, with holes or not."""
    if depth == 0:
        return random_convex(rng, float(rng.uniform(0.2, 0.7)))
    one, two = random_tree(rng, depth - 1), random_tree(rng, depth - 1)
    return union([one, two]) if rng.random() < 0.6 else difference(one, two)


def triangles(region: Region) -> list[Array]:
    """Corners (3, 2) of triangles that make up a polygonal region."""
    cut = shapely.constrained_delaunay_triangles(polygon(region, 1e-9))
    return [np.asarray(one.exterior.coords)[:3] for one in cut.geoms]


def minkowski(first: Region, second: Region) -> BaseGeometry:
    """A ⊕ (−B) as the union of the hulls of all pairwise differences of triangles' corners."""
    hulls = [
        shapely.MultiPoint((a[:, None] - b[None]).reshape(-1, 2)).convex_hull
        for a, b in product(triangles(first), triangles(second))
    ]
    return shapely.union_all(hulls)


@pytest.mark.parametrize("seed", range(20))
def test_expansions_of_polygons_are_minkowski_sums(seed: int) -> None:
    rng = np.random.default_rng(seed)
    G, section = union([box(-0.1, -0.1, 0.2, 0.2), random_tree(rng, 3)]), random_tree(rng, 1 + seed % 2)
    section = box(-0.3, -0.1, 0.4, 0.2) if section.empty else section
    wanted, found = minkowski(G, section), expanded(G, [section])
    assert found.area == pytest.approx(wanted.area, rel=1e-9)
    assert polygon(found, 1e-9).hausdorff_distance(wanted) <= 1e-9


def test_a_square_grown_by_a_disc() -> None:
    a, r = 2.0, 0.7
    for G, section in ((box(0.0, 0.0, a, a), disc(0.0, 0.0, r)), (disc(0.0, 0.0, r), box(0.0, 0.0, a, a))):
        grown = expanded(G, [section])
        assert grown.area == pytest.approx(math.pi * r**2 + 4.0 * a * r + a**2, rel=1e-14)
        assert sorted(type(curve).__name__ for curve in grown.curves) == ["Arc"] * 4 + ["LineSegment"] * 4


def test_holes_shrink_and_vanish() -> None:
    ring = difference(disc(0.0, 0.0, 2.0), disc(0.0, 0.0, 1.0))
    assert expanded(ring, [disc(0.0, 0.0, 0.3)]).area == pytest.approx(math.pi * (2.3**2 - 0.7**2), rel=1e-14)
    assert expanded(disc(0.0, 0.0, 0.3), [ring]).area == pytest.approx(math.pi * (2.3**2 - 0.7**2), rel=1e-14)
    assert expanded(ring, [disc(0.0, 0.0, 1.0)]).area == pytest.approx(9.0 * math.pi, rel=1e-14)
    assert expanded(ring, [disc(0.0, 0.0, 1.5)]).area == pytest.approx(3.5**2 * math.pi, rel=1e-14)


def test_the_expansion_of_a_difference_is_not_the_difference_of_expansions() -> None:
    block, bore, peg = box(0.0, 0.0, 6.0, 3.0), box(2.0, 1.0, 2.0, 2.0), box(-0.5, 0.0, 1.0, 2.0)
    G = difference(block, bore)
    right = expanded(G, [peg])
    assert right.area == pytest.approx(minkowski(G, peg).area, rel=1e-12)
    wrong = difference(expanded(block, [peg]), expanded(bore, [peg]))
    assert difference(right, wrong).area > 1.0
    assert intersection(right, wrong).area == pytest.approx(wrong.area, rel=1e-12)


def test_empty_operands() -> None:
    G = box(0.0, 0.0, 1.0, 1.0)
    assert expanded(G, []) is G
    assert expanded(G, [Region(())]) is G
    assert expanded(Region(()), [G]).empty
    grown = expanded(G, [G])
    assert difference(expanded(G, [Region(()), G]), grown).empty
    assert difference(grown, expanded(G, [Region(()), G])).empty


@pytest.mark.parametrize("seed", range(6))
def test_assertion_1(seed: int) -> None:
    """The expansion by a union of instances is the union of the expansions, and so over a union of what is fixed."""
    rng = np.random.default_rng(200 + seed)
    fixed = [random_tree(rng, 1) for _ in range(2)]
    moving = [random_convex(rng, 0.4) for _ in range(2)] + [disc(0.2, 0.1, 0.3)]
    G = union(fixed)
    whole = expanded(G, moving)
    for other in (
        expanded(G, [union(moving)]),
        union([expanded(G, [section]) for section in moving]),
        union([expanded(part, moving) for part in fixed if not part.empty]),
    ):
        assert other.area == pytest.approx(whole.area, rel=1e-9)
        for one, two in ((other, whole), (whole, other)):
            points = np.vstack([curve.point(np.linspace(0.0, 1.0, 5)) for curve in one.curves])
            assert two.boundary_distance(points).max() <= 1e-9


@pytest.mark.parametrize("seed", range(5))
def test_membership_of_round_expansions(seed: int) -> None:
    """Inside GE, and only there, the section overlaps G: centres by sampling, both ways."""
    rng = np.random.default_rng(300 + seed)
    G, section = round_tree(rng), round_tree(rng).moved(np.eye(2), rng.uniform(-0.2, 0.2, 2))
    GE = expanded(G, [section], 1e-5)
    low, high = GE.box
    centres = rng.uniform(low, high, (60, 2))
    depth = overlaps(G, section, centres)
    inside = GE.contains(centres)
    assert not np.any(~inside & (depth > 1e-9))
    clear = GE.depth(centres) > 0.2
    assert np.all(depth[clear] > 0.0)
    assert clear.any()
    assert not inside.all()


@pytest.mark.parametrize("radius", [0.1, 0.5, 1.3])
@pytest.mark.parametrize("tolerance", [1e-3, 1e-6])
def test_conic_offsets_lie_outside_and_within_the_tolerance(radius: float, tolerance: float) -> None:
    """Around an ellipse, and around an elliptic hole, where the offset may have cusps."""
    solid = ellipse(0.1, 0.2, 2.0, 1.0)
    for G in (solid, difference(box(-3.0, -3.0, 6.0, 6.0), solid)):
        GE = expanded(G, [disc(0.0, 0.0, radius)], tolerance)
        for curve in GE.curves:
            away = G.distance(curve.point(np.linspace(0.0, 1.0, 9))) - radius
            assert away.min() >= -1e-12
            assert away.max() <= tolerance
        assert len(GE.curves) < 120


def test_conics_beside_polygons_are_exact() -> None:
    grown = expanded(ellipse(0.3, 0.0, 2.0, 1.0), [box(-0.5, -0.5, 1.0, 1.0)])
    assert grown.area == pytest.approx(2.0 * math.pi + 4.0 + 2.0 + 1.0, rel=1e-12)
    assert len(grown.curves) == 8


def test_touching_cusped_and_pinched_boundaries() -> None:
    grown = expanded(difference(disc(0.0, 0.0, 1.0), disc(0.5, 0.0, 0.5)), [disc(0.0, 0.0, 0.2)])
    assert grown.area == pytest.approx(math.pi * (1.2**2 - 0.3**2), rel=1e-9)
    pinched = union([box(0.0, 0.0, 1.0, 1.0), box(1.0, 1.0, 1.0, 1.0)])
    section = box(-0.1, -0.1, 0.2, 0.2)
    assert expanded(pinched, [section]).area == pytest.approx(2.0 * 1.44 - 0.04, rel=1e-12)
    holed = difference(box(-1.0, -1.0, 2.0, 2.0), disc(0.0, 0.0, 1.0))
    rest = difference(box(-1.1, -1.1, 2.2, 2.2), intersection(*(disc(x, 0.0, 1.0) for x in (-0.1, 0.1))))
    assert expanded(holed, [box(-0.1, -0.1, 0.2, 0.2)]).area > rest.area


def test_a_peg_as_wide_as_its_hole_leaves_nothing_free() -> None:
    plate = difference(box(-2.0, -2.0, 4.0, 4.0), box(-0.5, -0.5, 1.0, 1.5))
    assert expanded(plate, [box(-0.5, -0.2, 1.0, 0.4)]).area == pytest.approx(5.0 * 4.4, rel=1e-12)
    free = difference(box(-3.0, -3.0, 6.0, 6.0), expanded(plate, [box(-0.4, -0.2, 0.8, 0.4)]))
    assert free.contains([(0.0, 0.0), (0.11, 0.0)]).tolist() == [True, False]


@pytest.mark.parametrize(("first", "last"), [(0.0, 0.4), (-1.0, 1.5), (0.5, 7.0)])
@pytest.mark.parametrize("seed", range(3))
def test_sections_swept_in_orientation(seed: int, first: float, last: float) -> None:
    rng = np.random.default_rng(400 + seed)
    for section in (random_tree(rng, 1), round_tree(rng), box(0.2, -0.1, 0.5, 0.2)):
        if section.empty:
            continue
        swept = turn_swept(section, first, last)
        low, high = swept.box
        points = rng.uniform(low - 0.1, high + 0.1, (150, 2))
        angles = np.linspace(first, last, 100)
        held = np.any([turned(section, angle).contains(points) for angle in angles], axis=0)
        depth = swept.depth(points)
        assert not np.any(held & (depth < -1e-9))
        assert np.all(held[depth > 0.03 * (last - first)])


def test_an_edge_turning_sweeps_a_sector() -> None:
    wiper = box(0.0, -0.1, 1.0, 0.1)
    swept = turn_swept(wiper, 0.0, 1.0)
    assert swept.area == pytest.approx(0.1 + 0.5 * (1.0 + 0.1**2), rel=1e-12)
    assert turn_swept(wiper, 0.0, 7.0).area == pytest.approx(math.pi * 1.01, rel=1e-12)
    assert turn_swept(wiper, 0.5, 0.5).area == pytest.approx(0.1, rel=1e-12)


def test_expansion_over_an_orientation_interval() -> None:
    rng = np.random.default_rng(7)
    G = difference(box(-1.0, -1.0, 2.0, 1.0), box(-0.3, -0.6, 0.6, 0.6))
    section, interval = box(-0.2, 0.0, 0.4, 0.7), (-0.2, 0.3)
    whole = expanded(G, [turn_swept(section, *interval)])
    low, high = whole.box
    centres = rng.uniform(low, high, (1000, 2))
    steps = [expanded(G, [turned(section, angle)]) for angle in np.linspace(*interval, 60)]
    held = np.any([step.contains(centres) for step in steps], axis=0)
    depth = whole.depth(centres)
    assert not np.any(held & (depth < -1e-9))
    assert np.all(held[depth > 0.005])
    assert whole.area > max(step.area for step in steps) + 0.05
