"""CU as a body over φ, sliced, with the nominal C-surface inside."""

import math
from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np

from fmopt.plan.diagnostics import Slice, Surface
from fmopt.report.drawing import BLUE, RUST, WIDTH, Drawing, Figure, legend
from fmopt.report.views.planar_view import piece_points

_COLUMNS = 2
_ROW = 2.75  # inches
TITLE = "CU of basic contacts over φ, and the nominal C-surface inside"


def paper(count: int) -> tuple[float, float]:
    """Width and height, in inches, of a sheet for so many surfaces, two in a row."""
    return WIDTH, 0.35 + _ROW * math.ceil(count / _COLUMNS)


def drawing(surfaces: Sequence[Surface]) -> Drawing:
    """The surfaces of a plan side by side."""
    words = []
    for surface in surfaces:
        low, high = (math.degrees(surface.slices[k].phi) for k in (0, -1))
        words.append(f"{surface.contact}, {surface.kind}, φ from {low:.4g} to {high:.4g}°")
    alt = f"Configurations at which contacts are possible, as slices over φ: {'; '.join(words)}."
    return Drawing("surfaces", TITLE, alt, paper(len(surfaces)), partial(paint_surfaces, surfaces, upright="z"))


def paint_surfaces(surfaces: Sequence[Surface], figure: Figure, upright: str = "y") -> None:
    """A body for each surface, as `papers.basanez_suarez.account` makes; `upright` names the plane's second axis."""
    from matplotlib.ticker import MaxNLocator

    figure.set_layout_engine("none")  # no layout counts the labels of axes in space
    height = float(figure.get_size_inches()[1])
    row = (height - 0.35) / height / math.ceil(len(surfaces) / _COLUMNS)
    for k, surface in enumerate(surfaces):
        left, top = (k % _COLUMNS) / _COLUMNS, 1.0 - (k // _COLUMNS) * row
        axes: Any = figure.add_axes((left + 0.01, top - row, 0.46, 0.95 * row), projection="3d")
        _slices(axes, surface.slices)
        _nominal(axes, surface.slices)
        name = f"CU of {surface.contact}, {surface.kind}"
        figure.text(left + 0.04, top - 0.07 * row, name, fontweight="bold", fontsize=9.0)
        labels = ((axes.xaxis, "x, mm", 0.0), (axes.yaxis, f"{upright}, mm", 1.0), (axes.zaxis, "φ, °", 0.0))
        for axis, label, pad in labels:
            axis.set_major_locator(MaxNLocator(5, prune="both"))
            axis.set_label_text(label)
            axis.labelpad = pad
        axes.tick_params(labelsize=8.0, pad=0.0)
        axes.view_init(elev=22.0, azim=-62.0)
        axes.set_box_aspect(None, zoom=0.82)
    possible = {"facecolor": BLUE, "alpha": 0.3}
    entries = {"CU, possible with uncertainty": possible, "nominal C-surface": {"facecolor": RUST}}
    legend(figure, entries, loc="outside lower center", ncols=2)


def _slices(axes: Any, slices: Sequence[Slice]) -> None:
    """Each slice as a translucent face with its outline: together the skin of the body."""
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    faces = []
    for part in slices:
        for loop in part.boundary.loops:
            edge = 1e3 * np.vstack([piece_points(piece, 0.15)[:-1] for piece in loop])
            faces.append(np.column_stack([edge, np.full(len(edge), math.degrees(part.phi))]))
    skin = Poly3DCollection(faces, facecolor=BLUE, edgecolor=BLUE, alpha=0.1, linewidth=0.6)
    # BLUE once more: `alpha` has made edges as pale as the faces.
    skin.set_edgecolor((0.106, 0.31, 0.541, 0.6))
    axes.add_collection3d(skin)
    points = np.vstack(faces)
    for k, setter in enumerate((axes.set_xlim, axes.set_ylim, axes.set_zlim)):
        setter(points[:, k].min(), points[:, k].max())


def _nominal(axes: Any, slices: Sequence[Slice]) -> None:
    """The nominal C-surface, ruled by one segment a slice."""
    ends = [(np.array(part.boundary.nominal), math.degrees(part.phi)) for part in slices]
    ruled = [np.column_stack([1e3 * pair, np.full(2, phi)]) for pair, phi in ends if len(pair) == 2]
    if len(ruled) > 1:
        x, y, z = np.moveaxis(np.array(ruled), -1, 0)
        axes.plot_surface(x, y, z, color=RUST, alpha=0.85, linewidth=0.3, edgecolor="white", shade=False)
