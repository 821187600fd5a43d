"""Figures of a study: curves over one axis, maps over two with the border of what works, samples axis by axis."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from fmopt.report.drawing import BLUE, DASHES, GREY, INK, PALE, RUST, WIDTH, drawn
from fmopt.study.statistics import share
from fmopt.study.table import Varied
from fmopt.study.view import Truth, View, answer_label, axis_label
from fmopt.values import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_BINS = 8
_MOST_BINDING = 10  # contacts that are told apart


def figures(view: View) -> dict[str, tuple[str, str]]:
    """The figures of a study by name: what each shows, and its SVG, the same bytes for the same results."""
    found: dict[str, tuple[str, str]] = {}
    if not len(view.results.lines) or not view.done.any():
        return found
    grid = _grid(view)
    for name in view.answers:
        title = f"{answer_label(name)}, over {' and '.join(axis_label(axis) for axis in view.free)}"
        if grid is not None:
            paint, height = partial(_map, view, name, grid), 4.2
        elif len(view.free) == 1:
            paint, height = partial(_curve, view, name), 3.4
        else:
            paint, height = partial(_clouds, view, name), 2.6 * -(-len(view.free) // 2)
        found[name] = (title, drawn(paint, (WIDTH, height)).decode())
    if not view.good[view.done].all():
        height = 2.6 * -(-len(view.free) // 2)
        words = f"share of runs that are {view.goodness}, with 95 % intervals"
        found["share"] = (words, drawn(partial(_shares, view), (WIDTH, height)).decode())
    if grid is not None and "binding_contact" in view.results.columns:
        found["binding"] = ("what binds where", drawn(partial(_binding, view, grid), (WIDTH, 4.2)).decode())
    return found


class _Grid:
    """A full grid over two axes: its values along both, and the run in each cell."""

    def __init__(self, x: Array, y: Array, run: Any) -> None:
        self.x, self.y, self.run = x, y, run

    def of(self, values: Any) -> Any:
        """Values (n,) as a table over y and x."""
        return np.asarray(values)[self.run]


def _grid(view: View) -> _Grid | None:
    if len(view.free) != 2:
        return None
    first, second = (view.axis(axis) for axis in view.free)
    (x, i), (y, j) = (np.unique(values, return_inverse=True) for values in (first, second))
    if len(x) * len(y) != len(first) or min(len(x), len(y)) < 2:
        return None
    run = np.full((len(y), len(x)), -1)
    run[j, i] = np.arange(len(first))
    return None if (run < 0).any() else _Grid(x, y, run)


def _edges(values: Array) -> Array:
    """Borders (n + 1,) of cells around values (n,)."""
    middle = 0.5 * (values[1:] + values[:-1])
    return np.concatenate([[values[0] - (middle[0] - values[0])], middle, [values[-1] + (values[-1] - middle[-1])]])


def _map(view: View, name: str, grid: _Grid, figure: Figure) -> None:
    axes = figure.subplots()
    values = np.ma.masked_invalid(grid.of(view.answer(name)))
    x, y = _edges(grid.x), _edges(grid.y)
    axes.set_facecolor("white")
    mesh = axes.pcolormesh(x, y, values, cmap="cividis", edgecolors="white", linewidth=0.3)
    figure.colorbar(mesh, ax=axes, label=answer_label(name))
    for row, column in zip(*np.nonzero(values.mask | np.zeros(values.shape, bool)), strict=True):
        axes.text(grid.x[column], grid.y[row], "×", ha="center", va="center", color=GREY)
    _border(axes, x, y, grid.of(view.good), grid.of(view.done))
    _labelled(view, axes, view.free[0], view.free[1])
    axes.set_title(title(view, name, f"; inside the line: {view.goodness}", "; ×: no value"))


def title(view: View, name: str, border: str, nothing: str) -> str:
    """The title of an answer's figure, with words on runs that did not come out well, or have no value, if any."""
    words = "" if view.good[view.done].all() else border
    return answer_label(name) + words + ("" if np.isfinite(view.answer(name)).all() else nothing)


def _border(axes: Axes, x: Array, y: Array, good: Truth, done: Truth) -> None:
    """The line between cells that came out well and others, of those that have answers."""
    rows, columns = good.shape
    beside = (good[:, 1:] != good[:, :-1]) & done[:, 1:] & done[:, :-1]
    above = (good[1:] != good[:-1]) & done[1:] & done[:-1]
    lines = [((x[c + 1], x[c + 1]), (y[r], y[r + 1])) for r in range(rows) for c in range(columns - 1) if beside[r, c]]
    lines += [((x[c], x[c + 1]), (y[r + 1], y[r + 1])) for r in range(rows - 1) for c in range(columns) if above[r, c]]
    for across, up in lines:
        axes.plot(across, up, color="white", linewidth=4.0, solid_capstyle="projecting")
    for across, up in lines:
        axes.plot(across, up, color=RUST, linewidth=2.0, solid_capstyle="projecting")


def _labelled(view: View, axes: Axes, across: Varied, up: Varied) -> None:
    axes.set_xlabel(axis_label(across))
    axes.set_ylabel(axis_label(up))
    for axis, ticks in ((across, axes.set_xticks), (up, axes.set_yticks)):
        if axis.unit == "word":
            ticks(range(len(view.words(axis))), view.words(axis))
        else:
            places = np.unique(view.axis(axis))
            if len(places) <= 10:
                ticks(places, [f"{place:.3g}" for place in places])


def _curve(view: View, name: str, figure: Figure) -> None:
    axes = figure.subplots()
    axis = view.free[0]
    order = np.argsort(view.axis(axis), kind="stable")
    x, y, good = view.axis(axis)[order], view.answer(name)[order], view.good[order]
    axes.plot(x, y, color=GREY, linewidth=1.0)
    axes.plot(x[good], y[good], "o", color=BLUE, label=view.goodness)
    if not good.all():
        axes.plot(x[~good], y[~good], "o", color=RUST, markerfacecolor="white", label=f"not {view.goodness}")
    for place in x[~np.isfinite(y)]:
        axes.axvline(place, color=RUST, linewidth=0.8, linestyle=DASHES[1])
    if np.nanmin(y) < 0.0 < np.nanmax(y):
        axes.axhline(0.0, color=INK, linewidth=0.8)
    if axis.log:
        axes.set_xscale("log")
    axes.set_xlabel(axis_label(axis))
    if axis.unit == "word":
        axes.set_xticks(range(len(view.words(axis))), view.words(axis))
    axes.set_ylabel(answer_label(name))
    axes.legend()
    axes.set_title(title(view, name, "", "; dashed: no value"))


def _clouds(view: View, name: str, figure: Figure) -> None:
    panels = figure.subplots(-(-len(view.free) // 2), 2, squeeze=False, sharey=True).ravel()
    y, good = view.answer(name), view.good
    for axes, axis in zip(panels, view.free, strict=False):
        x = view.axis(axis)
        axes.plot(x[good], y[good], ".", color=BLUE, markersize=4)
        axes.plot(x[~good], y[~good], "x", color=RUST, markersize=4)
        if axis.log:
            axes.set_xscale("log")
        axes.set_xlabel(axis_label(axis))
    for axes in panels[len(view.free) :]:
        axes.set_axis_off()
    panels[0].set_ylabel(answer_label(name))
    figure.suptitle(f"{answer_label(name)}; dots: {view.goodness}, crosses: not")


def _shares(view: View, figure: Figure) -> None:
    panels = figure.subplots(-(-len(view.free) // 2), 2, squeeze=False, sharey=True).ravel()
    for axes, axis in zip(panels, view.free, strict=False):
        for middle, good, total in bins(view, axis):
            found = share(good, total)
            axes.plot([middle, middle], [found.low, found.high], color=GREY, linewidth=3.0)
            axes.plot([middle], [found.value], "o", color=BLUE)
        axes.set_ylim(-0.03, 1.03)
        axes.set_xlabel(axis_label(axis))
    for axes in panels[len(view.free) :]:
        axes.set_axis_off()
    panels[0].set_ylabel(view.goodness)
    figure.suptitle(f"share that is {view.goodness}, 95 % intervals")


def bins(view: View, axis: Varied) -> list[tuple[float, int, int]]:
    """Middle, good and all done runs of each value of an axis, or of bins of equal number where there are many."""
    x, good = view.axis(axis)[view.done], view.good[view.done]
    places = np.unique(x)
    if len(places) <= _BINS:
        groups = [np.flatnonzero(x == place) for place in places]
    else:
        groups = [group for group in np.array_split(np.argsort(x, kind="stable"), _BINS) if len(group)]
    return [(float(np.median(x[group])), int(good[group].sum()), len(group)) for group in groups]


def binding(view: View) -> Mapping[str, int]:
    """The contacts that bind, most often first, with the number of runs."""
    counts: dict[str, int] = {}
    for line in view.results.lines:
        name = line.get("binding_contact")
        if name is not None:
            counts[str(name)] = counts.get(str(name), 0) + 1
    return dict(sorted(counts.items(), key=lambda item: (-item[1], item[0])))


def _binding(view: View, grid: _Grid, figure: Figure) -> None:
    axes = figure.subplots()
    named = list(binding(view))[:_MOST_BINDING]
    x, y = _edges(grid.x), _edges(grid.y)
    axes.pcolormesh(x, y, np.zeros(grid.run.shape), cmap="Greys", vmin=0, vmax=1, edgecolors=PALE, linewidth=0.5)
    for row in range(len(grid.y)):
        for column in range(len(grid.x)):
            name = view.results.lines[grid.run[row, column]].get("binding_contact")
            letter = "" if name is None else chr(65 + named.index(str(name))) if name in named else "…"
            axes.text(grid.x[column], grid.y[row], letter, ha="center", va="center")
    _border(axes, x, y, grid.of(view.good), grid.of(view.done))
    _labelled(view, axes, view.free[0], view.free[1])
    legend = "; ".join(f"{chr(65 + n)}: {name}" for n, name in enumerate(named))
    axes.set_title("what binds: " + legend, fontsize=7.5, wrap=True)


def changes(tolerances: Sequence[Mapping[str, Any]]) -> str:
    """SVG of what tolerances become, as multiples of what they are now; from an allocation's file."""
    return drawn(partial(_bars, tolerances), (WIDTH, 0.9 + 0.32 * len(tolerances))).decode()


def _bars(tolerances: Sequence[Mapping[str, Any]], figure: Figure) -> None:
    axes = figure.subplots()
    names = [str(t["name"]).replace("_", " ") for t in tolerances]
    factors = [float(t["after"]) / float(t["now"]) for t in tolerances]
    colours = [GREY if t["after"] >= (1.0 - 1e-9) * t["high"] else BLUE for t in tolerances]
    axes.barh(names, factors, color=colours, height=0.6)
    axes.axvline(1.0, color=INK, linewidth=0.8)
    for place, factor in enumerate(factors):
        axes.text(factor, place, f" {factor:.3g}", va="center")
    axes.invert_yaxis()
    axes.set_xlim(0.0, 1.1 * max(factors))
    axes.set_xlabel("new tolerance / present one; grey: the loosest allowed")
