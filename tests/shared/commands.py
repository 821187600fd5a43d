"""A command in the process of a test."""

from typing import NamedTuple

import pytest

from fmopt.cli import main


class Outcome(NamedTuple):
    """Exit code and both outputs of one command."""

    code: int
    out: str
    err: str


def ended(capfd: pytest.CaptureFixture[str]) -> Outcome:
    """Runs the command that `sys.argv` has; what it puts out holds no traceback."""
    capfd.readouterr()
    with pytest.raises(SystemExit) as stop:
        main()
    out, err = capfd.readouterr()
    assert "Traceback" not in out + err
    return Outcome(stop.value.code if isinstance(stop.value.code, int) else 0, out, err)
