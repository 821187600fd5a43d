"""Where the command line is entered and left: every error becomes one message and an exit code."""

from __future__ import annotations

import json
import sys
from dataclasses import asdict
from typing import NoReturn

import typer

from fmopt.cli.app import app
from fmopt.errors import FmoptError, InputError, InterferenceError, ResourceError

_DATA = ("interference", "place", "shortfall", "feature", "rule")  # what errors carry beside their words


def main() -> None:
    """Runs the command line; every error becomes one message and an exit code, never a traceback."""
    try:
        app()
    except FmoptError as error:
        _fail(error)
    except MemoryError:
        _fail(ResourceError("out of memory", "solve a smaller problem or free some"))
    except OSError as error:
        _fail(ResourceError(f"{error.filename or 'I/O'}: {error.strerror or error}", "check the path and the disk"))
    except Exception as error:  # noqa: BLE001 (the last door: nobody outside sees a traceback)
        _fail(FmoptError(f"internal fault: {type(error).__name__}: {error}; please report it with the input"))


def _fail(error: FmoptError) -> NoReturn:
    """One message on standard error, and with --json an object on standard output."""
    for line in _message(error):
        typer.echo(line, err=True)
    if "--json" in sys.argv[1:]:
        faults = [asdict(fault) for fault in error.faults] if isinstance(error, InputError) else []
        data = {name: getattr(error, name) for name in _DATA if hasattr(error, name)}
        told = {"message": error.message, "advice": error.advice, **data, "faults": faults}
        typer.echo(json.dumps({"error": told, "exit_code": error.exit_code}))
    sys.exit(error.exit_code)


def _message(error: FmoptError) -> list[str]:
    if isinstance(error, InputError):
        return [str(fault) for fault in error.faults]
    if isinstance(error, InterferenceError):
        return [
            f"infeasible: {error.message}",
            f"interference {1e3 * max(error.interference, 0.0):.6f} mm at {error.place}; {error.advice}",
        ]
    return [f"{error.message}" + (f"\nadvice: {error.advice}" if error.advice else "")]
