"""Pages of Markdown become one page of HTML: links, figures and the search stay inside it.

A page is a file `<name>.md` in this folder, named in `PAGES`; its first line is its heading. Links between pages are
written `[words](problem.md#meshes)`, figures `![what is to be seen](figures/name.svg)`.
"""

import re
from collections.abc import Iterator, Sequence
from html import escape
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING

from fmopt.report.shell import page, svg_source

if TYPE_CHECKING:
    from markdown_it.token import Token

FOLDER = Path(__file__).parent.parent
PAGES = (
    "start",
    "concepts",
    "glossary",
    "problem",
    "certificate",
    "presses",
    "robots",
    "trials",
    "studies",
    "commands",
    "python",
    "errors",
    "shipped",
    "limits",
    "design",
    "changes",
    "speed",
    "references",
)
"""The pages, in their order."""


def text_of(name: str) -> str:
    """A page in Markdown."""
    return (FOLDER / f"{name}.md").read_text(encoding="utf-8")


def anchor(heading: str) -> str:
    """The name of a heading in links, as where such files are browsed: small letters, hyphens, nothing else."""
    return re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-")


def manual(names: Sequence[str] = PAGES) -> str:
    """The pages as one page of HTML, with contents and a search, which opens offline."""
    made = [_made(name) for name in names]
    contents = "\n".join(f"<li>{heads}</li>" for heads, _ in made)
    body = "\n".join(f'<article id="{name}">\n{html}</article>' for name, (_, html) in zip(names, made, strict=True))
    return page(
        "fmopt: the manual", _beside("book/manual.css"), _BODY.format(contents, body, _beside("book/manual.js")), True
    )


_BODY = """<header>
<p class="kind">fmopt</p>
<p class="title">The manual</p>
<form role="search"><label for="words">Search</label> <input id="words" type="search" autocomplete="off"></form>
<output id="found" for="words"></output>
</header>
<nav aria-label="pages">
<ol>
{}
</ol>
</nav>
<main>
{}
</main>
<script>
{}</script>
"""


def _beside(name: str) -> str:
    return (FOLDER / name).read_text(encoding="utf-8")


def _made(name: str) -> tuple[str, str]:
    """A page's lines of the contents, and the page, both in HTML."""
    from markdown_it import MarkdownIt

    # Without HTML of its own a page cannot break the one that it becomes part of.
    reader = MarkdownIt("commonmark", {"html": False, "xhtmlOut": False}).enable("table")
    tokens = reader.parse(text_of(name))
    for token in tokens:
        for child in token.children or ():
            _turned(child, name)
    # Before rendering, as it is the tokens that get the names.
    heads = list(_named(tokens, name))
    inner = "".join(f'\n<li><a href="#{at}">{escape(said)}</a></li>' for at, said, level in heads if level == 2)
    title = f'<a href="#{heads[0][0]}">{escape(heads[0][1])}</a>'
    written = reader.renderer.render(tokens, reader.options, {})
    # What a page writes is escaped: these can only be tags of its tables.
    html = written.replace("<table>", '<div class="wide"><table>').replace("</table>", "</table></div>")
    return f"{title}\n<ul>{inner}\n</ul>" if inner else title, html


def _named(tokens: "Sequence[Token]", name: str) -> Iterator[tuple[str, str, int]]:
    """Gives each heading a name of its own, and says them with their words and levels."""
    for token, inner in pairwise(tokens):
        if token.type == "heading_open":
            said = "".join(child.content for child in inner.children or ())
            level = int(token.tag[1])
            at = f"{name}.{anchor(said)}" if level > 1 else f"{name}.top"
            token.attrSet("id", at)
            yield at, said, level


def _turned(child: "Token", name: str) -> None:
    """A link to another page becomes one inside the page, a figure its own source."""
    if child.type == "link_open":
        child.attrSet("href", inside(str(child.attrGet("href")), name))
    elif child.type == "image":
        child.attrSet("src", svg_source(_beside(str(child.attrGet("src")))))


def inside(link: str, name: str) -> str:
    """Where a link of page `name` leads within the one page; links to elsewhere stay as they are."""
    told = re.fullmatch(r"(?:(\w+)\.md)?(?:#([\w\-]+))?", link)
    return link if told is None else f"#{told[1] or name}.{told[2] or 'top'}"
