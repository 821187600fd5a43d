"""Clearance and margin along the path: what the parts leave free, and what is left of it when all errors have taken."""

from functools import partial
from textwrap import fill
from typing import Any

import numpy as np

from fmopt.plan import Plan, Segment
from fmopt.report.drawing import BLUE, GREY, INK, RUST, WIDTH, Axes, Drawing, Figure, legend
from fmopt.report.moves import MoveWords, margin_name, margin_words, moves, turn_of, way_of
from fmopt.report.naming import binding_label
from fmopt.spatial.values import Array

TITLE = "Clearance and margin along the path; what binds is named under each move's number"
_LETTERS = 70.0  # points; the words of moves are written in letters of this over their number, 8 at most
_LINEAR = 10.0  # µm: the vertical axis is linear between minus this and this, logarithmic beyond


def drawing(plan: Plan) -> Drawing:
    """Steps over the travel, each move equally wide: the clearance dashed, the margin solid, hatched between."""
    said = [f"move {m.number} {margin_words(m.margin)}, bound by {binding_label(plan, m.binding)}" for m in moves(plan)]
    alt = f"Clearance and {margin_name(plan)} of every piece of the motion. Smallest by move: {'; '.join(said)}."
    return Drawing("margin", TITLE, alt, (WIDTH, 4.1), partial(_paint, plan))


def _paint(plan: Plan, figure: Figure) -> None:
    axes = figure.subplots()
    run = moves(plan)
    marks = [0.0, *np.cumsum([sum(_length(plan, piece) for piece in move.segments) for move in run]).tolist()]
    edges = [_edges(plan, move, k) for k, move in enumerate(run)]
    for move, places in zip(run, edges, strict=True):
        _steps(axes, move, places)
    axes.axhline(0.0, color=INK, linewidth=1.0)
    axes.set_yscale("symlog", linthresh=_LINEAR)
    values = np.concatenate([[_LINEAR], *(_micrometres(move).ravel() for move in run)])
    # Room for the words above, which on a logarithmic axis is a factor.
    axes.set_ylim(min(4.0 * float(np.min(values)), -0.3 * _LINEAR), 20.0 * float(np.max(values)))
    fontsize = min(8.0, _LETTERS / len(run))
    for k, move in enumerate(run):
        axes.axvline(k, color=GREY, linewidth=0.5, linestyle=":")
        words = f"move {move.number}\n" + fill(binding_label(plan, move.binding), 12, break_on_hyphens=False)
        axes.text(k + 0.5, 0.985, words, ha="center", va="top", fontsize=fontsize, transform=axes.get_xaxis_transform())
    _point_at_smallest(axes, run, edges)
    axes.set_xlim(0, len(run))
    axes.set_xticks(range(len(marks)), [f"{mark:.3g}" for mark in marks])
    axes.set_xlabel("travel so far, mm, turning counted with ρ (every move drawn equally wide)")
    axes.set_ylabel("µm (linear up to 10, logarithmic beyond)")
    axes.yaxis.set_major_formatter(lambda value, _: f"{value:.0f}".replace("-", "−"))
    axes.set_title(f"Clearance and {margin_name(plan)}")
    entries: dict[str, dict[str, Any]] = {
        "clearance of the nominal motion": {"color": GREY, "linestyle": "--"},
        margin_name(plan): {"color": BLUE, "linewidth": 2.0},
        "taken by errors and curvature": {"facecolor": "none", "edgecolor": "#bbbbbb", "hatch": "/////"},
    }
    legend(axes, entries, loc="upper center", bbox_to_anchor=(0.5, -0.16), ncols=3)


def _length(plan: Plan, piece: Segment) -> float:
    """ρ-metric length of a piece, mm."""
    way, angle = np.linalg.norm(way_of(piece)), np.linalg.norm(turn_of(piece))
    return 1e3 * float(np.hypot(way, plan.rho * angle))


def _edges(plan: Plan, move: MoveWords, left: int) -> Array:
    """Where the pieces of a move begin and end on the axis: shares of its length, from `left` to `left` + 1."""
    passed = np.concatenate([[0.0], np.cumsum([_length(plan, piece) for piece in move.segments])])
    # Pieces of a move without any length share it evenly.
    return left + (passed / passed[-1] if passed[-1] > 0.0 else np.linspace(0.0, 1.0, len(passed)))


def _steps(axes: Axes, move: MoveWords, places: Array) -> None:
    clearance, margin = _micrometres(move)
    stairs: dict[str, Any] = {"baseline": None}  # no closing lines down to zero
    axes.stairs(clearance, places, color=GREY, linestyle="--", linewidth=1.2, **stairs)
    x, low, high = np.repeat(places, 2)[1:-1], np.repeat(margin, 2), np.repeat(clearance, 2)
    axes.fill_between(x, low, high, facecolor="none", edgecolor="#bbbbbb", hatch="/////", linewidth=0)
    axes.stairs(margin, places, color=BLUE, linewidth=2.0, **stairs)


def _micrometres(move: MoveWords) -> Array:
    """Clearances and margins (2, n) of a move's pieces, µm."""
    return 1e6 * np.array([(piece.clearance, piece.margin) for piece in move.segments]).T


def _point_at_smallest(axes: Axes, run: tuple[MoveWords, ...], edges: list[Array]) -> None:
    move = min(run, key=lambda m: m.margin)
    _, margins = _micrometres(move)
    piece = int(np.argmin(margins))
    place = 0.5 * (edges[move.number - 1][piece] + edges[move.number - 1][piece + 1])
    name = "smallest: " if move.margin > 0.0 else ""
    axes.plot([place], [margins[piece]], "o", color=RUST, markersize=5, markerfacecolor="white", markeredgewidth=1.6)
    side = -1 if place > 0.6 * len(run) else 1
    style: Any = {"textcoords": "offset points", "ha": "left" if side > 0 else "right", "color": RUST}
    axes.annotate(name + margin_words(move.margin), (place, margins[piece]), (side * 8, -11), **style)
