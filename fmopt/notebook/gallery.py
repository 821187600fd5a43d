"""What `fmopt show` draws of a file: of a plan, a problem, a model, or the tasks of an assembly."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fmopt.errors import ChoiceError
from fmopt.notebook.drawing import drawings
from fmopt.notebook.parts import is_part, load_part
from fmopt.plan import STDIO
from fmopt.report.drawing import SUFFIXES, Drawing
from fmopt.task.toml.source import read

if TYPE_CHECKING:
    from fmopt.task.object_model.command import Answer

# What people call drawings of a plan, beside their names.
_SAID = {"moves": "cut", "motion": "scene", "3d": "scene", "graph": "states", "margins": "margin", "errors": "tube"}
_RHO = 0.01  # m: an assembly states no errors, so that the characteristic length plays no part


def gallery(file: Path) -> Mapping[str, Drawing]:
    """The drawings that there are of a plan, problem, model, assembly or part, by name, made when asked for."""
    if file == STDIO or file.suffix.lower() == ".json":
        from fmopt.notebook.plan import read as read_plan

        return drawings(read_plan(file))
    if is_part(file):
        bodies = load_part(file)
        if len(bodies) == 1:
            return drawings(bodies[0])
        said = [body.name for body in bodies]
        if len({*said}) < len(said):  # with numbers, as two of one screw have one name
            said = [f"{name}-{k}" for k, name in enumerate(said, 1)]
        pairs = zip(said, bodies, strict=True)
        found = {f"{body}-{name}": drawing for body, part in pairs for name, drawing in drawings(part).items()}
        return {name: replace(drawing, name=name) for name, drawing in found.items()}
    if {"objects", "tasks"} & set(read(file).data):
        return _tasks(file)
    from fmopt.notebook.problem import load

    return drawings(load(file))


def draw(file: Path, what: str | None, out: Path | None) -> bytes | Path:
    """Draws a file by the name of a drawing, or what people call it, as "motion", else the first; gives what it wrote.

    The ending of `out` says the format. "-" gives the bytes of SVG, or of HTML for what moves; None writes a file named
    after both into the current folder.

    Raises:
        ChoiceError: there is no such drawing, or not in this format.
        ResourceError: it cannot be written.
        FmoptError: the file cannot be read or drawn.
    """
    found = gallery(file)
    name = what or next(iter(found))
    name = name if name in found else _SAID.get(name.lower(), name)
    if name not in found:
        advice = f"choose from {', '.join(found)}; fmopt show {file} --list says what each shows"
        raise ChoiceError(f"{file}: no drawing {name!r} of it", advice)
    drawing = found[name]
    if out == STDIO:
        return (drawing.html() if drawing.paint is None else drawing.svg()).encode()
    stem = "plan" if file == STDIO else file.stem
    suffix = SUFFIXES[2] if drawing.paint is None else SUFFIXES[0]
    return drawing.save(out if out is not None else Path(f"{stem}-{name}{suffix}"))


def _tasks(file: Path) -> dict[str, Drawing]:
    """The cut-diagrams of each task, without the errors, which an assembly does not state."""
    from fmopt.report.views import diagram_view
    from fmopt.task.assembly import carried_out, load_assembly

    def paint(answer: Answer, sheet: Any) -> None:
        from fmopt.papers.lee_huang.mapping import answered, diagrams

        mapping = answered(answer, [0.0] * 6, _RHO)
        diagram_view.paint(diagrams(mapping, float(-mapping.path.nodes[-1, 2]) or _RHO), sheet)

    found = {}
    for step in carried_out(load_assembly(file)):
        title = f"{step.name}: {step.answer.task.moving} into {step.answer.task.fixed}, cut-diagrams without errors"
        found[step.name] = Drawing(step.name, title, title, diagram_view.paper(3), partial(paint, step.answer))
    return found
