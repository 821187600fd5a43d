"""Methods whose results stay with their object: of the few points and contacts of a plan the same is asked again."""

from collections.abc import Callable
from functools import cache, partial
from typing import Any, Concatenate, Generic, ParamSpec, TypeVar, cast

T = TypeVar("T")
P = ParamSpec("P")
R = TypeVar("R")


class remembered(Generic[T, P, R]):
    """Keeps what a method finds with its object, where a cache of the method's own would keep the object as well."""

    def __init__(self, method: Callable[Concatenate[T, P], R]) -> None:
        self._method = method
        self._name = method.__name__

    def __get__(self, owner: Any, kind: type) -> Callable[P, R]:
        # From then on found before this is: what an object has itself comes first.
        found = cast("Callable[P, R]", cache(partial(self._method, owner)))
        owner.__dict__[self._name] = found
        return found
