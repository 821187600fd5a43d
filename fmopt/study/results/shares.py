"""What a table of results says in numbers: shares by value of an axis, rank correlations, Sobol indices."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from fmopt.execution.confidence import success_interval
from fmopt.spatial.values import Array, Indices
from fmopt.study.results.table import Varied
from fmopt.study.results.view import View

_NORMAL_95 = 1.959963984540054  # standard deviations either way that hold 95 % of a normal distribution
_VALUES = 16  # of an axis, above which neighbours are put together
_BINS = 8
_DRAWS = 1000  # of the bootstrap: 25 lie outside of an interval on each side


@dataclass(frozen=True)
class Bin:
    """What came well of how many, with an axis between two values in the unit that people read."""

    low: float
    high: float
    good: int
    total: int

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
    names = ("successes", "trials") if "trials" in view.results.columns else ("seated", "draws")
    if names[1] not in view.results.columns:
        return []
    good, total = map(view.column, names)
    known = np.flatnonzero(np.isfinite(total))
    return _bins(view, axis, known, good[known], total[known])


def _bins(view: View, axis: Varied, runs: Indices, good: Array, total: Array) -> list[Bin]:
    """Value by value; where there are many, neighbouring values together, about as many runs in each bin."""
    x = view.axis(axis)[runs]
    places, place, counts = np.unique(x, return_inverse=True, return_counts=True)
    if len(places) <= _VALUES or axis.unit == "word":
        group = place
    else:
        # By where the middle of a value's runs is among all of them, so that runs of one value stay together.
        middles = np.cumsum(counts) - 0.5 * counts
        group = np.minimum(middles / len(x) * _BINS, _BINS - 1).astype(int)[place]
    chosen = [group == number for number in np.unique(group)]
    return [Bin(float(x[c].min()), float(x[c].max()), round(good[c].sum()), round(total[c].sum())) for c in chosen]


@dataclass(frozen=True)
class Estimate:
    """A number with its 95 % interval."""

    value: float
    low: float
    high: float


def share(successes: int, trials: int) -> Estimate:
    """A share with its Clopper–Pearson interval, which holds for few trials and for shares near 0 and 1, too.

    Raises:
        ValueError: there are no trials, or more successes than trials.
    """
    if not 0 <= successes <= trials or trials == 0:
        raise ValueError(f"{successes} of {trials} is no share")
    return Estimate(successes / trials, *success_interval(successes, trials))


def difference(seats: str, others: str) -> Estimate:
    """By how much more of the same draws seat in one run than in another, each digit 1 where one does.

    The 95 % interval takes what is gained from what is lost, each with a Clopper–Pearson interval of 97.5 %.
    """
    pairs = [*zip(seats, others, strict=True)]
    gained, lost = pairs.count(("1", "0")), pairs.count(("0", "1"))
    more, less = (success_interval(count, len(pairs), 0.975) for count in (gained, lost))
    return Estimate((gained - lost) / len(pairs), more[0] - less[1], more[1] - less[0])


def rank_correlation(x: Array, y: Array) -> Estimate | None:
    """Spearman's ρ of two samples (n,), interval after Bonett and Wright (2000); None when it is not defined.

    The interval of a perfect order reaches as far as that of the order with two neighbours exchanged.
    """
    from scipy.stats import spearmanr

    if len(x) < 4 or np.ptp(x) == 0.0 or np.ptp(y) == 0.0:
        return None
    rho = float(spearmanr(x, y).statistic)
    n = float(len(x))
    # Two neighbours exchanged make Σd² = 2 in ρ = 1 − 6 Σd²/(n (n² − 1)); at ρ = 1 the arctanh is infinite.
    near = math.copysign(min(abs(rho), 1.0 - 12.0 / (n * (n**2 - 1.0))), rho)
    z, spread = math.atanh(near), _NORMAL_95 * math.sqrt((1.0 + 0.5 * near**2) / (n - 3.0))
    # A perfect order is outside of the interval about its neighbour, which is widened to hold it.
    return Estimate(rho, min(math.tanh(z - spread), rho), max(math.tanh(z + spread), rho))


@dataclass(frozen=True)
class SobolIndex:
    """Share of the variance that an axis explains alone, and with all others together."""

    first: Estimate
    total: Estimate


def sobol_indices(values: Array, dimensions: int) -> list[SobolIndex] | None:
    """Sobol indices from values at the points that `sampling.cube` makes for "saltelli", bootstrap intervals.

    First order S_i = E[f(B)(f(AB_i) − f(A))]/V, total T_i = E[(f(A) − f(AB_i))²]/2V, after Saltelli et al. (2010) and
    Jansen (1999), over the rows whose values are all known. Values (n (d + 2),) are not a number where a run has none.
    There is an index for each axis; None when fewer than eight rows are known, or the values do not vary.
    """
    # A row for each base point: at A, at B, then at A with each column of B, as `cube` puts them.
    rows = values.reshape(dimensions + 2, -1).T
    rows = rows[np.isfinite(rows).all(axis=1)]
    if len(rows) < 8 or not float(np.var(rows[:, :2])) > 0.0:
        return None
    rng = np.random.default_rng(0)  # the same interval for the same results
    draws = [_indices(rows[rng.integers(0, len(rows), len(rows))]) for _ in range(_DRAWS)]
    found = _indices(rows), *np.nanquantile(draws, [0.025, 0.975], axis=0)  # no number where a draw does not vary
    bounded = np.stack(found, axis=-1).tolist()
    return [SobolIndex(*(Estimate(*bounded[k][i]) for k in (0, 1))) for i in range(dimensions)]


def _indices(rows: Array) -> Array:
    """First and total indices (2, d) of rows (n, d + 2)."""
    # A constant does not change what is estimated, but how far the estimates scatter.
    centred = rows - rows[:, :2].mean()
    A, B, AB = centred[:, :1], centred[:, 1:2], centred[:, 2:]
    variance = float(np.var(centred[:, :2]))
    if variance == 0.0:
        return np.full((2, AB.shape[1]), np.nan)
    first = np.mean(B * (AB - A), axis=0)
    total = 0.5 * np.mean((A - AB) ** 2, axis=0)
    return np.array([first, total]) / variance
