"""What is asked for without a problem file: two parts, or an assembly, and a start error."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from fmopt.cli.entry import answer, say
from fmopt.notebook.asking import Asked, of_assembly, wrong
from fmopt.notebook.parts import holds_several, is_part
from fmopt.task.toml.source import read

if TYPE_CHECKING:
    from fmopt.geometry.part import Part
    from fmopt.task.problem import Problem

PROBLEM = "problem.toml"
_EXAMPLE = 'fmopt solve peg.step plate.step --error "1 mm, 1 deg"'
_WARNING = "warning: "

Options = tuple[str | None, str | None, str | None, str | None]  # --error, --unit, --moving and --fixed


def asked_problem(files: Sequence[Path], options: Options) -> Asked | None:
    """The question that files and options ask; None for a problem file. Where they do not go together: an example."""
    error, unit, moving, fixed = options
    if len(files) > 2:
        advice = f"name a problem file, or two parts: {_EXAMPLE}"
        raise wrong(files[2], "too-many", f"{len(files)} files are named", advice)
    parts = [is_part(file) for file in files]
    if len(files) == 1 and not parts[0]:
        for option, value in zip(("--error", "--unit", "--moving", "--fixed"), options, strict=True):
            if value is not None:
                read(files[0])  # what it refuses is neither
                message = f"{option} is for parts without a problem file, and this is one"
                raise wrong(files[0], "conflict", message, f"leave {option} out and state it in the file")
        return None
    if not all(parts):
        other = files[parts.index(False)]
        read(other)  # what it refuses is neither
        message = "this is no part but a problem or an assembly file"
        raise wrong(other, "file-kind", message, f"name it alone, or two parts: {_EXAMPLE}")
    if len(files) == 2 and files[0].absolute() == files[1].absolute():
        advice = f"name the part that moves and the one that stays: {_EXAMPLE}"
        raise wrong(files[0], "same-part", "this part is named twice", advice)
    single = len(files) == 1
    if single and files[0].suffix.lower() not in {".obj", ".glb", ".3mf"} and not holds_several(files[0]):
        message = "this is one part, and an insertion takes two"
        raise wrong(files[0], "one-part", message, f"name the other one, too: {_EXAMPLE}")
    if error is None:
        message = "how far off the part may start is not stated, and nobody but you can know it"
        raise wrong(files[0], "missing-error", message, f'add --error "1 mm, 1 deg": {_EXAMPLE}')
    if single:
        return of_assembly(files[0], error, moving, fixed, unit)
    return Asked((files[0], files[1]), error, (unit, unit), (moving, fixed))


def problem_in(folder: Path, files: Sequence[Path], options: Options, quiet: bool) -> "Problem":
    """The problem that files and options ask for, its file written into the folder of the results."""
    from fmopt.runtime import output
    from fmopt.task.problem import load

    asked = asked_problem(files, options)
    if asked is None:
        return load(files[0])
    output.prepare(folder)
    problem = asked.written(folder / PROBLEM)
    if not quiet:
        told(problem)
    return problem


def told(problem: "Problem") -> None:
    """Says what a user has to know of how the parts were taken, on standard error."""
    for part in (problem.moving, problem.fixed):
        for note in part.notes:
            if note.startswith(_WARNING):
                say(note, err=True)


def written(asked: Asked, target: Path, stated: bool) -> list[Path]:
    """Writes the problem file of a question, what is found as comments in it, whether or not the error is `stated`."""
    from fmopt.notebook.found import commented
    from fmopt.planning.pipeline import tried
    from fmopt.runtime import output

    if target.exists():
        raise wrong(target, "file-there", "this file is there already", "name another one with --out, or remove it")
    # Written twice: what is put into it as comments is found by reading it as any other problem file.
    problem = asked.written(target)
    try:
        clearance = tried(problem)
    except BaseException:
        # Without its comments it is not what was asked for, and the next try would be refused for its sake.
        target.unlink()
        raise
    output.save(commented(asked, target.parent, problem, clearance, stated).encode(), target)
    told(problem)
    return [target, draw_found((problem.moving, problem.fixed), target.with_suffix(".svg"))]


def draw_found(parts: "Sequence[Part]", target: Path) -> Path:
    """Draws what was taken for what on parts."""
    from fmopt.report.views import part_view

    return part_view.drawing("found", *parts).save(target)


def check_part(file: Path, unit: str | None, out: Path | None, form: tuple[bool, bool]) -> None:
    """Says what is found on one part, as JSON or not at all by `form`, and draws it where that is asked for."""
    from fmopt.notebook.parts import load_part, part_facts, part_words

    parts = load_part(file, unit)
    drawn = [] if out is None else [draw_found(parts, out)]
    facts = {"valid": True, "parts": [part_facts(part) for part in parts], "written": [str(path) for path in drawn]}
    hint = f"drawn by: fmopt check {file} --out {file.stem}.svg" if out is None else f"wrote {out}"
    answer(facts, "\n".join([str(file), *map(part_words, parts), hint]), *form)
