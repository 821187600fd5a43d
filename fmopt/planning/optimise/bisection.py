"""Bisection: the largest factor of all start errors that a motion stands, and how much of something can be had.

Factors lie on a grid: between powers of two in steps of a 64th of the lower one, in 4096ths below 1/64. Where a motion
stands a factor if and only if it stands all smaller ones, which of them are tried makes no difference to what is found.
"""

import math
from bisect import bisect_left
from collections.abc import Callable
from functools import cache
from typing import TypeVar

_OCTAVE = 64  # steps from one power of two to the next
_MOST = 6 * _OCTAVE  # up to a factor of 64
_LEAST = -7 * _OCTAVE  # nothing at all

T = TypeVar("T")

ATTEMPTS = 7  # at most, with the steps that are given


def factor(step: int) -> float:
    """The factor of a step of the grid; step 0 is 1."""
    if step < _LEAST + _OCTAVE:
        return (step - _LEAST) / _OCTAVE**2
    octave, rest = divmod(step, _OCTAVE)
    return math.ldexp(1.0 + rest / _OCTAVE, octave)


def largest(holds: Callable[[float], bool], likely: Callable[[float], bool]) -> tuple[float, float | None]:
    """The largest factor that holds and the next one on the grid, which does not; None in its place past 64.

    The factor is 0 where the least of the grid does not hold. `likely` takes less to say whether a factor holds, and
    tells where to look first, no more.
    """

    def likely_at(step: int) -> bool:
        return likely(factor(step))

    @cache
    def holds_at(step: int) -> bool:
        return holds(factor(step))

    if not holds_at(0):
        last = last_step(_LEAST, 0, holds_at)
        return factor(last), factor(last + 1)
    last = last_step(*_doubled(0, likely_at), likely_at)
    if last > 0 and not holds_at(last):  # step 0 is known to hold
        last = last_step(0, last, holds_at)
    elif last < _MOST and holds_at(last + 1):
        last = last_step(*_doubled(last + 1, holds_at), holds_at)
    return factor(last), factor(last + 1) if last < _MOST else None


def last_step(low: int, high: int, holds: Callable[[int], bool]) -> int:
    """The last step that holds, of one that does and a higher one that does not."""
    return low + bisect_left(range(low + 1, high), True, key=lambda step: not holds(step))


def _doubled(low: int, holds: Callable[[int], bool]) -> tuple[int, int]:
    """A step that holds and a higher one that does not, from a first one that does, by powers of two."""
    high = (low // _OCTAVE + 1) * _OCTAVE
    while high <= _MOST and holds(high):
        low, high = high, high + _OCTAVE
    return (low, high) if low < _MOST else (_MOST, _MOST + 1)


def largest_share(
    attempt: Callable[[float], T | None], steps: int = 20, finer: int = 5, whole: float = 1.0
) -> tuple[float, T] | None:
    """The largest share k / steps below the whole at which an attempt succeeds, by bisection, with its result.

    Success is taken to be monotone: where it is not, the answer is a share at which it succeeds, with a failure one
    step above. One step is tried first: there a success is had soonest, and if there is none, larger shares would fail
    after a long time each. The step is divided once more then; None when the attempt fails even so. Shares are told
    apart by at least 2 steps, the last of them divided in `finer`, 1 for not at all.
    """
    low, high = 1, steps
    found = attempt(whole / steps)
    if found is None:
        return largest_share(attempt, finer, 1, whole / steps) if finer > 1 else None
    best = whole / steps, found
    while high - low > 1:
        middle = (low + high) // 2
        found = attempt(middle * whole / steps)
        if found is None:
            high = middle
        else:
            low, best = middle, (middle * whole / steps, found)
    return best
