"""Starts far above the mouth: what the part drifts by on its way down counts among the errors to leave room for."""

from dataclasses import replace

import numpy as np
import pytest

from fmopt.certificate.assembly import Assembly
from fmopt.planning.pipeline import synthesise
from fmopt.planning.search.entry_room import room
from fmopt.spatial.values import Array
from fmopt.task.explain import explain
from fmopt.task.problem import VelocityError, load
from fmopt.task.sizes import drift, measured_clearance
from tests import PROBLEMS

PEG, SLOT = (load(PROBLEMS / f"{name}.toml") for name in ("square_peg_100um", "mit_planar_slot"))
CLEARANCE, RHO, RATE = 1e-4, 0.0141, 0.01


def left(height: float, planar: bool = False) -> Array:
    """Room for the start errors of a part that comes from a height (m)."""
    problem = replace(SLOT if planar else PEG, approach=height, velocity_error=VelocityError(RATE, RATE))
    assembly = Assembly(problem.moving, problem.fixed, planar=planar)
    return room(assembly, CLEARANCE, problem.start_box, drift(problem, measured_clearance(problem)))


def test_a_drift_below_the_clearance_is_left_aside() -> None:
    assert np.array_equal(left(0.001), PEG.start_box)
    assert np.array_equal(left(0.009), PEG.start_box)


@pytest.mark.parametrize("height", [0.02, 0.05])
def test_room_is_left_for_most_of_a_drift(height: float) -> None:
    drift = RATE * height / np.array([1.0, 1.0, 1.0, RHO, RHO, RHO])
    more = left(height) - PEG.start_box
    assert (0.5 * drift <= more).all()
    assert (more <= drift).all()


def test_a_planar_part_drifts_in_its_plane() -> None:
    more = left(0.1, planar=True) - left(0.0, planar=True)
    assert (more[[0, 2, 4]] > 0.0).all()
    assert not more[[1, 3, 5]].any()


def test_the_drift_is_told_where_it_counts() -> None:
    high, low = (explain(there, measured_clearance(there)) for there in (replace(PEG, approach=0.03), PEG))
    assert "drifts by up to 0.3 mm and 1.21543 deg on its way down" in high
    assert "drifts" not in low


@pytest.mark.wide
def test_a_plan_from_high_above_is_certified() -> None:
    solved = synthesise(replace(PEG, approach=0.02))
    assert solved.document["verdict"] == "CERTIFIED"
