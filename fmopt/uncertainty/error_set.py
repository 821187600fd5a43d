"""Sets of pose errors e = (d, δ): an ellipsoid, and beside it the sum of a zonotope and an ellipsoid."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import ArrayLike

from fmopt import ellipsoid
from fmopt.values import Array, Value, frozen

_SIGNED = 10


@dataclass(frozen=True, eq=False)
class ErrorSet(Value):
    """A set of error coordinates e = (d, δ) in m and rad, symmetric about zero, known from outside in two ways.

    Every error lies in the ellipsoid `shape` and also in the Minkowski sum of the zonotope
    {Σ uᵢ gᵢ, |uᵢ| ≤ 1} and the ellipsoid `growth`. Both stay true under linear maps and sums, so that of two
    bounds the smaller counts. The ellipsoid is what cone constraints are written in; the zonotope spares the
    factor √6 that a box of six independent errors costs.

    Args:
        shape: shape matrix (6, 6) of the outer ellipsoid of everything.
        generators: rows gᵢ (k, 6).
        growth: shape matrix (6, 6).
    """

    shape: Array
    generators: Array
    growth: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "shape", frozen(self.shape, 6, 6, name="shape"))
        object.__setattr__(self, "generators", frozen(self.generators, None, 6, name="generators"))
        object.__setattr__(self, "growth", frozen(self.growth, 6, 6, name="growth"))

    @staticmethod
    def zero() -> ErrorSet:
        """The set of no error."""
        return ErrorSet(np.zeros((6, 6)), np.zeros((0, 6)), np.zeros((6, 6)))

    @staticmethod
    def from_box(half_widths: ArrayLike) -> ErrorSet:
        """The box |eᵢ| ≤ aᵢ, half-widths a (6,) in m and rad; exact in its zonotope."""
        a = np.asarray(half_widths, dtype=np.float64)
        return ErrorSet(ellipsoid.box_shape(a), np.diag(a)[a > 0.0], np.zeros((6, 6)))

    @staticmethod
    def from_ellipsoid(shape: Array) -> ErrorSet:
        """The ellipsoid with this shape matrix (6, 6), exact."""
        return ErrorSet(shape, np.zeros((0, 6)), shape)

    @staticmethod
    def from_zonotope(generators: Array, rho: float) -> ErrorSet:
        """The zonotope of these rows (k, 6), exact; ρ (m) weighs angles when its outer ellipsoid is chosen."""
        shape = ellipsoid.zonotope_shape(generators, ellipsoid.metric(rho))
        return ErrorSet(shape, generators, np.zeros((6, 6)))

    def image(self, A: Array) -> ErrorSet:
        """The image under the linear map A (6, 6), exact for both descriptions."""
        return ErrorSet(ellipsoid.image(self.shape, A), self.generators @ A.T, ellipsoid.image(self.growth, A))

    def plus(self, shape: Array, rho: float) -> ErrorSet:
        """The Minkowski sum with an ellipsoid, by outer ellipsoids of least trace.

        Args:
            shape: shape matrix (6, 6) of the summand.
            rho: length in m that weighs angles against translations in the trace.
        """
        weights = ellipsoid.metric(rho)
        return ErrorSet(
            ellipsoid.outer_sum(self.shape, shape, weights),
            self.generators,
            ellipsoid.outer_sum(self.growth, shape, weights),
        )

    def plus_zonotope(self, generators: Array, rho: float) -> ErrorSet:
        """The Minkowski sum with the zonotope of these rows (k, 6), exact in the second description.

        Args:
            generators: rows (k, 6); rows of zeros are left out.
            rho: length in m that weighs angles against translations in the trace.
        """
        weights = ellipsoid.metric(rho)
        G = generators[np.any(generators != 0.0, axis=1)]
        shape = ellipsoid.outer_sum(self.shape, ellipsoid.zonotope_shape(G, weights), weights)
        return ErrorSet(shape, np.vstack([self.generators, G]), self.growth)

    def support(self, rows: ArrayLike) -> Array:
        """Bound of N·e over the set, min(√(NᵀQN), Σ|gᵢ·N| + √(NᵀGN)).

        Args:
            rows: N (k, 6), or one row (6,).

        Returns:
            (k,), or a scalar array for one row.
        """
        N = np.asarray(rows, dtype=np.float64)
        zonotope = np.abs(N @ self.generators.T).sum(axis=-1) + ellipsoid.support(self.growth, N)
        return np.asarray(np.minimum(ellipsoid.support(self.shape, N), zonotope))

    def translation_bound(self) -> float:
        """Upper bound of |d| over the set, in m."""
        return self._length_bound(slice(0, 3))

    def angle_bound(self) -> float:
        """Upper bound of |δ| over the set, in rad."""
        return self._length_bound(slice(3, 6))

    def _length_bound(self, part: slice) -> float:
        outer = _largest_radius(self.shape[part, part])
        return min(outer, _zonotope_radius(self.generators[:, part]) + _largest_radius(self.growth[part, part]))


def _largest_radius(Q: Array) -> float:
    return float(np.sqrt(max(np.linalg.eigvalsh(Q)[-1], 0.0)))


def _zonotope_radius(generators: Array) -> float:
    """Bound of |Σ ±gᵢ| over rows gᵢ (k, 3): all signs of the longest ten, and the lengths of the others."""
    lengths = np.linalg.norm(generators, axis=1)
    order = np.argsort(-lengths)
    G, rest = generators[order[:_SIGNED]], float(lengths[order[_SIGNED:]].sum())
    signs = np.array(list(product((-1.0, 1.0), repeat=len(G))))
    return float(np.linalg.norm(signs @ G, axis=1).max()) + rest
