"""The same two parts in TOML, as binary STL and as STEP have the same verdict."""

from pathlib import Path

import pytest

import fmopt
from tests.shared.parts import families
from tests.shared.parts.forms import WRITERS

PAIRS = [("3-gon", 0), ("triangle", 0), ("rectangle", 0), ("L", 0), ("U", 0)]  # for which time is not short


@pytest.mark.wide
@pytest.mark.parametrize(("family", "seed"), PAIRS)
def test_all_forms_of_a_pair_are_certified(family: str, seed: int, tmp_path: Path) -> None:
    pair = families.pair(family, seed)
    for form, write in WRITERS.items():
        problem = fmopt.load(write(pair, tmp_path / form)).with_(settings_time_limit="60 s")
        plan = fmopt.solve(problem)
        assert plan.verify(problem).verdict == "CERTIFIED", form
