"""`fmopt solve`, `verify`, `check` and `schema`."""

import json
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeAlias

import typer

from fmopt.cli.entry import EXIT, Json, Quiet, answer, app, compile_kernels, say, wrote
from fmopt.errors import FmoptError, InfeasibleError, PlanFormatError, ResourceError, SearchError
from fmopt.plan import STDIO, Plan

if TYPE_CHECKING:
    from fmopt.task.toml.tables import Table
    from fmopt.verify import Verdict
    from fmopt.verify.reading import document as proof


Wanted: TypeAlias = Literal["tested", "certified"]
Error = Annotated[str | None, typer.Option("--error", help='Start error without a problem file: "1 mm, 1 deg".')]
MeshUnit = Annotated[str | None, typer.Option("--unit", help="Of the numbers of mesh files; mm if not given.")]
Moving = Annotated[str | None, typer.Option("--moving", help="Body of an assembly (STEP) that moves: name or number.")]
Fixed = Annotated[str | None, typer.Option("--fixed", help="Body of an assembly that stays: name or number.")]
Parts = Annotated[
    list[Path],
    typer.Argument(help="PEG HOLE: mesh, STEP or model files; or one STEP file of an assembly.", metavar="PEG HOLE"),
]


@app.command(epilog='Examples: fmopt solve problems/square_peg.toml; fmopt solve PEG HOLE --error "1 mm, 1 deg"')
def solve(
    files: Annotated[
        list[Path],
        typer.Argument(
            help="Problem file (TOML; or -); or PEG HOLE: mesh, STEP or model files, or one assembly, with --error.",
            metavar="FILE | PEG HOLE",
        ),
    ],
    error: Error = None,
    unit: MeshUnit = None,
    moving: Moving = None,
    fixed: Fixed = None,
    out: Annotated[Path | None, typer.Option("--out", help="Folder for the results; default: out/<problem>.")] = None,
    report: Annotated[bool, typer.Option("--report", help="Write report.html and its figures, too.")] = False,
    evidence: Annotated[Wanted | None, typer.Option("--evidence", help="Default: as the problem asks for.")] = None,
    trials: Annotated[
        int | None, typer.Option("--trials", min=0, max=10_000, help="Draws to carry the plan out with; 0: none.")
    ] = None,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Plan an insertion, check the certificate, write plan.json."""
    from fmopt import plan
    from fmopt.cli.console import print_solved, stages
    from fmopt.planning.pipeline import RESERVED, synthesise
    from fmopt.runtime import output
    from fmopt.runtime.clock import clock
    from fmopt.runtime.compiled import announce
    from fmopt.task.mesh_source import MESHES
    from fmopt.task.problem import load

    folder = out if out is not None else Path("out") / _stem(files)
    options = (error, unit, moving, fixed)
    # The usual case is known by its name alone; for the others all that finds its way about parts is loaded.
    if len(files) == 1 and options == (None,) * 4 and files[0].suffix.lower() not in MESHES:
        problem = load(files[0])
        output.prepare(folder)
    else:
        from fmopt.cli.asked import problem_in

        problem = problem_in(folder, files, options, quiet)
    if evidence is not None:
        problem = replace(problem, settings=replace(problem.settings, evidence=evidence))
    if trials is not None:
        problem = replace(problem, settings=replace(problem.settings, draws=trials))
    with stages(quiet or as_json) as progress:
        announce(progress)
        compile_kernels(progress)
        begun = clock()
        try:
            result = synthesise(problem, progress, RESERVED).carried_out(problem.settings, progress)
        except FmoptError as error:
            kept = output.set_aside(folder, ("plan.json", "timings.json", "report.html"))
            lines = [f"the {path.name.removeprefix('earlier-')} of an earlier run is now {path}" for path in kept]
            if isinstance(error, SearchError | InfeasibleError):
                from fmopt.notebook.failure import explained, write

                lines += [f"wrote {path}" for path in write(explained(problem, error, begun, progress), folder)]
            if lines and not (quiet or as_json):
                say("\n".join(lines))
            raise
    # Nobody is to take what an earlier run left for this one's; a report that is written now replaces the old one.
    output.set_aside(folder, ("attempt.html",) if report else ("attempt.html", "report.html"))
    plan.write(result.document, folder / "plan.json")
    output.save(f"{json.dumps(result.seconds, indent=1)}\n".encode(), folder / "timings.json")
    if report:
        _write_report(result.plan, folder)
    if as_json:
        typer.echo(json.dumps(_summary(result.plan, result.verdict, folder)))
    elif not quiet:
        print_solved(result.plan, [*map(str, result.verdict.findings)], folder, report)
    raise typer.Exit(0 if result.plan.verdict == "TESTED" else EXIT[result.plan.verdict])


def _stem(files: list[Path]) -> str:
    """What results are called after."""
    return "stdin" if files[0] == STDIO else "_".join(file.stem for file in files)


def _write_report(found: Plan, folder: Path) -> None:
    from fmopt.report.figures import figures
    from fmopt.report.page import report_page
    from fmopt.runtime import output

    drawn = figures(found)
    for name, svg in drawn.items():
        output.save(svg.encode(), folder / "figures" / f"{name}.svg")
    output.save(report_page(found, drawn).encode(), folder / "report.html")


def _summary(plan: Plan, verdict: "Verdict", folder: Path) -> dict[str, Any]:
    found = {**_findings(verdict), "verdict": plan.verdict, "plan": str(folder / "plan.json")}
    if plan.press_plan is not None:
        evidence = {} if plan.evidence is None else asdict(plan.evidence)
        counts = {name: value for name, value in evidence.items() if not name.endswith(("outcomes", "seconds"))}
        if plan.trials is not None:
            counts |= {"cycle_times": plan.trials.cycle_times, "distance": plan.trials.distance}
        return {**found, "presses": plan.presses, "attempts": len(plan.press_plan.attempts), "evidence": counts}
    return {
        **found,
        **_margins(plan),
        "margin" if plan.verdict == "CERTIFIED" else "computed_margin": min(s.margin for s in plan.segments),
        "segments": len(plan.segments),
        "moves": list(plan.description.search.moves) if plan.description.search is not None else [],
        "carried_out": None if plan.description.carried_out is None else asdict(plan.description.carried_out),
    }


def _findings(verdict: "Verdict") -> dict[str, Any]:
    """A verdict as JSON: every finding in words and as data, the collision when there is one."""
    return {
        "verdict": str(verdict.verdict),
        "stated_verdict": verdict.stated,
        "findings": [str(finding) for finding in verdict.findings],
        "details": [asdict(finding) for finding in verdict.findings],
        "collision": None if verdict.witness is None else asdict(verdict.witness),
        "taken_from_the_planner": list(verdict.taken),
        "not_covered": list(verdict.not_covered),
    }


def _margins(plan: "proof.StatedPlan") -> dict[str, Any]:
    """What each segment states, in m; stated, not proved, unless the verdict is CERTIFIED."""
    keys = {"move": "move", "margin": "margin", "clearance": "clearance", "binding_contact": "binding"}
    return {"segment_margins": [{key: getattr(s, name) for key, name in keys.items()} for s in plan.segments]}


@app.command(epilog="Example: fmopt verify out/square_peg/plan.json --problem problems/square_peg.toml")
def verify(
    file: Annotated[Path, typer.Argument(help="Plan file (JSON); - for standard input.")],
    problem: Annotated[Path | None, typer.Option(help="Problem file that the plan must belong to.")] = None,
    evidence: Annotated[Wanted, typer.Option("--evidence", help="What is asked of the plan.")] = "certified",
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Check a plan's certificate from its own geometry, in exact arithmetic; with --problem, that it is of that one."""
    from fmopt import plan
    from fmopt import verify as independent
    from fmopt.verify.reading.parse import parse

    if file != STDIO and not file.is_file():
        what = "is no file" if file.exists() else "no such file"
        raise ResourceError(f"{file}: {what}", "give the plan.json of a solved problem")
    document = plan.read_document(file)
    try:
        read = parse(document)
        verdict = independent.judge(read)
        if problem is not None:
            from fmopt.planning.same_problem import REMARK, differences
            from fmopt.task.problem import load

            verdict = verdict.unless(differences(plan.parsed(document), load(problem)), (REMARK,))
    except independent.PlanError as error:
        raise PlanFormatError(f"{file}: {error}", "give a plan.json that fmopt solve wrote") from error
    answer({**_findings(verdict), **_margins(read)}, "\n".join(verdict.lines()), as_json, quiet)
    enough = evidence == "tested" and str(verdict.verdict) == "TESTED"
    raise typer.Exit(0 if enough else EXIT[str(verdict.verdict)])


@app.command(epilog='Example: fmopt init peg.step plate.step --error "1 mm, 1 deg"')
def init(
    files: Parts,
    error: Error = None,
    unit: MeshUnit = None,
    moving: Moving = None,
    fixed: Fixed = None,
    out: Annotated[Path | None, typer.Option("--out", help="File to write; default: <peg>_<hole>.toml here.")] = None,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Write the problem file for two parts, with what is found on them as comments, and a drawing of it."""
    from fmopt.cli.asked import asked_problem, written
    from fmopt.notebook.asking import wrong

    target = out if out is not None else Path(f"{_stem(files)}.toml")
    asked = asked_problem(files, (error or "1 mm, 1 deg", unit, moving, fixed))
    if asked is None:
        advice = f"check it with fmopt check {files[0]}"
        raise wrong(files[0], "file-kind", "this is a problem file already", advice)
    paths = written(asked, target, stated=error is not None)
    wrote(paths, as_json, quiet)
    if not (as_json or quiet):
        say(f"next: fmopt check {paths[0]}, then fmopt solve {paths[0]}")


@app.command(epilog="Example: fmopt check problems/square_peg.toml, or fmopt check peg.step --out peg.svg")
def check(
    file: Annotated[
        Path, typer.Argument(help="Problem or assembly (TOML; or - for standard input); a part: mesh, STEP or model.")
    ],
    unit: MeshUnit = None,
    out: Annotated[Path | None, typer.Option("--out", help="Drawing of what was found: .svg, .png, .html.")] = None,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Validate a problem file with all models, an assembly and each of its tasks, or one part; say it back in words."""
    from fmopt.cli.asked import check_part, draw_found
    from fmopt.notebook.parts import is_part

    if is_part(file):
        check_part(file, unit, out, (as_json, quiet))
        return
    from fmopt.planning.pipeline import tried
    from fmopt.task.assembly import carried_out, is_assembly, load_assembly
    from fmopt.task.explain import assembly_facts, explain, explain_assembly, facts
    from fmopt.task.problem import load

    if is_assembly(file):
        assembly = load_assembly(file)
        steps = list(carried_out(assembly))
        answer(assembly_facts(assembly, steps), explain_assembly(assembly, steps), as_json, quiet)
        return
    problem = load(file)
    clearance = tried(problem)
    drawn = [] if out is None else [draw_found((problem.moving, problem.fixed), out)]
    words = "\n".join([explain(problem, clearance), *(f"wrote {path}" for path in drawn)])
    answer({**facts(problem, clearance), "written": [str(path) for path in drawn]}, words, as_json, quiet)


@app.command(epilog="Example: fmopt schema problem > problem.schema.json")
def schema(
    kind: Annotated[str, typer.Argument(help="problem, model, assembly, study or allocation.")] = "problem",
) -> None:
    """Print the JSON Schema of such files, for editors that complete and check as you type."""
    from fmopt.study.study_file import AllocationFile, StudyFile
    from fmopt.task.toml.assembly_file import AssemblyFile
    from fmopt.task.toml.model_file import ModelFile
    from fmopt.task.toml.problem_file import ProblemFile

    kinds: dict[str, type[Table]] = {"problem": ProblemFile, "model": ModelFile, "assembly": AssemblyFile}
    kinds |= {"study": StudyFile, "allocation": AllocationFile}
    if (found := kinds.get(kind)) is None:
        raise typer.BadParameter(f"{kind!r} is none of {', '.join(kinds)}", param_hint="kind")
    dialect = {"$schema": "https://json-schema.org/draft/2020-12/schema"}
    typer.echo(json.dumps({**dialect, **found.model_json_schema()}, indent=2, ensure_ascii=False))
