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
from fmopt.certificate.rows import Forms, Mask, Rows, stacked
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
class Course:
    """Several pieces of motion (n), of which the same is asked: what `Ends` has of one, at once.

    Args:
        listed: the pieces.
        p: nominal positions (2, n, 3) at both ends of all, m.
        R: nominal rotations (2, n, 3, 3).
        both: supports at both ends of all, columns (2, n, 6, k).
        extent: how far they reach, with twists and half-widths (n, 1, 6).
    """

    listed: tuple[Ends, ...]
    p: Array
    R: Array
    both: Support
    extent: Extent

    @staticmethod
    def of(listed: Sequence[Ends]) -> Course:
        """Pieces of motion together."""
        at, to = zip(*(ends.supports for ends in listed), strict=True)
        support = Support.beside(*at, *to)
        poses = [*(ends.start for ends in listed), *(ends.goal for ends in listed)]
        p, R = np.array([pose.p for pose in poses]), np.array([pose.R for pose in poses])
        columns = support.columns.reshape(2, len(listed), *support.columns.shape[1:])
        extent = Extent.beside([ends.extent for ends in listed])
        both = Support(columns, support.cuts)
        return Course(tuple(listed), p.reshape(2, -1, 3), R.reshape(2, -1, 3, 3), both, extent)

    def over(self, forms: Forms) -> tuple[Rows, Rows]:
        """Rows (n, k) at both ends."""
        return forms.ends(self.p, self.R)


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


def lower_bounds(start: Rows, goal: Rows, ends: Ends | Course) -> Array:
    """Certified lower bound (k,) of rows over a piece of motion, or (n, k): worst end, less errors and remainder."""
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
        places: which witnesses each pair has (pairs, w), the last repeated where others have more.
        special: places of witnesses along edges, with what decides which of their rows count.
    """

    witnesses: tuple[Witness, ...]
    forms: Forms
    begins: NDArray[np.intp]
    places: NDArray[np.intp]
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
        spans = [range(first, last) for first, last in pairwise((0, *ends))]
        most = max(len(span) for span in spans)
        places = np.array([[*span, *[span[-1]] * (most - len(span))] for span in spans], dtype=np.intp)
        special = tuple((n, rows) for n, (_, rows) in enumerate(found) if rows.edges is not None)
        forms = stacked(*(rows.forms for _, rows in found))
        return Candidates(tuple(witness for witness, _ in found), forms, begins, places, special)

    def best(self, course: Course, grazing: float) -> list[list[Separation | None]]:
        """For each pair the separation with the largest margin among witnesses whose planes hold nominally.

        Only of these rows are there bounds with errors; what counts of witnesses along edges is known from bounds only.

        Args:
            course: pieces of motion (n).
            grazing: how far nominal distances may be below zero, m.

        Returns:
            for each piece of motion one for each pair, None where no witness holds.
        """
        start, goal = course.over(self.forms)
        nominal = np.minimum(start.f, goal.f)
        clearances = np.minimum.reduceat(nominal, self.begins, axis=1)
        asked: Mask = np.any(clearances >= -grazing, axis=0)
        asked[[n for n, _ in self.special]] = True
        rows = np.repeat(asked, np.diff(self.begins, append=len(self.forms)))
        lower = np.full(nominal.shape, -np.inf)
        lower[:, rows] = lower_bounds(start.kept(rows), goal.kept(rows), course)
        margins = np.minimum.reduceat(lower, self.begins, axis=1)
        for n, counted in self.special:
            span = slice(self.begins[n], self.begins[n] + len(counted.forms))
            for k, ends in enumerate(course.listed):
                which = counted.counts(lower[k, span])
                scale = counted.scale(ends.start, ends.goal, ends.extent)
                margins[k, n], clearances[k, n] = (of[k, span][which].min() / scale for of in (lower, nominal))
        holding = np.where(clearances >= -grazing, margins, -np.inf)
        best = np.take_along_axis(self.places[None], holding[:, self.places].argmax(axis=2)[..., None], axis=2)[..., 0]
        each = np.arange(len(best))[:, None]
        chosen = zip(best.tolist(), margins[each, best].tolist(), clearances[each, best].tolist(), strict=True)
        return [
            [
                Separation(self.witnesses[n], margin, clearance) if clearance >= -grazing else None
                for n, margin, clearance in zip(*row, strict=True)
            ]
            for row in chosen
        ]
