"""Sheets for figures: one style, vector graphics that come out the same every time, legible in black and white.

The parts of a plan as polyhedra, where they stand, and their sections through the mating axis.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from io import BytesIO
from typing import TYPE_CHECKING, Any

import numpy as np

from fmopt.escape import one_line
from fmopt.geometry.polyhedron import Polyhedron, from_faces, placed
from fmopt.geometry.section import section
from fmopt.plan import Body, Part, Plan
from fmopt.se3 import Pose
from fmopt.values import Array

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from shapely import MultiPolygon


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
    "svg.hashsalt": "fmopt",
    "svg.fonttype": "path",
    "text.parse_math": False,
    "axes.unicode_minus": True,
}

_SLIT = 1e-10  # m: rounding leaves slits between the sections of neighbouring pieces


@contextmanager
def sheet(size: tuple[float, float]) -> Iterator[Figure]:
    """An empty figure in the house style, width and height in inches; the style holds inside the block only."""
    import matplotlib
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        matplotlib.rcParams.update(_STYLE)
        figure = Figure(figsize=size, layout="constrained")
        FigureCanvasAgg(figure)
        yield figure


def _calm(figure: Figure) -> None:
    """Writes what is not printable in the texts of a figure as its code: SVG repeats them in comments."""
    from matplotlib.text import Text

    for text in figure.findobj(Text):
        if isinstance(text, Text) and not (words := text.get_text()).isprintable():
            text.set_text("\n".join(map(one_line, words.split("\n"))))


def drawn(paint: Callable[[Figure], None], size: tuple[float, float], form: str = "svg", dpi: float = 150.0) -> bytes:
    """The bytes of a figure, the same for the same painting.

    Args:
        paint: fills an empty figure.
        size: width and height in inches.
        form: "svg" or "png".
        dpi: dots per inch of a PNG.
    """
    content = BytesIO()
    # Nothing of the day, the machine or the library's version goes into the file.
    unsaid: dict[str, Any] = {"Date": None, "Creator": None} if form == "svg" else {"Software": None}
    with sheet(size) as figure:
        paint(figure)
        _calm(figure)
        figure.savefig(content, format=form, dpi=dpi, metadata=unsaid)
    return content.getvalue()


def body_of(body: Body) -> Polyhedron:
    """The polyhedron of a part or piece of a plan."""
    return from_faces(body.vertices, body.faces)


def pieces_of(part: Part) -> tuple[Polyhedron, ...]:
    """The convex pieces of a part of a plan."""
    return tuple(body_of(piece) for piece in part.pieces)


def upright_plane(azimuth: float) -> Pose:
    """The plane through the axis at an angle from x, rad: first axis to the right, z upward, seen against the third.

    The frame is exact where the angle is 0 or π/2.
    """
    c, s = (round(value, 15) + 0.0 for value in (math.cos(azimuth), math.sin(azimuth)))
    return Pose(np.zeros(3), np.array([[c, 0.0, s], [s, 0.0, -c], [0.0, 1.0, 0.0]]))


CUTS = {"x–z": upright_plane(0.0), "y–z": upright_plane(0.5 * math.pi)}


def contact_place(plan: Plan, contact: str, pose: Pose) -> Array:
    """Where a contact touches (3,), m: its vertex, or the point of the moving edge nearest to the fixed one."""
    record = next(c for c in plan.contacts if c.id == contact)
    moving = pose.apply(np.array([plan.moving.body.vertices[i] for i in record.moving]))
    fixed = np.array([plan.fixed.body.vertices[i] for i in record.fixed])
    if len(moving) == 1 or len(fixed) == 1:
        return np.asarray((moving if len(moving) == 1 else fixed)[0])
    e, f, d = moving[1] - moving[0], fixed[1] - fixed[0], fixed[0] - moving[0]
    ee, ef, ff = e @ e, e @ f, f @ f
    level = ee * ff - ef * ef <= 1e-9 * ee * ff
    share = 0.5 if level else float(np.clip(((d @ e) * ff - (d @ f) * ef) / (ee * ff - ef * ef), 0.0, 1.0))
    return np.asarray(moving[0] + share * e)


def section_of(bodies: tuple[Polyhedron, ...], pose: Pose, plane: Pose) -> MultiPolygon:
    """The section of a part at a pose by a plane, in the plane's coordinates, m; slits between pieces closed."""
    from shapely import MultiPolygon, get_parts

    shape = section([placed(body, pose) for body in bodies], plane)
    closed = shape.buffer(_SLIT, join_style="mitre").buffer(-_SLIT, join_style="mitre")
    return MultiPolygon([part for part in get_parts(closed) if part.geom_type == "Polygon"])


def extent(shape: MultiPolygon, height: float) -> Array:
    """Where the line at a height crosses a section: intervals (n, 2) from left to right, m."""
    from shapely import LineString, get_parts

    left, _, right, _ = shape.bounds
    line = LineString([(left - 1.0, height), (right + 1.0, height)])
    runs = [run.bounds for run in get_parts(shape.intersection(line)) if run.length > 0.0]
    return np.array(sorted((run[0], run[2]) for run in runs)).reshape(-1, 2)
