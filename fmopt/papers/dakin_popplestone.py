"""A motion judged by the error sets of [DakinPopplestone1993], for comparison with the sound ones.

The paper takes the section of the ellipsoid across the motion where the shadow is needed, and bounds no curvature. What
it calls clear is not, and the independent check refuses it.

The published recipe for one step of the tube, kept for comparison only: it under-covers.

[DakinPopplestone1993] section 4.2 takes the section of the error ellipsoid by V⊥ where its shadow is needed, so
that most of the ellipsoid's surface leaves the cylinder. Nothing here may enter a certificate.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.linalg import null_space

from fmopt.certificate.assembly import Assembly, contact_rows
from fmopt.certificate.claim import Claim
from fmopt.certificate.error_set import ErrorSet
from fmopt.certificate.piece_pairs import facing
from fmopt.certificate.propagation import Advance
from fmopt.certificate.remainder import Extent
from fmopt.certificate.segment_linearisation import Piece, Tolerance
from fmopt.certificate.separating_plane import separation
from fmopt.spatial import ellipsoid
from fmopt.spatial.values import Array

_ACROSS = 0.03  # sine of the angle below which an axis counts as along the motion: eq. 13 is singular there


def as_in_the_paper(
    assembly: Assembly, claims: Sequence[Claim], start: ErrorSet, tolerance: Tolerance
) -> tuple[Claim, ...]:
    """The same pieces and planes with the paper's error sets, and the margins that it would see.

    The paper knows the ellipsoid alone of the error set at the start.
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
    """
    if piece.basis:
        held = contact_rows(assembly, [c.contact for c in piece.basis], piece.held, piece.goal).N
        hold, _ = ellipsoid.oblique_projector(held, np.array([c.direction for c in piece.basis]).T)
        # The paper has one ellipsoid: what the held contacts take up is projected out of it at the start.
        errors = ErrorSet.from_ellipsoid(ellipsoid.image(errors.shape, hold))
    basis = step.basis if piece.last else piece.basis
    together = piece.goal_contacts if piece.last else piece.held
    rows = contact_rows(assembly, [c.contact for c in basis], together, piece.goal).N if basis else np.zeros((0, 6))
    directions = np.array([c.direction for c in basis]).reshape(-1, 6).T
    return errors, step_in_the_paper(errors, step.motion, rows, directions, tolerance.velocity_error, tolerance.rho)


def _judged(assembly: Assembly, claim: Claim, errors: ErrorSet, tolerance: Tolerance) -> Claim:
    piece, step = claim.piece, claim.advance
    start, goal = goal_in_the_paper(assembly, piece, step, errors, tolerance)
    # No extent and no slack: the paper's claims leave out what is of second order.
    flat = Extent(np.zeros(6), np.zeros(6))
    ends = replace(step.ends, start_set=start, goal_set=goal, extent=flat, slack=np.zeros((6, 0)), core=None)
    both = zip(claim.separations, facing(assembly, piece).listed, strict=True)
    separations = tuple((i, j, separation(assembly, pair, one.witness, ends)) for (i, j, one), (*_, pair) in both)
    margin, binding = min((s.margin, f"pieces {i}/{j}") for i, j, s in separations)
    moved = replace(step, ends=ends)
    return replace(claim, advance=moved, separations=separations, margin=margin, binding=binding, early=None)


def section(Q: Array, V: Array) -> Array:
    """Shape matrix Q − (QV)(QV)ᵀ/(VᵀQV) of the section of the ellipsoid by the hyperplane V⊥ through its centre.

    The ellipsoid through the surface points λ_U U of [DakinPopplestone1993] eq. 9 and 28, in closed form and in the
    coordinates of Q. Q is (n, n) and V, the direction, (n,).
    """
    QV = Q @ V
    reach = float(V @ QV)
    # The ellipsoid cut by the plane across V: what errors along the motion do is stop it sooner or later.
    return np.asarray(Q - np.outer(QV, QV) / reach) if reach > 0.0 else Q


def lateral_rate(U: Array, velocity_error: tuple[float, float]) -> float:
    """λ_U of [DakinPopplestone1993] eq. 6: the point of the cone's base in direction U (6,), rotation scaled by ρ."""
    rates = np.repeat(velocity_error, 3)
    u = U / np.linalg.norm(U)
    # No velocity error there: any part of U in it is out of the cone.
    if (u[rates == 0.0] != 0.0).any():
        return 0.0
    return float(1.0 / np.linalg.norm(u[rates > 0.0] / rates[rates > 0.0]))


def step_in_the_paper(
    errors: ErrorSet, move: Array, rows: Array, directions: Array, velocity_error: tuple[float, float], rho: float
) -> ErrorSet:
    """Errors at the goal after one segment, by [DakinPopplestone1993] section 4.4.

    The section by V⊥ is carried onto the goal state, and its radii grow by v/(1 − |B·V|) (eq. 13). The paper
    bounds no curvature.

    The move is V (6,) as (d, δ), the rows N (r, 6) are a basis of the contacts that hold at the goal, with the
    directions C (6, r) in which they correct the pose. The velocity error is (λ_t, λ_r), m of drift and ρ·rad of drift
    per m of travel.
    """
    M = ellipsoid.metric(rho)
    scaled_move = move * M
    length = float(np.linalg.norm(scaled_move))
    projector, _ = ellipsoid.oblique_projector(rows / M, directions * M[:, None])
    Q = errors.shape * np.outer(M, M)
    # Without a motion there is no drift.
    if length == 0.0:
        return ErrorSet.from_ellipsoid(ellipsoid.image(Q, projector) / np.outer(M, M))
    V = scaled_move / length
    # Within the held contacts only.
    basis = null_space(rows / M) if len(rows) else np.eye(6)
    squares, axes = np.linalg.eigh(basis.T @ ellipsoid.image(section(Q, V), projector) @ basis)
    radii = np.sqrt(np.maximum(squares, 0.0))
    B = basis @ axes
    for i, axis in enumerate(B.T):
        along = float(axis @ V)
        U = axis - along * V
        # Across the motion: along it the rate is no error, and eq. 13 divides by nothing.
        if np.linalg.norm(U) > _ACROSS:
            radii[i] += lateral_rate(U, velocity_error) * length / (1.0 - abs(along))
    return ErrorSet.from_ellipsoid((B * radii**2) @ B.T / np.outer(M, M))
