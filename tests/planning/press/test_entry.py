"""The tip comes down inside the mouth for every start error, whatever the outline."""

from __future__ import annotations

from itertools import product
from pathlib import Path

import numpy as np
import pytest
from shapely import Point

from fmopt.errors import SearchError
from fmopt.planning.press.entry import _placed, attitude, corner_entry, low_vertex, support
from fmopt.planning.press.library import LIBRARY
from fmopt.planning.press.task import PressTask
from fmopt.spatial.se3 import exp
from fmopt.spatial.values import Array
from fmopt.task.problem import load
from tests.shared.parts.families import pair, write_toml
from tests.shared.plans.press_plan import press_task

SIGNS = np.array([*product((-1.0, 1.0), repeat=6)])


def starts(task: PressTask) -> Array:
    """Start errors: all vertices of the box and samples of it."""
    return np.vstack([SIGNS, np.random.default_rng(0).uniform(-1.0, 1.0, (100, 6))]) * task.box


@pytest.mark.parametrize("seed", [103, 104])
@pytest.mark.parametrize("family", ["3-gon", "rectangle", "L", "7-gon"])
def test_the_tip_comes_down_inside_the_mouth_for_every_start_error(family: str, seed: int, tmp_path: Path) -> None:
    task = press_task(load(write_toml(pair(family, seed), tmp_path)))
    errors = starts(task)
    # Supports are of first order: a turn by θ leaves θ²/2 of an arm, and a little of higher ones.
    turn = float(np.linalg.norm(task.box[3:]))
    for corner, numbers in product(task.corners[:2], LIBRARY[:3]):
        beside = numbers.distance * task.lateral
        pose, descent, share = corner_entry(task, corner, numbers.tilt, corner.angle, beside, 0.0)
        R, p = pose.R, pose.p
        assert np.allclose(R, attitude(corner.angle, numbers.tilt) @ task.goal.R, atol=1e-12)
        tip = low_vertex(task, R, np.array([np.cos(corner.angle), np.sin(corner.angle)]))
        assert share == pytest.approx(1.0, abs=1e-6)  # such a mouth is wide beside the error
        rest = 0.51 * turn**2 * float(np.linalg.norm(R @ tip))
        mouth = task.mouth.buffer(rest)
        for e in errors:
            turned = exp(e[3:]) @ R
            assert mouth.contains(Point((p + e[:3] + turned @ tip)[:2]))
            lowest = (task.tip @ turned.T)[:, 2].min() + p[2] + e[2]
            assert lowest > 0.0  # and the part begins above the mouth
        assert descent == pytest.approx(float((p + R @ tip)[2]), abs=1e-12)


def test_supports_are_reached_at_a_vertex_and_passed_nowhere(tmp_path: Path) -> None:
    task = press_task(load(write_toml(pair("L", 103), tmp_path)))
    errors, random = starts(task), np.random.default_rng(1)
    for _ in range(20):
        direction, arm = random.normal(size=3), task.size * random.normal(size=3)
        direction /= np.linalg.norm(direction)
        moved = (errors[:, :3] + np.cross(errors[:, 3:], arm)) @ direction
        assert moved.max() == pytest.approx(support(task, direction, arm), rel=1e-12)


def test_a_mouth_narrower_than_the_errors_takes_a_share_or_is_refused(tmp_path: Path) -> None:
    one = pair("4-gon", 103)
    wide = 0.3 * one.size
    task = press_task(load(write_toml(one, tmp_path, error=(wide, 0.3))))
    corner = task.corners[0]
    assert 0.0 < corner_entry(task, corner, 0.1, corner.angle, wide, 0.0)[2] < 1.0
    with pytest.raises(SearchError, match="no place for the tip"):  # two walls without a gap
        _placed(np.array([[1.0, 0.0], [-1.0, 0.0]]), np.zeros(2), np.full(2, 1e-3))
