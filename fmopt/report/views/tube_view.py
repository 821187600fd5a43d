"""Cross-sections of the tube: the set of errors at the start and at every move's end, in planes of two coordinates."""

import math
from collections.abc import Sequence
from functools import partial

import numpy as np
from numpy.typing import ArrayLike

from fmopt.plan import Plan
from fmopt.plan.error_sets import PlanErrorSet
from fmopt.plan.position_force import AXES
from fmopt.report.drawing import BLUE, INK, WIDTH, Axes, Drawing, Figure, legend
from fmopt.report.moves import moves
from fmopt.report.naming import AXES_READ, SCALES, pose_words
from fmopt.report.shell import paragraph, table
from fmopt.spatial.values import Array

PLANES = ((0, 1), (1, 3), (0, 4), (2, 5))  # a turn about x swings the part along y, one about y along x
_DIRECTIONS = 60  # 6° apart, between which a circle is drawn 0.14 % short
_PER_ROW = 8
_NOTHING = 1e-12
_LITTLE = 1e-6  # m or rad; smaller errors are not worth a word
_FINE = 0.004  # of an axis's half-length: two points this close are drawn as one


def error_sets(plan: Plan) -> dict[str, PlanErrorSet]:
    """The set at the start and at the end of every move, as far as they can be derived, by name."""
    ends, end = {"start": 0}, 0
    for move in moves(plan):
        end += len(move.segments)
        ends[f"move {move.number}"] = end
    return {name: plan.error_sets[end] for name, end in ends.items() if end < len(plan.error_sets)}


def ends_words(plan: Plan) -> str:
    """Where the motion begins, and what is left of the errors at its end, in a sentence."""
    words = f"It begins at {pose_words(plan.segments[0].start)}, the lowest point above the mouth, and "
    if len(plan.error_sets) <= len(plan.segments):
        return words + "no error at its end follows."
    half = plan.error_sets[-1].half_widths()
    wide = [(k, axis) for k, axis in enumerate(AXES) if half[k] > _LITTLE]
    left = [f"{axis} ±{float(SCALES[k] * half[k]):.2g}{'°' if k > 2 else ' mm'}" for k, axis in wide]
    return words + (f"ends with errors of up to {', '.join(left)}." if left else "ends with no error to speak of.")


def error_table(plan: Plan) -> str:
    """How contacts shrink the error: half-widths at the start and at every move's end."""
    rows = [(name, *map(_fine, SCALES * errors.half_widths())) for name, errors in error_sets(plan).items()]
    head = ("at the end of", *AXES_READ)
    return paragraph(ends_words(plan)) + table("Half-widths of the set of errors", head, rows, ".nnnnnn")


def _fine(value: float) -> str:
    return "< 0.0001" if 0.0 < value < 1e-4 else f"{value:.4f}"  # four digits alone would say that there is none


def drawing(plan: Plan) -> Drawing:
    """A column per move's end, a row per plane; one scale in a row, so that shrinking is seen as shrinking."""
    sets = [*error_sets(plan).items()]
    said = [f"{name} {_largest(errors.half_widths())}" for name, errors in sets]
    alt = f"Cross-sections of the set of errors. Largest half-widths: {'; '.join(said)}."
    height = 4.7 * max(1, math.ceil(len(sets) / _PER_ROW))
    return Drawing("tube", "The set of errors at every move's end", alt, (WIDTH, height), partial(_paint, sets))


def _paint(sets: Sequence[tuple[str, PlanErrorSet]], figure: Figure) -> None:
    blocks = [sets[k : k + _PER_ROW] for k in range(0, len(sets), _PER_ROW)]
    figure.set_layout_engine("none")
    # How far the axes go on each side, mm and degrees: no outline is clipped.
    widths = [np.sqrt(np.maximum(np.diag(errors.shape), 0.0)) for _, errors in sets]
    reach = np.maximum(1.08 * SCALES * np.max(widths, axis=0), _NOTHING)
    for number, block in enumerate(blocks):
        bottom, top = (1.0 - (number + share) / len(blocks) for share in (1.0, 0.0))
        room = {"bottom": bottom + 0.12 / len(blocks), "top": top - 0.06 / len(blocks), "hspace": 0.62}
        grid = figure.add_gridspec(len(PLANES), _PER_ROW, left=0.075, right=0.995, wspace=0.16, **room)
        for row, plane in enumerate(PLANES):
            for column, (name, errors) in enumerate(block):
                axes = figure.add_subplot(grid[row, column])
                _panel(axes, errors, plane, reach)
                _scales(axes, plane, reach, column == 0)
                if row == 0:
                    axes.set_title(name, loc="center", fontweight="normal")
    entries = {
        "zonotope ⊕ ellipsoid": {"color": BLUE},
        "outer ellipsoid (errors lie in both)": {"color": INK, "linestyle": "--", "linewidth": 0.8},
    }
    legend(figure, entries, loc="lower center", ncols=2)


def outline(generators: ArrayLike, growth: ArrayLike) -> Array:
    """Boundary points (n, 2), in order, of the plane set zonotope(generators (k, 2)) ⊕ ellipsoid(shape matrix (2, 2)).

    The support point in direction u is Σ sign(gᵢ·u) gᵢ + growth·u/√(uᵀ growth u); the directions on both sides of each
    generator's normal are among those taken, so that the zonotope's corners are exact.
    """
    G, Q = np.reshape(generators, (-1, 2)), np.asarray(growth, dtype=np.float64)
    corners = np.arctan2(G[:, 0], -G[:, 1])[:, None] + np.array([0.0, np.pi])[:, None, None] + np.array([-1e-6, 1e-6])
    even = np.linspace(-np.pi, np.pi, _DIRECTIONS, endpoint=False)
    circle = np.column_stack([np.cos(even), np.sin(even)])
    values, axes = np.linalg.eigh(Q)
    # Even along the ellipse as well: of a slender one nearly all directions meet its two ends.
    if values[0] > _NOTHING * values[1]:
        circle = np.vstack([circle, circle / np.sqrt(values) @ axes.T])
    angles = np.sort(np.mod(np.concatenate([np.arctan2(*circle.T[::-1]), corners.ravel()]) + np.pi, 2.0 * np.pi))
    u = np.column_stack([np.cos(angles), np.sin(angles)])
    across = np.sqrt(np.maximum(np.einsum("ni,ij,nj->n", u, Q, u), 0.0))
    round_ = np.divide(u @ Q, across[:, None], out=np.zeros_like(u), where=across[:, None] > 0.0)
    return np.asarray(np.sign(u @ G.T) @ G + round_)


def _panel(axes: Axes, errors: PlanErrorSet, plane: tuple[int, int], reach: Array) -> None:
    from matplotlib.colors import to_rgb
    from matplotlib.patches import Polygon

    pick, scale = list(plane), SCALES[list(plane)]
    growth, shape = (matrix[np.ix_(pick, pick)] * np.outer(scale, scale) for matrix in (errors.growth, errors.shape))
    inner = _thinned(outline(errors.generators[:, pick] * scale, growth), reach[pick])
    outer = _thinned(outline(np.zeros((0, 2)), shape), reach[pick])
    axes.axhline(0.0, color="#cccccc", linewidth=0.4, zorder=0)
    axes.axvline(0.0, color="#cccccc", linewidth=0.4, zorder=0)
    # A set too small for its outline to be seen is a dot.
    if np.all(np.ptp(inner, axis=0) < 0.05 * reach[pick]):
        axes.plot([0.0], [0.0], ".", color=BLUE, markersize=2.5)
    axes.add_patch(Polygon(inner, facecolor=(*to_rgb(BLUE), 0.2), edgecolor=BLUE, linewidth=1.2))
    axes.add_patch(Polygon(outer, fill=False, edgecolor=INK, linewidth=0.8, linestyle="--"))


def _thinned(points: Array, reach: Array) -> Array:
    """The outline without points that nobody could tell from the one before."""
    kept = [points[0]]
    for point in points[1:]:
        if np.max(np.abs(point - kept[-1]) / reach) > _FINE:
            kept.append(point)
    return np.array(kept)


def _scales(axes: Axes, plane: tuple[int, int], reach: Array, first: bool) -> None:
    """Axes from −reach to reach with one round mark on each side."""
    for axis, side in zip(plane, (axes.xaxis, axes.yaxis), strict=True):
        power = 10.0 ** math.floor(math.log10(0.8 * reach[axis]))
        mark = power * max(digit for digit in (1, 2, 4, 6, 8) if digit * power <= 0.8 * reach[axis])
        side.set_ticks([-mark, 0.0, mark], [f"−{mark:g}", "", f"{mark:g}"])
        (axes.set_xlim if side is axes.xaxis else axes.set_ylim)(-reach[axis], reach[axis])
    axes.set_xlabel(AXES_READ[plane[0]], labelpad=0)
    axes.tick_params(labelleft=first, pad=1.5, length=2)
    if first:
        axes.set_ylabel(AXES_READ[plane[1]], labelpad=1)


def _largest(half_widths: Array) -> str:
    way, angle = np.max((SCALES * half_widths).reshape(2, 3), axis=1)
    return f"{way:.3g} mm and {angle:.3g}°"
