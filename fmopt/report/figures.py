"""All figures of a plan: vector graphics from the plan alone, the same bytes for the same plan."""

from collections.abc import Callable
from typing import Any

from fmopt.plan import Plan
from fmopt.report.drawing import Drawing
from fmopt.report.views import (
    budget_view,
    cut_view,
    depth_view,
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
    nominal, planar = plan.description.nominal, plan.diagnostics.planar
    course = None if nominal is None else trajectory_view.Course(nominal, plan.description.position_force)
    chosen: list[Drawing] = []
    others: tuple[tuple[Callable[[Any], Drawing], Any], ...] = ()
    if plan.press_plan is None:
        chosen = [cut_view.drawing(plan), *graph_view.drawings(plan)]
        chosen += [margin_view.drawing(plan), tube_view.drawing(plan)]
        others = (
            (budget_view.drawing, budget_view.shares(plan)),
            (planar_view.drawing, planar and planar.sets),
            (surface_view.drawing, planar and planar.surfaces),
            (diagram_view.drawing, diagram_view.diagrams(plan)),
        )
    depths = next((one.depths for one in plan.description.placed), ())
    others = (*others, (depth_view.drawing, depths), (trajectory_view.drawing, course))
    chosen += [drawing(subject) for drawing, subject in others if subject]
    return {drawing.name: drawing for drawing in chosen}
