"""Thickness of contact surfaces: what curvature, nominal poses and rounding leave between a row and its surface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fmopt.certificate.piece import Piece
from fmopt.certificate.way import Way
from fmopt.uncertainty.error_set import Support
from fmopt.values import Array

_NONE = np.zeros(2)


@dataclass(frozen=True, eq=False)
class Layers:
    """What the thickness of contact surfaces at both ends of a piece is made up of.

    Args:
        lines: how the held basis' rows bend, and on the last piece the row of the contact being made; see `tube`.
        held: how many are held, h.
        rest: what start set and nominal poses leave of the rows (r,), m.
        residue: what rounding leaves of the made one under the projection, per m and per rad (2,).
        goal_dual: T^G (6, r), dual to the rows at the goal.
        delay: how much farther the execution goes for each thickness (r,), as a share of the piece, 1/m.
    """

    lines: Array
    held: int
    rest: Array
    residue: Array
    goal_dual: Array
    delay: Array


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
        return Layers(way.held_curvature.lines, len(ends), ends, _NONE, way.goal_dual, np.zeros(len(ends)))
    closing, rest = way.closing, np.append(ends, np.abs(way.made[1].f))
    lines = np.concatenate([way.held_curvature.lines, way.made_curvature.lines])
    return Layers(lines, len(ends), rest, closing.residue, closing.dual, np.abs(closing.progress))
