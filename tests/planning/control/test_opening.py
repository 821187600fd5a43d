"""Nearest twists that open contacts against friction: what Moreau's theorem says of them, and refusals."""

import numpy as np
import pytest

from fmopt.planning.control.friction_cones import nearest_opening
from fmopt.spatial.values import Array


def contacts(rng: np.random.Generator, count: int, friction: float = 0.3) -> tuple[Array, Array]:
    """Rows (m, 6) and (m, 2, 6) of contacts whose normals are not far apart."""
    normals = rng.normal(size=(count, 3)) + np.array([1.5, 1.5, 0.5])
    frames = np.array([np.linalg.svd(n[None])[2] for n in normals])
    frames[:, 0] *= np.sign(np.vecdot(frames[:, 0], normals))[:, None]
    arms = rng.normal(size=(count, 3))
    rows = np.concatenate([frames, np.cross(arms[:, None], frames)], axis=2)
    return np.ascontiguousarray(rows[:, 0]), np.ascontiguousarray(friction * rows[:, 1:])


@pytest.mark.parametrize("count", [1, 3, 6])
def test_what_is_settled_opens_and_lies_where_friction_leaves_it(count: int) -> None:
    """By Moreau's theorem: v opens all contacts, and v − w is a sum of rays across v."""
    rng = np.random.default_rng(20 + count)
    for _ in range(20):
        (normal, tangent), wrench = contacts(rng, count), rng.normal(size=6)
        twist, settled = nearest_opening(wrench, normal, tangent, 0.0)
        assert settled
        assert (normal @ twist - np.linalg.norm(tangent @ twist, axis=1)).min() >= -1e-9 * np.linalg.norm(wrench)
        assert abs(float(twist @ (twist - wrench))) <= 1e-9 * float(wrench @ wrench)


def test_contacts_that_face_each_other_open_by_no_twist() -> None:
    normal, tangent = contacts(np.random.default_rng(1), 1)
    both = np.vstack([normal, -normal]), np.concatenate([tangent, tangent])
    assert not nearest_opening(np.zeros(6), *both, 1.0)[1]
    assert nearest_opening(np.ones(6), *both, 0.0)[1]
