"""Boundaries of planar uncertainty sets: exact arcs and segments, their valid ranges, degenerate input, polygons."""

import math
from collections.abc import Iterator

import numpy as np
import pytest
import shapely

from fmopt.errors import GeometryError
from fmopt.geometry.plane.curve import Arc, distance
from fmopt.papers.basanez_suarez.boundary import BoundaryPiece, Carrier
from fmopt.papers.basanez_suarez.contact import ContactType
from fmopt.papers.basanez_suarez.edge import Case, TurnedEdge, edge_position
from fmopt.papers.basanez_suarez.gap import wrapped
from fmopt.papers.basanez_suarez.planar_set import PlanarSet
from fmopt.papers.basanez_suarez.reach import Reach
from fmopt.papers.basanez_suarez.vertex import ArcSum, vertex_position
from tests.shared.planar_sampling import instances

ORIGIN = (0.0, 0.0)


def random_sets(count: int) -> Iterator[PlanarSet]:
    for kind, case in ((ContactType.TYPE_1, None), (ContactType.TYPE_2, Case.A), (ContactType.TYPE_2, Case.B)):
        for instance in instances(kind, case, count, seed=11):
            yield instance.cu.at(instance.phi)


def degenerate_sets() -> dict[str, PlanarSet]:
    """Zero and over-large deviations, points on lines and edges, edges along the axes, angles across ±π."""
    found: dict[str, PlanarSet] = {}
    for spread in (0.0, 1e-9, 1e-6, 0.05, 0.5 * math.pi, 3.0, math.pi, 7.0):
        for radius in (0.0, 1e-9, 0.01, 1.0, 3.0):
            key = f"ε_φ = {spread:.3g}, ε = {radius}"
            found[f"vertex, {key}"] = vertex_position((0.1, 0.2), math.pi, Reach(1.0, 0.0), spread, radius)
            found[f"vertex at the origin, {key}"] = vertex_position(ORIGIN, 1.0, Reach(0.0, 0.0), spread, radius)
            for name, end in (("along x", (0.7, 0.0)), ("along −y", (0.0, -0.7)), ("short", (1e-4, 0.0))):
                for angle in (-math.pi, -0.5 * math.pi, 0.3, math.pi - 1e-7):
                    found[f"edge {name} at {angle:.3g}, {key}"] = ArcSum(ORIGIN, end, 1.0, angle, spread, radius)
            for name, ends in {
                "on its own line": ((0.5, 0.5), (1.0, 1.0)),
                "through the reference point": ((-0.5, 0.0), (1.0, 0.0)),
                "from the reference point": ((0.0, 0.0), (0.0, 1.0)),
                "perpendicular at its end": ((1.0, 0.0), (1.0, 1.0)),
                "symmetric": ((1.0, -0.5), (1.0, 0.5)),
                "across −x": ((-1.0, 0.5), (-1.0, -0.2)),
                "of no length": ((0.3, 0.4), (0.3, 0.4)),
            }.items():
                found[f"turned edge {name}, {key}"] = TurnedEdge((3.0, -2.0), *ends, spread, radius)
    return found


DEGENERATE = degenerate_sets()


def winding(shape: PlanarSet, points: np.ndarray, tolerance: float) -> np.ndarray:
    """How often the boundary, as chords to a tolerance, winds round the points (k, 2)."""
    total = np.zeros(len(points))
    for loop in shape.boundary():
        corners = np.vstack([piece.curve.polyline(tolerance)[:-1] for piece in loop])
        to = corners - points[:, None]
        theta = np.arctan2(to[..., 1], to[..., 0])
        total += np.sum(wrapped(np.roll(theta, -1, axis=1) - theta), axis=1)
    return np.round(total / (2.0 * math.pi))


def check_boundary(shape: PlanarSet, rng: np.random.Generator) -> list[BoundaryPiece]:
    """Every law that ties a boundary to the distance from the set."""
    loops = shape.boundary()
    pieces = [piece for loop in loops for piece in loop]
    for loop in loops:
        for one, other in zip(loop, (*loop[1:], loop[0]), strict=True):
            np.testing.assert_allclose(one.curve.point(1.0), other.curve.point(0.0), rtol=0.0, atol=1e-9 * shape.size)
    if not pieces:
        return pieces
    on = np.vstack([piece.curve.point(np.linspace(0.0, 1.0, 7)) for piece in pieces])
    np.testing.assert_allclose(shape.core_distance(on), shape.radius, rtol=0.0, atol=1e-9 * shape.size)
    x = on[rng.integers(len(on), size=60)] + rng.normal(size=(60, 2)) * shape.size * 10.0 ** rng.uniform(-5, 0, (60, 1))
    to_boundary = np.min([distance(piece.curve, x) for piece in pieces], axis=0)
    outside = shape.distance(x) > 0.0
    # Nothing of the boundary is missing, and nothing is at the wrong place.
    np.testing.assert_allclose(to_boundary[outside], shape.distance(x)[outside], rtol=0.0, atol=1e-9 * shape.size)
    clear = to_boundary > 1e-3 * shape.size
    np.testing.assert_array_equal(winding(shape, x[clear], 2e-4 * shape.size), ~outside[clear])
    return pieces


def test_boundaries_of_random_sets() -> None:
    rng = np.random.default_rng(5)
    carriers = {piece.on for shape in random_sets(60) for piece in check_boundary(shape, rng)}
    assert carriers == set(Carrier)


@pytest.mark.parametrize("part", range(4))
def test_boundaries_of_degenerate_sets(part: int) -> None:
    rng = np.random.default_rng(6)
    for shape in list(DEGENERATE.values())[part::4]:
        check_boundary(shape, rng)


def test_a_point_has_no_boundary_and_contains_itself() -> None:
    shape = vertex_position((0.1, 0.2), 0.3, Reach(0.5, 1.0), 0.0, 0.0)
    assert (shape.boundary(), shape.area()) == ((), 0.0)
    at = np.array([0.1 + 0.5 * math.cos(1.3), 0.2 + 0.5 * math.sin(1.3)])
    assert shape.contains(at)
    assert not shape.contains(at + 1e-6)
    assert shapely.Point(at).within(shape.polygon(1e-3, "outside"))


@pytest.mark.parametrize("area", ["sector", "stadium", "ring", "disc", "swept arc"])
def test_areas_by_hand(area: str) -> None:
    h, s, r, L = 1.3, 0.4, 0.1, 0.7
    by_hand: dict[str, tuple[PlanarSet, float]] = {
        "sector": (vertex_position(ORIGIN, 2.0, Reach(h, 1.0), s, r), 4.0 * h * r * s + math.pi * r**2),
        "stadium": (ArcSum(ORIGIN, (0.0, L), h, 1.0, 0.0, r), 2.0 * L * r + math.pi * r**2),
        "ring": (vertex_position(ORIGIN, 2.0, Reach(h, 1.0), math.pi, r), 4.0 * math.pi * h * r),
        "disc": (vertex_position(ORIGIN, 2.0, Reach(0.0, 1.0), s, r), math.pi * r**2),
        # An arc from −s to s swept along y runs over itself nowhere when the edge is along its axis.
        "swept arc": (ArcSum(ORIGIN, (L, 0.0), h, 0.0, s, 0.0), 2.0 * L * h * math.sin(s)),
    }
    shape, expected = by_hand[area]
    assert shape.area() == pytest.approx(expected, rel=1e-12)


def test_valid_arcs_of_uv_and_cuv() -> None:
    rng = np.random.default_rng(7)
    for _ in range(50):
        h, s, r, phi, gamma = rng.uniform([0.5, 0.01, 0.01, -9, -9], [1.0, 1.0, 0.4, 9, 9])
        for cu in (False, True):
            # CUv is Uv seen from the point that is touched: turned by π, eqs. (22)-(24) against (17)-(19).
            phi_seen = phi + (math.pi if cu else 0.0)
            shape = vertex_position(ORIGIN, phi_seen, Reach(h, gamma), s, r)
            arcs = {piece.on: piece.curve for loop in shape.boundary() for piece in loop}
            assert all(isinstance(arc, Arc) for arc in arcs.values())
            np.testing.assert_allclose(arcs[Carrier.FAR].radius, h + r, rtol=1e-12)
            np.testing.assert_allclose(arcs[Carrier.NEAR].radius, h - r, rtol=1e-12)
            for on, low, high in ((Carrier.PLUS, -math.pi, 0.0), (Carrier.MINUS, 0.0, math.pi)):
                sign = 1.0 if on is Carrier.PLUS else -1.0
                theta = arcs[on].start + np.linspace(0.01, 0.99, 9) * arcs[on].sweep
                inside = wrapped(phi_seen + gamma + sign * s - theta)
                assert np.all((inside > low) & (inside < high)), (on, cu)
            for on in (Carrier.FAR, Carrier.NEAR):
                theta = arcs[on].start + np.linspace(0.01, 0.99, 9) * arcs[on].sweep
                assert np.all(np.abs(wrapped(phi_seen + gamma - theta)) < s)


@pytest.mark.parametrize(("radius", "vanished"), [(0.5, False), (0.999, False), (1.0, True), (1.5, True)])
def test_the_inner_arc_vanishes_when_deviations_reach_the_centre(radius: float, vanished: bool) -> None:
    shapes = [
        vertex_position(ORIGIN, 0.3, Reach(1.0, 0.0), 0.7, radius),
        edge_position(ORIGIN, 0.3, (1.0, -0.4), (1.0, 0.8), 0.2, radius),
    ]
    for shape, on in zip(shapes, (Carrier.NEAR, Carrier.FOOT), strict=True):
        carriers = {piece.on for loop in shape.boundary() for piece in loop}
        assert (on not in carriers) is vanished
        assert bool(shape.contains(ORIGIN)) is vanished


def test_case_a_has_the_additional_arc_and_four_segments() -> None:
    for case, segments in ((Case.A, 4), (Case.B, 2)):
        for instance in instances(ContactType.TYPE_2, case, 40, seed=12):
            edge = instance.cu.edge
            e = edge[1] - edge[0]
            k = -float(edge[0] @ e) / float(e @ e)
            assert (0.0 < k < 1.0) is (case is Case.A)
            # A thin set shows every part that its case has; a wide one rounds some off.
            half = [math.hypot(*v) for v in (edge[0] + k * e - edge[0], edge[1] - edge[0] - k * e)]
            thin = 0.05 * min(*half, math.hypot(*(edge[0] + k * e)), instance.cu.reach) / instance.cu.reach
            shape = TurnedEdge(ORIGIN, edge[0], edge[1], thin, 1e-3 * thin * instance.cu.reach)
            pieces = [piece.on for loop in shape.boundary() for piece in loop]
            assert pieces.count(Carrier.LINE) == segments
            assert pieces.count(Carrier.FOOT) == (1 if case is Case.A else 0)
            assert pieces.count(Carrier.FAR) == (2 if case is Case.A else 1)


def test_support_is_the_greatest_of_the_boundary() -> None:
    theta = np.linspace(-math.pi, math.pi, 50)
    n = np.stack([np.cos(theta), np.sin(theta)], axis=-1)
    for shape in random_sets(20):
        on = np.vstack([piece.curve.point(np.linspace(0.0, 1.0, 400)) for loop in shape.boundary() for piece in loop])
        greatest = np.max(on @ n.T, axis=0)
        assert np.all(greatest <= shape.support(n) + 1e-12 * shape.size)
        np.testing.assert_allclose(shape.support(n), greatest, rtol=0.0, atol=1e-4 * shape.size)
        np.testing.assert_allclose(shape.support(3.0 * n), 3.0 * shape.support(n), rtol=1e-12)


def check_polygons(shape: PlanarSet, tolerance: float) -> None:
    outer, inner = shape.polygon(tolerance, "outside"), shape.polygon(tolerance, "inside")
    for polygon, sign in ((outer, 1.0), (inner, -1.0)):
        assert polygon.is_valid
        corners = shapely.get_coordinates(shapely.segmentize(polygon, 0.2 * shape.size))
        excess = sign * (shape.core_distance(corners) - shape.radius)
        assert np.all(excess >= -1e-9 * shape.size)
        assert np.all(sign < 0.0 or excess <= tolerance + 1e-9 * shape.size)
    loops = shape.boundary()
    on = shapely.points(np.vstack([p.curve.point(np.linspace(0.0, 1.0, 9)) for loop in loops for p in loop]))
    assert np.all(shapely.distance(outer, on) <= 1e-9 * shape.size)
    slack = 1e-12 * shape.size**2
    assert outer.area + slack >= shape.area() >= inner.area - slack


def test_polygons_lie_on_their_side() -> None:
    for shape in random_sets(40):
        for tolerance in (1e-2, 1e-4):
            check_polygons(shape, tolerance * shape.size)


def test_polygons_of_degenerate_sets() -> None:
    for shape in list(DEGENERATE.values())[::7]:
        if shape.boundary():
            check_polygons(shape, 1e-3 * shape.size)


def test_polygons_close_in_on_the_area() -> None:
    for shape in random_sets(5):
        areas = [shape.polygon(t * shape.size, side).area for t in (1e-3, 1e-5) for side in ("inside", "outside")]
        assert areas[0] <= areas[2] <= shape.area() <= areas[3] <= areas[1]
        assert areas[3] - areas[2] < 0.05 * (areas[1] - areas[0])


def test_refusals() -> None:
    shape = vertex_position(ORIGIN, 0.0, Reach(1.0, 0.0), 0.1, 0.1)
    with pytest.raises(GeometryError, match="tolerance of 0"):
        shape.polygon(0.0, "outside")
    with pytest.raises(ValueError, match="radius is -1"):
        ArcSum(ORIGIN, ORIGIN, 1.0, 0.0, 0.1, -1.0)
    with pytest.raises(ValueError, match="spread is nan"):
        TurnedEdge(ORIGIN, ORIGIN, (1.0, 0.0), math.nan, 0.1)
    with pytest.raises(ValueError, match="not finite"):
        TurnedEdge(ORIGIN, (math.inf, 0.0), (1.0, 0.0), 0.1, 0.1)
