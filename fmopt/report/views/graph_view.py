"""The contact graph of a critical point with the chosen states, or the chain of the states when no graph is given."""

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from textwrap import wrap
from typing import Any

import numpy as np

from fmopt.plan import Plan
from fmopt.report.drawing import GREY, INK, PALE, RUST, WIDTH, Axes, Drawing, Figure
from fmopt.report.moves import states
from fmopt.spatial.values import Array

TITLE = "Contact states, by how many freedoms they leave, and the chosen sequence"
_LINE = 0.165  # inches a line of the legend
_COLUMNS = 100  # characters of a legend line
_SWEEPS = 6
_FEW = 24  # states beside the path that can all carry their names


@dataclass(frozen=True)
class StateGraph:
    """A contact graph of a plan: contacts and dimension of each state, sons of each, chosen states in order."""

    name: str
    contacts: tuple[tuple[str, ...], ...]
    dimensions: tuple[int, ...]
    sons: tuple[tuple[int, ...], ...]
    chosen: tuple[int, ...]

    @property
    def links(self) -> tuple[tuple[int, int], ...]:
        """Pairs (father, son)."""
        return tuple((i, j) for i, sons in enumerate(self.sons) for j in sons)


def graphs(plan: Plan) -> tuple[StateGraph, ...]:
    """The graphs that the plan carries and that have chosen states; else the chain of its own states."""
    chosen = [graph for graph in plan.diagnostics.graphs if graph.chosen]
    if chosen:
        return tuple(state_graph(g.critical_point, g.states, g.sons, g.chosen) for g in chosen)
    contacts, dimensions = zip(*states(plan), strict=True)
    sons = (*((i,) for i in range(1, len(contacts))), ())
    return (StateGraph("", contacts, dimensions, sons, tuple(range(len(contacts)))),)


def state_graph(name: str, listed: Iterable[Any], sons: Sequence[Sequence[int]], chosen: Sequence[int]) -> StateGraph:
    """A graph of states that have contacts and a dimension."""
    contacts, dimensions = zip(*((state.contacts, state.dimension) for state in listed), strict=True)
    return StateGraph(name, contacts, dimensions, tuple(map(tuple, sons)), tuple(chosen))


def drawings(plan: Plan) -> list[Drawing]:
    """A drawing of each graph, named "states", "states-2", and so on."""
    return [drawing("states" if k == 1 else f"states-{k}", graph) for k, graph in enumerate(graphs(plan), start=1)]


def drawing(name: str, graph: StateGraph) -> Drawing:
    """States as dots in rows by dimension, the chosen ones numbered along a thick line; below, what they hold."""
    words = "; ".join(f"{order}: {_named(graph.contacts[i])}" for order, i in enumerate(graph.chosen))
    counts = ", ".join(f"{n} of dimension {d}" for d, n in sorted(Counter(graph.dimensions).items(), reverse=True))
    among = f"{len(graph.contacts)} states of the contact graph" if graph.name else ""
    alt = f"The chosen sequence of contact states{' among ' * bool(among)}{among}. {words}."
    alt = alt if graph.chosen else f"{among}: {counts}."
    size = WIDTH, _picture_height(graph) + _LINE * (len(_legend(graph)) + 1)
    title = TITLE if graph.chosen else f"{len(graph.contacts)} contact states by dimension"
    return Drawing(name, title, alt, size, partial(_paint, graph))


def _paint(graph: StateGraph, figure: Figure) -> None:
    lines = _legend(graph)
    axes, text = figure.subplots(2, 1, height_ratios=[_picture_height(graph), _LINE * (len(lines) + 1)])
    text.axis("off")
    for row, (line, strong) in enumerate(lines):
        place = 1.0 - (row + 0.5) / (len(lines) + 1)
        text.text(0.0, place, line, va="center", fontsize=8, color=INK if strong else GREY, transform=text.transAxes)
    if graph.dimensions:
        in_order = np.column_stack([np.arange(len(graph.dimensions)), graph.dimensions]).astype(np.float64)
        places = _layered(graph) if graph.name else in_order
        _draw_links(axes, graph, places)
        _draw_states(axes, graph, places)
    layers = sorted(set(graph.dimensions))
    axes.set_yticks(layers, [str(layer) for layer in layers])
    axes.set_ylim(min(layers, default=0) - 0.6, max(layers, default=0) + 0.6)
    axes.set_xticks([])
    axes.spines["bottom"].set_visible(False)
    axes.set_ylabel("freedoms left")
    axes.set_title(f"{len(graph.contacts)} contact states at “{graph.name}”" if graph.name else "The states, in order")


def _draw_links(axes: Axes, graph: StateGraph, places: Array) -> None:
    if graph.links:  # one line with gaps: a tenth of the size of as many lines
        ends = places[np.array(graph.links)]
        broken = np.concatenate([ends, np.full((len(ends), 1, 2), np.nan)], axis=1).reshape(-1, 2)
        axes.plot(broken[:, 0], broken[:, 1], color=PALE, linewidth=0.4, zorder=1)
    arrow = {"arrowstyle": "-|>", "color": RUST, "lw": 1.8, "shrinkB": 7}
    for a, b in pairwise(graph.chosen):
        axes.annotate("", places[b], places[a], zorder=3, arrowprops=arrow)


def _draw_states(axes: Axes, graph: StateGraph, places: Array) -> None:
    axes.scatter(places[:, 0], places[:, 1], s=9, color=GREY, linewidths=0, zorder=2)
    visits: dict[int, list[str]] = {}
    for number, state in enumerate(graph.chosen):
        visits.setdefault(state, []).append(str(number))
    beside = _beside(graph)
    for i in beside if len(beside) <= _FEW else ():
        father = next((f for f in graph.chosen if i in graph.sons[f]), None)
        extra = [c for c in graph.contacts[i] if father is None or c not in graph.contacts[father]]
        name = "+" + extra[0] + (" …" if len(extra) > 1 else "") if extra else ""
        axes.annotate(name, places[i], (0, -9), textcoords="offset points", ha="center", fontsize=8, color=GREY)
    for state, numbers in visits.items():
        circle = {"boxstyle": "circle,pad=0.3", "facecolor": "white", "edgecolor": RUST, "linewidth": 1.6}
        text = ",".join(numbers)
        axes.annotate(text, places[state], ha="center", va="center", bbox=circle, zorder=4, fontsize=8, color=INK)
    axes.margins(0.05)


def _beside(graph: StateGraph) -> list[int]:
    """Sons of the chosen states that were not chosen."""
    return sorted({j for i in graph.chosen for j in graph.sons[i]} - set(graph.chosen))


def _legend(graph: StateGraph) -> list[tuple[str, bool]]:
    """Lines of the legend, each with whether it is printed strongly."""
    lines, count = [], len(_beside(graph))
    for number, state in enumerate(graph.chosen):
        held = wrap(_named(graph.contacts[state]), _COLUMNS) or [""]
        lines += [(f"{number if k == 0 else ' ':<3} {line}", True) for k, line in enumerate(held)]
    if count > _FEW:
        lines.append((f"{count} states border on the path; they are too many to be named here.", False))
    elif count:
        lines.append(("+ names what a state beside the path holds more than the one above it on the path.", False))
    return lines


def _named(contacts: Sequence[str]) -> str:
    return ", ".join(contacts) or "free space"


def _picture_height(graph: StateGraph) -> float:
    return (0.55 if graph.name else 0.36) * len(set(graph.dimensions)) + 0.6


def _layered(graph: StateGraph) -> Array:
    """Places (n, 2): rows by dimension, in each row by the mean place of the neighbours, a few sweeps up and down."""
    count = len(graph.dimensions)
    near: list[list[int]] = [[] for _ in range(count)]
    for i, j in graph.links:
        near[i].append(j)
        near[j].append(i)
    layers = {d: [i for i in range(count) if graph.dimensions[i] == d] for d in sorted(set(graph.dimensions))}
    across = np.zeros(count)
    for layer in layers.values():
        across[layer] = _spread(len(layer))
    for sweep in range(_SWEEPS):
        for dimension in sorted(layers, reverse=sweep % 2 == 0):
            layer = layers[dimension]
            pull = [float(np.mean(across[near[i]])) if near[i] else 0.0 for i in layer]
            # Ties by number, so that the picture is the same every time.
            order = [layer[k] for k in sorted(range(len(layer)), key=lambda k: (pull[k], layer[k]))]
            across[order] = _spread(len(layer))
    return np.column_stack([across, np.array(graph.dimensions, dtype=np.float64)])


def _spread(count: int) -> Array:
    return np.linspace(-1.0, 1.0, count) if count > 1 else np.zeros(1)
