"""Figures of a study: curves over one axis, maps over two with the border of what works, samples axis by axis."""

from __future__ import annotations

import string
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from textwrap import fill
from typing import Any

import numpy as np

from fmopt.report.drawing import BLUE, DASHES, GREY, INK, PALE, RUST, WIDTH, Axes, Figure, drawn
from fmopt.spatial.values import Array, Bits
from fmopt.study.results.shares import bins
from fmopt.study.results.table import Varied
from fmopt.study.results.view import View, answer_label, axis_label, ticks

_LINE = 100  # characters of a title
_MOST_TICKS = 10
_GOOD = {"CERTIFIED": BLUE, "held": BLUE, "feasible": BLUE}
_REST = (RUST, GREY, INK, "#6b5876", "#8c6d1f", "#4f6f52")
_MOST_BINDING = 10  # contacts that are told apart


def figures(view: View) -> dict[str, tuple[str, str]]:
    """The figures of a study by name: what each shows, and its SVG, the same bytes for the same results."""
    if not view.done.any():
        return {}
    grid, rows = _grid(view), 2.6 * -(-len(view.free) // 2)
    over = f"over {' and '.join(axis_label(axis) for axis in view.free)}"
    chosen: dict[str, tuple[str, Callable[[Figure], None], float]] = {}
    for name in view.answers:
        paint, height = partial(_clouds, view, name), rows
        if grid is not None:
            paint, height = partial(_map, view, name, grid), 4.2
        elif len(view.free) == 1:
            paint, height = partial(_curve, view, name), 3.4
        chosen[name] = (f"{answer_label(name)}, {over}", paint, height)
    if len(set(view.kinds)) > 1 and (grid is not None or len(view.free) == 1):
        paint, height = (partial(_strip, view), 2.4) if grid is None else (partial(_verdicts, view, grid), 4.2)
        chosen["verdict"] = (f"what became of the runs, {over}", paint, height)
    if not view.good[view.done].all():
        words = f"share of runs that are {view.goodness}, with 95 % intervals"
        chosen["share"] = (words, partial(_shares, view), rows)
    if grid is not None and "binding_contact" in view.results.columns:
        chosen["binding"] = ("what binds where, by the letters above the map", partial(_binding, view, grid), 4.2)
    return {name: (words, drawn(p, (WIDTH, height)).decode()) for name, (words, p, height) in chosen.items()}


@dataclass(frozen=True, eq=False)
class _Grid:
    """A full grid over two axes: its values along both with the borders of the cells, and the run in each cell."""

    x: Array
    y: Array
    run: Any
    borders: tuple[Array, Array]

    def of(self, values: Any) -> Any:
        """Values (n,) as a table over y and x."""
        return np.asarray(values)[self.run]


def _grid(view: View) -> _Grid | None:
    if len(view.free) != 2:
        return None
    first, second = (view.axis(axis) for axis in view.free)
    (x, i), (y, j) = (np.unique(values, return_inverse=True) for values in (first, second))
    # As many runs as cells: one that has two leaves another empty, which stays −1. Borders take two values at least.
    if len(x) * len(y) != len(first) or min(len(x), len(y)) < 2:
        return None
    run = np.full((len(y), len(x)), -1)
    run[j, i] = np.arange(len(first))
    return None if (run < 0).any() else _Grid(x, y, run, (_edges(x, view.free[0].log), _edges(y, view.free[1].log)))


def _edges(values: Array, log: bool) -> Array:
    """Borders (n + 1,) of cells around values (n,), half way between them, or half way in the logarithm."""
    if log:
        return np.asarray(np.exp(_edges(np.log(values), False)))
    middle = 0.5 * (values[1:] + values[:-1])
    return np.concatenate([[values[0] - (middle[0] - values[0])], middle, [values[-1] + (values[-1] - middle[-1])]])


def _map(view: View, name: str, grid: _Grid, figure: Figure) -> None:
    axes = figure.subplots()
    values = np.ma.masked_invalid(grid.of(view.answer(name)))
    x, y = grid.borders
    axes.set_facecolor("white")
    mesh = axes.pcolormesh(x, y, values, cmap="cividis", edgecolors="white", linewidth=0.3)
    figure.colorbar(mesh, ax=axes, label=answer_label(name))
    poor = np.ma.masked_array(np.ones(values.shape), values.mask | grid.of(view.good))
    if poor.count():
        # Not pcolormesh, which draws no hatches.
        axes.pcolor(x, y, poor, hatch="///", edgecolor="white", linewidth=0.0, facecolor="none")
    for row, column in zip(*np.nonzero(values.mask | np.zeros(values.shape, bool)), strict=True):
        axes.text(grid.x[column], grid.y[row], "×", ha="center", va="center", color=GREY)
    _border(axes, x, y, grid.of(view.good), grid.of(view.done))
    _labelled(view, axes, view.free[0], view.free[1])
    words = f"; hatched: not {view.goodness}" if poor.count() else ""
    axes.set_title(title(view, name, words, "; ×: no value"))


def title(view: View, name: str, border: str, nothing: str) -> str:
    """The title of an answer's figure, with words on runs that did not come out well, or have no value, if any."""
    words = "" if view.good[view.done].all() else border
    return answer_label(name) + words + ("" if np.isfinite(view.answer(name)).all() else nothing)


def _border(axes: Axes, x: Array, y: Array, good: Bits, done: Bits) -> None:
    """The line between cells that came out well and others, of those that have answers."""
    rows, columns = good.shape
    beside = (good[:, 1:] != good[:, :-1]) & done[:, 1:] & done[:, :-1]
    above = (good[1:] != good[:-1]) & done[1:] & done[:-1]
    lines = [((x[c + 1], x[c + 1]), (y[r], y[r + 1])) for r in range(rows) for c in range(columns - 1) if beside[r, c]]
    lines += [((x[c], x[c + 1]), (y[r + 1], y[r + 1])) for r in range(rows - 1) for c in range(columns) if above[r, c]]
    # All of the white first, so that none of it lies on the red of a neighbour.
    for color, linewidth in (("white", 4.0), (RUST, 2.0)):
        for across, up in lines:
            axes.plot(across, up, color=color, linewidth=linewidth, solid_capstyle="projecting")


def _labelled(view: View, axes: Axes, across: Varied, up: Varied) -> None:
    axes.set_xlabel(axis_label(across))
    axes.set_ylabel(axis_label(up))
    for axis, scale, put in ((across, axes.set_xscale, axes.set_xticks), (up, axes.set_yscale, axes.set_yticks)):
        if axis.log:
            scale("log")
        if axis.unit == "word":
            put(range(len(view.words(axis))), view.words(axis))
        elif len(places := np.unique(view.axis(axis))) <= _MOST_TICKS:
            put([], minor=True)  # a logarithmic axis would label its own in between
            put(places, ticks(places))


def _across(view: View, axes: Axes, axis: Varied) -> None:
    """Labels the axis of x."""
    axes.set_xscale("log" if axis.log else "linear")
    if axis.unit == "word":
        axes.set_xticks(range(len(view.words(axis))), view.words(axis))
    axes.set_xlabel(axis_label(axis))


def _curve(view: View, name: str, figure: Figure) -> None:
    axes = figure.subplots()
    axis = view.free[0]
    order = np.argsort(view.axis(axis), kind="stable")
    x, y, good = view.axis(axis)[order], view.answer(name)[order], view.good[order]
    axes.plot(x, y, color=GREY, linewidth=1.0)
    if name == "success":
        bounds = 100.0 * view.column("success_low")[order], 100.0 * view.column("success_high")[order]
        axes.vlines(x, *bounds, color=GREY, linewidth=3.0, label="95 % interval")
    axes.plot(x[good], y[good], "o", color=BLUE, label=view.goodness)
    if not good.all():
        axes.plot(x[~good], y[~good], "o", color=RUST, markerfacecolor="white", label=f"not {view.goodness}")
    for place in x[~np.isfinite(y)]:
        axes.axvline(place, color=RUST, linewidth=0.8, linestyle=DASHES[1])
    if np.nanmin(y) < 0.0 < np.nanmax(y):
        axes.axhline(0.0, color=INK, linewidth=0.8)
    _across(view, axes, axis)
    axes.set_ylabel(answer_label(name))
    axes.legend()
    axes.set_title(title(view, name, "", "; dashed: no value"))


def _panels(view: View, label: str, figure: Figure) -> Iterator[tuple[Axes, Varied]]:
    """Two panels a row, one for each free axis, with one label up."""
    panels = figure.subplots(-(-len(view.free) // 2), 2, squeeze=False, sharey=True).ravel()
    yield from zip(panels, view.free, strict=False)
    for axes in panels[len(view.free) :]:
        axes.set_axis_off()
    panels[0].set_ylabel(label)


def _clouds(view: View, name: str, figure: Figure) -> None:
    y, good = view.answer(name), view.good
    for axes, axis in _panels(view, answer_label(name), figure):
        x = view.axis(axis)
        axes.plot(x[good], y[good], ".", color=BLUE, markersize=4)
        axes.plot(x[~good], y[~good], "x", color=RUST, markersize=4)
        _across(view, axes, axis)
    figure.suptitle(f"{answer_label(name)}; dots: {view.goodness}, crosses: not")


def _shares(view: View, figure: Figure) -> None:
    for axes, axis in _panels(view, view.goodness, figure):
        for group in bins(view, axis):
            found, middle = group.share, 0.5 * (group.low + group.high)
            axes.plot([middle, middle], [found.low, found.high], color=GREY, linewidth=3.0)
            axes.plot([group.low, group.high], [found.value, found.value], color=BLUE)
            axes.plot([middle], [found.value], "o", color=BLUE)
        axes.set_ylim(-0.03, 1.03)
        _across(view, axes, axis)
    figure.suptitle(f"share that is {view.goodness}, 95 % intervals")


def _verdicts(view: View, grid: _Grid, figure: Figure) -> None:
    """A map of what became of each run; every kind with its own grey or colour, and its own letter."""
    from matplotlib.colors import ListedColormap

    axes = figure.subplots()
    kinds = sorted(set(view.kinds), key=lambda kind: (kind not in _GOOD, kind))
    rest = [kind for kind in kinds if kind not in _GOOD]
    shades = [_GOOD[kind] if kind in _GOOD else _REST[rest.index(kind) % len(_REST)] for kind in kinds]
    # The number of a kind is in the middle of its colour's range.
    number, colours, most = grid.of([*map(kinds.index, view.kinds)]), ListedColormap(shades), len(kinds) - 0.5
    axes.pcolormesh(*grid.borders, number, cmap=colours, vmin=-0.5, vmax=most, edgecolors="white")
    _lettered(view, axes, grid, view.kinds, kinds, color="white", weight="bold")


def _lettered(
    view: View, axes: Axes, grid: _Grid, names: Sequence[str | None], listed: Sequence[str], **style: Any
) -> None:
    """Writes a letter into every cell for its run's name, as far as that is listed, and says which is whose."""
    letters = dict(zip(listed, string.ascii_uppercase, strict=False))
    for (row, column), run in np.ndenumerate(grid.run):
        name = names[run]
        letter = "" if name is None else letters.get(name, "…")
        axes.text(float(grid.x[column]), float(grid.y[row]), letter, ha="center", va="center", **style)
    _labelled(view, axes, view.free[0], view.free[1])
    axes.set_title(fill("; ".join(f"{letters.get(name, '…')}: {name}" for name in listed), _LINE))


def _strip(view: View, figure: Figure) -> None:
    axes = figure.subplots()
    axis = view.free[0]
    kinds = sorted(set(view.kinds), key=lambda kind: (kind in _GOOD, kind))
    for row, kind in enumerate(kinds):
        mine = np.array([other == kind for other in view.kinds])
        axes.plot(view.axis(axis)[mine], np.full(int(mine.sum()), row), "o", color=_GOOD.get(kind, RUST))
    axes.set_yticks(range(len(kinds)), kinds)
    axes.set_ylim(-0.6, len(kinds) - 0.4)
    _across(view, axes, axis)
    axes.set_title("what became of the runs")


def binding(view: View) -> Mapping[str, int]:
    """What binds, most often first, with the number of runs."""
    counts = Counter(name for name in view.bindings if name is not None)
    return dict(sorted(counts.items(), key=lambda item: (-item[1], item[0])))


def _binding(view: View, grid: _Grid, figure: Figure) -> None:
    axes = figure.subplots()
    x, y = grid.borders
    axes.pcolormesh(x, y, np.zeros(grid.run.shape), cmap="Greys", vmin=0, vmax=1, edgecolors=PALE, linewidth=0.5)
    _border(axes, x, y, grid.of(view.good), grid.of(view.done))
    _lettered(view, axes, grid, view.bindings, [*binding(view)][:_MOST_BINDING])


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
