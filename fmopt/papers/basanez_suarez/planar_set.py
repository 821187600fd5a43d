"""What every planar uncertainty set can be asked: membership, distance, support, boundary, area, polygons.

Polygons on a chosen side of boundaries of arcs and segments.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Literal, Self

import numpy as np
from numpy.typing import ArrayLike
from shapely import MultiPolygon, get_parts

from fmopt.errors import GeometryError
from fmopt.geometry.plane.chords import enclosed
from fmopt.geometry.plane.curve import Side as CurveSide
from fmopt.papers.basanez_suarez.boundary import BoundaryPiece, Loop, moved, outline
from fmopt.spatial.values import Array, Bits, Value

ROUNDING = 1e-9  # of the size
Side = Literal["inside", "outside"]
SIDES: dict[Side, CurveSide] = {"inside": "left", "outside": "right"}


class PlanarSet(Value, ABC):
    """A core curve or region widened by a disc of radius `radius`: {x : distance of x from the core ≤ radius}."""

    radius: float

    @property
    @abstractmethod
    def size(self) -> float:
        """A length that bounds the set's extent from its own centre, m; tolerances are relative to it."""

    @property
    @abstractmethod
    def origin(self) -> Array:
        """A point (2,) near the set, m, that `displaced` carries along."""

    @abstractmethod
    def displaced(self, by: Array) -> Self:
        """The set displaced by a vector (2,) in m."""

    @abstractmethod
    def widened(self, radius: float) -> Self:
        """The Minkowski sum with a further disc of this radius in m."""

    @abstractmethod
    def core_distance(self, points: ArrayLike) -> Array:
        """Distance (…) in m of points (…, 2) from the core."""

    @abstractmethod
    def support(self, directions: ArrayLike) -> Array:
        """max n·x over the set, (…) in m, for directions n (…, 2) that need not be unit vectors."""

    @abstractmethod
    def candidates(self) -> list[BoundaryPiece]:
        """Directed curves that contain the boundary, the set on their left."""

    def contains(self, points: ArrayLike) -> Bits:
        """Whether points (…, 2) in m lie in the closed set, to 1e-9 of its size."""
        return np.asarray(self.core_distance(points) <= self.radius + ROUNDING * self.size)

    def distance(self, points: ArrayLike) -> Array:
        """Distance (…) in m of points (…, 2) from the set, 0 inside."""
        return np.asarray(np.maximum(self.core_distance(points) - self.radius, 0.0))

    def boundary(self) -> tuple[Loop, ...]:
        """The boundary as closed loops of exact arcs and segments, the set on their left.

        Holes run clockwise. A set without interior is run along both its sides; a single point has no loop.

        Raises:
            GeometryError: two features differ by less than the tolerance without being one.
        """
        # Moved to its own origin: tolerances are of its size, not of where it lies.
        here = self.displaced(-self.origin)
        return moved(outline(here.candidates(), here.core_distance, here.radius, here.size), self.origin)

    def area(self) -> float:
        """Area in m², by Green's theorem along the boundary."""
        return max(float(sum(piece.curve.moment() for loop in self.boundary() for piece in loop)), 0.0)

    def polygon(self, tolerance: float, side: Side) -> MultiPolygon:
        """A polygon that contains the set, or lies in it, each arc replaced within `tolerance`, m.

        No point of the outer one is farther from the set than that. Where the set, or a gap in it, is thinner, the
        polygon is cut off or closed. A set without interior is first widened by half the tolerance to be contained.

        Raises:
            GeometryError: the tolerance is not positive.
        """
        if not tolerance > 0.0:
            raise GeometryError(f"polygon of an uncertainty set to a tolerance of {tolerance} m", "give a positive one")
        loops = self.boundary()
        area = sum(float(piece.curve.moment()) for loop in loops for piece in loop)
        if side == "inside" or area > (ROUNDING * self.size) ** 2:
            return polygon(loops, tolerance, side)
        # A set of no area has no outside to bulge to: it is widened by half the tolerance first.
        return polygon(self.widened(0.5 * tolerance).boundary(), 0.5 * tolerance, side)


def polygon(loops: Sequence[Loop], tolerance: float, side: Side) -> MultiPolygon:
    """The polygon of loops that have their set on the left, within a tolerance (m); see `PlanarSet.polygon`.

    Chords where an arc bulges away from the chosen side, tangents where it bulges to it. Each arc is moved within the
    set, or its complement, so that points that a thin place lets the polygon run round wrongly have winding number 0.
    """
    rings = [np.vstack([piece.curve.polyline(tolerance, SIDES[side])[:-1] for piece in loop]) for loop in loops]
    closed = [np.vstack([points, points[:1]]) for points in rings if len(points) > 2]
    # Polylines may cross where curves do not: what they bound is told by winding numbers, face by face.
    parts = get_parts(enclosed(closed, rounded=False)) if closed else ()
    return MultiPolygon([part for part in parts if part.area > 0.0])
