"""What is said beside the code: what arguments are, in docstrings, and why a thing is done so, in comments."""

from __future__ import annotations

import ast
import io
import re
import tokenize
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import fmopt

PACKAGE = Path(fmopt.__file__).parent
DOCUMENTED = 0.8  # of the public functions that take two arguments or more
COMMENTS = 3.0  # in a hundred lines
MOST_ARGUMENTS = 6  # self and cls included
_ENTRY = re.compile(r" {4}(\*{0,2}\w+(?:, \*{0,2}\w+)*): \S")
_DIRECTIVE = re.compile(r"#\s*(noqa|type:|fmt:|pragma)")


def sources() -> dict[str, str]:
    return {path.relative_to(PACKAGE).as_posix(): path.read_text("utf-8") for path in sorted(PACKAGE.rglob("*.py"))}


def taken(function: ast.FunctionDef) -> list[str]:
    """The names of all that a function takes."""
    a = function.args
    rest = [one for one in (a.vararg, a.kwarg) if one is not None]
    return [one.arg for one in (*a.posonlyargs, *a.args, *a.kwonlyargs, *rest)]


def said(docstring: str) -> set[str]:
    """The names under `Args:` of a docstring."""
    _, found, after = f"\n{docstring}".partition("\nArgs:\n")
    section = after.split("\n\n")[0] if found else ""
    entries = [entry[1] for line in section.splitlines() if (entry := _ENTRY.match(line))]
    return {name.strip(" *") for entry in entries for name in entry.split(",")}


def public(text: str) -> Iterator[ast.FunctionDef]:
    """The functions of a module and the methods of its classes, none of them behind an underscore."""
    for node in ast.parse(text).body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef) and not node.name.startswith("_"):
            within = node.body if isinstance(node, ast.ClassDef) else [node]
            yield from (one for one in within if isinstance(one, ast.FunctionDef) and not one.name.startswith("_"))


def is_documented(function: ast.FunctionDef, elsewhere: dict[str, set[str]]) -> bool:
    """Whether a function says of each argument what it is, or that it is as for another function, which says it."""
    text = ast.get_docstring(function) or ""
    others = re.findall(r"rguments\s+as\s+for\s+`(\w+)`", text)
    told = said(text).union(*(elsewhere.get(name, set()) for name in others))
    return {*taken(function)} - {"self", "cls"} <= told


def said_by_name(texts: dict[str, str]) -> dict[str, set[str]]:
    found: dict[str, set[str]] = {}
    for text in texts.values():
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.FunctionDef | ast.ClassDef):
                found.setdefault(node.name, set()).update(said(ast.get_docstring(node) or ""))
    return found


def comments(text: str) -> list[str]:
    """All comments of a source but those that are addressed to a tool."""
    tokens = tokenize.generate_tokens(io.StringIO(text).readline)
    return [one.string for one in tokens if one.type == tokenize.COMMENT and not _DIRECTIVE.match(one.string)]


def test_most_public_functions_say_what_their_arguments_are() -> None:
    """Counted are public functions and methods with two arguments or more; commands say it in their options' help."""
    texts = {name: text for name, text in sources().items() if not name.startswith("cli/")}
    elsewhere = said_by_name(texts)
    counted = [one for text in texts.values() for one in public(text) if len({*taken(one)} - {"self", "cls"}) > 1]
    good = sum(is_documented(one, elsewhere) for one in counted)
    assert len(counted) > 800
    assert good >= DOCUMENTED * len(counted), f"{good} of {len(counted)}"


def test_functions_take_few_arguments() -> None:
    """Commands aside, whose arguments are options."""
    many = [
        f"{name}: {node.name}"
        for name, text in sources().items()
        if not name.startswith("cli/")
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.FunctionDef) and len(taken(node)) > MOST_ARGUMENTS
    ]
    assert not many


def astray(text: str) -> list[str]:
    """The strings of a source that explain nothing: neither docstrings nor right behind an assignment."""
    found = []
    for node in ast.walk(ast.parse(text)):
        body = getattr(node, "body", None)
        for before, one in pairwise(body if isinstance(body, list) else ()):
            if isinstance(one, ast.Expr) and isinstance(one.value, ast.Constant) and isinstance(one.value.value, str):
                found += [] if isinstance(before, ast.Assign | ast.AnnAssign) else [one.value.value]
    return found


def test_what_a_name_stands_for_is_said_right_behind_it() -> None:
    assert [f"{name}: {one}" for name, text in sources().items() for one in astray(text)] == []


def test_comments_say_why_often_enough() -> None:
    """Comments in a hundred lines, of all lines that there are; directives to tools are none."""
    texts = sources()
    lines = sum(len(text.splitlines()) for text in texts.values())
    found = sum(len(comments(text)) for text in texts.values())
    assert 100.0 * found >= COMMENTS * lines, f"{found} in {lines}"


def test_the_counts_see_what_they_should() -> None:
    text = (
        "def f(a, *b):\n    '''One.\n\n    Args:\n        a, b: m.\n\n    Raises:\n        E: none.\n    '''\n"
        "def g(a, c):\n    '''Two; arguments as for `f`.\n\n    Args:\n        c: m.\n    '''\n"
        "def h(a, c):\n    '''Three.\n\n    Args:\n        a: m,\n            c: not one.\n    '''  # noqa: E1\n"
        "class C:\n    def of(self, a): ...  # why\n    def _of(self, a, b): ...\ndef _k(a, b): ...\n"
    )
    elsewhere = said_by_name({"": text})
    assert [one.name for one in public(text)] == ["f", "g", "h", "of"]
    assert [is_documented(one, elsewhere) for one in public(text)] == [True, True, False, False]
    assert comments(text) == ["# why"]
    assert astray("'''What.'''\nA = 1\n'''One.'''\n'''Two.'''\ndef f():\n    '''Three.'''\n") == ["Two."]
    assert taken(next(public(text))) == ["a", "b"]
