"""Pieces of a move, the compliance with which contacts are held along them, and the tolerances of the problem."""

from __future__ import annotations

from dataclasses import dataclass

from fmopt.contact.primitive import PrimitiveContact
from fmopt.se3 import Pose
from fmopt.values import Array


@dataclass(frozen=True, eq=False)
class Compliance:
    """A held contact of the basis and the twist (6,) along which the part gives way to keep it."""

    contact: PrimitiveContact
    direction: Array


@dataclass(frozen=True, eq=False)
class Piece:
    """A piece of a move: nominal poses, contacts held and to be held, the basis, and which fraction of the move it is.

    Args:
        start: nominal pose at the beginning.
        goal: nominal pose at the end.
        held: all contacts held along the piece.
        goal_contacts: all contacts held after the whole move.
        basis: independent contacts of `held`, each with its compliant direction.
        made: the contact that the move makes, one for all that are made together, or None.
        progress: fractions of the move at both ends.
        left: contacts held up to the start of the move, which it gives up.
    """

    start: Pose
    goal: Pose
    held: tuple[PrimitiveContact, ...]
    goal_contacts: tuple[PrimitiveContact, ...]
    basis: tuple[Compliance, ...]
    made: PrimitiveContact | None
    progress: tuple[float, float]
    left: tuple[PrimitiveContact, ...] = ()

    @property
    def last(self) -> bool:
        """Whether the move ends with this piece."""
        return self.progress[1] >= 1.0

    @property
    def making(self) -> tuple[PrimitiveContact, ...]:
        """The contacts that the move adds."""
        return tuple(c for c in self.goal_contacts if c not in self.held) if self.made is not None else ()

    @property
    def opening(self) -> tuple[PrimitiveContact, ...]:
        """The contacts that never pass but may be open: the one being made that counts, and those given up."""
        return self.left if self.made is None else (self.made, *self.left)

    @property
    def share(self) -> float:
        """The part φ of what is left of the move that this piece covers."""
        return 1.0 if self.last else (self.progress[1] - self.progress[0]) / (1.0 - self.progress[0])


@dataclass(frozen=True, eq=False)
class Tolerance:
    """What steps need of the problem: velocity errors (translation, rotation) and the characteristic length ρ, m."""

    velocity_error: tuple[float, float]
    rho: float
