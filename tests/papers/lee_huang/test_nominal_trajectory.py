"""The nominal trajectory: three nodes, timing from the speed, one branch of rotation vectors, refusals."""

import pickle

import numpy as np
import pytest

from fmopt.errors import GeometryError
from fmopt.papers.lee_huang.nominal_trajectory import NominalTrajectory, insertion
from fmopt.spatial import se3

START = [0.002, -0.001, 0.005, 0.0, 0.0, 0.1]
GOAL = [0.0, 0.0, -0.03, 0.0, 0.0, 0.2]
RHO = 0.014


def test_three_nodes_start_mouth_seated_with_the_goal_orientation_from_the_mouth_on():
    path = insertion(START, GOAL, 0.02, RHO)
    assert np.array_equal(path.nodes, [START, [0, 0, 0, 0, 0, 0.2], GOAL])
    for t in np.linspace(path.times[1], path.duration, 7):
        assert np.array_equal(path.at(t)[3:], path.nodes[-1, 3:])


def test_time_is_length_over_speed():
    path = insertion(START, GOAL, 0.02, RHO)
    first = np.sqrt(0.002**2 + 0.001**2 + 0.005**2 + (RHO * 0.1) ** 2)
    assert path.times == pytest.approx([0.0, first / 0.02, (first + 0.03) / 0.02], rel=1e-14)


def test_at_is_linear_between_nodes_and_rests_outside():
    path = insertion(START, GOAL, 0.02, RHO)
    for k in range(2):
        t = 0.25 * path.times[k] + 0.75 * path.times[k + 1]
        assert path.at(t) == pytest.approx(0.25 * path.nodes[k] + 0.75 * path.nodes[k + 1], abs=1e-16)
    assert np.array_equal(path.at(-1.0), path.nodes[0])
    assert np.array_equal(path.at(path.duration + 1.0), path.nodes[-1])
    assert path.pose(path.duration).vector() == pytest.approx(GOAL, abs=1e-15)


def test_no_point_within_rho_outruns_the_speed():
    path = insertion([0.0, 0.0, 0.004, 0.3, -0.2, 0.5], GOAL, 0.02, RHO)
    times = np.linspace(0.0, path.duration, 400)
    poses = [path.pose(t) for t in times]
    for a, b, dt in zip(poses, poses[1:], np.diff(times), strict=False):
        X = a.local(b)
        assert np.hypot(np.linalg.norm(X[:3]), RHO * np.linalg.norm(X[3:])) <= 0.02 * dt * (1 + 1e-9)


def test_rotation_vectors_of_one_branch_turn_the_short_way():
    start = np.array([0.0, 0.0, 0.005, 0.0, 0.0, 3.1])
    path = insertion(start, [0.0, 0.0, -0.03, 0.0, 0.0, -3.1], 0.02, RHO)
    assert abs(path.nodes[0, 5] - path.nodes[1, 5]) == pytest.approx(2 * np.pi - 6.2, abs=1e-12)
    assert np.allclose(se3.exp(path.nodes[0, 3:]), se3.exp(start[3:]), atol=1e-14)


def test_a_start_in_the_mouth_makes_two_nodes():
    assert len(insertion(np.zeros(6), [0, 0, -0.01, 0, 0, 0], 0.02, RHO).nodes) == 2


@pytest.mark.parametrize(
    ("start", "goal", "words"),
    [
        ([0, 0, -0.001, 0, 0, 0], GOAL, "start lies 0.001 m below the mouth"),
        (START, [0, 0, 0.002, 0, 0, 0], "goal lies 0.002 m above the mouth"),
    ],
)
def test_refuses_a_start_inside_and_a_goal_outside(start, goal, words):
    with pytest.raises(GeometryError, match=words):
        insertion(start, goal, 0.02, RHO)


@pytest.mark.parametrize("times", [[0.0], [0.0, 0.0], [1.0, 2.0]])
def test_refuses_times_that_do_not_grow_from_zero(times):
    with pytest.raises(ValueError, match="start at 0 and grow"):
        NominalTrajectory(np.zeros((len(times), 6)), np.array(times))


def test_stays_read_only_through_pickling():
    path = pickle.loads(pickle.dumps(insertion(START, GOAL, 0.02, RHO)))
    with pytest.raises(ValueError, match="read-only"):
        path.nodes[0, 0] = 1.0
