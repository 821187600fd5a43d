"""Separating planes of convex pieces, kept over a whole piece of motion with its errors.

Two convex pieces are apart when a face plane of one, or a plane along an edge of each, has them on opposite sides.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fmopt.certificate.assembly import Assembly
from fmopt.certificate.counted import counted_rows
from fmopt.certificate.course import AtEnd, Course, Ends
from fmopt.certificate.pair import Pair, Witness, pairs, touching
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
