"""The cut view: both parts cut through the mating axis, the moving part at every move's end, the gaps magnified."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from fmopt.report.bodies import CUTS, cut, extent, pieces_of
from fmopt.report.drawing import BLUE, DASHES, INK, PALE, WIDTH
from fmopt.report.moves import moves
from fmopt.report.naming import quantity
from fmopt.se3 import Pose
from fmopt.values import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from shapely import MultiPolygon

TITLE = "Cut view: both parts cut through the mating axis"
_TOUCH = 1e-9  # m
_NEAR = 0.004  # m, labels closer than this are one
_HEADROOM = 0.12  # of the height of a panel, for labels above the moving part
_CROWDED = (0.016, 0.008)  # m, labels closer than this are set one above the other


@dataclass(frozen=True, eq=False)
class _Gap:
    """A gap between the seated moving part and the fixed part: its side −1 or 1, wall, flank, and engaged heights."""

    side: int
    wall: float
    flank: float
    low: float
    high: float

    @property
    def width(self) -> float:
        return self.side * (self.wall - self.flank)


def size(plan: Mapping[str, Any]) -> tuple[float, float]:
    """Width and height in inches."""
    return (WIDTH, 6.6 if _all_gaps(plan) else 4.4)


def alt(plan: Mapping[str, Any]) -> str:
    """What is to be seen, for who cannot see it."""
    parts, gaps = plan["parts"], _all_gaps(plan)
    words = f"Sections of {parts['moving']['name']} and {parts['fixed']['name']} by the planes x–z and y–z, with the "
    words += f"outline of {parts['moving']['name']} at the end of each of {len(moves(plan))} moves."
    said = [f"{'left' if gap.side < 0 else 'right'} in {plane} {_width(gap)}" for plane, gap in gaps]
    return words + (f" Gaps in the goal pose: {', '.join(said)}." if said else "")


def paint(plan: Mapping[str, Any], figure: Figure) -> None:
    """Two sections side by side; below them the gaps in the seated pose, magnified across."""
    gaps = _all_gaps(plan)
    figure.set_layout_engine("none")  # by hand: half the time
    room = {"left": 0.085, "right": 0.985, "top": 0.965, "bottom": 0.4 if gaps else 0.1, "wspace": 0.1}
    grid = figure.add_gridspec(1, 2, **room)
    left = figure.add_subplot(grid[0])
    for axes, plane in zip((left, figure.add_subplot(grid[1], sharey=left)), CUTS, strict=True):
        _section_panel(axes, plan, plane)
    left.set_ylabel("z, mm")
    low, high = left.get_ylim()
    left.set_ylim(low, high + _HEADROOM * (high - low))
    if gaps:
        figure.text(0.01, 0.31, "The gaps in the goal pose, magnified across", fontweight="bold", fontsize=9.5)
        room = {"left": 0.085, "right": 0.985, "top": 0.265, "bottom": 0.075, "wspace": 0.55}
        below = figure.add_gridspec(1, max(len(gaps), 4), **room)
        for number, (plane, gap) in enumerate(gaps):
            _gap_panel(figure.add_subplot(below[number]), plane, gap)


def _section_panel(axes: Axes, plan: Mapping[str, Any], plane: str) -> None:
    moving, fixed = (pieces_of(plan["parts"][side]) for side in ("moving", "fixed"))
    _fill(axes, cut(fixed, Pose.identity(), plane), facecolor=PALE, edgecolor="#999999", hatch="////", linewidth=0)
    _outline(axes, cut(fixed, Pose.identity(), plane), color=INK, linewidth=1.0)
    tops: list[tuple[Array, list[str]]] = []
    for end, pose, name in _ends(plan):
        shape = cut(moving, pose, plane)
        last = end == len(moves(plan))
        if last:
            _fill(axes, shape, facecolor=BLUE, alpha=0.15, linewidth=0)
        _outline(axes, shape, color=BLUE, linewidth=1.4 if last else 0.7, linestyle="-" if last else DASHES[end % 4])
        _note(tops, CUTS[plane].inverse().apply(pose.apply(_top(plan)))[:2], name)
    paper = {"boxstyle": "square,pad=0.15", "facecolor": "white", "edgecolor": "none"}
    for number, (place, names) in enumerate(tops):
        text = names[0] if len(names) == 1 else f"{names[0]} … {names[-1]}" if len(names) > 2 else ", ".join(names)
        below = [other for other, _ in tops[:number] if np.all(np.abs(other - place) < _CROWDED)]
        foot = (1e3 * place[0], 1e3 * max(place[1], *(other[1] for other in below), -np.inf))
        offset = (0, 7 + 13 * len(below))
        axes.annotate(text, foot, offset, textcoords="offset points", ha="center", color=BLUE, bbox=paper)
    axes.set_aspect("equal")
    axes.margins(0.04, 0.06)
    axes.set_title(f"plane {plane}: numbers are move ends" if plane == "x–z" else f"plane {plane}")
    axes.set_xlabel(f"{plane[0]}, mm")
    axes.tick_params(labelleft=plane == "x–z")


def _ends(plan: Mapping[str, Any]) -> list[tuple[int, Pose, str]]:
    run = moves(plan)
    if not run:
        nodes = plan.get("nominal", {}).get("nodes", ())
        return [(k, Pose.from_vector(node), f"node {k}") for k, node in enumerate(nodes)]
    start = (0, Pose.from_vector(run[0].segments[0]["start"]), "start")
    return [start, *((m.number, Pose.from_vector(m.segments[-1]["goal"]), str(m.number)) for m in run)]


def _note(tops: list[tuple[Array, list[str]]], place: Array, name: str) -> None:
    """Adds a label, to one that stands near where there is one."""
    for other, names in tops:
        if np.all(np.abs(other - place) < _NEAR):
            names.append(name)
            return
    tops.append((place, [name]))


def _top(plan: Mapping[str, Any]) -> Array:
    """The middle of the trailing end of the moving part, body frame, m."""
    points = np.asarray(plan["parts"]["moving"]["vertices"], dtype=np.float64)
    return np.array([*(0.5 * (points.min(axis=0) + points.max(axis=0)))[:2], points[:, 2].max()])


def _fill(axes: Axes, shape: MultiPolygon, **style: Any) -> None:
    from matplotlib.patches import PathPatch
    from matplotlib.path import Path

    loops = [loop for polygon in shape.geoms for loop in (polygon.exterior, *polygon.interiors)]
    if loops:
        paths = [Path(1e3 * np.asarray(loop.coords), closed=True) for loop in loops]
        axes.add_patch(PathPatch(Path.make_compound_path(*paths), **style))


def _outline(axes: Axes, shape: MultiPolygon, **style: Any) -> None:
    for polygon in shape.geoms:
        for loop in (polygon.exterior, *polygon.interiors):
            axes.plot(*(1e3 * np.asarray(loop.coords)).T, **style)


def _all_gaps(plan: Mapping[str, Any]) -> list[tuple[str, _Gap]]:
    ends = _ends(plan)
    if not ends:
        return []
    return [(plane, gap) for plane in CUTS for gap in _gaps(plan, ends[-1][1], plane)]


def _gaps(plan: Mapping[str, Any], pose: Pose, plane: str) -> list[_Gap]:
    """The gaps on both sides at the middle of the engaged heights; none where the parts are not side by side."""
    moving, fixed = (pieces_of(plan["parts"][side]) for side in ("moving", "fixed"))
    peg, block = cut(moving, pose, plane), cut(fixed, Pose.identity(), plane)
    if peg.is_empty or block.is_empty:
        return []
    low, high = max(peg.bounds[1], block.bounds[1]), min(peg.bounds[3], block.bounds[3])
    if high - low <= _TOUCH:
        return []
    flanks, walls = (extent(shape, 0.5 * (low + high)) for shape in (peg, block))
    found = []
    for side, flank in ((-1, flanks[0, 0]), (1, flanks[-1, 1])) if len(flanks) else ():
        beyond = [wall for wall in walls[:, 1 if side < 0 else 0] if side * (wall - flank) >= -_TOUCH]
        if beyond:
            found.append(_Gap(side, min(beyond, key=lambda wall: side * wall), flank, low, high))
    return found


def _width(gap: _Gap) -> str:
    return "touching" if abs(gap.width) <= _TOUCH else quantity(gap.width)


def _gap_panel(axes: Axes, plane: str, gap: _Gap) -> None:
    """One gap: wall hatched, moving part tinted; the horizontal axis from the wall, in µm."""
    reach = 1.5e6 * max(gap.width, 5e-5)
    low, high = 1e3 * gap.low, 1e3 * gap.high
    flank = -gap.side * 1e6 * gap.width
    axes.axvspan(0.0, gap.side * reach, facecolor=PALE, edgecolor="#999999", hatch="////", linewidth=0)
    axes.axvspan(flank, -gap.side * 2.0 * reach, facecolor=BLUE, alpha=0.15, linewidth=0)
    axes.axvline(0.0, color=INK, linewidth=1.0)
    axes.axvline(flank, color=BLUE, linewidth=1.4)
    axes.set_xlim(*sorted((gap.side * 0.5 * reach, -gap.side * 1.5 * reach)))
    axes.set_ylim(low, high)
    axes.set_title(f"{plane}, {'left' if gap.side < 0 else 'right'}: {_width(gap)}", fontweight="normal")
    axes.set_xlabel(f"{plane[0]} from the wall, µm")
    axes.set_ylabel("z, mm")
