"""Kernels: compiled as written, announced, on no clock, kept for later processes, and at work where nothing is kept."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from fmopt.runtime import compiled
from tests import ROOT

PROBLEM = ROOT / "problems" / "lee_huang_peg.toml"
KERNEL = """
from fmopt.runtime.compiled import announce, compiled, part

@part
def _twice(x: float) -> float:
    return 2.0 * x

@compiled
def four_times(x: float) -> float:
    return _twice(_twice(x))
"""
RUN = """
import kernel
words = []
kernel.announce(words.append)
assert kernel.four_times(1.5) == 6.0
print(len(words))
"""


def compilations(folder: Path) -> int:
    """How often a process of its own that calls a kernel compiles."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(folder), *sys.path])}
    words = [sys.executable, "-c", RUN]
    done = subprocess.run(words, env=environment, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr
    return int(done.stdout)


def test_a_kernel_is_compiled_once_for_all_processes(tmp_path: Path) -> None:
    (tmp_path / "kernel.py").write_text(KERNEL)
    assert compilations(tmp_path) == 1
    assert compilations(tmp_path) == 0


def test_a_process_that_can_keep_nothing_compiles_anew(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(*_: object, **settings: object) -> object:
        if "cache" in settings:
            raise RuntimeError("cannot cache function: no locator available")
        return real(**settings)

    real = compiled.njit
    monkeypatch.setattr(compiled, "njit", refused)
    assert compiled.compiled(lambda x: x + 1)(2) == 3


def test_the_clock_stands_still_while_something_is_compiled_and_only_then() -> None:
    compiling, began = compiled._compiling, compiled.clock()
    for nested in range(2):
        compiling.on_start(nested)
    time.sleep(0.4)
    for nested in range(2):
        compiling.on_end(nested)
    assert compiled.clock() - began < 0.2
    time.sleep(0.2)
    assert compiled.clock() - began >= 0.2


def test_no_kernel_reaches_beyond_its_arrays() -> None:
    """Compiled, kernels do not look where they read and write; as they are written, Python does."""
    code = (
        "import sys\nfrom fmopt.planning.pipeline import synthesise\nfrom fmopt.task.problem import load\n"
        "print(synthesise(load(sys.argv[1])).document['sha256'])"
    )
    found = []
    for written in ("0", "1"):
        environment = {**os.environ, "NUMBA_DISABLE_JIT": written}
        words = [sys.executable, "-c", code, str(PROBLEM)]
        done = subprocess.run(words, env=environment, capture_output=True, text=True, timeout=900, check=False)
        assert done.returncode == 0, done.stderr
        found.append(done.stdout)
    assert found[0] == found[1]
