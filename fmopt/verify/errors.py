"""Error sets in fixed point: outer descriptions of where the pose error can be."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

from fmopt.verify.document import Plan
from fmopt.verify.linear import NOTHING, SIX, diagonal, outer_sum
from fmopt.verify.linkage import Linkage, linkage_of
from fmopt.verify.rational import BLUR, Row, Square, fixed, root, spread, times, width


@dataclass(frozen=True)
class ErrorSet:
    """Errors known from outside in two ways: in Zonotope(core, thickness) ⊕ slide ⊕ swing, and in shape.

    Attributes:
        core: generators that are images of the start box.
        thick: generators of the thickness of the last piece's contact surfaces.
        slide: shape matrix (6, 6) of the ellipsoid of what velocity errors add in translation.
        swing: shape matrix (6, 6) of the ellipsoid of what they add in rotation.
        shape: shape matrix (6, 6) of the ellipsoid around everything.
        linkage: how the first generators of the core move on with the part; None where all stay as they are.
    """

    core: tuple[Row, ...]
    thick: tuple[Row, ...]
    slide: Square
    swing: Square
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
        return around if around <= inside else min(around, inside + self.drift(N))

    def drift(self, N: Row) -> int:
        """Bound of N·e over what velocity errors add."""
        return width(self.slide, N) + width(self.swing, N)

    def ellipsoids(self, weights: Row) -> tuple[tuple[str, Square], ...]:
        """Shapes by their names in a plan; `growth` has the least trace around both drifts in a metric."""
        growth = outer_sum(self.slide, self.swing, weights)
        return ("shape", self.shape), ("slide", self.slide), ("swing", self.swing), ("growth", growth)

    def half_widths(self, thick: Sequence[Row]) -> list[int]:
        """Half-widths (6,) of the box around core, this thickness and drifts."""
        gens = (*self.core, *thick)
        return [sum(abs(g[a]) for g in gens) + sum(root(Q[a][a] + BLUR) for Q in (self.slide, self.swing)) for a in SIX]


def start_errors(plan: Plan) -> ErrorSet:
    """The start box |eₐ| ≤ half-width of a plan; its ellipsoid is stretched by the root of the number of axes."""
    a = [fixed(x) for x in plan.start_box]
    axes = [k for k in SIX if a[k] > 0]
    shape = diagonal([len(axes) * times(x, x) + (BLUR if x else 0) for x in a]) if axes else NOTHING
    core, linkage = linkage_of(plan)
    return ErrorSet(core, (), NOTHING, NOTHING, shape, linkage)
