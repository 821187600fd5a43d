"""Error sets in fixed point: outer descriptions of where the pose error can be."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

from fmopt.verify.document import Plan
from fmopt.verify.linear import NOTHING, SIX, diagonal
from fmopt.verify.linkage import Linkage, linkage_of
from fmopt.verify.rational import BLUR, Row, Square, fixed, root, spread, times, width


@dataclass(frozen=True)
class ErrorSet:
    """Errors known from outside in two ways: inside Zonotope(core, thickness) ⊕ Ellipsoid(growth) and Ellipsoid(shape).

    Attributes:
        core: generators that are images of the start box.
        thick: generators of the thickness of the last piece's contact surfaces.
        growth: shape matrix (6, 6).
        shape: shape matrix (6, 6).
        linkage: how the first generators of the core move on with the part; None where all stay as they are.
    """

    core: tuple[Row, ...]
    thick: tuple[Row, ...]
    growth: Square
    shape: Square
    linkage: Linkage | None = None

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


def start_errors(plan: Plan) -> ErrorSet:
    """The start box |eₐ| ≤ half-width of a plan; its ellipsoid is stretched by the root of the number of axes."""
    a = [fixed(x) for x in plan.start_box]
    axes = [k for k in SIX if a[k] > 0]
    shape = diagonal([len(axes) * times(x, x) + (BLUR if x else 0) for x in a]) if axes else NOTHING
    core, linkage = linkage_of(plan)
    return ErrorSet(core, (), NOTHING, shape, linkage)
