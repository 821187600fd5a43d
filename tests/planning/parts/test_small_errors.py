"""Start errors next to nothing, along some axes or all: no harder to plan for than large ones."""

from dataclasses import replace

import numpy as np
import pytest

import fmopt
from fmopt.geometry.section import leading_corners
from fmopt.planning.pipeline import synthesise
from fmopt.planning.search.entry import start_spread, swung_by
from fmopt.planning.search.entry_room import roomy_errors
from fmopt.task.explain import explain
from fmopt.task.problem import VelocityError, load
from fmopt.task.sizes import measured_clearance
from tests import ROOT

PROBLEM = load(ROOT / "problems" / "square_peg_100um.toml")
VELOCITY = ("uncertainty.velocity.translation", "uncertainty.velocity.rotation")
CLEARANCE = 1e-4
NONE, X_ALONE = np.zeros(6), np.array([1e-3, 0.0, 0.0, 0.0, 0.0, 0.0])
SMALL = 1e-5 * np.array([1.0, 1.0, 0.0, 17.0, 17.0, 17.0])
BOXES = {"none": NONE, "x alone": X_ALONE, "small": SMALL, "a fifth": 0.2 * PROBLEM.start_box}


@pytest.mark.parametrize("name", BOXES)
def test_a_plan_is_found_and_certified(name: str) -> None:
    solved = synthesise(replace(PROBLEM, start_box=BOXES[name]))
    assert solved.document["verdict"] == "CERTIFIED"
    assert solved.verdict.margin is not None
    assert solved.verdict.margin > 2e-5


def test_a_plan_is_certified_without_errors_of_velocity() -> None:
    solved = synthesise(replace(PROBLEM, velocity_error=VelocityError(0.0, 0.0)))
    assert (solved.verdict.findings, solved.document["verdict"]) == ((), "CERTIFIED")


START = tuple(f"uncertainty.start.{axis}" for axis in ("x", "y", "rx", "ry", "rz"))


@pytest.mark.parametrize("stated", [{}, {"uncertainty.start.x": 0.3}, {"uncertainty.start.rz": 1.0}])
def test_a_plan_without_errors_allows_for_rounding(stated: dict[str, float]) -> None:
    """Rounding grew beyond what the check takes as stated where only one component had an error."""
    perfect = fmopt.load(fmopt.example("square_peg")).with_({**dict.fromkeys((*START, *VELOCITY), 0.0), **stated})
    assert np.sort(perfect.start_box)[:5] == pytest.approx(np.full(5, 1e-9))
    assert [share.source for share in perfect.budget] == ["as stated", "allowance for rounding"]
    assert "error as listed below: +-" in explain(perfect, measured_clearance(perfect))
    plan = fmopt.solve(perfect)
    assert (plan.verdict, plan.verify().findings) == ("CERTIFIED", ())


def test_nothing_is_allowed_for_rounding_beside_errors_of_velocity() -> None:
    for axis in VELOCITY:
        there = fmopt.load(fmopt.example("square_peg")).with_(dict.fromkeys({*START, *VELOCITY} - {axis}, 0.0))
        assert there.budget == ()
        assert not there.start_box.any()


def test_sources_of_nothing_and_planar_problems_have_the_allowance_too() -> None:
    there = fmopt.load(fmopt.example("factory_rect_8mm_sources"))
    sources = [f"{source}.{axis}" for source in ("configuration", "feeder", "robot") for axis in ("position", "angle")]
    names = ("shape", *sources, "grasp.position", "grasp.angle")
    perfect = there.with_({**{f"uncertainty.sources.{name}": 0.0 for name in names}, **dict.fromkeys(VELOCITY, 0.0)})
    np.testing.assert_array_equal(perfect.start_box, np.full(6, 1e-9))
    assert perfect.budget[-1].source == "allowance for rounding"
    assert "error from its sources: +-" in explain(perfect, measured_clearance(perfect))
    slot = fmopt.load(fmopt.example("mit_planar_slot"))
    slot = slot.with_(dict.fromkeys(("uncertainty.start.x", "uncertainty.start.ry", *VELOCITY), 0.0))
    np.testing.assert_array_equal(slot.start_box, [1e-9, 0.0, 1e-9, 0.0, 1e-9, 0.0])


@pytest.mark.parametrize("name", BOXES)
def test_room_is_left_for_more_than_the_errors(name: str) -> None:
    box = BOXES[name]
    room = roomy_errors(PROBLEM.moving, CLEARANCE, box)
    assert (room >= box).all()
    assert (room[:2] > 0.0).all()
    assert start_spread(PROBLEM.moving, room) >= 2.0 * CLEARANCE * (1.0 - 1e-12)
    assert swung_by(leading_corners(PROBLEM.moving), room) >= CLEARANCE * (1.0 - 1e-12)


def test_no_more_room_is_left_for_large_errors_than_there_are() -> None:
    assert np.array_equal(roomy_errors(PROBLEM.moving, CLEARANCE, PROBLEM.start_box), PROBLEM.start_box)
