"""Errors that are fixed in the hole or in the hand: how their generators move on, and what the linear picture leaves.

With a hole that is askew by H, a grasp that is off by G, and κ for what robot and contacts add in the world, the part's
pose in the hole's frame is H⁻¹ · (C ⊕ κ) · G for the commanded pose C = (p̄, R̄). With the turn h and shift h_p of the
hole about the start position p̄₀ and the error g = (g_p, g_r) in the hand,

    e = h_p + h × (p̄ − p̄₀) + κ_p + R̄ g_p + q_e,    ε = h + κ_r + R̄ g_r + q_ε,

    |q_e| ≤ ½|h|²P + |h|(|κ_p| + |g_p|) + |κ_r||g_p|,    |q_ε| ≤ ½ab(1 + a + b) + ½|h|c(1 + |h| + c),

a = |κ_r|, b = |g_r|, c = a + b, P = |p̄ − p̄₀|; |κ_p| ≤ |e| + |h_p| + |h|P + |g_p| and |κ_r| ≤ |ε| + |h| + |g_r|.
Between the ends of a piece that turns by τ, R̄ g is off its chord by τ²/8 of its size. All of it counts against every
row; it does not add up along the way.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from fmopt.verify.document import Plan
from fmopt.verify.form import FIXED_IN
from fmopt.verify.linear import NO_ROW, row_of
from fmopt.verify.rational import (
    ONE,
    ZERO3,
    ArithmeticRefusal,
    Matrix,
    Row,
    Vector,
    add,
    cross,
    fixed,
    length,
    sub,
    times,
    turned,
    vector,
)


@dataclass(frozen=True)
class Linkage:
    """How the first generators of an error set move on with the part.

    Attributes:
        hole: turns of the hole (3,), rad; zero for generators that are not fixed there.
        hand: generators fixed in the hand, as they are turned now; zero for others.
        sizes: bounds of |h_p|, |h|, |g_p| and |g_r|.
        origin: p̄₀.
    """

    hole: tuple[Vector, ...]
    hand: tuple[Row, ...]
    sizes: tuple[int, int, int, int]
    origin: Vector

    @property
    def linked(self) -> int:
        """How many generators move on otherwise than the world's."""
        return sum(h != ZERO3 or g != NO_ROW for h, g in zip(self.hole, self.hand, strict=True))

    def turned(self, turn: Matrix) -> Linkage:
        """The linkage after the part has turned."""
        return replace(self, hand=tuple(turned(turn, g[:3]) + turned(turn, g[3:]) for g in self.hand))

    def moves(self, travel: Vector, turn: Matrix, count: int) -> tuple[Row, ...]:
        """By how much `count` generators move as the part travels and turns."""
        after = self.turned(turn).hand
        found = []
        for h, old, new in zip(self.hole, self.hand, after, strict=True):
            swung = add(sub(new[:3], old[:3]), cross(h, travel))
            found.append(row_of((*swung, *sub(new[3:], old[3:]))))
        return (*found, *[NO_ROW] * (count - len(found)))

    def left(self, offset: int, angle: int, ends: Sequence[Vector], turn: int) -> tuple[int, int]:
        """What the linear picture leaves of errors of at most these sizes over a piece between two positions.

        Raises:
            ArithmeticRefusal: the errors are too large for its bounds.
        """
        shift, askew, off, slant = self.sizes
        travel = max(length(sub(p, self.origin)) for p in ends)
        moved = offset + shift + times(askew, travel) + off
        a = angle + askew + slant
        c = a + slant
        if askew + c > ONE >> 1:
            raise ArithmeticRefusal("errors fixed in different frames are too large for the bounds of this check")
        arc = times(turn, turn) >> 3
        straight = (times(times(askew, askew), travel) >> 1) + times(askew, moved + off) + times(a + arc, off)
        round_ = (times(times(a, slant), ONE + c) >> 1) + (times(times(askew, c), ONE + askew + c) >> 1)
        return straight + 8, round_ + times(arc, slant) + 8


def linkage_of(plan: Plan) -> tuple[tuple[Row, ...], Linkage | None]:
    """The generators of a plan's start errors, and how they move on; None where all are fixed in the world."""
    boxes = {"world": plan.start_box} if not plan.sources else dict(plan.sources)
    rows: list[Row] = []
    hole: list[Vector] = []
    hand: list[Row] = []
    for frame in FIXED_IN:
        for k, width in enumerate(boxes.get(frame, ())):
            if width > 0.0:
                g = row_of(fixed(width) if j == k else 0 for j in range(6))
                rows.append(g)
                hole.append(g[3:] if frame == "hole" else ZERO3)
                hand.append(g if frame == "hand" else NO_ROW)
    if not plan.sources:
        return tuple(rows), None
    none = (0.0,) * 6
    askew, grip = boxes.get("hole", none), boxes.get("hand", none)
    shift, turn, off, slant = (length(vector(box[k : k + 3])) for box in (askew, grip) for k in (0, 3))
    origin = vector(plan.segments[0].start[:3])
    return tuple(rows), Linkage(tuple(hole), tuple(hand), (shift, turn, off, slant), origin)
