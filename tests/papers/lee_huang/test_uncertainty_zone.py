"""Ball, cone and trapezoid as the paper defines them, and the radii that a box of errors gives."""

import pickle

import numpy as np
import pytest
from shapely import MultiPoint, Point, Polygon

from fmopt.papers.lee_huang.uncertainty_zone import PLANES, ErrorCone, ErrorSquare, Trapezoid, wrapped_distance, zones

ZONE = Trapezoid(ErrorSquare([0.01, -0.02], 0.001), ErrorCone(np.pi / 2, 0.1), 0.04)


def test_the_ball_is_one_of_the_max_norm():
    ball = ErrorSquare([1.0, 2.0], 0.5)
    assert ball.contains([[1.5, 2.5], [1.0, 2.0], [0.5, 1.5]]).all()
    assert not ball.contains([[1.51, 2.0], [1.0, 1.49]]).any()
    assert Polygon(ball.corners).exterior.is_ccw
    assert Polygon(ball.corners).area == pytest.approx(1.0)


@pytest.mark.parametrize(("one", "other", "d"), [(0.1, 6.2, 0.1 + 2 * np.pi - 6.2), (0.0, np.pi, np.pi), (1.0, 1.0, 0)])
def test_angles_are_compared_the_short_way_round(one, other, d):
    assert wrapped_distance(one, other) == pytest.approx(d)
    assert wrapped_distance(other, one + 4 * np.pi) == pytest.approx(d)
    unwrapped = abs(one - other)  # the paper's formula
    assert unwrapped >= wrapped_distance(one, other) - 1e-12


def test_a_cone_at_zero_holds_angles_on_both_sides():
    cone = ErrorCone(0.0, 0.2)
    assert cone.contains(0.1)
    assert cone.contains(2 * np.pi - 0.1)  # which |Ψ − Ψ₀| ≤ s would refuse
    assert not cone.contains(0.21)


def test_the_trapezoid_holds_every_line_and_its_edges_bound_them():
    rng = np.random.default_rng(0)
    hull = Polygon(ZONE.outline).buffer(1e-12)
    points = []
    for _ in range(300):
        centre = ZONE.ball.centre + rng.uniform(-1, 1, 2) * ZONE.ball.radius
        line = ZONE.line(centre, ZONE.cone.centre + rng.uniform(-1, 1) * ZONE.cone.half_angle)
        points += list(line)
        assert hull.contains(Point(line[0]))
        assert hull.distance(Point(line[1])) < 0.04 * (1 - np.cos(0.1))  # the cap is drawn straight
    assert MultiPoint(points).convex_hull.area > 0.9 * hull.area
    right, left = ZONE.edges
    for edge, side in ((right, 1.0), (left, -1.0)):
        along = (edge[1] - edge[0]) / np.linalg.norm(edge[1] - edge[0])
        across = side * np.array([along[1], -along[0]])
        assert max(across @ point for point in points) <= across @ edge[0] + 1e-12
        assert ZONE.ball.contains(edge[0] + 1e-9 * (ZONE.ball.centre - edge[0]))
    assert right[1, 0] - ZONE.ball.centre[0] == pytest.approx(0.001 + 0.04 * np.sin(0.1))


def test_without_uncertainty_the_trapezoid_is_the_line():
    thin = Trapezoid(ErrorSquare([0.0, 0.0], 0.0), ErrorCone(0.5, 0.0), 2.0)
    assert np.allclose(thin.outline, thin.line([0, 0], 0.5))
    assert np.allclose(thin.edges[0], thin.edges[1])


def test_zones_are_the_smallest_that_hold_a_box_of_errors():
    xz, yz, xy = zones([1e-4, 2e-4, 3e-5, 0.01, 0.02, 0.03])
    assert [zone.plane for zone in (xz, yz, xy)] == list(PLANES)
    assert [zone.radius for zone in (xz, yz, xy)] == [1e-4, 2e-4, 2e-4]
    assert [zone.half_angle for zone in (xz, yz, xy)] == [0.02, 0.01, 0.03]  # about y, x and z
    assert xz.trapezoid([0, 0], np.pi / 2, 0.04).cone.half_angle == 0.02


@pytest.mark.parametrize(
    "make", [lambda: ErrorSquare([0, 0], -1e-9), lambda: ErrorCone(0, np.nan), lambda: ErrorCone(0, 1.6)]
)
def test_refuses_radii_that_are_none(make):
    with pytest.raises(ValueError, match=r"radius|half-angle"):
        make()


def test_stays_read_only_through_pickling():
    with pytest.raises(ValueError, match="read-only"):
        pickle.loads(pickle.dumps(ZONE)).ball.centre[0] = 1.0
