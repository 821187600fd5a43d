"""Sets of pose errors e = (d, δ): an ellipsoid, and beside it the sum of a zonotope and an ellipsoid.

Errors that are fixed in the hole or in the hand, and so turn with a part as the other one moves.

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

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from fmopt.spatial import ellipsoid
from fmopt.spatial.se3 import cross, length, lengths
from fmopt.spatial.values import Array, Framing, Value, frozen

_NONE = np.zeros((0, 6))
_POINT = np.zeros((6, 0))
UNCOUPLED = frozen(np.zeros(2))

"""What the linear picture leaves of errors that are all fixed in the world: nothing."""


@dataclass(frozen=True, eq=False)
class ErrorSet(Value):
    """A set of error coordinates e = (d, δ) in m and rad, symmetric about zero, known from outside in two ways.

    Every error lies in the ellipsoid with root `shape_root` and also in the Minkowski sum of the zonotope
    {Σ uᵢ gᵢ, |uᵢ| ≤ 1} and the ellipsoids with roots `slide_root` and `swing_root`, of what errors of velocity add in
    translation and in rotation. Both stay true under linear maps and sums, so that of two bounds the smaller counts.
    The one ellipsoid is what cone constraints are written in; the sum spares the factor √6 that a box of six
    independent errors costs, and up to √2 that one ellipsoid around both drifts does. The generators are a core, images
    of the start box, and the thickness of contact surfaces.
    """

    shape_root: Array  # root (6, a) of the outer ellipsoid of everything
    generators: Array  # rows gᵢ (k, 6)
    slide_root: Array  # root (6, b)
    swing_root: Array = field(default_factory=lambda: _POINT)  # root (6, c)
    thick: int = 0
    # Twists (r, 6) along which contacts of that thickness give way
    compliant: Array = field(default_factory=lambda: _NONE)
    linkage: Linkage | None = None  # how the first generators move on with the part; None where all stay as they are

    def __post_init__(self) -> None:
        # Six columns at most: sums would let roots grow with each piece of motion.
        object.__setattr__(self, "shape_root", frozen(ellipsoid.narrow(self.shape_root, 6), 6, None, name="shape"))
        object.__setattr__(self, "generators", frozen(self.generators, None, 6, name="generators"))
        object.__setattr__(self, "slide_root", frozen(ellipsoid.narrow(self.slide_root, 6), 6, None, name="slide"))
        object.__setattr__(self, "swing_root", frozen(ellipsoid.narrow(self.swing_root, 6), 6, None, name="swing"))
        object.__setattr__(self, "compliant", frozen(self.compliant, None, 6, name="compliant twists"))

    @staticmethod
    def from_box(half_widths: ArrayLike) -> ErrorSet:
        """The box |eᵢ| ≤ aᵢ, half-widths a (6,) in m and rad; exact in its zonotope."""
        a = frozen(half_widths, 6, name="half-widths")
        # The box is exact as a zonotope; only its ellipsoid is wider, by √6 along the axes.
        return ErrorSet(ellipsoid.box_root(a), np.diag(a)[a > 0.0], _POINT)

    @staticmethod
    def of(half_widths: ArrayLike, framing: Framing) -> ErrorSet:
        """The box of start errors by half-widths (6,), m and rad, each share of it fixed where the framing says."""
        a = frozen(half_widths, 6, name="half-widths")
        generators, linkage = Linkage.of(a, framing)
        return ErrorSet(ellipsoid.box_root(a), generators, _POINT, linkage=linkage)

    @staticmethod
    def from_ellipsoid(shape: Array) -> ErrorSet:
        """The ellipsoid with this shape matrix (6, 6), exact."""
        root = ellipsoid.root(frozen(shape, 6, 6, name="shape"))
        # No generators: the sum of nothing and the ellipsoid, which is the same twice.
        return ErrorSet(root, _NONE, root)

    @cached_property
    def shape(self) -> Array:
        """Shape matrix (6, 6) of the outer ellipsoid."""
        return frozen(self.shape_root @ self.shape_root.T)

    def core(self, directions: Array) -> Array:
        """The generators (k, 6) that a motion with these held compliant twists (r, 6) carries on.

        The projection along the twists removes a thickness that lies in their span; else all of it is kept.
        """
        held = {direction.tobytes() for direction in directions}
        # Thickness is given up only if all contacts that it comes from are still held: it is then measured anew.
        if all(old.tobytes() in held for old in self.compliant):
            return self.generators[: len(self.generators) - self.thick]
        return self.generators

    @cached_property
    def _columns(self) -> Array:
        return np.hstack([self.generators.T, self.slide_root, self.swing_root, self.shape_root])

    def support(self, rows: ArrayLike) -> Array:
        """Bound min(|FᵀN|, Σ|g·N| + |AᵀN| + |BᵀN|) of N·e over the set along rows N (k, 6), or one row (6,).

        F is the root of the shape, A and B are those of slide and swing, g the generators.
        """
        cuts = np.cumsum([len(self.generators), self.slide_root.shape[1], self.swing_root.shape[1]])
        # All from one matrix product.
        spread, *roots = np.split(np.asarray(rows, dtype=np.float64) @ self._columns, cuts, axis=-1)
        slide, swing, shape = map(lengths, roots)
        return np.asarray(np.minimum(shape, np.abs(spread).sum(axis=-1) + slide + swing))

    def half_widths(self, generators: Array) -> Array:
        """Half-widths (6,) of the box around generators (k, 6) and both drifts, in m and rad."""
        return np.asarray(np.abs(generators).sum(axis=0) + lengths(self.slide_root) + lengths(self.swing_root))


@dataclass(frozen=True, eq=False)
class Linkage(Value, hole=(None, 3), hand=(None, 6), sizes=(4,)):
    """How generators (k, 6) of the start error move on with the part, the first ones of an error set."""

    hole: Array  # turns (k, 3) of the hole, rad; zero for generators that are not fixed there
    hand: Array  # generators (k, 6) that are fixed in the hand, as they are turned now, m and rad; zero for others
    sizes: Array  # of h_p, h, g_p and g_r at most (4,), m and rad
    origin: Array | None = None

    @staticmethod
    def of(box: Array, framing: Framing) -> tuple[Array, Linkage | None]:
        """Generators (k, 6) of a box (6,), m and rad, and how they move on; None where all stay as they are."""
        if framing.still:
            return np.diag(box)[box > 0.0], None
        hole, hand, world = framing.parts(box)
        # One generator for each component that has a share, in each of the frames: the shares vary independently.
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
        """Sizes of errors in different frames, and the greatest way from the origin of two positions (3,), m: (5,)."""
        origin = start if self.origin is None else self.origin
        return np.append(self.sizes, max(length(start - origin), length(goal - origin)))

    def moves(self, travel: Array, turn: Array, count: int) -> Array:
        """By how much generators (count, 6) move, if linked, as the part travels (3,), m, and turns (3, 3)."""
        found = np.zeros((count, 6))
        after = self.turned(turn).hand
        # What is fixed in the hand turns with the part; what is fixed in the hole stays and swings what has moved on.
        found[: len(self.hole)] = after - self.hand
        # A tilt of the hole seen from a part that has travelled: cross product of the tilt with the way.
        found[: len(self.hole), :3] += cross(self.hole, travel)
        return found

    @property
    def linked(self) -> int:
        """How many generators move on otherwise than the world's."""
        return int(np.count_nonzero(self.hole.any(axis=1) | self.hand.any(axis=1)))

    def turned(self, turn: Array) -> Linkage:
        """The linkage after the part has turned by a rotation (3, 3)."""
        return replace(self, hand=np.hstack([self.hand[:, :3] @ turn.T, self.hand[:, 3:] @ turn.T]))
