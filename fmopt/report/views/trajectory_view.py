"""The trajectory over time: P(t) and the bands of S(t), and where the plan has them Pa(t) and Fa(t)."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from itertools import groupby
from typing import Any

import numpy as np

from fmopt.plan.description import Nominal, PositionForce
from fmopt.plan.position_force import AXES
from fmopt.report.drawing import BLUE, GREY, INK, RUST, WIDTH, Axes, Drawing, Figure, legend
from fmopt.report.naming import AXES_READ, SCALES
from fmopt.spatial.values import Array

TITLE = "Position and force over time, without errors"
STOPS = {0: "free", 1: "stopped in +", -1: "stopped in −", 2: "stopped in both"}
_BANDS: dict[int, dict[str, Any]] = {
    1: {"facecolor": "#f3e3d3", "edgecolor": "#b08050", "hatch": "///"},
    -1: {"facecolor": "#dfe8f2", "edgecolor": "#5080b0", "hatch": "\\\\\\"},
    2: {"facecolor": "#e4e4e4", "edgecolor": "#888888", "hatch": "xxx"},
}
_SHORT = 0.008  # of the duration, bands shorter than this are lines
_STILL = 1e-3  # mm, °, N or N·m: what varies by less does not move
_NEAR = 0.12  # of the duration, labels nearer than this are one


@dataclass(frozen=True)
class Course:
    """A nominal trajectory, with the rows of Pa(t) and Fa(t) where a plan has them."""

    nominal: Nominal
    forces: tuple[PositionForce, ...] = ()


def stops_words(s: Sequence[int]) -> str:
    """S by axis in words: "x stopped in +, z stopped in both"."""
    return ", ".join(f"{axis} {STOPS[code]}" for axis, code in zip(AXES, s, strict=True) if code) or "all free"


def drawing(course: Course) -> Drawing:
    """A row per axis: position on the left with S(t) as bands, reaction force on the right where there is one."""
    said = "; ".join(f"{i.start:.3g} to {i.end:.3g} s: {stops_words(i.s)}" for i in course.nominal.intervals)
    forces = ", and position and reaction force Pa and Fa" if course.forces else ""
    alt = f"Nominal trajectory P(t) per axis with the bands of S(t){forces}. S by time: {said}."
    return Drawing("trajectory", TITLE, alt, (WIDTH, 6.6), partial(_paint, course))


def _paint(course: Course, figure: Figure) -> None:
    forces = course.forces
    columns = 2 if forces else 1
    figure.set_layout_engine("none")  # by hand: a fifth of the time
    room = {"left": 0.09, "right": 0.985, "top": 0.945, "bottom": 0.145, "hspace": 0.3, "wspace": 0.24}
    grid = figure.subplots(6, columns, squeeze=False, sharex=True, gridspec_kw=room)
    for axis, row in enumerate(grid):
        _bands(row[0], course.nominal, axis)
        _position(row[0], course, axis)
        if forces:
            _bands(row[1], course.nominal, axis)
            _force(row[1], forces, axis)
    title = "position P(t), Pa(t), and S(t)" if forces else "nominal position P(t) and freedoms S(t)"
    grid[0, 0].set_title(title, pad=14.0)
    if forces:
        grid[0, 1].set_title("reaction Fa(t); applied: −Fa(t)", pad=14.0)
    for axes in grid[-1]:
        axes.set_xlabel("time, s")
    _switches(grid, course.nominal)
    figure.align_ylabels()
    _legend(figure, bool(forces))


def _bands(axes: Axes, nominal: Nominal, axis: int) -> None:
    """Bands over the whole height; an interval too short to be seen is drawn as a line."""
    duration = nominal.times[-1]
    for code, stretch in groupby(nominal.intervals, key=lambda item: item.s[axis]):
        run, style = [*stretch], _BANDS.get(code)
        start, end = run[0].start, run[-1].end
        if style and end - start > _SHORT * duration:
            axes.axvspan(start, end, linewidth=0, zorder=0, **style)
        elif style:
            axes.axvline(0.5 * (start + end), color=style["edgecolor"], linewidth=2.5, zorder=0)


def _switches(grid: Any, nominal: Nominal) -> None:
    """A thin line where S changes, its time above the first row, unless it is too near another."""
    duration = nominal.times[-1]
    last = -math.inf
    for start in (item.start for item in nominal.intervals[1:]):
        for axes in (axes for row in grid for axes in row):
            axes.axvline(start, color=GREY, linewidth=0.5, zorder=1)
        if start - last > _NEAR * duration:
            place = (start, 1.0)
            style: Any = {"xycoords": grid[0, 0].get_xaxis_transform(), "textcoords": "offset points", "ha": "center"}
            grid[0, 0].annotate(f"{start:.3g} s", place, (0, 1), fontsize=8.0, color=GREY, **style)
            last = start


def _position(axes: Axes, course: Course, axis: int) -> None:
    nominal = course.nominal
    values = SCALES[axis] * np.array(nominal.nodes, dtype=np.float64)[:, axis]
    axes.plot(nominal.times, values, color=INK, linewidth=1.2)
    everything = [values]
    for item in course.forces:
        if item.s[axis] != 0:
            continue  # Γ is 0 there, and not a position: the axis is servoed in force
        ends = SCALES[axis] * np.array([item.pa_start[axis], item.pa_end[axis]], dtype=np.float64)
        axes.plot([item.start, item.end], ends, color=BLUE, linewidth=1.6, linestyle="--")
        everything.append(ends)
    _limits(axes, np.concatenate(everything))
    axes.set_ylabel(AXES_READ[axis])


def _force(axes: Axes, forces: tuple[PositionForce, ...], axis: int) -> None:
    """Steps of Fa; where the sign depends on which side touches, both signs."""
    everything = []
    for item in forces:
        value, style = item.fa[axis], "-"
        steps = [value]
        if axis in item.either_sign and value:
            steps, style = [value, -value], ":"
        for step in steps:
            axes.plot([item.start, item.end], [step, step], color=RUST, linewidth=1.6, linestyle=style)
        everything += steps
    axes.axhline(0.0, color=GREY, linewidth=0.5, zorder=1)
    _limits(axes, np.array(everything))
    axes.set_ylabel(f"F{AXES[axis]}, N" if axis < 3 else f"M{AXES[axis][1]}, N·m")


def _limits(axes: Axes, values: Array) -> None:
    low, high = float(np.min(values)), float(np.max(values))
    # What does not move would show its rounding, magnified to the height of the axis.
    room = 1.0 if high - low < _STILL else max(0.15 * (high - low), _STILL)
    axes.set_ylim(low - room, high + room)
    axes.locator_params(axis="y", nbins=4)


def _legend(figure: Figure, forces: bool) -> None:
    entries: dict[str, dict[str, Any]] = {"P(t)": {"color": INK}}
    if forces:
        entries["Pa(t), where position is servoed"] = {"color": BLUE, "linestyle": "--", "linewidth": 1.6}
        entries["Fa(t), where force is servoed"] = {"color": RUST, "linewidth": 1.6}
        entries["either sign"] = {"color": RUST, "linewidth": 1.6, "linestyle": ":"}
    entries |= {f"S: {STOPS[code]}": {"linewidth": 0, **style} for code, style in _BANDS.items()}
    legend(figure, entries, loc="lower center", ncols=3)
