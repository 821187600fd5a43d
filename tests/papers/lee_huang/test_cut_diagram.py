"""Cut-diagrams against the solids: polyhedral trees by sections of their pieces, curved ones by membership."""

import math

import numpy as np
import pytest

from fmopt.geometry import csg
from fmopt.geometry.part import part_of
from fmopt.geometry.plane.boolean import difference, intersection, union
from fmopt.geometry.plane.region import polygon_region
from fmopt.geometry.section import section
from fmopt.papers.lee_huang.cut_diagram import cut_diagram
from fmopt.spatial.se3 import Pose, exp
from fmopt.spatial.values import Array
from tests.shared.plane_shapes import polygon

HEXAGON = tuple((math.cos(k * math.pi / 3.0), math.sin(k * math.pi / 3.0)) for k in range(6))


def random_pose(rng: np.random.Generator, reach: float) -> Pose:
    return Pose(rng.uniform(-reach, reach, 3), exp(rng.normal(size=3)))


def random_tree(rng: np.random.Generator, primitives: list[csg.Solid], depth: int) -> csg.Solid:
    """A tree of unions and differences; the first operand stays in the middle so that something is left."""
    if depth == 0:
        return csg.Moved(primitives[int(rng.integers(len(primitives)))], random_pose(rng, 0.5))
    one, two = (random_tree(rng, primitives, depth - 1) for _ in range(2))
    return csg.Union((one, two)) if rng.random() < 0.6 else csg.Difference(one, (two,))


def held(solid: csg.Solid, points: Array) -> Array:
    """Which points (n, 3) lie in a solid, from its definition; curved surfaces as they are."""
    x, y, z = points.T
    match solid:
        case csg.Cylinder(radius, height, _):
            return np.asarray((x**2 + y**2 <= radius**2) & (z >= 0.0) & (z <= height))
        case csg.Cone(bottom, top, height, _):
            radius = bottom + (top - bottom) * z / height
            return np.asarray((x**2 + y**2 <= radius**2) & (z >= 0.0) & (z <= height))
        case csg.Sphere(radius, _):
            return np.asarray(x**2 + y**2 + z**2 <= radius**2)
        case csg.Box() | csg.Prism() | csg.Wedge():
            body = csg.convex_polyhedron(solid, Pose.identity())
            return np.asarray(np.all(points @ body.normals.T <= body.offsets, axis=1))
        case csg.Moved(inner, pose):
            return held(inner, (points - pose.p) @ pose.R)
        case csg.Union(parts):
            return np.asarray(np.any([held(part, points) for part in parts], axis=0))
        case csg.Difference(base, tools):
            return np.asarray(held(base, points) & ~np.any([held(tool, points) for tool in tools], axis=0))
    raise AssertionError(solid)


@pytest.mark.parametrize("seed", range(12))
def test_polyhedral_trees_have_the_sections_of_their_pieces(seed: int) -> None:
    rng = np.random.default_rng(seed)
    solids: list[csg.Solid] = [csg.Box((1.0, 0.8, 0.6)), csg.Prism(HEXAGON, 0.7), csg.Wedge((1.0, 0.9, 0.8), 0.4)]
    solid = csg.Union((csg.Box((1.2, 1.2, 0.4)), random_tree(rng, solids, 2)))
    pieces = part_of("tree", solid).pieces
    for _ in range(3):
        plane = random_pose(rng, 0.2)
        region, wanted = cut_diagram(solid, plane), section(pieces, plane)
        assert region.area == pytest.approx(wanted.area, rel=1e-9, abs=1e-12)
        if not region.empty:
            assert polygon(region, 1e-9).hausdorff_distance(wanted) <= 1e-9


@pytest.mark.parametrize("seed", range(12))
def test_curved_trees_hold_exactly_what_the_solid_holds(seed: int) -> None:
    rng = np.random.default_rng(100 + seed)
    solids: list[csg.Solid] = [csg.Cylinder(0.4, 0.9), csg.Cone(0.5, 0.2, 0.8), csg.Sphere(0.5)]
    solid = csg.Union((csg.Sphere(0.45), random_tree(rng, solids, 2)))
    plane = random_pose(rng, 0.2)
    region = cut_diagram(solid, plane)
    uv = rng.uniform(-1.2, 1.2, (4000, 2))
    clear = region.boundary_distance(uv) > 1e-9 if not region.empty else np.ones(len(uv), dtype=bool)
    points = uv @ plane.R[:, :2].T + plane.p
    np.testing.assert_array_equal(region.contains(uv)[clear], held(solid, points)[clear])


def crossings(solid: csg.Solid, start: Array, along: Array) -> Array:
    """Where a line enters or leaves one of the primitives of a tree, as parameters, from their equations."""
    match solid:
        case csg.Cylinder(radius, height, _):
            return _through(height, start, along, (radius, 0.0))
        case csg.Cone(bottom, top, height, _):
            return _through(height, start, along, (bottom, (top - bottom) / height))
        case csg.Sphere(radius, _):
            return _roots(along @ along, start @ along, start @ start - radius**2)
        case csg.Box() | csg.Prism() | csg.Wedge():
            body = csg.convex_polyhedron(solid, Pose.identity())
            return np.asarray((body.offsets - body.normals @ start) / (body.normals @ along))
        case csg.Moved(inner, pose):
            return crossings(inner, (start - pose.p) @ pose.R, along @ pose.R)
        case csg.Union(parts):
            return np.concatenate([crossings(part, start, along) for part in parts])
        case csg.Difference(base, tools):
            return np.concatenate([crossings(part, start, along) for part in (base, *tools)])
    raise AssertionError(solid)


def _through(height: float, start: Array, along: Array, radius: tuple[float, float]) -> Array:
    """A line through both ends and the side x² + y² = (a + b z)² of a cylinder or cone."""
    (a, b), flat = radius, np.array([1.0, 1.0, 0.0])
    at, rate = a + b * start[2], b * along[2]
    side = _roots(flat * along @ along - rate**2, flat * start @ along - at * rate, flat * start @ start - at**2)
    return np.concatenate([side, (np.array([0.0, height]) - start[2]) / along[2]])


def _roots(a: float, b: float, c: float) -> Array:
    """Of a t² + 2 b t + c."""
    inside = b * b - a * c
    return np.zeros(0) if inside < 0.0 else (-b + np.array([-1.0, 1.0]) * math.sqrt(inside)) / a


@pytest.mark.parametrize("seed", range(6))
def test_lines_cross_a_cut_diagram_where_they_cross_the_solid(seed: int) -> None:
    """Trees of all primitives: a line of the plane has the same stretches in both, their ends to 1e-9."""
    rng = np.random.default_rng(500 + seed)
    solids = [csg.Cylinder(0.4, 0.9), csg.Cone(0.5, 0.2, 0.8), csg.Sphere(0.5), csg.Box((0.8, 0.7, 0.6))]
    solids += [csg.Prism(HEXAGON, 0.4), csg.Wedge((0.9, 0.8, 0.7), 0.4)]
    solid = csg.Union((csg.Sphere(0.45), random_tree(rng, solids, 3)))
    plane = random_pose(rng, 0.2)
    region = cut_diagram(solid, plane)
    for angle, offset in zip(rng.uniform(0.0, math.pi, 30), rng.uniform(-0.6, 0.6, 30), strict=True):
        along, across = np.array([math.cos(angle), math.sin(angle)]), np.array([-math.sin(angle), math.cos(angle)])
        line = plane.R[:, :2] @ along
        found = np.sort(crossings(solid, plane.p + plane.R[:, :2] @ (offset * across), line))
        cells = np.concatenate([[-3.0], found[np.abs(found) < 3.0], [3.0]])
        wide = np.diff(cells) > 1e-6
        middle = (0.5 * (cells[1:] + cells[:-1]))[wide]
        uv = offset * across + middle[:, None] * along
        inside = held(solid, uv @ plane.R[:, :2].T + plane.p)
        np.testing.assert_array_equal(region.contains(uv), inside)
        ends = cells[:-1][wide][1:][inside[1:] != inside[:-1]]
        if len(ends):
            assert region.boundary_distance(offset * across + ends[:, None] * along).max() <= 1e-9


def test_sections_of_round_primitives_are_exact() -> None:
    tilted = Pose(np.array([0.0, 0.0, 0.5]), exp([0.3, 0.0, 0.0]))
    assert cut_diagram(csg.Cylinder(0.1, 1.0), tilted).area == pytest.approx(math.pi * 0.01 / math.cos(0.3), rel=1e-12)
    above = Pose(np.array([0.0, 0.0, 0.3]), np.eye(3))
    assert cut_diagram(csg.Sphere(0.5), above).area == pytest.approx(math.pi * (0.25 - 0.09), rel=1e-12)
    assert cut_diagram(csg.Cone(0.4, 0.2, 1.0), above).area == pytest.approx(math.pi * 0.34**2, rel=1e-12)


def test_the_interior_is_on_the_left_and_holes_turn_the_other_way() -> None:
    drilled = csg.Difference(csg.Box((0.06, 0.06, 0.04)), (csg.Cylinder(0.01, 0.04),))
    region = cut_diagram(drilled, Pose(np.array([0.0, 0.0, 0.02]), np.eye(3)))
    assert len(region.loops) == 2
    assert region.area == pytest.approx(0.0036 - math.pi * 1e-4, rel=1e-12)
    for curve in region.curves:
        t = np.array([0.5])
        left = curve.tangent(t)[..., ::-1] * (-1.0, 1.0)
        inside = curve.point(t) + 1e-6 * left / np.linalg.norm(left)
        assert region.contains(inside).all()


def test_a_plane_in_a_face_gives_what_both_sides_share() -> None:
    box = csg.Box((0.1, 0.1, 0.1))
    stacked = csg.Union((box, csg.Moved(box, Pose(np.array([0.0, 0.0, 0.1]), np.eye(3)))))
    seam = Pose(np.array([0.0, 0.0, 0.1]), np.eye(3))
    assert cut_diagram(stacked, seam).area == pytest.approx(0.01, rel=1e-12)
    assert cut_diagram(box, seam).empty


def test_regularised_operators_add_up() -> None:
    """|A ∪ B| = |A| + |B| − |A ∩ B| and |A − B| = |A| − |A ∩ B|, edges in common or not."""
    rng = np.random.default_rng(5)
    for k in range(40):
        shift = rng.integers(-2, 3, 2) * 0.5 if k % 2 else rng.uniform(-1.0, 1.0, 2)
        square = np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)])
        one, two = polygon_region(square), polygon_region(square + shift)
        common = intersection(one, two).area
        assert union([one, two]).area == pytest.approx(2.0 - common, abs=1e-12)
        assert difference(one, two).area == pytest.approx(1.0 - common, abs=1e-12)
        expected = max(0.0, 1.0 - abs(shift[0])) * max(0.0, 1.0 - abs(shift[1]))
        assert common == pytest.approx(expected, abs=1e-12)
