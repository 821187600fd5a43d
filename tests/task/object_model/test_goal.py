"""Goal states with free entries: what settles them, against brute force and closed forms."""

import math

import numpy as np
import pytest

from fmopt.errors import TaskError
from fmopt.spatial.se3 import Pose, exp, log
from fmopt.task.object_model.goal import FREE, SETTLED, Goal, settle
from fmopt.task.object_model.workcell import LowerPair
from tests.shared.parts.workcells import DOWN


@pytest.mark.parametrize("seed", range(30))
def test_free_rotations_are_the_nearest_to_the_start(seed: int) -> None:
    """Against a grid over the free entries; a free turn about the axis is the twist of the start about it."""
    random = np.random.default_rng(seed)
    start = Pose(np.zeros(3), exp(random.normal(size=3)))
    free = sorted(random.choice(3, size=int(random.integers(1, 4)), replace=False).tolist())
    entries = [FREE if i in free else float(random.uniform(-1, 1)) for i in range(3)]
    x, y, z = entries
    values, told = settle((0.0, 0.0, 0.0, x, y, z), start, "spherical", 0.0, "ball")
    assert [one.entry for one in told] == [("q_x", "q_y", "q_z")[i] for i in free]

    def away(q: np.ndarray) -> float:
        return float(np.linalg.norm(log(exp(q) @ start.R.T)))

    grid = np.stack(np.meshgrid(*[np.linspace(-3.1, 3.1, 13)] * len(free)), axis=-1).reshape(-1, len(free))
    trials = np.tile(values[3:], (len(grid), 1))
    trials[:, free] = grid
    assert away(values[3:]) <= min(map(away, trials)) + 1e-9


@pytest.mark.parametrize("turn", [-3.0, -1.0, 0.0, 0.5, 3.1])
@pytest.mark.parametrize("lean", [0.0, 0.3, 1.0])
def test_a_free_turn_keeps_the_turn_of_the_start(turn: float, lean: float) -> None:
    start = Pose(np.zeros(3), exp([lean, 0.5 * lean, 0.0]) @ exp([0.0, 0.0, turn]))
    values, told = settle((0.0, FREE, FREE, 0.0, FREE, FREE), start, "cylindrical", -0.03, "peg")
    quaternion = math.cos(0.5 * math.hypot(lean, 0.5 * lean))
    assert quaternion > 0.0
    np.testing.assert_allclose(values, [0, 0, -0.03, 0, 0, turn], atol=1e-9)
    assert [str(one) for one in told] == [
        "p_y is free: 0 mm, as the cylindrical pair holds it",
        "p_z is free: -30 mm, at full depth",
        "q_y is free: 0 deg, as the cylindrical pair holds it",
        f"q_z is free: {math.degrees(values[5]):.6g} deg, nearest to the orientation at the start",
    ]


def test_free_entries_by_pair() -> None:
    start = Pose.from_vector([0.01, 0.02, 0.03, 0.0, 0.0, 0.4])
    every: Goal = (FREE, FREE, FREE, FREE, FREE, FREE)
    wanted: dict[LowerPair, list[float]] = {
        "cylindrical": [0, 0, -0.03, 0, 0, 0.4],
        "prismatic": [0, 0, -0.03, 0, 0, 0],
        "revolute": [0, 0, -0.03, 0, 0, 0.4],
        "planar": [0.01, 0.02, 0, 0, 0, 0.4],
        "spherical": [0, 0, 0, 0, 0, 0.4],
    }
    for pair, goal in wanted.items():
        values, told = settle(every, start, pair, -0.03, "peg")
        np.testing.assert_allclose(values, goal, atol=1e-12)
        assert len(told) == 6


def test_a_turn_of_half_a_circle_leaves_a_free_turn_open() -> None:
    start = Pose(np.zeros(3), exp([math.pi, 0.0, 0.0]))
    with pytest.raises(TaskError, match="turned by 180 deg against every goal, which leaves q_z open") as caught:
        settle(DOWN, start, "cylindrical", -0.03, "peg")
    assert caught.value.rule == SETTLED
