"""The clock that time limits go by, which does not count compiling, and the moment that all stages heed."""

import math
import time
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

from fmopt.errors import OverdueError

_left_out = 0.0  # s


def leave_out(seconds: float) -> None:
    """The clock does not count these."""
    global _left_out
    _left_out += seconds


def clock() -> float:
    """Seconds since some moment, but for those spent on compiling kernels, which time limits do not count."""
    return time.monotonic() - _left_out


_moment: ContextVar[float] = ContextVar("moment", default=math.inf)  # one for each thread


def deadline() -> float:
    """The `clock()` at which a computation is to stop; infinite where there is none."""
    return _moment.get()


@contextmanager
def until(moment: float) -> Iterator[None]:
    """What runs inside is to stop at a `clock()`, whatever moment was set around it; it heeds that where it is long."""
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
