"""A motion judged by the error sets of [DakinPopplestone1993], for comparison with the sound ones.

The paper takes the section of the ellipsoid across the motion where the shadow is needed, and bounds no curvature. What
it calls clear is not, and the independent check refuses it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fmopt import ellipsoid
from fmopt.certificate.assembly import Assembly
from fmopt.certificate.claim import Claim
from fmopt.certificate.curvature import Extent
from fmopt.certificate.functions import contact_rows
from fmopt.certificate.piece import Piece, Tolerance
from fmopt.certificate.segment import Advance
from fmopt.certificate.separation import pairs, separation
from fmopt.uncertainty import dakin
from fmopt.uncertainty.error_set import ErrorSet


def as_in_the_paper(
    assembly: Assembly, claims: Sequence[Claim], start: ErrorSet, tolerance: Tolerance
) -> tuple[Claim, ...]:
    """The same pieces and planes with the paper's error sets, and the margins that it would see.

    Args:
        assembly: the two parts.
        claims: the motion, soundly judged.
        start: error set at its start; the paper knows its ellipsoid alone.
        tolerance: velocity error and metric.
    """
    errors = ErrorSet.from_ellipsoid(start.shape)
    found = []
    for claim in claims:
        judged = _judged(assembly, claim, errors, tolerance)
        errors = judged.advance.ends.goal_set
        found.append(judged)
    return tuple(found)


def goal_in_the_paper(
    assembly: Assembly, piece: Piece, step: Advance, errors: ErrorSet, tolerance: Tolerance
) -> tuple[ErrorSet, ErrorSet]:
    """The paper's error sets at both ends of a piece of motion.

    The paper works inside the facet: what the held contacts' normals have turned since is projected away first.

    Args:
        assembly: the two parts.
        piece: the piece.
        step: its outcome, soundly judged.
        errors: error set at its start.
        tolerance: velocity error and metric.
    """
    if piece.basis:
        held = contact_rows(assembly, [c.contact for c in piece.basis], piece.held, piece.goal).N
        hold, _ = ellipsoid.oblique_projector(held, np.array([c.direction for c in piece.basis]).T)
        errors = ErrorSet.from_ellipsoid(ellipsoid.image(errors.shape, hold))
    basis = step.basis if piece.last else piece.basis
    together = piece.goal_contacts if piece.last else piece.held
    rows = contact_rows(assembly, [c.contact for c in basis], together, piece.goal).N if basis else np.zeros((0, 6))
    directions = np.array([c.direction for c in basis]).reshape(-1, 6).T
    return errors, dakin.step(errors, step.motion, rows, directions, tolerance.velocity_error, tolerance.rho)


def _judged(assembly: Assembly, claim: Claim, errors: ErrorSet, tolerance: Tolerance) -> Claim:
    piece, step = claim.piece, claim.advance
    start, goal = goal_in_the_paper(assembly, piece, step, errors, tolerance)
    flat = Extent(np.zeros(6), np.zeros(6))
    ends = replace(step.ends, start_set=start, goal_set=goal, extent=flat, slack=np.zeros((6, 0)), core=None)
    listed = pairs(assembly, piece)
    separations = tuple(
        (i, j, separation(assembly, pair, kept.witness, ends))
        for (i, j, kept), (_, _, pair) in zip(claim.separations, listed, strict=True)
    )
    margin, binding = min((s.margin, f"pieces {i}/{j}") for i, j, s in separations)
    return replace(
        claim, advance=replace(step, ends=ends), separations=separations, margin=margin, binding=binding, early=None
    )
