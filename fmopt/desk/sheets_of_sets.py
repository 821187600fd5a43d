"""Regions of the plane, contact graphs and sets of errors on a sheet."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from fmopt.contact.graph import ContactGraph
from fmopt.plane.region import Region
from fmopt.report.drawing import BLUE, GREY, INK, PALE, RUST
from fmopt.uncertainty.error_set import ErrorSet
from fmopt.values import Array

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Sheet

_AXES = ("x", "y", "z", "rx", "ry", "rz")
_PAIRS = ((0, 1), (0, 2), (3, 4))
_MANY = 1500  # lines of a graph that can still be told apart


def paint_region(region: Region, sheet: Sheet) -> None:
    """The region hatched, each loop with an arrow that has the interior on its left; mm."""
    from matplotlib.patches import PathPatch
    from matplotlib.path import Path

    axes = sheet.subplots()
    tolerance = 1e-4 * region.size if not region.empty else 1.0
    loops = [1e3 * np.vstack([curve.polyline(tolerance)[:-1] for curve in loop]) for loop in region.loops]
    if loops:
        closed = [Path(np.vstack([loop, loop[:1]]), closed=True) for loop in loops]
        path = Path.make_compound_path(*closed)
        axes.add_patch(PathPatch(path, facecolor=PALE, edgecolor=BLUE, linewidth=1.1))
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


def paint_graph(graph: ContactGraph, sheet: Sheet) -> None:
    """A row for each dimension, free space on top; a dot for each state, lines to the states on its boundary."""
    axes = sheet.subplots()
    counts = graph.count()
    rank: dict[int, int] = dict.fromkeys(counts, 0)
    places = np.zeros((len(graph.states), 2))
    for i, state in enumerate(graph.states):
        number = rank[state.dimension]
        rank[state.dimension] += 1
        places[i] = (number + 0.5) / counts[state.dimension] - 0.5, state.dimension
    links = [(i, j) for i, sons in enumerate(graph.sons) for j in sons]
    if len(links) <= _MANY:
        lines = np.array([[places[i], places[j]] for i, j in links]).reshape(-1, 2, 2)
        axes.plot(lines[:, :, 0].T, lines[:, :, 1].T, color=GREY, linewidth=0.25, zorder=1)
    axes.plot(*places.T, "o", markersize=3.6 if len(places) < 100 else 2.4, color=BLUE, zorder=2)
    for dimension, count in counts.items():
        axes.annotate(f"{count}", (0.56, dimension), va="center", color=INK)
    axes.set_xlim(-0.55, 0.62)
    axes.set_yticks(list(counts), [f"dimension {d}" for d in counts])
    axes.set_xticks([])
    axes.spines[["bottom", "left"]].set_visible(False)
    lines_said = "" if len(links) <= _MANY else f", {len(links)} borders not drawn"
    axes.set_title(f"{len(graph.states)} contact states{lines_said}")


def paint_errors(errors: ErrorSet, sheet: Sheet) -> None:
    """Shadows of the set on three pairs of axes: of its ellipsoid, and of what is known of it altogether."""
    turn = np.linspace(0.0, 2.0 * math.pi, 181)
    round_ = np.column_stack([np.cos(turn), np.sin(turn)])
    for axes, pair in zip(sheet.subplots(1, len(_PAIRS)), _PAIRS, strict=True):
        scale = np.array([1e3 if axis < 3 else math.degrees(1.0) for axis in pair])
        rows = np.zeros((len(turn), 6))
        rows[:, list(pair)] = round_
        both = _outline(round_, errors.support(rows)) * scale
        root = errors.shape_root[list(pair)]
        size = np.sqrt(np.einsum("ij,jk,ik->i", round_, root @ root.T, round_))
        axes.plot(*(_outline(round_, size) * scale).T, color=RUST, linestyle="--", label="ellipsoid")
        axes.fill(*both.T, facecolor=PALE, edgecolor=BLUE, linewidth=1.1, label="bound in use")
        axes.set_aspect("equal", adjustable="datalim")
        unit = "mm" if pair[0] < 3 else "°"
        axes.set_xlabel(f"{_AXES[pair[0]]}, {unit}")
        axes.set_ylabel(f"{_AXES[pair[1]]}, {unit}")
    handles, labels = axes.get_legend_handles_labels()
    sheet.legend(handles, labels, loc="outside lower center", ncols=2)


def error_words(errors: ErrorSet) -> str:
    """Half-widths of the set along the six axes, in words."""
    widths = errors.support(np.eye(6))
    said = [
        f"{_AXES[i]} {1e3 * w:.4g} mm" if i < 3 else f"{_AXES[i]} {math.degrees(w):.4g}°" for i, w in enumerate(widths)
    ]
    return ", ".join(said)


def _outline(directions: Array, support: Array) -> Any:
    """Corners (n, 2) of the set with these support values along unit directions (n, 2) that go once around."""
    ahead, further = np.roll(directions, -1, axis=0), np.roll(support, -1)
    det = directions[:, 0] * ahead[:, 1] - directions[:, 1] * ahead[:, 0]
    kept = np.abs(det) > 1e-12
    x = (support * ahead[:, 1] - further * directions[:, 1])[kept] / det[kept]
    y = (directions[:, 0] * further - ahead[:, 0] * support)[kept] / det[kept]
    return np.column_stack([x, y])[[*range(int(kept.sum())), 0]]
