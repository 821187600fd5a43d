"""Separating planes of convex pieces, kept over a whole piece of motion with its errors.

Two convex pieces are apart when a face plane of one, or a plane along an edge of each, has them on opposite sides.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from fmopt.certificate.assembly import Assembly
from fmopt.certificate.counted import Counted, counted_rows
from fmopt.certificate.curvature import Extent, remainders
from fmopt.certificate.pair import Pair, Witness, pairs, touching
from fmopt.certificate.rows import Forms, Rows, stacked
from fmopt.se3 import Pose
from fmopt.uncertainty.error_set import ErrorSet, Support
from fmopt.values import Array

__all__ = [
    "Candidates",
    "Ends",
    "Pair",
    "RowBounds",
    "Separation",
    "Witness",
    "lower_bounds",
    "pairs",
    "row_bounds",
    "separation",
    "touching",
]


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

    @cached_property
    def both(self) -> Support:
        """Both supports as one, the start's first."""
        return Support.beside(*self.supports)


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
    least = (np.array([start.f, goal.f]) - ends.both(np.array([start.N, goal.N]))).min(axis=0)
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


@dataclass(frozen=True, eq=False)
class Candidates:
    """The counted rows of several witnesses for each of several pairs, one after the other.

    Args:
        witnesses: of all pairs.
        forms: the rows.
        begins: where those of each witness begin.
        ends: how many witnesses there are up to the end of each pair.
        special: places of witnesses along edges, with what decides which of their rows count.
    """

    witnesses: tuple[Witness, ...]
    forms: Forms
    begins: NDArray[np.intp]
    ends: tuple[int, ...]
    special: tuple[tuple[int, Counted], ...]

    @staticmethod
    def of(assembly: Assembly, asked: Iterable[tuple[Pair, Sequence[Witness]]]) -> Candidates:
        """The rows of witnesses that may keep pairs apart; one whose rows are all settled says nothing."""
        found: list[tuple[Witness, Counted]] = []
        ends = []
        for pair, witnesses in asked:
            counted = ((witness, counted_rows(assembly, pair, witness)) for witness in witnesses)
            found += [(witness, rows) for witness, rows in counted if len(rows.forms)]
            ends.append(len(found))
        begins = np.cumsum([0, *(len(rows.forms) for _, rows in found[:-1])])
        special = tuple((n, rows) for n, (_, rows) in enumerate(found) if rows.edges is not None)
        forms = stacked(*(rows.forms for _, rows in found))
        return Candidates(tuple(witness for witness, _ in found), forms, begins, tuple(ends), special)

    def best(self, ends: Ends, grazing: float) -> list[Separation | None]:
        """For each pair the separation with the largest margin among witnesses whose planes hold nominally.

        Args:
            ends: the piece of motion.
            grazing: how far nominal distances may be below zero, m.

        Returns:
            one for each pair, None where no witness holds.
        """
        start, goal = self.forms.over(ends.start, ends.goal)
        lower, nominal = lower_bounds(start, goal, ends), np.minimum(start.f, goal.f)
        margins = np.minimum.reduceat(lower, self.begins)
        clearances = np.minimum.reduceat(nominal, self.begins)
        for n, counted in self.special:
            span = slice(self.begins[n], self.begins[n] + len(counted.forms))
            which = counted.counts(lower[span])
            scale = counted.scale(ends.start, ends.goal, ends.extent)
            margins[n], clearances[n] = lower[span][which].min() / scale, nominal[span][which].min() / scale
        holding = np.where(clearances >= -grazing, margins, -np.inf)
        found: list[Separation | None] = []
        for first, last in pairwise((0, *self.ends)):
            best = first + int(np.argmax(holding[first:last]))
            holds = clearances[best] >= -grazing
            kept = Separation(self.witnesses[best], float(margins[best]), float(clearances[best]))
            found.append(kept if holds else None)
        return found
