"""Ceilings on the sums of lines of the package and of the tests. They are only ever lowered.

Whoever adds lines takes others away in the same change, and lowers the ceiling where the sum has fallen.
"""

import ast
import io
import tokenize

import pytest

from tests import ROOT

SOURCES = {".py", ".js", ".css", ".html"}
NO_CODE = {tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT, tokenize.ENDMARKER}
# All lines; lines of Python without docstrings, comments and blanks.
CEILINGS = {"fmopt": (70391, 46227), "tests": (40642, 31010)}


def code_lines(text: str) -> int:
    """Number of lines that hold code: neither docstrings nor comments nor blanks."""
    tokens = tokenize.generate_tokens(io.StringIO(text).readline)
    held = {row for token in tokens if token.type not in NO_CODE for row in range(token.start[0], token.end[0] + 1)}
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str):
            held -= {*range(node.lineno, (node.end_lineno or node.lineno) + 1)}
    return len(held)


@pytest.mark.parametrize("root", CEILINGS)
def test_no_sum_of_lines_rises(root: str) -> None:
    texts = [(file.suffix, file.read_text("utf-8")) for file in (ROOT / root).rglob("*") if file.suffix in SOURCES]
    lines = sum(len(text.splitlines()) for _, text in texts)
    code = sum(code_lines(text) for suffix, text in texts if suffix == ".py")
    most_lines, most_code = CEILINGS[root]
    figures = f"{root}: {lines} lines, at most {most_lines}; {code} lines of code, at most {most_code}"
    assert lines <= most_lines, figures
    assert code <= most_code, figures


def test_lines_of_code_are_counted() -> None:
    text = '"""Text."""\n\nimport a  # why\n# why\nB = """\n\n"""\n"""Text\n\nof B."""\n'
    text += 'def f():\n    "Text"\n    return [\n        1,\n\n    ]\n'
    assert code_lines(text) == 8
