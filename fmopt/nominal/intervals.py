"""S(t) as intervals: what is stopped when, joined to a piecewise constant function, [LeeHuang1985] section 4.1.2."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from fmopt.values import Value

_AT_GOAL = 1e-11  # of T: what begins this late only the goal touches

Bits = NDArray[np.bool_]


@dataclass(frozen=True)
class FreedomInterval:
    """S on [start, end], s: six values −1, 0, 1, 2; an interval of no length at T holds what only the goal touches."""

    start: float
    end: float
    s: tuple[int, ...]


@dataclass(frozen=True, eq=False)
class Stop(Value):
    """Motions that are stopped from `start` to `end`, s: bits (6, 2), motion along each degree and against it."""

    start: float
    end: float
    bits: Bits


def intervals(stops: Sequence[Stop], duration: float, blur: float) -> tuple[FreedomInterval, ...]:
    """S on the cells between all ends, equal neighbours joined; at T also what touches there only.

    Args:
        stops: what is stopped when.
        duration: T, s.
        blur: s; ends nearer than this cannot be told apart: starts among them move to the first, ends to the last.
    """
    ends = np.unique([0.0, duration, *(end for stop in stops for end in (stop.start, stop.end))])
    group = np.concatenate([[0], np.cumsum(np.diff(ends) > blur)])
    first = {t: float(ends[group == g].min()) for t, g in zip(ends.tolist(), group, strict=True)}
    last = {t: float(ends[group == g].max()) for t, g in zip(ends.tolist(), group, strict=True)}
    at_goal = duration * (1.0 - _AT_GOAL)
    starts = [first[stop.start] if stop.start < at_goal else duration for stop in stops]
    spans = [(start, last[stop.end], stop.bits) for start, stop in zip(starts, stops, strict=True)]
    cuts = np.unique([0.0, duration, *(end for start, stop, _ in spans for end in (start, stop))])
    joined: list[FreedomInterval] = []
    for a, b in [*pairwise(cuts.tolist()), (duration, duration)]:
        t = 0.5 * (a + b)
        bits = np.any([bits for start, stop, bits in spans if start <= t <= stop] or [np.zeros((6, 2), bool)], axis=0)
        s = tuple(2 if plus and minus else int(plus) - int(minus) for plus, minus in bits)
        if joined and joined[-1].s == s:
            joined[-1] = FreedomInterval(joined[-1].start, b, s)
        else:
            joined.append(FreedomInterval(a, b, s))
    return tuple(joined)
