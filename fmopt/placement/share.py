"""How much of something can be had, when not all of it can."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

T = TypeVar("T")


def largest_share(attempt: Callable[[float], T | None], steps: int = 20) -> tuple[float, T] | None:
    """The largest share k / steps below 1 at which an attempt succeeds, by bisection, with its result.

    Success is taken to be monotone: where it is not, the answer is a share at which it succeeds, with a failure one
    step above. None when the attempts fail down to one step.

    Args:
        attempt: tries a share in (0, 1); None when it fails.
        steps: how finely shares are told apart, at least 2.
    """
    low, high = 0, steps
    best: tuple[float, T] | None = None
    while high - low > 1:
        middle = (low + high) // 2
        found = attempt(middle / steps)
        if found is None:
            high = middle
        else:
            low, best = middle, (middle / steps, found)
    return best
