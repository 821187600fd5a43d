"""Where errors of the start pose are fixed: in the hole, in the hand that holds the part, or in the world."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fmopt.spatial.values import Array, Value, frozen


@dataclass(frozen=True, eq=False)
class Framing(Value):
    """Which share of each component of the start error is fixed in the hole, and which in the hand.

    What is left stays as it is in the world: the robot's own error, which neither part turns with.

    Args:
        hole: shares (6,), from 0 to 1, of what turns with the fixed part.
        hand: shares (6,) of what turns with the moving part.
    """

    hole: Array
    hand: Array

    def __post_init__(self) -> None:
        for name in ("hole", "hand"):
            shares = frozen(getattr(self, name), 6, name=f"shares of the {name}")
            object.__setattr__(self, name, shares)
        if (self.hole < 0.0).any() or (self.hand < 0.0).any() or (self.hole + self.hand > 1.0 + 1e-12).any():
            raise ValueError("shares of an error lie between 0 and 1, and so do their sums")

    @property
    def still(self) -> bool:
        """Whether all errors are fixed in the world."""
        return not (self.hole.any() or self.hand.any())

    def parts(self, box: Array) -> tuple[Array, Array, Array]:
        """The half-widths (6,) of a box that are fixed in the hole, in the hand and in the world; they add up to it."""
        hole, hand = self.hole * box, self.hand * box
        return hole, hand, np.maximum(box - hole - hand, 0.0)


IN_THE_WORLD = Framing(frozen([0.0] * 6), frozen([0.0] * 6))
"""All errors are fixed in the world."""
