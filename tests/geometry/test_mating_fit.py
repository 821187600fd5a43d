"""The turn that leaves a peg the most room, against all turns measured in full."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from fmopt.geometry import mating_fit
from fmopt.geometry.clearance import facing, gap
from fmopt.geometry.part import Part, rebased
from fmopt.spatial.se3 import Pose, exp
from fmopt.task.problem import load
from tests.shared.parts import families

NEAR = 1e-12  # m, to which the overlap of two sections is found


def rooms(peg: Part, hole: Part, depth: float) -> dict[float, float]:
    """The least gap for every turn that is tried."""
    pairs = facing(peg, hole, depth)
    return {
        turn: min(gap(mating_fit._turned(one, turn), other.shape) for one, other in pairs)
        for turn in mating_fit._turns(peg, hole, depth)
    }


@pytest.mark.parametrize("family", ["L", "plus", "stepped", "tapered", "7-gon"])
@pytest.mark.parametrize(("aside", "turn"), [(0.0, 0.0), (2e-5, 0.0), (3e-4, 0.3), (1e-3, 0.0)])
def test_the_best_turn_is_that_of_all_measured_in_full(family: str, aside: float, turn: float, tmp_path: Path) -> None:
    problem = load(families.write_toml(families.pair(family, 5), tmp_path))
    peg = rebased(problem.moving, Pose(np.array([aside, 0.5 * aside, 0.0]), exp([0.0, 0.0, turn])))
    depth = -float(problem.goal[2])
    found, all_of_them = mating_fit.best_fit(peg, problem.fixed, depth), rooms(peg, problem.fixed, depth)
    best = max(all_of_them.values())
    assert abs(found.gap - all_of_them[found.turn]) <= NEAR
    as_good = [one for one, room in all_of_them.items() if room >= best - max(1e-9, 0.02 * abs(best))]
    assert found.turn == min(as_good, key=lambda one: (abs(one), -one))
    assert mating_fit.goes_in(peg, problem.fixed, depth) == (best > 0.0)
    assert (found.gap > 0.0) == (best > 0.0)
    assert type(found.turn) is float  # it goes into files as it is written
