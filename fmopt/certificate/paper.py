"""The error sets of [DakinPopplestone1993] in place of sound ones, so that the two can be compared.

The paper takes the section of the ellipsoid across the motion where the shadow is needed, and bounds no curvature. Its
margins look larger than they are, and the independent check refuses them.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fmopt.certificate.functions import contact_rows
from fmopt.certificate.knowledge import Assembly
from fmopt.certificate.piece import Piece, Tolerance
from fmopt.certificate.rows import Extent
from fmopt.certificate.segment import Advance
from fmopt.certificate.spread import Spread
from fmopt.uncertainty import dakin
from fmopt.uncertainty.error_set import ErrorSet


def as_in_the_paper(assembly: Assembly, piece: Piece, step: Advance, errors: ErrorSet, tolerance: Tolerance) -> Advance:
    """A step whose goal set comes from the paper's recipe, with no allowance for curvature.

    Args:
        assembly: the two parts.
        piece: the piece of motion.
        step: the sound step, for poses, basis and motion.
        errors: error set at its start, the paper's own from the piece before.
        tolerance: velocity error and metric.
    """
    basis = step.basis if piece.last else piece.basis
    together = piece.goal_contacts if piece.last else piece.held
    rows = contact_rows(assembly, [c.contact for c in basis], together, piece.goal).N if basis else np.zeros((0, 6))
    directions = np.array([c.direction for c in basis]).reshape(-1, 6).T
    goal = dakin.step(
        errors, step.motion, rows, directions, np.zeros(len(basis)), tolerance.velocity_error, tolerance.rho
    )
    flat = Extent(0.0, np.zeros(3), 0.0, np.zeros(3))
    ends = replace(step.ends, goal_set=Spread.of(goal), extent=flat, slack=np.zeros((6, 0)))
    return replace(step, ends=ends)
