"""S(t) as intervals: what is stopped when, joined to a piecewise constant function, [LeeHuang1985] section 4.1.2."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from fmopt.values import Array, Value

_AT_GOAL = 1e-11  # of T: what begins this late only the goal touches

Bits = NDArray[np.bool_]


@dataclass(frozen=True)
class FreedomInterval:
    """S on [start, end], s: six values −1, 0, 1, 2; an interval of no length at T holds what only the goal touches."""

    start: float
    end: float
    s: tuple[int, ...]


@dataclass(frozen=True, eq=False)
class Stops(Value):
    """Motions that are stopped for stretches of time, n of them.

    Args:
        start, end: (n,), s.
        bits: (n, 6, 2), motion along each degree and against it.
    """

    start: Array
    end: Array
    bits: Bits


def together(parts: Sequence[Stops]) -> Stops:
    """All that several parts stop."""
    return Stops(
        np.concatenate([np.zeros(0), *(part.start for part in parts)]),
        np.concatenate([np.zeros(0), *(part.end for part in parts)]),
        np.concatenate([np.zeros((0, 6, 2), dtype=bool), *(part.bits for part in parts)]),
    )


def intervals(stops: Stops, duration: float, blur: float) -> tuple[FreedomInterval, ...]:
    """S on the cells between all ends, equal neighbours joined; at T also what touches there only.

    Args:
        stops: what is stopped when.
        duration: T, s.
        blur: s; ends nearer than this cannot be told apart: starts among them move to the first, ends to the last.
    """
    ends = np.unique(np.concatenate([[0.0, duration], stops.start, stops.end]))
    opens = np.concatenate([[True], np.diff(ends) > blur])
    group = np.cumsum(opens) - 1
    first, last = ends[opens], ends[np.append(opens[1:], True)]
    late = stops.start >= duration * (1.0 - _AT_GOAL)
    start = np.where(late, duration, first[group[np.searchsorted(ends, stops.start)]])
    end = last[group[np.searchsorted(ends, stops.end)]]
    cuts = np.unique(np.concatenate([[0.0, duration], start, end]))
    cuts = np.append(cuts, duration)
    t = 0.5 * (cuts[:-1] + cuts[1:])
    on = (start[:, None] <= t) & (t <= end[:, None])
    plus, minus = np.moveaxis((on.T.astype(int) @ stops.bits.reshape(-1, 12)).reshape(-1, 6, 2) > 0, 2, 0)
    values = np.where(plus & minus, 2, plus.astype(int) - minus)
    begins = np.flatnonzero(np.concatenate([[True], np.any(values[1:] != values[:-1], axis=1)]))
    edges = np.append(cuts[begins], duration).tolist()
    return tuple(
        FreedomInterval(a, b, tuple(values[k].tolist())) for k, (a, b) in zip(begins, pairwise(edges), strict=True)
    )
