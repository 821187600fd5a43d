"""Thickness of contact surfaces: what curvature, nominal poses and rounding leave between a row and its surface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fmopt import ellipsoid
from fmopt.certificate.piece import Piece
from fmopt.certificate.rows import Curvature, lengths
from fmopt.certificate.way import Way
from fmopt.uncertainty.error_set import Support
from fmopt.values import Array


@dataclass(frozen=True, eq=False)
class Layers:
    """The thickness of contact surfaces at both ends of a piece.

    Args:
        held: curvature of the held basis' rows.
        ends: what start set and nominal poses leave of them (h,), m.
        made: curvature of the row of the contact being made; None before the last piece.
        rest: what the nominal goal leaves of it, m.
        residue: what rounding leaves of it under the projection (2,), per m and per rad.
        goal_dual: T^G (6, r), dual to the rows at the goal.
        delay: how much farther the execution goes for each thickness (r,), as a share of the piece, 1/m.
    """

    held: Curvature
    ends: Array
    made: Curvature | None
    rest: float
    residue: Array
    goal_dual: Array
    delay: Array

    def thicknesses(self, theta: float, offset: Array, wide: Array) -> tuple[Array, Array]:
        """Thickness at the start (h,) and at the goal (r,), m.

        Args:
            theta: bound of the angle of errors, rad.
            offset: half-widths (3,) of the box around their translation, m.
            wide: bounds (2,) of translation and angle with their drift, before contacts take it up.
        """
        own = self.held.bound(theta, offset) + self.ends
        if self.made is None:
            return own, own
        return own, np.append(own, self.made.bound(theta, offset) + self.rest + self.residue @ wide)


def layers_of(piece: Piece, way: Way, start: Support) -> Layers:
    """The thickness of the contact surfaces along a piece.

    Args:
        piece: the piece.
        way: its linear picture.
        start: support of the start set without its old thickness.

    Raises:
        InfeasibleError: contacts do not determine their compliant directions.
    """
    first, second = way.held
    held = Curvature.of(first, second, way.turn, way.travel)
    ends = np.maximum(np.abs(first.f) + start(first.N), np.abs(second.f))
    if way.made is None or not piece.last:
        return Layers(held, ends, None, 0.0, np.zeros(2), way.goal_dual, np.zeros(len(ends)))
    begin, end = way.made
    C = np.vstack([way.directions, way.motion]).T
    inverse = ellipsoid.coupling_inverse(np.vstack([second.N, end.N]), C)
    left = end.N[0] @ way.projector
    residue = lengths(left.reshape(2, 3))
    made = Curvature.of(begin, end, way.turn, way.travel)
    return Layers(held, ends, made, abs(float(end.f[0])), residue, C @ inverse, np.abs(inverse[-1]))
