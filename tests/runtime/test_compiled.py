"""Kernels: announced, on no clock, kept for later processes, and at work where nothing is kept."""

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest
from numba.core.event import Event, EventStatus

from fmopt.runtime import compiled
from fmopt.runtime.clock import clock

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
    compiling, began = compiled._compiling, clock()
    event = Event("numba:compile", EventStatus.START, {"dispatcher": None})
    for _ in range(2):
        compiling.on_start(event)
    time.sleep(0.4)
    for _ in range(2):
        compiling.on_end(event)
    assert clock() - began < 0.2
    time.sleep(0.2)
    assert clock() - began >= 0.2
