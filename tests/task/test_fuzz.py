"""Whatever is done to a valid file, loading it gives a problem or an InputError, never anything else."""

from __future__ import annotations

import random
from contextlib import suppress
from pathlib import Path

import pytest

from fmopt.errors import InputError
from fmopt.task.problem import Problem, load
from tests.shared.fuzz.damage import damaged
from tests.shared.fuzz.files import KINDS


@pytest.mark.parametrize("kind", ["problem", "model"])
def test_a_damaged_file_is_a_problem_or_is_refused_as_input(kind: str, tmp_path: Path) -> None:
    cases = KINDS[kind](tmp_path)
    for number in range(100):
        rng = random.Random(f"{kind} {number}")
        case = rng.choice(cases)
        file, whole = tmp_path / case.file, (tmp_path / case.file).read_bytes()
        file.write_bytes(damaged(rng, whole))
        with suppress(InputError):
            assert isinstance(load(tmp_path / case.commands[0][1]), Problem)
        file.write_bytes(whole)
