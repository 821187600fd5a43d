"""Figure 2's task whole, from the problem file to Pa(t) and Fa(t), and its relatives: blind, square, stepped."""

from functools import cache

import numpy as np
import pytest

from fmopt.errors import GeometryError, InterferenceError
from fmopt.geometry.csg import Box, Cone, Cylinder, Union
from fmopt.papers.lee_huang.freedom import freedom, half_widths
from fmopt.papers.lee_huang.hand_position_force import position_force
from fmopt.papers.lee_huang.mapping import MappingTask, answered, diagrams, plane_diagrams, task_mapping
from fmopt.plan.description import Nominal
from fmopt.plan.field_types import numbers
from fmopt.plan.position_force import Decomposition, contact_forces
from fmopt.report.views import diagram_view, trajectory_view
from fmopt.task.problem import load
from fmopt.task.task_command import problem_answer
from tests import PROBLEMS
from tests.shared.parts.figure2 import BORE, BOX, GOAL, PEG, RHO, SPEED, START, at, block, hexagon, radius

FREE, ROUND = (0,) * 6, (2, 2, 0, 2, 2, 0)
BALL, CONE = 1e-4, np.radians(0.5)


def rim_depth(clearance, half_width, r, s):
    """Depth at which the rim stops a flank that leans by s, its lower end off by r to the side and down."""
    return (half_width + clearance - r - half_width / np.cos(s)) / np.tan(s) - r


@cache
def figure_two():
    problem = load(PROBLEMS / "lee_huang_peg.toml")
    found = problem_answer(problem)
    return problem, found, answered(found, half_widths(*problem.trapezoid), RHO)


def radii():
    _, found, _ = figure_two()
    return radius(found.moving.solid), radius(found.fixed.solid)


def test_figure_two_is_free_until_t1_and_then_servoed_in_z_and_q_z_alone():
    problem, _, made = figure_two()
    assert [one.s for one in made.freedoms] == [FREE, ROUND]
    t1, T = made.freedoms[1].start, made.path.duration
    assert made.freedoms[1].end == T
    own, bore = radii()
    depth = rim_depth(bore - own, own, BALL, CONE)
    assert made.path.at(t1)[2] == pytest.approx(-depth, abs=1e-9 * T * problem.specification.speed)
    split = Decomposition(ROUND)
    assert split.written["C_ap"] == "(0, 0, p_z, 0, 0, q_z)"
    assert split.written["C_np"] == "(p_x, p_y, 0, q_x, q_y, 0)"
    forces = contact_forces(problem.specification, RHO)
    for row in position_force(made.path, made.freedoms, forces):
        middle = 0.5 * (row.start + row.end)
        if middle < t1:
            assert not any((*row.fa, *row.pn_start))
        else:
            assert np.array_equal(np.abs(row.fa), forces * [1, 1, 0, 1, 1, 0])
            assert row.either_sign == (0, 1, 3, 4)
            assert not any(row.pa_end[axis] for axis in row.either_sign)
        assert np.allclose(np.add(row.pa_start, row.pn_start), made.path.at(row.start))
        assert len(Decomposition(row.s).natural) + len(Decomposition(row.s).artificial) == 6


def test_figure_two_has_the_papers_three_nodes_and_the_speed_of_the_specification():
    problem, found, made = figure_two()
    nodes = made.path.nodes
    assert len(nodes) == 3
    assert np.array_equal(nodes[0][:3], START[:3])
    assert np.array_equal(nodes[1][:2], [0, 0])
    assert 0.0 < nodes[1][2] < 2e-3  # on the axis, as high as the uncertain part strays
    assert np.array_equal(nodes[2], found.PT)
    lengths = np.linalg.norm(np.diff(nodes[:, :3], axis=0), axis=1)
    assert np.allclose(np.diff(made.path.times), lengths / problem.specification.speed)


def test_space_agrees_on_what_is_stopped_in_the_end():
    problem, _, made = figure_two()
    assert freedom(problem.moving, problem.fixed, made.path, half_widths(BALL, CONE))[-1].s == made.freedoms[-1].s


def test_the_diagrams_of_figure_two():
    """Room for the nominal centre: twice the clearance across, on the plane of the mouth a disc."""
    *upright, mouth = figure_two()[2].planes
    own, bore = radii()
    room = bore - own
    for plane in upright:
        G = 2 * (0.03 - bore) * 0.03  # two walls of a block of 60 mm by 30 mm
        assert plane.fixed.area == pytest.approx(G, rel=1e-9)
        points = np.column_stack([room * np.array([-1.01, -0.99, 0.0, 0.99, 1.01]), np.full(5, -0.015)])
        assert plane.expanded.contains(points).tolist() == [True, False, False, False, True]
    assert mouth.fixed.area == pytest.approx(0.06**2 - np.pi * bore**2, rel=1e-9)
    angle = np.linspace(0.1, 6.2, 50)
    rim = np.column_stack([np.cos(angle), np.sin(angle)])
    assert not mouth.expanded.contains(room * (1 - 1e-6) * rim).any()
    assert mouth.expanded.contains(room * (1 + 1e-6) * rim).all()


def test_a_blind_hole_adds_the_stop_on_z_at_the_end():
    made = task_mapping(MappingTask(PEG, block(BORE, 0.03), START, GOAL, BOX, SPEED, RHO))
    assert [one.s for one in made.freedoms] == [FREE, ROUND, (2, 2, -1, 2, 2, 0)]
    floor = -0.03 + 1e-4 + 0.01 * np.sin(0.005)
    assert made.path.at(made.freedoms[2].start)[2] == pytest.approx(floor, abs=1e-9 * 0.04)


def test_a_square_peg_adds_two_on_q_z():
    peg, bore = Box((0.02, 0.02, 0.05)), Box((0.0204, 0.0204, 0.06))
    box = np.array([1e-4, 1e-4, 1e-4, 0.005, 0.005, 0.015])
    made = task_mapping(MappingTask(peg, block(bore, 0.04), START, GOAL, box, SPEED, RHO))
    assert (made.freedoms[0].s, made.freedoms[-1].s) == (FREE, (2, 2, 0, 2, 2, 2))
    less = task_mapping(MappingTask(peg, block(bore, 0.04), START, GOAL, BOX, SPEED, RHO))
    assert less.freedoms[-1].s == ROUND  # turned by 5 mrad about the axis a square peg does not reach the walls


def test_a_hexagonal_peg_is_stopped_about_its_axis_too():
    flat = np.cos(np.pi / 6)
    peg, bore = hexagon(0.01 / flat, 0.05), hexagon(0.0102 / flat, 0.06)
    made = task_mapping(MappingTask(peg, block(bore, 0.04), START, GOAL, BOX + 0.02 * np.eye(6)[5], SPEED, RHO))
    assert (made.freedoms[0].s, made.freedoms[-1].s) == (FREE, (2, 2, 0, 2, 2, 2))


def test_a_flange_lands_on_the_block():
    """The flange stops z when it comes near the mouth's plane; on that plane it is no peg in a hole."""
    flanged = Union((PEG, at(Cylinder(0.02, 0.01, 32), 0, 0, 0.03)))
    made = task_mapping(MappingTask(flanged, block(BORE, 0.04), START, GOAL, BOX, SPEED, RHO))
    assert [one.s[2] for one in made.freedoms] == [0, 0, -1]
    height = made.path.at(made.freedoms[2].start)[2]
    assert height == pytest.approx(-0.03 + 1e-4 + 0.02 * np.sin(0.005) - 0.03 * (1 - np.cos(0.005)), abs=2e-6)


def test_a_pointed_peg_starts_to_be_stopped_deeper():
    pointed = Union((Cone(0.006, 0.01, 0.005, 32), at(Cylinder(0.01, 0.045, 32), 0, 0, 0.005)))
    plain = task_mapping(MappingTask(PEG, block(BORE, 0.04), START, GOAL, BOX, SPEED, RHO))
    made = task_mapping(MappingTask(pointed, block(BORE, 0.04), START, GOAL, BOX, SPEED, RHO))
    assert [one.s for one in made.freedoms] == [FREE, ROUND]
    assert made.freedoms[1].start == pytest.approx(plain.freedoms[1].start, rel=1e-3)


def test_a_turned_goal_takes_the_sections_of_the_turned_peg():
    """A square peg that fits at 45° only: its sections on the planes are as wide as its diagonal."""
    turn = np.array([0, 0, np.pi / 4])
    bore = at(Box((0.0204, 0.0204, 0.06)), r=turn)
    goal = np.concatenate([GOAL[:3], turn])
    made = task_mapping(MappingTask(Box((0.02, 0.02, 0.05)), block(bore, 0.04), START, goal, BOX, SPEED, RHO))
    assert made.planes[0].sections[0][0].area == pytest.approx(0.05 * 0.02 * np.sqrt(2), rel=1e-9)
    assert np.allclose(made.path.nodes[-2:, 3:], turn)
    assert made.freedoms[0].end >= made.path.times[1]
    with pytest.raises(GeometryError, match=r"N_T, the goal, .* lies inside GE"):
        task_mapping(MappingTask(Box((0.02, 0.02, 0.05)), block(bore, 0.04), START, GOAL, BOX, SPEED, RHO))


def test_a_part_that_starts_turned_has_its_goals_orientation_before_the_mouth():
    start = np.concatenate([START[:3], [0.2, -0.1, 0.3]])
    made = task_mapping(MappingTask(PEG, block(BORE, 0.04), start, GOAL, BOX, SPEED, RHO))
    turned = next(t for t, node in zip(made.path.times, made.path.nodes, strict=True) if not node[3:].any())
    assert made.path.at(turned)[2] > 0.0
    assert [one.s for one in made.freedoms] == [FREE, ROUND]


def test_a_wall_in_the_way_takes_more_nodes_and_none_of_them_is_touched():
    wall = at(Box((0.004, 0.05, 0.01)), 0.024, 0, 0)
    start = np.array([0.05, 0.0, 0.002, 0, 0, 0])
    made = task_mapping(MappingTask(PEG, Union((block(BORE, 0.04), wall)), start, GOAL, BOX, SPEED, RHO))
    assert len(made.path.nodes) > 3
    assert made.path.nodes[:, 2].max() >= 0.01
    assert np.array_equal(made.path.nodes[-1], GOAL)


def test_an_obstacle_off_the_planes_is_reported():
    post = at(Box((0.003, 0.003, 0.01)), 0.006, 0.006, 0.0)
    standing = [("block", block(BORE, 0.04)), ("post", post)]
    with pytest.raises(InterferenceError, match=r"'peg' meets 'post' .* off the planes xz, yz and xy") as told:
        task_mapping(MappingTask(PEG, block(BORE, 0.04), START, GOAL, BOX, SPEED, RHO, [("peg", PEG)], standing))
    assert told.value.place == "post"
    with_post = plane_diagrams(PEG, Union((block(BORE, 0.04), post)), START, GOAL, BOX)
    without = plane_diagrams(PEG, block(BORE, 0.04), START, GOAL, BOX)
    assert [p.fixed.area for p in with_post[:2]] == pytest.approx([p.fixed.area for p in without[:2]], rel=1e-12)


def test_the_radii_come_from_the_problems_errors():
    problem, found, _ = figure_two()
    planes = plane_diagrams(found.moving.solid, found.fixed.solid, found.P0, found.PT, problem.start_box)
    assert [plane.zone.radius for plane in planes] == pytest.approx([3e-5] * 3)
    angles = np.degrees([plane.zone.half_angle for plane in planes])
    assert angles == pytest.approx([0.05, 0.05, 0.3])


def test_the_figures_show_all_parts_of_the_mapping():
    problem, _, made = figure_two()
    rows = position_force(made.path, made.freedoms, contact_forces(problem.specification, RHO))
    nominal = Nominal(tuple(map(numbers, made.path.nodes)), numbers(made.path.times), made.freedoms)
    course = trajectory_view.Course(nominal, rows)
    found = diagrams(made, 0.05)
    for drawing in (diagram_view.drawing(found), trajectory_view.drawing(course)):
        assert drawing.svg() == drawing.svg()
        assert "<image" not in drawing.svg()  # vectors only
    words = diagram_view.drawing(found).alt
    assert words.count("ball 100 µm") == 3
    assert "cone 0.5°" in words
    (xz, _, xy) = found
    assert [pose.name for pose in xz.poses] == ["start", "first contact", "goal"]
    touching = xz.poses[1]
    right = np.array(touching.edges[0])  # at first contact the trapezoid's edge runs over the corner of GE
    corner = np.array([radii()[1] - radii()[0], 0.0])
    along = (right[1] - right[0]) / np.linalg.norm(right[1] - right[0])
    off = corner - right[0]
    assert abs(along[0] * off[1] - along[1] * off[0]) < 1e-6  # the paper's edge is a (1/cos s − 1) short
    assert xy.poses[0].line[0] == xy.poses[0].line[1]  # seen from above the line is a point
