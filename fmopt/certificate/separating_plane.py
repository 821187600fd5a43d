"""Separating planes of convex pieces, kept over a whole piece of motion with its errors.

Two convex pieces are apart when a face plane of one, or a plane along an edge of each, has them on opposite sides.

Several witnesses for each of several pairs: which of them keeps its pair apart at most margin.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from fmopt.certificate.assembly import Assembly
from fmopt.certificate.counted import Counted, counted_rows, rows_along
from fmopt.certificate.curvature import AtEnd, Course, Ends
from fmopt.certificate.kernels_rows import Table
from fmopt.certificate.lower import Places, Witnesses, best
from fmopt.certificate.pair import Pair, Witness, pairs, touching
from fmopt.certificate.rows import stacked
from fmopt.values import Array

__all__ = ["Ends", "Pair", "RowBounds", "Separation", "Witness", "pairs", "row_bounds", "separation", "touching"]


@dataclass(frozen=True, eq=False)
class Separation:
    """A witness with its certified margin and its nominal clearance (m) over a piece of motion."""

    witness: Witness
    margin: float
    clearance: float


@dataclass(frozen=True, eq=False)
class RowBounds:
    """The counted rows of a witness at both ends, their certified lower bounds (k,), and the divisor of the margin."""

    start: AtEnd
    goal: AtEnd
    lower: Array
    scale: float


def row_bounds(assembly: Assembly, pair: Pair, witness: Witness, ends: Ends) -> RowBounds:
    """All rows of one witness over a piece of motion, for placements that want to move them."""
    counted = counted_rows(assembly, pair, witness)
    rows = Course.of((ends,)).over(counted.forms)
    lower = rows.lower[0]
    which = counted.counts(lower)
    start, goal = (AtEnd(rows.f[end, 0, which], rows.N[end, 0, which]) for end in (0, 1))
    return RowBounds(start, goal, lower[which], counted.scale(ends.start, ends.goal, ends.extent))


def separation(assembly: Assembly, pair: Pair, witness: Witness, ends: Ends) -> Separation:
    """Margin and clearance of one witness over a piece of motion."""
    rows = row_bounds(assembly, pair, witness, ends)
    clearance = float(np.minimum(rows.start.f, rows.goal.f).min()) / rows.scale
    return Separation(witness, float(rows.lower.min()) / rows.scale, clearance)


@dataclass(frozen=True, eq=False)
class Block:
    """Witnesses of one pair with their counted rows; one whose rows are all settled is not listed."""

    witnesses: tuple[Witness, ...]
    counted: tuple[Counted, ...]

    @staticmethod
    def of(assembly: Assembly, pair: Pair, witnesses: tuple[Witness, ...]) -> Block:
        """Those of a pair's witnesses that say something."""
        rows = rows_along(assembly, pair, witnesses)
        said = [(witness, own) for witness, own in zip(witnesses, rows, strict=True) if len(own.forms)]
        return Block(tuple(witness for witness, _ in said), tuple(own for _, own in said))


@dataclass(frozen=True, eq=False)
class Candidates:
    """The witnesses of several pairs (m), one after the other, and their rows."""

    witnesses: tuple[Witness, ...]
    rows: Table
    listed: Witnesses

    @staticmethod
    def of(blocks: Sequence[Block]) -> Candidates:
        """The witnesses of several pairs."""
        if not all(block.counted for block in blocks):
            raise ValueError("a pair of pieces has no plane that could keep it apart")
        counted = [rows for block in blocks for rows in block.counted]
        begins = np.cumsum([0, *(len(rows.forms) for rows in counted)])
        ends = np.cumsum([0, *(len(block.counted) for block in blocks)]).tolist()
        most = max(len(block.counted) for block in blocks)
        places = np.array([[*range(i, j), *[j - 1] * (most - j + i)] for i, j in pairwise(ends)])
        surely, edges = np.ones(begins[-1], dtype=np.bool_), np.zeros((len(counted), 2, 3))
        walls = [(n, wall) for n, rows in enumerate(counted) for wall in rows.onto]
        behind = np.zeros((len(walls), np.diff(begins).max()), dtype=np.bool_)
        for n, rows in enumerate(counted):
            if rows.edges is not None:
                edges[n], surely[begins[n] : begins[n + 1]] = rows.edges, rows.surely
        for mask, (_, wall) in zip(behind, walls, strict=True):
            mask[: len(wall.behind)] = wall.behind
        onto = np.array([(n, wall.outside, wall.inside) for n, wall in walls], dtype=np.intp).reshape(-1, 3)
        always = np.array([rows.always for rows in counted])
        forms = stacked(*(rows.forms for rows in counted))
        listed = Witnesses(begins, places, always, surely, edges, onto, behind)
        witnesses = tuple(witness for block in blocks for witness in block.witnesses)
        return Candidates(witnesses, forms.table, listed)

    def best(self, course: Course, least: Array, grazing: float) -> tuple[Places, Array, Array]:
        """For each pair the witness with the largest margin among those whose planes hold nominally.

        Args:
            course: pieces of motion (n).
            least: margins (n, m) that are asked for, m.
            grazing: how far nominal distances may be below zero, m.

        Returns:
            numbers (n, m) of the witnesses, −1 where none holds with that margin, their margins and clearances, m.
        """
        return best(self.rows, self.listed, course.motion, least, grazing)
