"""Pages without a browser: their HTML read, their scripts run in V8 over a stub of the page."""

import json
from html.parser import HTMLParser
from pathlib import Path
from typing import Any, Self

from py_mini_racer import JSEvalException, MiniRacer

STUB = (Path(__file__).parent / "stub.js").read_text(encoding="utf-8")
VOID = {"area", "base", "br", "col", "hr", "img", "input", "link", "meta", "source", "wbr"}
Node = list[Any]


class Tree(HTMLParser):
    """A page as nested [tag, attributes, children]; what is not closed, or closed twice, is an error."""

    def __init__(self, text: str) -> None:
        super().__init__(convert_charrefs=True)
        self.root: Node = ["page", {}, []]
        self._open = [self.root]
        self.feed(text)
        self.close()
        assert len(self._open) == 1, f"never closed: {[node[0] for node in self._open[1:]]}"

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        assert len(dict(attrs)) == len(attrs), f"an attribute of {tag} twice: {attrs}"
        node: Node = [tag, {name: value or "" for name, value in attrs}, []]
        self._open[-1][2].append(node)
        if tag not in VOID:
            self._open.append(node)

    def handle_endtag(self, tag: str) -> None:
        assert self._open[-1][0] == tag, f"</{tag}> closes <{self._open[-1][0]}> in line {self.getpos()[0]}"
        self._open.pop()

    def handle_data(self, data: str) -> None:
        self._open[-1][2].append(data)


def walk(node: Node) -> list[Node]:
    """The elements of a tree, in the order of the page."""
    return [node, *(inner for child in node[2] if not isinstance(child, str) for inner in walk(child))]


def words(node: Node) -> str:
    """The text of an element, without scripts and styles."""
    parts = [child if isinstance(child, str) else words(child) for child in node[2] if child[0] not in _SILENT]
    return " ".join(" ".join(parts).split())


_SILENT = ("script", "style")


class Page:
    """An open page, driven as a user would."""

    def __init__(self, text: str) -> None:
        self.tree = Tree(text).root
        self._engine = MiniRacer()
        self.run(f"{STUB}\npage.root = built({json.dumps(self.tree)}, null); 0")
        for node in walk(self.tree):
            if node[0] == "script" and node[1].get("type", "text/javascript") == "text/javascript":
                self.run("".join(node[2]) + "\n;0")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._engine.close()

    def run(self, program: str) -> Any:
        """The value of an expression in the page; what a script throws is thrown."""
        return self._engine.eval(program)

    def press(self, key: str) -> bool:
        """Whether the element in focus takes the key."""
        return bool(self.run(f"pressed({json.dumps(key)})"))

    def drawn(self) -> int:
        """A number that tells pictures apart."""
        return int(self.run("document.querySelector('canvas').pen.digest()"))


Thrown = JSEvalException
