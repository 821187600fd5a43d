"""Rows of distances: gradients against differences, remainders against samples, supports against their definition."""

import numpy as np
import pytest

from fmopt.certificate.error_set import UNCOUPLED
from fmopt.certificate.remainder import Curvature, Extent
from fmopt.certificate.rows import Rows, balls_above, edges_apart, faces_above, points_above, stacked
from fmopt.certificate.tube import left
from fmopt.contact import definitions
from fmopt.spatial.se3 import Pose, exp, turns
from fmopt.spatial.values import Array
from tests.shared.random_rows import KINDS, box, forms, moved, pose, unit

SAMPLES = 120


def test_many_poses_at_once_and_kinds_mixed_are_what_each_is_alone() -> None:
    rng = np.random.default_rng(7)
    parts, poses = [forms(kind, rng) for kind in KINDS], [pose(rng) for _ in range(5)]
    rows = stacked(*parts).rows(np.array([X.p for X in poses]), np.array([X.R for X in poses]))
    f, N = rows.f, rows.N
    assert turns(np.array([[0.1, 0.2, 0.3], [0.0, 0.0, 0.0]])) == pytest.approx(
        np.array([exp([0.1, 0.2, 0.3]), np.eye(3)]), abs=1e-15
    )
    for k, X in enumerate(poses):
        alone = [part.at(X) for part in parts]
        assert f[k] == pytest.approx(np.concatenate([rows.f for rows in alone]), abs=1e-15)
        assert N[k] == pytest.approx(np.vstack([rows.N for rows in alone]), abs=1e-15)


@pytest.mark.parametrize("kind", KINDS)
def test_gradients_are_those_of_differences(kind: str) -> None:
    rng = np.random.default_rng(1)
    rows, X, h = forms(kind, rng), pose(rng), 1e-6
    N = rows.at(X).N
    for axis, step in enumerate(np.eye(6) * h):
        slope = (rows.at(X.moved(step)).f - rows.at(X.moved(-step)).f) / (2.0 * h)
        np.testing.assert_allclose(N[:, axis], slope, atol=1e-9)


def test_edge_rows_are_the_distance_to_the_plane_along_both_edges() -> None:
    rng = np.random.default_rng(2)
    e_m, e_f = unit(rng, 2)
    q, points, X = rng.normal(size=3), rng.normal(size=(4, 3)), pose(rng)
    expected = (X.apply(points) - q) @ np.cross(X.R @ e_m, e_f)
    np.testing.assert_allclose(edges_apart(e_m, e_f, q, points).at(X).f, expected, atol=1e-14)


def remainders(start: Rows, goal: Rows, extent: Extent) -> Array:
    """What the linear picture of rows (k) leaves over a piece of motion."""
    return left(Curvature.of(start, goal, extent.twist).bending, extent.half, UNCOUPLED)


def excesses(kind: str, turn: float, half: Array, seed: int) -> Array:
    """|f − linear prediction| over the remainder, for corners of a box of errors, on a piece; (samples, rows)."""
    rng = np.random.default_rng(seed)
    rows, start = forms(kind, rng), pose(rng)
    goal, twist = moved(rng, start, turn)
    at_start, at_goal = rows.over(start, goal)
    allowed = remainders(at_start, at_goal, Extent(twist, half))
    found = []
    for _ in range(SAMPLES):
        errors = rng.choice([-1.0, 1.0], (2, 6)) * half
        if rng.uniform() < 0.5:
            errors[1] = errors[0]
        s = rng.choice([0.0, 0.5, 1.0, rng.uniform()])
        real = start.moved(s * twist).moved((1.0 - s) * errors[0] + s * errors[1])
        linear = (1.0 - s) * (at_start.f + at_start.N @ errors[0]) + s * (at_goal.f + at_goal.N @ errors[1])
        found.append(np.abs(rows.at(real).f - linear) / allowed)
    return np.array(found)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(
    ("turn", "half"),
    [
        (0.02, box((0.01, 0.004, 0.006))),
        (0.1, box((0.02, 0.0, 0.001))),
        (0.0, box((0.03, 0.03, 0.03))),
        (0.05, box((0.0, 0.0, 0.0))),
        (0.03, box((0.06, 0.02, 0.01), (2e-4, 2.5e-3, 6e-4))),
        (0.5, box((0.3, 0.1, 0.2), (2e-3, 2e-3, 2e-3))),
    ],
)
def test_no_sample_leaves_the_remainder(kind: str, turn: float, half: Array) -> None:
    assert max(excesses(kind, turn, half, seed).max() for seed in range(4)) <= 1.0 + 1e-9


@pytest.mark.parametrize("kind", KINDS)
def test_half_the_remainder_would_not_do(kind: str) -> None:
    still, turning = (0.0, box((0.03, 0.0, 0.0))), (0.05, box((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)))
    for turn, half in (still, turning):
        assert max(excesses(kind, turn, half, seed).max() for seed in range(6)) > 0.5


def test_mixed_rows_have_the_remainders_that_each_has_alone() -> None:
    rng = np.random.default_rng(8)
    parts, start, half = [forms(kind, rng) for kind in KINDS], pose(rng), box((0.06, 0.02, 0.01))
    goal, twist = moved(rng, start, 0.04)
    extent = Extent(twist, half)
    alone = np.concatenate([remainders(*part.over(start, goal), extent) for part in parts])
    np.testing.assert_allclose(remainders(*stacked(*parts).over(start, goal), extent), alone, rtol=1e-12)


def test_a_row_does_not_feel_turns_about_its_own_normal() -> None:
    wall = points_above(np.array([[0.01, -0.01, 0.002]]), np.array([1.0, 0.0, 0.0]), 0.0)
    X = pose(np.random.default_rng(9))
    about, across = (Extent(np.zeros(6), box(angles)) for angles in ((0.06, 0.0, 0.0), (0.0, 0.06, 0.0)))
    assert remainders(wall.at(X), wall.at(X), about) == 0.0
    assert remainders(wall.at(X), wall.at(X), across) > 1e-6


def test_where_two_edges_touch_the_second_derivatives_cancel() -> None:
    """A corner edge on a rim 10 mm off the origin: both parts of the row bend much, their sum little."""
    X = Pose(np.array([0.01, 0.0, 0.002]), np.eye(3))
    e_m, e_f = np.array([0.0, 0.6, 0.8]), np.array([0.0, 1.0, 0.0])
    row = edges_apart(e_m, e_f, np.zeros(3), np.array([[-0.01, 0.0, -0.002]])).at(X)
    half = box((0.05, 0.0, 0.0), (0.0, 0.0, 0.0))
    lengths_alone = 0.5 * 0.05**2 * (row.forms.lever + np.linalg.norm(row.turned.y, axis=1))
    assert row.f == pytest.approx(0.0, abs=1e-15)
    assert (remainders(row, row, Extent(np.zeros(6), half)) < 0.2 * lengths_alone).all()


@pytest.mark.parametrize("kind", KINDS)
def test_errors_change_what_a_row_says_of_the_motion_by_its_power(kind: str) -> None:
    rng = np.random.default_rng(11)
    rows, X, twist = forms(kind, rng), pose(rng), rng.normal(size=6)
    at = rows.at(X)
    power = Curvature.of(at, at, twist).power()
    for axis, step in enumerate(np.eye(6) * 1e-6):
        slope = (rows.at(X.moved(step)).N - rows.at(X.moved(-step)).N) @ twist / 2e-6
        np.testing.assert_allclose(power[:, axis], slope, atol=1e-8)


def test_rows_of_contacts_are_what_their_definitions_say() -> None:
    rng = np.random.default_rng(5)
    v, n, c, r = rng.normal(size=3), rng.normal(size=3), rng.normal(), rng.normal()
    for _ in range(10):
        X = pose(rng)
        for row, told in (
            (points_above(v, n, c), definitions.vertex_face(X.p, X.R, v=v, n=n, c=c)),
            (balls_above(v, n, c, np.array(r)), definitions.ball_face(X.p, X.R, v=v, n=n, c=c, r=r)),
            (faces_above(n, c, v), definitions.face_vertex(X.p, X.R, n=n, w=v, c=c)),
        ):
            assert row.at(X).f[0] == pytest.approx(told, abs=1e-14)
