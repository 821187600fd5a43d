"""Kernels compiled ahead: by several processes, once, even where two commands come to it at the same time."""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from numba import from_dtype, types

from fmopt.certificate.kernels_rows import ROW, Turned
from fmopt.runtime import compiled
from fmopt.runtime.ahead import compile_ahead, type_of
from tests import ROOT
from tests.shared.kernel_list import json_of

KERNEL = """
from fmopt.runtime.compiled import announce, compiled

@compiled
def four_times(x: float) -> float:
    return 4.0 * x
"""
RUN = """
import json, sys
from pathlib import Path
from fmopt.runtime import ahead, compiled
ahead.LIST = compiled.LIST = Path(sys.argv[1])
ahead.cores = lambda: 2
words = []
ahead.compile_ahead(words.append)
print(json.dumps(words))
"""
CALL = """
import kernel_{0}
words = []
kernel_{0}.announce(words.append)
assert kernel_{0}.four_times(1.5) == 6.0
print(len(words))
"""


def started(folder: Path, code: str, *words: str) -> subprocess.Popen[str]:
    """A process that keeps what it compiles in a folder of its own, and finds modules there."""
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(folder / "kept")}
    environment["PYTHONPATH"] = os.pathsep.join([str(folder), *sys.path])
    return subprocess.Popen([sys.executable, "-c", code, *words], env=environment, stdout=subprocess.PIPE, text=True)


def answer(process: subprocess.Popen[str]) -> Any:
    """What a process prints, once it has ended well."""
    told, _ = process.communicate(timeout=120)
    assert process.returncode == 0
    return json.loads(told)


@pytest.fixture
def kernels(tmp_path: Path) -> Path:
    """A folder with two files of kernels and a list of them."""
    (tmp_path / "kept").mkdir()
    for name in "ab":
        (tmp_path / f"kernel_{name}.py").write_text(KERNEL)
    (tmp_path / "list.json").write_text(json.dumps([{f"kernel_{name}:four_times": ["float64"]} for name in "ab"]))
    return tmp_path


def test_what_is_compiled_ahead_is_compiled_once_and_found_by_who_calls_it(kernels: Path) -> None:
    both = [started(kernels, RUN, str(kernels / "list.json")) for _ in range(2)]
    words = [answer(process) for process in both]
    assert sorted(told[-1] for told in words) == [
        "compiling kernels, once: 2 of 2",
        "compiling kernels, once: another process is at it",
    ]
    assert answer(started(kernels, RUN, str(kernels / "list.json"))) == []
    assert [answer(started(kernels, CALL.format(name))) for name in "ab"] == [0, 0]


def test_what_a_child_did_not_come_to_is_compiled_when_it_is_called(kernels: Path) -> None:
    (kernels / "kernel_a.py").write_text(KERNEL + "import os\nos._exit(1)\n")
    words = answer(started(kernels, RUN, str(kernels / "list.json")))
    assert "compiling kernels, once: 2 of 2" not in words
    assert not list((kernels / "kept").rglob("ahead"))
    (kernels / "kernel_a.py").write_text(KERNEL)
    assert answer(started(kernels, CALL.format("a"))) == 1


def test_nothing_is_kept_where_no_folder_can_be_made(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").touch()
    monkeypatch.setattr(compiled, "folder", lambda: str(tmp_path / "file" / "kernels"))
    words: list[str] = []
    compile_ahead(words.append)
    assert words == []


@pytest.mark.parametrize(
    "kind",
    [
        types.float64,
        types.boolean,
        types.Array(types.int64, 2, "F", True, aligned=False),
        types.Tuple((types.float64, types.int64)),
        types.UniTuple(types.Array(types.bool_, 1, "A", False), 3),
        types.Array(from_dtype(ROW), 1, "C", False, aligned=False),
        types.NamedUniTuple(types.Array(types.float64, 2, "C", False), len(Turned._fields), Turned),
    ],
)
def test_types_come_back_from_json(kind: Any) -> None:
    assert type_of(json.loads(json.dumps(json_of(kind)))) == kind


def test_types_that_have_no_json_are_refused() -> None:
    with pytest.raises(TypeError, match="no kernel that is compiled ahead takes unicode_type"):
        json_of(types.unicode_type)


def test_the_list_names_what_a_plan_calls_and_with_what_types() -> None:
    words = [sys.executable, "-m", "tests.shared.kernel_list", "--show"]
    done = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout == compiled.LIST.read_text(), "the list is stale: run python -m tests.shared.kernel_list"
