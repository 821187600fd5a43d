"""Planar sets of possible contact as the plan has them: arcs in the colour of the circle that they lie on."""

import math
from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np

from fmopt.plan.diagnostics import Boundary, Curve
from fmopt.report.drawing import BLUE, GREY, INK, RUST, WIDTH, Axes, Drawing, Figure, legend
from fmopt.spatial.values import Array

TITLE = "Where uncertain features may be (Uv, Ul), and reference points that may touch (CUv, CUl)"
_PER_ROW = 3
# Colour and dashes of what a piece of a boundary lies on.
CARRIERS: dict[str, tuple[str, Any, str]] = {
    "r_M": (BLUE, "-", "outer circle about the centre of rotation"),
    "r_m": ("#5fa2dd", (0, (5, 1.5)), "inner circle about it"),
    "g_M": (RUST, "-", "circle about a tip turned by +ε_φ"),
    "g_m": ("#d98a3d", (0, (5, 1.5)), "circle about a tip turned by −ε_φ"),
    "n": ("#7a3b8f", (0, (1.5, 1.0)), "additional arc of case A"),
    "line": (INK, "-", "tangent line"),
}


def sets_size(sets: Sequence[Boundary]) -> tuple[float, float]:
    """Width and height in inches for this many sets."""
    return WIDTH, 0.75 + 2.35 * math.ceil(len(sets) / _PER_ROW)


def drawing(sets: Sequence[Boundary]) -> Drawing:
    """A panel for each set of a plan."""
    alt = f"Boundaries of planar uncertainty sets: {'; '.join(map(_said, sets))}."
    return Drawing("sets", TITLE, alt, sets_size(sets), partial(paint_sets, sets, upright="z"))


def _said(found: Boundary) -> str:
    pieces = [piece for loop in found.loops for piece in loop]
    x, y = 1e3 * np.ptp(np.vstack([piece_points(piece) for piece in pieces] or [np.zeros((1, 2))]), axis=0)
    arcs = sum(piece.arc is not None for piece in pieces)
    lines = sum(piece.line is not None for piece in pieces)
    return f"{found.name}, {x:.4g} by {y:.4g} mm, {arcs} arcs, {lines} lines"


def paint_sets(sets: Sequence[Boundary], figure: Figure, upright: str = "y") -> None:
    """A panel in mm for each set, such as `papers.basanez_suarez.account` makes; `upright` names its second axis."""
    grid = figure.subplots(math.ceil(len(sets) / _PER_ROW), _PER_ROW, squeeze=False).ravel()
    used = {piece.on for found in sets for loop in found.loops for piece in loop}
    for found, axes in zip(sets, grid, strict=False):
        _panel(axes, found)
        axes.set_ylabel(f"{upright}, mm", fontsize=7.5)
    for axes in grid[len(sets) :]:
        axes.set_visible(False)
    listed = [carrier for name, carrier in CARRIERS.items() if name in used]
    entries: dict[str, Any] = {words: {"color": c, "linestyle": d, "linewidth": 1.8} for c, d, words in listed}
    entries["without uncertainty"] = {"color": GREY, "linestyle": ":", "marker": "o", "markersize": 3.0}
    legend(figure, entries, loc="outside lower center", ncols=2)


def _panel(axes: Axes, found: Boundary) -> None:
    for loop in found.loops:
        edge = np.vstack([piece_points(piece)[:-1] for piece in loop])
        axes.fill(*(1e3 * edge.T), facecolor="#f2f2f2", edgecolor="none", zorder=0)
        for piece in loop:
            colour, dashes, _ = CARRIERS[piece.on]
            axes.plot(*(1e3 * piece_points(piece).T), color=colour, linestyle=dashes, linewidth=1.8)
    nominal = 1e3 * np.array(found.nominal).reshape(-1, 2)
    if len(nominal):
        axes.plot(*nominal.T, color=GREY, linestyle=":", linewidth=1.4, marker="o", markersize=3.0)
    axes.set_aspect("equal", adjustable="datalim")
    axes.margins(0.08)
    axes.set_title(found.name, fontsize=8.5)
    axes.tick_params(labelsize=7.0)
    axes.set_xlabel("x, mm", fontsize=7.5)


def piece_points(piece: Curve, step: float = 0.03) -> Array:
    """Points (k, 2), m, along a piece of a boundary, arcs in steps of at most `step`, rad."""
    if piece.line is not None:
        return np.array(piece.line, dtype=np.float64).reshape(2, 2)
    x, y, radius, start, sweep = piece.arc or (0.0,) * 5
    # In steps of 0.03 a chord is off its arc by 1e-4 of the radius.
    angles = start + np.linspace(0.0, sweep, max(math.ceil(abs(sweep) / step), 2) + 1)
    return np.column_stack([x + radius * np.cos(angles), y + radius * np.sin(angles)])
