"""Parts that are off their form: plans promise what they do of the real parts, and the old way of counting did not."""

import copy
from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pytest

from fmopt.plan import sealed
from fmopt.planning.pipeline import certified_motion, proved
from fmopt.task.problem import Problem, load
from fmopt.verify import verify
from fmopt.verify.reading.reader import NOT_COVERED, NOT_COVERED_OFF_FORM, PlanError
from tests.shared.executions.real_parts import execute, off_form
from tests.shared.parts import families

OFF = 2e-6  # m, of the facets of each part
SIDES = ("moving", "fixed")


@cache
def exact() -> Problem:
    with TemporaryDirectory() as folder:
        return load(families.write_toml(families.pair("4-gon", 1), Path(folder)))


@cache
def solved(off: float, wider: float = 0.0) -> dict[str, Any]:
    """The plan of parts whose files are off by so much, for start errors wider by so much, m."""
    problem = exact()
    parts = {side: replace(getattr(problem, side), off=off) for side in SIDES}
    problem = replace(problem, **parts, start_box=problem.start_box + np.repeat([wider, 0.0], 3))
    document, verdict = proved(problem, certified_motion(problem))
    assert verdict.findings == ()
    return document


def test_real_parts_keep_every_promise() -> None:
    plan = solved(OFF)
    assert {plan["parts"][side]["form"] for side in SIDES} == {1.5 * OFF}
    for seed in range(4):
        ledger = execute(plan, off_form(plan, _rng(seed)), 40, seed, steps=3)
        assert ledger.broken == {}
        assert len({k for check, k in ledger.least if check == "tube"}) == 1 + len(plan["segments"])


def test_real_parts_are_as_far_off_as_is_stated() -> None:
    plan = solved(OFF)
    for seed in range(4):
        real = off_form(plan, _rng(seed))
        for side in SIDES:
            part, there = plan["parts"][side], real["parts"][side]
            pairs = [(part, there), *zip(part["pieces"], there["pieces"], strict=True)]
            far = [np.linalg.norm(np.subtract(a["vertices"], b["vertices"]), axis=1).max() for a, b in pairs]
            assert max(far) == pytest.approx(part["form"], rel=1e-3)
            assert max(far) <= part["form"]


@pytest.mark.wide
def test_a_form_counted_at_the_start_alone_is_not_kept() -> None:
    plan = copy.deepcopy(solved(0.0, 3.0 * OFF))
    for side in SIDES:
        plan["parts"][side]["form"] = 1.5 * OFF
    plan["uncertainty"]["start_box"] = exact().start_box.tolist()
    broken = {check for seed in range(3) for check, _ in execute(plan, off_form(plan, _rng(seed)), 40, seed, 3).broken}
    assert "tube" in broken


def test_parts_far_beyond_their_form_are_noticed() -> None:
    plan = solved(OFF)
    broken = {c for seed in range(2) for c, _ in execute(plan, off_form(plan, _rng(seed), 30.0), 40, seed, 3).broken}
    assert "tube" in broken


def _rng(seed: int) -> np.random.Generator:
    return np.random.default_rng(seed)


def test_what_is_not_covered_says_so() -> None:
    assert tuple(solved(OFF)["not_covered"]) == NOT_COVERED_OFF_FORM
    assert tuple(solved(0.0, 3.0 * OFF)["not_covered"]) == NOT_COVERED
    assert all("form" not in solved(0.0, 3.0 * OFF)["parts"][side] for side in SIDES)


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("share", [0.0, 0.5, 0.99, 1.01])
def test_another_form_than_was_planned_with_does_not_follow(side: str, share: float) -> None:
    plan = copy.deepcopy(solved(OFF))
    plan["parts"][side]["form"] *= share
    if share == 0.0:
        del plan["parts"][side]["form"]
    found = verify(sealed(plan))
    assert found.verdict == "NOT_PROVED"
    assert any(finding.what.startswith("offset_box") for finding in found.findings)


@pytest.mark.parametrize("form", [-1e-6, "1e-6", None, True, 0.5, [1e-6]])
def test_a_form_that_is_none_is_refused(form: object) -> None:
    plan = copy.deepcopy(solved(OFF))
    plan["parts"]["fixed"]["form"] = form
    with pytest.raises(PlanError, match=r"parts\.fixed\.form"):
        verify(sealed(plan))
