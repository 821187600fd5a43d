"""`fmopt study` and `fmopt study report`."""

import json
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import typer
import typer.core

from fmopt.cli.entry import EXIT, MOST_WORKERS, Json, Quiet, answer, app, compile_kernels, duration


class _Study(typer.core.TyperGroup):
    """`fmopt study FILE…` is `fmopt study run FILE…`."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        if args and args[0] not in (*self.commands, "--help"):
            args = ["run", *args]
        return super().parse_args(ctx, args)


studies = typer.Typer(cls=_Study, no_args_is_help=True, rich_markup_mode=None)
app.add_typer(studies, name="study", help="Run a study over many problems, resumable; or report on its results.")


@studies.command("run", epilog="Example: fmopt study problems/studies/square_peg_clearance.toml --jobs 2")
def study_run(
    files: Annotated[list[Path], typer.Argument(help="Study files (TOML), one after the other.")],
    out: Annotated[Path | None, typer.Option("--out", help="Folder for the results; default: out/<study>.")] = None,
    jobs: Annotated[int | None, typer.Option(min=1, max=MOST_WORKERS, help="Processes; default: all cores.")] = None,
    limit: Annotated[int | None, typer.Option(min=0, help="Runs to do at most now.")] = None,
    retry_failed: Annotated[bool, typer.Option("--retry-failed", help="Do failed runs again.")] = False,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Only show the runs and an estimate of time.")] = False,
    cluster: Annotated[str | None, typer.Option(help="Address of a Dask scheduler, tcp://…, to work there.")] = None,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Run a study, or go on with one that was interrupted: what is done is not done again."""
    from fmopt.cli.console import runs, stages
    from fmopt.study import command
    from fmopt.study.running.running import Options

    options = Options(jobs, limit, retry_failed, cluster)
    if out is not None and len(files) > 1:
        raise typer.BadParameter("several studies cannot share one folder", param_hint="--out")
    allocations = [file for file in files if command.allocates(file)]
    if allocations and (cluster is not None or limit is not None or retry_failed):
        raise typer.BadParameter("an allocation is one piece of work on this machine", param_hint=str(allocations[0]))
    # Before there are workers, each of which would compile the same; other hosts keep their own.
    if not dry_run and cluster is None:
        with stages(quiet or as_json) as progress:
            compile_kernels(progress)
    for file in files:
        folder = out if out is not None else Path("out") / file.stem
        if file in allocations:
            _allocate(file, folder, dry_run, as_json, quiet)
            continue
        if dry_run:
            with stages(quiet or as_json) as progress:
                found = command.forecast(file, folder, options, progress)
            typer.echo(json.dumps(asdict(found)) if as_json else _foretold(file, found))
            continue
        with runs(file.stem, quiet or as_json) as progress:
            tally = command.carry_out(file, folder, options, progress)
        answer({**asdict(tally), "folder": str(folder)}, _told(tally, folder), as_json, quiet)
        if tally.interrupted:
            # As shells tell it of a process that a signal has ended.
            raise typer.Exit(128 + tally.interrupted)


def _allocate(file: Path, folder: Path, dry_run: bool, as_json: bool, quiet: bool) -> None:
    from fmopt.cli.console import stages
    from fmopt.study import command

    if dry_run:
        record, words = command.asked_for(file)
    else:
        with stages(quiet or as_json) as progress:
            record, words = command.allocated(file, folder, progress)
        record = {**record, "folder": str(folder)}
    answer(record, "\n".join(words), as_json, quiet)
    if not dry_run and record["same_motion"]["verdict"] != "CERTIFIED":
        raise typer.Exit(EXIT[record["same_motion"]["verdict"]])


@studies.command("report", epilog="Example: fmopt study report out/square_peg")
def study_report(
    folders: Annotated[list[Path], typer.Argument(help="Folders of studies, finished or not.")],
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Write report.html, table.csv and, where polars is installed, table.parquet beside the results."""
    from fmopt.study import command

    for folder in folders:
        written = [str(path) for path in command.report(folder)]
        answer({"folder": str(folder), "written": written}, "wrote " + ", ".join(written), as_json, quiet)


def _foretold(file: Path, found: Any) -> str:
    lines = [f"{file}: {found.total} runs, {found.done} of them done", *found.listing]
    if found.seconds is None:
        return "\n".join([*lines, f"no estimate of time: {found.source}"])
    whole = "the rest" if found.asked == found.total - found.done else f"{found.asked} runs"
    words = f"{duration(found.seconds)} a run, by {found.source}; {duration(found.rest)} for {whole}"
    return "\n".join([*lines, words])


def _told(tally: Any, folder: Path) -> str:
    left = tally.total - tally.done
    words = f"{tally.done} of {tally.total} runs done"
    words += f", {tally.failed} of them failed (--retry-failed does them again)" if tally.failed else ""
    words += f"; {tally.fresh} now, in {duration(tally.seconds)}" if tally.fresh else ""
    words = f"interrupted: {words}; the same command goes on" if tally.interrupted else words
    words += f"; {left} left" if left and not tally.interrupted else ""
    return f"{words}\nwrote {folder / 'table.csv'}; fmopt study report {folder} makes a page of it"
