"""What trials keep clear of: distances against boxes and an independent library, and trials that touch."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from manifold3d import Manifold

from fmopt.execution.engines.engine import Bodies
from fmopt.execution.kept_clear import KeptClear
from fmopt.execution.press_rig import PressRig
from fmopt.execution.press_trials import carry_out
from fmopt.execution.rotation import from_quaternions
from fmopt.plan.evidence import TOUCH
from fmopt.plan.press import ConvexSolid, Surroundings
from fmopt.spatial.se3 import Pose
from fmopt.spatial.values import Array
from tests.shared.plans.press_plan import drawn, press_choosing, press_plan

STILL = np.array([1.0, 0.0, 0.0, 0.0])


def box(low: tuple[float, float, float], high: tuple[float, float, float]) -> Array:
    """Corners of a cuboid, mm in, m out."""
    return 1e-3 * np.array([*product(*zip(low, high, strict=True))])


def solid(name: str, *pieces: Array) -> ConvexSolid:
    return ConvexSolid(name, tuple(tuple((x, y, z) for x, y, z in piece.tolist()) for piece in pieces))


PEG, BLOCK = box((-5, -5, 0), (5, 5, 30)), box((-30, -30, -20), (30, 30, 0))
GRIPPER = solid("gripper", box((-10, -10, 30), (10, 10, 50)), box((-3, -3, 50), (3, 3, 90)))
WALL = solid("wall", box((20, -30, 0), (30, 30, 40)))
CELL = Surroundings((GRIPPER,), (WALL,))


def at(x: float, y: float, z: float) -> Array:
    return np.append(1e-3 * np.array([x, y, z]), STILL)


@pytest.mark.parametrize(
    ("pose", "distance", "words"),
    [
        (at(0, 0, 5), 10.0, "gripper and wall"),
        (at(0, 0, 39), 15.0, "moving part and wall"),
        (at(-15, 0, -25), 5.0, "gripper and the fixed part"),
        (at(8, 0, 0), 2.0, "gripper and wall"),
        (at(0, 0, 1500), 1000.0, ""),
    ],
)
def test_the_least_distance_is_that_of_boxes(pose: Array, distance: float, words: str) -> None:
    clear = KeptClear(Bodies((PEG,), (BLOCK,)), CELL, pose[None])
    least, nearest = clear.measured(pose)
    assert 1e3 * least == pytest.approx(distance, abs=1e-4)
    assert words in nearest
    assert (clear.least[0], clear.nearest[0]) == (least, nearest)


def test_bounds_along_ways_are_no_more_than_an_independent_library_measures_and_hardly_less() -> None:
    """Poses with a step between them like that of a period; the part and what it has stays off the block."""
    random, bodies = np.random.default_rng(3), Bodies((PEG,), (BLOCK,))
    count = 6
    poses = np.array([at(0, 0, 60)] * count)
    clear = KeptClear(bodies, CELL, poses)
    held = [Manifold.hull_points(np.array(piece)) for piece in GRIPPER.pieces]
    own, wall, block = (Manifold.hull_points(np.array(one)) for one in (PEG, WALL.pieces[0], BLOCK))
    least, speeds = np.full(count, 1.0), random.uniform(-1.0, 1.0, (count, 7)) * 0.002
    speeds[:, :4] = np.column_stack(
        [np.linspace(-4e-4, 4e-4, count), np.zeros(count), np.full(count, -6e-4), np.zeros(count)]
    )
    for _ in range(90):
        poses += speeds
        poses[:, 3:] /= np.linalg.norm(poses[:, 3:], axis=1)[:, None]
        clear.see(poses, np.arange(count))
        for k, pose in enumerate(poses):
            T = np.column_stack([from_quaternions(pose[3:]), pose[:3]])
            near = [one.transform(T).min_gap(other, 1.0) for one in held for other in (wall, block)]
            least[k] = min(least[k], own.transform(T).min_gap(wall, 1.0), *near)
    touched = least <= TOUCH
    assert touched.any()
    assert not touched.all()
    assert (clear.least <= np.maximum(least, TOUCH) + 1e-7).all()
    assert (clear.least[~touched] >= 0.94 * least[~touched] - 1e-5).all()
    assert set(np.flatnonzero(touched)) <= set(np.flatnonzero(clear.least <= TOUCH))


@pytest.mark.parametrize(("beside", "touches"), [(40.0, False), (9.5, True)])
def test_a_trial_that_comes_near_a_wall_fails_and_is_else_the_same(beside: float, touches: bool) -> None:
    presses, bodies, (errors, free) = press_plan(), press_choosing().bodies, drawn(2)
    wall = solid("wall", box((beside, -60, 1), (beside + 5, 60, 60)))
    seen: list[Array] = []

    def look(rig: PressRig) -> None:
        seen.append(rig.engine.qpos[0].copy())

    near = carry_out(bodies, replace(presses, cell=Surroundings((), (wall,))), errors, 1, range(2), look=look)
    assert all(one.seated and one.distance is None for one in free)
    for one, other in zip(near, free, strict=True):
        assert (one.seconds, one.offset, one.seated) == (other.seconds, other.offset, not touches)
        assert one.reasons == (("the moving part and wall touch",) if touches else ())
    corners = np.vstack(bodies.moving)
    gaps = [1e-3 * beside - Pose(q[:3], from_quaternions(q[3:])).apply(corners)[:, 0].max() for q in seen]
    assert near[0].distance is not None
    if not touches:  # the wall is as wide and as high as the part's way
        assert 0.94 * min(gaps) - 1e-5 <= near[0].distance <= min(gaps) + 1e-7
