"""Which drawings there are of which values: a table by type, looked up by name so that nothing is imported in vain."""

import math
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from fmopt.certificate.error_set import ErrorSet
from fmopt.contact.state_graph import ContactGraph
from fmopt.geometry.part import Part
from fmopt.geometry.plane.region import Region
from fmopt.report.bodies import stated_part
from fmopt.report.drawing import BLUE, PALE, RUST, Drawing, Figure, fill
from fmopt.report.naming import AXES_READ, SCALES, box_words
from fmopt.spatial.values import Array

if TYPE_CHECKING:
    from fmopt.notebook.plan import Plan
    from fmopt.papers.lee_huang.mapping import Mapping as Diagrams
    from fmopt.task.problem import Problem

_SCENE, _PRESSES, _STILL = (8.2, 8.0), (8.2, 9.4), (8.2, 6.5)  # inches
_PAIRS = ((0, 1), (0, 2), (3, 4))


def views_of(value: Any) -> dict[str, Drawing]:
    """The drawings of a value by name; none for a type that the table does not have."""
    # By all bases: the notebook's own problem is one of the task with more to it.
    for kind in type(value).__mro__:
        views = VIEWS.get(f"{kind.__module__}.{kind.__qualname__}")
        if views is not None:
            return {drawing.name: drawing for drawing in views(value)}
    return {}


def _plan(plan: "Plan") -> Iterable[Drawing]:
    from fmopt.report.figures import catalogue
    from fmopt.report.scene import scene

    stated = plan.stated
    title = f"{stated.moving.name} going into {stated.fixed.name}, to be turned and played"
    size = _SCENE if stated.press_plan is None else _PRESSES
    yield Drawing("scene", title, title, size, fragment=partial(scene, stated))
    yield from catalogue(stated).values()


def _problem(problem: "Problem") -> Iterable[Drawing]:
    """Both parts; the scene with the nominal trajectory straight down, which no plan has confirmed; cut-diagrams."""
    from fmopt.report.scene import seating
    from fmopt.report.views import diagram_view, part_view

    def paint(sheet: Figure) -> None:
        from fmopt.notebook.stages import nominal
        from fmopt.papers.lee_huang.mapping import diagrams

        diagram_view.paint(diagrams(nominal(problem).planes, problem.peg.length), sheet)

    title = f"{problem.moving.name} and {problem.fixed.name}"
    yield part_view.drawing("parts", problem.moving, problem.fixed)
    nodes = [tuple(pose.tolist()) for pose in (problem.start, problem.goal)]
    seated = partial(seating, stated_part(problem.moving), stated_part(problem.fixed), nodes)
    yield Drawing("scene", f"{title}, seated along the axis", title, _SCENE, fragment=seated)
    alt = f"{title}: cut-diagrams G and GE on three planes."
    yield Drawing("diagrams", diagram_view.TITLE, alt, diagram_view.paper(3), paint)


def _diagrams(mapping: "Diagrams") -> Iterable[Drawing]:
    from fmopt.papers.lee_huang.mapping import diagrams
    from fmopt.report.views import diagram_view

    yield diagram_view.drawing(diagrams(mapping, float(-mapping.path.nodes[-1, 2]) or 0.01))


def _part(part: Part) -> Iterable[Drawing]:
    from fmopt.report.scene import part_scene
    from fmopt.report.views import part_view

    yield part_view.drawing("part", part)
    turning = partial(part_scene, stated_part(part))
    yield Drawing("scene", f"{part.name}, to be turned", part.name, _STILL, fragment=turning)


def _region(region: Region) -> Iterable[Drawing]:
    low, high = region.box if not region.empty else ((0.0, 0.0), (0.0, 0.0))
    width, height = (1e3 * float(b - a) for a, b in zip(low, high, strict=True))
    alt = f"A region of the plane, {width:.4g} by {height:.4g} mm, area {1e6 * region.area:.4g} mm²."
    yield Drawing("region", "Region of the plane", alt, (4.5, 4.0), paint=partial(paint_region, region))


def _graph(graph: ContactGraph) -> Iterable[Drawing]:
    from fmopt.report.views import graph_view

    yield graph_view.drawing("states", graph_view.state_graph("the pose", graph.states, graph.sons, ()))


def _errors(errors: ErrorSet) -> Iterable[Drawing]:
    alt = f"Half-widths of the set of errors: {box_words(errors.support(np.eye(6)).tolist())}."
    title = "Set of pose errors, seen along pairs of axes"
    yield Drawing("errors", title, alt, (7.0, 2.9), partial(paint_errors, errors))


VIEWS: Mapping[str, Callable[[Any], Iterable[Drawing]]] = {
    "fmopt.notebook.plan.Plan": _plan,
    "fmopt.task.problem.Problem": _problem,
    "fmopt.geometry.part.Part": _part,
    "fmopt.geometry.plane.region.Region": _region,
    "fmopt.contact.state_graph.ContactGraph": _graph,
    "fmopt.papers.lee_huang.mapping.Mapping": _diagrams,
    "fmopt.certificate.error_set.ErrorSet": _errors,
}


def paint_region(region: Region, sheet: Figure) -> None:
    """The region hatched, each loop with an arrow that has the interior on its left; mm."""
    axes = sheet.subplots()
    tolerance = 1e-4 * region.size if not region.empty else 1.0
    loops = [np.vstack([curve.polyline(tolerance)[:-1] for curve in loop]) for loop in region.loops]
    fill(axes, [1e3 * np.vstack([loop, loop[:1]]) for loop in loops], facecolor=PALE, edgecolor=BLUE, linewidth=1.1)
    for loop in region.loops:
        longest = max(loop, key=lambda curve: curve.length)
        at, along = 1e3 * longest.point(0.5), longest.tangent(0.5)
        tip = at + 1e3 * 0.04 * region.size * along / np.linalg.norm(along)
        axes.annotate("", (tip[0], tip[1]), (at[0], at[1]), arrowprops={"arrowstyle": "-|>", "color": BLUE})
    axes.autoscale_view()
    axes.margins(0.06)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("u, mm")
    axes.set_ylabel("v, mm")


def paint_errors(errors: ErrorSet, sheet: Figure) -> None:
    """Shadows of the set on three pairs of axes: of its ellipsoid, and of what is known of it altogether."""
    turn = np.linspace(0.0, 2.0 * math.pi, 181)
    round_ = np.column_stack([np.cos(turn), np.sin(turn)])
    for axes, pair in zip(sheet.subplots(1, len(_PAIRS)), _PAIRS, strict=True):
        scale = SCALES[list(pair)]
        # A shadow reaches as far along a direction of its plane as the set does in space.
        both = _outline(round_, errors.support(round_ @ np.eye(6)[list(pair)])) * scale
        root = errors.shape_root[list(pair)]
        size = np.sqrt(np.einsum("ij,jk,ik->i", round_, root @ root.T, round_))
        axes.plot(*(_outline(round_, size) * scale).T, color=RUST, linestyle="--", label="ellipsoid")
        axes.fill(*both.T, facecolor=PALE, edgecolor=BLUE, linewidth=1.1, label="bound in use")
        axes.set_aspect("equal", adjustable="datalim")
        axes.set_xlabel(AXES_READ[pair[0]])
        axes.set_ylabel(AXES_READ[pair[1]])
    handles, labels = axes.get_legend_handles_labels()
    sheet.legend(handles, labels, loc="outside lower center", ncols=2)


def _outline(directions: Array, support: Array) -> Any:
    """Corners (n, 2) of the set with these support values along unit directions (n, 2) that go once around."""
    ahead, further = np.roll(directions, -1, axis=0), np.roll(support, -1)
    det = directions[:, 0] * ahead[:, 1] - directions[:, 1] * ahead[:, 0]
    kept = np.abs(det) > 1e-12  # the last direction is the first once more, and crosses it nowhere
    x = (support * ahead[:, 1] - further * directions[:, 1])[kept] / det[kept]
    y = (directions[:, 0] * further - ahead[:, 0] * support)[kept] / det[kept]
    return np.column_stack([x, y])[[*range(int(kept.sum())), 0]]
