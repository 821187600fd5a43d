"""TOML with places: every key and value is found again in the text, and unreadable files say where and why."""

from pathlib import Path

import pytest

from fmopt.errors import Fault, InputError
from fmopt.task.toml.source import MAX_BYTES, Key, dotted, read

DOCUMENT = """\
title = "ä ö" # first
a.'b c'.d = 1
[one]
x = { y = [ 10, { z = 11 } ], "q.r" = 12 }
m = [
  [21, 22], # a comment
  [23, 24],
]
[[many.of]]
n = 31
[[many.of]]
n = "é", rest = 0
"""


def written(tmp_path: Path, content: str | bytes) -> Path:
    path = tmp_path / "file.toml"
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return path


def the_fault(path: Path) -> Fault:
    with pytest.raises(InputError) as caught:
        read(path)
    assert caught.value.exit_code == 2
    (fault,) = caught.value.faults
    assert fault.file == str(path)
    return fault


@pytest.mark.parametrize(
    ("key", "of_key", "line", "column"),
    [
        (("title",), False, 1, 9),
        (("a", "b c", "d"), False, 2, 13),
        (("a", "b c", "d"), True, 2, 9),
        (("a", "b c"), True, 2, 3),
        (("one",), True, 3, 2),
        (("one", "x", "y", 0), False, 4, 13),
        (("one", "x", "y", 1, "z"), False, 4, 23),
        (("one", "x", "q.r"), True, 4, 31),
        (("one", "m", 1, 0), False, 7, 4),
        (("many", "of", 0, "n"), False, 10, 5),
        (("many", "of", 1, "n"), False, 12, 5),
        (("many", "of", 1), True, 11, 1),
        (("many", "of", 1, "nothing", 3), False, 11, 1),
        (("nothing",), False, 1, 1),
    ],
)
def test_places(tmp_path: Path, key: Key, of_key: bool, line: int, column: int) -> None:
    source = read(written(tmp_path, DOCUMENT.replace('"é", rest = 0', '"é"')))
    place = source.place(key, of_key=of_key)
    assert (place.line, place.column) == (line, column)


def test_windows_line_ends_keep_places(tmp_path: Path) -> None:
    source = read(written(tmp_path, "a = 1\r\n\r\n[t]\r\nb = 2\r\n"))
    place = source.place(("t", "b"))
    assert (place.line, place.column) == (4, 5)


def test_keys_are_written_as_one_reads_them() -> None:
    assert dotted(("solids", "block", "size", 2)) == "solids.block.size[2]"
    assert dotted(("a b", "c\n\x1b")) == '"a b"."c\\n\\x1b"'


@pytest.mark.parametrize(
    ("content", "line", "column", "code", "words"),
    [
        (DOCUMENT, 12, 8, "toml-syntax", "Expected newline or end of document"),
        ("a = 1\na = 2\n", 2, 6, "toml-syntax", "Cannot overwrite a value"),
        ("a = 1\nb = [1, 2", 2, 10, "toml-syntax", "Unclosed array"),
        ("a = \n", 1, 5, "toml-syntax", "Invalid value"),
        ("a = 1\nb = " + "9" * 5000, 2, 1, "toml-syntax", "5000 digits"),
        (b"\xef\xbb\xbfa = 1\n", 1, 1, "toml-bom", "byte order mark"),
        (b"a = 1\nb = '\xff'\n", 2, 6, "toml-encoding", "byte 0xff is not UTF-8"),
        ("a = 'ä'".encode("utf-16"), 1, 1, "toml-encoding", "byte 0xff is not UTF-8"),
        ("a = 1\nb = " + "[" * 30 + "]" * 30, 2, 28, "toml-nesting", "nested more than 24 deep"),
        ("a = 1\nb = " + "[" * 9000 + "]" * 9000, 2, 1, "toml-nesting", "nested more than 24 deep"),
        ("x." * 3000 + "x = 1", 1, 47, "toml-nesting", "nested more than 24 deep"),
        ("[" + "x." * 3000 + "x]", 1, 48, "toml-nesting", "nested more than 24 deep"),
        ("a = 1 " + "#" * MAX_BYTES, 1, 1, "file-size", "bytes, more than 1000000"),
    ],
)
def test_what_is_no_toml(tmp_path: Path, content: str | bytes, line: int, column: int, code: str, words: str) -> None:
    fault = the_fault(written(tmp_path, content))
    assert (fault.line, fault.column, fault.code) == (line, column, code)
    assert words in fault.message
    assert fault.advice


@pytest.mark.parametrize(
    ("name", "code"),
    [
        ("none.toml", "file-missing"),
        ("a\0b.toml", "file-missing"),
        ("x" * 5000, "file-unreadable"),
        (".", "file-kind"),
        ("/dev/zero", "file-kind"),
    ],
)
def test_what_is_no_file_is_refused(tmp_path: Path, name: str, code: str) -> None:
    fault = the_fault(tmp_path / name)
    assert (fault.code, fault.line, fault.column) == (code, 1, 1)
