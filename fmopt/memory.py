"""What has been worked out about an object, kept with it: the memory goes when the object does."""

from __future__ import annotations

import gc
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import lru_cache, wraps
from threading import Lock
from typing import Any, Concatenate, ParamSpec, TypeVar
from weakref import ref

T = TypeVar("T")
R = TypeVar("R")
P = ParamSpec("P")
_PLACE = "_remembered"
_lock = Lock()
_before: list[tuple[int, int, int]] = []  # what was set before, for each that runs
_COLLECTED = (20_000, 10, 50)  # new objects, and collections of the younger ones, before the next collection


class _Memory(dict[Any, Any]):
    """Results by function, in the process that found them: copies and what is sent to others start without."""

    def __reduce__(self) -> tuple[type[_Memory], tuple[()]]:
        return _Memory, ()


def _of(function: Callable[Concatenate[T, P], R], owner: ref[T]) -> Callable[P, R]:
    """The function of an object that does not live on for it: a cycle would wait for the garbage collector."""

    def found(*arguments: P.args, **named: P.kwargs) -> R:
        return function(there(owner), *arguments, **named)

    return found


def there(owner: ref[T]) -> T:
    """The object, which is there as long as somebody asks for what it remembers."""
    found = owner()
    assert found is not None
    return found


def remembered(most: int) -> Callable[[Callable[Concatenate[T, P], R]], Callable[Concatenate[T, P], R]]:
    """Keeps the latest results of a pure function with its first argument, an object that does not change.

    A cache of the function's own would hold on to objects that nobody uses any more: a worker that plans one problem
    after the other would grow by each of them.

    Args:
        most: results kept with one object; the least recently used go first.
    """

    def decorated(function: Callable[Concatenate[T, P], R]) -> Callable[Concatenate[T, P], R]:
        @wraps(function)
        def found(owner: T, /, *arguments: P.args, **named: P.kwargs) -> R:
            memory = owner.__dict__.get(_PLACE)
            if memory is None:
                memory = owner.__dict__[_PLACE] = _Memory()
            if function not in memory:
                memory[function] = lru_cache(maxsize=most)(_of(function, ref(owner)))
            kept: Callable[P, R] = memory[function]
            return kept(*arguments, **named)

        return found

    return decorated


@contextmanager
def few_collections() -> Iterator[None]:
    """Looks for garbage less often than Python does by itself, which takes an eighth of the time of a short solve.

    What is remembered goes without that, as soon as nobody has its object.
    """
    with _lock:
        _before.append(_before[0] if _before else gc.get_threshold())
        gc.set_threshold(*(max(pair) if min(pair) else 0 for pair in zip(_before[0], _COLLECTED, strict=True)))
    try:
        yield
    finally:
        with _lock:
            before = _before.pop()
            if not _before:
                gc.set_threshold(*before)
