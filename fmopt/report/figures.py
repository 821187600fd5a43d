"""All figures of a plan: vector graphics from the plan alone, the same bytes for the same plan."""

from __future__ import annotations

from fmopt.plan import Plan
from fmopt.report.drawing import Drawing
from fmopt.report.views import (
    budget_view,
    cut_view,
    diagram_view,
    graph_view,
    margin_view,
    planar_view,
    surface_view,
    trajectory_view,
    tube_view,
)

def figures(plan: Plan) -> dict[str, str]:
    """The figures of a plan as texts of SVG, by name, in the order of a report."""
    return {name: figure.svg() for name, figure in catalogue(plan).items()}


def catalogue(plan: Plan) -> dict[str, Drawing]:
    """The figures that the plan has the data for, not yet drawn, by name, in the order of a report."""
    said = plan.description
    course = None if said.nominal is None else trajectory_view.Course(said.nominal, said.position_force)
    if plan.press_plan is not None:
        return {} if course is None else {"trajectory": _of("trajectory", trajectory_view, course)}
    chosen = [_of("cut", cut_view, plan)]
    for number, graph in enumerate(graph_view.graphs(plan), start=1):
        chosen.append(_of("states" if number == 1 else f"states-{number}", graph_view, graph))
    chosen += [_of("margin", margin_view, plan), _of("tube", tube_view, plan)]
    planar = None if plan.description.diagnostics is None else plan.description.diagnostics.planar
    others: tuple[tuple[str, Any, Any], ...] = (
        ("budget", budget_view, budget_view.shares(plan)),
        ("sets", planar_view, planar and planar.sets),
        ("surfaces", surface_view, planar and planar.surfaces),
        ("diagrams", diagram_view, diagram_view.diagrams(plan)),
        ("trajectory", trajectory_view, course),
    )
    chosen += [_of(name, view, subject) for name, view, subject in others if subject]
    return {figure.name: figure for figure in chosen}


def _of(name: str, view: Any, subject: Any) -> Figure:
    return Figure(name, view.TITLE, view.alt(subject), view.size(subject), partial(view.paint, subject))
