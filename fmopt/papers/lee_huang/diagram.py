"""What of a cut-diagram can touch: straight edges, convex corners with their normals, and circular arcs."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from fmopt.geometry.plane.curve import Arc, Curve, LineSegment
from fmopt.geometry.plane.region import Region
from fmopt.spatial.values import Array, Value

_SMOOTH = 1e-9  # rad, a turn below which two curves meet without a corner


@dataclass(frozen=True, eq=False)
class PlaneDiagram(Value, ends=(None, 2, 2), points=(None, 2), fans=(None, 2)):
    """The features of a region on a plane.

    Args:
        ends: where straight edges start and end (n, 2, 2), m, the interior on the left.
        points: convex corners (k, 2), m.
        fans: bearing of each corner's first outward normal, and how far these open (k, 2), rad.
        arcs: circular arcs; the interior lies outside the circles of those that run clockwise.
    """

    ends: Array
    points: Array
    fans: Array
    arcs: tuple[Arc, ...]

    @cached_property
    def size(self) -> float:
        """Largest distance of a feature from the origin, m."""
        return self._farthest(2)

    @property
    def width(self) -> float:
        """Largest coordinate of a feature in size, m."""
        return self._farthest(np.inf)

    def _farthest(self, order: float) -> float:
        points = np.vstack([self.ends[:, 0], self.points])
        far = [float(np.linalg.norm(points, order, axis=1).max(initial=0.0))]
        return max(far + [float(np.linalg.norm(arc.centre, order)) + arc.radius for arc in self.arcs])

    @cached_property
    def normals(self) -> Array:
        """Unit outward normals (n, 2) of the edges."""
        along = self.ends[:, 1] - self.ends[:, 0]
        return np.asarray(along[:, ::-1] * (1.0, -1.0) / np.linalg.norm(along, axis=1)[:, None])


def of_region(region: Region, tolerance: float = 0.0) -> PlaneDiagram:
    """The features of a region of the plane.

    Circular arcs stay as they are where the tolerance (m) is 0; else they become polylines within it. Conics always do,
    within 1e-9 of the region's size where it is 0. Polylines contain the region: what they leave free is free.
    """
    loops = [[one for curve in loop for one in _features(curve, tolerance, region.size)] for loop in region.loops]
    curves = [curve for loop in loops for curve in loop]
    corners = [corner for loop in loops for pair in pairwise([*loop, loop[0]]) for corner in _corner(*pair)]
    return PlaneDiagram(
        np.reshape([(curve.start, curve.end) for curve in curves if isinstance(curve, LineSegment)], (-1, 2, 2)),
        np.reshape([point for point, _, _ in corners], (-1, 2)),
        np.reshape([fan for _, *fan in corners], (-1, 2)),
        tuple(curve for curve in curves if isinstance(curve, Arc)),
    )


def disc(region: Region) -> PlaneDiagram | None:
    """The one arc of a region that is a disc about the origin, to 1e-9 of its radius; None for any other region."""
    arcs = [curve for curve in region.curves if isinstance(curve, Arc)]
    if not arcs or len(arcs) < len(region.curves) or len(region.loops) != 1:
        # Arcs alone, in one loop: the disc may be cut into several arcs of one circle.
        return None
    radius = arcs[0].radius
    round_ = all(abs(arc.radius - radius) + float(np.abs(arc.centre).max()) <= 1e-9 * radius for arc in arcs)
    return of_region(Region(((Arc(np.zeros(2), radius, 0.0, math.tau),),))) if round_ else None


def _features(curve: Curve, tolerance: float, size: float) -> list[LineSegment | Arc]:
    if isinstance(curve, Arc) and tolerance == 0.0:
        return [curve]
    # On the right, outside of the region: contact is then seen no later than it can occur.
    return [LineSegment(a, b) for a, b in pairwise(curve.polyline(tolerance or 1e-9 * size, "right")) if np.any(a != b)]


def _corner(one: LineSegment | Arc, other: LineSegment | Arc) -> Iterator[tuple[Array, float, float]]:
    """Point, first normal and opening of the corner where a curve ends and the next begins; none when it is reflex."""
    # The sine and cosine of the turn: a reflex corner has a negative one, and touches nothing.
    a, b = one.tangent(1.0), other.tangent(0.0)
    opening = math.atan2(a[0] * b[1] - a[1] * b[0], float(a @ b))
    if opening > _SMOOTH:
        yield one.last, math.atan2(-a[0], a[1]), opening
