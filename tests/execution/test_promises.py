"""Executions of the square peg's plan, simulated on the true geometry, keep what the plan promises."""

import copy
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from fmopt.planning.pipeline import synthesise
from fmopt.task.problem import load
from fmopt.verify import verify
from tests import PROBLEMS
from tests.shared.executions.errors import drifts, start_errors
from tests.shared.executions.geometry import Convex, Scene, Touch, gaps, rotations, vectors
from tests.shared.executions.model import Piece, execute, first_zero
from tests.shared.lies.restate import restated

CUBE = {
    "vertices": [[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)],
    "faces": [[[0, 1, 3, 2]], [[4, 6, 7, 5]], [[0, 4, 5, 1]], [[2, 3, 7, 6]], [[0, 2, 6, 4]], [[1, 5, 7, 3]]],
}
SQUARE = np.array([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]])
EDGE = np.array([[0.3, -1.0, 0.2], [0.4, 1.5, 0.1]])
TOUCHES = {
    "vertex-face": (EDGE[:1], SQUARE),
    "hinge": (EDGE, SQUARE),
    "face-vertex": (SQUARE, EDGE[:1]),
    "edge-edge": (EDGE, SQUARE[:2]),
}


def test_every_execution_keeps_every_promise(square_peg_plan: dict[str, Any]) -> None:
    ledger = execute(square_peg_plan, 60, seed=1)
    assert ledger.broken == {}
    assert {k for check, k in ledger.least if check == "separation"} == set(range(len(square_peg_plan["segments"])))
    # The samples go far enough out for the stated sets to be put to the test.
    assert ledger.share["tube", 1] > 0.85


def test_a_robot_that_goes_wrong_in_turns_only_keeps_every_promise() -> None:
    """No drift of the position covers what a turn adds to the errors to second order."""
    problem = load(PROBLEMS / "square_peg_100um.toml")
    turning = replace(problem.velocity_error, translation=0.0, rotation=0.01)
    found = synthesise(replace(problem, velocity_error=turning)).document
    assert execute(found, 60, seed=1).broken == {}


def test_a_wider_start_box_is_noticed(square_peg_plan: dict[str, Any]) -> None:
    plan = copy.deepcopy(square_peg_plan)
    plan["uncertainty"]["start_box"] = [3.0 * x for x in plan["uncertainty"]["start_box"]]
    broken = {check for check, _ in execute(plan, 20, seed=1, steps=2).broken}
    assert {"tube", "separation"} <= broken
    assert any(check.endswith("inside") for check in broken)


def test_a_narrower_tube_is_noticed(square_peg_plan: dict[str, Any]) -> None:
    plan = copy.deepcopy(square_peg_plan)
    for segment in plan["segments"]:
        for key in ("offset_box", "angle_box"):
            segment["tube"][key] = [0.6 * x for x in segment["tube"][key]]
    broken = execute(plan, 20, seed=1, steps=1).broken
    assert {check for check, _ in broken} == {"tube"}
    assert len(broken) > len(plan["segments"]) // 3


def test_a_faster_drift_is_noticed(square_peg_plan: dict[str, Any]) -> None:
    plan = copy.deepcopy(square_peg_plan)
    plan["uncertainty"]["velocity_error"] = [5.0 * x for x in plan["uncertainty"]["velocity_error"]]
    assert "tube" in {check for check, _ in execute(plan, 20, seed=1, steps=1).broken}


@pytest.mark.parametrize("shares", [{"hole": 1.0}, {"hand": 1.0}, {"hole": 0.4, "hand": 0.3, "world": 0.3}])
def test_errors_of_hole_and_hand_keep_every_promise(square_peg_plan: dict[str, Any], shares: dict[str, float]) -> None:
    plan = copy.deepcopy(square_peg_plan)
    box = np.array(plan["uncertainty"]["start_box"])
    boxes = {frame: (share * box).tolist() for frame, share in shares.items()}
    plan["uncertainty"]["sources"] = [{"frame": frame, "box": stated} for frame, stated in boxes.items()]
    plan = restated(plan)
    assert verify(plan).findings == ()
    assert execute(plan, 40, seed=2, steps=4).broken == {}


def _turning(plan: dict[str, Any]) -> Piece:
    """The piece of a plan that turns most."""
    pieces = [Piece(Scene(plan), k) for k in range(len(plan["segments"]))]
    return max(pieces, key=lambda piece: float(np.linalg.norm(piece.omega)))


@pytest.mark.parametrize("frame", ["world", "hole", "hand"])
def test_errors_move_as_what_they_are_fixed_in(square_peg_plan: dict[str, Any], frame: str) -> None:
    """Their sum, as error sets hold it, is what is seen but for what is of second order in them."""
    piece, rng = _turning(square_peg_plan), np.random.default_rng(1)
    box = np.array([2e-4, 3e-4, 1e-4, 0.02, 0.01, 0.03])
    for size in (1e-2, 1e-3):
        world, fixed = start_errors([(frame, (size * box).tolist())], (piece.p, piece.R), 50, rng)
        total = fixed.summed(world, (piece.p, piece.R))
        assert (np.abs(total) <= size * box * (1.0 + 1e-12)).all()
        real = fixed.seen(piece.poses(world, np.ones(50)))
        linear = fixed.summed(world, piece.goal)
        left = np.abs(piece.errors_at_goal(real) - linear)
        assert left.max() < 1e-3 * size**2
        moved = np.abs(linear - total).max()
        assert moved == pytest.approx(0.0, abs=1e-18) if frame == "world" else moved > 1e-7 * size


def test_errors_are_drawn_on_the_boundary_of_what_is_stated(square_peg_plan: dict[str, Any]) -> None:
    piece, rng = _turning(square_peg_plan), np.random.default_rng(0)
    start = piece.p, piece.R
    boxes = np.array([[1e-4, 2e-4, 0.0, 0.01, 0.0, 0.02], [2e-4, 1e-4, 1e-4, 0.0, 0.0, 0.01]])
    alone, _ = start_errors([("world", boxes[0].tolist())], start, 400, rng)
    scaled = np.abs(alone[:, boxes[0] > 0.0]) / boxes[0][boxes[0] > 0.0]
    assert scaled.max(axis=1) == pytest.approx(1.0)
    world, fixed = start_errors([("world", boxes[0].tolist()), ("hole", boxes[1].tolist())], start, 400, rng)
    whole = boxes.sum(axis=0)
    total = np.abs(fixed.summed(world, start))[:, whole > 0.0] / whole[whole > 0.0]
    assert (total <= 1.0 + 1e-12).all()
    assert total.min(axis=1).max() == pytest.approx(1.0)
    rates = square_peg_plan["uncertainty"]["velocity_error"]
    drawn = drifts(piece, 400, rng) * np.repeat([1.0, piece.scene.rho], 3)
    for part, rate in enumerate(rates):
        assert np.linalg.norm(drawn[:, 3 * part : 3 * part + 3], axis=1) == pytest.approx(rate)


@pytest.mark.parametrize(
    ("place", "turn", "gap"),
    [
        ([2.5, 0.0, 0.0], [0.0, 0.0, 0.0], 0.5),
        ([1.5, 0.2, 0.1], [0.0, 0.0, 0.0], -0.5),
        ([1.0 + np.sqrt(2.0), 0.0, 0.0], [0.0, 0.0, np.pi / 4], 0.0),
    ],
)
def test_gap_of_cubes(place: list[float], turn: list[float], gap: float) -> None:
    cube = Convex.read(CUBE)
    assert gaps(cube, cube, np.array([place]), rotations(np.array([turn])))[0] == pytest.approx(gap, abs=1e-12)


def test_crossed_edges_are_told_apart_where_no_face_does() -> None:
    cube = Convex.read(CUBE)
    # Both cubes show an edge: one is turned about y, the other (seen from the first) about z; they meet at 2√2.
    first, second = (rotations(np.pi / 4 * np.eye(3)[[axis]])[0] for axis in (1, 2))
    R = (second.T @ first)[None]
    for apart in (0.05, -0.05):
        p = (second.T @ np.array([2.0 * np.sqrt(2.0) + apart, 0.0, 0.0]))[None]
        assert gaps(cube, cube, p, R)[0] == pytest.approx(apart, abs=1e-12)


@pytest.mark.parametrize("kind", TOUCHES)
def test_rows_are_gradients(kind: str) -> None:
    touch = Touch(kind, *TOUCHES[kind], np.ones(4, dtype=bool))
    p, r, step = np.array([[0.1, 0.2, 0.3]]), np.array([[0.2, -0.3, 0.4]]), 1e-6
    difference = [
        touch.value(p + s * step * d[None, :3], rotations(s * step * d[None, 3:]) @ rotations(r))[0]
        for d in np.eye(6)
        for s in (1.0, -1.0)
    ]
    numeric = (np.array(difference[::2]) - np.array(difference[1::2])) / (2.0 * step)
    assert touch.row(p, rotations(r))[0] == pytest.approx(numeric, abs=1e-8)


def test_rotations_and_zeros() -> None:
    r = np.random.default_rng(0).normal(size=(50, 3))
    assert vectors(rotations(r)) == pytest.approx(r, abs=1e-12)
    zero = np.array([0.0, 0.3, 1.7, 2.1])
    found = first_zero(lambda x: zero - x + 0.1 * (zero - x) ** 3, 4, 2.0)
    assert found[:3] == pytest.approx(zero[:3], abs=1e-12)
    assert np.isnan(found[3])
    # Where the chord meets the zero from before, a hair short of it.
    short = first_zero(lambda x: np.where(np.abs(x - 1.03) < 1e-9, 1e-20, 1.03 - x), 1, 2.0)
    assert short == pytest.approx([1.03], abs=1e-9)
