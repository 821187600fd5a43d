"""Drawings: what `fmopt.show` and `fmopt show` make of a value, as SVG, PNG or a page of HTML."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from html import escape
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fmopt.errors import ChoiceError, ResourceError
from fmopt.report.shell import page, svg_source
from fmopt.runtime.output import save

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Sheet

SUFFIXES = (".svg", ".png", ".html")
_STYLE = """body { margin: 0.6rem; max-width: 60rem; background: #fff; color: #111;
  font: 1rem/1.45 system-ui, "DejaVu Sans", Arial, sans-serif; }
h1 { font-size: 1.1rem; margin: 0.2rem 0; }
img { max-width: 100%; height: auto; }
"""


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
    paint: Callable[[Sheet], None] | None = None
    fragment: Callable[[], str] | None = None

    def svg(self) -> str:
        """The drawing as a text of SVG, the same for the same value.

        Raises:
            ChoiceError: it moves, and is HTML alone.
        """
        from fmopt.report.drawing import drawn

        return drawn(self._painter("SVG"), self.size).decode()

    def png(self, dpi: float = 150.0) -> bytes:
        """The drawing as the bytes of a PNG, at so many dots per inch.

        Raises:
            ChoiceError: it moves, and is HTML alone.
        """
        from fmopt.report.drawing import drawn

        return drawn(self._painter("PNG"), self.size, "png", dpi)

    def html(self) -> str:
        """A page of HTML that holds everything and opens offline."""
        return page(self.title, _STYLE, f"<h1>{escape(self.title)}</h1>\n{self._body()}", scripts=True)

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

    def _painter(self, form: str) -> Callable[[Sheet], None]:
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


def show(value: Any, what: str | None = None) -> Drawing:
    """A drawing of a value, by name or the first: it shows itself in a notebook, and `save` writes it.

    >>> plan = fmopt.read("out/square_peg/plan.json")
    >>> fmopt.show(plan)
    <fmopt.Drawing scene: square_peg going into square_hole_block, to be turned and played>
    >>> "states" in fmopt.drawings(plan)
    True

    Raises:
        ChoiceError: there is no drawing of this name.
        ResourceError: the value has none at all.
    """
    found = drawings(value)
    if what is None:
        return next(iter(found.values()))
    if what not in found:
        message = f"there is no drawing {what!r} of this {type(value).__name__}"
        raise ChoiceError(message, f"choose from {', '.join(found)}")
    return found[what]


def drawings(value: Any) -> Mapping[str, Drawing]:
    """The drawings that there are of a value, by name; none is made before it is asked for.

    >>> list(fmopt.drawings(fmopt.load(fmopt.example("square_peg"))))
    ['parts', 'scene', 'diagrams']

    Raises:
        ResourceError: the value has none.
    """
    from fmopt.notebook.views import views_of

    found = views_of(value)
    if not found:
        raise ResourceError(f"a {type(value).__name__} has no drawing", "see help(fmopt.show) for what has")
    return found
