"""Numeric kernels: plain loops over arrays of a few numbers, which Numba compiles when they are first called.

What is compiled is kept for later processes, in the package's folder or, where that cannot be written to, in the user's
cache. Numba looks at the file of a kernel alone to tell whether that is still valid. What kernels of several files call
is therefore in files named kernels….py, and what they contain names the folder; all else kernels call, and the named
tuples that they take, is in their own file.

How Python and the libraries are set while fmopt computes: for many small objects and many small matrices.
"""

import gc
import hashlib
import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from threading import Lock
from typing import Any, ParamSpec, TypeVar, cast

from numba import config, njit
from numba.core import event
from threadpoolctl import threadpool_limits

from fmopt.runtime.clock import leave_out

P = ParamSpec("P")
R = TypeVar("R")

_SETTINGS: dict[str, Any] = {"error_model": "numpy"}
# LLVM's level and its two vectorisers: kernels of short loops run no faster at the full level, and compile slower.
_EFFORT = {"OPT": 1, "LOOP_VECTORIZE": 0, "SLP_VECTORIZE": 0}
_PACKAGE = Path(__file__).parent.parent
LIST = Path(__file__).with_name("signatures.json")  # of kernels that `fmopt.runtime.ahead` compiles
_COLLECTED = (20_000, 10, 50)  # new objects, and collections of the younger ones, before the next collection
_lock = Lock()
_before: list[tuple[tuple[int, int, int], threadpool_limits]] = []  # what was set before, for each that runs
KERNELS: dict[str, Any] = {}  # those that are defined by now, by module and name


def compiled(function: Callable[P, R]) -> Callable[P, R]:
    """A kernel: a function of numbers and arrays, compiled. The function as it is written is its attribute py_func.

    Where no folder for what is compiled can be written to, each process compiles anew.
    """
    try:
        with _kept_in(folder()):
            kernel = njit(cache=True, **_SETTINGS)(function)
    except RuntimeError:  # no folder to keep it in
        kernel = njit(**_SETTINGS)(function)
    KERNELS[f"{function.__module__}:{function.__qualname__}"] = kernel
    return cast("Callable[P, R]", kernel)


@cache
def folder() -> str:
    """Where what is compiled is kept: a folder for each state of what kernels share: files, settings, types by name."""
    own = Path(os.environ.get("NUMBA_CACHE_DIR") or _PACKAGE / "__pycache__").absolute()
    # It need not be there yet: what is made is made in the nearest folder that is.
    if not os.access(next(place for place in (own, *own.parents) if place.exists()), os.W_OK):
        own = Path(os.environ.get("XDG_CACHE_HOME") or Path("~/.cache").expanduser()) / "fmopt"
    # Sorted, as a disk lists files in an order of its own, which the name must not depend on.
    shared = b"".join(path.read_bytes() for path in (*sorted(_PACKAGE.rglob("kernels*.py")), LIST))
    state = hashlib.sha256(shared + repr((_SETTINGS, _EFFORT)).encode()).hexdigest()
    return str(own / f"kernels-{state[:16]}")


def mark() -> Path:
    """The file that says that all kernels of the list have been compiled."""
    return Path(folder()) / "ahead"


@contextmanager
def _kept_in(folder: str) -> Iterator[None]:
    """Numba keeps in this folder what is compiled of functions that are decorated meanwhile."""
    before, config.CACHE_DIR = config.CACHE_DIR, folder
    try:
        yield
    finally:
        config.CACHE_DIR = before


def part(function: Callable[P, R]) -> Callable[P, R]:
    """What kernels call: compiled with them."""
    return cast("Callable[P, R]", njit(**_SETTINGS)(function))


class _Compiling(event.Listener):  # type: ignore[misc]
    """Leaves the time of compiling out of the clock, and tells when it begins."""

    def __init__(self) -> None:
        self.told, self._depth, self._since = list[Callable[[str], None]](), 0, 0.0
        self._before: dict[str, Any] = {}

    def on_start(self, event: Any) -> None:
        # Kernels are compiled with their parts, each of which is an event of its own: the outermost one counts.
        if self._depth == 0:
            self._before = {name: getattr(config, name) for name in _EFFORT}
            self._set(_EFFORT if event.data["dispatcher"] in KERNELS.values() else {})
            self._since = time.monotonic()
            for tell in self.told:
                tell("compiling kernels, once")
        self._depth += 1

    def on_end(self, event: Any) -> None:
        self._depth -= 1
        if self._depth == 0:
            self._set(self._before)
            leave_out(time.monotonic() - self._since)

    @staticmethod
    def _set(values: dict[str, Any]) -> None:
        for name, value in values.items():
            setattr(config, name, value)


_compiling = _Compiling()
event.register("numba:compile", _compiling)


def announce(tell: Callable[[str], None]) -> None:
    """Has somebody told, from now on, when this process begins to compile."""
    _compiling.told.append(tell)


@contextmanager
def undisturbed() -> Iterator[None]:
    """Looks for garbage less often than Python does by itself, and keeps linear algebra in one thread.

    Looking for garbage takes an eighth of the time of a short solve; what is remembered goes without that, as soon as
    nobody has its object. Matrices are too small to be shared out: further threads only wait for each other, which
    takes a quarter of a core from whatever else runs, and how sums are shared out may change their last digits.
    """
    with _lock:
        # The first of several that run at once knows what was set before all of them; the last one puts it back.
        _before.append(_before[0] if _before else (gc.get_threshold(), threadpool_limits(1, user_api="blas")))
        collected, _ = _before[0]
        # Who looks for garbage less often, or never, which is 0, keeps that.
        gc.set_threshold(*(max(pair) if min(pair) else 0 for pair in zip(collected, _COLLECTED, strict=True)))
    try:
        yield
    finally:
        with _lock:
            collected, threads = _before.pop()
            if not _before:
                gc.set_threshold(*collected)
                threads.restore_original_limits()
