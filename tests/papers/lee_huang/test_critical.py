"""Critical poses from geometry: blind, through, stepped, chamfered and round holes."""

import numpy as np
import pytest

from fmopt.geometry.csg import Box, Cylinder, Difference, Moved, Union, chamfered_box
from fmopt.geometry.part import part_of
from fmopt.papers.lee_huang.nominal_trajectory import critical_poses, insertion
from fmopt.spatial.se3 import Pose
from tests.shared.solids import frustum, raised

REACH = 5e-4
SPEED = 0.02
RHO = 0.014


def found(peg, hole, goal_z, reach=REACH, start=(0.0, 0.0, 0.005, 0.0, 0.0, 0.0), turn=0.0):
    path = insertion(start, [0.0, 0.0, goal_z, 0.0, 0.0, turn], SPEED, RHO)
    poses = critical_poses(part_of("peg", peg), part_of("block", hole), path, reach)
    for one in poses:
        assert np.allclose(path.at(one.time), one.pose, atol=1e-15)
    assert [one.time for one in poses] == sorted(one.time for one in poses)
    return {one.name: round(float(one.pose[2]), 12) for one in poses}


def block(*tools):
    return raised(Difference(Box((0.06, 0.06, 0.04)), tools), -0.04)


SQUARE = block(raised(Box((0.0202, 0.0202, 0.031)), 0.01))
PEG = Box((0.02, 0.02, 0.04))


def test_square_peg_in_a_blind_hole():
    assert found(PEG, SQUARE, -0.03) == {"mouth": 0.0, "mid-depth": -0.015, "bottom": -0.03}


@pytest.mark.parametrize("start", [(0.003, -0.002, 0.005, 0.0, 0.0, 0.0), (0.0, 0.0, 0.005, 0.1, 0.0, 0.0)])
def test_a_start_off_the_axis_or_turned_changes_nothing(start):
    assert found(PEG, SQUARE, -0.03, start=start) == found(PEG, SQUARE, -0.03)


def test_a_hole_turned_about_its_axis_changes_nothing():
    turned = Moved(SQUARE, Pose(np.zeros(3), Pose.from_vector([0, 0, 0, 0, 0, 0.7]).R))
    assert found(PEG, turned, -0.03, turn=0.7) == found(PEG, SQUARE, -0.03)


def test_through_plate_seated_at_its_exit_and_beyond():
    plate = raised(Difference(Box((0.04, 0.04, 0.009)), (raised(Box((0.00814, 0.00713, 0.011)), -0.001),)), -0.009)
    peg = chamfered_box((0.008, 0.007, 0.05), 0.00025)
    assert found(peg, plate, -0.009) == {"mouth": 0.0, "mid-depth": -0.0045, "bottom": -0.009}
    assert found(peg, plate, -0.013) == {"mouth": 0.0, "exit 1": -0.009, "mid-depth": -0.011, "bottom": -0.013}


def test_chamfered_mouth_is_a_step():
    hole = block(raised(Box((0.0202, 0.0202, 0.03)), 0.01), raised(frustum((0.0202,) * 2, (0.0242,) * 2, 2e-3), 0.038))
    assert found(PEG, hole, -0.03) == {"mouth": 0.0, "step 1": -0.002, "mid-depth": -0.016, "bottom": -0.03}


def test_stepped_peg_and_hole():
    hole = block(raised(Box((0.02, 0.02, 0.03)), 0.01), raised(Box((0.03, 0.03, 0.03)), 0.025))
    peg = Union((Box((0.0198, 0.0198, 0.04)), raised(Box((0.0298, 0.0298, 0.03)), 0.015)))
    # The tip meets the lower bore 15 mm down, at the same time as the shoulder meets the mouth; 18 mm: not so.
    assert found(peg, hole, -0.03) == {"mouth": -0.015, "mid-depth": -0.0225, "bottom": -0.03}
    other = Union((Box((0.0198, 0.0198, 0.04)), raised(Box((0.0298, 0.0298, 0.03)), 0.018)))
    assert found(other, hole, -0.03) == {"mouth": -0.015, "step 1": -0.018, "mid-depth": -0.024, "bottom": -0.03}


def test_round_peg():
    hole = block(raised(Cylinder(0.0101, 0.031, 16), 0.01))
    assert found(Cylinder(0.01, 0.04, 16), hole, -0.03) == {"mouth": 0.0, "mid-depth": -0.015, "bottom": -0.03}


def test_nothing_but_the_bottom_where_no_wall_is_within_reach():
    assert found(PEG, block(raised(Box((0.04, 0.04, 0.031)), 0.01)), -0.03) == {"bottom": -0.03}
