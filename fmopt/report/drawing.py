"""Sheets for figures: one style, vector graphics that come out the same every time, legible in black and white."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from io import BytesIO
from typing import TYPE_CHECKING, Any

from fmopt.runtime.escape import one_line
from fmopt.spatial.values import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

WIDTH = 7.0  # inches: the text width of an A4 page, so that print shows every figure at its own size
INK = "#111111"
BLUE = "#1b4f8a"
RUST = "#a34a00"
GREY = "#777777"
PALE = "#dddddd"
DASHES = ("-", "--", "-.", ":")

_STYLE: Any = {
    "font.family": "DejaVu Sans",
    "font.size": 8.5,
    "axes.titlesize": 9.0,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.labelsize": 8.5,
    "axes.linewidth": 0.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": INK,
    "xtick.labelsize": 8.0,
    "ytick.labelsize": 8.0,
    "legend.fontsize": 8.0,
    "legend.frameon": False,
    "figure.titlesize": 9.5,
    "figure.titleweight": "bold",
    "hatch.linewidth": 0.5,
    "lines.linewidth": 1.2,
    "svg.hashsalt": "fmopt",  # without one, ids in an SVG are drawn at random
    "svg.fonttype": "path",  # outlines: whoever opens the figure need not have the font
    "text.parse_math": False,  # a dollar sign in a plan's text begins no formula
    "axes.unicode_minus": True,
}


@contextmanager
def sheet(size: tuple[float, float]) -> Iterator[Figure]:
    """An empty figure in the house style, width and height in inches; the style holds inside the block only."""
    import matplotlib
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    with matplotlib.rc_context():
        matplotlib.rcdefaults()  # a user's own style would make other bytes of the same plan
        matplotlib.rcParams.update(_STYLE)
        # Not by pyplot, which keeps every figure that it makes, and may want a display.
        figure = Figure(figsize=size, layout="constrained")
        FigureCanvasAgg(figure)
        yield figure


def _calm(figure: Figure) -> None:
    """Writes what is not printable in the texts of a figure as its code: SVG repeats them in comments."""
    from matplotlib.text import Text

    for text in figure.findobj(Text):
        if isinstance(text, Text) and not (words := text.get_text()).isprintable():
            text.set_text("\n".join(map(one_line, words.split("\n"))))


def fill(axes: Axes, loops: Iterable[Array], **style: Any) -> None:
    """Fills what loops (n, 2) bound, whose first corner comes again at the end; whatever their unit."""
    from matplotlib.patches import PathPatch
    from matplotlib.path import Path

    closed = [Path(loop, closed=True) for loop in loops]
    if closed:
        axes.add_patch(PathPatch(Path.make_compound_path(*closed), **style))


def drawn(paint: Callable[[Figure], None], size: tuple[float, float], form: str = "svg", dpi: float = 150.0) -> bytes:
    """The bytes of a figure, the same for the same painting."""
    content = BytesIO()
    # Nothing of the day, the machine or the library's version goes into the file.
    unsaid: dict[str, Any] = {"Date": None, "Creator": None} if form == "svg" else {"Software": None}
    with sheet(size) as figure:
        paint(figure)
        _calm(figure)
        figure.savefig(content, format=form, dpi=dpi, metadata=unsaid)
    return content.getvalue()
