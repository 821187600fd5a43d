"""Error sets as a certificate carries them: with roots of their ellipsoids, and with the thickness told from the core.

A contact that is held makes the ellipsoids flat. From a shape matrix in floating point, √(NᵀQN) of a direction that
is flat comes out as 1e-12 m of noise; from a root F with Q = F Fᵀ it comes out as 1e-19 m.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from fmopt import ellipsoid
from fmopt.certificate.rows import length, lengths
from fmopt.uncertainty.error_set import ErrorSet
from fmopt.values import Array, frozen

_WIDTH = 18  # columns that a root may have while sums are taken


@dataclass(frozen=True, eq=False)
class Spread(ErrorSet):
    """An error set whose generators are a core, images of the start box, and the thickness of contact surfaces.

    Args:
        shape_root: (6, a), shape = shape_root shape_rootᵀ.
        growth_root: (6, b), growth = growth_root growth_rootᵀ.
        thick: how many generators, the last ones, are thickness.
        compliant: twists (r, 6) along which the contacts of that thickness give way.
    """

    shape_root: Array
    growth_root: Array
    thick: int
    compliant: Array

    @staticmethod
    def of(errors: ErrorSet) -> Spread:
        """The error set with roots; all its generators count as core, unless they are known."""
        if isinstance(errors, Spread):
            return errors
        roots = (_root(errors.shape), _root(errors.growth))
        return Spread(errors.shape, errors.generators, errors.growth, *roots, 0, np.zeros((0, 6)))

    @staticmethod
    def made(generators: Array, shape_root: Array, growth_root: Array, thick: int, compliant: Array) -> Spread:
        """The set of these parts."""
        shape, growth = frozen(_narrow(shape_root, 6)), frozen(_narrow(growth_root, 6))
        return Spread(shape @ shape.T, generators, growth @ growth.T, shape, growth, thick, frozen(compliant))

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
        """Bound of N·e over the set along rows N (k, 6), or one row (6,); see `ErrorSet.support`."""
        return self.bound(np.asarray(rows, dtype=np.float64))

    def half_widths(self, generators: Array) -> Array:
        """Half-widths (6,) of the box around generators (k, 6) and the growth, in m and rad."""
        return np.asarray(np.abs(generators).sum(axis=0) + lengths(self.growth_root))


@dataclass(frozen=True, eq=False)
class Support:
    """How far errors reach along rows: min(√(NᵀQN), Σ|g·N| + √(NᵀGN)) + Σ|s·N|, all from one matrix product.

    Args:
        columns: (6, k), generators, root of the growth, root of the shape, and slack, side by side.
        cuts: where each of these ends.
    """

    columns: Array
    cuts: tuple[int, int, int]

    @staticmethod
    def of(generators: Array, errors: Spread, slack: Array | None = None) -> Support:
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


def _root(Q: Array) -> Array:
    diagonal = np.diag(Q)
    if np.array_equal(Q, np.diag(diagonal)):
        return np.asarray(np.diag(np.sqrt(diagonal))[:, diagonal > 0.0])
    return ellipsoid.root(Q)


def summed(F1: Array, F2: Array, weights: Array) -> Array:
    """A root of the ellipsoid of least trace around the sum of two that are given by roots (6, a), (6, b).

    As `ellipsoid.outer_sum`: (1 + 1/p) Q₁ + (1 + p) Q₂ with p = √tr Q₁/√tr Q₂ in the metric of the weights (6,).
    """
    s1, s2 = (length((weights[:, None] * F).ravel()) for F in (F1, F2))
    if s1 == 0.0 or s2 == 0.0:
        return F2 if s1 == 0.0 else F1
    return _narrow(np.hstack([np.sqrt(1.0 + s2 / s1) * F1, np.sqrt(1.0 + s1 / s2) * F2]), _WIDTH)


def _narrow(F: Array, most: int) -> Array:
    """A root of the same ellipsoid with no more columns than that, six at the least."""
    return F if F.shape[1] <= most else np.asarray(np.linalg.qr(F.T).R.T)
