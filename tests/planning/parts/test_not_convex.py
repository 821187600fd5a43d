"""Parts that are not convex: their pieces lie in walls and beside rims that others of them touch."""

import copy
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pytest

from fmopt.planning.pipeline import certified_motion, proved
from fmopt.task.problem import load
from fmopt.verify import verify
from tests.shared.executions.model import execute
from tests.shared.parts.families import pair, write_toml

QUICK = (("U", 3), ("L", 3), ("U", 5))
SLOW = (("plus", 1), ("T", 5))  # with faces of several arms that come to parallel walls at once


@cache
def solved(family: str, seed: int) -> dict[str, Any]:
    """The plan of a generated pair for ±0.3 mm and ±0.3°, as it was proved."""
    with TemporaryDirectory() as folder:
        problem = load(write_toml(pair(family, seed), Path(folder), error=(0.3, 0.3), time_limit=300.0))
        document, verdict = proved(problem, certified_motion(problem))
    assert verdict.findings == ()
    return document


@pytest.mark.parametrize(("family", "seed"), [*QUICK, *(pytest.param(*case, marks=pytest.mark.wide) for case in SLOW)])
def test_every_execution_keeps_every_promise(family: str, seed: int) -> None:
    plan = solved(family, seed)
    ledger = execute(plan, 40, seed=1, steps=3)
    assert ledger.broken == {}
    assert {k for check, k in ledger.least if check == "separation"} == set(range(len(plan["segments"])))


@pytest.mark.parametrize("grown", [1e-10, 1e-7])
def test_a_leg_that_is_too_far_out_is_noticed(grown: float) -> None:
    """What a face in one wall says of one beside it holds for that one's place alone."""
    plan = copy.deepcopy(solved("U", 3))
    moved = 0
    axis, side = _inner_side(plan)
    for body in (plan["parts"]["moving"], *plan["parts"]["moving"]["pieces"]):
        vertices = np.array(body["vertices"])
        inner = np.abs(vertices[:, axis] - side) < 1e-9  # of one leg, which faces the other one
        vertices[inner, axis] -= grown
        moved += int(inner.sum())
        body["vertices"] = vertices.tolist()
    assert moved > 0
    assert verify(plan).verdict != "CERTIFIED"


def _inner_side(plan: dict[str, Any]) -> tuple[int, float]:
    """Across which axis the legs stand, and where the inner side of the one towards that is."""
    levels = [sorted({round(vertex[k], 12) for vertex in plan["parts"]["moving"]["vertices"]}) for k in (0, 1)]
    axis = int(len(levels[0]) < len(levels[1]))
    assert len(levels[axis]) == 4
    return axis, float(levels[axis][2])
