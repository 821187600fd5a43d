"""Rows of presses against closed forms, sampled rests, sampled errors, and finite differences."""

import math
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import linprog, nnls

from fmopt.plan.description import Description
from fmopt.planning.optimise.cone_program import as_cvxpy
from fmopt.planning.optimise.solvers import ClarabelSolver
from fmopt.planning.press.placed.jam import jam, reached_sets
from fmopt.planning.press.placed.placement import placed_push, strongest
from fmopt.planning.press.placed.room import room, widest_room
from fmopt.planning.press.placed.rows import placed_attempts
from fmopt.planning.press.placed.touches import PressWrench, Touches, escape, escaped
from fmopt.planning.press.propose import proposals
from fmopt.planning.press.solve import conditions_of, traced
from fmopt.planning.press.task import PressTask
from fmopt.spatial.se3 import Pose
from fmopt.spatial.values import Array
from fmopt.task.problem import load
from tests.shared.parts.families import Pair, Placing, Section, pair, widened, write_toml
from tests.shared.plans.press_plan import choosing_of, press_task

SIDES = 48  # of a pyramid inside a friction cone


def square(folder: Path) -> PressTask:
    """A square peg, 20 mm wide, in a hole 50 mm deep, 0.1 mm a side."""
    outline = ((-10.0, -10.0), (10.0, -10.0), (10.0, 10.0), (-10.0, 10.0))
    peg, hole = (Section(0.0, outline), Section(80.0, outline)), widened(outline, 0.1)
    here = Placing((0.0, 0.0, 0.0), 0.0)
    one = Pair(
        "square", "4-gon", peg, (), (Section(-50.0, hole), Section(0.0, hole)), (80.0, 80.0, 60.0), 0.1, 50.0, False,
        20.0, (here, here), False,
    )  # fmt: skip
    return press_task(load(write_toml(one, folder, (0.3, 0.3))))


def going_down(task: PressTask, depth: float) -> tuple[Touches, PressWrench, Array]:
    """The walls about the axis pose at a depth, m, an axial force at the tip, and the box of the play."""
    clearance = task.clearance.per_side
    pose = Pose(np.append(task.goal.p[:2], -depth), task.goal.R)
    near = Touches.near(task.moving.polyhedron, task.fixed.polyhedron, pose, 20.0 * clearance, 0.2, clearance)
    touches = near.some(np.abs(near.N[:, 2]) < 0.5)
    push = PressWrench(np.array([0.0, 0.0, -1.0, 0.0, 0.0, 0.0]), np.ones(6, dtype=bool), 0.5 * task.size)
    return touches, push, np.array([30.0 * clearance] * 3 + [0.3] * 3)


def rests(touches: Touches, push: PressWrench, friction: float) -> bool:
    """Whether forces in pyramids inside the friction cones hold a wrench, by non-negative least squares."""
    turns = np.arange(SIDES) * (2.0 * math.pi / SIDES)
    along = np.stack([np.cos(turns), np.sin(turns)])
    cones = touches.N[:, None] + friction * np.einsum("ts,ktn->ksn", along, touches.T)
    return bool(nnls(push.rows(cones.reshape(-1, 6)).T, -push.free)[1] < 1e-6 * push.size)


@pytest.mark.parametrize("share", [0.1, 0.25, 0.5, 1.0, 2.0])
def test_a_square_peg_jams_across_its_corners_from_a_friction_that_is_known(share: float, tmp_path: Path) -> None:
    touches, push, box = going_down(square(tmp_path), 0.02 * share)
    sets = reached_sets(touches, box, np.eye(6)[2], 1e-4)
    assert (len(touches), len(sets)) == (16, 18)
    found = jam(sets, touches, push)
    # Two corners that lie across, each on two walls: the line between them inside both cones of half the opening.
    assert found.friction == pytest.approx(share / math.hypot(2.0, share), abs=3e-4)
    held = touches.some([touches.names.index(name) for name in found.contacts])
    assert escaped(held, push, found.twist) == pytest.approx(found.friction, abs=1e-9)
    assert not rests(held, push, found.friction)
    assert rests(held, push, 1.02 * found.friction)


def test_cvxpy_states_the_program_of_an_escape_and_agrees(tmp_path: Path) -> None:
    touches, push, box = going_down(square(tmp_path), 0.01)
    for some in reached_sets(touches, box, np.eye(6)[2], 1e-4)[::4]:
        program = escape(touches.some(sorted(some)), push, 0.1)
        stated, _ = as_cvxpy(program)
        margin = float(program.c @ ClarabelSolver().proposed(program))
        assert margin > 1e-3
        assert stated.solve(solver="CLARABEL") == pytest.approx(margin, abs=1e-6)


def corner(turn: float) -> tuple[Touches, PressWrench]:
    """Two walls that meet at an exterior angle, degrees, and a push between them, across the axis."""
    normals = [[-math.cos(0.5 * math.radians(turn)), s * math.sin(0.5 * math.radians(turn)), 0.0] for s in (1.0, -1.0)]
    held = Touches.at(("one", "other"), np.zeros(2), np.array(normals), np.zeros((2, 3)))
    return held, PressWrench(np.array([8.0, 0.0, -3.0, 0.0, 0.0, 0.0]), np.arange(6) < 2, 0.01)


@pytest.mark.parametrize(("turn", "friction"), [(120.0, 0.5), (90.0, 0.5), (60.0, 0.3), (51.4, 0.5), (40.0, 0.3)])
def test_a_placed_push_leads_along_a_wall_and_holds_in_the_corner_as_well_as_any(turn: float, friction: float) -> None:
    held, push = corner(turn)
    placed = placed_push(push, [held.some([0])], held, friction)
    assert (placed.push.wrench[2], placed.push.size) == pytest.approx((-3.0, 8.0))
    assert [rests(some, placed.push, friction) for some in (held.some([0]), held)] == [False, True]
    half, angles = math.radians(0.5 * turn), np.linspace(-math.pi, math.pi, 2001)  # of pushes, and of twists
    out, along = -held.N[0, :2], np.array([held.N[0, 1], -held.N[0, 0]])
    u = np.stack([np.cos(angles), np.sin(angles)])
    opens = -(out @ u) - friction * np.abs(along @ u)
    best = -1.0
    for at in np.linspace(-half, half, 1001):
        powers = np.array([math.cos(at), math.sin(at)]) @ u
        escapes = np.minimum(opens, powers)
        forces = np.linalg.solve(held.N[:, :2].T, [-math.cos(at), -math.sin(at)])
        best = max(best, min(float(powers[escapes.argmax()]), *forces.tolist()))
    assert placed.margin == pytest.approx(best, abs=4e-3)
    stated = as_cvxpy(strongest(placed.push, placed.twists, held))[0].solve(solver="CLARABEL")
    assert stated == pytest.approx(placed.margin, abs=2e-3)


def test_a_push_that_rests_on_a_wall_at_first_is_placed_by_lower_frictions() -> None:
    held, push = corner(40.0)
    alone = [held.some([0]), held.some([1])]
    first, second = (placed_push(push, [wall], held, 0.5) for wall in alone)
    for wall, one in zip(alone, (first, second), strict=True):
        assert (rests(wall, push, 0.5), rests(wall, one.push, 0.5)) == (True, False)
    assert first.push.wrench == pytest.approx(second.push.wrench * (1.0, -1.0, 1.0, 1.0, 1.0, 1.0), abs=1e-3)
    assert placed_push(push, alone, held, 0.5).friction == pytest.approx(math.tan(math.radians(20.0)), abs=1e-3)


@pytest.mark.parametrize("family", ["3-gon", "7-gon", "L", "star"])
def test_no_sampled_rest_is_outside_the_sets_that_errors_reach(family: str, tmp_path: Path) -> None:
    task = press_task(load(write_toml(pair(family, 103), tmp_path)))
    touches, push, box = going_down(task, 0.4 * task.depth)
    along = np.eye(6)[2]
    sets = reached_sets(touches, box, along, task.clearance.per_side)
    friction = jam(sets, touches, push).friction
    assert 0.05 < friction < 1.0
    random = np.random.default_rng(7)
    for _ in range(60):
        # A face of the play: the vertices at which a random direction, and one near it, are farthest.
        towards = random.normal(size=6) / box
        x = linprog(
            -towards, A_ub=-touches.N, b_ub=touches.f, A_eq=along[None], b_eq=[0.0], bounds=np.column_stack([-box, box])
        ).x
        at = frozenset(np.flatnonzero(touches.f + touches.N @ x < 1e-3 * task.clearance.per_side).tolist())
        assert any(at <= one for one in sets)
        some = random.choice(sorted(at), size=random.integers(1, len(at) + 1), replace=False).tolist()
        assert not rests(touches.some(some), push, 0.99 * friction)


def test_rows_of_contacts_are_those_of_finite_differences(tmp_path: Path) -> None:
    task = square(tmp_path)
    pose = Pose(np.array([2e-5, -3e-5, -0.011]), Pose.from_vector([0.0, 0.0, 0.0, 1e-3, -2e-3, 5e-4]).R)
    parts = task.moving.polyhedron, task.fixed.polyhedron
    touches = Touches.near(*parts, pose, 2e-3, 0.05, 1e-4)
    step, random = 1e-7, np.random.default_rng(3)
    for twist in random.normal(size=(4, 6)):
        moved = Touches.near(*parts, pose.moved(step * twist), 2e-3, 0.05, 1e-4)
        change = [
            (moved.f[moved.names.index(name)] - f) / step for name, f in zip(touches.names, touches.f, strict=True)
        ]
        assert change == pytest.approx(touches.N @ twist, abs=1e-5)
    # A tangential map takes what is normal out of the speed of the point, and nothing else.
    assert np.abs(np.einsum("ktn,kn->kt", touches.T[..., :3], touches.N[:, :3])).max() < 1e-12
    assert np.linalg.norm(touches.T[..., :3], axis=2) == pytest.approx(1.0)


def test_errors_leave_the_room_between_pieces_that_is_told(tmp_path: Path) -> None:
    task = press_task(load(write_toml(pair("5-gon", 103), tmp_path)))
    body, random = task.moving.pieces[0], np.random.default_rng(11)
    pose = Pose(np.array([1e-3, -5e-4, 2e-3]), Pose.from_vector([0.0, 0.0, 0.0, 0.06, -0.05, 0.1]).R)
    errors = np.diag([5e-4, 5e-4, 2e-4, 0.01, 0.01, 0.01])
    told = 0
    for other in task.fixed.pieces:
        kept, gap = room(body, other, pose, errors)
        widest = widest_room(body, other, pose, errors)
        if widest > 1e-5:
            told += 1
            assert kept <= widest + 1e-9 <= gap + 1e-9
            for signs in random.choice([-1.0, 1.0], size=(40, 6)):
                moved = pose.moved(errors @ signs)
                assert widest_room(body, other, moved, np.zeros((6, 0))) >= widest - 2e-5  # curvature of turns
    assert told >= 3


def described(task: PressTask) -> Description:
    """The rows of the first sequence for a part, as a plan describes them."""
    plan, conditions = choosing_of(task).plan(proposals(task)[:1]), conditions_of(task.problem)
    return Description(placed=placed_attempts(task, plan, traced(task, plan, conditions), conditions))


def test_rows_go_on_to_the_seat_after_presses_that_take_no_time(tmp_path: Path) -> None:
    (attempt,) = described(press_task(load(write_toml(pair("5-gon", 103), tmp_path)))).placed
    assert len(attempt.depths) == 12


@pytest.fixture(scope="module")
def stepped(tmp_path_factory: pytest.TempPathFactory) -> Description:
    """The rows of a stepped fit that stands on its shelf."""
    task = press_task(load(write_toml(pair("stepped", 103), tmp_path_factory.mktemp("stepped"), (0.32, 0.32))))
    made = described(task)
    assert made == described(task)
    return Description.parsed(made.record())


def test_from_its_datum_on_a_stepped_fit_is_shown_to_come_to_its_goal(stepped: Description) -> None:
    (attempt,) = stepped.placed
    assert (attempt.datum, len(attempt.presses), len(attempt.depths)) == (2, 9, 12)
    datum, slide, *_, last = attempt.presses[2:]
    assert datum.rank == 6
    assert datum.holds is not None
    assert 0.05 < datum.holds < 0.5
    assert max(datum.error[:3]) <= 1e-6
    assert max(attempt.presses[1].error[3:]) > 5e-3
    assert slide.largest_friction is None  # a twist leads it
    assert last.margin is not None
    assert last.margin > 1e-4
    assert attempt.shown_friction == min(
        one.largest_friction for one in attempt.presses[2:] if one.largest_friction is not None
    )
    assert 0.1 < attempt.shown_friction < 0.3
    assert not attempt.presses[0].contacts
