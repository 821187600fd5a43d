"""The uncertainty budget: what each source adds to the half-widths of the start error."""

import math
from functools import partial
from typing import TypeAlias

import numpy as np

from fmopt.plan import Plan
from fmopt.plan.position_force import AXES
from fmopt.report.drawing import BLUE, GREY, INK, PALE, RUST, WIDTH, Drawing, Figure
from fmopt.report.naming import AXES_READ, degrees, millimetres
from fmopt.report.shell import table
from fmopt.spatial.values import Array

Shares: TypeAlias = list[tuple[str, Array]]
TITLE = "Uncertainty budget: which source adds how much to the start error"
_FILLS = (  # face, hatch: told apart in black and white, too
    (BLUE, ""),
    (PALE, ""),
    (RUST, ""),
    ("white", "////"),
    (GREY, ""),
    ("white", "...."),
    ("#9fbfe0", "\\\\\\\\"),
    ("#e6c3a5", "xxxx"),
)


def shares(plan: Plan) -> Shares:
    """Sources with what each adds to the half-widths (6,), m and rad; those that add nothing are left out."""
    named = ((f"{i.source} ({i.symbol})" if i.symbol else i.source, i.box) for i in plan.diagnostics.budget)
    return [(name, np.array(box, dtype=np.float64)) for name, box in named if any(box)]


def drawing(listed: Shares) -> Drawing:
    """One bar of 100 % for each axis, or axes alike, in parts by source."""
    bars = _bars(listed)
    words = "; ".join(f"{names}: {', '.join(parts)}" for names, _, parts in bars)
    size = WIDTH, 0.9 + 0.36 * len(bars) + 0.19 * math.ceil(len(listed) / 2)
    return Drawing("budget", TITLE, f"Parts of the start error by source. {words}.", size, partial(_paint, listed))


def budget_table(plan: Plan) -> str:
    """One row per source and one for the sum."""
    listed = shares(plan)
    if not listed:
        return ""
    whole = np.sum([box for _, box in listed], axis=0)
    rows = [(name, *_row(box, whole)) for name, box in listed]
    rows.append(("sum", *_row(whole, None)))
    return table("Sources of the start error, half-widths", ("source", *AXES_READ), rows, ".nnnnnn")


def _row(box: Array, whole: Array | None) -> list[str]:
    cells = [millimetres(value) for value in box[:3]] + [degrees(value) for value in box[3:]]
    if whole is None:
        return cells
    return [f"{cell} ({_percent(b, w)})" if b else "0" for cell, b, w in zip(cells, box, whole, strict=True)]


def _percent(part: float, whole: float) -> str:
    return f"{100.0 * part / whole:.3g} %" if whole else "0 %"


def _bars(listed: Shares) -> list[tuple[str, Array, list[str]]]:
    """Axes that have the same budget as one bar: their names with the sum, shares of 1, and the shares in words."""
    boxes = np.array([box for _, box in listed]).reshape(-1, 6)
    # Alike to the last bit, as a bar says one sum for all of its axes; lengths and angles apart.
    groups: dict[tuple[bool, bytes], list[int]] = {}
    for axis in np.flatnonzero(boxes.any(axis=0)).tolist():
        groups.setdefault((axis < 3, boxes[:, axis].tobytes()), []).append(axis)
    bars = []
    for axes in groups.values():
        column = boxes[:, axes[0]]
        total = float(column.sum())
        reach = f"±{millimetres(total)} mm" if axes[0] < 3 else f"±{degrees(total)}°"
        parts = [f"{name} {_percent(v, total)}" for (name, _), v in zip(listed, column, strict=True) if v]
        bars.append((f"{', '.join(AXES[i] for i in axes)}  {reach}", column / total, parts))
    return bars


def _paint(listed: Shares, figure: Figure) -> None:
    axes = figure.subplots()
    bars = _bars(listed)
    left = np.zeros(len(bars))
    places = np.arange(len(bars))[::-1]
    for k, (name, _) in enumerate(listed):
        face, hatch = _FILLS[k % len(_FILLS)]
        width = np.array([100.0 * parts[k] for _, parts, _ in bars])
        axes.barh(places, width, 0.62, left, label=name, facecolor=face, hatch=hatch, edgecolor=INK, linewidth=0.6)
        left = left + width
    axes.set_yticks(places, [name for name, _, _ in bars])
    axes.set_xlim(0.0, 100.0)
    axes.set_xlabel("% of the half-width")
    axes.spines["left"].set_visible(False)
    axes.tick_params(axis="y", length=0)
    axes.set_title("Uncertainty budget of the start error")
    figure.legend(loc="outside lower center", ncols=2)
