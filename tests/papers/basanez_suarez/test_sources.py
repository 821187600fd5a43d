"""Sources of uncertainty: their sums by the paper, and by sampling every source along the chain."""

import math
import pickle
from collections.abc import Callable

import numpy as np
import pytest

from fmopt.errors import GeometryError
from fmopt.papers.basanez_suarez.sources import Configuration, Deviation, Grasped, ObservedPoints, deviations, edge_turn
from fmopt.task.sources import budget, total
from fmopt.task.toml import problem_file as files
from tests.shared.planar_sampling import disc

SHAPE, FEEDER, ROBOT, SLIDE = 2e-5, Deviation(1e-4), Deviation(3e-4, 0.004), Deviation(5e-5, 0.001)
GRASPED = Grasped(SHAPE, FEEDER, ROBOT, SLIDE)


def epsilon_a(configuration: Configuration, point: tuple[float, float], shape: float = 0.0) -> float:
    return float(deviations(shape, configuration, [point], GRASPED).static[0])


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
    assert GRASPED.in_gripper.position == pytest.approx(3e-4 + 1e-4 + 5e-5, rel=1e-15)
    assert GRASPED.in_gripper.angle == pytest.approx(0.004 + 0.001, rel=1e-15)
    assert GRASPED.moved.position == pytest.approx(3e-4 + 4.5e-4 + 2e-5, rel=1e-15)
    assert GRASPED.moved.angle == pytest.approx(0.004 + 0.005, rel=1e-15)
    # ε_a = ε_v + ε_pp, or ε_m.
    assert epsilon_a(FEEDER, (0.1, 0.2), SHAPE) == pytest.approx(1.2e-4, rel=1e-15)
    assert epsilon_a(Deviation(), (0.1, 0.2), 7e-5) == 7e-5


def test_the_start_box_has_the_same_sums() -> None:
    feeder, robot = files.Configuration(position=1e-4), files.DeviationTable(position=3e-4, angle=0.004)
    grasp = files.Grasp(position=5e-5, angle=0.001, height=0.0)
    sources = files.Sources(shape=2e-5, configuration=feeder, feeder=feeder, robot=robot, grasp=grasp)
    box = total(budget(sources, (0.0, 0.0), 0.0))
    off = deviations(SHAPE, FEEDER, [(0.0, 0.0)], GRASPED)
    assert box[0] == pytest.approx(off.static[0] + off.position, rel=1e-14)
    assert box[3] == pytest.approx(off.angle, rel=1e-14)


def test_a_point_of_the_grasped_object_along_the_chain() -> None:
    rng, n = np.random.default_rng(1), 200_000
    total, point, phi = GRASPED.moved, np.array([0.03, -0.01]), 2.5
    in_gripper = drawn(rng, ROBOT.position, n) + drawn(rng, FEEDER.position, n) + drawn(rng, SLIDE.position, n)
    turn_g = drawn_angle(rng, ROBOT.angle, n) + drawn_angle(rng, SLIDE.angle, n)
    turn_r = drawn_angle(rng, ROBOT.angle, n)
    held = turned(np.broadcast_to(point, (n, 2)), turn_g) + in_gripper + drawn(rng, SHAPE, n)
    world = drawn(rng, ROBOT.position, n) + turned(held, phi + turn_r)
    turns = turn_g + turn_r
    apart = np.hypot(*(world - turned(np.broadcast_to(point, (n, 2)), phi + turns)).T)
    assert np.abs(turns).max() <= total.angle + 1e-15
    assert np.abs(turns).max() == pytest.approx(total.angle, rel=1e-9)
    assert 0.95 * total.position <= apart.max() <= total.position * (1.0 + 1e-9)


@pytest.mark.parametrize("point", [(0.0, 0.0), (0.05, 0.02), (-0.3, 0.1)])
def test_an_observed_object_moves_its_points_by_no_more(point: tuple[float, float]) -> None:
    rng, n = np.random.default_rng(2), 100_000
    configuration = Deviation(1e-4, 0.3, (0.02, 0.01))
    lever = np.asarray(point) - configuration.about
    angle = drawn_angle(rng, configuration.angle, n)
    moved = turned(np.broadcast_to(lever, (n, 2)), angle) - lever + drawn(rng, configuration.position, n)
    bound = epsilon_a(configuration, point)
    assert 0.999 * bound <= np.hypot(*moved.T).max() <= bound * (1.0 + 1e-12)


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
    bound = epsilon_a(configuration, point)
    far = moved(np.asarray(point))[kept].max()
    assert 0.9 * bound <= far <= bound * (1.0 + 1e-12)
    assert np.abs(angle[kept]).max() <= most


def test_an_object_handled_several_times() -> None:
    rng, n = np.random.default_rng(4), 200_000
    grasps = [np.array([0.0, 0.0]), np.array([0.04, 0.01]), np.array([-0.02, 0.03])]
    final = FEEDER
    for grasp in grasps:
        final = Grasped(SHAPE, final, ROBOT, SLIDE, grasp).placed
    # The object as a rigid motion x ↦ R x + t, after each handling seen from the grasping point.
    angle, at = np.zeros(n), drawn(rng, FEEDER.position, n)
    for grasp in grasps:
        place = turned(np.broadcast_to(grasp, (n, 2)), angle) + at - grasp
        place = place + drawn(rng, 2.0 * ROBOT.position + SLIDE.position, n)
        angle = angle + drawn_angle(rng, 2.0 * ROBOT.angle + SLIDE.angle, n)
        at = place + grasp - turned(np.broadcast_to(grasp, (n, 2)), angle)
    off = np.hypot(*(turned(np.broadcast_to(grasps[-1], (n, 2)), angle) + at - grasps[-1]).T)
    assert 0.999 * final.angle <= np.abs(angle).max() <= final.angle * (1.0 + 1e-12)
    assert 0.7 * final.position <= off.max() <= final.position * (1.0 + 1e-12)
    # One handling more costs more; at the same point orientation does not turn into position.
    once = GRASPED.placed
    assert once.position == pytest.approx(2.0 * ROBOT.position + SLIDE.position + FEEDER.position)
    twice = Grasped(SHAPE, once, ROBOT, SLIDE).placed
    assert twice.position == pytest.approx(2.0 * once.position - FEEDER.position)
    assert twice.angle == pytest.approx(2.0 * once.angle)
    assert final.position > twice.position


def test_deviations_of_the_vertices_bound_those_of_the_edges() -> None:
    static = Deviation(1e-4, 0.01, (0.5, 0.5))
    corners = np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0)])
    total = deviations(SHAPE, static, corners, GRASPED)
    assert total.shape == SHAPE
    for k in np.linspace(0.0, 1.0, 11):
        point = (1.0 - k) * corners[0] + k * corners[1]
        assert epsilon_a(static, point, SHAPE) <= max(total.static[:2]) + 1e-18


def test_values_stay_read_only_through_pickling() -> None:
    for value in (Deviation(1e-4, 0.1, (1.0, 2.0)), ObservedPoints((0.0, 0.0), (1.0, 0.0), 1e-3)):
        again = pickle.loads(pickle.dumps(value))
        array = again.about if isinstance(again, Deviation) else again.first
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: Grasped(-1e-5), "shape is -1e-05"),
        (lambda: ObservedPoints((0.0, 0.0), (1.0, 0.0), math.nan), "epsilon_m is nan"),
        (lambda: Deviation(math.inf), "position is inf"),
        (lambda: Deviation(0.0, -0.1), "angle is -0.1"),
    ],
)
def test_negative_and_missing_numbers_are_refused(build: Callable[[], object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        build()


def test_two_observed_points_must_differ() -> None:
    with pytest.raises(GeometryError, match="observe two different points"):
        ObservedPoints((1.0, 1.0), (1.0, 1.0), 1e-4)
