"""Tables of HTML for people and screen readers, from plain texts."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from html import escape

_UNIT = re.compile(r"(\d) (mm|µm|%|N|s)\b")
_ID = re.compile(r"\b[vef]\d+-[vef]\d+\b")


def table(caption: str, head: Sequence[str], rows: Iterable[Sequence[str]], numbers: str = "", worst: int = -1) -> str:
    """A table with its caption; the first cell of a row heads it. Nothing when there are no rows.

    Args:
        caption: what it lists.
        head: the columns; no row of heads when all are empty.
        rows: plain texts; they are escaped here.
        numbers: for each column "n" when it holds numbers, else anything.
        worst: index of the row to bring out.
    """
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


def _cell(text: str) -> str:
    """An escaped text that breaks neither contact ids nor between a number and its unit, but names at underscores."""
    return _ID.sub(r'<span class="id">\g<0></span>', _UNIT.sub("\\1\u00a0\\2", escape(text))).replace("_", "_<wbr>")
