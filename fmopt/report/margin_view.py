"""Clearance and margin along the path: what the parts leave free, and what is left of it when all errors have taken."""

from __future__ import annotations

from collections.abc import Mapping
from textwrap import fill
from typing import TYPE_CHECKING, Any

import numpy as np

from fmopt.report.drawing import BLUE, GREY, INK, RUST, WIDTH
from fmopt.report.moves import Move, characteristic_length, margin_name, margin_words, moves, turn_of, way_of
from fmopt.report.naming import binding_label
from fmopt.values import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

TITLE = "Clearance and margin along the path; what binds is named under each move's number"
_LETTERS = 70.0  # points; the words of moves are written in letters of this over their number, 8 at most
_LINEAR = 10.0  # µm: the vertical axis is linear between minus this and this, logarithmic beyond


def size(plan: Mapping[str, Any]) -> tuple[float, float]:
    """Width and height in inches."""
    return WIDTH, 4.1


def alt(plan: Mapping[str, Any]) -> str:
    """What is to be seen, for who cannot see it."""
    said = [f"move {m.number} {margin_words(m.margin)}, bound by {binding_label(plan, m.binding)}" for m in moves(plan)]
    return f"Clearance and {margin_name(plan)} of every piece of the motion. Smallest by move: {'; '.join(said)}."


def paint(plan: Mapping[str, Any], figure: Figure) -> None:
    """Steps over the travel, each move equally wide: the clearance dashed, the margin solid, hatched between."""
    axes = figure.subplots()
    run = moves(plan)
    marks = _marks(plan, run)
    edges = [_edges(plan, move, k) for k, move in enumerate(run)]
    for move, places in zip(run, edges, strict=True):
        _steps(axes, move, places)
    axes.axhline(0.0, color=INK, linewidth=1.0)
    axes.set_yscale("symlog", linthresh=_LINEAR)
    values = np.array([*(v for move in run for key in ("clearance", "margin") for v in _values(move, key)), _LINEAR])
    axes.set_ylim(min(4.0 * float(np.nanmin(values)), -0.3 * _LINEAR), 20.0 * float(np.nanmax(values)))
    fontsize = min(8.0, _LETTERS / max(len(run), 1))
    for k, move in enumerate(run):
        axes.axvline(k, color=GREY, linewidth=0.5, linestyle=":")
        words = f"move {move.number}\n" + fill(binding_label(plan, move.binding), 12, break_on_hyphens=False)
        axes.text(k + 0.5, 0.985, words, ha="center", va="top", fontsize=fontsize, transform=axes.get_xaxis_transform())
    _point_at_smallest(axes, run, edges)
    axes.set_xlim(0, max(len(run), 1))
    axes.set_xticks(range(len(marks)), [f"{mark:.3g}" for mark in marks])
    axes.set_xlabel("travel so far, mm, turning counted with ρ (every move drawn equally wide)")
    axes.set_ylabel("µm (linear up to 10, logarithmic beyond)")
    axes.yaxis.set_major_formatter(lambda value, _: f"{value:.0f}".replace("-", "−"))
    axes.set_title(f"Clearance and {margin_name(plan)}")
    _legend(axes, plan)


def _length(plan: Mapping[str, Any], piece: Mapping[str, Any]) -> float:
    """ρ-metric length of a piece, mm."""
    way, angle = np.linalg.norm(way_of(piece)), np.linalg.norm(turn_of(piece))
    return 1e3 * float(np.hypot(way, characteristic_length(plan) * angle))


def _marks(plan: Mapping[str, Any], run: tuple[Move, ...]) -> list[float]:
    """Travel at the ends of the moves, mm."""
    lengths = [sum(_length(plan, piece) for piece in move.segments) for move in run]
    return [0.0, *np.cumsum(lengths).tolist()]


def _edges(plan: Mapping[str, Any], move: Move, left: int) -> Array:
    """Where the pieces of a move begin and end on the axis: shares of its length, from `left` to `left` + 1."""
    passed = np.concatenate([[0.0], np.cumsum([_length(plan, piece) for piece in move.segments])])
    return left + (passed / passed[-1] if passed[-1] > 0.0 else np.linspace(0.0, 1.0, len(passed)))


def _steps(axes: Axes, move: Move, places: Array) -> None:
    clearance, margin = (_values(move, key) for key in ("clearance", "margin"))
    stairs: dict[str, Any] = {"baseline": None}
    axes.stairs(clearance, places, color=GREY, linestyle="--", linewidth=1.2, **stairs)
    x, low, high = np.repeat(places, 2)[1:-1], np.repeat(margin, 2), np.repeat(clearance, 2)
    axes.fill_between(x, low, high, facecolor="none", edgecolor="#bbbbbb", hatch="/////", linewidth=0)
    axes.stairs(margin, places, color=BLUE, linewidth=2.0, **stairs)


def _values(move: Move, key: str) -> Array:
    """The values of a move's pieces, µm; not a number where a piece states none."""
    return np.array([np.nan if piece.get(key) is None else 1e6 * piece[key] for piece in move.segments])


def _point_at_smallest(axes: Axes, run: tuple[Move, ...], edges: list[Array]) -> None:
    stated = [move for move in run if move.margin is not None]
    if not stated:
        return
    move = min(stated, key=lambda m: float(m.margin or 0.0))
    margins = _values(move, "margin")
    piece = int(np.nanargmin(margins))
    place = 0.5 * (edges[move.number - 1][piece] + edges[move.number - 1][piece + 1])
    name = "smallest: " if move.margin and move.margin > 0.0 else ""
    axes.plot([place], [margins[piece]], "o", color=RUST, markersize=5, markerfacecolor="white", markeredgewidth=1.6)
    side = -1 if place > 0.6 * len(run) else 1
    axes.annotate(
        name + margin_words(move.margin),
        (place, margins[piece]),
        (side * 8, -11),
        textcoords="offset points",
        ha="left" if side > 0 else "right",
        color=RUST,
    )


def _legend(axes: Axes, plan: Mapping[str, Any]) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    handles = [
        Line2D([], [], color=GREY, linestyle="--", label="clearance of the nominal motion"),
        Line2D([], [], color=BLUE, linewidth=2.0, label=margin_name(plan)),
        Patch(facecolor="none", edgecolor="#bbbbbb", hatch="/////", label="taken by errors and curvature"),
    ]
    axes.legend(handles=handles, loc="upper center", bbox_to_anchor=(0.5, -0.16), ncols=3)
