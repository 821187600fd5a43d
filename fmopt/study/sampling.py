"""Points in the unit cube, and what a quantile of an axis is: the sampling of a study."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from fmopt.spatial.values import Array

Method = Literal["grid", "list", "random", "latin-hypercube", "sobol", "saltelli"]
CUBES = ("random", "latin-hypercube", "sobol", "saltelli")
_EDGE = 1e-12  # quantiles of a normal distribution stay this far from 0 and 1


@dataclass(frozen=True)
class Uniform:
    """Evenly between two bounds, in the value or in its logarithm."""

    low: float
    high: float
    log: bool = False

    def at(self, quantile: float) -> float:
        """The value of a quantile in [0, 1]."""
        if self.log:
            return float(math.exp((1.0 - quantile) * math.log(self.low) + quantile * math.log(self.high)))
        # Both ends come out exactly, which low + quantile (high − low) does not promise.
        return (1.0 - quantile) * self.low + quantile * self.high


@dataclass(frozen=True)
class Normal:
    """A normal distribution, cut off outside two bounds."""

    mean: float
    deviation: float
    low: float = -math.inf
    high: float = math.inf

    def at(self, quantile: float) -> float:
        """The value of a quantile in [0, 1]."""
        from scipy.special import ndtr, ndtri

        below, above = (float(ndtr((bound - self.mean) / self.deviation)) for bound in (self.low, self.high))
        # The inverse is infinite at 0 and 1.
        inside = min(max(below + quantile * (above - below), _EDGE), 1.0 - _EDGE)
        value = self.mean + self.deviation * float(ndtri(inside))
        # Rounding may lead past a bound, and `_EDGE` does where a bound is far out in the tail.
        return min(max(value, self.low), self.high)


def stepped(uniform: Uniform, steps: int) -> list[float]:
    """A number of even steps from the lower bound to the upper one, the ends exactly; one is the lower bound alone."""
    if steps == 1:
        return [uniform.low]
    return [uniform.low, *(rounded(uniform.at(i / (steps - 1))) for i in range(1, steps - 1)), uniform.high]


def rounded(value: float) -> float:
    """To twelve digits: 0.0003 rather than 0.00030000000000000003."""
    return float(f"{value:.12g}")


def cube(method: Method, dimensions: int, runs: int, seed: int) -> Array:
    """Points (n, d) in the unit cube, the same for the same seed.

    Args:
        method: "saltelli" makes runs · (d + 2): two independent samples A and B, then A with each column from B in
            turn, after Saltelli et al. (2010), which Sobol indices are computed from.
    """
    from scipy.stats import qmc

    rng = np.random.default_rng(seed)
    match method:
        case "random":
            return rng.random((runs, dimensions))
        case "latin-hypercube":
            return np.asarray(qmc.LatinHypercube(dimensions, rng=rng).random(runs), dtype=np.float64)
        case "sobol":
            # The logarithm of a power of two, as the study's check has let nothing else pass.
            return np.asarray(qmc.Sobol(dimensions, rng=rng).random_base2(runs.bit_length() - 1), dtype=np.float64)
        case "saltelli":
            # One sequence over 2d axes fills A and B evenly together; two sequences over d axes need not.
            both = np.asarray(qmc.Sobol(2 * dimensions, rng=rng).random_base2(runs.bit_length() - 1), dtype=np.float64)
            A, B = both[:, :dimensions], both[:, dimensions:]
            return np.concatenate([A, B, *(np.where(axis, B, A) for axis in np.eye(dimensions, dtype=bool))])
        case "grid" | "list":
            raise ValueError(f"{method} has no points in a cube")


def grid(lengths: Sequence[int]) -> Array:
    """All combinations (n, d) of indices, the last axis fastest."""
    return np.indices(tuple(lengths)).reshape(len(lengths), -1).T.astype(np.float64)
