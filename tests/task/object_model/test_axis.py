"""Solids along the z axis, against membership of points on it."""

import numpy as np
import pytest

from fmopt.geometry.csg import Box, Cone, Cylinder, Difference, Moved, Solid, Union
from fmopt.spatial.se3 import Pose, exp
from fmopt.task.object_model.axis import length, on_axis
from tests.shared.solids import contains


def trees(random: np.random.Generator) -> Solid:
    def body() -> Solid:
        primitive = (Box((0.05, 0.04, 0.06)), Cylinder(0.03, 0.05, 9), Cone(0.03, 0.01, 0.07, 8))[random.integers(3)]
        return Moved(primitive, Pose(random.uniform(-0.03, 0.03, 3), exp(random.normal(size=3))))

    aside = Pose(np.array([0.01, 0.0, 0.0]), np.eye(3))
    return Difference(Union((body(), body(), body())), (body(), Moved(Union((body(), body())), aside)))


@pytest.mark.parametrize("seed", range(8))
def test_the_axis_agrees_with_membership(seed: int) -> None:
    random = np.random.default_rng(seed)
    solid = trees(random)
    heights = random.uniform(-0.1, 0.1, 400)
    points = np.column_stack([np.zeros((400, 2)), heights])
    stretches = on_axis(solid)
    found = [any(a < z < b for a, b in stretches) for z in heights]
    np.testing.assert_array_equal(found, contains(solid, points))
    fine = np.column_stack([np.zeros((20001, 2)), np.linspace(-0.1, 0.1, 20001)])
    assert length(stretches, -0.1, 0.1) == pytest.approx(0.2 * np.mean(contains(solid, fine)), abs=1e-4)
    assert length(stretches, 0.0, 0.02) <= 0.02
