"""A command in the process of a test."""

import pytest

from fmopt.cli import main


def ended(capfd: pytest.CaptureFixture[str]) -> tuple[int, str, str]:
    """Runs the command that `sys.argv` has: exit code, output, errors, none of them a traceback."""
    capfd.readouterr()
    with pytest.raises(SystemExit) as stop:
        main()
    out, err = capfd.readouterr()
    assert "Traceback" not in out + err
    return stop.value.code if isinstance(stop.value.code, int) else 0, out, err
