"""The worst: a cross-entropy search for trials of presses that fail, and the region of the unknowns that holds them.

A normal distribution, truncated to the intervals of the unknowns, is fitted to the trials that come nearest to failing,
batch by batch [RubinsteinKroese2004]. A quarter of each batch stays uniform. It is a search: nothing is bounded.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import truncnorm

from fmopt.errors import PlanFormatError
from fmopt.execution.engines.catalogue import ENGINES
from fmopt.execution.engines.engine import Bodies
from fmopt.execution.execute import TrialSettings
from fmopt.execution.press_controller import MAX_SECONDS
from fmopt.execution.press_trials import carried, count_presses, drawn_shares, errors_at, stated
from fmopt.execution.trials import Trials, grown
from fmopt.plan import Plan
from fmopt.plan.evidence import TrialOutcome
from fmopt.plan.press import Conditions, PressPlan
from fmopt.runtime import output
from fmopt.runtime.process import cores
from fmopt.spatial.values import Array, Bits

UNKNOWNS = (
    *(f"start {axis}" for axis in ("x", "y", "z", "about x", "about y", "about z")),
    *("friction", "stiffness", "admittance"),
    *(f"{name} offset {axis}" for name in ("force", "torque") for axis in "xyz"),
)
BATCH = 32  # trials between two fits
_UNIFORM = 0.25  # of a batch after the first one
_ELITE = 0.125  # of all trials so far, that the distribution is fitted to; all that fail are, if these are more
_MIN_ELITE = 8
_SMOOTHING = 0.7  # weight of a fit against the one before
_MIN_DEVIATION = 0.2  # of half of an interval
_MIN_FAILED = 8  # trials, below which there is no region
_HELD = (0.1, 0.9)  # quantiles of the failing trials, between which the region lies
_MAX_NAMED = 3  # unknowns that the region is of
_NARROW = 0.65  # of what uniform trials take between these quantiles, that such an unknown takes at most
_SEARCH = 0x776F7273  # sets the streams of the search apart from those of evidence and choice


@dataclass(frozen=True, eq=False)
class ShareRegion:
    """Shares of the intervals of all unknowns, from `low` (n,) to `high` (n,); -1 to 1 is the whole interval."""

    low: Array
    high: Array

    @property
    def named(self) -> list[int]:
        """The unknowns that it bounds, the narrowest first."""
        return [int(k) for k in np.argsort(self.high - self.low, kind="stable") if self.high[k] - self.low[k] < 2.0]

    @property
    def share(self) -> float:
        """What it takes of all that is drawn."""
        return float(np.prod(0.5 * (self.high - self.low)))

    def placed(self, shares: Array) -> Array:
        """Shares (m, n) of the whole intervals, taken to as many of the region."""
        return 0.5 * (self.low + self.high) + 0.5 * (self.high - self.low) * shares


@dataclass(frozen=True, eq=False)
class TrialSearch:
    """Trials of a search: `shares` (m, n) of the intervals, which of them have `failed` (m,), and their `kinds` (m,).

    A trial is "uniform", "fitted" (drawn from the distribution), or uniform in the "region" that those before came to,
    which is None where too few fail or no unknown is narrow.
    """

    shares: Array
    failed: Bits
    kinds: NDArray[np.str_]
    region: ShareRegion | None

    def failures(self, kind: str) -> tuple[int, int]:
        """How many trials of a kind fail, and how many there are."""
        return int(self.failed[self.kinds == kind].sum()), int((self.kinds == kind).sum())


def cross_entropy(score: Callable[[Array, range], Array], free: Bits, budget: int, seed: int) -> TrialSearch:
    """Search the unknowns that are free (n,) for trials that fail; the others stay in the middle of their intervals.

    Args:
        score: of shares (m, n) of the intervals, from -1 to 1, by the numbers of the trials: 1 where one fails, else
            the less, the further it is from that.
        budget: trials in all. The last batch is drawn from the region that those before it come to.
    """
    random, n = np.random.default_rng([seed, _SEARCH]), len(free)
    shares, scores, kinds, fits = np.zeros((0, n)), np.zeros(0), np.zeros(0, "U8"), list[tuple[int, Any]]()
    mean, deviation, region = np.zeros(n), np.full(n, 3.0**-0.5), None
    while len(shares) < budget:
        numbers = range(len(shares), min(len(shares) + BATCH, budget))
        count = len(numbers)
        new, kind = random.uniform(-1.0, 1.0, (count, n)), np.full(count, "uniform")
        if numbers.stop == budget and (region := _region(shares, scores >= 1.0, free, fits)):
            new, kind[:] = region.placed(new), "region"
        elif numbers.start:
            fitted = count - round(_UNIFORM * count)
            fits.append((fitted, truncnorm((-1.0 - mean) / deviation, (1.0 - mean) / deviation, mean, deviation)))
            new[-fitted:], kind[-fitted:] = fits[-1][1].rvs((fitted, n), random), "fitted"
        new = np.where(free, new, 0.0)
        shares, kinds = np.concatenate([shares, new]), np.concatenate([kinds, kind])
        scores = np.concatenate([scores, score(new, numbers)])
        fewest = min(max(_MIN_ELITE, round(_ELITE * len(scores))), len(scores))
        elite = shares[scores >= np.sort(scores)[-fewest]]
        mean = mean + _SMOOTHING * (elite.mean(axis=0) - mean)
        deviation = deviation + _SMOOTHING * (np.maximum(elite.std(axis=0), _MIN_DEVIATION) - deviation)
    return TrialSearch(shares, scores >= 1.0, kinds, region)


def _region(shares: Array, failed: Bits, free: Bits, fits: Sequence[tuple[int, Any]]) -> ShareRegion | None:
    """The unknowns that failing trials leave narrow; a trial counts the less, the more are drawn beside it."""
    if failed.sum() < _MIN_FAILED:
        return None
    density = 0.5 * (len(shares) - sum(count for count, _ in fits)) * np.ones_like(shares[failed])
    density += sum(count * fit.pdf(shares[failed]) for count, fit in fits)
    ends = np.quantile(shares[failed], _HELD, axis=0, weights=1.0 / density, method="inverted_cdf")
    widths = np.where(free, np.ptp(ends, axis=0), 2.0)
    wide = np.argsort(widths, kind="stable")[_MAX_NAMED:]
    ends[:, (widths > _NARROW * 2.0 * (_HELD[1] - _HELD[0])) | np.isin(range(len(free)), wide)] = [[-1.0], [1.0]]
    return ShareRegion(*ends) if (ends != [[-1.0], [1.0]]).any() else None


def severity(one: TrialOutcome, presses: PressPlan) -> float:
    """1 for a trial that fails; else the mean of the shares of attempts, of the limit of force and of time it takes.

    Where a part that seats rests in its play tells nothing of how near it was to failing: it lies against a wall.
    """
    if not one.seated:
        return 1.0
    force = one.peak_force / presses.robot.limits[0]
    return (one.attempt / len(presses.attempts) + force + one.seconds / MAX_SECONDS) / 3.0


def values_at(conditions: Conditions, shares: Array) -> Array:
    """The unknowns (m, 15) of trials in SI units, friction and factors as they are."""
    found = errors_at(conditions, shares, np.zeros((len(shares), 6, 0)))
    return np.column_stack([found.start, found.friction, found.stiffness, found.admittance, found.offset])


def worst(plan: Plan, trials: Trials, settled: TrialSettings, caution: str = "") -> dict[str, Any]:
    """Search a plan of presses for failures with as many trials as there are inside; writes and gives the summary.

    Drift and noise are drawn anew for each trial.

    Raises:
        PlanFormatError: the plan has guarded moves, or does not say what its errors are.
        ResourceError: the extra is missing, or `worst.json` cannot be written.
    """
    ENGINES[trials.engine].library()
    if plan.press_plan is None:
        message = "a plan of guarded moves states no intervals of friction, stiffness and offset to search"
        raise PlanFormatError(message, "leave out --worst, and sample its errors by --trials and --beyond")
    presses, _, conditions = stated(plan, trials)
    bodies, count, outcomes = Bodies.of(grown(plan, trials.growth)), count_presses(presses), list[TrialOutcome]()
    asked, threads = replace(trials, seed=trials.seed ^ _SEARCH), settled.workers or cores()
    output.prepare(settled.folder)

    def score(shares: Array, numbers: range) -> Array:
        errors = errors_at(conditions, shares, drawn_shares(count, asked.seed, numbers)[1])
        new = carried(presses, bodies, asked, errors, numbers, threads)
        outcomes.extend(new)
        settled.advance(len(new))
        return np.array([severity(one, presses) for one in new])

    ends = values_at(conditions, np.array([[-1.0], [1.0]]) * np.ones(len(UNKNOWNS)))
    search = cross_entropy(score, np.ptp(ends, axis=0) > 0.0, trials.inside, trials.seed)
    warned = {"caution": caution} if caution else {}
    found = {"plan": plan.sha256, "verdict": plan.verdict, **warned, "seed": trials.seed}
    found |= _summary(search, outcomes, conditions)
    output.save((json.dumps(found, indent=1) + "\n").encode(), settled.folder / "worst.json")
    return found


def _summary(search: TrialSearch, outcomes: Sequence[TrialOutcome], conditions: Conditions) -> dict[str, Any]:
    """Counts, the region, and each trial that fails."""
    failed, region = np.flatnonzero(search.failed).tolist(), search.region
    values, rows = values_at(conditions, search.shares), list[dict[str, Any]]()
    if region is not None:
        for k in region.named:
            ends = np.zeros((6, len(UNKNOWNS)))
            ends[:, k] = -1.0, 1.0, region.low[k], region.high[k], *_without_failure(search, k)
            drawn, held, safe = values_at(conditions, ends)[:, k].reshape(3, 2).tolist()
            rows.append({"name": UNKNOWNS[k], "drawn": drawn, "region": held, "without_failure": safe})
    return {
        "trials": len(outcomes),
        "failures": len(failed),
        "uniform": search.failures("uniform"),
        "in_region": search.failures("region"),
        "region_share": region.share if region else 0.0,
        "unknowns": rows,
        "kinds": dict(Counter(f"{outcomes[k].press}: {outcomes[k].kind}" for k in failed).most_common()),
        "failed": [
            {"trial": k, **dict(zip(UNKNOWNS, values[k].tolist(), strict=True)), "reasons": outcomes[k].reasons}
            for k in failed
        ],
    }


def _without_failure(search: TrialSearch, k: int) -> tuple[float, float]:
    """The longest interval of an unknown, in shares, in which no trial of the search fails.

    Start errors and offsets are narrowed from both sides, friction and factors from one.
    """
    values = search.shares[search.failed, k]
    if " " in UNKNOWNS[k]:
        return -float(np.abs(values).min()), float(np.abs(values).min())
    low, high = float(values.min()), float(values.max())
    return (-1.0, low) if low + high >= 0.0 else (high, 1.0)
