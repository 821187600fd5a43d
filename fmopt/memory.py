"""What has been worked out about an object, kept with it: the memory goes when the object does."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache, partial, wraps
from typing import Concatenate, ParamSpec, TypeVar

T = TypeVar("T")
R = TypeVar("R")
P = ParamSpec("P")


def remembered(most: int) -> Callable[[Callable[Concatenate[T, P], R]], Callable[Concatenate[T, P], R]]:
    """Keeps the latest results of a pure function with its first argument, an object that does not change.

    A cache of the function's own would hold on to objects that nobody uses any more: a worker that plans one problem
    after the other would grow by each of them.

    Args:
        most: results kept with one object; the least recently used go first.
    """

    def decorated(function: Callable[Concatenate[T, P], R]) -> Callable[Concatenate[T, P], R]:
        place = f"{function.__module__}.{function.__qualname__}"

        @wraps(function)
        def found(owner: T, /, *arguments: P.args, **named: P.kwargs) -> R:
            known = owner.__dict__
            if place not in known:
                known[place] = lru_cache(maxsize=most)(partial(function, owner))
            kept: Callable[P, R] = known[place]
            return kept(*arguments, **named)

        return found

    return decorated
