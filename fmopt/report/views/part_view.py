"""A part as it is: seen from a corner, and its sections through the axis of its frame and across it."""

import math
from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np

from fmopt.geometry.convex_pieces import faceted
from fmopt.geometry.part import Part
from fmopt.geometry.polyhedron import Polyhedron
from fmopt.geometry.section import section
from fmopt.report.bodies import CUTS, creases, loops_of
from fmopt.report.drawing import BLUE, GREY, INK, PALE, WIDTH, Axes, Drawing, Figure, fill
from fmopt.spatial.se3 import Pose
from fmopt.spatial.values import Array

_LAMP = np.array([0.3, -0.5, 0.81])
# Where the part is looked at from: rows to the right, up, and towards the viewer.
_VIEW = np.array([[0.8, 0.6, 0.0], [-0.3, 0.4, math.sqrt(0.75)], [0.52, -0.69, 0.5]])
_PLANES = {**CUTS, "x–y": Pose.identity()}


def drawing(name: str, *parts: Part) -> Drawing:
    """Each part seen from a corner, and cut through its axis and across it."""
    title, alt = " and ".join(part.name for part in parts), " ".join(map(_words, parts))
    return Drawing(name, title, alt, (WIDTH, 0.8 * WIDTH * len(parts)), partial(_paint, parts))


def _words(part: Part) -> str:
    body = part.polyhedron
    extent = " × ".join(f"{1e3 * width:.4g}" for width in body.widths)
    words = f"{part.name}, {extent} mm, {len(body.faces)} faces, {len(body.edges)} edges, {len(body.vertices)} vertices"
    return f"{words}: seen from a corner, and cut by the planes x–z and y–z through its axis and across it."


def _paint(parts: Sequence[Part], figure: Figure) -> None:
    """Four views of each part: from a corner, and three sections; the one across the axis in the middle."""
    halves = figure.subfigures(len(parts), 1, squeeze=False).ravel() if len(parts) > 1 else [figure]
    for half, part in zip(halves, parts, strict=True):
        grid = half.subplots(2, 2).ravel()
        corner(grid[0], part.polyhedron)
        grid[0].set_title(part.name)
        heights = part.polyhedron.vertices[:, 2]
        for axes, plane in zip(grid[1:], _PLANES, strict=True):
            cut(axes, plane, part.bodies, 0.5 * float(heights.min() + heights.max()) if plane == "x–y" else 0.0)


def view() -> Array:
    """Directions (3, 3), unit vectors as rows: to the right, up, and towards who looks at a part from its corner."""
    return np.asarray(_VIEW / np.linalg.norm(_VIEW, axis=1)[:, None])


def corner(axes: Axes, body: Polyhedron) -> None:
    """The faces that look at the viewer, far ones first, each lighter the more it faces the lamp."""
    body, across = faceted(body), view()
    sharp = creases(body)
    seen = [face for face in body.faces if float(face.normal @ across[2]) > 1e-9]
    far = sorted(seen, key=lambda face: float(np.mean(body.vertices[list(face.loops[0])] @ across[2])))
    for order, face in enumerate(far):
        light = 0.72 + 0.26 * max(0.0, float(face.normal @ _LAMP))
        loops = [1e3 * body.vertices[[*loop, loop[0]]] @ across[:2].T for loop in face.loops]
        fill(axes, loops, facecolor=(light,) * 3, edgecolor="none", zorder=order)
        number = body.faces.index(face)
        for edge in (edge for edge in sharp if number in edge.faces):
            ends = 1e3 * body.vertices[list(edge.vertices)] @ across[:2].T
            axes.plot(*ends.T, color=INK, linewidth=0.7, zorder=order, solid_capstyle="round")
    axes.autoscale_view()
    axes.set_aspect("equal")
    axes.set_axis_off()


def cut(axes: Axes, plane: str, pieces: Sequence[Polyhedron], height: float) -> None:
    """The section of convex pieces by a plane of their frame, "x–y" at a height, m; the axes in mm."""
    style: dict[str, Any] = {"facecolor": PALE, "edgecolor": BLUE, "linewidth": 0.8, "hatch": "////"}
    loops = loops_of(section(pieces, _PLANES[plane].moved([0.0, 0.0, height, 0.0, 0.0, 0.0])))
    fill(axes, [1e3 * loop for loop in loops], hatch_linewidth=0.3, **style)
    for place in (axes.axhline, axes.axvline):
        place(0.0, color=GREY, linewidth=0.5, linestyle=(0, (8, 2, 2, 2)))
    axes.autoscale_view()
    axes.margins(0.08)
    axes.set_aspect("equal", adjustable="datalim")
    across = f" at z = {1e3 * height:.4g} mm".replace("-", "−") if plane == "x–y" else ""
    axes.set_title(f"section {plane}{across}")
    axes.set_xlabel(f"{plane[0]}, mm")
    axes.set_ylabel(f"{plane[-1]}, mm")
