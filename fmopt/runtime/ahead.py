"""Kernels compiled before they are called, side by side: once for all processes, in as many as there are cores.

Which kernels nearly all plans call, and with what types, is in signatures.json, those of one file together since they
share what they call. Numba keeps what the children compile where later processes look for it. A kernel that is not
listed, or that a child did not come to, is compiled when it is called first.
"""

from __future__ import annotations

import fcntl
import importlib
import json
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numba import from_dtype, types
from numba.core import config
from numba.np.numpy_support import as_dtype

from fmopt.runtime.compiled import LIST, mark
from fmopt.runtime.process import cores

if TYPE_CHECKING:
    from multiprocessing.connection import Connection

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
        # Asked again under the lock: whoever held it may have done it all.
        if not done.exists() and _shared_out(json.loads(LIST.read_text()), count, tell):
            done.touch()


def _shared_out(groups: list[Listed], count: int, tell: Callable[[str], None]) -> bool:
    """Has children compile groups of kernels, one after the other as they come to it; whether all are compiled."""
    from multiprocessing.connection import Connection, wait

    total, left, finished = sum(map(len, groups)), iter(groups), 0
    with ExitStack() as stack:
        children = [stack.enter_context(_child()) for _ in range(min(count, len(groups)))]
        while children:
            tell(f"compiling kernels, once: {finished} of {total}")
            for line in wait(children):
                assert isinstance(line, Connection)
                try:
                    if line.recv():  # one kernel more is compiled; False asks for a group
                        finished += 1
                    else:
                        line.send(next(left, None))
                except (EOFError, ConnectionError):  # it has ended, as it does when nothing is left
                    children.remove(line)
    return finished == total


@contextmanager
def _child() -> Iterator[Connection]:
    from fmopt.runtime.child_process import Child

    child = Child("fmopt.runtime.ahead:work")
    try:
        yield child.connection
    finally:
        child.end()


def work(line: Connection) -> None:
    """The inside of a child: asks for groups of kernels until there are none, and says when each is compiled."""
    while True:
        line.send(False)
        group = line.recv()
        if group is None:
            return
        for name, signature in group.items():
            kernel_of(name).compile(tuple(map(type_of, signature)))
            line.send(True)


def kernel_of(name: str) -> Any:
    """The kernel with this module and name."""
    module, function = name.split(":")
    return getattr(importlib.import_module(module), function)


def json_of(kind: Any) -> Any:
    """A type of an argument of a kernel as JSON; `type_of` reads it.

    Raises:
        TypeError: kernels of the list take no such type.
    """
    match kind:
        case types.Array():
            return ["array", json_of(kind.dtype), kind.ndim, kind.layout, not kind.mutable, kind.aligned]
        case types.Record():
            return ["record", np.lib.format.dtype_to_descr(as_dtype(kind))]
        case types.BaseNamedTuple():  # before plain tuples, which it is as well
            name = f"{kind.instance_class.__module__}:{kind.instance_class.__qualname__}"
            return ["named", name, list(map(json_of, kind.types))]
        case types.BaseTuple():
            return ["tuple", list(map(json_of, kind.types))]
        case types.Number() | types.Boolean():
            return kind.name
    raise TypeError(f"no kernel that is compiled ahead takes {kind}")


def type_of(told: Any) -> Any:
    """The type that `json_of` told."""
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
