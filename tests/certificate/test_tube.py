"""The tube of the planner's own step contains every sampled execution; the published recipe in its place is caught."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from fmopt.certificate.assembly import contact_rows
from fmopt.certificate.error_set import ErrorSet
from fmopt.certificate.propagation import advance
from fmopt.certificate.segment_linearisation import Piece, Tolerance
from fmopt.certificate.tube import Numbers, carried
from fmopt.errors import InfeasibleError
from fmopt.papers.dakin_popplestone import goal_in_the_paper
from fmopt.spatial.se3 import Pose
from fmopt.spatial.values import Array
from tests.shared.executions.tube_segments import KINDS, RHO, SCALE, SEGMENTS, Segment, executions, segment, unit_rows
from tests.shared.in_ellipsoid import contains

SAMPLES = 100_000
DIRECTIONS = 16
ROUNDING = 5e-10  # m; how exactly an execution keeps its contacts
Goal = Callable[[Segment], ErrorSet]


@dataclass(frozen=True, eq=False)
class Pool:
    """Boundary-biased samples (6, k) of the unit ball and box, drawn once and turned for each segment."""

    ball: Array
    box: Array
    drift: Array

    def few(self) -> "Pool":
        return Pool(self.ball[:, :2000], self.box[:, :2000], self.drift[:, :2000])


@pytest.fixture(scope="module")
def pool() -> Pool:
    rng = np.random.default_rng(11)
    shrink = np.where(rng.random((2, SAMPLES)) < 0.7, 1.0, rng.random((2, SAMPLES)))
    box = rng.uniform(-1.0, 1.0, (6, SAMPLES))
    corner = rng.random((6, SAMPLES)) < 0.8
    box[corner] = np.sign(box[corner])
    return Pool(shrink[0] * unit_rows(rng, SAMPLES).T, box, shrink[1] * unit_rows(rng, SAMPLES).T)


def rows_of(made: Segment, rng: np.random.Generator) -> Array:
    """Directions (k, 6) to try: random ones, and the contacts' own, in which the set at the goal is thin."""
    own = contact_rows(made.assembly, made.contacts, made.contacts, made.piece.goal).N
    return np.vstack([unit_rows(rng, DIRECTIONS) * SCALE, own / np.linalg.norm(own / SCALE, axis=1, keepdims=True)])


def extreme_inputs(made: Segment, rows: Array) -> tuple[Array, Array]:
    """Start errors and drifts (6, m) that reach farthest at the goal along rows (k, 6), or stop latest on the way."""
    own = contact_rows(made.assembly, made.contacts, made.contacts, made.piece.goal).N
    columns = np.column_stack([made.directions, made.piece.start.local(made.piece.goal)])
    onto = np.eye(6) - columns @ np.linalg.inv(own @ columns) @ own
    pull, late = rows @ onto, np.tile(own[-1], (len(rows), 1))
    starts = [_outermost(made, along) for along in (pull, late)]
    # Drift counts against the pull; its size does not matter where nothing drifts.
    drift = made.rates[:, None] * on_both_bounds((pull * made.rates).T)
    return np.hstack([*starts, 0.5 * (starts[0] + starts[1])]), np.tile(drift, 3)


def on_both_bounds(drift: Array) -> Array:
    """Drifts (6, k) with translation and turn of size 1 each, in the directions that they have."""
    parts = (drift[:3], drift[3:])
    return np.vstack([part / np.maximum(np.linalg.norm(part, axis=0), 1e-300) for part in parts])


def _outermost(made: Segment, along: Array) -> Array:
    seen = along @ made.factor
    u = seen / np.maximum(np.linalg.norm(seen, axis=1, keepdims=True), 1e-300) if made.in_ball else np.sign(seen)
    return np.asarray((u @ made.factor.T).T)


def sampled_inputs(made: Segment, pool: Pool, rng: np.random.Generator) -> tuple[Array, Array]:
    turn = np.linalg.qr(rng.normal(size=(6, 6)))[0]
    unit = turn @ pool.ball if made.in_ball else pool.box[rng.permutation(6)[: made.factor.shape[1]]]
    return made.factor @ unit, made.rates[:, None] * on_both_bounds(turn @ pool.drift)


def sound(made: Segment) -> ErrorSet:
    return made.outcome.ends.goal_set


def as_published(made: Segment) -> ErrorSet:
    """The goal set by [DakinPopplestone1993], which knows the ellipsoid of the start set alone."""
    errors = ErrorSet.from_ellipsoid(made.errors.shape)
    return goal_in_the_paper(made.assembly, made.piece, made.outcome, errors, made.tolerance)[1]


def leaves(made: Segment, pool: Pool, goal: Goal = sound) -> bool:
    """Whether any sampled or extreme execution ends outside the goal set, or leaves the tube on the way."""
    rng = np.random.default_rng(5)
    ended = goal(made)
    rows = rows_of(made, rng)
    reach = ended.support(rows) + ROUNDING
    ends = executions(made, *extreme_inputs(made, rows))
    if (rows @ ends > reach[:, None]).any():
        return True
    start, drift = sampled_inputs(made, pool, rng)
    ends = executions(made, start, drift)
    if (rows @ ends > reach[:, None]).any() or not contains(ended.shape_root, ends, ROUNDING).all():
        return True
    share, some = rng.random(2000), slice(0, 2000)
    between = executions(made, start[:, some], drift[:, some], share)
    step = made.outcome.ends
    assert step.core is not None
    begun = replace(step.start_set, generators=step.core).support(rows) + np.abs(rows @ step.slack).sum(axis=1)
    return bool((rows @ between > (1.0 - share) * begun[:, None] + share * reach[:, None] + ROUNDING).any())


@pytest.mark.parametrize("part", range(4))
def test_no_execution_leaves_the_tube(pool: Pool, part: int) -> None:
    assert [index for index in range(part, SEGMENTS, 4) if leaves(segment(index), pool)] == []


def test_the_segments_are_of_every_kind() -> None:
    made = [segment(index) for index in range(SEGMENTS)]
    assert {contact.kind for each in made for contact in each.contacts} == set(KINDS)
    assert {len(each.piece.basis) for each in made} == {0, 1, 2, 3}
    assert sum(each.linear for each in made) == SEGMENTS // 5
    assert sum(max(each.tolerance.velocity_error) > 0.0 for each in made) == 3 * SEGMENTS // 5
    turns = [float(np.linalg.norm(each.piece.start.local(each.piece.goal)[3:])) for each in made]
    assert sum(turn > 0.01 for turn in turns) > SEGMENTS // 3
    assert max(turns) > 0.1


def test_the_same_test_catches_the_published_recipe(pool: Pool) -> None:
    few = pool.few()
    caught = {index for index in range(SEGMENTS) if leaves(segment(index), few, as_published)}
    # Linear, started in an ellipsoid, no contact held: the section in place of the shadow is all that differs.
    bare = {index for index in range(0, SEGMENTS, 15) if segment(index).linear and segment(index).in_ball}
    assert len(bare) == 14
    assert bare <= caught
    assert len(caught) >= 0.9 * SEGMENTS


def test_it_catches_drift_counted_over_the_commanded_way(pool: Pool, monkeypatch: pytest.MonkeyPatch) -> None:
    """An execution that starts far from the surface goes on until it is there, and drifts on the way."""
    drifting = [index for index in range(SEGMENTS) if max(segment(index).tolerance.velocity_error) > 0.0]

    def commanded(layers: Any, way: Numbers, *rest: Any) -> Any:
        return carried(layers, way._replace(leaning=0.0, seen=np.zeros(6)), *rest)  # no error is seen along the way

    monkeypatch.setattr("fmopt.certificate.propagation.carried", commanded)

    def careless(made: Segment) -> ErrorSet:
        return advance(made.assembly, made.piece, made.errors, made.tolerance).ends.goal_set

    assert any(leaves(segment(index), pool.few(), careless) for index in drifting)


def test_the_same_test_catches_surfaces_without_thickness(pool: Pool) -> None:
    def flat(made: Segment) -> ErrorSet:
        at = sound(made)
        return ErrorSet(at.shape_root, at.generators[: len(at.generators) - at.thick], at.slide_root, at.swing_root)

    caught = [index for index in range(SEGMENTS) if leaves(segment(index), pool.few(), flat)]
    assert len(caught) > SEGMENTS // 3
    assert not any(segment(index).linear for index in caught)


def test_linear_steps_reach_every_support_direction() -> None:
    linear = [made for made in map(segment, range(SEGMENTS)) if made.linear]
    rows = unit_rows(np.random.default_rng(2), 64) * SCALE
    for made in linear:
        start, drift = extreme_inputs(made, rows)
        ends = executions(made, start[:, : len(rows)], drift[:, : len(rows)])
        np.testing.assert_allclose((rows * ends.T).sum(axis=1), sound(made).support(rows), rtol=1e-7, atol=ROUNDING)


def test_a_made_contact_takes_the_error_along_its_normal_away() -> None:
    for made in map(segment, range(0, SEGMENTS, 11)):
        rows = contact_rows(made.assembly, made.contacts, made.contacts, made.piece.goal).N
        goal = sound(made)
        assert goal.thick == len(rows)
        thickness = np.abs(goal.generators[-goal.thick :] @ rows.T)
        # Dual to the contacts: each of its last generators moves the pose off one surface only.
        np.testing.assert_allclose(thickness, np.diag(np.diag(thickness)), atol=1e-15)
        np.testing.assert_allclose(goal.support(rows), np.diag(thickness), atol=1e-14)


def test_without_a_contact_to_make_the_drift_is_that_of_the_commanded_way() -> None:
    made = segment(1)
    free = Piece(made.piece.start, made.piece.goal, (), (), (), None, (0.0, 1.0))
    errors = ErrorSet.from_box([1e-4, 2e-4, 3e-4, 0.0, 0.0, 0.0])
    outcome = advance(made.assembly, free, errors, Tolerance((0.02, 0.03), RHO))
    drift = np.array([0.02, 0.03 / RHO]) * outcome.length  # each in a ball of its own, both at once
    reached = errors.support(np.eye(6)) + np.repeat(drift, 3)
    np.testing.assert_allclose(outcome.ends.goal_set.support(np.eye(6)), reached, rtol=1e-12)
    assert outcome.approach is None
    assert outcome.departure == np.inf


@pytest.mark.parametrize(
    ("length", "refusal"), [(20.0, r"past the contact|too large for this piece"), (1.0, "past the contact")]
)
def test_a_grazing_approach_is_refused(length: float, refusal: str) -> None:
    made = segment(0)
    far = made.piece.start.local(made.piece.goal)
    row = contact_rows(made.assembly, made.contacts, made.contacts, made.piece.goal).N[0]
    aside = np.append(np.cross(row[:3], [0.3, 0.5, 0.7]), np.zeros(3))
    start = Pose(made.piece.goal.p - length * (1e-3 * far[:3] + 2e-3 * aside[:3]), made.piece.goal.R)
    piece = Piece(start, made.piece.goal, (), made.contacts, (), made.piece.made, (0.0, 1.0))
    with pytest.raises(InfeasibleError, match=refusal):
        advance(made.assembly, piece, made.errors, Tolerance((0.1, 0.1), RHO))
