"""What has been worked out about an object, kept with it: the memory goes when the object does."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache, partial, wraps
from typing import Any, Concatenate, ParamSpec, TypeVar

T = TypeVar("T")
R = TypeVar("R")
P = ParamSpec("P")
_PLACE = "_remembered"


class _Memory(dict[Any, Any]):
    """Results by function, in the process that found them: copies and what is sent to others start without."""

    def __reduce__(self) -> tuple[type[_Memory], tuple[()]]:
        return _Memory, ()


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
                memory[function] = lru_cache(maxsize=most)(partial(function, owner))
            kept: Callable[P, R] = memory[function]
            return kept(*arguments, **named)

        return found

    return decorated
