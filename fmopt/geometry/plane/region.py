"""Plane regions bounded by closed loops of exact curves, the interior on the left; coordinates in m."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from fmopt.errors import GeometryError
from fmopt.geometry.plane.chords import CHORD, chords, filled
from fmopt.geometry.plane.curve import Curve, LineSegment, boxes_of, distance
from fmopt.geometry.plane.meet import meet
from fmopt.spatial.values import Array, Bits, Value

if TYPE_CHECKING:
    from shapely.geometry.base import BaseGeometry

_CLOSED = 1e-8  # of the size: shared ends agree to rounding


@dataclass(frozen=True, eq=False)
class Region(Value):
    """A regular closed set of the plane; without loops it is empty.

    Args:
        loops: closed chains of curves with the interior on their left, outer ones counter-clockwise, holes clockwise.

    Raises:
        GeometryError: a loop is open.
    """

    loops: tuple[tuple[Curve, ...], ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "loops", tuple(tuple(loop) for loop in self.loops))
        for number, loop in enumerate(self.loops):
            ends = np.array([curve.last for curve in loop]).reshape(-1, 2)
            starts = np.array([curve.first for curve in loop]).reshape(-1, 2)
            gap = float(np.max(np.abs(ends - np.roll(starts, -1, axis=0)), initial=0.0))
            if not loop or gap > _CLOSED * float(np.max(np.abs(starts), initial=0.0)):
                raise GeometryError(
                    f"loop {number} of a region is open by {gap:g} m", "let every curve begin where the last one ended"
                )

    @property
    def curves(self) -> tuple[Curve, ...]:
        """All boundary curves."""
        return tuple(curve for loop in self.loops for curve in loop)

    @property
    def empty(self) -> bool:
        """Whether the region has no point."""
        return not self.loops

    @cached_property
    def area(self) -> float:
        """Area in m², by Green's theorem."""
        return float(sum(curve.moment() for curve in self.curves))

    @cached_property
    def box(self) -> tuple[Array, Array]:
        """Lower and upper corner (2,) of the bounding box.

        Raises:
            GeometryError: the region is empty.
        """
        if self.empty:
            raise GeometryError("an empty region has no bounding box", "test Region.empty first")
        boxes = boxes_of(self.curves)
        return boxes[:, :2].min(axis=0), boxes[:, 2:].max(axis=0)

    @property
    def size(self) -> float:
        """Diagonal of the bounding box in m, 0 when empty."""
        return 0.0 if self.empty else float(np.hypot(*(self.box[1] - self.box[0])))

    @cached_property
    def shape(self) -> BaseGeometry:
        """What the loops wind round at least once, curves as chords within 1e-6 of the size, prepared."""
        import shapely

        lines = [
            np.vstack([*(chords(curve, CHORD * self.size)[:-1] for curve in loop), loop[0].first])
            for loop in self.loops
        ]
        found = filled(lines)
        shapely.prepare(found)
        return found

    def contains(self, points: ArrayLike) -> Bits:
        """Whether each of `points` (n, 2) lies inside, shape (n,); on the boundary rounding decides."""
        import shapely

        points = np.asarray(points, dtype=np.float64).reshape(-1, 2)
        inside = np.asarray(shapely.contains_xy(self.shape, points), dtype=np.bool_)
        # Between a chord and its curve the curve decides: on which side of it the point lies.
        reach = CHORD * self.size
        bent = [curve for curve in self.curves if not isinstance(curve, LineSegment)]
        near = shapely.dwithin(self.shape.boundary, shapely.points(points), reach) if bent else np.zeros(0, dtype=bool)
        for k in np.flatnonzero(near).tolist():
            apart, number = min((float(distance(curve, points[k, None])[0]), c) for c, curve in enumerate(bent))
            curve = bent[number]
            t = float(curve.nearest(points[k, None])[0])
            if apart <= reach and 0.0 < t < 1.0:
                along, off = curve.tangent(t), points[k] - curve.point(t)
                inside[k] = along[0] * off[1] - along[1] * off[0] >= 0.0
        return inside

    def boundary_distance(self, points: ArrayLike) -> Array:
        """Distance (n,) in m of `points` (n, 2) from the boundary, infinite for the empty region."""
        points = np.asarray(points, dtype=np.float64).reshape(-1, 2)
        nearest = np.full(len(points), np.inf)
        boxes = self._boxes
        far = np.full(len(points), np.inf)
        for lower, upper in boxes:
            # Every box has a point of the boundary within its farthest corner: an upper bound, which spares most
            # curves.
            far = np.minimum(far, np.hypot(*np.maximum(np.abs(points - lower), np.abs(points - upper)).T))
        for curve, (lower, upper) in zip(self.curves, boxes, strict=True):
            beyond = np.maximum(np.maximum(lower - points, points - upper), 0.0)
            asked = np.flatnonzero(np.hypot(*beyond.T) <= np.minimum(far, nearest))
            if asked.size:
                nearest[asked] = np.minimum(nearest[asked], distance(curve, points[asked]))
        return nearest

    @cached_property
    def _boxes(self) -> list[tuple[Array, Array]]:
        return [curve.box for curve in self.curves]

    def distance(self, points: ArrayLike) -> Array:
        """Distance (n,) in m of `points` (n, 2) from the region: 0 inside, infinite for the empty region."""
        points = np.asarray(points, dtype=np.float64).reshape(-1, 2)
        return np.where(self.contains(points), 0.0, self.boundary_distance(points))

    def depth(self, points: ArrayLike) -> Array:
        """Signed distance (n,) in m of `points` (n, 2) from the boundary, positive inside."""
        points = np.asarray(points, dtype=np.float64).reshape(-1, 2)
        return np.where(self.contains(points), 1.0, -1.0) * self.boundary_distance(points)

    def crossings(self, curve: Curve) -> Array:
        """Parameters (k,) in [0, 1], ascending, at which `curve` meets the boundary; ends of common pieces included."""
        lower, upper = curve.box
        tolerance = 1e-12 * max(self.size, float(np.hypot(*(upper - lower))))
        found = []
        for own, (low, high) in zip(self.curves, self._boxes, strict=True):
            if np.all(low <= upper + tolerance) and np.all(lower <= high + tolerance):
                found += [t for t, _ in meet(curve, own, tolerance)]
        slack = tolerance / curve.length if curve.length > 0.0 else 0.0
        kept: list[float] = []
        for t in sorted(found):
            # Two curves that share an end both report it.
            if not kept or t - kept[-1] > 2.0 * slack:
                kept.append(t)
        return np.array(kept)

    def moved(self, R: ArrayLike, offset: ArrayLike) -> Region:
        """The image under p ↦ R p + offset with R (2, 2) orthogonal; a reflection turns the loops round."""
        R = np.asarray(R, dtype=np.float64)
        loops = tuple(tuple(curve.moved(R, offset) for curve in loop) for loop in self.loops)
        if R[0, 0] * R[1, 1] - R[0, 1] * R[1, 0] < 0.0:
            # Run backward as well, the interior is on the left again.
            loops = tuple(tuple(curve.reversed() for curve in reversed(loop)) for loop in loops)
        return Region(loops)


def polygon_region(*rings: ArrayLike) -> Region:
    """The region bounded by closed polygons (n, 2), outer ones counter-clockwise and holes clockwise."""
    loops = []
    for ring in rings:
        points = np.asarray(ring, dtype=np.float64)
        loops.append(tuple(LineSegment(a, b) for a, b in zip(points, np.roll(points, -1, axis=0), strict=True)))
    return Region(tuple(loops))
