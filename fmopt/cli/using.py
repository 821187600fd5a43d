"""What is done with a plan: `fmopt export`, `show`, `examples`, `execute`, `compare`; and `fmopt manual`."""

import json
from dataclasses import asdict, replace
from pathlib import Path
from typing import Annotated, Any

import typer

from fmopt.cli.entry import MOST_TRIALS, Json, Quiet, Unverified, Workers, answer, app, say, wrote
from fmopt.plan import STDIO


@app.command(epilog="Example: fmopt export plan.json --to urscript --base 0.4 -0.1 0.2 0 0 0")
def export(
    file: Annotated[Path, typer.Argument(help="Plan file (JSON); - for standard input.")],
    to: Annotated[
        str,
        typer.Option(
            "--to",
            help="urscript or ros2: the motion to run; csv or json: the nominal position/force trajectory straight in, "
            "a table to look at and not to run; mjcf: a scene with both parts for simulators, as --mjcf.",
        ),
    ] = "",
    mjcf: Annotated[bool, typer.Option("--mjcf", help="The same as --to mjcf.")] = False,
    out: Annotated[Path | None, typer.Option("--out", help="File, or - for standard output; of ros2 a folder.")] = None,
    base: Annotated[
        tuple[float, float, float, float, float, float] | None,
        typer.Option(
            "--base",
            help="Pose of the hole's frame, z out of the hole, in the robot's base: m, and a rotation vector in rad, "
            "which is 0 0 0 for a hole open upwards.",
        ),
    ] = None,
    rate: Annotated[float, typer.Option("--rate", help="Samples a second of csv and json.")] = 100.0,
    unverified: Unverified = False,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Write a certified plan for robots, or its nominal position/force trajectory as a table."""
    from fmopt.plan.export.write import Form, place
    from fmopt.plan.export.write import export as write

    if as_json and out == STDIO:
        raise typer.BadParameter("--json lists the files that were written, --out - writes none: leave one of them out")
    if bool(to) == mjcf:
        raise typer.BadParameter("name one format", param_hint="--to")
    try:
        form, target = Form(to or "mjcf", base, rate), place(file, to or "mjcf", out)
        plan, caution = _admitted(file, unverified)
        if form.to == "mjcf":
            from fmopt.execution.mjcf import mjcf as scene

            form = replace(form, scene=scene)
        written = write(plan, replace(form, caution=caution), target)
    except ValueError as error:
        raise typer.BadParameter(str(error)) from error
    if as_json:
        notes = [caution] * bool(caution) + list(written.notes)
        typer.echo(json.dumps({"written": [str(path) for path in written.paths], "notes": notes}))
        return
    typer.echo(written.text, nl=False)
    if not quiet:
        for path in written.paths:
            typer.echo(str(path))
        for note in written.notes:
            say(note, err=True)


evidence = typer.Typer(no_args_is_help=True, rich_markup_mode=None)
app.add_typer(evidence, name="evidence", help="Put trials on a robot of your own beside those in the physics engine.")


@evidence.command("add", epilog="Example: fmopt evidence add out/square_peg/plan.json trials.csv")
def evidence_add(
    file: Annotated[Path, typer.Argument(help="Plan file (JSON), to which they are added.")],
    trials: Annotated[Path, typer.Argument(help="CSV: a column outcome, seated or failed; seconds where known.")],
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Add trials on a robot to a plan: how many seat, the bound of their rate, and whether simulation disagrees."""
    from fmopt.notebook.own_trials import with_trials
    from fmopt.plan import parsed, write
    from fmopt.report.presses import own_words

    if file == STDIO:
        raise typer.BadParameter("name the file of the plan, which is changed", param_hint="FILE")
    document = with_trials(file, trials)
    write(document, file)
    plan = parsed(document)
    answer(asdict(plan.description.own_trials[-1]), own_words(plan)[-1], as_json, quiet)


def _admitted(file: Path, unverified: bool) -> tuple[Any, str]:
    """A plan that the check certifies, or what is said of it, on standard error, too, as the check was not asked."""
    from fmopt.notebook.checking import admitted
    from fmopt.plan import read

    plan = read(file)
    caution = admitted(plan, unverified, str(file))
    if caution:
        say(f"{file}: {caution}", err=True)
    return plan, caution


@app.command(epilog="Examples: fmopt show models/square_peg.toml; fmopt show out/square_peg/plan.json --what states")
def show(
    file: Annotated[Path, typer.Argument(help="Plan (JSON; or -), problem, model or assembly (TOML), mesh or STEP.")],
    what: Annotated[str | None, typer.Option("--what", help="Which drawing; default: first of --list.")] = None,
    out: Annotated[Path | None, typer.Option("--out", help="File .svg, .png, .html; or - for standard output.")] = None,
    listing: Annotated[bool, typer.Option("--list", help="Say which drawings there are, and draw nothing.")] = False,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Draw models, cut-diagrams, contact states, plans: as SVG or PNG, or as a page that turns and plays offline."""
    from fmopt.notebook.gallery import draw, gallery

    if listing:
        found = {name: drawing.title for name, drawing in gallery(file).items()}
        say(json.dumps(found) if as_json else "\n".join(f"{name:<12} {title}" for name, title in found.items()))
        return
    drawn = draw(file, what, out)
    if isinstance(drawn, bytes):
        typer.echo(drawn, nl=False)
    else:
        wrote([drawn], as_json, quiet)


@app.command(epilog="Example: fmopt examples --out trial, then fmopt check trial/problems/square_peg.toml")
def examples(
    out: Annotated[Path | None, typer.Option("--out", help="Folder that gets problems/ and models/.")] = None,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Copy the shipped problems and models into a folder; without --out, say which there are."""
    from fmopt.notebook import shipped

    if out is None:
        names = shipped.examples()
        typer.echo(json.dumps({"examples": names}) if as_json else "\n".join(names))
        return
    written = shipped.copy_examples(out)
    answer({"written": [str(path) for path in written]}, f"wrote {len(written)} files to {out}", as_json, quiet)


@app.command(epilog="Example: fmopt execute out/square_peg/plan.json --trials 1000 --seed 0")
def execute(
    file: Annotated[Path, typer.Argument(help="Plan file (JSON).")],
    trials: Annotated[
        int | None,
        typer.Option("--trials", min=0, max=MOST_TRIALS, help="Errors inside the set; default: 100, of --worst 256."),
    ] = None,
    beyond: Annotated[int, typer.Option("--beyond", min=0, max=MOST_TRIALS, help="Errors of 1 to 2 times it.")] = 0,
    seed: Annotated[
        int | None, typer.Option("--seed", min=0, help="Default: 0; of presses a new one, that of --replay theirs.")
    ] = None,
    method: Annotated[str, typer.Option("--method", help="plan, push, spiral, dither or tilt.")] = "plan",
    friction: Annotated[float | None, typer.Option("--friction", help="Default: the plan's bound.")] = None,
    time_step: Annotated[float | None, typer.Option("--time-step", help="s; default: by the clearance.")] = None,
    growth: Annotated[float, typer.Option("--growth", help="Of the moving part, m a side: interference fits.")] = 0.0,
    offset: Annotated[float, typer.Option("--offset", help="Of each start along x, m, that nobody knows of.")] = 0.0,
    recovery: Annotated[
        bool, typer.Option("--recovery/--no-recovery", help="Back off and try again as the plan says, or fail.")
    ] = True,
    covered: Annotated[bool, typer.Option("--covered", help="Errors beyond are those that retries cover.")] = False,
    engine: Annotated[str, typer.Option("--engine", help="mujoco, or drake for a second opinion.")] = "mujoco",
    again: Annotated[int | None, typer.Option("--replay", min=0, help="Draw this trial as a GIF instead.")] = None,
    hardest: Annotated[
        bool, typer.Option("--worst", help="Search what presses are drawn from for trials that fail instead.")
    ] = False,
    out: Annotated[Path | None, typer.Option("--out", help="Folder; default: trials beside the plan.")] = None,
    workers: Workers = None,
    unverified: Unverified = False,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Carry a certified or tested plan out in a physics engine, under sampled errors (MuJoCo, or extra drake)."""
    from fmopt.cli.console import trials as shown
    from fmopt.execution.engines.catalogue import ENGINES
    from fmopt.execution.execute import TrialSettings
    from fmopt.execution.execute import execute as run
    from fmopt.execution.summary import lines
    from fmopt.execution.trials import METHODS, Trials
    from fmopt.execution.worst import worst
    from fmopt.plan.evidence import MAX_EXAMINED
    from fmopt.report.worst import worst_lines

    trials = (256 if hardest else 100) if trials is None else trials
    if hardest and (not trials or beyond or again is not None or method != "plan"):
        raise typer.BadParameter("give it trials, and none of --beyond, --replay, --method", param_hint="--worst")
    for option, given, known in (("--method", method, METHODS), ("--engine", engine, ENGINES)):
        if given not in known:
            raise typer.BadParameter(f"{given!r} is none of {', '.join(known)}", param_hint=option)
    if trials + beyond == 0:
        raise typer.BadParameter("no trials, neither inside nor --beyond the set", param_hint="--trials")
    drawn = Trials(trials, beyond, seed=seed or 0, time_step=time_step, friction=friction, engine=engine)
    wanted = replace(drawn, method=method, growth=growth, offset=offset, recovery=recovery, covered=covered)
    # That it is not installed is told before the plan is checked, which takes longer.
    ENGINES[engine].library()
    folder = out if out is not None else (Path() if file == STDIO else file.parent) / "trials"
    plan, caution = _admitted(file, unverified)
    if seed is None and plan.trials is not None:
        # Draws of the evidence are repeated one by one; a rate is that of new ones, which no examined plan had.
        wanted = replace(wanted, seed=plan.trials.seed + (MAX_EXAMINED if again is None else 0))
    if again is not None:
        _replay(plan, wanted, again, folder)
        return
    with shown(trials + beyond, quiet or as_json) as advance:
        found = (worst if hardest else run)(plan, wanted, TrialSettings(folder, workers, advance), caution)
    answer(found, "\n".join((worst_lines if hardest else lines)(found)), as_json, quiet)


def _replay(plan: Any, wanted: Any, number: int, folder: Path) -> None:
    from fmopt.execution.replay import replay
    from fmopt.runtime import output

    if number >= wanted.inside + wanted.beyond:
        raise typer.BadParameter(f"trial {number} of {wanted.inside + wanted.beyond}", param_hint="--replay")
    output.prepare(folder)
    picture = folder / f"trial_{number}.gif"
    record = replay(plan, wanted, number, picture)
    typer.echo(f"{picture}: {'seated' if record['success'] else ', '.join(record['reasons'])}")


@app.command(epilog="Example: fmopt compare out/square_peg/plan.json --trials 200")
def compare(
    files: Annotated[list[Path], typer.Argument(help="Plan files (JSON).")],
    trials: Annotated[int, typer.Option("--trials", min=1, max=MOST_TRIALS, help="Of each method, inside.")] = 100,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Of all that is drawn.")] = 0,
    out: Annotated[Path | None, typer.Option("--out", help="Folder; default: compared beside the first plan.")] = None,
    workers: Workers = None,
    unverified: Unverified = False,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Carry certified plans out beside what people do without one, as push, spiral, search, tilt."""
    from fmopt.cli.console import print_compared
    from fmopt.cli.console import trials as shown
    from fmopt.execution.execute import TrialSettings
    from fmopt.execution.execute import compare as run
    from fmopt.execution.trials import METHODS

    folder = out if out is not None else (Path() if files[0] == STDIO else files[0].parent) / "compared"
    # All of them before the first is carried out: one that is refused costs no trials.
    plans = [_admitted(file, unverified)[0] for file in files]
    with shown(len(files) * len(METHODS) * trials, quiet or as_json) as advance:
        rows = run(plans, trials, seed, TrialSettings(folder, workers, advance))
    if as_json:
        typer.echo(json.dumps(rows))
    elif not quiet:
        print_compared(rows)


@app.command(epilog="Example: fmopt manual --out manual.html")
def manual(
    out: Annotated[Path, typer.Option("--out", help="File .html; or - for standard output.")] = Path("manual.html"),
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Write the manual as one page of HTML that opens and is searched offline."""
    from fmopt.manual import manual as book
    from fmopt.runtime import output

    if out == STDIO:
        typer.echo(book(), nl=False)
        return
    output.save(book().encode(), out)
    wrote([out], as_json, quiet)
