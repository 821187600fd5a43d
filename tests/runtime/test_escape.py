"""Text from outside, written into other languages: it stays text."""

import csv
import io
import sys
import unicodedata

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fmopt.runtime import escape

BREAKS = ("\n", "\r", "\r\n", "\v", "\f", "\x1c", "\x1d", "\x1e", "\x85", "\u2028", "\u2029", "\0", "\x1b[2J", "\u202e")
ANY = st.text(st.characters(codec="utf-8") | st.sampled_from("\n\r\x85\u2028\"'\\#:=@+-,;\x1b\0"))


def is_one_line(text: str) -> bool:
    return len(f"{text}.".splitlines()) == 1 and not any(unicodedata.category(one) in ("Cc", "Cf") for one in text)


@given(ANY)
def test_everything_stays_on_one_line(text: str) -> None:
    for written in (escape.one_line, escape.urscript_string, escape.csv_text, escape.csv_comment):
        assert is_one_line(written(text))


def test_no_letter_breaks_a_line() -> None:
    letters = [chr(number) for number in (*range(0x3000), 0xFEFF, 0xFFFE, 0xFFFF, 0xE0001)]
    assert [letter for letter in letters if not is_one_line(escape.one_line(f"a{letter}b"))] == []


def test_what_people_write_stays_as_it_is() -> None:
    for text in ("Peg, 0.1 mm a side: 20 µm · 3°", "Stift – Ø 10", "栓 16 mm", "a\\b"):
        assert (escape.one_line(text), escape.csv_text(text)) == (text, text)


@given(ANY)
def test_strings_of_urscript_have_no_quotes_inside(text: str) -> None:
    written = escape.urscript_string(text)
    assert written[0] == written[-1] == '"'
    assert not {'"', "\\"} & set(written[1:-1])


@pytest.mark.parametrize("surrogate", ["\ud800", "a\udfffb"])
def test_half_a_character_can_be_written(surrogate: str) -> None:
    for written in (escape.one_line, escape.urscript_string, escape.csv_text, escape.csv_comment):
        assert written(surrogate).encode()


@given(ANY)
def test_no_cell_is_a_formula(text: str) -> None:
    content = io.StringIO()
    csv.writer(content).writerow([escape.csv_text(text), "end"])
    [[cell, end]] = csv.reader(io.StringIO(content.getvalue()))
    assert end == "end"
    assert not cell.lstrip().startswith(("=", "+", "-", "@"))


@pytest.mark.parametrize("text", ["=1+1", "+1", "-1", "@a", "\t=1", "\r=1", " =1", "'=1"])
def test_formulas_are_marked(text: str) -> None:
    assert escape.csv_text(text).startswith("'")


@given(ANY)
def test_a_comment_of_a_table_is_one_cell(text: str) -> None:
    line = f"# plan {escape.csv_comment(text)}"
    for delimiter in ",;\t|":
        assert len(next(csv.reader([line], delimiter=delimiter))) == 1


def test_every_line_break_that_python_knows_is_among_these() -> None:
    known = {chr(n) for n in range(sys.maxunicode + 1) if len(f"a{chr(n)}b".splitlines()) > 1}
    assert known == {text for text in BREAKS if text in known}
    assert not any(letter.isprintable() for letter in known)
