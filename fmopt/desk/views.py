"""Which drawings there are of which values: a table by type, looked up by name so that nothing is imported in vain."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from functools import partial
from typing import TYPE_CHECKING, Any

from fmopt.desk.drawing import Drawing

if TYPE_CHECKING:
    from fmopt.contact.graph import ContactGraph
    from fmopt.desk.plan import Plan
    from fmopt.geometry.part import Part
    from fmopt.nominal.mapping import Mapping as Diagrams
    from fmopt.plane.region import Region
    from fmopt.report.figures import Figure
    from fmopt.task.problem import Problem
    from fmopt.uncertainty.error_set import ErrorSet

_SCENE, _STILL = (8.2, 8.0), (8.2, 6.5)  # inches


def views_of(value: Any) -> dict[str, Drawing]:
    """The drawings of a value by name; none for a type that the table does not have."""
    for kind in type(value).__mro__:
        views = VIEWS.get(f"{kind.__module__}.{kind.__qualname__}")
        if views is not None:
            return {drawing.name: drawing for drawing in views(value)}
    return {}


def _plan(plan: Plan) -> Iterable[Drawing]:
    from fmopt.report.figures import catalogue
    from fmopt.report.scene import scene

    stated = plan.stated
    title = f"{stated.moving.name} going into {stated.fixed.name}, to be turned and played"
    yield Drawing("scene", title, title, _SCENE, fragment=partial(scene, stated))
    yield from map(figure_drawing, catalogue(stated).values())


def figure_drawing(figure: Figure) -> Drawing:
    """A figure of a report as a drawing."""
    return Drawing(figure.name, figure.title, figure.alt, figure.size, figure.paint)


def _problem(problem: Problem) -> Iterable[Drawing]:
    from fmopt.report import diagram_view

    title = f"{problem.moving.name} and {problem.fixed.name}"
    yield _part_sheet(problem.moving, problem.fixed, name="parts")
    yield Drawing("scene", f"{title}, seated along the axis", title, _SCENE, fragment=partial(_seating, problem))
    yield Drawing(
        "diagrams",
        diagram_view.TITLE,
        f"{title}: cut-diagrams G and GE on three planes.",
        diagram_view.paper(3),
        paint=partial(_paint_diagrams, problem),
    )


def _seating(problem: Problem) -> str:
    """The parts with the nominal trajectory straight down, which no plan has confirmed."""
    from fmopt.desk.solids import stated_part
    from fmopt.report.scene import seating

    nodes = [tuple(pose.tolist()) for pose in (problem.start, problem.goal)]
    return seating(stated_part(problem.moving), stated_part(problem.fixed), nodes)


def _paint_diagrams(problem: Problem, sheet: Any) -> None:
    from fmopt.desk.stages import nominal
    from fmopt.nominal.diagram_record import records
    from fmopt.plan import diagram
    from fmopt.report import diagram_view

    found = records(nominal(problem).planes, problem.peg.length)
    diagram_view.paint([diagram(record) for record in found], sheet)


def _diagrams(mapping: Diagrams) -> Iterable[Drawing]:
    from fmopt.nominal.diagram_record import records
    from fmopt.plan import diagram
    from fmopt.report import diagram_view

    length = float(-mapping.path.nodes[-1, 2]) or 0.01
    found = [diagram(record) for record in records(mapping, length)]
    yield Drawing(
        "diagrams",
        diagram_view.TITLE,
        diagram_view.alt(found),
        diagram_view.size(found),
        paint=partial(diagram_view.paint, found),
    )


def _part(part: Part) -> Iterable[Drawing]:
    from fmopt.desk.solids import turning

    yield _part_sheet(part, name="part")
    yield Drawing("scene", f"{part.name}, to be turned", part.name, _STILL, fragment=partial(turning, part))


def _part_sheet(*parts: Part, name: str) -> Drawing:
    from fmopt.report import part_view

    def paint(sheet: Any) -> None:
        from fmopt.desk.solids import middle

        if len(parts) == 1:
            part_view.paint(parts[0].name, parts[0].polyhedron, parts[0].pieces, middle(parts[0]), sheet)
            return
        for half, part in zip(sheet.subfigures(len(parts), 1), parts, strict=True):
            part_view.paint(part.name, part.polyhedron, part.pieces, middle(part), half)

    width, height = part_view.size()
    alt = " ".join(part_view.alt(part.name, part.polyhedron) for part in parts)
    title = " and ".join(part.name for part in parts)
    return Drawing(name, title, alt, (width, height * len(parts)), paint=paint)


def _region(region: Region) -> Iterable[Drawing]:
    from fmopt.desk.sheets_of_sets import paint_region

    low, high = region.box if not region.empty else ((0.0, 0.0), (0.0, 0.0))
    width, height = (1e3 * float(b - a) for a, b in zip(low, high, strict=True))
    alt = f"A region of the plane, {width:.4g} by {height:.4g} mm, area {1e6 * region.area:.4g} mm²."
    yield Drawing("region", "Region of the plane", alt, (4.5, 4.0), paint=partial(paint_region, region))


def _graph(graph: ContactGraph) -> Iterable[Drawing]:
    from fmopt.desk.sheets_of_sets import paint_graph

    counts = ", ".join(f"{n} of dimension {d}" for d, n in reversed(graph.count().items()))
    alt = f"{len(graph.states)} contact states: {counts}. Each row is a dimension, lines join states that touch."
    yield Drawing(
        "states", f"{len(graph.states)} contact states by dimension", alt, (7.0, 4.6), partial(paint_graph, graph)
    )


def _errors(errors: ErrorSet) -> Iterable[Drawing]:
    from fmopt.desk.sheets_of_sets import error_words, paint_errors

    alt = f"Half-widths of the set of errors: {error_words(errors)}."
    yield Drawing(
        "errors", "Set of pose errors, seen along pairs of axes", alt, (7.0, 2.9), partial(paint_errors, errors)
    )


VIEWS: Mapping[str, Callable[[Any], Iterable[Drawing]]] = {
    "fmopt.desk.plan.Plan": _plan,
    "fmopt.task.problem.Problem": _problem,
    "fmopt.geometry.part.Part": _part,
    "fmopt.plane.region.Region": _region,
    "fmopt.contact.graph.ContactGraph": _graph,
    "fmopt.nominal.mapping.Mapping": _diagrams,
    "fmopt.uncertainty.error_set.ErrorSet": _errors,
}
