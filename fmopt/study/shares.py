"""How often runs come out well, and how often their trials succeed: value by value of an axis, or bin by bin."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fmopt.study.statistics import Estimate, share
from fmopt.study.table import Varied
from fmopt.study.view import View
from fmopt.values import Array

_VALUES = 16  # of an axis, above which neighbours are put together
_BINS = 8


@dataclass(frozen=True)
class Bin:
    """What came well of how many, with an axis between two values.

    Args:
        low: least value of the axis, in the unit that people read.
        high: greatest.
        good: runs that came out well, or trials that succeeded.
        total: all of them.
    """

    low: float
    high: float
    good: int
    total: int

    @property
    def middle(self) -> float:
        """Half way between the bounds."""
        return 0.5 * (self.low + self.high)

    @property
    def share(self) -> Estimate:
        """The share with its 95 % interval."""
        return share(self.good, self.total)


def bins(view: View, axis: Varied) -> list[Bin]:
    """The runs that have answers, by the values of an axis."""
    done = np.flatnonzero(view.done)
    return _bins(view, axis, done, view.good[done].astype(float), np.ones(len(done)))


def trials(view: View, axis: Varied) -> list[Bin]:
    """The trials of all runs that were executed, by the values of an axis."""
    if "trials" not in view.results.columns:
        return []
    good, total = view.column("successes"), view.column("trials")
    known = np.flatnonzero(np.isfinite(total))
    return _bins(view, axis, known, good[known], total[known])


def _bins(view: View, axis: Varied, runs: NDArray[np.intp], good: Array, total: Array) -> list[Bin]:
    """Value by value; where there are many, neighbouring values together, about as many runs in each bin."""
    x = view.axis(axis)[runs]
    places, place, counts = np.unique(x, return_inverse=True, return_counts=True)
    if len(places) <= _VALUES or axis.unit == "word":
        group = place
    else:
        middles = np.cumsum(counts) - 0.5 * counts
        group = np.minimum(middles / len(x) * _BINS, _BINS - 1).astype(int)[place]
    chosen = [group == number for number in np.unique(group)]
    return [
        Bin(float(x[c].min()), float(x[c].max()), round(float(good[c].sum())), round(float(total[c].sum())))
        for c in chosen
    ]
