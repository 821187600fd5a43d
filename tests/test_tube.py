"""The tube contains every sampled execution, and the published recipe put in its place is caught."""

import pickle
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
import pytest

from fmopt import ellipsoid
from fmopt.errors import InfeasibleError
from fmopt.uncertainty import dakin
from fmopt.uncertainty.error_set import ErrorSet
from fmopt.uncertainty.tube import Tube, drift_shape, farthest_travel, linear_segment, step, travel_length

RHO = 0.02
SCALE = ellipsoid.metric(RHO)
SEGMENTS = 200
SAMPLES = 100_000
NO_ROWS, NO_COLUMNS = np.zeros((0, 6)), np.zeros((6, 0))


@dataclass(frozen=True, eq=False)
class Segment:
    """One random segment; a start error is `factor` @ u with u in the unit ball or the unit box."""

    factor: np.ndarray
    in_ball: bool
    errors: ErrorSet
    move: np.ndarray
    held: np.ndarray
    compliant: np.ndarray
    normal: np.ndarray
    thickness: np.ndarray
    velocity_error: tuple[float, float]

    @property
    def exact(self) -> bool:
        return max(self.velocity_error) == 0.0

    def tube(self, method: str) -> Tube:
        return linear_segment(
            self.errors,
            self.move,
            self.held,
            self.compliant,
            self.normal,
            self.thickness,
            self.velocity_error,
            RHO,
            method,
        )


@dataclass(frozen=True, eq=False)
class Pool:
    """Boundary-biased samples (k, 6) of the unit ball and box, drawn once and turned for each segment."""

    ball: np.ndarray
    box: np.ndarray
    drift: np.ndarray


def unit_rows(rng: np.random.Generator, k: int, n: int = 6) -> np.ndarray:
    u = rng.normal(size=(k, n))
    return u / np.linalg.norm(u, axis=1, keepdims=True)


@pytest.fixture(scope="module")
def pool() -> Pool:
    rng = np.random.default_rng(11)
    shrink = np.where(rng.random((2, SAMPLES, 1)) < 0.7, 1.0, rng.random((2, SAMPLES, 1)))
    box = rng.uniform(-1.0, 1.0, (SAMPLES, 6))
    corner = rng.random((SAMPLES, 6)) < 0.8
    box[corner] = np.sign(box[corner])
    return Pool(shrink[0] * unit_rows(rng, SAMPLES), box, shrink[1] * unit_rows(rng, SAMPLES))


def random_start(rng: np.random.Generator, kind: int) -> tuple[np.ndarray, bool, ErrorSet]:
    spread = 1e-3 * 10.0 ** rng.uniform(-2.0, 0.0, 6)
    if kind == 0:
        factor = np.linalg.qr(rng.normal(size=(6, 6)))[0] * spread / SCALE[:, None]
        return factor, True, ErrorSet.from_ellipsoid(factor @ factor.T)
    if kind == 1:
        generators = unit_rows(rng, 6) * spread[:, None] / SCALE
        generators[rng.integers(4, 7) :] = 0.0
        return generators.T, False, ErrorSet.from_zonotope(generators, RHO)
    return np.diag(spread / SCALE), False, ErrorSet.from_box(spread / SCALE)


def random_segment(index: int) -> Segment:
    rng = np.random.default_rng([3, index])
    rank = index % 4
    held = unit_rows(rng, rank) * SCALE
    compliant = (unit_rows(rng, rank) + 1.5 * held / SCALE).T / SCALE[:, None]
    normal = unit_rows(rng, 1)[0] * SCALE
    onto_state = np.eye(6) - np.linalg.pinv(held / SCALE) @ (held / SCALE)
    V = onto_state @ unit_rows(rng, 1)[0]
    V /= np.linalg.norm(V)
    while abs(normal / SCALE @ V) < 0.3:
        normal = unit_rows(rng, 1)[0] * SCALE
    factor, in_ball, errors = random_start(rng, index % 3)
    in_state, _ = ellipsoid.oblique_projector(held, compliant)
    grows, thick = index % 5 in (1, 2, 3), index % 5 in (2, 4)
    return Segment(
        factor=in_state @ factor,
        in_ball=in_ball,
        errors=errors.image(in_state),
        move=rng.uniform(2e-4, 5e-3) * V / SCALE,
        held=held,
        compliant=compliant,
        normal=normal,
        thickness=thick * 2e-5 * rng.random(rank + 1),
        velocity_error=(float(grows * rng.uniform(0.0, 0.1)), float(grows * rng.uniform(0.0, 0.1))),
    )


def executions(segment: Segment, start: np.ndarray, drift: np.ndarray, surface: np.ndarray) -> np.ndarray:
    """Errors at the goal (k, 6) of executions with these start errors, drifts per metre and surface offsets."""
    keep, correction = ellipsoid.oblique_projector(segment.held, segment.compliant)
    velocity = segment.move / travel_length(segment.move, RHO) + drift @ keep.T
    ahead = start - segment.move
    if surface.any():
        ahead = ahead + surface[:, :-1] @ correction.T
    travel = (surface[:, -1] - ahead @ segment.normal) / (velocity @ segment.normal)
    return np.asarray(ahead + travel[:, None] * velocity)


def execution_by_equations(segment: Segment, start: np.ndarray, drift: np.ndarray, surface: np.ndarray) -> np.ndarray:
    """One execution again, from the contact equations alone: compliance and travel that meet all surfaces."""
    velocity = segment.move / travel_length(segment.move, RHO) + drift
    rows = np.vstack([segment.held, segment.normal])
    directions = np.column_stack([segment.compliant, velocity])
    ahead = start - segment.move
    return np.asarray(ahead + directions @ np.linalg.solve(rows @ directions, surface - rows @ ahead))


def extreme_inputs(
    segment: Segment, directions: np.ndarray, start_along: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Start errors, drifts and surface offsets that reach farthest at the goal along each direction (k, 6).

    With `start_along` (6,) the start errors are the outermost along that instead.
    """
    rows = np.vstack([segment.held, segment.normal])
    columns = np.column_stack([segment.compliant, segment.move])
    onto_goal, correction = ellipsoid.oblique_projector(rows, columns)
    pull = directions @ onto_goal
    along = (pull if start_along is None else np.tile(start_along, (len(pull), 1))) @ segment.factor
    u = along / np.linalg.norm(along, axis=1, keepdims=True) if segment.in_ball else np.sign(along)
    D = drift_shape(segment.velocity_error, RHO)
    reach = ellipsoid.support(D, pull)[:, None]
    drift = np.divide(pull @ D, reach, out=np.zeros_like(pull), where=reach > 0.0)
    return u @ segment.factor.T, drift, np.sign(directions @ correction) * segment.thickness


def sampled_inputs(segment: Segment, pool: Pool, rng: np.random.Generator) -> tuple[np.ndarray, ...]:
    turn = np.linalg.qr(rng.normal(size=(6, 6)))[0]
    start = pool.ball @ (segment.factor @ turn).T if segment.in_ball else pool.box @ segment.factor.T
    drift, surface = np.zeros((1, 6)), np.zeros((1, len(segment.thickness)))
    if not segment.exact:
        drift = pool.drift @ (ellipsoid.root(drift_shape(segment.velocity_error, RHO)) @ turn).T
    if segment.thickness.any():
        surface = pool.box[:, rng.permutation(6)[: len(segment.thickness)]] * segment.thickness
    return start, drift, surface


def leaves(segment: Segment, pool: Pool, method: str) -> bool:
    """Whether any sampled or extreme execution ends outside the goal set, or passes a plane that the tube clears."""
    rng = np.random.default_rng(5)
    tube = segment.tube(method)
    directions = unit_rows(rng, 16) * SCALE
    outermost, drift, surface = extreme_inputs(segment, directions)
    away = -segment.normal / (segment.normal @ segment.move)
    latest, _, _ = extreme_inputs(segment, directions, away)
    for start in (outermost, latest, 0.5 * (outermost + latest)):
        ends = executions(segment, start, drift, surface)
        if (np.sum(ends * directions, axis=1) > tube.goal.support(directions) + 1e-12).any():
            return True
    start, drift, surface = sampled_inputs(segment, pool, rng)
    ends = executions(segment, start, drift, surface)
    if not ellipsoid.contains(tube.goal.shape, ends).all():
        return True
    if ((directions @ ends.T).max(axis=1) > tube.goal.support(directions) + 1e-12).any():
        return True
    some = slice(0, 2000)
    fraction = rng.random((2000, 1))
    path = (1.0 - fraction) * start[some] + fraction * (segment.move + ends[some])
    level = tube.margins(directions, np.zeros(16), directions @ segment.move)
    return bool(((path @ directions.T).min(axis=0) < level - 1e-12).any())


def test_no_execution_leaves_the_tube(pool: Pool) -> None:
    outside = [index for index in range(SEGMENTS) if leaves(random_segment(index), pool, "shadow")]
    assert outside == []


def test_the_same_test_catches_the_published_recipe(pool: Pool) -> None:
    few = Pool(pool.ball[:2000], pool.box[:2000], pool.drift[:2000])
    caught = [index for index in range(SEGMENTS) if leaves(random_segment(index), few, "dakin1993")]
    bare = [index for index in range(0, SEGMENTS, 15) if not random_segment(index).thickness.any()]
    assert len(bare) == 14
    assert all(random_segment(index).exact and random_segment(index).in_ball for index in bare)
    assert set(bare) <= set(caught)
    assert len(caught) > 0.9 * SEGMENTS


def test_the_same_test_catches_drift_counted_over_the_commanded_way(
    pool: Pool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("fmopt.uncertainty.tube.farthest_travel", lambda errors, move, *_: travel_length(move, RHO))
    few = Pool(pool.ball[:2000], pool.box[:2000], pool.drift[:2000])
    caught = [index for index in range(SEGMENTS) if leaves(random_segment(index), few, "shadow")]
    assert caught
    assert not any(random_segment(index).exact for index in caught)


def test_exact_steps_reach_every_support_direction() -> None:
    exact = [segment for segment in map(random_segment, range(SEGMENTS)) if segment.exact]
    assert len(exact) == 80
    assert any(segment.thickness.any() for segment in exact)
    directions = unit_rows(np.random.default_rng(2), 64) * SCALE
    for segment in exact:
        reached = np.sum(executions(segment, *extreme_inputs(segment, directions)) * directions, axis=1)
        bound = segment.tube("shadow").goal.support(directions)
        np.testing.assert_allclose(reached, bound, rtol=1e-9, atol=1e-12)


def test_executions_agree_with_the_contact_equations() -> None:
    directions = unit_rows(np.random.default_rng(4), 4) * SCALE
    for index in range(0, SEGMENTS, 7):
        segment = random_segment(index)
        inputs = extreme_inputs(segment, directions)
        for end, *given in zip(executions(segment, *inputs), *inputs, strict=True):
            np.testing.assert_allclose(end, execution_by_equations(segment, *given), atol=1e-14)


def test_drift_is_counted_over_the_way_really_gone() -> None:
    """A start error along the move alone: the execution farthest from the wall drifts longest."""
    errors = ErrorSet.from_box([0.0, 0.0, 1e-3, 0.0, 0.0, 0.0])
    move, normal = np.array([0.0, 0.0, -2e-3, 0.0, 0.0, 0.0]), np.eye(6)[2]
    tube = linear_segment(errors, move, NO_ROWS, NO_COLUMNS, normal, np.array([5e-4]), (0.1, 0.0), RHO)
    given = np.array([0.0, 0.0, 1e-3, 0.0, 0.0, 0.0]), np.array([0.06, 0.0, 0.08, 0.0, 0.0, 0.0]), np.array([-5e-4])
    segment = Segment(np.eye(6), False, errors, move, NO_ROWS, NO_COLUMNS, normal, np.zeros(1), (0.1, 0.0))
    end = executions(segment, *(part[None] for part in given))[0]
    sideways = float(tube.goal.support(np.eye(6)[0]))
    assert end[0] == pytest.approx(0.06 * 3.5e-3 / 0.92)
    assert end[0] > 0.1 * 2e-3
    assert end[0] < sideways
    assert sideways == pytest.approx(0.1 * 3.5e-3 / 0.9)


def test_travel_without_a_stop_is_the_commanded_one() -> None:
    errors, move = ErrorSet.from_box(np.full(6, 1e-3)), np.array([3e-3, 0.0, 0.0, 0.0, 0.0, 0.2])
    given = NO_ROWS, NO_COLUMNS, np.zeros(0), (0.1, 0.1), RHO
    assert farthest_travel(errors, move, *given) == pytest.approx(5e-3)
    grown = step(errors, move, *given)
    np.testing.assert_allclose(
        grown.shape, ellipsoid.outer_sum(errors.shape, 25e-6 * drift_shape((0.1, 0.1), RHO), SCALE), rtol=1e-12
    )
    still = step(errors, np.zeros(6), np.eye(6)[:1], np.eye(6)[:, :1], np.zeros(1), (0.1, 0.1), RHO)
    assert float(still.support(np.eye(6)[0])) == 0.0
    assert float(still.support(np.eye(6)[1])) == pytest.approx(1e-3)


def test_a_new_contact_removes_its_normal_direction() -> None:
    for index in range(0, SEGMENTS, 11):
        segment = random_segment(index)
        goal = replace(segment, thickness=np.zeros(len(segment.held) + 1)).tube("shadow").goal
        rows = np.vstack([segment.held, segment.normal])
        np.testing.assert_allclose(goal.support(rows), 0.0, atol=1e-10)
        thick = replace(segment, thickness=np.full(len(rows), 3e-5)).tube("shadow").goal
        assert (thick.support(rows) >= 3e-5 * (1.0 - 1e-9)).all()


def test_a_grazing_approach_is_refused() -> None:
    move, normal = np.array([2e-3, 0.0, -1e-4, 0.0, 0.0, 0.0]), np.eye(6)[2]
    with pytest.raises(InfeasibleError, match=r"miss the new contact.*approach the contact more steeply") as caught:
        linear_segment(ErrorSet.zero(), move, NO_ROWS, NO_COLUMNS, normal, np.zeros(1), (0.1, 0.1), RHO)
    length = travel_length(move, RHO)
    assert caught.value.shortfall == pytest.approx(length * (0.1 * length / 1e-4 - 1.0))


def test_margins_are_taken_at_the_worse_end() -> None:
    tube = Tube(ErrorSet.from_box([1e-3, 0, 0, 0, 0, 0.01]), ErrorSet.from_box([2e-3, 0, 0, 0, 0, 0.02]))
    rows = np.eye(6)[[0, 0]]
    np.testing.assert_allclose(tube.margins(rows, [2e-3, 9e-3], [9e-3, 3e-3]), [1e-3, 1e-3])
    assert tube.angle_bound() == pytest.approx(0.02)


def test_section_is_the_ellipse_through_the_published_points() -> None:
    turn = np.array([[1.0, -1.0], [1.0, 1.0]]) / np.sqrt(2.0)
    Q = turn @ np.diag([1.0, 0.01]) @ turn.T
    radius = float(np.sqrt(dakin.section(Q, np.array([1.0, 0.0]))[1, 1]))
    assert radius == pytest.approx(1.0 / np.sqrt(50.5), rel=1e-12)
    assert round(radius, 2) == 0.14
    rng = np.random.default_rng(8)
    factor = rng.normal(size=(3, 3))
    Q3, V = factor @ factor.T, rng.normal(size=3)
    U = ellipsoid.complement(V).T
    lateral = [U[0], U[1], (U[0] + U[1]) / 2.0]
    surface = np.array([u / np.sqrt(u @ np.linalg.solve(Q3, u)) for u in lateral]) @ U.T
    a, b, c = np.linalg.solve(
        np.column_stack([surface[:, 0] ** 2, 2.0 * surface[:, 0] * surface[:, 1], surface[:, 1] ** 2]), np.ones(3)
    )
    np.testing.assert_allclose(U @ dakin.section(Q3, V) @ U.T, np.linalg.inv([[a, b], [b, c]]), rtol=1e-9)


def test_published_growth_stretches_the_radii() -> None:
    move, rows = np.array([0.0, 0.0, -2e-3, 0.0, 0.0, 0.0]), np.eye(6)[2:3]
    errors = ErrorSet.from_ellipsoid(np.diag([1e-6, 4e-6, 1e-6, 0.0, 0.0, 0.0]))
    goal = dakin.step(errors, move, rows, move[:, None], np.zeros(1), (0.1, 0.2), RHO)
    expected = [1e-3 + 2e-4, 2e-3 + 2e-4, 0.0, *[4e-4 / RHO] * 3]
    np.testing.assert_allclose(goal.support(np.eye(6)), expected, atol=1e-12)


def test_error_set_is_carried_in_two_ways() -> None:
    rng = np.random.default_rng(1)
    a = np.array([1e-3, 2e-3, 1e-3, 0.01, 0.02, 0.01])
    box = ErrorSet.from_box(a)
    np.testing.assert_allclose(box.support(np.eye(6)), a, rtol=1e-14)
    np.testing.assert_allclose(ellipsoid.support(box.shape, np.eye(6)), np.sqrt(6.0) * a, rtol=1e-14)
    A = rng.normal(size=(6, 6))
    corners = np.array(list(product((-1.0, 1.0), repeat=6))) * a
    N = rng.normal(size=(40, 6))
    np.testing.assert_allclose(box.image(A).support(N), (corners @ A.T @ N.T).max(axis=0), rtol=1e-12)
    Q = np.diag([1e-6, 0.0, 0.0, 0.0, 1e-4, 0.0])
    grown = box.plus(Q, RHO)
    assert (grown.support(N) >= box.support(N) + ellipsoid.support(Q, N) - 1e-15).all()
    assert (grown.support(N) <= ellipsoid.support(grown.shape, N)).all()
    G = rng.normal(size=(3, 6)) * a
    both = grown.plus_zonotope(np.vstack([G, np.zeros(6)]), RHO)
    assert both.generators.shape == (9, 6)
    np.testing.assert_allclose(both.support(N), grown.support(N) + np.abs(N @ G.T).sum(axis=1), rtol=1e-12)


def test_length_bounds_hold_every_corner() -> None:
    a = np.array([1e-3, 2e-3, 2e-3, 0.01, 0.02, 0.02])
    box = ErrorSet.from_box(a)
    assert box.translation_bound() == pytest.approx(3e-3)
    assert box.angle_bound() == pytest.approx(0.03)
    rng = np.random.default_rng(6)
    for k in (1, 6, 13):
        generators = rng.normal(size=(k, 6))
        zonotope = ErrorSet.from_zonotope(generators, 1.0)
        corners = np.array(list(product((-1.0, 1.0), repeat=k))) @ generators
        longest = np.linalg.norm(corners[:, 3:], axis=1).max()
        assert zonotope.angle_bound() >= longest * (1.0 - 1e-12)
        if k <= 10:
            assert zonotope.angle_bound() == pytest.approx(longest)
    ball = ErrorSet.from_ellipsoid(np.diag([4e-6, 1e-6, 1e-6, 1e-4, 9e-4, 1e-4]))
    assert ball.angle_bound() == pytest.approx(0.03)
    assert ErrorSet.zero().angle_bound() == 0.0
    assert float(ErrorSet.zero().support(np.ones(6))) == 0.0


def test_error_sets_stay_read_only_and_refuse_bad_arrays() -> None:
    box = pickle.loads(pickle.dumps(ErrorSet.from_box(np.ones(6))))
    for array in (box.shape, box.generators, box.growth):
        assert not array.flags.writeable
    with pytest.raises(ValueError, match="shape has shape"):
        ErrorSet.from_ellipsoid(np.eye(3))
    with pytest.raises(ValueError, match="not finite"):
        ErrorSet.from_box(np.full(6, np.nan))
