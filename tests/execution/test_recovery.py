"""Recovery in the physics engine: the way back, a second attempt that seats, and trials that never fail."""

from __future__ import annotations

import copy
from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from typing import Any

import numpy as np
import pytest

from fmopt.errors import PlanFormatError
from fmopt.execution.attempt import ReferenceCourse, carried_out
from fmopt.execution.engines.engine import Bodies
from fmopt.execution.engines.mujoco_engine import MujocoEngine
from fmopt.execution.engines.physics import Physics
from fmopt.execution.engines.scene import compiled, scene
from fmopt.execution.noise import Noise
from fmopt.execution.program import Program, planned
from fmopt.execution.recovery import EARLY, LATE, Recovery, WayBack
from fmopt.execution.rig import Rig
from fmopt.execution.robot import Robot
from fmopt.execution.rotation import from_quaternions, product, quaternions
from fmopt.execution.summary import Fit, Log, lines, summary
from fmopt.execution.trials import Trials, draw
from fmopt.plan import parsed
from fmopt.plan.contact_geometry import contacts
from fmopt.plan.guarded_moves import moves
from fmopt.spatial.se3 import Pose
from fmopt.spatial.values import Array
from tests.shared.trial_records import record

Plan = dict[str, Any]
DEAF = 1  # the move whose contact is not felt at the first attempt


ASIDE = np.array([3e-4, -2e-4, 0.0])


def recovery_of(document: Plan) -> Recovery:
    found = Recovery.of(parsed(document))
    assert found is not None
    return found


def deaf(program: Program) -> Program:
    """The program with one move that feels nothing: it stands at its contact until its time is used up."""
    steps = (replace(s, force=np.inf, sure=np.inf) if s.move == DEAF else s for s in program.steps)
    return replace(program, steps=tuple(steps))


def short(program: Program) -> Program:
    """The program with one move that is used up before it comes to its contact."""
    steps = (replace(s, travel=0.3 * s.travel) if s.move == DEAF else s for s in deaf(program).steps)
    return replace(program, steps=tuple(steps))


class Bench:
    """Runs bodies that start at the plan's pose and fail at their first attempt; keeps what was seen of the first."""

    def __init__(
        self, document: Plan, recovery: bool = True, spoilt: Callable[[Program], Program] = deaf, attempts: int = 1
    ) -> None:
        self.document, self.attempts, self.spoilt, robot = document, attempts, spoilt, Robot()
        self.fit, self.robot, self.program = Fit.of(parsed(document)), robot, planned(parsed(document), robot)
        physics = Physics.of_fit(self.fit.clearance, robot.period)
        self.model = compiled(scene(Bodies.of(parsed(document)), physics, robot.mass, robot.inertia, 0.3))
        self.recovery = recovery_of(document) if recovery else None
        self.seen: list[tuple[bool, Array]] = []

    def run(self, numbers: Sequence[int]) -> list[Log]:
        """The logs of trials with these numbers, whose noise is their own."""
        known, rows = contacts(parsed(self.document)), moves(parsed(self.document))
        start = np.hstack([self.program.start.p, quaternions(self.program.start.vector()[3:])])
        poses = np.tile(start, (len(numbers), 1))

        def rig(starts: tuple[Array, Array], which: Sequence[int], attempt: int) -> Rig:
            program = self.spoilt(self.program) if attempt < self.attempts else self.program
            drift = np.zeros((max(s.move for s in program.steps) + 1, len(which), 6))
            noise = Noise(0, [numbers[k] for k in which], attempt)
            return Rig(MujocoEngine(self.model, starts), program, self.robot, drift, noise)

        def look(shown: Rig) -> None:
            led = shown.back is not None and shown.time < shown.back.ends[0]
            self.seen.append((bool(led), np.array(shown.qpos[0])))

        course = ReferenceCourse(self.recovery, rows, known, self.fit, look)
        return carried_out(course, rig, (poses[:, :3], poses[:, 3:]))


@pytest.fixture(scope="module")
def bench(square_peg_plan: Plan) -> Bench:
    return Bench(square_peg_plan)


@pytest.fixture(scope="module")
def ran(bench: Bench) -> list[Log]:
    return bench.run([4, 9])


def test_a_part_whose_move_failed_is_brought_back_and_seats(bench: Bench, ran: list[Log]) -> None:
    order = bench.document["recovery"]["moves"][DEAF]["order"][EARLY]
    for log in ran:
        assert log.outcome is not None
        assert [asdict(one) for one in log.retries] == [{"move": DEAF, "felt": EARLY, "shift": order[0]}]
        assert log.outcome["retries"] == [asdict(one) for one in log.retries]
        assert log.departures[0] == f"move {DEAF + 1}: contact not felt"
        assert log.outcome["success"], log.outcome["reasons"]
        assert log.outcome["seconds"] > 4.0


def test_a_part_that_used_its_travel_up_is_tried_in_the_order_for_that(square_peg_plan: Plan) -> None:
    order = square_peg_plan["recovery"]["moves"][DEAF]["order"][LATE]
    [log] = Bench(square_peg_plan, spoilt=short).run([4])
    assert [asdict(one) for one in log.retries] == [{"move": DEAF, "felt": LATE, "shift": order[0]}]
    assert log.outcome is not None
    assert log.outcome["success"], log.outcome["reasons"]


def test_the_part_is_led_above_the_top_to_the_shifted_start(bench: Bench, ran: list[Log]) -> None:
    led = [q for leading, q in bench.seen if leading]
    assert ran
    assert bench.recovery is not None
    shift = bench.recovery.shifts[ran[0].retries[0].shift]
    assert np.abs(led[-1][:3] - bench.program.start.p - shift).max() < 1e-4
    begun = np.hstack([bench.program.start.p, quaternions(bench.program.start.vector()[3:])])
    heights = np.array([bench.recovery.lowest(q, begun, q[3:]) for q in led])
    turning = [k for k in range(1, len(led)) if np.abs(led[k][3:] - led[0][3:]).max() > 1e-3]
    assert heights[0] < 0.0
    assert heights[turning].min() > 0.0005
    # While it is deeper than the top it is lifted straight.
    below = [q[:2] for q, height in zip(led, heights, strict=True) if height < 0.0]
    assert np.abs(np.array(below) - led[0][:2]).max() < 1e-4


def test_what_becomes_of_a_body_does_not_depend_on_its_company(square_peg_plan: Plan, ran: list[Log]) -> None:
    [alone] = Bench(square_peg_plan).run([9])
    assert alone.outcome == ran[1].outcome


def test_without_recovery_the_first_failure_is_the_end(square_peg_plan: Plan) -> None:
    [log] = Bench(square_peg_plan, recovery=False).run([4])
    assert log.outcome is not None
    assert not log.outcome["success"]
    assert log.outcome["retries"] == []


def test_every_start_is_tried_once_in_the_plans_order(square_peg_plan: Plan) -> None:
    recovery = recovery_of(square_peg_plan)
    for move, said in enumerate(square_peg_plan["recovery"]["moves"]):
        for felt in (EARLY, LATE):
            tried: list[int] = []
            while (shift := recovery.next(move, felt, tried)) is not None:
                tried.append(shift)
            assert tried == said["order"][felt]
            assert sorted(tried) == list(range(len(square_peg_plan["recovery"]["retries"])))


def test_ways_back_are_straight_legs_without_jumps(square_peg_plan: Plan) -> None:
    recovery, rng = recovery_of(square_peg_plan), np.random.default_rng(2)
    start = square_peg_plan["segments"][0]["start"]
    begun = np.tile(np.hstack([start[:3], quaternions(np.array(start[3:]))]), (3, 1))
    begun[:, :2] += rng.uniform(-3e-4, 3e-4, (3, 2))
    poses = begun.copy()
    poses[:, 2] -= (0.02, 0.004, -0.05)
    poses[:, 3:] = product(quaternions(rng.uniform(-0.1, 0.1, (3, 3))), poses[:, 3:])
    back = WayBack.of(recovery, poses, begun, [0, 3, 1])
    assert np.allclose(back.at(0.0)[0], poses[:, :3])
    end, _, still = back.at(float(back.ends.max()))
    assert np.allclose(end, begun[:, :3] + recovery.shifts[[0, 3, 1]], atol=1e-15)
    assert not still.any()
    assert back.arrived(np.hstack(back.at(99.0)[:2])).all()
    assert not back.arrived(poses).any()
    dt = 1e-3
    for time in np.arange(0.0, float(back.ends.max()), dt):
        (p, q, twist), (ahead, after, _) = back.at(time), back.at(time + dt)
        assert np.linalg.norm(ahead - p, axis=1).max() <= 0.05 * dt * (1.0 + 1e-9)
        inner = ~((time < back.times[1:]) & (time + dt >= back.times[1:])).any(axis=0)
        assert np.allclose((ahead - p)[inner] / dt, twist[inner, :3], atol=1e-9)
        assert np.linalg.norm(twist[:, 3:], axis=1).max() <= 0.5 * (1.0 + 1e-9)
        assert np.abs(np.linalg.norm(after, axis=1) - 1.0).max() < 1e-12
        carried = (time > back.times[1]) & (time < back.times[2])
        for k in np.flatnonzero(carried & (poses[:, 2] < begun[:, 2])):
            assert recovery.lowest(np.hstack([p[k], q[k]]), begun[k], q[k]) > 0.001


def test_heights_are_those_of_the_commanded_pose(square_peg_plan: Plan) -> None:
    """An unknown start error in x and y, or a turn about the vertical, leaves the height as commanded."""
    recovery = recovery_of(square_peg_plan)
    points, start = np.array(square_peg_plan["parts"]["moving"]["vertices"]), recovery.start
    begun = np.hstack([start.p + ASIDE, quaternions(start.vector()[3:])])
    for segment in square_peg_plan["segments"]:
        pose = Pose.from_vector(segment["goal"])
        q = np.hstack([pose.p + ASIDE, quaternions(pose.vector()[3:])])
        assert recovery.lowest(q, begun, q[3:]) == pytest.approx(pose.apply(points)[:, 2].min(), abs=1e-12)
        assert np.allclose(from_quaternions(q[3:]), pose.R)
    low = np.hstack([start.p - (0.0, 0.0, 0.05), begun[3:]])
    assert recovery.liftable(begun, begun)
    assert not recovery.liftable(low, begun)


def test_plans_without_retries_have_nothing_to_try(square_peg_plan: Plan) -> None:
    plan = parsed(square_peg_plan)
    assert plan.recovery is not None
    assert Recovery.of(replace(plan, recovery=None)) is None
    assert Recovery.of(replace(plan, recovery=replace(plan.recovery, lift=None))) is None
    assert Recovery.of(replace(plan, recovery=replace(plan.recovery, retries=()))) is None
    broken = copy.deepcopy(square_peg_plan)
    del broken["recovery"]["moves"][0]["order"]
    with pytest.raises(PlanFormatError, match=r"recovery.moves\[0\]: lacks the key 'order'"):
        parsed(broken)


def test_errors_that_only_retries_cover_are_drawn_where_they_are(square_peg_plan: Plan) -> None:
    plan, wanted = parsed(square_peg_plan), Trials(5, 60, seed=8, covered=True)
    program = planned(plan, Robot())
    box = np.array(square_peg_plan["uncertainty"]["start_box"])
    draws = [draw(plan, program, wanted, n) for n in range(65)]
    assert max(one.size for one in draws[:5]) <= 1.0 < min(one.size for one in draws[5:])
    errors = np.array([one.start for one in draws[5:]])
    assert (np.abs(errors) <= square_peg_plan["recovery"]["covers"]).all()
    assert (np.abs(errors[:, :2]) > box[:2]).any(axis=1).all()
    assert np.array_equal(draw(plan, program, wanted, 40).start, draws[40].start)
    with pytest.raises(PlanFormatError, match="no retries"):
        draw(replace(plan, recovery=None), program, wanted, 6)


def test_nothing_is_beyond_no_error(square_peg_plan: Plan) -> None:
    plan, program = replace(parsed(square_peg_plan), start_box=(0.0,) * 6), planned(parsed(square_peg_plan), Robot())
    assert draw(plan, program, Trials(1, 1), 0).size == 0.0
    with pytest.raises(PlanFormatError, match="no start error"):
        draw(plan, program, Trials(1, 1), 1)
    assert summary([record(0, 0.0), record(1, 0.2)])["by_size"][0] == {"size": [0.0, 0.25], "trials": 2, "share": 1.0}


def test_summaries_tell_what_trying_again_has_gained() -> None:
    again = {"retries": [{"move": 2, "felt": LATE, "shift": 1}]}
    records = [record(0, 0.5), {**record(1, 0.5), **again}, {**record(2, 0.5, False), **again}, record(3, 1.5)]
    found = summary(records)
    assert found["inside"]["successes"] == 2
    assert found["inside"]["without_recovery"]["successes"] == 1
    assert found["beyond"]["without_recovery"]["interval"] == found["beyond"]["interval"]
    told = "\n".join(lines({**found, "contact_force": 15.0}))
    assert "without trying again 1 of 3, 33.3 % (95 % interval" in told
    assert told.count("without trying again") == 1
