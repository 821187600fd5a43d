"""The command line: `fmopt solve`, `verify`, `check`, `execute`, `export`, `study`, `schema`; heavy imports wait."""

from __future__ import annotations

import json
import sys
from dataclasses import asdict, replace
from pathlib import Path
from typing import Annotated, Any, NoReturn

import typer
import typer.core

from fmopt import __version__
from fmopt.errors import FmoptError, InputError, InterferenceError, PlanFormatError, ResourceError

_DATA = ("interference", "place", "shortfall", "feature", "rule")  # what errors carry beside their words
STDIN = Path("-")
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
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Print nothing but errors.")]


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


@app.command(epilog="Example: fmopt solve problems/square_peg.toml --report")
def solve(
    file: Annotated[Path, typer.Argument(help="Problem file (TOML); - for standard input.")],
    out: Annotated[Path | None, typer.Option("--out", help="Folder for the results; default: out/<problem>.")] = None,
    report: Annotated[bool, typer.Option("--report", help="Write report.html and its figures, too.")] = False,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Plan an insertion, check the certificate, write plan.json."""
    from fmopt import plan
    from fmopt.console import Stages, print_solved
    from fmopt.synthesis import synthesise
    from fmopt.task.problem import load

    folder = out if out is not None else Path("out") / ("stdin" if file == STDIN else file.stem)
    problem = load(file)
    plan.prepare(folder)
    with Stages(quiet or as_json) as stages:
        result = synthesise(problem, stages)
    plan.write(result.document, folder / "plan.json")
    timings = json.dumps(result.seconds, indent=1) + "\n"
    plan.save(timings.encode(), folder / "timings.json")
    if report:
        _write_report(result.document, folder)
    if as_json:
        typer.echo(json.dumps(_summary(result.document, result.verdict, folder)))
    elif not quiet:
        print_solved(result.document, result.verdict, folder, report)
    raise typer.Exit(EXIT[result.document["verdict"]])


@app.command(epilog="Example: fmopt verify out/square_peg/plan.json --problem problems/square_peg.toml")
def verify(
    file: Annotated[Path, typer.Argument(help="Plan file (JSON); - for standard input.")],
    problem: Annotated[Path | None, typer.Option(help="Problem file that the plan must belong to.")] = None,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Check a plan's certificate from its own geometry, in exact arithmetic, without the planner."""
    from fmopt import verify as independent

    if file != STDIN and not file.is_file():
        what = "is no file" if file.exists() else "no such file"
        raise ResourceError(f"{file}: {what}", "give the plan.json of a solved problem")
    try:
        document = independent.load(file)
        verdict = independent.verify(document)
        if problem is not None:
            from fmopt.task.agreement import disagreements
            from fmopt.task.problem import load

            verdict = verdict.unless(disagreements(load(problem), document))
    except independent.PlanError as error:
        raise PlanFormatError(f"{file}: {error}", "give a plan.json that fmopt solve wrote") from error
    except OSError as error:
        raise ResourceError(f"{file}: {error.strerror or error}", "give the plan.json of a solved problem") from error
    if as_json:
        typer.echo(json.dumps({**_findings(verdict), **_margins(document)}))
    elif not quiet:
        for line in independent.describe(verdict):
            typer.echo(line)
    raise typer.Exit(EXIT[str(verdict.verdict)])


@app.command(epilog="Example: fmopt check problems/square_peg.toml")
def check(
    file: Annotated[Path, typer.Argument(help="Problem or assembly file (TOML); - for standard input.")],
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Validate a problem file, or an assembly and each of its tasks, with all models and say it back in words."""
    from fmopt.task.assembly import is_assembly
    from fmopt.task.explain import explain, facts, measured
    from fmopt.task.problem import load

    if is_assembly(file):
        _check_assembly(file, as_json, quiet)
        return
    problem = load(file)
    clearance = measured(problem)
    if as_json:
        typer.echo(json.dumps(facts(problem, clearance)))
    elif not quiet:
        typer.echo(explain(problem, clearance))


def _check_assembly(file: Path, as_json: bool, quiet: bool) -> None:
    from fmopt.task.assembly import carried_out, load_assembly
    from fmopt.task.explain_assembly import assembly_facts, explain_assembly

    assembly = load_assembly(file)
    steps = list(carried_out(assembly))
    if as_json:
        typer.echo(json.dumps(assembly_facts(assembly, steps)))
    elif not quiet:
        typer.echo(explain_assembly(assembly, steps))


@app.command(epilog="Example: fmopt export plan.json --to urscript --base 0.4 -0.1 0.2 0 3.14159 0")
def export(
    file: Annotated[Path, typer.Argument(help="Plan file (JSON); - for standard input.")],
    to: Annotated[str, typer.Option("--to", help="urscript, ros2, csv or json.")],
    out: Annotated[Path | None, typer.Option("--out", help="File; for ros2 a folder.")] = None,
    base: Annotated[
        tuple[float, float, float, float, float, float] | None,
        typer.Option("--base", help="Pose of the hole's frame in the robot's base, m and rotation vector in rad."),
    ] = None,
    rate: Annotated[float, typer.Option("--rate", help="Samples a second of ros2, csv and json.")] = 100.0,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Write a plan in a format that robots or tables take."""
    from fmopt.export.write import export as write

    try:
        written = write(file, to, out, base, rate)
    except ValueError as error:
        raise typer.BadParameter(str(error)) from error
    if as_json:
        typer.echo(json.dumps({"written": [str(path) for path in written]}))
    elif not quiet:
        for path in written:
            typer.echo(str(path))


@app.command(epilog="Examples: fmopt show models/square_peg.toml; fmopt show out/square_peg/plan.json --what states")
def show(
    file: Annotated[Path, typer.Argument(help="Plan (JSON; or -), problem, model or assembly (TOML).")],
    what: Annotated[
        str | None, typer.Option("--what", help="Which drawing; default: the first that --list has.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--out", help="File .svg, .png or .html, or - for standard output.")
    ] = None,
    listing: Annotated[bool, typer.Option("--list", help="Say which drawings there are, and draw nothing.")] = False,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Draw models, cut-diagrams, contact states, plans: as SVG or PNG, or as a page that turns and plays offline."""
    from fmopt.desk.gallery import draw, gallery

    if listing:
        found = {name: drawing.title for name, drawing in gallery(file).items()}
        typer.echo(json.dumps(found) if as_json else "\n".join(f"{name:<12} {title}" for name, title in found.items()))
        return
    drawn = draw(file, what, out)
    if isinstance(drawn, bytes):
        typer.echo(drawn, nl=False)
    elif as_json:
        typer.echo(json.dumps({"written": [str(drawn)]}))
    elif not quiet:
        typer.echo(f"wrote {drawn}")


@app.command(epilog="Example: fmopt examples --out trial, then fmopt check trial/problems/square_peg.toml")
def examples(
    out: Annotated[Path | None, typer.Option("--out", help="Folder that gets problems/ and models/.")] = None,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Copy the shipped problems and models into a folder; without --out, say which there are."""
    from fmopt.desk import shipped

    if out is None:
        names = shipped.examples()
        typer.echo(json.dumps({"examples": names}) if as_json else "\n".join(names))
        return
    written = shipped.copy_examples(out)
    if as_json:
        typer.echo(json.dumps({"written": [str(path) for path in written]}))
    elif not quiet:
        typer.echo(f"wrote {len(written)} files to {out}")


@app.command(epilog="Example: fmopt execute out/square_peg/plan.json --trials 1000 --seed 0")
def execute(
    file: Annotated[Path, typer.Argument(help="Plan file (JSON).")],
    trials: Annotated[int, typer.Option("--trials", min=0, help="With errors inside the certified set.")] = 100,
    beyond: Annotated[int, typer.Option("--beyond", min=0, help="With errors of one to two times the set.")] = 0,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Of all that is drawn.")] = 0,
    method: Annotated[str, typer.Option("--method", help="plan, push, spiral, dither or tilt.")] = "plan",
    friction: Annotated[float | None, typer.Option("--friction", min=0, help="Default: the plan's bound.")] = None,
    time_step: Annotated[
        float | None, typer.Option("--time-step", help="Of the physics, s; by the clearance if not given.")
    ] = None,
    growth: Annotated[float, typer.Option("--growth", help="Of the moving part, m a side: interference fits.")] = 0.0,
    offset: Annotated[float, typer.Option("--offset", help="Of each start along x, m, that nobody knows of.")] = 0.0,
    again: Annotated[int | None, typer.Option("--replay", min=0, help="Draw this trial as a GIF instead.")] = None,
    out: Annotated[Path | None, typer.Option("--out", help="Folder; default: trials beside the plan.")] = None,
    workers: Annotated[int | None, typer.Option("--workers", min=1, help="Processes; default: one a core.")] = None,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Carry a plan out in a physics engine, under sampled errors (extra sim)."""
    from fmopt.console import Trials as Progress
    from fmopt.execution.execute import execute as run
    from fmopt.execution.summary import lines
    from fmopt.execution.trials import METHODS, Trials

    if method not in METHODS:
        raise typer.BadParameter(f"{method!r} is none of {', '.join(METHODS)}", param_hint="--method")
    drawn = Trials(trials, beyond, seed=seed, time_step=time_step, friction=friction)
    wanted = replace(drawn, method=method, growth=growth, offset=offset)
    folder = out if out is not None else file.parent / "trials"
    if again is not None:
        _replay(file, wanted, again, folder)
        return
    with Progress(trials + beyond, quiet or as_json) as progress:
        found = run(file, wanted, folder, workers, progress.advance)
    if as_json:
        typer.echo(json.dumps(found))
    elif not quiet:
        for line in lines(found):
            typer.echo(line)


def _replay(file: Path, wanted: Any, number: int, folder: Path) -> None:
    from fmopt import plan
    from fmopt.execution.replay import replay

    if number >= wanted.inside + wanted.beyond:
        raise typer.BadParameter(f"trial {number} of {wanted.inside + wanted.beyond}", param_hint="--replay")
    plan.prepare(folder)
    picture = folder / f"trial_{number}.gif"
    record = replay(plan.read(file), wanted, number, picture)
    typer.echo(f"{picture}: {'seated' if record['success'] else ', '.join(record['reasons'])}")


@app.command(epilog="Example: fmopt compare out/square_peg/plan.json --trials 200")
def compare(
    files: Annotated[list[Path], typer.Argument(help="Plan files (JSON).")],
    trials: Annotated[int, typer.Option("--trials", min=1, help="Of each method, with errors inside.")] = 100,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Of all that is drawn.")] = 0,
    out: Annotated[Path | None, typer.Option("--out", help="Folder; default: compared beside the first plan.")] = None,
    workers: Annotated[int | None, typer.Option("--workers", min=1, help="Processes; default: one a core.")] = None,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Carry plans out beside what people do without one: push, spiral, random search, a tilt by hand (extra sim)."""
    from fmopt.console import Trials as Progress
    from fmopt.console import print_compared
    from fmopt.execution.execute import compare as run
    from fmopt.execution.trials import METHODS

    folder = out if out is not None else files[0].parent / "compared"
    with Progress(len(files) * len(METHODS) * trials, quiet or as_json) as progress:
        rows = run(files, trials, seed, folder, workers, progress.advance)
    if as_json:
        typer.echo(json.dumps(rows))
    elif not quiet:
        print_compared(rows)


@app.command(epilog="Example: fmopt schema problem > problem.schema.json")
def schema(
    kind: Annotated[str, typer.Argument(help="problem, model, assembly, study or allocation.")] = "problem",
) -> None:
    """Print the JSON Schema of such files, for editors that complete and check as you type."""
    from fmopt.study import schema as of_studies
    from fmopt.task import schema as schemas

    kinds = {
        "problem": schemas.problem_schema,
        "model": schemas.model_schema,
        "assembly": schemas.assembly_schema,
        "study": of_studies.study_schema,
        "allocation": of_studies.allocation_schema,
    }
    found = kinds.get(kind)
    if found is None:
        raise typer.BadParameter(f"{kind!r} is none of {', '.join(kinds)}", param_hint="kind")
    typer.echo(schemas.text(found()), nl=False)


class _Study(typer.core.TyperGroup):
    """`fmopt study FILE…` is `fmopt study run FILE…`."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        if args and args[0] not in (*self.commands, "--help"):
            args = ["run", *args]
        return super().parse_args(ctx, args)


studies = typer.Typer(cls=_Study, no_args_is_help=True, rich_markup_mode=None)
app.add_typer(studies, name="study", help="Run a study over many problems, resumable; or report on its results.")


@studies.command("run", epilog="Example: fmopt study problems/studies/square_peg.toml --jobs 2")
def study_run(
    files: Annotated[list[Path], typer.Argument(help="Study files (TOML), one after the other.")],
    out: Annotated[Path | None, typer.Option("--out", help="Folder for the results; default: out/<study>.")] = None,
    jobs: Annotated[int | None, typer.Option(min=1, help="Processes; default: one for each processor.")] = None,
    limit: Annotated[int | None, typer.Option(min=0, help="Runs to do at most now.")] = None,
    retry_failed: Annotated[bool, typer.Option("--retry-failed", help="Do failed runs again.")] = False,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Show the runs and an estimate of time, and stop.")
    ] = False,
    cluster: Annotated[str | None, typer.Option(help="Address of a Dask scheduler, tcp://…, to work there.")] = None,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Run a study, or go on with one that was interrupted: what is done is not done again."""
    from fmopt.console import Runs
    from fmopt.study import command

    if out is not None and len(files) > 1:
        raise typer.BadParameter("several studies cannot share one folder", param_hint="--out")
    for file in files:
        folder = out if out is not None else Path("out") / file.stem
        if command.allocates(file):
            if cluster is not None or limit is not None or retry_failed:
                raise typer.BadParameter("an allocation is one piece of work on this machine", param_hint=str(file))
            _allocate(file, folder, dry_run, as_json, quiet)
            continue
        if dry_run:
            found = command.forecast(file, folder, jobs)
            typer.echo(json.dumps(asdict(found)) if as_json else _foretold(file, found))
            continue
        with Runs(file.stem, quiet or as_json) as progress:
            tally = command.carry_out(file, folder, command.Asked(jobs, limit, retry_failed, cluster), progress)
        if as_json:
            typer.echo(json.dumps({**asdict(tally), "folder": str(folder)}))
        elif not quiet:
            typer.echo(_told(tally, folder))
        if tally.interrupted:
            raise typer.Exit(128 + tally.interrupted)


def _allocate(file: Path, folder: Path, dry_run: bool, as_json: bool, quiet: bool) -> None:
    from fmopt.console import Stages
    from fmopt.study import command

    if dry_run:
        record, words = command.asked_for(file)
    else:
        with Stages(quiet or as_json) as stages:
            record, words = command.allocated(file, folder, stages)
        record = {**record, "folder": str(folder)}
    if as_json or not quiet:
        typer.echo(json.dumps(record) if as_json else "\n".join(words))
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
        if as_json:
            typer.echo(json.dumps({"folder": str(folder), "written": written}))
        elif not quiet:
            typer.echo("wrote " + ", ".join(written))


def _foretold(file: Path, found: Any) -> str:
    from fmopt.console import duration

    lines = [f"{file}: {found.total} runs, {found.done} of them done", *found.listing]
    if found.seconds is None:
        return "\n".join([*lines, f"no estimate of time: {found.source}"])
    return "\n".join(
        [*lines, f"{duration(found.seconds)} a run, by {found.source}; {duration(found.rest)} for the rest"]
    )


def _told(tally: Any, folder: Path) -> str:
    from fmopt.console import duration

    left = tally.total - tally.done
    words = f"{tally.done} of {tally.total} runs done"
    words += f", {tally.failed} of them failed (--retry-failed does them again)" if tally.failed else ""
    words += f"; {tally.fresh} now, in {duration(tally.seconds)}" if tally.fresh else ""
    words = f"interrupted: {words}; the same command goes on" if tally.interrupted else words
    words += f"; {left} left" if left and not tally.interrupted else ""
    return f"{words}\nwrote {folder / 'table.csv'}"


def _write_report(document: dict[str, Any], folder: Path) -> None:
    from fmopt import plan
    from fmopt.report.figures import figures
    from fmopt.report.page import report_page

    drawn = figures(document)
    for name, svg in drawn.items():
        plan.save(svg.encode(), folder / "figures" / f"{name}.svg")
    plan.save(report_page(document, drawn).encode(), folder / "report.html")


def _summary(document: dict[str, Any], verdict: Any, folder: Path) -> dict[str, Any]:
    least = min(segment["margin"] for segment in document["segments"])
    return {
        **_findings(verdict),
        **_margins(document),
        "verdict": document["verdict"],
        "margin" if document["verdict"] == "CERTIFIED" else "computed_margin": least,
        "segments": len(document["segments"]),
        "moves": document["search"]["moves"],
        "plan": str(folder / "plan.json"),
    }


def _findings(verdict: Any) -> dict[str, Any]:
    """A verdict as JSON: every finding in words and as data, the collision when there is one."""
    return {
        "verdict": str(verdict.verdict),
        "findings": [str(finding) for finding in verdict.findings],
        "details": [asdict(finding) for finding in verdict.findings],
        "collision": None if verdict.witness is None else asdict(verdict.witness),
        "not_covered": list(verdict.not_covered),
    }


def _margins(document: dict[str, Any]) -> dict[str, Any]:
    """What each segment states, in m; stated, not proved, unless the verdict is CERTIFIED."""
    keys = ("move", "margin", "clearance", "binding_contact")
    return {"segment_margins": [{key: segment[key] for key in keys} for segment in document["segments"]]}


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
