"""Thickness of contact surfaces: what curvature, nominal poses and rounding leave between a row and its surface."""

from __future__ import annotations

from dataclasses import dataclass

from fmopt.certificate.rows import Rows
from fmopt.values import Array


@dataclass(frozen=True, eq=False)
class Layers:
    """What the thickness of contact surfaces at both ends of a piece is made up of, whatever the errors.

    Args:
        lines: how the held basis' rows bend, and on the last piece the row of the contact being made (r); see `tube`.
        held: rows of those held (h) at the start.
        off: how far the nominal pose at the goal is off the surfaces (r,), m.
        residue: what rounding leaves of the made one under the projection, per m and per rad (2,).
        goal_dual: T^G (6, r), dual to the rows at the goal.
        delay: how much farther the execution goes for each thickness (r,), as a share of the piece, 1/m.
    """

    lines: Array
    held: Rows
    off: Array
    residue: Array
    goal_dual: Array
    delay: Array
