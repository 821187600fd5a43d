"""S, Pₐ and Fₐ of certified motions, against what held contacts do when the part is moved a little along each axis."""

import json
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

import fmopt
from fmopt.plan import Plan, parsed
from fmopt.plan.contact_geometry import contacts
from fmopt.plan.position_force import AXES, Decomposition, Stretch, gamma, omega, stretches
from fmopt.report.control_tables import motion_table
from fmopt.spatial.se3 import Pose
from tests import PROBLEMS

STEP = 1e-7  # m, or rad at a lever of 1 m


@pytest.fixture(scope="module", params=["square_peg", "lee_huang_peg", "mit_planar_slot"])
def plan(request: pytest.FixtureRequest, square_peg_plan: dict[str, Any]) -> Plan:
    if request.param == "square_peg":
        return parsed(square_peg_plan)
    return fmopt.solve(fmopt.load(PROBLEMS / f"{request.param}.toml")).stated


def held_by(plan: Plan, stretch: Stretch) -> tuple[str, ...]:
    """The contacts that a stretch holds, and the pose at its goal."""
    own = [piece for piece in plan.segments if piece.move == stretch.move]
    return own[-1].state if own else plan.segments[-1].goal_state


def goal(plan: Plan, stretch: Stretch) -> Pose:
    own = [piece for piece in plan.segments if piece.move == stretch.move] or [plan.segments[-1]]
    return Pose.from_vector(np.array(own[-1].goal))


def test_an_axis_is_stopped_where_a_step_along_it_closes_a_held_contact(plan: Plan) -> None:
    known = contacts(plan)
    for stretch in stretches(plan):
        at = goal(plan, stretch)
        held = [known[name] for name in held_by(plan, stretch) if not known[name].level(at)]
        for axis in range(6):
            stopped = {
                sign: any(
                    contact.touch(at.moved(sign * STEP * np.eye(6)[axis]))[2] < contact.touch(at)[2] - 1e-5 * STEP
                    for contact in held
                )
                for sign in (1, -1)
            }
            said = 2 if stopped[1] and stopped[-1] else 1 if stopped[1] else -1 if stopped[-1] else 0
            assert stretch.s[axis] == said, (stretch.move, AXES[axis])


def test_positions_and_forces_follow_from_it(plan: Plan) -> None:
    asked, found = plan.specification, stretches(plan)
    torque = min(asked.contact_force * plan.rho, asked.torque_limit)
    for stretch in found:
        assert np.array_equal(stretch.fa, omega(stretch.s, [asked.contact_force] * 3 + [torque] * 3))
        assert np.allclose(stretch.pa_end, gamma(stretch.s, goal(plan, stretch).vector()), rtol=0.0, atol=1e-15)
        split = Decomposition(stretch.s)
        assert len(split.natural) + len(split.artificial) == 6
        assert not stretch.fa[list(split.artificial)].any()


def test_stretches_follow_each_other_and_end_seated(plan: Plan) -> None:
    found = stretches(plan)
    assert [stretch.move for stretch in found] == [*range(plan.segments[-1].move + 1), None]
    assert found[0].start == 0.0
    for one, other in pairwise(found):
        assert one.start < one.end == other.start


def test_every_difference_from_the_nominal_trajectory_has_a_reason(plan: Plan) -> None:
    for stretch in stretches(plan):
        told = {axis for words in stretch.differences for axis in words.split(":")[0].split(", ")}
        assert told == {axis for axis, a, b in zip(AXES, stretch.s, stretch.nominal, strict=True) if a != b}
    page = motion_table(plan)
    assert page.count("<tr>") == len(stretches(plan)) + 1
    assert "differs from S(t)" in page


def test_the_square_peg_holds_one_side_where_either_could_be_touched(square_peg_plan: dict[str, Any]) -> None:
    last = stretches(parsed(square_peg_plan))[-1]
    assert last.nominal[:2] == (2, 2)
    assert all(s in (1, -1) for s in last.s[:2])
    assert any("either side could be touched on the nominal way" in words for words in last.differences)
    assert fmopt.Plan(json.loads(json.dumps(square_peg_plan))).stretches[-1].s == last.s
