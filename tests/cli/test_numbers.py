"""Every numeric option of every command: numbers that are none, too large or too small are bad input, at once."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import get_args

import pytest
from typer.main import get_command

from fmopt.cli import app
from tests import ROOT
from tests.shared.commands import Outcome

# Of each option: whether a negative number, nought, and a huge one can be meant.
MEANT = {
    "solve --trials": (False, True, False),
    "export --rate": (False, False, False),
    "export --base": (True, True, False),
    "execute --trials": (False, True, False),
    "execute --beyond": (False, True, False),
    "execute --seed": (False, True, True),
    "execute --friction": (False, True, False),
    "execute --time-step": (False, False, False),
    "execute --growth": (True, True, False),
    "execute --offset": (True, True, False),
    "execute --replay": (False, True, False),
    "execute --workers": (False, False, False),
    "compare --trials": (False, False, False),
    "compare --seed": (False, True, True),
    "compare --workers": (False, False, False),
    "study run --jobs": (False, False, False),
    "study run --limit": (False, True, True),
}
NUMBERS = {"nan": None, "inf": None, "-inf": None, "-0.1": 0, "-1": 0, "0": 1, "1e300": 2}  # which of them it is


def numeric() -> Iterator[str]:
    """Every numeric option."""
    waiting = [("", get_command(app))]
    while waiting:
        name, command = waiting.pop()
        waiting += [(f"{name} {key}".strip(), sub) for key, sub in getattr(command, "commands", {}).items()]
        for option in command.params:
            wanted = option.type_descriptor.annotation
            if {wanted, *get_args(wanted)} & {int, float}:
                yield f"{name} {max(option.opts, key=len)}"


def test_every_numeric_option_is_in_the_table() -> None:
    assert set(numeric()) == set(MEANT)


@pytest.mark.parametrize("option", MEANT)
def test_numbers_that_cannot_be_meant_are_bad_input(
    option: str, square_peg_plan_file: Path, tmp_path: Path, command: Callable[..., Outcome]
) -> None:
    verb, flag = option.rsplit(" ", 1)
    file = ROOT / "problems/studies/square_peg_clearance.toml" if verb.startswith("study") else square_peg_plan_file
    to = "csv" if flag == "--rate" else "ros2"
    rest = {"export": ["--to", to, "--base", *"000000"], "study run": ["--dry-run"]}.get(verb, [])
    values = 6 if flag == "--base" else 1
    refused = [number for number, meant in NUMBERS.items() if meant is None or not MEANT[option][meant]]
    for number in refused + (["99999999999999999999"] if not MEANT[option][2] else []):
        done = command(*verb.split(), file, *rest, "--out", tmp_path / "out", flag, *([number] * values))
        assert (done.code, number) == (2, number), done.err
        assert done.err
        assert not (tmp_path / "out").exists()
