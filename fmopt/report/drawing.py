"""Drawings: one style, vector graphics that come out the same every time, legible in black and white."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from html import escape
from io import BytesIO
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fmopt.errors import ChoiceError
from fmopt.report.shell import page, svg_source
from fmopt.runtime.escape import one_line
from fmopt.runtime.output import save
from fmopt.spatial.values import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes as Axes
    from matplotlib.figure import Figure as Figure
else:  # names of types for all that draws: matplotlib is loaded where a sheet is made
    Axes = Figure = Any

SUFFIXES = (".svg", ".png", ".html")
WIDTH = 7.0  # inches: the text width of an A4 page, so that print shows every figure at its own size
INK = "#111111"
BLUE = "#1b4f8a"
RUST = "#a34a00"
GREY = "#777777"
PALE = "#dddddd"
DASHES = ("-", "--", "-.", ":")

_PAGE_STYLE = """body { margin: 0.6rem; max-width: 60rem; background: #fff; color: #111;
  font: 1rem/1.45 system-ui, "DejaVu Sans", Arial, sans-serif; }
h1 { font-size: 1.1rem; margin: 0.2rem 0; }
img { max-width: 100%; height: auto; }
"""
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


def legend(owner: Axes | Figure, entries: Mapping[str, Any], **place: Any) -> None:
    """A legend of lines by their words and style, and of patches where the style has a colour of faces."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    handles = [
        Patch(label=words, **style) if "facecolor" in style else Line2D([], [], label=words, **style)
        for words, style in entries.items()
    ]
    owner.legend(handles=handles, **place)


@dataclass(frozen=True, eq=False)
class Drawing:
    """A drawing of a value, made when it is first asked for: lines on a sheet, or a fragment of HTML that moves.

    >>> drawing = fmopt.show(fmopt.read("out/square_peg/plan.json"), "margin")
    >>> drawing.save("margin.svg").stat().st_size > 10_000
    True
    """

    name: str
    title: str
    alt: str
    size: tuple[float, float]
    paint: Callable[[Figure], None] | None = None
    fragment: Callable[[], str] | None = None

    def svg(self) -> str:
        """The drawing as a text of SVG, the same for the same value; `ChoiceError` where it moves: HTML alone."""
        return drawn(self._painter("SVG"), self.size).decode()

    def png(self, dpi: float = 150.0) -> bytes:
        """The drawing as the bytes of a PNG, at so many dots per inch; `ChoiceError` as of `svg`."""
        return drawn(self._painter("PNG"), self.size, "png", dpi)

    def html(self) -> str:
        """A page of HTML that holds everything and opens offline."""
        return page(self.title, _PAGE_STYLE, f"<h1>{escape(self.title)}</h1>\n{self._body()}", scripts=True)

    def save(self, path: str | PathLike[str]) -> Path:
        """Writes the drawing in the format that the file's name ends with: .svg, .png or .html.

        Raises:
            ChoiceError: there is no such format, or this drawing is not to be had in it.
            ResourceError: the file cannot be written.
        """
        target = Path(path)
        match target.suffix.lower():
            case ".svg":
                content = self.svg().encode()
            case ".png":
                content = self.png()
            case ".html":
                content = self.html().encode()
            case other:
                raise ChoiceError(f"{target}: {other!r} is no format", f"choose from {', '.join(SUFFIXES)}")
        save(content, target)
        return target

    def _painter(self, form: str) -> Callable[[Figure], None]:
        if self.paint is None:
            raise ChoiceError(f"{self.name!r} moves, it is no {form}", "write it to a file that ends with .html")
        return self.paint

    def _body(self) -> str:
        if self.fragment is not None:
            return self.fragment()
        return f'<img src="{svg_source(self.svg())}" alt="{escape(self.alt)}">\n'

    def _repr_html_(self) -> str:
        if self.fragment is None:
            width = round(96 * self.size[0])
            return f'<img src="{svg_source(self.svg())}" alt="{escape(self.alt)}" width="{width}">'
        return framed(self.html(), self.title, self.size)

    def __repr__(self) -> str:
        return f"<fmopt.Drawing {self.name}: {self.title}>"


def framed(page: str, title: str, size: tuple[float, float]) -> str:
    """A page inside another, kept apart from it: its own styles, scripts and names."""
    width, height = (round(96 * inches) for inches in size)
    # Without allow-same-origin scripts inside cannot reach the notebook around them.
    return (
        f'<iframe title="{escape(title)}" srcdoc="{escape(page)}" sandbox="allow-scripts" '
        f'style="width: 100%; max-width: {width}px; height: {height}px; border: 1px solid #999;"></iframe>'
    )
