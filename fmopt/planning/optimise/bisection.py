"""The largest factor of all start errors that a motion stands, from as few certifications of it as that takes.

Factors lie on a grid: between powers of two in steps of a 64th of the lower one, in 4096ths below 1/64. Where a motion
stands a factor if and only if it stands all smaller ones, which of them are tried makes no difference to what is found.

How much of something can be had, when not all of it can.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

_OCTAVE = 64  # steps from one power of two to the next
_MOST = 6 * _OCTAVE  # up to a factor of 64
_LEAST = -7 * _OCTAVE  # nothing at all
_PATIENCE = 3  # guesses in a row that leave more than half of what there was

T = TypeVar("T")

ATTEMPTS = 7  # at most, with the steps that are given


@dataclass(frozen=True)
class Trial:
    """The margins, m, of a motion's moves under a factor, up to the first without one, and whether it holds for all."""

    margins: tuple[float, ...]
    holds: bool


def factor(step: int) -> float:
    """The factor of a step of the grid; step 0 is 1."""
    if step < _LEAST + _OCTAVE:
        return (step - _LEAST) / _OCTAVE**2
    octave, rest = divmod(step, _OCTAVE)
    return math.ldexp(1.0 + rest / _OCTAVE, octave)


def largest(tried: Callable[[float], Trial], likely: Callable[[float], bool]) -> tuple[float, float | None]:
    """The largest factor that holds and the next one on the grid, which does not; None in its place past 64.

    The factor is 0 where the least of the grid does not hold. `likely` takes less to say whether a factor holds, and
    tells where to look first, no more.
    """
    found = _Tried(tried, {})
    if not found.holds(0):
        low, high = found.between(_LEAST, 0)
        return factor(low), factor(high)
    low, high = _doubled(0, lambda step: likely(factor(step)))
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if likely(factor(middle)) else (low, middle)
    if low > 0 and not found.holds(low):  # step 0 is known to hold
        low, high = found.between(0, low)
    elif high <= _MOST and found.holds(high):
        low, high = found.between(*_doubled(high, found.holds))
    return factor(low), factor(high) if high <= _MOST else None


def _doubled(low: int, holds: Callable[[int], bool]) -> tuple[int, int]:
    """A step that holds and a higher one that does not, from a first one that does, by powers of two."""
    high = (low // _OCTAVE + 1) * _OCTAVE
    while high <= _MOST and holds(high):
        low, high = high, high + _OCTAVE
    return (low, high) if low < _MOST else (_MOST, _MOST + 1)


@dataclass(frozen=True, eq=False)
class _Tried:
    """The steps tried so far."""

    certify: Callable[[float], Trial]
    trials: dict[int, Trial]

    def holds(self, step: int) -> bool:
        """Whether the factor of a step holds."""
        if step not in self.trials:
            self.trials[step] = self.certify(factor(step))
        return self.trials[step].holds

    def between(self, low: int, high: int) -> tuple[int, int]:
        """Two steps next to each other, between one that holds and one that does not, of which the same is true."""
        slow, width = 0, high - low
        while high - low > 1:
            step = (low + high) // 2 if slow == _PATIENCE else self._guess(low, high)
            low, high = (step, high) if self.holds(step) else (low, step)
            slow, width = (slow + 1, width) if 2 * (high - low) > width and slow < _PATIENCE else (0, high - low)
        return low, high

    def _guess(self, low: int, high: int) -> int:
        """The last step that holds, if the margin that is gone at the higher one falls evenly; else the middle."""
        middle, margins = (low + high) // 2, self.trials[high].margins
        move = len(margins) - 1
        others = [step for step, trial in self.trials.items() if step != high and len(trial.margins) > move]
        if not others or not margins or margins[move] > 0.0:
            return middle
        at = factor(high)
        near = min(others, key=lambda step: abs(factor(step) - at))
        slope = (self.trials[near].margins[move] - margins[move]) / (factor(near) - at)
        if slope >= 0.0:  # of margins that rise with errors no end can be foreseen
            return middle
        there = at - margins[move] / slope
        guesses = (step for step in range(high - 1, low, -1) if factor(step) <= there)
        return next(guesses, low + 1)


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
