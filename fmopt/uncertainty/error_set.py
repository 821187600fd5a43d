"""Sets of pose errors e = (d, δ): an ellipsoid, and beside it the sum of a zonotope and an ellipsoid."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from fmopt import ellipsoid
from fmopt.framing import Framing
from fmopt.se3 import lengths
from fmopt.uncertainty.linkage import Linkage
from fmopt.values import Array, Value, frozen

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

    Args:
        shape_root: root (6, a) of the outer ellipsoid of everything.
        generators: rows gᵢ (k, 6).
        slide_root: root (6, b).
        swing_root: root (6, c).
        thick: how many generators, the last ones, are thickness.
        compliant: twists (r, 6) along which the contacts of that thickness give way.
        linkage: how the first generators move on with the part; None where all stay as they are.
    """

    shape_root: Array
    generators: Array
    slide_root: Array
    swing_root: Array = field(default_factory=lambda: _POINT)
    thick: int = 0
    compliant: Array = field(default_factory=lambda: _NONE)
    linkage: Linkage | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "shape_root", frozen(ellipsoid.narrow(self.shape_root, 6), 6, None, name="shape"))
        object.__setattr__(self, "generators", frozen(self.generators, None, 6, name="generators"))
        object.__setattr__(self, "slide_root", frozen(ellipsoid.narrow(self.slide_root, 6), 6, None, name="slide"))
        object.__setattr__(self, "swing_root", frozen(ellipsoid.narrow(self.swing_root, 6), 6, None, name="swing"))
        object.__setattr__(self, "compliant", frozen(self.compliant, None, 6, name="compliant twists"))

    @staticmethod
    def from_box(half_widths: ArrayLike) -> ErrorSet:
        """The box |eᵢ| ≤ aᵢ, half-widths a (6,) in m and rad; exact in its zonotope."""
        a = frozen(half_widths, 6, name="half-widths")
        return ErrorSet(ellipsoid.box_root(a), np.diag(a)[a > 0.0], _POINT)

    @staticmethod
    def of(half_widths: ArrayLike, framing: Framing) -> ErrorSet:
        """The box of start errors with half-widths (6,) in m and rad, each share of it fixed where the framing says."""
        a = frozen(half_widths, 6, name="half-widths")
        generators, linkage = Linkage.of(a, framing)
        return ErrorSet(ellipsoid.box_root(a), generators, _POINT, linkage=linkage)

    @staticmethod
    def from_ellipsoid(shape: Array) -> ErrorSet:
        """The ellipsoid with this shape matrix (6, 6), exact."""
        root = ellipsoid.root(frozen(shape, 6, 6, name="shape"))
        return ErrorSet(root, _NONE, root)

    @cached_property
    def shape(self) -> Array:
        """Shape matrix (6, 6) of the outer ellipsoid."""
        return frozen(self.shape_root @ self.shape_root.T)

    def growth(self, rho: float) -> Array:
        """Shape matrix (6, 6) of the ellipsoid of least trace around both drifts, in the metric of ρ, m."""
        root = ellipsoid.outer_sum(self.slide_root, self.swing_root, ellipsoid.metric(rho))
        return frozen(root @ root.T)

    def core(self, directions: Array) -> Array:
        """The generators (k, 6) that a motion with these held compliant twists (r, 6) carries on.

        The projection along the twists removes a thickness that lies in their span; else all of it is kept.
        """
        held = {direction.tobytes() for direction in directions}
        if all(old.tobytes() in held for old in self.compliant):
            return self.generators[: len(self.generators) - self.thick]
        return self.generators

    @cached_property
    def bound(self) -> Support:
        """The support function of the whole set."""
        return Support.of(self.generators, self)

    def support(self, rows: ArrayLike) -> Array:
        """Bound of N·e over the set along rows N (k, 6), or one row (6,); see `Support`."""
        return self.bound(np.asarray(rows, dtype=np.float64))

    def half_widths(self, generators: Array) -> Array:
        """Half-widths (6,) of the box around generators (k, 6) and both drifts, in m and rad."""
        return np.asarray(np.abs(generators).sum(axis=0) + lengths(self.slide_root) + lengths(self.swing_root))


@dataclass(frozen=True, eq=False)
class Support:
    """How far errors reach along rows: min(|FᵀN|, Σ|g·N| + |AᵀN| + |BᵀN|) + Σ|s·N|, all from one matrix product.

    Args:
        columns: (6, k), generators, roots A and B of slide and swing, root F of the shape, and slack s, side by side.
        cuts: where each of these ends.
    """

    columns: Array
    cuts: tuple[int, int, int, int]

    @staticmethod
    def of(generators: Array, errors: ErrorSet, slack: Array | None = None) -> Support:
        """The support of generators (k, 6) with the ellipsoids of a set, and of slack columns (6, s) on top."""
        parts = [generators.T, errors.slide_root, errors.swing_root, errors.shape_root]
        first = len(generators)
        second = first + errors.slide_root.shape[1]
        third = second + errors.swing_root.shape[1]
        fourth = third + errors.shape_root.shape[1]
        return Support(np.hstack(parts if slack is None else [*parts, slack]), (first, second, third, fourth))

    def seen(self, X: Array) -> Array:
        """The bound (…) from the products N·columns (…, k)."""
        first, second, third, fourth = self.cuts
        reach = np.add.reduce(np.abs(X[..., :first]), axis=-1)
        for begin, end in ((first, second), (second, third)):
            if end > begin:
                reach += lengths(X[..., begin:end])
        reach = np.minimum(lengths(X[..., third:fourth]), reach)
        if X.shape[-1] > fourth:
            reach += np.add.reduce(np.abs(X[..., fourth:]), axis=-1)
        return np.asarray(reach)

    def __call__(self, N: Array) -> Array:
        """The bound (k,) along rows N (k, 6)."""
        return self.seen(N @ self.columns)
