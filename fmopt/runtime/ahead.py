"""Kernels compiled before they are called, side by side: once for all processes, in as many as there are cores.

Which kernels nearly all plans call, and with what types, is in signatures.json, those of one file together since they
share what they call. Numba keeps what the children compile where later processes look for it. A kernel that is not
listed, or that a child did not come to, is compiled when it is called first.
"""

import fcntl
import importlib
import json
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from typing import Any, TypeAlias

import numpy as np
from numba import from_dtype, types
from numba.core import config

from fmopt.errors import ResourceError
from fmopt.runtime.compiled import LIST, mark
from fmopt.runtime.pool import share_out
from fmopt.runtime.process import cores

Listed: TypeAlias = dict[str, list[Any]]  # types of arguments, as JSON, of kernels by module and name


def compile_ahead(tell: Callable[[str], None] = lambda _: None) -> None:
    """Compiles what nearly all plans call, unless that was done before or there is one core only.

    Two processes that come to it at once do not do it twice: one waits for the other, or for its end.
    """
    count, done = cores(), mark()
    if config.DISABLE_JIT or count < 2 or done.exists():
        return
    try:
        done.parent.mkdir(parents=True, exist_ok=True)
        lock = (done.parent / "lock").open("wb")
    except OSError:  # nothing can be kept: each process compiles what it calls
        return
    with lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            tell("compiling kernels, once: another process is at it")
            fcntl.flock(lock, fcntl.LOCK_EX)
        if done.exists():  # whoever held the lock has done it all
            return
        groups: list[Listed] = json.loads(LIST.read_text())
        total, finished = sum(map(len, groups)), list[str]()

        def take(name: str) -> None:
            finished.append(name)
            tell(f"compiling kernels, once: {len(finished)} of {total}")

        tell(f"compiling kernels, once: 0 of {total}")
        with suppress(ResourceError):  # without all workers the rest is compiled when it is called
            share_out([partial(_compile, group) for group in groups], count, take)
            done.touch()


def _compile(group: Listed, tell: Callable[[str], None]) -> None:
    """Compile a group of kernels, and name each that is done."""
    for name, signature in group.items():
        kernel_of(name).compile(tuple(map(type_of, signature)))
        tell(name)


def kernel_of(name: str) -> Any:
    """The kernel with this module and name."""
    module, function = name.split(":")
    return getattr(importlib.import_module(module), function)


def type_of(told: Any) -> Any:
    """The type of an argument that the list of kernels names."""
    match told:
        case ["array", kind, dimensions, layout, readonly, aligned]:
            return types.Array(type_of(kind), dimensions, layout, readonly, aligned=aligned)
        case ["record", fields]:
            return from_dtype(
                # JSON makes a list of a shape; a field of one number has none.
                np.lib.format.descr_to_dtype([(name, kind, tuple(*shape)) for name, kind, *shape in fields])
            )
        case ["named", name, parts]:
            return types.BaseTuple.from_types(tuple(map(type_of, parts)), kernel_of(name))
        case ["tuple", parts]:
            return types.BaseTuple.from_types(tuple(map(type_of, parts)))
    return getattr(types, told)
