"""Numeric kernels: plain loops over arrays of a few numbers, which Numba compiles when they are first called.

What is compiled stays beside the source, or in the user's cache, for later processes. Numba looks at the file of a
kernel alone to tell whether that is still valid: kernels call only what is in their own file, and take named tuples of
that file alone.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar, cast

from numba import njit
from numba.core import event

P = ParamSpec("P")
R = TypeVar("R")

_SETTINGS: dict[str, Any] = {"error_model": "numpy"}


def compiled(function: Callable[P, R]) -> Callable[P, R]:
    """A kernel: a function of numbers and arrays, compiled. The function as it is written is its attribute py_func.

    Where no folder for what is compiled can be written to, each process compiles anew.
    """
    try:
        kernel = njit(cache=True, **_SETTINGS)(function)
    except RuntimeError:  # no folder to keep it in
        kernel = njit(**_SETTINGS)(function)
    return cast("Callable[P, R]", kernel)


def part(function: Callable[P, R]) -> Callable[P, R]:
    """What kernels of the same file call: compiled with them."""
    return cast("Callable[P, R]", njit(**_SETTINGS)(function))


class _Compiling(event.Listener):  # type: ignore[misc]
    """How long this process has been compiling, s, and who is told when it begins to."""

    def __init__(self) -> None:
        self.seconds, self.told, self._depth, self._since = 0.0, list[Callable[[str], None]](), 0, 0.0

    def on_start(self, event: Any) -> None:
        if self._depth == 0:
            self._since = time.monotonic()
            for tell in self.told:
                tell("compiling kernels, which takes about a minute the first time")
        self._depth += 1

    def on_end(self, event: Any) -> None:
        self._depth -= 1
        if self._depth == 0:
            self.seconds += time.monotonic() - self._since


_compiling = _Compiling()
event.register("numba:compile", _compiling)


def announce(tell: Callable[[str], None]) -> None:
    """Has somebody told, from now on, when this process begins to compile."""
    _compiling.told.append(tell)


def clock() -> float:
    """Seconds since some moment, but for those spent on compiling kernels, which time limits do not count."""
    return time.monotonic() - _compiling.seconds
