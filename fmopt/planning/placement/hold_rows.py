"""How surely contacts are held, as rows of the placement: what a sequence must not lose, or is to gain first."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from fmopt.certificate.assembly import Assembly
from fmopt.certificate.segment_linearisation import Tolerance, linearisation_of
from fmopt.planning.moves.moves import Reached
from fmopt.planning.placement.sequence_rows import KEPT, SequenceRows
from fmopt.spatial.values import Array


class Hold(NamedTuple):
    """How surely a piece of a motion holds its contacts.

    Args:
        claim: number of the piece.
        share: of the contact force, on the contact that is pressed least.
        least: what it has to be, a share of the same.
        slopes: what displacements of the piece's start and goal change of it (12,), 1/m and 1/rad.
    """

    claim: int
    share: float
    least: float
    slopes: Array


def hold_rows(
    assembly: Assembly, reached: Reached, tolerance: Tolerance, holds: Sequence[Hold], width: int
) -> SequenceRows:
    """A row for each hold: that it is no less than it has to be, or than it is where it is less; shares on an arm of ρ.

    Args:
        assembly: the two parts.
        reached: the sequence.
        tolerance: velocity error and metric.
        holds: of its pieces.
        width: how many generators the rows are to have; holds lose to none.
    """
    rho, m = tolerance.rho, len(holds)
    numbers = np.cumsum([claim.piece.progress[0] == 0.0 for claim in reached.claims], dtype=np.intp) - 1
    n = 6 * (int(numbers[-1]) + 2)
    slopes, moves = np.zeros((m, n)), np.array([numbers[hold.claim] for hold in holds], dtype=np.intp)
    for row, hold, number in zip(slopes, holds, moves.tolist(), strict=True):
        piece = reached.claims[hold.claim].piece
        way = linearisation_of(assembly, piece, tolerance)
        kept = np.eye(6) - way.start_dual @ way.held[0].N, way.hold
        for part, share, stays in zip(hold.slopes.reshape(2, 6), piece.progress, kept, strict=True):
            row[6 * number : 6 * number + 6] += (1.0 - share) * rho * part @ stays
            row[6 * number + 6 : 6 * number + 12] += share * rho * part @ stays
    beyond = np.array([KEPT * rho * max(hold.share - hold.least, 0.0) for hold in holds])
    asked, none = np.array([rho * hold.least for hold in holds]), np.zeros(m)
    generators = np.zeros((m, width)), np.zeros((m, width, n))
    return SequenceRows(beyond, slopes, none, none, moves, *generators, asked, none)
