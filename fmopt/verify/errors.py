"""Error sets in fixed point: outer descriptions of where the pose error can be."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

from fmopt.verify.linear import NOTHING, SIX, diagonal, row_of
from fmopt.verify.rational import BLUR, Row, Square, fixed, root, spread, times, width


@dataclass(frozen=True)
class ErrorSet:
    """Errors known from outside in two ways: inside Zonotope(core, thickness) ⊕ Ellipsoid(growth) and Ellipsoid(shape).

    Attributes:
        core: generators that are images of the start box.
        thick: generators of the thickness of the last piece's contact surfaces.
        growth: shape matrix (6, 6).
        shape: shape matrix (6, 6).
    """

    core: tuple[Row, ...]
    thick: tuple[Row, ...]
    growth: Square
    shape: Square

    @cached_property
    def generators(self) -> tuple[Row, ...]:
        """All generators."""
        return self.core + self.thick

    def support(self, N: Row) -> int:
        """Bound of N·e over the set."""
        return self._support(self.generators, N)

    def core_support(self, N: Row) -> int:
        """Bound of N·e over the set without its thickness."""
        return self._support(self.core, N)

    def _support(self, generators: Sequence[Row], N: Row) -> int:
        around, inside = width(self.shape, N), spread(generators, N)
        return around if around <= inside else min(around, inside + width(self.growth, N))

    def half_widths(self, thick: Sequence[Row]) -> list[int]:
        """Half-widths (6,) of the box around core, this thickness and growth."""
        gens = (*self.core, *thick)
        return [sum(abs(g[a]) for g in gens) + root(self.growth[a][a] + BLUR) for a in SIX]


def from_box(half_widths: Sequence[float]) -> ErrorSet:
    """The box |eₐ| ≤ half-width; its ellipsoid is stretched by the root of the number of axes."""
    a = [fixed(x) for x in half_widths]
    axes = [k for k in SIX if a[k] > 0]
    core = tuple(row_of(a[k] if j == k else 0 for j in SIX) for k in axes)
    shape = diagonal([len(axes) * times(x, x) + (BLUR if x else 0) for x in a]) if axes else NOTHING
    return ErrorSet(core, (), NOTHING, shape)
