"""Candidates whose way tool and obstacles have no room for are dropped; where there is none, it is said where."""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
import pytest

from fmopt.errors import SearchError
from fmopt.execution.kept_clear import KeptClear
from fmopt.execution.press_controller import begun
from fmopt.notebook.failure import explained
from fmopt.plan.evidence import TOUCH
from fmopt.plan.press import ConvexSolid, Surroundings
from fmopt.planning import pipeline
from fmopt.planning.press.nominal_way import kept_clear
from fmopt.planning.press.propose import proposals
from fmopt.runtime.clock import clock
from fmopt.task.problem import Problem
from tests.shared.plans.press_plan import press_problem, press_task

Box = tuple[tuple[float, float], tuple[float, float], tuple[float, float]]
HEAD: Box = (-20, 20), (-20, 20), (40, 60)  # mm; the peg is 20 mm wide and 40 long, 30 of it go in


def with_boxes(held: Box, standing: Box) -> Problem:
    """The square peg with a box that moves with it, and one beside the hole."""
    cells = (
        (ConvexSolid(name, (tuple((1e-3 * x, 1e-3 * y, 1e-3 * z) for x, y, z in product(*box)),)),)
        for name, box in (("gripper", held), ("wall", standing))
    )
    return replace(press_problem(), cell=Surroundings(*cells))


def test_candidates_that_lean_away_from_a_wall_are_left() -> None:
    problem = with_boxes(HEAD, ((-29, -23), (-60, 60), (0, 45)))
    task = press_task(problem)
    proposed = proposals(task)
    assert kept_clear(press_task(press_problem()), proposed) == proposed
    left = kept_clear(task, proposed)
    assert 0 < len(left) < len(proposed)
    assert left == [one for one in proposed if one in left]
    box = 3.0 * task.box
    sure = kept_clear(replace(task, box=box), left)
    assert 0 < len(sure) < len(left)
    errors = np.random.default_rng(5).uniform(-box, box, (2000, 6))
    for one in sure:  # of its starts one in a thousand is too near, at most
        clear = KeptClear(task.bodies, problem.cell, begun(np.tile(one.start, (2000, 1)), errors))
        assert (clear.least <= TOUCH).sum() <= 2


@pytest.mark.parametrize(
    ("held", "standing", "words"),
    [
        (HEAD, ((15, 30), (-60, 60), (0, 60)), "gripper and wall come within 0 mm of each other on the way in"),
        (((-20, 20), (-20, 20), (20, 60)), ((40, 50), (0, 9), (0, 9)), "gripper and the fixed part"),
        (HEAD, ((-60, 60), (-60, 60), (41, 50)), "and wall come within 0 mm of each other"),
    ],
)
def test_where_none_is_left_it_is_said_what_is_near_and_where(held: Box, standing: Box, words: str) -> None:
    problem = with_boxes(held, standing)
    with pytest.raises(SearchError) as told:
        pipeline.synthesise(problem)  # no guarded moves take their place, which keep clear of nothing
    assert words in told.value.message
    assert "grip the part farther" in told.value.advice
    assert explained(problem, told.value, clock()).advice == (told.value.advice,)


def test_guarded_moves_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    problem = with_boxes(HEAD, HEAD)
    wanted: Any = replace(problem, settings=replace(problem.settings, evidence="certified"))
    with pytest.raises(SearchError, match="do not keep clear"):
        pipeline.synthesise(wanted)
