"""The check of the square peg's own plan: accepted as it is, rejected with any claim changed for the worse."""

from typing import Any

import pytest

from fmopt.verify import CERTIFIED, NOT_PROVED, PlanError, findings, verify
from fmopt.verify.certificate import facet_margin as facets
from fmopt.verify.parts.rows import Function
from tests.shared.lies.mutations import claims, numbers


def test_the_untouched_plan_is_certified(square_peg_plan: dict[str, Any]) -> None:
    verdict = verify(square_peg_plan, square_peg_plan["problem"]["sha256"])
    assert (verdict.findings, verdict.verdict) == ((), CERTIFIED)


def test_planner_and_check_agree_very_closely(square_peg_plan: dict[str, Any], monkeypatch: pytest.MonkeyPatch) -> None:
    """The planner allows for what the check adds to bounds of errors; without that 5e-11 were between them."""
    monkeypatch.setattr(findings, "RELATIVE", 1e-11)
    assert verify(square_peg_plan).findings == ()


def test_quick_bounds_are_never_closer(square_peg_plan: dict[str, Any], monkeypatch: pytest.MonkeyPatch) -> None:
    class Bounds(facets._Way):
        def quick(self, function: Function) -> tuple[int, int]:
            found = super().quick(function)
            nominal = self.nominal(function)
            looked.append(function)
            assert found[0] <= self.least(function) < nominal[0] <= nominal[1] < self.most(function) <= found[1]
            return found

    looked: list[Function] = []
    monkeypatch.setattr(facets, "_Way", Bounds)
    assert verify(square_peg_plan).verdict == CERTIFIED
    assert len(looked) > 100


def test_numbers_changed_for_the_worse_are_rejected(square_peg_plan: dict[str, Any]) -> None:
    for name, mutant in numbers(square_peg_plan, 1):
        assert verify(mutant).verdict == NOT_PROVED, name


def test_changed_claims_are_rejected(square_peg_plan: dict[str, Any]) -> None:
    for name, mutant in claims(square_peg_plan):
        try:
            verdict = verify(mutant).verdict
        except PlanError:  # what no plan may say at all
            continue
        assert verdict != CERTIFIED, name


def test_another_problem_is_rejected(square_peg_plan: dict[str, Any]) -> None:
    assert verify(square_peg_plan, "0" * 63 + "1").verdict == NOT_PROVED
