"""How much of something can be had, when not all of it can."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

T = TypeVar("T")


ATTEMPTS = 7  # at most, with the steps that are given


def largest_share(
    attempt: Callable[[float], T | None], steps: int = 20, finer: int = 5, whole: float = 1.0
) -> tuple[float, T] | None:
    """The largest share k / steps below the whole at which an attempt succeeds, by bisection, with its result.

    Success is taken to be monotone: where it is not, the answer is a share at which it succeeds, with a failure one
    step above. Where attempts fail down to one step, the step is divided once more; None when they fail even so.

    Args:
        attempt: tries a share between 0 and the whole; None when it fails.
        steps: how finely shares are told apart, at least 2.
        finer: in how many the last step is divided; 1 for not at all.
        whole: the share of which steps are taken, at which it fails.
    """
    low, high = 0, steps
    best: tuple[float, T] | None = None
    while high - low > 1:
        middle = (low + high) // 2
        found = attempt(middle * whole / steps)
        if found is None:
            high = middle
        else:
            low, best = middle, (middle * whole / steps, found)
    if best is None and finer > 1:
        return largest_share(attempt, finer, 1, whole / steps)
    return best
