"""The application, and what its commands share."""

from __future__ import annotations

from typing import Annotated

import typer

from fmopt import __version__
from fmopt.escape import one_line

MOST_WORKERS = 1024
MOST_TRIALS = 10_000_000
EXIT = {"CERTIFIED": 0, "REFUTED": 1, "NOT_PROVED": 3}

app = typer.Typer(
    add_completion=True,
    no_args_is_help=True,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    help="Insertion motions that work although the clearance is smaller than the error, with proof.",
    epilog="Exit codes: 0 certified, 1 refuted or infeasible, 2 bad input, 3 not proved, 4 resource, 70 internal.",
)

Json = Annotated[bool, typer.Option("--json", help="Print one JSON object instead of text.")]
Workers = Annotated[
    int | None, typer.Option("--workers", min=1, max=MOST_WORKERS, help="Processes; default: one a core.")
]
Unverified = Annotated[
    bool, typer.Option("--unverified", help="Take a plan without asking the check: nothing is guaranteed then.")
]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Print nothing but errors.")]


def say(text: str, err: bool = False) -> None:
    """Prints lines for people; what comes from a file is shown in them, and does not steer the terminal."""
    typer.echo("\n".join(map(one_line, text.split("\n"))), err=err)


def _version(wanted: bool) -> None:
    if wanted:
        typer.echo(__version__)
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version and stop.")
    ] = False,
) -> None:
    """Insertion motions that work although the clearance is smaller than the error, with proof."""
