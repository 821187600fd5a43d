"""The largest friction without a jam over depth, on the way into the hole."""

from functools import partial

import numpy as np

from fmopt.plan.press_rows import DepthRow
from fmopt.report.drawing import BLUE, GREY, WIDTH, Drawing, Figure, legend

TITLE = "Going down: the largest friction without a jam over depth"


def drawing(rows: tuple[DepthRow, ...]) -> Drawing:
    """The curve of a plan, and Whitney's for a plane peg."""
    said = ", ".join(f"{max(row.friction, 0.0):.2f} at {1e3 * row.depth:.1f} mm" for row in rows)
    alt = f"The largest friction that jams the part on no contacts that its play lets it reach: {said}."
    return Drawing("depths", TITLE, alt, (WIDTH, 3.0), partial(_paint, rows))


def _paint(rows: tuple[DepthRow, ...], figure: Figure) -> None:
    axes = figure.subplots()
    depth, friction, whitney = np.array([(1e3 * row.depth, row.friction, row.whitney) for row in rows]).T
    axes.plot(depth, np.maximum(friction, 0.0), color=BLUE, linewidth=2.0, marker="o", markersize=3.0)
    axes.plot(depth, whitney, color=GREY, linestyle="--")
    axes.set_ylim(0.0, 1.1 * max(float(friction.max()), 0.5))
    axes.set_xlabel("depth of the leading face below the mouth, mm")
    axes.set_ylabel("friction")
    axes.set_title("Friction that cannot jam the part")
    kinds = {
        "of all that it can touch in its play": {"color": BLUE},
        "height over width of the walls (Whitney)": {"color": GREY, "linestyle": "--"},
    }
    legend(axes, kinds, loc="upper center", bbox_to_anchor=(0.5, -0.2), ncols=2)
