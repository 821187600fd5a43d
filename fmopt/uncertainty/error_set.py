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
UNCOUPLED = frozen(np.zeros(2))
"""What the linear picture leaves of errors that are all fixed in the world: nothing."""


@dataclass(frozen=True, eq=False)
class ErrorSet(Value):
    """A set of error coordinates e = (d, δ) in m and rad, symmetric about zero, known from outside in two ways.

    Every error lies in the ellipsoid with root `shape_root` and also in the Minkowski sum of the zonotope
    {Σ uᵢ gᵢ, |uᵢ| ≤ 1} and the ellipsoid with root `growth_root`. Both stay true under linear maps and sums, so that
    of two bounds the smaller counts. The ellipsoid is what cone constraints are written in; the zonotope spares the
    factor √6 that a box of six independent errors costs. The generators are a core, images of the start box, and the
    thickness of contact surfaces.

    Args:
        shape_root: root (6, a) of the outer ellipsoid of everything.
        generators: rows gᵢ (k, 6).
        growth_root: root (6, b).
        thick: how many generators, the last ones, are thickness.
        compliant: twists (r, 6) along which the contacts of that thickness give way.
        linkage: how the first generators move on with the part; None where all stay as they are.
    """

    shape_root: Array
    generators: Array
    growth_root: Array
    thick: int = 0
    compliant: Array = field(default_factory=lambda: _NONE)
    linkage: Linkage | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "shape_root", frozen(ellipsoid.narrow(self.shape_root, 6), 6, None, name="shape"))
        object.__setattr__(self, "generators", frozen(self.generators, None, 6, name="generators"))
        object.__setattr__(self, "growth_root", frozen(ellipsoid.narrow(self.growth_root, 6), 6, None, name="growth"))
        object.__setattr__(self, "compliant", frozen(self.compliant, None, 6, name="compliant twists"))

    @staticmethod
    def from_box(half_widths: ArrayLike) -> ErrorSet:
        """The box |eᵢ| ≤ aᵢ, half-widths a (6,) in m and rad; exact in its zonotope."""
        a = frozen(half_widths, 6, name="half-widths")
        return ErrorSet(ellipsoid.box_root(a), np.diag(a)[a > 0.0], np.zeros((6, 0)))

    @staticmethod
    def of(half_widths: ArrayLike, framing: Framing) -> ErrorSet:
        """The box of start errors with half-widths (6,) in m and rad, each share of it fixed where the framing says."""
        a = frozen(half_widths, 6, name="half-widths")
        generators, linkage = Linkage.of(a, framing)
        return ErrorSet(ellipsoid.box_root(a), generators, np.zeros((6, 0)), linkage=linkage)

    @staticmethod
    def from_ellipsoid(shape: Array) -> ErrorSet:
        """The ellipsoid with this shape matrix (6, 6), exact."""
        root = ellipsoid.root(frozen(shape, 6, 6, name="shape"))
        return ErrorSet(root, _NONE, root)

    @cached_property
    def shape(self) -> Array:
        """Shape matrix (6, 6) of the outer ellipsoid."""
        return frozen(self.shape_root @ self.shape_root.T)

    @cached_property
    def growth(self) -> Array:
        """Shape matrix (6, 6) of the ellipsoid beside the zonotope."""
        return frozen(self.growth_root @ self.growth_root.T)

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
        """Half-widths (6,) of the box around generators (k, 6) and the growth, in m and rad."""
        return np.asarray(np.abs(generators).sum(axis=0) + lengths(self.growth_root))


@dataclass(frozen=True, eq=False)
class Support:
    """How far errors reach along rows: min(|FᵀN|, Σ|g·N| + |GᵀN|) + Σ|s·N|, all from one matrix product.

    Args:
        columns: (6, k), generators, root G of the growth, root F of the shape, and slack s, side by side.
        cuts: where each of these ends.
    """

    columns: Array
    cuts: tuple[int, int, int]

    @staticmethod
    def of(generators: Array, errors: ErrorSet, slack: Array | None = None) -> Support:
        """The support of generators (k, 6) with the ellipsoids of a set, and of slack columns (6, s) on top."""
        parts = [generators.T, errors.growth_root, errors.shape_root]
        first = len(generators)
        second = first + errors.growth_root.shape[1]
        third = second + errors.shape_root.shape[1]
        return Support(np.hstack(parts if slack is None else [*parts, slack]), (first, second, third))

    def seen(self, X: Array) -> Array:
        """The bound (…) from the products N·columns (…, k)."""
        first, second, third = self.cuts
        reach = np.add.reduce(np.abs(X[..., :first]), axis=-1)
        if second > first:
            reach += lengths(X[..., first:second])
        reach = np.minimum(lengths(X[..., second:third]), reach)
        if X.shape[-1] > third:
            reach += np.add.reduce(np.abs(X[..., third:]), axis=-1)
        return np.asarray(reach)

    def __call__(self, N: Array) -> Array:
        """The bound (k,) along rows N (k, 6)."""
        return self.seen(N @ self.columns)
