"""Impacts: the bound on the normal speed by sampling, the force of a mass on a spring, plans that are slowed."""

import copy
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fmopt.contact.primitive import Kind, PrimitiveContact
from fmopt.errors import InputError
from fmopt.execution.program import planned
from fmopt.execution.robot import Robot
from fmopt.plan import parsed
from fmopt.plan.guarded_moves import moves
from fmopt.planning.control.controlled_motion import Meeting, approach_speed, impact_force, impact_record, slowed
from fmopt.report.control_tables import hybrid_table
from fmopt.spatial.se3 import Pose, exp
from fmopt.spatial.values import Array
from fmopt.task.explain import explain
from fmopt.task.problem import Problem, Specification, load
from fmopt.task.sizes import measured_clearance
from fmopt.verify import CERTIFIED, NOT_PROVED, verify
from fmopt.verify.reading.reader import PlanError
from tests import ROOT
from tests.shared.files.shipped import loaded, shipped
from tests.shared.plans.table_plan import sealed

RHO = 0.014
PLAIN = Specification(0.02, 20.0, 1.0, 0.3, 2.0)
ASKED = Specification(0.02, 20.0, 1.0, 0.3, 2.0, 2.0, 0.5, 5e5)
NO_ERROR = (0.0, 0.0)


def ball(rng: np.random.Generator, size: float) -> Array:
    direction = rng.normal(size=3)
    return np.asarray(size * direction / np.linalg.norm(direction))


def unit_twist(rng: np.random.Generator) -> Array:
    V = rng.normal(size=6)
    return np.asarray(V / np.linalg.norm(V) / np.array([1.0, 1.0, 1.0, RHO, RHO, RHO]))


@pytest.mark.parametrize("kind", list(Kind))
@pytest.mark.parametrize("theta", [0.0, 0.03, 0.3])
def test_no_sampled_meeting_is_faster_than_the_bound(kind: Kind, theta: float) -> None:
    """Points between the vertices of the moving feature, turned with the part, on a normal that goes with its kind."""
    rng = np.random.default_rng(int(100 * theta))
    error, nearest = (0.02, 0.05), 0.0
    for _ in range(20):
        arms = 0.02 * rng.normal(size=({Kind.FACE_VERTEX: 4, Kind.EDGE_EDGE: 2}.get(kind, 1), 3))
        edge, V = ball(rng, 1.0), unit_twist(rng)
        normal = ball(rng, 1.0)
        leverage = 1.0 if kind is Kind.FACE_VERTEX else 0.0
        if kind is Kind.EDGE_EDGE:
            crossed = np.cross(arms[1] - arms[0], edge)
            normal = crossed / np.linalg.norm(crossed)
            leverage = float(np.linalg.norm(arms[1] - arms[0]) / np.linalg.norm(crossed))
        bound = approach_speed([Meeting(normal, arms, leverage)], V, theta, error, RHO)
        for k in range(60):
            R = exp(ball(rng, theta * (1.0 if k % 2 else rng.uniform())))
            share = rng.dirichlet(np.full(len(arms), 0.3))
            v, w = V[:3] + ball(rng, error[0]), V[3:] + ball(rng, error[1] / RHO)
            n = normal
            if kind is Kind.FACE_VERTEX:
                n = R @ normal
            elif kind is Kind.EDGE_EDGE:
                n = np.cross(R @ (arms[1] - arms[0]), edge)
                n = n / np.linalg.norm(n)
            met = abs(float(n @ (v + np.cross(w, R @ (share @ arms)))))
            assert met <= bound * (1.0 + 1e-12)
            nearest = max(nearest, met / bound)
    assert nearest > 0.6


def test_without_errors_the_bound_is_the_power_of_the_contacts_wrench() -> None:
    rng = np.random.default_rng(4)
    n, arm, V = ball(rng, 1.0), 0.02 * rng.normal(size=3), unit_twist(rng)
    wrench = np.concatenate([n, np.cross(arm, n)])
    found = approach_speed([Meeting(n, arm[None, :], 0.0)], V, 0.0, NO_ERROR, RHO)
    assert found == pytest.approx(abs(float(wrench @ V)), rel=1e-12)
    # Where no normal is known the speed of the point is all that bounds it.
    free = approach_speed([Meeting(np.zeros(3), arm[None, :], math.inf)], V, 0.0, NO_ERROR, RHO)
    assert free == pytest.approx(float(np.linalg.norm(V[:3] + np.cross(V[3:], arm))), rel=1e-12)
    assert approach_speed([], V, 0.1, (0.1, 0.1), RHO) == 0.0


def test_the_force_is_that_of_a_mass_on_a_spring() -> None:
    force = impact_force(ASKED, 0.7)
    assert force is not None
    mass, stiffness, x, v, step, greatest = 0.5, 5e5, 0.0, 0.7 * 0.02, 1e-7, 0.0
    while v > 0.0:
        v -= step * stiffness * x / mass
        x += step * v
        greatest = max(greatest, stiffness * x)
    assert force == pytest.approx(greatest, rel=1e-3)


def test_speed_falls_as_far_as_the_impact_asks_for_and_no_further() -> None:
    assert slowed(PLAIN, 1.0) is PLAIN
    assert slowed(ASKED, 0.1) is ASKED
    assert slowed(ASKED, 0.0) is ASKED
    slow = slowed(ASKED, 1.0)
    assert impact_force(slow, 1.0) == pytest.approx(2.0, rel=1e-14)
    assert slow.speed == pytest.approx(2.0 / math.sqrt(0.5 * 5e5), rel=1e-14)
    stated = {"speed": 0.02, "contact_force": 20.0, "torque_limit": 1.0, "friction": 0.3, "termination_force": 2.0}
    assert PLAIN.record() == stated


def primitive(record: dict[str, Any]) -> PrimitiveContact:
    own, other = (int(name[1:]) for name in record["id"].split("-"))
    features = (tuple(record[side]["vertices"]) for side in ("moving", "fixed"))
    return PrimitiveContact(record["id"], Kind(record["kind"]), *features, own, other)


@pytest.fixture(scope="module")
def soft_plan(square_peg_plan: dict[str, Any]) -> dict[str, Any]:
    """The plan of the square peg with its impacts limited to 2 N."""
    square_peg = load(ROOT / "problems" / "square_peg.toml")
    plan = copy.deepcopy(square_peg_plan)
    plan["specification"] = ASKED.record()
    known = {record["id"]: primitive(record) for record in plan["contacts"]}
    error, rho = tuple(plan["uncertainty"]["velocity_error"]), plan["uncertainty"]["rho"]
    for segment in plan["segments"]:
        start, goal = Pose.from_vector(segment["start"]), Pose.from_vector(segment["goal"])
        made = [known[name] for name in segment["goal_state"] if name not in segment["state"]]
        if not made:
            continue
        bodies = square_peg.moving.polyhedron, square_peg.fixed.polyhedron
        meetings = [Meeting.of(contact, *bodies, goal) for contact in made]
        theta = segment["tube"]["theta_max"] + float(np.linalg.norm(start.local(goal)[3:]))
        hybrid = segment["hybrid"]
        approach = approach_speed(meetings, np.array(hybrid["velocity"]), theta, error, rho)
        slow = slowed(ASKED, approach)
        hybrid["speed"] = slow.speed
        hybrid["termination"]["timeout"] *= ASKED.speed / slow.speed
        hybrid["impact"] = impact_record(slow, approach)
    return sealed(plan)


def test_a_slowed_plan_is_certified_and_tells_what_was_slowed(soft_plan: dict[str, Any]) -> None:
    verdict = verify(soft_plan)
    assert (verdict.findings, verdict.verdict) == ((), CERTIFIED)
    met = [s["hybrid"]["impact"] for s in soft_plan["segments"] if "impact" in s["hybrid"]]
    assert max(impact["force"] for impact in met) == pytest.approx(2.0, rel=1e-9)
    slow = {s["move"] + 1 for s in soft_plan["segments"] if s["hybrid"]["speed"] < 0.0199}
    page = hybrid_table(parsed(soft_plan))
    assert slow
    assert all(f"move {number} to" in page for number in slow)
    assert "met with at most 2" in page


CHANGES: dict[str, Callable[[dict[str, Any]], Any]] = {
    "faster": lambda h: h.update(speed=1.01 * h["speed"]),
    "met more softly": lambda h: h["impact"].update(force=0.99 * h["impact"]["force"]),
    "approached more slowly": lambda h: h["impact"].update(approach=0.99 * h["impact"]["approach"]),
    "left out": lambda h: h.pop("impact"),
}


@pytest.mark.parametrize("change", CHANGES)
def test_impacts_that_are_stated_too_low_are_rejected(soft_plan: dict[str, Any], change: str) -> None:
    plan = copy.deepcopy(soft_plan)
    CHANGES[change](next(s["hybrid"] for s in plan["segments"] if "impact" in s["hybrid"]))
    verdict = verify(sealed(plan))
    assert verdict.verdict == NOT_PROVED
    assert any(finding.what.startswith(("impact", "speed")) for finding in verdict.findings)


def test_an_impact_in_a_plan_without_a_limit_is_rejected(soft_plan: dict[str, Any]) -> None:
    plan = copy.deepcopy(soft_plan)
    plan["specification"] = PLAIN.record()
    assert verify(sealed(plan)).verdict == NOT_PROVED
    del plan["specification"]["friction"]
    plan["specification"]["impact_force"] = 2.0
    with pytest.raises(PlanError, match="lacks the key"):
        verify(sealed(plan))


def problem_with(folder: Path, lines: str) -> Problem:
    return loaded(folder, shipped("square_peg").replace("termination_force = 2\n", f"termination_force = 2\n{lines}"))


def test_the_keys_are_read_with_their_units(tmp_path: Path) -> None:
    lines = 'impact_force = 2\napparent_mass = "500 g"\ncontact_stiffness = "500 N/mm"\n'
    problem = problem_with(tmp_path, lines)
    assert problem.specification == ASKED
    assert "contacts met with at most 2 N by 0.5 kg on 500 N/mm" in explain(problem, measured_clearance(problem))


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        ("impact_force = 2\n", "missing-key: specification.apparent_mass: this key is missing"),
        ("contact_stiffness = 1e5\n", "missing-key: specification.impact_force: this key is missing"),
        ('impact_force = "2 kg"\n', "wrong-unit: specification.impact_force: '2 kg' is a mass, not a force"),
        ('apparent_mass = "5 N"\n', "wrong-unit: specification.apparent_mass: '5 N' is a force, not a mass"),
        ('contact_stiffness = "5 N"\n', "'5 N' is a force, not a stiffness"),
        ("apparent_mass = 0\n", "zero: specification.apparent_mass: 0 is zero"),
    ],
)
def test_keys_that_say_nothing_are_refused(tmp_path: Path, lines: str, message: str) -> None:
    with pytest.raises(InputError) as refused:
        problem_with(tmp_path, lines)
    assert message in str(refused.value)


def test_what_runs_a_plan_slows_slowed_segments(square_peg_plan: dict[str, Any], soft_plan: dict[str, Any]) -> None:
    robot = Robot()
    plain, soft = planned(parsed(square_peg_plan), robot), planned(parsed(soft_plan), robot)
    rates = [s["hybrid"]["speed"] / ASKED.speed for s in soft_plan["segments"]]
    assert min(rates) < 0.25
    for fast, slow, row, rate in zip(plain.steps, soft.steps, moves(parsed(soft_plan)), rates, strict=True):
        assert np.all(np.abs(slow.twist) <= np.abs(row.twist) * (1.0 + 1e-12))
        assert np.linalg.norm(slow.twist[:3]) <= np.linalg.norm(fast.twist[:3]) * (1.0 + 1e-12)
        # Moves that the robot turns more slowly than the plan has time to spare.
        turns = robot.turning / max(float(np.linalg.norm(row.twist[3:])) / rate, 1e-9)
        assert np.allclose(slow.twist, fast.twist * min(rate / min(turns, 1.0), 1.0), rtol=1e-12)
