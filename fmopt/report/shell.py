"""Pages of HTML from plain texts: a head that lets nothing in, chapters with links, figures, tables, lists."""

import re
from base64 import b64encode
from collections.abc import Iterable, Sequence
from html import escape

Chapter = tuple[str, str, str]
"""Name, heading in plain text, and content in HTML."""

_UNIT = re.compile(r"(\d) (mm|µm|%|N|s)\b")
_ID = re.compile(r"\b[vefb]\d+-[vef]\d+\b")


class Markup(str):
    """A text that is HTML already."""


def svg_source(svg: str) -> str:
    """An SVG as the source of an image, which needs no file beside the page."""
    return f"data:image/svg+xml;base64,{b64encode(svg.encode()).decode()}"


def figure(svg: str, alt: str, caption: str, size: tuple[float, float] | None = None) -> str:
    """A figure with its caption, and what is to be seen for who cannot see it, in plain text."""
    # CSS has 96 px to an inch, so that figures keep their own size in print.
    measures = "" if size is None else ' width="{}" height="{}"'.format(*(round(96 * inches) for inches in size))
    picture = f'<img src="{svg_source(svg)}" alt="{escape(alt)}"{measures}>'
    return f"<figure>\n{picture}\n<figcaption>{escape(caption)}</figcaption>\n</figure>\n"


def page(title: str, style: str, body: str, scripts: bool = False) -> str:
    """A page of HTML that opens offline and fetches nothing, in which scripts may run or not."""
    # Styles and scripts are part of the page, hence inline; nothing may be fetched, and no form sent.
    allowed = "img-src data:; style-src 'unsafe-inline'; " + ("script-src 'unsafe-inline'; " if scripts else "")
    policy = f"default-src 'none'; {allowed}base-uri 'none'; form-action 'none'"
    # Without an icon of its own a browser would ask for one.
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
    """The body of a page of a kind, its chapters without a content left out."""
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


def paragraph(*words: str) -> str:
    """Paragraphs of plain texts, those without words left out."""
    return "".join(f"<p>{escape(text)}</p>\n" for text in words if text)


def bullets(items: Iterable[str], words: str = "") -> str:
    """A list of plain texts, with words before it; nothing when there are none."""
    listed = "".join(f"<li>{escape(item)}</li>\n" for item in items)
    return f"{paragraph(words)}<ul>\n{listed}</ul>\n" if listed else ""


def table(caption: str, head: Sequence[str], rows: Iterable[Sequence[str]], numbers: str = "", worst: int = -1) -> str:
    """A table of plain texts with its caption; the first cell of a row heads it. Nothing when there are no rows."""
    rows = list(rows)
    if not rows:
        return ""
    kinds = [' class="number"' if kind == "n" else "" for kind in numbers.ljust(len(head))]
    heads = "".join(f'<th scope="col"{kind}>{_cell(text)}</th>' for text, kind in zip(head, kinds, strict=True))
    top = f"<thead><tr>{heads}</tr></thead>\n" if any(head) else ""
    lines = []
    for number, (first, *rest) in enumerate(rows):
        cells = "".join(f"<td{kind}>{_cell(text)}</td>" for text, kind in zip(rest, kinds[1:], strict=True))
        mark = ' class="worst"' if number == worst else ""
        lines.append(f'<tr{mark}><th scope="row"{kinds[0]}>{_cell(first)}</th>{cells}</tr>')
    body = "\n".join(lines)
    return (
        f'<div class="wide"><table>\n<caption>{escape(caption)}</caption>\n{top}'
        f"<tbody>\n{body}\n</tbody>\n</table></div>\n"
    )


def facts(caption: str, rows: Iterable[tuple[str, str]]) -> str:
    """A table of plain texts behind what they are about."""
    return table(caption, ("", ""), rows)


def _cell(text: str) -> str:
    """An escaped text that breaks neither contact ids nor between a number and its unit, but names at underscores."""
    if isinstance(text, Markup):
        return text
    # Escaped before spans and breaks are put in, which are to stay markup.
    return _ID.sub(r'<span class="id">\g<0></span>', _UNIT.sub("\\1\u00a0\\2", escape(text))).replace("_", "_<wbr>")
