"""Another collision engine sees no overlap along sampled executions, every promised contact, and no other."""

import copy
from typing import Any

import numpy as np
import pytest

from tests.shared.executions.collision_engine import Engine
from tests.shared.executions.model import execute


def test_the_engine_agrees_with_the_plan(square_peg_plan: dict[str, Any]) -> None:
    engine = Engine(square_peg_plan)
    assert execute(square_peg_plan, 25, seed=2, steps=4, watch=engine.watch).broken == {}
    assert engine.wrong == set()
    assert engine.deepest <= 1e-7
    assert engine.seen > 10_000


def test_larger_errors_are_seen(square_peg_plan: dict[str, Any]) -> None:
    plan = copy.deepcopy(square_peg_plan)
    plan["uncertainty"]["start_box"] = [3.0 * x for x in plan["uncertainty"]["start_box"]]
    engine = Engine(plan)
    execute(plan, 20, seed=2, steps=2, watch=engine.watch)
    assert any("overlap" in words for words in engine.wrong)
    assert engine.deepest > 1e-5


def test_contacts_that_are_not_there_are_seen(square_peg_plan: dict[str, Any]) -> None:
    plan = copy.deepcopy(square_peg_plan)
    first = next(segment for segment in plan["segments"] if segment["goal_state"])
    first["state"] = list(first["goal_state"])
    engine = Engine(plan)
    execute(plan, 2, seed=2, steps=2, watch=engine.watch)
    assert any("is not touched" in words for words in engine.wrong)


@pytest.mark.parametrize("lift", [2e-6, 1e-4, -1e-4])
def test_distances_are_those_of_the_geometry(square_peg_plan: dict[str, Any], lift: float) -> None:
    """Upright over the middle of the block's floor, or in it."""
    engine = Engine(square_peg_plan)
    depth = min(v[2] for v in square_peg_plan["parts"]["fixed"]["vertices"])
    goal = np.array(square_peg_plan["goal"][:3]) * [0.0, 0.0, 1.0] + [0.0, 0.0, lift]
    found = engine.distances(goal, np.eye(3))
    assert depth < goal[2] < 0.0
    assert min(found.values()) == pytest.approx(min(lift, 1e-4), abs=1e-8)
