"""The three diagrams of the T-C mapping: operand 2 cut, expanded by operand 1, and the uncertain line L on its way."""

import math
from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np

from fmopt.plan import Plan
from fmopt.plan.diagnostics import Diagram
from fmopt.plan.field_types import Polyline
from fmopt.report.drawing import BLUE, GREY, INK, PALE, RUST, WIDTH, Axes, Drawing, Figure, fill, legend
from fmopt.report.naming import quantity
from fmopt.spatial.values import Array

TITLE = (
    "The three cut-diagrams: operand 2 as it is and expanded by operand 1, which shrinks to the line L; "
    "first contact as the planes show it, in space it may come sooner"
)
_ROW = 2.75  # inches
_LEGEND = 1.0  # inches
_COARSE = 5e-3  # m: a magnified part wider than this is shown in mm
_GROUND = "#f4e6d8"
_TURNING: Any = {"color": RUST, "linewidth": 0.8, "linestyle": "--"}
_JOINED = 0.02  # of the extent, poses nearer than this have their names written together
_CLASH = np.array([0.45, 0.1])  # of the extent, names of poses nearer than this would stand on one another
# Places of a name, in the order in which they are tried: points right and up from its pose, its edges that lie there.
_SIDES = ((5, -2, "left", "top"), (-5, -2, "right", "top"), (5, 2, "left", "bottom"), (-5, 2, "right", "bottom"))


def diagrams(plan: Plan) -> tuple[Diagram, ...]:
    """The diagrams that the plan holds, at most one a plane; of a planar problem those with material of operand 2."""
    found = plan.diagnostics
    return found.diagrams if found.planar is None else tuple(item for item in found.diagrams if item.fixed)


def paper(count: int) -> tuple[float, float]:
    """Width and height, in inches, of a sheet for so many diagrams."""
    return WIDTH, _ROW * count + _LEGEND


def drawing(items: Sequence[Diagram]) -> Drawing:
    """A row per plane: the whole diagram on the left, the room for the nominal centre magnified on the right."""
    words = "Operand 2 cut by the planes of the mouth's frame (G), and expanded by operand 1 (GE)"
    said = [f"{_name(i)}: ball {quantity(i.radius)}, cone {math.degrees(i.half_angle):.3g}°" for i in items]
    alt = f"{words}, which becomes a line L. Uncertainty: {'; '.join(said)}."
    return Drawing("diagrams", TITLE, alt, paper(len(items)), partial(paint, items))


def paint(items: Sequence[Diagram], figure: Figure) -> None:
    """Paints what `drawing` shows."""
    height = paper(len(items))[1]
    figure.set_layout_engine("none")  # margins are in inches, whatever the number of rows
    bottom, top = _LEGEND / height, 1.0 - 0.3 / height
    room = {"left": 0.09, "right": 0.985, "top": top, "bottom": bottom + 0.35 / height, "hspace": 0.42, "wspace": 0.22}
    grid = figure.add_gridspec(len(items), 2, width_ratios=(1.0, 1.25), **room)
    for row, item in enumerate(items):
        whole, close = figure.add_subplot(grid[row, 0]), figure.add_subplot(grid[row, 1])
        _whole(whole, item)
        _close(close, item)
    figure.align_ylabels()
    _legend(figure, any(item.turning is not None for item in items))


def _whole(axes: Axes, item: Diagram) -> None:
    _panel(axes, item, np.array([1e3, 1e3]), _extent(item), "whole")
    axes.set_aspect("equal", adjustable="datalim")
    axes.margins(0.05)


def _close(axes: Axes, item: Diagram) -> None:
    """Magnified across the axis; on the plane of the mouth in both directions."""
    low, high = _window(item)
    upright = item.plane[1] == "z"
    scale = 1e3 if high[0] - low[0] > _COARSE else 1e6
    factor = np.array([scale, 1e3 if upright else scale])
    _panel(axes, item, factor, high - low, f"magnified {'across' if upright else 'both ways'}")
    axes.set_xlim(factor[0] * low[0], factor[0] * high[0])
    axes.set_ylim(factor[1] * low[1], factor[1] * high[1])
    if not upright:
        axes.set_aspect("equal", adjustable="box")


def _panel(axes: Axes, item: Diagram, factor: Array, extent: Array, words: str) -> None:
    """A diagram by the scale of u and v and its extent (2,), m: regions, path, L at its poses, their names."""
    _regions(axes, item, factor)
    axes.plot(*(np.array(item.path) * factor).T, color=INK, linewidth=0.9, linestyle=":", marker="o", markersize=2.6)
    if words != "whole":
        _zones(axes, item, factor)
    for pose in item.poses:
        line = np.array(pose.line) * factor
        axes.plot(*line.T, color=BLUE, linewidth=1.4)
        axes.plot(*line[0], color=BLUE, marker="o", markersize=3.4)  # the nominal centre
    _names(axes, item, factor, extent)
    axes.set_title(f"plane {_name(item)}, {words}")
    units = ["mm" if scale == 1e3 else "µm" for scale in factor]
    axes.set_xlabel(f"{item.plane[0]}, {units[0]}", labelpad=1)
    axes.set_ylabel(f"{item.plane[1]}, {units[1]}")


def _window(item: Diagram) -> tuple[Array, Array]:
    """Corners (2,) of the magnified part: the room of the seated nominal centre, the ball and the trapezoids."""
    centre = np.array(item.poses[-1].centre)
    spread = max(item.radius, item.room)
    for pose in item.poses:
        inside = np.array(pose.trapezoid)
        # A pose farther aside would widen the window until nothing is seen of the room at the seat.
        if abs(pose.centre[0] - centre[0]) <= spread:
            spread = max(spread, float(np.abs(inside[:, 0] - centre[0]).max()))
    half = 1.35 * max(spread, 1e-6)
    if item.plane[1] != "z":
        return centre - half, centre + half
    heights = [v for pose in item.poses for _, v in (*pose.trapezoid, pose.centre)]
    reach = max(heights) - min(heights)
    low = np.array([centre[0] - half, min(heights) - 0.06 * reach])
    return low, np.array([centre[0] + half, max(heights) + 0.06 * reach])


def _regions(axes: Axes, item: Diagram, factor: Array) -> None:
    """GE as ground, that of all orientations as its outline, and G hatched on it."""
    material = _closed(item.fixed, factor)
    fill(axes, _closed(item.expanded, factor), facecolor=_GROUND, edgecolor=RUST, linewidth=1.0)
    fill(axes, material, facecolor=PALE, edgecolor="#999999", hatch="////", linewidth=0.0)
    for loop in _closed(item.turning or (), factor):
        axes.plot(*loop.T, **_TURNING)
    for loop in material:
        axes.plot(*loop.T, color=INK, linewidth=0.8)


def _closed(loops: Sequence[Polyline], factor: Array) -> list[Array]:
    return [np.array([*loop, loop[0]]) * factor for loop in loops]


def _names(axes: Axes, item: Diagram, factor: Array, extent: Array) -> None:
    """Names of poses, each on a side where no other stands, by the scale of u and v and the extent (2,), m."""
    from matplotlib.patheffects import withStroke

    spots: list[tuple[Array, list[str]]] = []
    for pose in item.poses:
        centre = np.array(pose.centre)
        near = [names for spot, names in spots if np.all(np.abs(spot - centre) <= _JOINED * extent)]
        if near:
            near[0].append(pose.name)
        else:
            spots.append((centre, [pose.name]))
    style: Any = {"textcoords": "offset points", "color": BLUE, "fontsize": 8.0, "annotation_clip": True}
    style["path_effects"] = [withStroke(linewidth=2.0, foreground="white")]
    taken: list[tuple[Array, int]] = []
    for spot, names in spots:
        used = {side for other, side in taken if np.all(np.abs(other - spot) <= _CLASH * extent)}
        side = next((k for k in range(len(_SIDES)) if k not in used), 0)
        taken.append((spot, side))
        right, up, across, along = _SIDES[side]
        place = (float(spot[0] * factor[0]), float(spot[1] * factor[1]))
        axes.annotate("\n".join(names), place, (right, up), ha=across, va=along, **style)


def _extent(item: Diagram) -> Array:
    """Width and height (2,) of GE, of the path and of the lines, m."""
    points = [point for loop in item.expanded for point in loop] + list(item.path)
    points += [point for pose in item.poses for point in pose.line]
    return np.asarray(np.ptp(np.array(points), axis=0))


def _zones(axes: Axes, item: Diagram, factor: Array) -> None:
    """Ball, cone and trapezoid at every pose."""
    for pose in item.poses:
        trapezoid, ball = np.array(pose.trapezoid) * factor, np.array(pose.ball) * factor
        axes.fill(*trapezoid.T, facecolor=BLUE, alpha=0.12, linewidth=0)
        for edge in pose.edges:
            axes.plot(*(np.array(edge) * factor).T, color=BLUE, linewidth=0.9, linestyle="--")
        for ray in pose.cone:
            axes.plot(*(np.array(ray) * factor).T, color=GREY, linewidth=0.8, linestyle="-.")
        axes.plot(*np.vstack([ball, ball[:1]]).T, color=BLUE, linewidth=0.9)


def _name(item: Diagram) -> str:
    return f"{item.plane[0]}–{item.plane[1]}"


def _legend(figure: Figure, turning: bool) -> None:
    entries: dict[str, dict[str, Any]] = {
        "G: material of operand 2": {"facecolor": PALE, "edgecolor": "#999999", "hatch": "////", "linewidth": 0},
        "GE: where the nominal centre cannot be": {"facecolor": _GROUND, "edgecolor": RUST},
        **({"GE while operand 1 turns": _TURNING} if turning else {}),
        "P(t), nominal centre": {"color": INK, "linestyle": ":", "marker": "o", "markersize": 2.6},
        "L: operand 1, shrunk": {"color": BLUE, "linewidth": 1.4, "marker": "o", "markersize": 3.4},
        "ball of the centre": {"color": BLUE, "linewidth": 0.9},
        "cone of the direction": {"color": GREY, "linewidth": 0.8, "linestyle": "-."},
        "trapezoid: all lines L": {"facecolor": BLUE, "alpha": 0.12, "linewidth": 0},
        "its edges": {"color": BLUE, "linewidth": 0.9, "linestyle": "--"},
    }
    legend(figure, entries, loc="lower center", ncols=3)
