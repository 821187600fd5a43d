"""What is asked of a piece of motion."""

from __future__ import annotations

from dataclasses import dataclass

from fmopt.verify.arithmetic.rational import ONE, Row, Vector
from fmopt.verify.parts.assembly import Touch
from fmopt.verify.parts.rows import Pose


@dataclass(frozen=True)
class Task:
    """The piece to be carried through.

    Attributes:
        start, goal: nominal poses.
        held: basis contacts held along the piece, with directions.
        made: basis contact that the move makes, or None.
        state: all contacts held along the piece.
        goal_state: all contacts held after the move.
        share: φ, the piece's share of what is left of the move; ONE on its last piece.
        theta: stated bound of |ε|, rad.
        angles: stated half-widths of the box of ε, rad.
        box: stated half-widths of the box of e, m.
        rates: λ_t and λ_r.
        rho: characteristic length, m.
    """

    start: Pose
    goal: Pose
    held: tuple[tuple[Touch, Row], ...]
    made: Touch | None
    state: tuple[Touch, ...]
    goal_state: tuple[Touch, ...]
    share: int
    theta: int
    angles: Vector
    box: Vector
    rates: tuple[int, int]
    rho: int

    @property
    def last(self) -> bool:
        """Whether the move ends with this piece."""
        return self.share == ONE

    @property
    def basis(self) -> list[Touch]:
        """The contacts of the basis, the one being made the last of them."""
        return [*(touch for touch, _ in self.held), *([] if self.made is None else [self.made])]
