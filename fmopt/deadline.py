"""Until when a computation may go on: a moment for all that it calls, which heeds it where it may take long."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

from fmopt.compiled import clock
from fmopt.errors import OverdueError

_moment: ContextVar[float] = ContextVar("moment", default=math.inf)


def deadline() -> float:
    """The `clock()` at which to stop; infinite where there is none."""
    return _moment.get()


@contextmanager
def until(moment: float) -> Iterator[None]:
    """What runs inside is to stop at a `clock()`, whatever moment was set around it."""
    token = _moment.set(moment)
    try:
        yield
    finally:
        _moment.reset(token)


def heed() -> None:
    """Goes on if there is time left.

    Raises:
        OverdueError: there is none.
    """
    if clock() > _moment.get():
        raise OverdueError("the time limit is used up", advice="raise settings.time_limit")
