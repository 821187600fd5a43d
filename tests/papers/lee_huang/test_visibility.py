"""Position nodes: three where the paper's see one another, else a shortest visible path; refusals name the plane."""

from itertools import pairwise

import numpy as np
import pytest
from shapely import LineString

from fmopt.errors import GeometryError
from fmopt.geometry.plane.region import polygon_region
from fmopt.papers.lee_huang.visibility import Sight, bends, position_nodes
from tests.shared.plane_shapes import polygon

C = 1e-4  # clearance of the expanded hole
SQUARE = [(-0.04, -0.04), (0.04, -0.04), (0.04, 0.04), (-0.04, 0.04)]
HOLE = [(-C, -C), (-C, C), (C, C), (C, -C)]


def slot(*bumps):
    """GE of a block with a slot on its middle; bumps (u0, u1, height) on its top."""
    top = [(0.05, 0.0)]
    for u0, u1, height in sorted(bumps, reverse=True):
        if u0 > 0:
            top += [(u1, 0.0), (u1, height), (u0, height), (u0, 0.0)]
    top += [(C, 0.0), (C, -0.03), (-C, -0.03), (-C, 0.0)]
    for u0, u1, height in sorted(bumps, reverse=True):
        if u1 < 0:
            top += [(u1, 0.0), (u1, height), (u0, height), (u0, 0.0)]
    return polygon_region([(-0.05, -0.06), (0.05, -0.06), *top, (-0.05, 0.0)])


def sight(xz=None, yz=None):
    return Sight({"xz": xz or slot(), "yz": yz or slot(), "xy": polygon_region(SQUARE, HOLE)})


START, GOAL = np.array([0.02, 0.0, 0.01]), np.array([0.0, 0.0, -0.03])


def length(nodes):
    return sum(float(np.linalg.norm(b - a)) for a, b in pairwise(nodes))


def test_three_nodes_where_the_mouth_is_visible():
    assert np.array_equal(position_nodes(START, GOAL, sight()), [START, np.zeros(3), GOAL])
    lifted = position_nodes(START, GOAL, sight(), 0.002)
    assert np.array_equal(lifted[1], [0, 0, 0.002])
    low = position_nodes([0.0, 0.0, 0.001], GOAL, sight(), 0.002)  # a start lower than that is N_2 itself
    assert np.array_equal(low, [[0, 0, 0.001], GOAL])


def test_a_wall_between_start_and_mouth_is_passed_by_a_shortest_path():
    wall = slot((0.005, 0.01, 0.015))
    found = position_nodes(START, GOAL, sight(wall))
    assert len(found) > 3
    place = sight(wall)
    for a, b in pairwise(found):
        assert place.between(a, b) is None
        assert not LineString([a[[0, 2]], b[[0, 2]]]).intersects(polygon(wall, 1e-9).buffer(-1e-7))
    # By hand: over both upper corners of the wall, down to the middle of the mouth, and in along the axis.
    best = np.hypot(0.01, 0.005) + 0.005 + np.hypot(0.005, 0.015) + 0.03
    assert length(found) == pytest.approx(best, abs=2e-6)


def test_walls_on_both_planes_are_passed_together():
    start = np.array([0.02, 0.02, 0.005])
    place = sight(slot((0.005, 0.01, 0.015)), slot((0.005, 0.01, 0.012)))
    found = position_nodes(start, GOAL, place)
    assert all(place.between(a, b) is None for a, b in pairwise(found))
    assert length(found) < 0.075
    assert place.between(start, np.zeros(3)) in {"xz", "yz"}


def test_a_start_beside_the_hole_is_not_asked_of_the_plane_of_the_mouth():
    """As the paper writes its rule it would be: on x-y the start projects into the block."""
    place = sight()
    assert place.expanded["xy"].contains([START[:2]])[0]
    assert place.blocked_at(START) is None
    assert place.blocked_at([0.001, 0.0, -0.001]) == "xz"


def test_below_the_mouth_the_plane_of_the_mouth_counts():
    corner = Sight({"xy": polygon_region(SQUARE, HOLE)})
    assert corner.between([0.0, 0.0, 0.01], [0.001, 0.001, -0.01]) == "xy"
    assert corner.between([0.0, 0.0, 0.01], [0.5 * C, 0.5 * C, -0.01]) is None
    assert corner.between([0.001, 0.001, 0.01], [0.0, 0.0, 1e-3]) is None


@pytest.mark.parametrize(
    ("start", "goal", "words"),
    [
        ([0.02, 0.0, -0.001], GOAL, "N_1, the start, at .* lies inside GE on the plane xz"),
        (START, [0.001, 0.0, -0.03], "N_T, the goal, at .* inside GE on the plane xz"),
        (START, [0.0, -0.001, -0.03], "N_T, the goal, at .* on the plane yz"),
        (START, [0.0, 0.0, -0.031], "N_T, the goal"),
    ],
)
def test_refuses_a_start_in_the_solid_and_a_goal_off_the_axis(start, goal, words):
    with pytest.raises(GeometryError, match=f"{words}.*rule: N_i is not in GE") as told:
        position_nodes(start, goal, sight())
    assert "move it out of the material" in str(told.value)


def test_refuses_where_no_path_leads():
    enclosed = Sight({"xz": ring(), "yz": ring()})
    with pytest.raises(GeometryError, match=r"no path over nodes .* plane xz blocks"):
        position_nodes([0.0, 0.0, 0.009], GOAL, enclosed)


def ring():
    """A wall all round the start, which stands in its middle."""
    return polygon_region(
        [(-0.01, -0.001), (0.01, -0.001), (0.01, 0.02), (-0.01, 0.02)],
        [(-0.005, 0.005), (-0.005, 0.015), (0.005, 0.015), (0.005, 0.005)],
    )


def test_bends_lie_beside_convex_corners_only():
    region = slot((0.005, 0.01, 0.015))
    found = bends(region)
    assert not region.contains(found).any()
    assert np.all(region.boundary_distance(found) < 2e-6 * region.size)
    assert len(found) == 4 + 2 + 2  # outer corners, the rim of the slot, the top of the wall
