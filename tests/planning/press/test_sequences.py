"""Generators beside that of corners: where they have candidates, and that these seat parts that corner presses lose."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fmopt.execution.press_trials import carry_out, count_presses, vertex_errors
from fmopt.plan.press import Attempt, Conditions, PressPlan
from fmopt.planning.press.choice import Choosing
from fmopt.planning.press.library import LIBRARY, corner_attempt, robot_of
from fmopt.planning.press.propose import proposals
from fmopt.planning.press.task import PressTask
from fmopt.task.problem import load
from tests.shared.parts.families import pair, write_toml
from tests.shared.plans.press_plan import press_task

VERTICES = 8  # of the 64


def task_of(family: str, seed: int, folder: Path) -> PressTask:
    """A pair with errors of 1 mm, 1° and 0.5 mm in height, in proportion below 10 mm, for 80 N and 4 N·m."""
    made = pair(family, seed)
    share = min(1.0, 0.1 * made.size)
    box = np.array([1e-3 * share] * 2 + [0.5e-3 * share] + [math.radians(1.0)] * 3)
    problem = load(write_toml(made, folder))
    wanted = replace(problem.specification, contact_force=80.0, torque_limit=4.0)
    return replace(press_task(replace(problem, specification=wanted)), box=box)


def carried(task: PressTask, attempt: Attempt) -> tuple[Conditions, PressPlan]:
    """What draws are taken from, friction 0.3, and an attempt as a plan."""
    conditions = Conditions(tuple(task.box.tolist()), (0.3, 0.3), (1.0, 1.0), (1.0, 1.0))
    robot = robot_of(task, (2e4, 100.0), (2.0, 0.01))
    return conditions, Choosing(task.bodies, task.seat, robot, conditions, 0).plan([attempt])


def seated(task: PressTask, attempt: Attempt, count: int = VERTICES) -> int:
    """How many of some vertices an attempt seats alone."""
    conditions, plan = carried(task, attempt)
    errors = vertex_errors(conditions, count_presses(plan)).of(np.random.default_rng(1).permutation(64)[:count])
    return sum(one.seated for one in carry_out(task.bodies, plan, errors, 0, range(count), threads=2))


@pytest.mark.parametrize(
    ("family", "seed", "source"), [("rectangle", 106, "crossing"), ("T", 104, "yaw sweep"), ("star", 103, "yaw sweep")]
)
def test_a_sequence_made_for_a_mouth_seats_where_corner_presses_do_not(
    family: str, seed: int, source: str, tmp_path: Path
) -> None:
    task = task_of(family, seed, tmp_path)
    first, *_, last = proposals(task)
    assert (first.source, last.source) == (source, "corner")
    most = max(seated(task, one) for one in proposals(task)[:4])
    assert most >= VERTICES - 2
    corner = next(one for one in proposals(task) if one.source == "corner")
    assert most > seated(task, corner)


@pytest.mark.parametrize("family", ["6-gon", "keyed", "triangle"])
def test_mouths_that_are_wide_and_have_no_arms_are_entered_at_once(family: str, tmp_path: Path) -> None:
    assert {one.source for one in proposals(task_of(family, 104, tmp_path))} == {"corner"}


def test_the_top_is_touched_first_where_the_height_is_unknown_by_more_than_the_tip_goes_in(tmp_path: Path) -> None:
    known = task_of("4-gon", 104, tmp_path)
    assert all(one.presses[0].name == "come down" for one in proposals(known)[:2])
    task = replace(known, box=known.box * (1.0, 1.0, 4.0, 1.0, 1.0, 1.0))
    touching = proposals(task)[0]
    assert [one.name for one in touching.presses[:4]] == ["touch the top", "lift", "go over the mouth", "come down"]
    plain = corner_attempt(task, task.few_corners[0], LIBRARY[0])
    assert seated(task, touching) == VERTICES > seated(task, plain) + 2


@pytest.mark.parametrize(("family", "friction", "strokes"), [("4-gon", 0.3, 1), ("7-gon", 0.5, 2), ("10-gon", 0.3, 2)])
def test_a_tip_that_friction_holds_on_a_wall_is_led_along_either_one(
    family: str, friction: float, strokes: int, tmp_path: Path
) -> None:
    task = task_of(family, 104, tmp_path)
    task = replace(task, problem=replace(task.problem, friction=(0.1, friction)))
    corner = task.few_corners[0]
    pushed = [one for one in corner_attempt(task, corner, LIBRARY[0]).presses if one.name == "press into the corner"]
    assert len(pushed) == strokes
    # At least one leads away from each wall: it is farther from the wall's normal than the angle of friction.
    directions = np.array([one.wrench[:2] for one in pushed]) / np.linalg.norm(pushed[0].wrench[:2])
    assert (directions @ corner.walls.T).min(axis=0).max() < math.cos(math.atan(friction))


def test_small_parts_are_led_about_the_axis_and_rocked_before_they_go_in(tmp_path: Path) -> None:
    task = task_of("7-gon", 102, tmp_path)
    attempt = corner_attempt(task, task.few_corners[0], LIBRARY[0])
    turned = np.cumsum([one.twist[5] * one.ends[-1].seconds for one in attempt.presses if one.name == "sweep yaw"])
    assert turned[0] < -task.box[5] < task.box[5] < turned[1]  # all errors of yaw are passed
    for dropped in ({"sweep yaw"}, {"rock", "work free"}):
        without = replace(attempt, presses=tuple(one for one in attempt.presses if one.name not in dropped))
        assert seated(task, attempt, 24) >= seated(task, without, 24) + 3
    assert not any(one.name == "sweep yaw" for one in proposals(task_of("9-gon", 103, tmp_path))[0].presses)
