"""Errors that are fixed in the hole or in the hand, and so turn with a part as the other one moves.

With a hole that is askew by H, a grasp that is off by G, and κ for what robot and contacts add in the world, the part's
pose in the hole's frame is H⁻¹ · (C ⊕ κ) · G for the commanded pose C = (p̄, R̄). Let h and h_p be the turn and the shift
of the hole about the start position p̄₀, g = (g_p, g_r) the grasp error in the part's axes. To first order

    e = h_p + h × (p̄ − p̄₀) + κ_p + R̄ g_p,    ε = h + κ_r + R̄ g_r:

as the part goes by Δ, a generator with turn h moves by h × Δ, and one fixed in the hand turns as the part does. With
|e| ≤ D, |ε| ≤ θ, |p̄ − p̄₀| ≤ P, hence |κ_p| ≤ D + |h_p| + |h|P + |g_p| and |κ_r| ≤ θ + |h| + |g_r|, what is left is

    ½|h|²P + |h|(|κ_p| + |g_p|) + |κ_r||g_p|    and    ½ab(1 + a + b) + ½|h|c(1 + |h| + c),

a = |κ_r|, b = |g_r|, c = a + b, by the composition of turns; an arc of a turn τ is off its chord by τ²/8 of g at most.
These bounds, the coupling, hold at any one moment: they do not add up along the way.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fmopt.framing import Framing
from fmopt.se3 import cross, length
from fmopt.values import Array, Value, frozen


@dataclass(frozen=True, eq=False)
class Linkage(Value):
    """How generators of the start error move on with the part, the first ones of an error set.

    Args:
        hole: turns (k, 3) of the hole, rad; zero for generators that are not fixed there.
        hand: generators (k, 6) that are fixed in the hand, as they are turned now, m and rad; zero for others.
        sizes: of h_p, h, g_p and g_r at most (4,), m and rad.
        origin: p̄₀ (3,), m; None before the first piece of motion.
    """

    hole: Array
    hand: Array
    sizes: Array
    origin: Array | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "hole", frozen(self.hole, None, 3, name="turns of the hole"))
        object.__setattr__(self, "hand", frozen(self.hand, None, 6, name="errors in the hand"))
        object.__setattr__(self, "sizes", frozen(self.sizes, 4, name="sizes"))

    @staticmethod
    def of(box: Array, framing: Framing) -> tuple[Array, Linkage | None]:
        """The generators (k, 6) of a box of start errors, and how they move on; None where all stay as they are."""
        if framing.still:
            return np.diag(box)[box > 0.0], None
        hole, hand, world = framing.parts(box)
        generators = np.vstack([np.diag(part)[part > 0.0] for part in (hole, hand, world)])
        askew, gripped = np.zeros((len(generators), 3)), np.zeros((len(generators), 6))
        first, second = np.count_nonzero(hole), np.count_nonzero(hole) + np.count_nonzero(hand)
        askew[:first] = generators[:first, 3:]
        gripped[first:second] = generators[first:second]
        sizes = np.array([length(hole[:3]), length(hole[3:]), length(hand[:3]), length(hand[3:])])
        return generators, Linkage(askew, gripped, sizes)

    def begun(self, start: Array) -> Linkage:
        """The linkage of errors at a position (3,), which is the origin where there is none yet."""
        return self if self.origin is not None else replace(self, origin=start)

    def links(self, start: Array, goal: Array) -> Array:
        """The sizes of errors in different frames, and the greatest way from the origin of two positions (3,), (5,)."""
        origin = start if self.origin is None else self.origin
        return np.append(self.sizes, max(length(start - origin), length(goal - origin)))

    def moves(self, travel: Array, turn: Array, count: int) -> Array:
        """By how much generators (count, 6) move as the part goes by `travel` (3,) and turns by a rotation (3, 3)."""
        found = np.zeros((count, 6))
        after = self.turned(turn).hand
        found[: len(self.hole)] = after - self.hand
        found[: len(self.hole), :3] += cross(self.hole, travel)
        return found

    @property
    def linked(self) -> int:
        """How many generators move on otherwise than the world's."""
        return int(np.count_nonzero(self.hole.any(axis=1) | self.hand.any(axis=1)))

    def turned(self, turn: Array) -> Linkage:
        """The linkage after the part has turned by a rotation (3, 3)."""
        hand = np.hstack([self.hand[:, :3] @ turn.T, self.hand[:, 3:] @ turn.T])
        return replace(self, hand=hand)
