"""Errors fixed in the hole, in the hand and in the world: the linear picture and what it leaves, against real poses."""

import numpy as np
import pytest

from fmopt.certificate.error_set import ErrorSet, Linkage
from fmopt.certificate.tube import coupled
from fmopt.spatial.se3 import exp, log
from fmopt.spatial.values import IN_THE_WORLD, Array, Framing

BOX = np.array([3e-4, 2e-4, 1e-4, 6e-3, 4e-3, 8e-3])
FRAMING = Framing(np.array([0.3, 0.3, 0.5, 0.2, 0.2, 0.2]), np.array([0.4, 0.2, 0.0, 0.5, 0.5, 0.5]))


def on_its_bounds(rng: np.random.Generator, half: Array) -> Array:
    return rng.choice([-1.0, 1.0], len(half)) * half


def real_error(start: Array, p: Array, R: Array, hole: Array, hand: Array, world: Array) -> Array:
    """The error (6,) about a nominal pose: the hole askew about the start, the grasp off in the part's axes."""
    H, G = exp(hole[3:]), exp(hand[3:])
    placed = p + world[:3] + exp(world[3:]) @ R @ hand[:3]
    turned = H @ exp(world[3:]) @ R @ G
    return np.concatenate([start + hole[:3] + H @ (placed - start) - p, log(turned @ R.T)])


@pytest.mark.parametrize("seed", range(200))
def test_what_the_linear_picture_leaves_is_bounded(seed: int) -> None:
    rng = np.random.default_rng(seed)
    _, linkage = Linkage.of(BOX, FRAMING)
    hole, hand, world = (on_its_bounds(rng, part) for part in FRAMING.parts(BOX))
    start, R0 = rng.uniform(-0.02, 0.02, 3), exp(rng.uniform(-0.3, 0.3, 3))
    p, R = start + rng.uniform(-0.03, 0.03, 3), exp(rng.uniform(-0.4, 0.4, 3)) @ R0
    # The contacts take up much more than the world's own error: anything of this size.
    world = world + rng.uniform(-1.0, 1.0, 6) * np.array([1e-3] * 3 + [0.01] * 3)
    held = np.concatenate([R0.T @ hand[:3], R0.T @ hand[3:]])
    error = real_error(start, p, R, hole, held, world)
    linear = hole + world + np.concatenate([R @ held[:3], R @ held[3:]])
    linear[:3] += np.cross(hole[3:], p - start)
    left = coupled(linkage.begun(start).links(p, p), np.abs(error), 0.0)
    assert np.linalg.norm((error - linear)[:3]) <= left[0] * (1.0 + 1e-9) + 1e-15
    assert np.linalg.norm((error - linear)[3:]) <= left[1] * (1.0 + 1e-9) + 1e-15


def test_a_tenth_of_that_bound_would_not_do() -> None:
    rng, most = np.random.default_rng(1), 0.0
    for _ in range(300):
        hole, hand, world = (on_its_bounds(rng, part) for part in FRAMING.parts(BOX))
        p = rng.uniform(-0.03, 0.03, 3)
        error = real_error(np.zeros(3), p, np.eye(3), hole, hand, world)
        linear = hole + hand + world
        linear[:3] += np.cross(hole[3:], p)
        _, linkage = Linkage.of(BOX, FRAMING)
        left = coupled(linkage.begun(np.zeros(3)).links(p, p), np.abs(error), 0.0)
        most = max(most, float(np.linalg.norm((error - linear)[:3]) / left[0]))
    assert most > 0.1


def test_generators_move_as_their_frames_do() -> None:
    generators, linkage = Linkage.of(BOX, FRAMING)
    travel, turn = np.array([0.01, -0.02, 0.005]), exp([0.2, -0.1, 0.3])
    moved = linkage.moves(travel, turn, len(generators))
    for g, by, hole, hand in zip(generators, moved, linkage.hole, linkage.hand, strict=True):
        if hole.any():
            np.testing.assert_allclose(by, [*np.cross(g[3:], travel), 0.0, 0.0, 0.0], atol=1e-18)
        elif hand.any():
            np.testing.assert_allclose(g + by, [*(turn @ g[:3]), *(turn @ g[3:])], atol=1e-18)
        else:
            assert not by.any()


def test_errors_in_the_world_alone_are_the_plain_box() -> None:
    plain, framed = ErrorSet.from_box(BOX), ErrorSet.of(BOX, IN_THE_WORLD)
    assert framed.linkage is None
    np.testing.assert_array_equal(framed.generators, plain.generators)
    np.testing.assert_array_equal(framed.shape_root, plain.shape_root)


def test_shares_make_up_the_box() -> None:
    np.testing.assert_allclose(sum(FRAMING.parts(BOX)), BOX, rtol=1e-15)
    framed = ErrorSet.of(BOX, FRAMING)
    np.testing.assert_allclose(framed.half_widths(framed.generators), BOX, rtol=1e-12)
    with pytest.raises(ValueError, match="shares"):
        Framing(np.full(6, 0.7), np.full(6, 0.7))
