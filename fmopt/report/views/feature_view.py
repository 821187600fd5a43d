"""The mating features of a part: where their frames are, and the part cut through each of them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from fmopt.geometry.part import rebased
from fmopt.report.drawing import BLUE, INK, RUST, WIDTH
from fmopt.report.views import part_view

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from fmopt.geometry.mating_features import Feature
    from fmopt.geometry.part import Part

_MOST = 2  # features that are all cut; of more there is room for the largest alone


def size() -> tuple[float, float]:
    """Width and height in inches, of one part."""
    return 1.25 * WIDTH, 0.45 * WIDTH


def alt(part: Part) -> str:
    """What is to be seen, for who cannot see it."""
    said = [
        f"{one.name}, a {'peg' if one.kind == 'solid' else 'hole'} {1e3 * one.length:.4g} mm deep"
        for one in part.features
    ]
    return f"{part.name} with {', '.join(said) or 'no feature'}: frames, and sections along and across."


def paint(part: Part, figure: Figure) -> None:
    """The part from a corner with the frames of its features; the largest of them cut along and across its axis."""
    shown = part.features[:_MOST] if len(part.features) <= _MOST else part.features[:1]
    axes = figure.subplots(1, 1 + 2 * max(len(shown), 1), squeeze=False)[0]
    part_view.corner(axes[0], part.polyhedron)
    axes[0].set_title(part.name)
    for feature in part.features:
        _frame(axes[0], feature, float(np.ptp(part.polyhedron.vertices, axis=0).max()))
    for k, feature in enumerate(shown):
        own = rebased(part, feature.frame)
        # z points out of a hole at its mouth, and from a peg's leading end back into the part.
        inward = -feature.length if feature.kind == "hollow" else feature.length
        along, across = axes[1 + 2 * k], axes[2 + 2 * k]
        part_view.cut(along, "x–z", own.pieces, 0.0)
        part_view.cut(across, "x–y", own.pieces, 0.5 * inward)
        along.set_title(f"{feature.name}: {feature.kind}, {1e3 * feature.length:.4g} mm")
        along.annotate("", (0.0, 1e3 * inward), (0.0, 0.0), arrowprops={"arrowstyle": "-|>", "color": RUST})
        along.plot([0.0], [0.0], "o", color=RUST, markersize=4)
        reach = 0.25 * 1e3 * float(np.ptp(own.polyhedron.vertices[:, 0]))
        across.annotate("", (reach, 0.0), (0.0, 0.0), arrowprops={"arrowstyle": "-|>", "color": BLUE, "shrinkA": 0.0})
        across.annotate("x", (reach, 0.0), color=BLUE, textcoords="offset points", xytext=(3.0, 3.0))
    for unused in axes[1 + 2 * len(shown) :]:
        unused.set_axis_off()


def _frame(axes: Axes, feature: Feature, extent: float) -> None:
    """The origin of a feature and its axis out of the part, with its name."""
    view = part_view.view()[:2]
    out = feature.frame.R[:, 2] * (1.0 if feature.kind == "hollow" else -1.0)
    foot, tip = (1e3 * view @ point for point in (feature.frame.p, feature.frame.p + 0.35 * extent * out))
    # Above all faces, whose order of painting counts up with their number.
    axes.annotate("", tuple(tip), tuple(foot), arrowprops={"arrowstyle": "-|>", "color": RUST}, zorder=1e6)
    axes.annotate(feature.name, tuple(tip), color=INK, zorder=1e6)
    axes.update_datalim([foot, tip])  # annotations do not count for limits
    axes.autoscale_view()
