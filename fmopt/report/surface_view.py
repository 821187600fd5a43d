"""CU as a body over φ, sliced, with the nominal C-surface inside."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from fmopt.report.drawing import BLUE, RUST, WIDTH
from fmopt.report.planar_view import piece_points

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TITLE = "CU of basic contacts over φ, and the nominal C-surface inside"


def _surfaces(plan: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    return list(plan.get("diagnostics", {}).get("planar", {}).get("surfaces", ()))


def has(plan: Mapping[str, Any]) -> bool:
    """Whether the plan is planar and holds such surfaces."""
    return bool(_surfaces(plan))


def size(plan: Mapping[str, Any]) -> tuple[float, float]:
    """Width and height in inches."""
    return WIDTH, 3.9


def alt(plan: Mapping[str, Any]) -> str:
    """What is to be seen, for who cannot see it."""
    words = []
    for surface in _surfaces(plan):
        low, high = (math.degrees(surface["slices"][k]["phi"]) for k in (0, -1))
        words.append(f"{surface['contact']}, {surface['kind']}, φ from {low:.4g} to {high:.4g}°")
    return "Configurations at which contacts are possible, as slices over φ: " + "; ".join(words) + "."


def paint(plan: Mapping[str, Any], figure: Figure) -> None:
    """The surfaces of the plan side by side."""
    paint_surfaces(_surfaces(plan), figure, "z")


def paint_surfaces(surfaces: Sequence[Mapping[str, Any]], figure: Figure, upright: str = "y") -> None:
    """A body for each record, as `uncertainty.planar.record.surface_record` makes them; drawn in mm and °.

    `upright` is what the plane's second axis is called: z in a plan.
    """
    for k, surface in enumerate(surfaces):
        axes: Any = figure.add_subplot(1, len(surfaces), k + 1, projection="3d")
        _slices(axes, surface["slices"])
        _nominal(axes, surface["slices"])
        axes.set_title(f"CU of {surface['contact']}, {surface['kind']}", fontsize=8.5)
        axes.set_xlabel("x, mm", fontsize=7.5)
        axes.set_ylabel(f"{upright}, mm", fontsize=7.5)
        axes.set_zlabel("φ, °", fontsize=7.5, labelpad=1.0)
        axes.tick_params(labelsize=6.5)
        axes.view_init(elev=22.0, azim=-62.0)
        axes.set_box_aspect(None, zoom=0.8)  # room for the labels, which no layout counts
    _legend(figure)


def _slices(axes: Any, slices: Sequence[Mapping[str, Any]]) -> None:
    """Each slice as a translucent face with its outline: together the skin of the body."""
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    faces = []
    for part in slices:
        for loop in part["loops"]:
            edge = 1e3 * np.vstack([piece_points(piece, 0.15)[:-1] for piece in loop])
            faces.append(np.column_stack([edge, np.full(len(edge), math.degrees(part["phi"]))]))
    skin = Poly3DCollection(faces, facecolor=BLUE, edgecolor=BLUE, alpha=0.1, linewidth=0.6)
    skin.set_edgecolor((0.106, 0.31, 0.541, 0.6))
    axes.add_collection3d(skin)
    points = np.vstack(faces)
    for setter, low, high in zip(
        (axes.set_xlim, axes.set_ylim, axes.set_zlim), points.min(axis=0), points.max(axis=0), strict=True
    ):
        setter(low, high)


def _nominal(axes: Any, slices: Sequence[Mapping[str, Any]]) -> None:
    """The nominal C-surface, ruled by one segment a slice."""
    ruled = [
        np.column_stack([1e3 * np.array(part["nominal"]), np.full(2, math.degrees(part["phi"]))])
        for part in slices
        if len(part["nominal"]) == 2
    ]
    if len(ruled) > 1:
        x, y, z = np.moveaxis(np.array(ruled), -1, 0)
        axes.plot_surface(x, y, z, color=RUST, alpha=0.85, linewidth=0.3, edgecolor="white", shade=False)


def _legend(figure: Figure) -> None:
    from matplotlib.patches import Patch

    handles = [
        Patch(facecolor=BLUE, alpha=0.3, label="CU, possible with uncertainty"),
        Patch(facecolor=RUST, label="nominal C-surface"),
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=2)
