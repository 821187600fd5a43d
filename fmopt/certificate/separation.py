"""Separating planes of convex pieces, kept over a whole piece of motion with its errors.

Two convex pieces are apart when a face plane of one, or a plane along an edge of each, has them on opposite sides.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from fmopt.certificate.assembly import Assembly
from fmopt.certificate.counted import Counted, counted_rows
from fmopt.certificate.pair import Pair, Witness, pairs, touching
from fmopt.certificate.rows import Extent, Forms, Rows, remainders, stacked
from fmopt.se3 import Pose
from fmopt.uncertainty.error_set import ErrorSet, Support
from fmopt.values import Array

__all__ = [
    "Ends",
    "Pair",
    "RowBounds",
    "Separation",
    "Witness",
    "best_separation",
    "lower_bounds",
    "pairs",
    "row_bounds",
    "separation",
    "touching",
]

_MEMORY = 2048


@dataclass(frozen=True, eq=False)
class Ends:
    """A piece of motion: nominal poses and error sets at both ends, its extent, and the thickness of its contacts.

    `slack` (6, h) holds the columns T^Sᵢtᵢ: how far the true contact surfaces may push the error at the start, beyond
    the start set's core; `core` (k, 6) its generators, those of the whole start set by default.
    """

    start: Pose
    goal: Pose
    start_set: ErrorSet
    goal_set: ErrorSet
    extent: Extent
    slack: Array
    core: Array | None = None

    @cached_property
    def supports(self) -> tuple[Support, Support]:
        """How far errors reach along rows at both ends."""
        start, goal = self.start_set, self.goal_set
        return Support.of(start.generators if self.core is None else self.core, start, self.slack), goal.bound


@dataclass(frozen=True, eq=False)
class Separation:
    """A witness with its certified margin and its nominal clearance (m) over a piece of motion."""

    witness: Witness
    margin: float
    clearance: float


@dataclass(frozen=True, eq=False)
class RowBounds:
    """The counted rows of a witness at both ends, their certified lower bounds (k,), and the divisor of the margin."""

    start: Rows
    goal: Rows
    lower: Array
    scale: float


def lower_bounds(start: Rows, goal: Rows, ends: Ends) -> Array:
    """Certified lower bound (k,) of rows over a piece of motion: worst end, less errors and remainder."""
    before, after = ends.supports
    least = np.minimum(start.f - before(start.N), goal.f - after(goal.N))
    return np.asarray(least - remainders(start, goal, ends.extent))


def row_bounds(assembly: Assembly, pair: Pair, witness: Witness, ends: Ends) -> RowBounds:
    """All rows of one witness over a piece of motion, for placements that want to move them."""
    counted = counted_rows(assembly, pair, witness)
    start, goal = counted.forms.over(ends.start, ends.goal)
    lower = lower_bounds(start, goal, ends)
    if counted.onto:
        which = counted.counts(lower)
        start, goal, lower = start.kept(which), goal.kept(which), lower[which]
    return RowBounds(start, goal, lower, counted.scale(ends.start, ends.goal, ends.extent))


def separation(assembly: Assembly, pair: Pair, witness: Witness, ends: Ends) -> Separation:
    """Margin and clearance of one witness over a piece of motion."""
    rows = row_bounds(assembly, pair, witness, ends)
    clearance = float(np.minimum(rows.start.f, rows.goal.f).min()) / rows.scale
    return Separation(witness, float(rows.lower.min()) / rows.scale, clearance)


def best_separation(
    assembly: Assembly, pair: Pair, witnesses: tuple[Witness, ...], ends: Ends, grazing: float
) -> Separation | None:
    """The separation with the largest margin among witnesses whose planes hold nominally, None without.

    Args:
        assembly: the two parts.
        pair: the two pieces.
        witnesses: candidates.
        ends: the piece of motion.
        grazing: how far nominal distances may be below zero, m.
    """
    table = _table(assembly, pair, witnesses)
    start, goal = table.forms.over(ends.start, ends.goal)
    lower, nominal = lower_bounds(start, goal, ends), np.minimum(start.f, goal.f)
    margins = np.minimum.reduceat(lower, table.begins)
    clearances = np.minimum.reduceat(nominal, table.begins)
    for n, counted in table.special:
        span = slice(table.begins[n], table.begins[n] + len(counted.forms))
        which = counted.counts(lower[span])
        scale = counted.scale(ends.start, ends.goal, ends.extent)
        margins[n], clearances[n] = lower[span][which].min() / scale, nominal[span][which].min() / scale
    best = int(np.argmax(np.where(clearances >= -grazing, margins, -np.inf)))
    if clearances[best] < -grazing:
        return None
    return Separation(table.witnesses[best], float(margins[best]), float(clearances[best]))


@dataclass(frozen=True, eq=False)
class _Table:
    """The counted rows of several witnesses, one after the other; `special` are those along edges."""

    witnesses: tuple[Witness, ...]
    forms: Forms
    begins: np.ndarray[tuple[int], np.dtype[np.intp]]
    special: tuple[tuple[int, Counted], ...]


@lru_cache(maxsize=_MEMORY)
def _table(assembly: Assembly, pair: Pair, witnesses: Sequence[Witness]) -> _Table:
    counted = [(w, counted_rows(assembly, pair, w)) for w in witnesses]
    # A witness whose rows are all settled says nothing.
    counted = [(w, c) for w, c in counted if len(c.forms)]
    begins = np.cumsum([0, *(len(c.forms) for _, c in counted[:-1])])
    special = tuple((n, c) for n, (_, c) in enumerate(counted) if c.edges is not None)
    return _Table(tuple(w for w, _ in counted), stacked(*(c.forms for _, c in counted)), begins, special)
