"""The application, what its commands share, and its end: every error becomes one message and an exit code."""

import json
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any, NoReturn

import typer

from fmopt import __version__
from fmopt.errors import FmoptError, InputError, InterferenceError, ResourceError, UnprovedError
from fmopt.runtime.escape import one_line
from fmopt.runtime.process import interrupted

_SHOWN = 5  # findings that a refusal lists
_DATA = ("interference", "place", "shortfall", "feature", "rule", "findings")  # what errors carry beside their words
MOST_WORKERS = 1024
MOST_TRIALS = 10_000_000
EXIT = {"CERTIFIED": 0, "REFUTED": 1, "NOT_PROVED": 3, "TESTED": 3}  # of the check

app = typer.Typer(
    add_completion=True,
    no_args_is_help=True,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    help="Insertion motions that work although the clearance is smaller than the error, with proof.",
    epilog="Exit codes: 0 certified, or tested where that is asked for; 1 refuted or infeasible, 2 bad input, "
    "3 neither, 4 resource, 70 internal.",
)

Json = Annotated[bool, typer.Option("--json", help="Print one JSON object instead of text.")]
Workers = Annotated[int | None, typer.Option("--workers", min=1, max=MOST_WORKERS, help="Default: one a core.")]
Unverified = Annotated[bool, typer.Option("--unverified", help="Do without the check: nothing is guaranteed then.")]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Print nothing but errors.")]


def main() -> NoReturn:
    """Runs the command line inside a program that answers signals and has streams; see `fmopt.__main__`."""
    sys.exit(command())


def command() -> int:
    """Runs the command line; every error becomes one message and an exit code, never a traceback."""
    try:
        app()
    except SystemExit as stop:
        # A text in place of a code stands for 1, as Python takes it.
        return stop.code if isinstance(stop.code, int) else int(stop.code is not None)
    except Exception as error:  # noqa: BLE001 (the last door: nobody outside sees a traceback)
        interrupted()  # a signal, if that is what the library's error comes from
        return _told(_named(error))
    return 0


def _named(error: Exception) -> FmoptError:
    """What ends a command, as an error with advice and an exit code."""
    if isinstance(error, FmoptError):
        return error
    if isinstance(error, MemoryError):
        return ResourceError("out of memory", "solve a smaller problem or free some")
    if isinstance(error, OSError):
        return ResourceError(f"{error.filename or 'I/O'}: {error.strerror or error}", "check the path and the disk")
    return FmoptError(f"internal fault: {type(error).__name__}: {error}; please report it with the input")


def _told(error: FmoptError) -> int:
    """One message on standard error, and with --json an object on standard output; the exit code."""
    for line in _message(error):
        say(line, err=True)
    # Not from the options that were read: an error may come before there are any.
    if "--json" in sys.argv[1:]:
        faults = [asdict(fault) for fault in error.faults] if isinstance(error, InputError) else []
        data = {name: getattr(error, name) for name in _DATA if hasattr(error, name)}
        if (failure := getattr(error, "failure", None)) is not None:
            data["failure"] = failure.record()
        told = {"message": error.message, "advice": error.advice, **data, "faults": faults}
        with suppress(ResourceError):  # standard output takes nothing: the exit code still says what was wrong
            typer.echo(json.dumps({"error": told, "exit_code": error.exit_code}))
    return error.exit_code


def _message(error: FmoptError) -> list[str]:
    if isinstance(error, InputError):
        return [str(fault) for fault in error.faults]
    if isinstance(error, InterferenceError):
        return [
            f"infeasible: {error.message}",
            f"interference {1e3 * max(error.interference, 0.0):.6f} mm at {error.place}; {error.advice}",
        ]
    if isinstance(error, UnprovedError):
        more = len(error.findings) - _SHOWN
        listed = [f"  {finding}" for finding in error.findings[:_SHOWN]] + [f"  and {more} more"] * (more > 0)
        return [error.message, *listed, f"advice: {error.advice}"]
    failure = getattr(error, "failure", None)
    why = [] if failure is None else [f"stage: {failure.stage}; {failure.reason}"]
    return [error.message, *why, *([f"advice: {error.advice}"] if error.advice else [])]


def compile_kernels(tell: Callable[[str], None]) -> None:
    """Has kernels compiled side by side before the first work that needs many of them."""
    from fmopt.runtime.compiled import mark

    if not mark().exists():
        from fmopt.runtime.ahead import compile_ahead

        compile_ahead(tell)


def say(text: str, err: bool = False) -> None:
    """Prints lines for people; what comes from a file is shown in them, and does not steer the terminal."""
    typer.echo("\n".join(map(one_line, text.split("\n"))), err=err)


def answer(data: Any, words: str, as_json: bool, quiet: bool) -> None:
    """Prints what a command comes to: one JSON object where that is asked for, else lines for people, or nothing."""
    if as_json:
        typer.echo(json.dumps(data))
    elif not quiet:
        say(words)


def wrote(paths: Sequence[Path], as_json: bool, quiet: bool) -> None:
    """Names the files that a command has written."""
    names = [str(path) for path in paths]
    answer({"written": names}, "\n".join(f"wrote {name}" for name in names), as_json, quiet)


def duration(seconds: float) -> str:
    """A time as people say it."""
    for size, name in ((86400.0, "days"), (3600.0, "h"), (60.0, "min")):
        if seconds >= 2.0 * size:
            return f"{seconds / size:.3g} {name}"
    return f"{seconds:.3g} s"


def _version(wanted: bool) -> None:
    if wanted:
        typer.echo(__version__)
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[bool, typer.Option("--version", callback=_version, is_eager=True, help="Show it.")] = False,
) -> None:
    """Insertion motions that work although the clearance is smaller than the error, with proof."""
