"""One piece of motion with its errors: how the error set moves on, and what is certified along the way.

The moving part goes from pose S to pose G. A real execution starts at an error e₀ of the start set, moves along the
commanded direction with a velocity error within its bounds, keeps the held contacts (the compliant directions give way)
and, when a contact m is being made, goes on until it touches. Measured on its own way, at every fraction s,

    e(s) = (1 − s)(ẽ₀ + Σ T^S_i tᵢ) + s (ẽ₁ + Σ T^G_i tᵢ),   |tᵢ| ≤ thicknessᵢ,

with ẽ₀ in the start set without its old thickness, ẽ₁ = Π(ẽ₀ + drift), and T^S, T^G dual to the contacts' rows at
either end. A row that is affine in the error needs its bound at both ends only. [DakinPopplestone1993] section 4, with
exact images in place of the paper's sections.

The pieces of a move share one twist per unit of progress, but for what the compliance takes up: an execution that
touches late has then gone farther in each of them alike, whichever piece it was commanded in.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fmopt.certificate import segment_linearisation
from fmopt.certificate.assembly import Assembly
from fmopt.certificate.error_set import ErrorSet
from fmopt.certificate.form import under_form
from fmopt.certificate.remainder import Ends, Extent
from fmopt.certificate.segment_linearisation import Compliance, Growth, Linearisation, Piece, Tolerance
from fmopt.certificate.tube import LARGE, PAST, SETTLED, THICK, Numbers, StartRoots, carried, coupled
from fmopt.errors import InfeasibleError
from fmopt.spatial import ellipsoid
from fmopt.spatial.se3 import exp, length
from fmopt.spatial.values import Array

_IMPOSSIBLE = {
    PAST: ("the velocity error could carry the part past the contact that it is to make", ""),
    LARGE: ("errors are too large for this piece of motion", "make it shorter or steadier"),
    THICK: ("the contact surfaces are too thick for this piece of motion", ""),
}


@dataclass(frozen=True, eq=False)
class Advance:
    """The outcome of a step."""

    ends: Ends
    basis: tuple[Compliance, ...]
    motion: Array  # displacement (6,) of the piece inside the held contacts
    length: float
    approach: Growth | None = None  # how much nearer the contact being made comes; None without one
    departures: tuple[Growth, ...] = ()
    # How much longer or shorter the piece is at most until its move's contact is made, as a share of it
    overtravel: float = 0.0

    @property
    def departure(self) -> float:
        """How much farther away the contacts given up get at least, m; infinite without any."""
        # No contact is given up: nothing has to grow.
        return min((growth.least for growth in self.departures), default=np.inf)


def advance(assembly: Assembly, piece: Piece, errors: ErrorSet, tolerance: Tolerance) -> Advance:
    """Carries an error set through a piece of motion.

    Raises:
        InfeasibleError: the contact to be made cannot be reached along the motion, one cannot be given up alone,
            contacts do not determine their compliant directions, or errors outgrow the bounds in which the certificate
            holds.
    """
    way = segment_linearisation.linearisation_of(assembly, piece, tolerance)
    basis = piece.basis
    if piece.made is not None:
        basis = (*basis, Compliance(piece.made, way.direction))
    ends, overtravel = _carried(assembly, piece, way, basis, errors, tolerance)
    extent = ends.extent
    nearer = segment_linearisation.approach(tolerance, way, extent, errors.linkage)
    farther = tuple(segment_linearisation.departures(assembly, piece, tolerance, way, extent, errors.linkage))
    return Advance(ends, basis, way.motion, way.length, nearer, farther, overtravel)


def _carried(
    assembly: Assembly,
    piece: Piece,
    way: Linearisation,
    basis: Sequence[Compliance],
    errors: ErrorSet,
    tolerance: Tolerance,
) -> tuple[Ends, float]:
    """Both ends of a piece with their sets, and the overtravel.

    Everything is evaluated with one box around all errors of the piece, such that the one computed with it is no wider.
    """
    core, linkage = errors.core(way.directions), errors.linkage
    moved, shape_moved, links = core, errors.shape_root, np.zeros(5)
    if linkage is not None:
        # Errors fixed in the hand or in the hole move on with the part; the projection comes after.
        by = linkage.moves(way.travel, exp(way.twist[3:]), len(core))
        # k Σ gᵢgᵢᵀ holds the zonotope of k generators, as (Σ uᵢ gᵢ·n)² ≤ k Σ (gᵢ·n)² for |uᵢ| ≤ 1.
        root = math.sqrt(linkage.linked) * by.T
        moved, shape_moved = core + by, ellipsoid.outer_sum(shape_moved, root, ellipsoid.metric(tolerance.rho))
        links = linkage.links(piece.start.p, piece.goal.p)
        linkage = linkage.begun(piece.start.p).turned(exp(way.twist[3:]))
    # Only the last piece makes the contact; on those before it is still ahead.
    closing = piece.made is not None and piece.last
    layers = way.closing if closing else way.on_the_way
    translation, rotation = tolerance.velocity_error
    rates = translation, rotation / tolerance.rho
    leaning = length(way.seen[3:])
    numbers = Numbers(way.length, way.turn, way.rate, leaning, piece.share, rates, way.seen, way.projector)
    drifts = errors.slide_root, errors.swing_root
    roots = StartRoots(core, *drifts, errors.shape_root, moved, shape_moved, links)

    def carry(form: Array) -> tuple[Ends, float]:
        found = carried(layers._replace(form=form), numbers, roots, tolerance.rho)
        code, half, thickness, beyond, generators, slide, swing, shape = found
        if code != SETTLED:
            message, advice = _IMPOSSIBLE[code]
            raise InfeasibleError(message, advice=advice)
        compliant = np.array([c.direction for c in basis[: len(thickness)]]).reshape(-1, 6)
        goal = ErrorSet(shape, generators, slide, swing, len(thickness), compliant, linkage)
        extent = Extent(way.twist, half, coupled(links, half, way.turn))
        # Thickness at the start is what contacts of the basis may be off there, along their compliant directions.
        slack = way.start_dual * thickness[: len(piece.basis)]
        return Ends(piece.start, piece.goal, errors, goal, extent, slack, core, assembly.form), beyond

    return under_form(assembly, piece, way, carry) if assembly.form else carry(layers.form)
