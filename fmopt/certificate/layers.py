"""Thickness of contact surfaces: what curvature, nominal poses and rounding leave between a row and its surface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fmopt.certificate.curvature import Curvature
from fmopt.certificate.piece import Piece
from fmopt.certificate.way import Way
from fmopt.uncertainty.error_set import Support
from fmopt.values import Array


@dataclass(frozen=True, eq=False)
class Layers:
    """The thickness of contact surfaces at both ends of a piece.

    Args:
        curvature: of the held basis' rows, and on the last piece of the row of the contact being made (r).
        held: how many are held, h.
        rest: what start set and nominal poses leave of the rows (r,), m.
        residue: what rounding leaves of the made one under the projection, per m and per rad.
        goal_dual: T^G (6, r), dual to the rows at the goal.
        delay: how much farther the execution goes for each thickness (r,), as a share of the piece, 1/m.
    """

    curvature: Curvature
    held: int
    rest: Array
    residue: tuple[float, float]
    goal_dual: Array
    delay: Array

    def thicknesses(self, half: Array, wide: tuple[float, float]) -> tuple[Array, Array]:
        """Thickness at the start (h,) and at the goal (r,), m.

        Args:
            half: half-widths (6,) of the box around all errors.
            wide: bounds of translation and angle with their drift, before contacts take it up.
        """
        final = self.curvature.bound(half) + self.rest
        final[self.held :] += self.residue[0] * wide[0] + self.residue[1] * wide[1]
        return final[: self.held], final


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
    ends = np.maximum(np.abs(first.f) + start(first.N), np.abs(second.f))
    if way.made is None or not piece.last:
        return Layers(way.held_curvature, len(ends), ends, (0.0, 0.0), way.goal_dual, np.zeros(len(ends)))
    closing, rest = way.closing, np.append(ends, np.abs(way.made[1].f))
    return Layers(closing.rows, len(ends), rest, closing.residue, closing.dual, np.abs(closing.progress))
