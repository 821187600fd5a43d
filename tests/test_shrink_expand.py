"""Expansions of cut-diagrams against Shapely, closed forms and sampling."""

from __future__ import annotations

import math
from itertools import product

import numpy as np
import pytest
import shapely
from shapely.geometry.base import BaseGeometry

from fmopt.nominal.shrink_expand import expanded
from fmopt.plane.boolean import difference, intersection, union
from fmopt.plane.curve import Arc
from fmopt.plane.region import Region, polygon_region
from fmopt.values import Array


def disc(x: float, y: float, radius: float) -> Region:
    return Region(((Arc(np.array([x, y]), radius, 0.0, math.tau),),))


def box(x: float, y: float, width: float, height: float) -> Region:
    return polygon_region([(x, y), (x + width, y), (x + width, y + height), (x, y + height)])


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
    cut = shapely.constrained_delaunay_triangles(region.polygon(1e-9))
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
    assert found.polygon(1e-9).hausdorff_distance(wanted) <= 1e-9


def test_a_square_grown_by_a_disc() -> None:
    a, r = 2.0, 0.7
    for G, section in ((box(0.0, 0.0, a, a), disc(0.0, 0.0, r)), (disc(0.0, 0.0, r), box(0.0, 0.0, a, a))):
        grown = expanded(G, [section])
        assert grown.area == pytest.approx(math.pi * r**2 + 4.0 * a * r + a**2, rel=1e-14)
        assert sorted(type(curve).__name__ for curve in grown.curves) == ["Arc"] * 4 + ["Segment"] * 4


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
    assert expanded(G, [Region(()), G]).hausdorff(grown) == 0.0
