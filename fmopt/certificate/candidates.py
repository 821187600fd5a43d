"""Several witnesses for each of several pairs: which of them keeps its pair apart at most margin."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from fmopt.certificate.assembly import Assembly
from fmopt.certificate.counted import Counted, rows_along
from fmopt.certificate.course import Course
from fmopt.certificate.kernels_rows import Table
from fmopt.certificate.lower import Places, Witnesses, best
from fmopt.certificate.pair import Pair, Witness
from fmopt.certificate.rows import stacked
from fmopt.values import Array


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
