"""Parts that are next to round: they touch walls to learn where they are, and then go straight in."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from fmopt.execution.program import planned
from fmopt.execution.rig import Rig
from fmopt.execution.robot import Robot
from fmopt.execution.rotation import from_quaternions
from fmopt.execution.trials import Trials, run
from fmopt.geometry.section import corner_turns, leading_corners, next_to_round
from fmopt.plan import parsed
from fmopt.plan.guarded_moves import moves
from fmopt.planning.robustness.error_tolerance import CertifiedMotion
from fmopt.planning.search.best_first import begin
from fmopt.planning.search.entry import Shape, tilted_entry
from fmopt.planning.search.successors import Task, follow, successors
from fmopt.spatial import se3
from fmopt.spatial.se3 import Pose, length
from fmopt.task.problem import Problem, load
from fmopt.task.sizes import measured_clearance
from fmopt.verify import verify
from tests import ROOT
from tests.shared.executions.model import execute
from tests.shared.searched import certified_plan, task_of, tilted_motion

SHAPE = Shape(0.3272, 0.4809, 0.0547, 0.00046, (0.00303, 0.00495), flat=(0.00171, 0.000247, 0.0486))
BEGUN = ("approach", "edge", "face", "leave", "tilt", "enter")
FOUND = (*BEGUN, "-x", "back", "-y", "off", "upright", "in")


@pytest.fixture(scope="module")
def peg() -> Problem:
    return load(ROOT / "problems" / "factory_round_16mm_loose.toml")


@pytest.fixture(scope="module")
def task(peg: Problem) -> Task:
    return task_of(peg)


@pytest.fixture(scope="module")
def motion(peg: Problem) -> CertifiedMotion:
    return tilted_motion(peg, SHAPE)


@pytest.fixture(scope="module")
def plan(peg: Problem, motion: CertifiedMotion) -> dict[str, Any]:
    return certified_plan(peg, motion)


@pytest.mark.parametrize(
    ("name", "round_"),
    [
        ("factory_round_16mm_loose", True),
        ("factory_round_4mm_tight", True),
        ("square_peg", False),
        ("hexagon_prism", False),
        ("bilba_chamfered_60", False),  # its corners are cut, but its sides are long
    ],
)
def test_what_is_next_to_round(name: str, round_: bool) -> None:
    problem = load(ROOT / "problems" / f"{name}.toml")
    assert next_to_round(problem.moving) is round_


def test_corners_of_a_polygon_turn_all_the_way_round(peg: Problem) -> None:
    turns = corner_turns(leading_corners(peg.moving))
    assert turns == pytest.approx(np.full(18, np.radians(20.0)))


def test_two_touches_tell_where_it_is(peg: Problem, motion: CertifiedMotion) -> None:
    assert motion.found.names == FOUND
    assert 0.0 <= motion.found.lower_bound <= motion.found.cost
    claims = motion.placed.reached.claims
    assert min(claim.margin for claim in claims) > 2e-5
    made = [claim for claim in claims if claim.piece.progress[1] == 1.0]
    spread = [claim.advance.ends.goal_set.support(np.eye(6)) for claim in made]
    x, y = (FOUND.index(name) for name in ("-x", "-y"))
    assert (spread[x - 1][:2] > peg.start_box[:2]).all()
    # The first touch takes the error across its wall away, the second what is left along it.
    assert spread[x][0] < 1e-4
    assert spread[x][1] > peg.start_box[1]
    assert (spread[y][:2] < 1e-4).all()
    assert not any(claim.piece.held and not claim.piece.left for claim in made[x + 1 :] if claim is not made[y])


def test_it_knows_its_place_before_it_goes_in(peg: Problem, task: Task) -> None:
    """After one touch it goes back for another; only where both coordinates are known it leaves for the hole."""
    node = begin(task, tilted_entry(peg.moving, measured_clearance(peg).play, peg.approach, SHAPE))
    assert node is not None
    once = follow(task, node, "-x")
    assert once is not None
    assert once.place.held
    assert [after.names[len(once.names) :] for after in successors(task, once)] == [("back",)]
    back = follow(task, once, "back")
    assert back is not None
    assert not back.place.held
    assert "-x" not in {after.names[-1] for after in successors(task, back)}
    twice = follow(task, back, "-y")
    assert twice is not None
    (seated,) = successors(task, twice)
    assert seated.names[len(twice.names) :] == ("off", "upright", "in")
    assert task.seated(seated.place.pose)
    assert seated.cost >= node.cost + task.final_rank * (task.costs.transition + task.costs.danger)


def test_it_is_laid_flat_on_corners_that_come_down_on_the_top(motion: CertifiedMotion) -> None:
    """Many corners come down together, some of them over the hole."""
    (corner,) = motion.placed.moves[2].making[:1]
    last = next(claim for claim in motion.placed.reached.claims if corner in claim.piece.making)
    assert last.margin > 2e-4
    pose, body = motion.placed.moves[2].goal, motion.assembly.moving.polyhedron
    tip = pose.apply(body.vertices[body.vertices[:, 2] < 1e-9])
    assert np.abs(tip[:, 2]).max() < 1e-9
    assert (np.linalg.norm(tip[:, :2], axis=1) < 0.008).any()
    touching = pose.apply(body.vertices[corner.moving_feature])
    assert np.linalg.norm(touching[:2]) > 0.00825


def test_its_plan_keeps_its_promises(plan: dict[str, Any]) -> None:
    assert str(verify(plan).verdict) == "CERTIFIED"
    assert execute(plan, 60, seed=3).broken == {}


def test_the_engine_carries_it_out_with_the_contacts_of_the_plan(plan: dict[str, Any]) -> None:
    found = run(parsed(plan), Trials(6, seed=11), range(6))
    assert [trial["reasons"] for trial in found] == [[]] * 6
    assert [trial["departures"] for trial in found] == [[]] * 6


def test_a_turn_in_many_pieces_goes_as_far_as_it_is_to(plan: dict[str, Any]) -> None:
    """What a piece goes too far by, the next one does less."""
    number = FOUND.index("tilt")
    rows = [row for row in plan["segments"] if row["move"] == number]
    assert len(rows) > 20
    begun, ended = Pose.from_vector(rows[0]["start"]), Pose.from_vector(rows[-1]["goal"])
    seen: list[Pose] = []

    def look(rig: Rig) -> None:
        step = int(rig.state.step[0])
        if step >= 0 and rig.program.steps[step].move in (number, number + 1):
            seen.append(Pose(rig.qpos[0, :3], from_quaternions(rig.qpos[0, 3:])))

    run(parsed(plan), Trials(1, seed=1), [0], look=look)
    turned = length(se3.log(seen[-1].R @ seen[0].R.T))
    assert turned == pytest.approx(length(se3.log(ended.R @ begun.R.T)), abs=1e-3)


def test_a_touch_has_way_enough_to_be_felt(plan: dict[str, Any]) -> None:
    """Where errors use all of a move's travel up, the servo's spring still has to give way until the force is there."""
    robot = Robot()
    for step, move in zip(planned(parsed(plan), robot).steps, moves(parsed(plan)), strict=True):
        if move.stop is not None and move.last:
            assert step.travel == pytest.approx(move.stop.max_travel + 2.0 * move.stop.force / robot.stiffness)
        elif move.stop is None:
            assert step.travel == move.length
