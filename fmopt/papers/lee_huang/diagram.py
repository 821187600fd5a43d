"""What of a cut-diagram can touch: straight edges, convex corners with their normals, and circular arcs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from fmopt.geometry.plane.curve import Arc as PlaneArc
from fmopt.geometry.plane.curve import Curve
from fmopt.geometry.plane.region import Region
from fmopt.spatial.values import Array, Value, frozen

_SMOOTH = 1e-9  # rad, a turn below which two curves meet without a corner


@dataclass(frozen=True, eq=False)
class Edge(Value):
    """A straight edge from `start` to `end` (2,) in m with the interior on its left."""

    start: Array
    end: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "start", frozen(self.start, 2, name="start"))
        object.__setattr__(self, "end", frozen(self.end, 2, name="end"))

    @property
    def normal(self) -> Array:
        """Unit outward normal (2,)."""
        return _right(self.end - self.start)


@dataclass(frozen=True, eq=False)
class Arc(Value):
    """A circular arc: centre (2,) and radius in m, angles from `first` over `opening` ≥ 0 counter-clockwise, rad.

    `hollow` when the interior lies outside the circle.
    """

    centre: Array
    radius: float
    first: float
    opening: float
    hollow: bool

    def __post_init__(self) -> None:
        object.__setattr__(self, "centre", frozen(self.centre, 2, name="centre"))


@dataclass(frozen=True, eq=False)
class Corner(Value):
    """A convex corner: its point (2,) in m, and the angles of its outward normals from `first` over `opening`, rad."""

    point: Array
    first: float
    opening: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "point", frozen(self.point, 2, name="corner"))


@dataclass(frozen=True, eq=False)
class Diagram(Value):
    """The features of a region on a plane."""

    edges: tuple[Edge, ...]
    corners: tuple[Corner, ...]
    arcs: tuple[Arc, ...]

    @cached_property
    def size(self) -> float:
        """Largest distance of a feature from the origin, m."""
        points = [edge.start for edge in self.edges] + [corner.point for corner in self.corners]
        far = [float(np.linalg.norm(point)) for point in points]
        return max(far + [float(np.linalg.norm(arc.centre)) + arc.radius for arc in self.arcs], default=0.0)

    @cached_property
    def ends(self) -> Array:
        """Where the edges start and end, (n, 2, 2) in m."""
        return np.array([(edge.start, edge.end) for edge in self.edges]).reshape(-1, 2, 2)

    @cached_property
    def normals(self) -> Array:
        """Unit outward normals (n, 2) of the edges."""
        return np.array([edge.normal for edge in self.edges]).reshape(-1, 2)

    @cached_property
    def points(self) -> Array:
        """The corners (n, 2) in m."""
        return np.array([corner.point for corner in self.corners]).reshape(-1, 2)

    @cached_property
    def fans(self) -> Array:
        """First normal and opening (n, 2) of the corners, rad."""
        return np.array([(corner.first, corner.opening) for corner in self.corners]).reshape(-1, 2)

    @property
    def width(self) -> float:
        """Largest coordinate of a feature in size, m."""
        points = [edge.start for edge in self.edges] + [corner.point for corner in self.corners]
        far = [float(np.abs(point).max()) for point in points]
        return max(far + [float(np.abs(arc.centre).max()) + arc.radius for arc in self.arcs], default=0.0)


def diagram(loops: Sequence[Sequence[Edge | Arc]]) -> Diagram:
    """The features of loops of edges and arcs, each loop with the interior on its left, in the order of travel."""
    edges, corners, arcs = [], [], []
    for loop in loops:
        for k, curve in enumerate(loop):
            if isinstance(curve, Edge):
                edges.append(curve)
            else:
                arcs.append(curve)
            corner = _corner(curve, loop[(k + 1) % len(loop)])
            if corner is not None:
                corners.append(corner)
    return Diagram(tuple(edges), tuple(corners), tuple(arcs))


def of_region(region: Region, tolerance: float = 0.0) -> Diagram:
    """The features of a region of the plane.

    Args:
        tolerance: m; 0 keeps circular arcs as they are; else they become polylines within it. Conics always do, within
            1e-9 of the region's size where it is 0. Polylines contain the region: what they leave free is free.
    """
    if region.empty:
        return Diagram((), (), ())
    return diagram(
        [[one for curve in loop for one in _features(curve, tolerance, region.size)] for loop in region.loops]
    )


def disc(region: Region) -> Diagram | None:
    """The one arc of a region that is a disc about the origin, to 1e-9 of its radius; None for any other region."""
    arcs = [curve for curve in region.curves if isinstance(curve, PlaneArc)]
    if not arcs or len(arcs) < len(region.curves) or len(region.loops) != 1:
        # Arcs alone, in one loop: the disc may be cut into several arcs of one circle.
        return None
    radius = arcs[0].radius
    round_ = all(abs(arc.radius - radius) + float(np.abs(arc.centre).max()) <= 1e-9 * radius for arc in arcs)
    return circle((0.0, 0.0), radius) if round_ else None


def _features(curve: Curve, tolerance: float, size: float) -> list[Edge | Arc]:
    if isinstance(curve, PlaneArc) and tolerance == 0.0:
        first = curve.start if curve.sweep > 0.0 else curve.start + curve.sweep
        return [Arc(curve.centre, curve.radius, first, abs(curve.sweep), curve.sweep < 0.0)]
    # On the right, outside of the region: contact is then seen no later than it can occur.
    points = curve.polyline(tolerance or 1e-9 * size, "right")
    return [Edge(a, b) for a, b in pairwise(points) if np.any(a != b)]


def polygon(*loops: ArrayLike) -> Diagram:
    """The diagram of polygons (n, 2) in m: outlines counter-clockwise, holes clockwise."""
    made = []
    for loop in loops:
        points = np.asarray(loop, dtype=np.float64)
        made.append([Edge(a, b) for a, b in zip(points, np.roll(points, -1, axis=0), strict=True)])
    return diagram(made)


def circle(centre: ArrayLike, radius: float, hollow: bool = False) -> Diagram:
    """The diagram of a disc about a centre (2,), or of the plane around a round hole, m.

    Args:
        centre: (2,), m.
        radius: m.
        hollow: whether the material is outside.
    """
    return Diagram((), (), (Arc(np.asarray(centre, dtype=np.float64), radius, 0.0, 2.0 * math.pi, hollow),))


def together(*diagrams: Diagram) -> Diagram:
    """The features of several diagrams that do not overlap."""
    return Diagram(
        tuple(edge for one in diagrams for edge in one.edges),
        tuple(corner for one in diagrams for corner in one.corners),
        tuple(arc for one in diagrams for arc in one.arcs),
    )


def _corner(one: Edge | Arc, other: Edge | Arc) -> Corner | None:
    """The corner where a curve ends and the next begins; None when it is reflex or smooth."""
    # The sine and cosine of the turn: a reflex corner has a negative one, and touches nothing.
    a, b = _tangent(one, 1), _tangent(other, 0)
    opening = math.atan2(a[0] * b[1] - a[1] * b[0], float(a @ b))
    if opening <= _SMOOTH:
        return None
    first = _right(a)
    return Corner(_end(one), math.atan2(first[1], first[0]), opening)


def _end(curve: Edge | Arc) -> Array:
    if isinstance(curve, Edge):
        return curve.end
    # Along a hollow arc travel is clockwise, from its last angle to its first.
    angle = curve.first if curve.hollow else curve.first + curve.opening
    return np.asarray(curve.centre + curve.radius * np.array([math.cos(angle), math.sin(angle)]))


def _tangent(curve: Edge | Arc, at_end: int) -> Array:
    """Direction of travel at the start (0) or the end (1); along a hollow arc it is clockwise."""
    if isinstance(curve, Edge):
        along = curve.end - curve.start
        return np.asarray(along / np.linalg.norm(along))
    if curve.hollow:
        angle = curve.first + (0.0 if at_end else curve.opening)
        return np.array([math.sin(angle), -math.cos(angle)])
    angle = curve.first + (curve.opening if at_end else 0.0)
    return np.array([-math.sin(angle), math.cos(angle)])


def _right(along: Array) -> Array:
    return np.array([along[1], -along[0]]) / float(np.linalg.norm(along))
