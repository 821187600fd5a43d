"""S(t): the paper's values, switching times known by hand, and agreement with sampled poses in three dimensions."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.optimize import linprog

from fmopt.errors import SolverError
from fmopt.geometry.csg import Box, Cylinder, Difference
from fmopt.geometry.part import part_of
from fmopt.papers.lee_huang import freedom as slack_module
from fmopt.papers.lee_huang.freedom import freedom, half_widths
from fmopt.papers.lee_huang.nominal_trajectory import NominalTrajectory, insertion
from fmopt.papers.lee_huang.touch import Linearised
from tests.shared.parts.figure2 import agree, at, steps

SPEED = 0.02
ENGAGED = (2, 2, 0, 2, 2, 2)
LANDING = (2, 2, -1, 2, 2, 2)
FREE = (0,) * 6


PEG = part_of("peg", Box((0.02, 0.02, 0.04)))
BLOCK = part_of(
    "block", at(Difference(Box((0.06, 0.06, 0.04)), (at(Box((0.0202, 0.0202, 0.031)), 0, 0, 0.01),)), 0, 0, -0.04)
)
PLATE = part_of(
    "plate", at(Difference(Box((0.06, 0.06, 0.01)), (at(Box((0.0202, 0.0202, 0.02)), 0, 0, -0.005),)), 0, 0, -0.01)
)
DOWN = insertion([0, 0, 0.005, 0, 0, 0], [0, 0, -0.03, 0, 0, 0], SPEED, 0.014)


class Gap:
    """Distance between convex pieces along their best separating axis: positive apart, negative in overlap."""

    def __init__(self, moving, fixed):
        self.moving = [(p.vertices, p.normals, self.directions(p)) for p in moving.pieces]
        self.fixed = [(p.vertices, p.normals, self.directions(p)) for p in fixed.pieces]

    @staticmethod
    def directions(piece):
        along = [piece.vertices[b] - piece.vertices[a] for a, b in (edge.vertices for edge in piece.edges)]
        return np.unique(np.round([e / np.linalg.norm(e) for e in along], 12), axis=0)

    def __call__(self, pose):
        worst = np.inf
        for vertices, normals, edges in self.moving:
            points, turned, along = pose.apply(vertices), normals @ pose.R.T, edges @ pose.R.T
            for others, walls, rims in self.fixed:
                crossed = np.cross(along[:, None], rims[None]).reshape(-1, 3)
                size = np.linalg.norm(crossed, axis=1)
                crossed = crossed[size > 1e-6] / size[size > 1e-6, None]
                n = np.vstack([walls, -turned, crossed, -crossed])
                worst = min(worst, float(np.max((points @ n.T).min(axis=0) - (others @ n.T).max(axis=0))))
        return worst


def test_square_peg_in_a_blind_hole_switches_where_the_ball_meets_rim_and_floor():
    found = steps(freedom(PEG, BLOCK, DOWN, half_widths(2e-4, 0.0)), DOWN)
    expected = [(FREE, 5e-3, 2e-4), (LANDING, 2e-4, -2e-4), (ENGAGED, -2e-4, -0.0298), (LANDING, -0.0298, -0.03)]
    agree(found, expected)


def test_a_ball_smaller_than_the_clearance_leaves_only_the_floor():
    found = steps(freedom(PEG, BLOCK, DOWN, half_widths(5e-5, 0.0)), DOWN)
    assert [s for s, _, _ in found] == [FREE, (0, 0, -1, 2, 2, 0)]
    assert found[1][1] == pytest.approx(-0.02995, abs=1e-11)


def test_without_error_only_the_goal_touches():
    last = freedom(PEG, BLOCK, DOWN, np.zeros(6))[-1]
    assert last.s == (0, 0, -1, 2, 2, 0)
    assert last.start == last.end == DOWN.duration


def test_a_through_hole_stops_nothing_at_its_end():
    path = insertion([0, 0, 0.005, 0, 0, 0], [0, 0, -0.01, 0, 0, 0], SPEED, 0.014)
    assert [one.s for one in freedom(PEG, PLATE, path, half_widths(2e-4, 0.002))] == [FREE, LANDING, ENGAGED]


@pytest.mark.parametrize("sides", [16, 32])
def test_a_round_peg_stays_free_about_its_axis(sides):
    hole = Difference(Box((0.06, 0.06, 0.04)), (at(Cylinder(0.0101, 0.031, sides), 0, 0, 0.01),))
    peg, block = part_of("peg", Cylinder(0.01, 0.04, sides)), part_of("hole", at(hole, 0, 0, -0.04))
    intervals = freedom(peg, block, DOWN, half_widths(2e-4, 0.002))
    assert [one.s for one in intervals] == [FREE, (2, 2, -1, 2, 2, 0), (2, 2, 0, 2, 2, 0), (2, 2, -1, 2, 2, 0)]


def test_signs_name_the_motion_that_is_stopped():
    # One wall at +x: it pushes along −x, below and above the reference point's height only where the wall is higher.
    wall = part_of("wall", at(Box((0.02, 0.06, 0.04)), 0.0201, 0, -0.04))
    path = NominalTrajectory(np.array([[0, 0, 0.005, 0, 0, 0], [0, 0, -0.03, 0, 0, 0]]), np.array([0.0, 1.0]))
    assert freedom(PEG, wall, path, half_widths(2e-4, 0.0))[-1].s == (1, 0, 0, 0, 1, 2)
    mirrored = part_of("wall", at(Box((0.02, 0.06, 0.04)), -0.0201, 0, -0.04))
    assert freedom(PEG, mirrored, path, half_widths(2e-4, 0.0))[-1].s == (-1, 0, 0, 0, -1, 2)


def test_intervals_cover_the_trajectory_and_differ():
    intervals = freedom(PEG, BLOCK, DOWN, half_widths(3e-4, 0.005))
    assert (intervals[0].start, intervals[-1].end) == (0.0, DOWN.duration)
    for one, other in pairwise(intervals):
        assert one.end == other.start
        assert one.s != other.s


@pytest.mark.parametrize("fixed", [BLOCK, PLATE], ids=["blind", "through"])
def test_no_sampled_pose_touches_where_nothing_is_stopped(fixed):
    path = insertion([0, 0, 0.003, 0, 0, 0], [0, 0, -0.01, 0, 0, 0], SPEED, 0.014)
    box = half_widths(3e-4, 0.005)
    first = freedom(PEG, fixed, path, box)[0]
    assert first.s == FREE
    gap, rng = Gap(PEG, fixed), np.random.default_rng(0)
    corners = np.array(np.meshgrid(*[[-1.0, 1.0]] * 6)).reshape(6, -1).T
    errors = box * np.vstack([corners, rng.uniform(-1.0, 1.0, (150, 6))])
    for t in (0.5 * first.end, 0.99 * first.end, first.end):
        assert all(gap(path.pose(t).moved(e)) > 0.0 for e in errors)
    # Control: the answer for a smaller box is refuted by the same samples.
    early = freedom(PEG, fixed, path, 0.9 * box)[0].end
    assert any(gap(path.pose(early).moved(e)) < 0.0 for e in errors)


@pytest.mark.parametrize("number", [1, 2, 3])
def test_every_stopped_motion_is_found_by_sampling_and_no_other(number):
    """From a free pose in the box, a motion along one degree inside the box runs into the fixed part, or never does."""
    box = half_widths(2e-4, 0.004)
    interval = freedom(PEG, BLOCK, DOWN, box)[number]
    pose = DOWN.pose(0.5 * (interval.start + interval.end))
    gap, rng = Gap(PEG, BLOCK), np.random.default_rng(number)
    hit = np.zeros((6, 2), dtype=bool)
    for _ in range(400):
        e = rng.uniform(-1.0, 1.0, 6) * box
        e[3:] *= rng.integers(0, 2)
        if gap(pose.moved(e)) <= 0.0:
            continue
        for degree in range(6):
            # Turned poses slide along tilted faces; a translation is tried from unturned ones only.
            if degree < 3 and np.any(e[3:]):
                continue
            for side, sign in enumerate((1.0, -1.0)):
                if not hit[degree, side]:
                    moved = e.copy()
                    moved[degree] = sign * box[degree]
                    hit[degree, side] = gap(pose.moved(moved)) < 0.0
    s = tuple(2 if plus and minus else int(plus) - int(minus) for plus, minus in hit)
    assert interval.s == s


def test_a_program_that_does_not_end_is_reported(monkeypatch):
    monkeypatch.setattr(slack_module, "maximin", lambda c, _: np.full(len(c), np.nan))
    empty = Linearised(*(np.zeros((3, *shape)) for shape in ((), (6,), (4,), (4, 6), (2,), (3,))))
    with pytest.raises(SolverError, match="did not end"):
        slack_module.slack(empty, np.ones(6), 0.0, 1.0)


@pytest.mark.parametrize("rows", [1, 2, 3, 5, 21])
@pytest.mark.parametrize("ties", [False, True], ids=["any", "ties"])
def test_programs_solved_together_are_solved_one_by_one(rows, ties):
    """Also where rows repeat or leave several corners equally good; the bound where that is below 0."""
    rng = np.random.default_rng(rows)
    c, B = rng.normal(0.5, 1.0, (40, rows)), rng.normal(0.0, 0.5, (40, rows, 6)) * (rng.random((40, 1, 6)) > 0.3)
    if ties:
        c, B = np.round(np.repeat(c, 2, axis=1)), np.round(np.repeat(B, 2, axis=1))
    found, cost = slack_module.maximin(c, B), [0.0] * 6 + [-1.0]
    for value, offsets, slopes in zip(found, c, B, strict=True):
        A = np.column_stack([-slopes, np.ones(len(slopes))])
        answer = linprog(cost, A_ub=A, b_ub=offsets, bounds=[(-1.0, 1.0)] * 6 + [(None, None)])
        bound = np.min(offsets + np.abs(slopes).sum(axis=1))
        assert value == pytest.approx(-answer.fun if bound >= 0.0 else bound, abs=1e-9)
