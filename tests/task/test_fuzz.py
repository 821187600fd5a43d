"""Whatever is done to a valid file, loading it gives a problem or an InputError, never anything else."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from fmopt.errors import InputError
from fmopt.task.problem import Problem, load
from tests import ROOT

PROBLEM = "problems/square_peg.toml"
FILES = [PROBLEM, "models/square_peg.toml", "models/square_hole_block.toml"]
TEXTS = {name: (ROOT / name).read_text(encoding="utf-8") for name in FILES}

VALUES = st.sampled_from(
    r"""
    nan; -inf; 1e400; -1; 0; 1e-300; 1e300; 0x10; 1_000_000; true; ''; "5 kg"; "1e400 mm"; "width"; "(((1"; "1 / 0"; []
    [[1], 2]; [1, 2, 3]; {}; { a = 1 }; 1979-05-27; 07:32:00; "../models"; "\u0000"; "a\nb"; "part"; 9999999999999999999
    """.strip()
    .replace("\n", ";")
    .split(";")
)
FUZZ = settings(
    max_examples=50, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.function_scoped_fixture]
)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name, text in TEXTS.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text, encoding="utf-8")
    return tmp_path


def loads_or_refuses(folder: Path, name: str, content: bytes) -> None:
    (folder / name).write_bytes(content)
    try:
        with suppress(InputError):
            assert isinstance(load(folder / PROBLEM), Problem)
    finally:
        (folder / name).write_text(TEXTS[name], encoding="utf-8")


@given(name=st.sampled_from(FILES), data=st.data())
@FUZZ
def test_bytes_changed(folder: Path, name: str, data: st.DataObject) -> None:
    content = TEXTS[name].encode()
    for _ in range(data.draw(st.integers(1, 3))):
        start = data.draw(st.integers(0, len(content)))
        end = data.draw(st.integers(start, min(start + 20, len(content))))
        content = content[:start] + data.draw(st.binary(max_size=6)) + content[end:]
    loads_or_refuses(folder, name, content)


@given(name=st.sampled_from(FILES), data=st.data())
@FUZZ
def test_values_changed(folder: Path, name: str, data: st.DataObject) -> None:
    lines = TEXTS[name].split("\n")
    assigned = [i for i, line in enumerate(lines) if " = " in line]
    for _ in range(data.draw(st.integers(1, 3))):
        i = data.draw(st.sampled_from(assigned))
        lines[i] = f"{lines[i].split(' = ')[0]} = {data.draw(VALUES)}"
    loads_or_refuses(folder, name, "\n".join(lines).encode())


@given(name=st.sampled_from(FILES), data=st.data())
@FUZZ
def test_lines_dropped_repeated_and_exchanged(folder: Path, name: str, data: st.DataObject) -> None:
    lines = TEXTS[name].split("\n")
    for _ in range(data.draw(st.integers(1, 3))):
        i, j = data.draw(st.integers(0, len(lines) - 1)), data.draw(st.integers(0, len(lines) - 1))
        match data.draw(st.sampled_from(["drop", "repeat", "exchange"])):
            case "drop":
                lines[i] = ""
            case "repeat":
                lines.insert(j, lines[i])
            case _:
                lines[i], lines[j] = lines[j], lines[i]
    loads_or_refuses(folder, name, "\n".join(lines).encode())


@given(
    name=st.sampled_from(FILES[1:]),
    data=st.data(),
    factor=st.sampled_from([1e-9, 1e-6, 1e-3, 0.5, 0.999999999, 1.000000001, 2.0, 1e3, 1e6]),
)
@FUZZ
def test_sizes_changed(folder: Path, name: str, data: st.DataObject, factor: float) -> None:
    lines = TEXTS[name].split("\n")
    sizes = [i for i, line in enumerate(lines) if " = " in line and line.split(" = ")[1][0].isdigit()]
    i = data.draw(st.sampled_from(sizes))
    key, value = lines[i].split("#")[0].split(" = ")
    lines[i] = f"{key} = {float(value) * factor!r}"
    loads_or_refuses(folder, name, "\n".join(lines).encode())
