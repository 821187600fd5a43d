"""Advice of the geometry room is followed to the letter, and what was refused is taken; each advice that there is."""

from __future__ import annotations

from pathlib import Path

import pytest

from fmopt.errors import FmoptError
from tests.shared.files.advice import meshes, objects, step
from tests.shared.files.advice.case import Case, advice_of

CASES = (*meshes.CASES, *step.CASES, *objects.CASES)


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_advice_that_is_followed_helps(case: Case, tmp_path: Path) -> None:
    with pytest.raises(FmoptError) as told:
        case.wrong(tmp_path)
    assert advice_of(told.value) == case.advice
    assert case.followed(tmp_path) == pytest.approx(case.gives, rel=1e-3)
