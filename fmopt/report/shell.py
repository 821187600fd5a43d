"""What all pages have in common: a head that lets nothing in from outside, chapters with links to them, figures."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Sequence
from html import escape

Chapter = tuple[str, str, str]
"""Name, heading in plain text, and content in HTML."""


def svg_source(svg: str) -> str:
    """An SVG as the source of an image, which needs no file beside the page."""
    return f"data:image/svg+xml;base64,{b64encode(svg.encode()).decode()}"


def figure(svg: str, alt: str, caption: str, size: tuple[float, float] | None = None) -> str:
    """A figure with what it shows in words.

    Args:
        svg: the picture.
        alt: what is to be seen, for who cannot see it; plain text, as the caption.
        caption: what it shows.
        size: width and height in inches, where the picture is not to be as wide as the page.
    """
    measures = "" if size is None else ' width="{}" height="{}"'.format(*(round(96 * inches) for inches in size))
    picture = f'<img src="{svg_source(svg)}" alt="{escape(alt)}"{measures}>'
    return f"<figure>\n{picture}\n<figcaption>{escape(caption)}</figcaption>\n</figure>\n"


def page(title: str, style: str, body: str, scripts: bool = False) -> str:
    """A page of HTML that opens offline and fetches nothing.

    Args:
        title: in plain text.
        style: its style sheet.
        body: in HTML.
        scripts: whether scripts in it may run.
    """
    allowed = "img-src data:; style-src 'unsafe-inline'; " + ("script-src 'unsafe-inline'; " if scripts else "")
    policy = f"default-src 'none'; {allowed}base-uri 'none'; form-action 'none'"
    return f"""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="{policy}">
<meta name="viewport" content="width=device-width, initial-scale=1">
<link rel="icon" href="data:,">
<title>{escape(title)}</title>
<style>
{style}</style>
</head>
<body>
{body}</body>
</html>
"""


def chaptered(kind: str, heading: str, chapters: Sequence[Chapter], lead: str = "") -> str:
    """The body of a page of chapters, those without a content left out.

    Args:
        kind: what it is a page of; plain text, as the heading.
        heading: of the page.
        chapters: what it has.
        lead: in HTML, what comes first.
    """
    shown = [chapter for chapter in chapters if chapter[2]]
    links = "\n".join(f'<li><a href="#{name}">{escape(said)}</a></li>' for name, said, _ in shown)
    body = "\n".join(_section(*chapter) for chapter in shown)
    return f"""<header>
<p class="kind">{escape(kind)}</p>
<h1>{escape(heading)}</h1>
{lead}</header>
<nav aria-label="chapters">
<ol>
{links}
</ol>
</nav>
<main>
{body}
</main>
"""


def _section(name: str, heading: str, text: str) -> str:
    head = f'<h2 id="{name}-head">{escape(heading)}</h2>'
    return f'<section id="{name}" aria-labelledby="{name}-head">\n{head}\n{text}\n</section>'
