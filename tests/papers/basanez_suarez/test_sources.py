"""Sources of uncertainty: their sums by the paper, and by sampling every source along the chain."""

from __future__ import annotations

import math
import pickle

import numpy as np
import pytest

from fmopt.errors import GeometryError
from fmopt.papers.basanez_suarez.sources import (
    Budget,
    Configuration,
    GraspedSources,
    KnownConfiguration,
    Measurement,
    ObservedConfiguration,
    ObservedPoints,
    Robot,
    Shape,
    Slide,
    StaticSources,
    deviations,
    edge_turn,
    grasped_budget,
    gripper_budget,
    placed,
    placed_in_turn,
    static_budget,
)
from fmopt.task.sources import Deviation, Sources, start_box
from tests.shared.planar_sampling import disc

SHAPE, FEEDER, ROBOT, SLIDE = Shape(2e-5), KnownConfiguration(1e-4), Robot(3e-4, 0.004), Slide(5e-5, 0.001)
GRASPED = GraspedSources(SHAPE, FEEDER, ROBOT, SLIDE)


def turned(points: np.ndarray, angle: np.ndarray) -> np.ndarray:
    c, s = np.cos(angle)[..., None], np.sin(angle)[..., None]
    x, y = points[..., 0:1], points[..., 1:2]
    return np.concatenate([c * x - s * y, s * x + c * y], axis=-1)


def drawn(rng: np.random.Generator, epsilon: float, count: int) -> np.ndarray:
    """Vectors (count, 2) of at most this length, half of them of just this length."""
    size = np.where(rng.uniform(size=count) < 0.5, 1.0, np.sqrt(rng.uniform(size=count)))
    return epsilon * disc(rng.uniform(size=count), size)


def drawn_angle(rng: np.random.Generator, epsilon: float, count: int) -> np.ndarray:
    return epsilon * np.clip(rng.uniform(-1.5, 1.5, count), -1.0, 1.0)


def test_sums_of_the_paper() -> None:
    # ε_pg = ε_pr + ε_pp + ε_td, ε_φg = ε_φr + ε_φd; ε_prpgv = ε_pr + ε_pg + ε_v, ε_φrφg = ε_φr + ε_φg.
    assert gripper_budget(GRASPED).position == pytest.approx(3e-4 + 1e-4 + 5e-5, rel=1e-15)
    assert gripper_budget(GRASPED).angle == pytest.approx(0.004 + 0.001, rel=1e-15)
    assert grasped_budget(GRASPED).position == pytest.approx(3e-4 + 4.5e-4 + 2e-5, rel=1e-15)
    assert grasped_budget(GRASPED).angle == pytest.approx(0.004 + 0.005, rel=1e-15)
    # ε_a = ε_v + ε_pp, or ε_m.
    assert static_budget(StaticSources(SHAPE, FEEDER), (0.1, 0.2)).position == pytest.approx(1.2e-4, rel=1e-15)
    assert static_budget(StaticSources(SHAPE, Measurement(7e-5)), (0.1, 0.2)).position == 7e-5


def test_the_start_box_has_the_same_sums() -> None:
    stated = Sources(2e-5, None, Deviation(1e-4), Deviation(1e-4), Deviation(3e-4, 0.004), Deviation(5e-5, 0.001), 0.0)
    box = start_box(stated, 0.0)
    total = deviations(StaticSources(SHAPE, FEEDER), [(0.0, 0.0)], GRASPED)
    assert box[0] == pytest.approx(total.static[0] + total.position, rel=1e-14)
    assert box[3] == pytest.approx(total.angle, rel=1e-14)


def test_budgets_name_every_source_and_add_up() -> None:
    for budget in (grasped_budget(GRASPED), static_budget(StaticSources(SHAPE, FEEDER), (0.0, 0.0))):
        assert math.fsum(position for _, position, _ in budget.fractions()) == pytest.approx(1.0, rel=1e-14)
    assert [symbol for symbol, _, _ in grasped_budget(GRASPED).fractions()] == [
        "ε_pr, ε_φr",
        "ε_pr, ε_φr",
        "ε_pp",
        "ε_td, ε_φd",
        "ε_v",
    ]
    by_symbol = {share.source: share for share in grasped_budget(GRASPED).shares}
    assert by_symbol["robot, grasping"] == by_symbol["robot, moving"].__class__(
        "robot, grasping", "ε_pr, ε_φr", ROBOT.epsilon_pr, ROBOT.epsilon_phi_r
    )
    assert Budget(()).fractions() == ()
    assert grasped_budget(GraspedSources()).fractions()[0] == ("ε_pr, ε_φr", 0.0, 0.0)


def test_a_point_of_the_grasped_object_along_the_chain() -> None:
    rng, n = np.random.default_rng(1), 200_000
    total, point, phi = grasped_budget(GRASPED), np.array([0.03, -0.01]), 2.5
    in_gripper = drawn(rng, ROBOT.epsilon_pr, n) + drawn(rng, FEEDER.epsilon_pp, n) + drawn(rng, SLIDE.epsilon_td, n)
    turn_g = drawn_angle(rng, ROBOT.epsilon_phi_r, n) + drawn_angle(rng, SLIDE.epsilon_phi_d, n)
    turn_r = drawn_angle(rng, ROBOT.epsilon_phi_r, n)
    held = turned(np.broadcast_to(point, (n, 2)), turn_g) + in_gripper + drawn(rng, SHAPE.epsilon_v, n)
    world = drawn(rng, ROBOT.epsilon_pr, n) + turned(held, phi + turn_r)
    turns = turn_g + turn_r
    apart = np.hypot(*(world - turned(np.broadcast_to(point, (n, 2)), phi + turns)).T)
    assert np.abs(turns).max() <= total.angle + 1e-15
    assert np.abs(turns).max() == pytest.approx(total.angle, rel=1e-9)
    assert apart.max() <= total.position * (1.0 + 1e-9)
    assert apart.max() >= 0.95 * total.position


@pytest.mark.parametrize("point", [(0.0, 0.0), (0.05, 0.02), (-0.3, 0.1)])
def test_an_observed_object_moves_its_points_by_no_more(point: tuple[float, float]) -> None:
    rng, n = np.random.default_rng(2), 100_000
    configuration = ObservedConfiguration(1e-4, 0.3, (0.02, 0.01))
    lever = np.asarray(point) - configuration.about
    angle = drawn_angle(rng, configuration.epsilon_phi_p, n)
    moved = turned(np.broadcast_to(lever, (n, 2)), angle) - lever + drawn(rng, configuration.epsilon_pp, n)
    bound = static_budget(StaticSources(Shape(), configuration), point).position
    assert np.hypot(*moved.T).max() <= bound * (1.0 + 1e-12)
    assert np.hypot(*moved.T).max() >= 0.999 * bound


@pytest.mark.parametrize("point", [(0.01, 0.0), (0.05, 0.08), (0.3, 0.0), (-0.1, 0.2)])
def test_a_configuration_from_two_observed_points(point: tuple[float, float]) -> None:
    rng, n = np.random.default_rng(3), 400_000
    configuration = ObservedPoints((0.0, 0.0), (0.1, 0.0), 1e-3)
    # Rigid motions: turn about the middle between the points, and shift; kept when both points move by ε_m at most.
    middle = np.array([0.05, 0.0])
    most = edge_turn(configuration.epsilon_m, configuration.length)
    angle, shift = rng.uniform(-most, most, n), 1e-3 * disc(rng.uniform(size=n), np.sqrt(rng.uniform(size=n)))

    def moved(x: np.ndarray) -> np.ndarray:
        return np.hypot(*(turned(np.broadcast_to(x - middle, (n, 2)), angle) + middle + shift - x).T)

    kept = (moved(configuration.first) <= 1e-3) & (moved(configuration.second) <= 1e-3)
    assert kept.sum() > 50_000
    budget = static_budget(StaticSources(Shape(), configuration), point)
    far = moved(np.asarray(point))[kept].max()
    assert far <= budget.position * (1.0 + 1e-12)
    assert far >= 0.9 * budget.position
    assert np.abs(angle[kept]).max() <= most


def test_an_object_handled_several_times() -> None:
    rng, n = np.random.default_rng(4), 200_000
    grasps = [np.array([0.0, 0.0]), np.array([0.04, 0.01]), np.array([-0.02, 0.03])]
    handlings = [GraspedSources(SHAPE, FEEDER, ROBOT, SLIDE, grasp) for grasp in grasps]
    final = placed_in_turn(FEEDER, handlings)
    assert isinstance(final, ObservedConfiguration)
    # The object as a rigid motion x ↦ R x + t, after each handling seen from the grasping point.
    angle, at = np.zeros(n), drawn(rng, FEEDER.epsilon_pp, n)
    for grasp in grasps:
        place = turned(np.broadcast_to(grasp, (n, 2)), angle) + at - grasp
        place = place + drawn(rng, 2.0 * ROBOT.epsilon_pr + SLIDE.epsilon_td, n)
        angle = angle + drawn_angle(rng, 2.0 * ROBOT.epsilon_phi_r + SLIDE.epsilon_phi_d, n)
        at = place + grasp - turned(np.broadcast_to(grasp, (n, 2)), angle)
    off = np.hypot(*(turned(np.broadcast_to(grasps[-1], (n, 2)), angle) + at - grasps[-1]).T)
    assert np.abs(angle).max() <= final.epsilon_phi_p * (1.0 + 1e-12)
    assert np.abs(angle).max() >= 0.999 * final.epsilon_phi_p
    assert off.max() <= final.epsilon_pp * (1.0 + 1e-12)
    assert off.max() >= 0.7 * final.epsilon_pp
    # One handling more costs more; at the same point orientation does not turn into position.
    once = placed(handlings[0])
    assert once.epsilon_pp == pytest.approx(2.0 * ROBOT.epsilon_pr + SLIDE.epsilon_td + FEEDER.epsilon_pp)
    twice = placed_in_turn(FEEDER, [handlings[0]] * 2)
    assert isinstance(twice, ObservedConfiguration)
    assert twice.epsilon_pp == pytest.approx(2.0 * once.epsilon_pp - FEEDER.epsilon_pp)
    assert twice.epsilon_phi_p == pytest.approx(2.0 * once.epsilon_phi_p)
    assert final.epsilon_pp > twice.epsilon_pp


def test_deviations_of_the_vertices_bound_those_of_the_edges() -> None:
    static = StaticSources(SHAPE, ObservedConfiguration(1e-4, 0.01, (0.5, 0.5)))
    corners = np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0)])
    total = deviations(static, corners, GRASPED)
    assert total.shape == SHAPE.epsilon_v
    for k in np.linspace(0.0, 1.0, 11):
        point = (1.0 - k) * corners[0] + k * corners[1]
        assert static_budget(static, point).position <= max(total.static[:2]) + 1e-18


def test_values_stay_read_only_through_pickling() -> None:
    for value in (ObservedConfiguration(1e-4, 0.1, (1.0, 2.0)), ObservedPoints((0.0, 0.0), (1.0, 0.0), 1e-3)):
        again = pickle.loads(pickle.dumps(value))
        array = again.about if isinstance(again, ObservedConfiguration) else again.first
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: Shape(-1e-5), "epsilon_v is -1e-05"),
        (lambda: Measurement(math.nan), "epsilon_m is nan"),
        (lambda: KnownConfiguration(math.inf), "epsilon_pp is inf"),
        (lambda: ObservedConfiguration(0.0, -0.1), "epsilon_phi_p is -0.1"),
        (lambda: Robot(0.0, -1.0), "epsilon_phi_r is -1"),
        (lambda: Slide(-1.0, 0.0), "epsilon_td is -1"),
    ],
)
def test_negative_and_missing_numbers_are_refused(build: type[Configuration], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        build()


def test_two_observed_points_must_differ() -> None:
    with pytest.raises(GeometryError, match="observe two different points"):
        ObservedPoints((1.0, 1.0), (1.0, 1.0), 1e-4)
