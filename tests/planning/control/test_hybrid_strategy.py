"""Hybrid strategies: reciprocal axes, aligned frames, bias wrenches that balance, terminations, refusals."""

import json
import pickle
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.optimize import nnls

from fmopt.errors import InfeasibleError, SolverError
from fmopt.planning.control.bias_wrench import GuardedMove, Hold, firmness, steadiness
from fmopt.planning.control.compliance_frame import (
    _orientations,
    axes,
    compliance_frame,
    row_space,
    twist_scale,
    wrenches_in,
)
from fmopt.planning.control.hybrid_strategy import hybrid_strategy
from fmopt.spatial.se3 import Pose
from fmopt.task.problem import Specification

SPECIFICATION = Specification(0.02, 5.0, 0.5, 0.3, 2.0)
RHO = 0.014
SEATED = Pose(np.array([-1e-4, -1e-4, -0.03]), np.eye(3))
NONE = np.zeros((0, 6))


def wrench(point, normal, pose=SEATED):
    n = np.asarray(normal, dtype=float) / np.linalg.norm(normal)
    return np.concatenate([n, np.cross(np.asarray(point) - pose.p, n)])


def contacts(pairs, pose=SEATED):
    points = np.array([point for point, _ in pairs]).reshape(-1, 3)
    return np.array([wrench(point, normal, pose) for point, normal in pairs]).reshape(-1, 6), points


X_WALL = [((-0.0101, y, z), (1, 0, 0)) for y in (-0.0101, 0.0099) for z in (-0.03, 0.0)]
Y_WALL = [((x, -0.0101, z), (0, 1, 0)) for x in (-0.0101, 0.0099) for z in (-0.03, 0.0)]
FLOOR = [((x, y, -0.03), (0, 0, 1)) for x in (-0.0101, 0.0099) for y in (-0.0101, 0.0099)]
DOWN = np.array([0, 0, -0.01, 0, 0, 0])


def move(held, displacement, made=(), pose=SEATED):
    W, points = contacts(held, pose)
    return GuardedMove(pose, np.asarray(displacement, dtype=float), W, points, contacts(made, pose)[0], 1e-3)


def random_contacts(rng, count):
    pose = Pose(rng.normal(size=3) * 0.01, Pose.from_vector([0, 0, 0, *rng.normal(size=3)]).R)
    return (*contacts([(pose.p + rng.normal(size=3) * 0.02, rng.normal(size=3)) for _ in range(count)], pose), pose)


@pytest.mark.parametrize("count", range(8))
def test_axes_are_reciprocal_orthonormal_and_span_the_contacts(count):
    rng = np.random.default_rng(count)
    for _ in range(5):
        W, points, pose = random_contacts(rng, count)
        local = wrenches_in(compliance_frame(W, points, pose, RHO), W, pose)
        split, scale = axes(local, RHO), twist_scale(RHO)
        assert len(split.position) + len(split.force) == 6
        assert len(split.force) == min(count, 6)
        assert np.allclose(split.position @ split.force.T, 0.0, atol=1e-13)
        assert np.allclose(split.position @ local.T, 0.0, atol=1e-13)
        assert np.allclose((split.position * scale**2) @ split.position.T, np.eye(len(split.position)), atol=1e-12)
        assert np.allclose((split.force / scale) @ (split.force / scale).T, np.eye(len(split.force)), atol=1e-12)
        assert len(row_space(np.vstack([split.force, local]), RHO)) == len(split.force)


@pytest.mark.parametrize("tilt", [1e-13, 1e-10, 3e-8])
def test_axes_next_to_those_of_the_frame_are_not_taken_for_them(tilt):
    W = np.array([[np.cos(tilt), np.sin(tilt), 0.0, 0.0, 0.0, 0.0]])
    split = axes(W, RHO)
    assert split.aligned == (6 if tilt < 1e-12 else 4)
    assert np.abs(split.position @ W.T).max() < 1e-12


def test_power_does_not_depend_on_the_frame():
    rng = np.random.default_rng(3)
    W, _, pose = random_contacts(rng, 4)
    V = rng.normal(size=(5, 6))
    frame = Pose(rng.normal(size=3), Pose.from_vector([0, 0, 0, *rng.normal(size=3)]).R)
    moved = V[:, :3] + np.cross(V[:, 3:], frame.p - pose.p)  # twists in the coordinates of the frame
    twists = np.hstack([moved @ frame.R, V[:, 3:] @ frame.R])
    assert np.allclose(wrenches_in(frame, W, pose) @ twists.T, W @ V.T, atol=1e-13)


@pytest.mark.parametrize(
    ("held", "forced"),
    [
        ([], []),
        (X_WALL, [0, 4, 5]),
        (X_WALL + Y_WALL, [0, 1, 3, 4, 5]),
        (FLOOR, [2, 3, 4]),
        (X_WALL + Y_WALL + FLOOR, [0, 1, 2, 3, 4, 5]),
    ],
)
def test_flush_walls_keep_the_frame_of_b_with_all_freedoms_along_axes(held, forced):
    W, points = contacts(held)
    frame = compliance_frame(W, points, SEATED, RHO)
    assert np.array_equal(frame.p, SEATED.p)
    assert np.array_equal(frame.R, np.eye(3))
    split = axes(wrenches_in(frame, W, SEATED), RHO)
    assert split.aligned == 6
    assert np.array_equal(np.flatnonzero(np.abs(split.force).sum(axis=0)), forced)
    assert np.array_equal(np.count_nonzero(split.force, axis=1), np.ones(len(forced)))


@pytest.mark.parametrize("count", range(1, 7))
def test_the_frame_is_the_first_of_those_with_most_freedoms_along_axes(count):
    rng = np.random.default_rng(count)
    for flat in (True, False):
        W, points, pose = random_contacts(rng, count)
        if flat:
            W, points = contacts(rng.permutation(np.array(X_WALL + Y_WALL + FLOOR))[:count], pose)
        frames = [Pose(p, R) for p in (pose.p, *points) for R in _orientations(W, pose.R)]
        most = [axes(wrenches_in(frame, W, pose), RHO).aligned for frame in frames]
        first, found = frames[int(np.argmax(most))], compliance_frame(W, points, pose, RHO)
        assert np.array_equal(found.p, first.p)
        assert np.array_equal(found.R, first.R)


def test_one_oblique_contact_turns_the_frame_to_its_normal_and_moves_it_to_its_point():
    n = np.array([np.cos(0.2), 0.0, np.sin(0.2)])
    W, points = contacts([((-0.0101, 0.003, -0.01), n)])
    frame = compliance_frame(W, points, SEATED, RHO)
    assert np.allclose(frame.p, points[0])
    assert np.allclose(frame.R[:, 0], n)
    assert np.linalg.det(frame.R) == pytest.approx(1.0)
    assert axes(wrenches_in(frame, W, SEATED), RHO).aligned == 6


def test_bias_balances_normal_forces_on_every_listed_contact_also_dependent_ones():
    strategy = hybrid_strategy(move(X_WALL + Y_WALL, DOWN), RHO, SPECIFICATION)
    assert np.all(strategy.normal_forces > 0.5)
    assert strategy.normal_forces.sum() <= SPECIFICATION.contact_force * (1 + 1e-9)
    W, _ = contacts(X_WALL + Y_WALL)
    assert np.allclose(strategy.bias_wrench + strategy.normal_forces @ W, 0.0, atol=1e-12)
    # Applied into the walls at −x and −y, a force towards them.
    assert np.all(strategy.bias_wrench[:2] < 0.0)


def test_bias_pushes_into_the_new_contact_and_holds_all_when_it_is_felt():
    """Independent of the program: reactions of held and new contacts that balance the bias exist, all positive."""
    held = X_WALL + Y_WALL
    strategy = hybrid_strategy(move(held, DOWN, FLOOR), RHO, SPECIFICATION)
    assert strategy.stays is Hold.PUSH
    W, _ = contacts(held)
    new, _ = contacts(FLOOR)
    every, scale = np.vstack([W, new]), twist_scale(RHO)
    least = 0.05
    reaction, residual = nnls((every / scale).T, -(strategy.bias_wrench + least * every.sum(axis=0)) / scale)
    assert residual < 1e-9
    assert np.all(reaction + least > 0.0)
    V = strategy.velocity
    slip = SPECIFICATION.friction * strategy.normal_forces.sum()
    assert strategy.bias_wrench @ V >= SPECIFICATION.termination_force + slip


def test_the_whole_push_on_the_new_contact_opens_none_and_what_only_rubs_is_pressed_less():
    """A peg laid on a wall about the mouth's edge, another wall beside it: without friction, all stays closed."""
    edge = [((-0.0101, y, 0.0), (1, 0, 0)) for y in (-0.008, 0.008)]
    beside = [((x, -0.0101, z), (0, 1, 0)) for x in (-0.008, 0.008) for z in (-0.003, 0.0)]
    deep = [((-0.0101, y, -0.003), (1, 0, 0)) for y in (-0.008, 0.008)]
    # The motion turns the part about the mouth's edge, so that the deep points come to the wall.
    axis = np.array([-0.0101, 0.0, 0.0]) - SEATED.p
    turn = np.array([0.0, 0.05, 0.0])
    task = move(edge + beside, np.concatenate([np.cross(axis, turn), turn]), deep)
    strategy = hybrid_strategy(task, RHO, SPECIFICATION)
    assert strategy.stays is Hold.PUSH
    pressed = strategy.normal_forces
    assert pressed[:2].min() > pressed[2:].max()
    approach = -task.reaction @ strategy.velocity
    whole = strategy.push * np.linalg.norm(strategy.velocity * twist_scale(RHO)) / approach
    assert whole >= SPECIFICATION.termination_force
    held, scale = task.held / twist_scale(RHO), twist_scale(RHO)
    left, residual = nnls(held.T, held.T @ pressed - _held_part(held, whole * task.reaction / scale))
    assert residual < 1e-8
    assert left.sum() > 0.0


def _held_part(rows, wrench):
    """The part of a scaled wrench in the space of the rows."""
    basis = np.linalg.svd(rows, full_matrices=False)
    kept = basis[2][basis[1] > 1e-9 * basis[1][0]]
    return kept.T @ (kept @ wrench)


def test_the_push_allows_for_what_held_contacts_may_do_against_the_motion():
    """As errors turn a normal force, it has power on the motion: the push then has that much more."""
    task = move(X_WALL + Y_WALL, DOWN, FLOOR)
    stray = np.full(len(X_WALL + Y_WALL), 2e-4)
    plain = hybrid_strategy(task, RHO, SPECIFICATION)
    more = hybrid_strategy(replace(task, resisting=lambda forces: float(forces @ stray)), RHO, SPECIFICATION)
    needed = SPECIFICATION.termination_force * 1.25 + SPECIFICATION.friction * more.normal_forces.sum()
    assert more.push >= needed + 0.999 * (more.normal_forces @ stray) / np.linalg.norm(DOWN)
    assert more.push > 1.005 * plain.push


def _rubbed(given, strategy):
    """Normal forces that balance the bias on held contacts under all the friction of the motion."""
    V, mu = strategy.velocity, SPECIFICATION.friction
    basis, scale = row_space(given.held, RHO), twist_scale(RHO)
    rows = []
    for w, point in zip(given.held, given.points, strict=True):
        arm, n = point - given.reference.p, w[:3]
        velocity = V[:3] + np.cross(V[3:], arm)
        sliding = velocity - (velocity @ n) * n
        against = -sliding / np.linalg.norm(sliding)
        rows.append(w + mu * np.concatenate([against, np.cross(arm, against)]))
    pressed = strategy.normal_forces @ given.held
    return np.linalg.solve(basis @ (np.array(rows) / scale).T, basis @ (pressed / scale))


def turn_on_a_wall():
    near = [((-0.0101, y, z), (1, 0, 0)) for y, z in ((-0.0101, -0.001), (-0.0061, -0.001), (-0.0081, -0.004))]
    pose = Pose(np.array([0.0, 0.0, -0.004]), np.eye(3))
    pivot = np.array([-0.0101, -0.0101, 0.001]) - pose.p
    turn = np.array([-0.1, 0.0, 0.0])
    return move(near, [*-np.cross(turn, pivot), *turn], [((0.0099, 0.0099, -0.004), (0, 0, 1))], pose)


def test_a_part_that_turns_keeps_its_contacts_under_all_the_friction():
    given = turn_on_a_wall()
    strategy = hybrid_strategy(given, RHO, SPECIFICATION)
    forces = strategy.normal_forces
    assert _rubbed(given, strategy).min() > 0.2 * forces.min() > 0.0
    even = replace(strategy, normal_forces=np.full(3, forces.sum() / 3.0))
    assert _rubbed(given, even).min() < 0.0  # which the same forces on all of them would not do


def test_what_turns_far_from_its_contact_is_pressed_for_friction_not_for_the_stop():
    """Friction leaves each contact what it has without: more than where the new contact may come."""
    given = turn_on_a_wall()
    near, far = (hybrid_strategy(replace(given, near=flag), RHO, SPECIFICATION) for flag in (True, False))
    assert far.stays is Hold.NONE
    assert _rubbed(given, far).min() >= (1.0 - 1e-6) * far.normal_forces.min()
    assert _rubbed(given, far).min() > 2.0 * _rubbed(given, near).min()
    slide = move(X_WALL, [0, -0.01, 0, 0, 0, 0], Y_WALL)
    both = [hybrid_strategy(replace(slide, near=flag), RHO, SPECIFICATION).normal_forces for flag in (True, False)]
    assert np.array_equal(*both)


def test_firmness_is_of_slides_to_new_contacts_alone():
    slide = move(X_WALL, [0, -0.01, 0, 0, 0, 0], [((0.0, -0.0101, -0.015), (0, 1, 0))])
    forces = hybrid_strategy(slide, RHO, SPECIFICATION).normal_forces
    assert firmness(slide, RHO, SPECIFICATION) == pytest.approx(forces.min() / SPECIFICATION.contact_force)
    assert firmness(move(X_WALL, DOWN), RHO, SPECIFICATION) == 1.0
    assert firmness(move([], DOWN, FLOOR), RHO, SPECIFICATION) == 1.0
    weak = Specification(0.02, 1.0, 0.5, 0.3, 2.0)
    assert firmness(slide, RHO, weak) == 0.0


def test_steadiness_is_of_turns_to_new_contacts_and_falls_with_friction():
    given = turn_on_a_wall()
    found = [steadiness(given, RHO, replace(SPECIFICATION, friction=mu)) for mu in (0.0, 0.1, 0.2, 0.3, 0.5, 1.0)]
    assert np.all(np.diff(found) <= 1e-12)
    assert found[0] > found[3] > 0.0
    assert found[4] == found[5] == pytest.approx(0.0, abs=1e-9)
    assert steadiness(move(X_WALL, [0, -0.01, 0, 0, 0, 0], Y_WALL), RHO, SPECIFICATION) == 1.0
    assert steadiness(move(X_WALL, DOWN), RHO, SPECIFICATION) == 1.0
    assert steadiness(move([], DOWN, FLOOR), RHO, SPECIFICATION) == 1.0
    assert given.approaches
    away = replace(given, displacement=-given.displacement)
    assert not away.approaches
    assert steadiness(away, RHO, SPECIFICATION) == 0.0


def test_bias_without_any_contact_is_none_and_with_a_first_one_is_a_push():
    assert not hybrid_strategy(move([], DOWN), RHO, SPECIFICATION).bias_wrench.any()
    first = hybrid_strategy(move([], DOWN, FLOOR[:1]), RHO, SPECIFICATION)
    assert first.bias_wrench == pytest.approx([0, 0, -1.25 * SPECIFICATION.termination_force, 0, 0, 0], abs=1e-12)


def test_a_contact_that_pries_the_others_open_is_reported_not_hidden():
    # Sliding along the x-wall into one end of the y-wall only: its reaction turns the peg off the x-wall.
    narrow = [((-0.0101, y, z), (1, 0, 0)) for y in (-0.0101, -0.0065) for z in (-0.03, 0.0)]
    alone = hybrid_strategy(move(narrow, [0, -0.002, 0, 0, 0, 0], Y_WALL[2:]), RHO, SPECIFICATION)
    together = hybrid_strategy(move(narrow, [0, -0.002, 0, 0, 0, 0], Y_WALL), RHO, SPECIFICATION)
    assert alone.stays is Hold.NONE
    assert together.stays is Hold.PUSH
    assert np.all(alone.normal_forces > 0.0)


def test_termination_expects_the_new_contacts_reaction():
    end = hybrid_strategy(move(X_WALL, DOWN, FLOOR[:1]), RHO, SPECIFICATION).termination
    assert np.allclose(end.wrench, SPECIFICATION.termination_force * contacts(FLOOR[:1])[0][0])
    assert end.threshold == SPECIFICATION.termination_force
    assert end.max_travel == pytest.approx(0.011)
    assert end.timeout == pytest.approx(2 * 0.011 / SPECIFICATION.speed)
    assert not hybrid_strategy(move(X_WALL, DOWN), RHO, SPECIFICATION).termination.wrench.any()


def test_velocity_is_a_unit_twist_in_the_metric_of_rho():
    strategy = hybrid_strategy(move([], [0.001, 0, 0, 0, 0.2, 0]), RHO, SPECIFICATION)
    assert np.linalg.norm(strategy.velocity * twist_scale(RHO)) == pytest.approx(1.0)
    assert strategy.speed == SPECIFICATION.speed


@pytest.mark.parametrize("limit", [0.5, 0.02])
def test_torques_stay_within_the_limit(limit):
    strategy = hybrid_strategy(move(X_WALL + Y_WALL, DOWN), RHO, replace(SPECIFICATION, torque_limit=limit))
    assert np.all(np.abs(strategy.bias_wrench[3:]) <= limit + 1e-9)


def test_document_has_exactly_the_plan_files_keys():
    strategy = hybrid_strategy(move(X_WALL, DOWN, FLOOR), RHO, SPECIFICATION)
    names = [f"v{k}-f1" for k in range(len(X_WALL))]
    document = strategy.document(names, ["v0-f2"])
    keys = ["frame", "position_axes", "force_axes", "velocity", "speed", "bias_wrench", "push"]
    assert list(document) == [*keys, "stays", "normal_forces", "termination"]
    assert list(document["termination"]) == ["contacts", "wrench", "threshold", "max_travel", "timeout"]
    assert [item["contact"] for item in document["normal_forces"]] == names
    assert len(document["position_axes"]) + len(document["force_axes"]) == 6
    json.dumps(document, allow_nan=False)


@pytest.mark.parametrize(
    ("task", "limits", "error", "words"),
    [
        (move(X_WALL, np.zeros(6)), {}, ValueError, "no length"),
        (move([], -DOWN, FLOOR), {}, InfeasibleError, r"does not approach.*free side"),
        (move(FLOOR, DOWN, FLOOR[:1]), {}, InfeasibleError, r"runs into a contact that it holds.*release"),
        (move(X_WALL, DOWN, FLOOR), {"contact_force": 2.0}, InfeasibleError, r"wrench within 2 N.*termination_force"),
    ],
)
def test_refuses_moves_that_no_strategy_makes(task, limits, error, words):
    with pytest.raises(error, match=words):
        hybrid_strategy(task, RHO, replace(SPECIFICATION, **limits))


def test_a_solver_that_lies_is_caught(monkeypatch):
    monkeypatch.setattr("daqp.solve", lambda _, c, M, *a, **k: (np.ones(len(c)), 0, 1, {"lam": np.zeros(sum(M.shape))}))
    monkeypatch.setattr("scipy.optimize.linprog", lambda c, **_: SimpleNamespace(status=0, x=np.ones(len(c))))
    with pytest.raises(SolverError, match="breaks its rows"):
        hybrid_strategy(move(X_WALL, DOWN, FLOOR), RHO, SPECIFICATION)


def test_stays_read_only_through_pickling():
    strategy = pickle.loads(pickle.dumps(hybrid_strategy(move(X_WALL, DOWN), RHO, SPECIFICATION)))
    with pytest.raises(ValueError, match="read-only"):
        strategy.bias_wrench[0] = 1.0
