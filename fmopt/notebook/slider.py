"""A row of drawings behind a slider: one page of HTML that needs neither a kernel nor a network."""

from collections.abc import Sequence
from functools import partial
from hashlib import sha256
from html import escape

from fmopt.report.drawing import Drawing
from fmopt.report.shell import svg_source

_SCRIPT = """(function () {
const root = document.getElementById("NAME"), input = root.querySelector("input"), said = root.querySelector("output");
const frames = [...root.querySelectorAll("img")];
function look() {
  const chosen = frames[Number(input.value)];
  frames.forEach(frame => { frame.hidden = frame !== chosen; });
  said.textContent = chosen.dataset.said;
  input.setAttribute("aria-valuetext", chosen.dataset.said);
}
input.addEventListener("input", look);
look();
})();"""


def slider(label: str, frames: Sequence[tuple[str, Drawing]]) -> Drawing:
    """Drawings on sheets of one size behind a slider, each with what the slider says at its place.

    >>> part = fmopt.load(fmopt.example("square_peg")).moving
    >>> moving = fmopt.slider("view", [(name, fmopt.show(part, "part")) for name in ("one", "two")])
    >>> moving.html().count("<img")
    2

    Raises:
        ValueError: there are no frames.
        ChoiceError: as it is drawn, where one of the drawings moves and is no sheet.
    """
    if not frames:
        raise ValueError("a slider needs a drawing at least")
    first, last = frames[0], frames[-1]
    title = f"{first[1].title}, over {label}"
    alt = f"{title}: from {first[0]} ({first[1].alt}) to {last[0]} ({last[1].alt})"
    # Room in inches beside a frame, and for the title and the slider above it.
    width, height = first[1].size
    return Drawing("slider", title, alt, (width + 0.4, height + 1.3), fragment=partial(_fragment, label, tuple(frames)))


def _fragment(label: str, frames: Sequence[tuple[str, Drawing]]) -> str:
    images = []
    for number, (said, drawing) in enumerate(frames):
        # All but the first are hidden from the start, for where no scripts run.
        words = f'{"hidden " if number else ""}data-said="{escape(said)}" alt="{escape(drawing.alt)}"'
        images.append(f'<img {words} src="{svg_source(drawing.svg())}">')
    body = "\n".join(images)
    name = f"slider-{sha256((label + body).encode()).hexdigest()[:12]}"
    control = f'<input type="range" min="0" max="{len(frames) - 1}" value="0" step="1" style="width: 60%">'
    return (
        f'<div id="{name}">\n<p><label>{escape(label)} {control}</label> <output aria-live="polite"></output></p>\n'
        f"{body}\n</div>\n<script>{_SCRIPT.replace('NAME', name)}</script>\n"
    )
