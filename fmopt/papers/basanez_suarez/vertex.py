"""Edge ⊕ arc ⊕ disc: where a vertex of the grasped object may be and what it may touch, eqs. (15)-(30).

[BasanezSuarez] steps 1 to 3 of type-1 C-surfaces. With an edge of no length it is Uv or CUv, with the static edge CUl.
"""

import math
from dataclasses import dataclass, replace
from itertools import count, pairwise, takewhile

import numpy as np
from numpy.typing import ArrayLike

from fmopt.geometry.plane.curve import Arc, LineSegment
from fmopt.papers.basanez_suarez.boundary import BoundaryPiece, Carrier
from fmopt.papers.basanez_suarez.gap import segment_arc_gap, wrapped
from fmopt.papers.basanez_suarez.planar_set import PlanarSet
from fmopt.papers.basanez_suarez.reach import Reach
from fmopt.papers.basanez_suarez.sources import require
from fmopt.spatial.values import Array, frozen


@dataclass(frozen=True, eq=False)
class ArcSum(PlanarSet, start=(2,), end=(2,), labels={"start": "start of the edge", "end": "end of the edge"}):
    """The set {c + k(e − c) + h u(θ) + ρ : k ∈ [0, 1], |θ − angle| ≤ spread, |ρ| ≤ radius}, u(θ) = (cos θ, sin θ).

    Args:
        start: c (2,), m.
        end: e (2,), m; equal to `start` for a single point.
        h: radius of the arc, m.
        angle: middle of the arc, rad.
        spread: half of its opening ε_φ, rad; π or more is a full circle.
        radius: of the disc, m.

    Raises:
        ValueError: a number is not finite, or a length or opening is negative.
    """

    start: Array
    end: Array
    h: float
    angle: float
    spread: float
    radius: float

    def __post_init__(self) -> None:
        super().__post_init__()
        require(h=self.h, spread=self.spread, radius=self.radius)
        frozen(self.angle, name="angle of the arc")

    @property
    def size(self) -> float:
        """Bound of the set's extent, m."""
        return math.hypot(*(self.end - self.start)) + self.h + self.radius

    @property
    def origin(self) -> Array:
        """The start of the edge (2,), m."""
        return self.start

    def widened(self, radius: float) -> "ArcSum":
        """The Minkowski sum with a further disc of this radius in m."""
        return replace(self, radius=self.radius + radius)

    def displaced(self, by: Array) -> "ArcSum":
        """The set displaced by a vector (2,) in m."""
        return replace(self, start=np.add(self.start, by), end=np.add(self.end, by))

    def core_distance(self, points: ArrayLike) -> Array:
        """Distance (…) in m of points (…, 2) from edge ⊕ arc: a point less the edge, against the arc."""
        x = np.asarray(points, dtype=np.float64)
        return segment_arc_gap(x - self.start, x - self.end, self.h, self.angle, self.spread)

    def support(self, directions: ArrayLike) -> Array:
        """max n·x, (…) in m for n (…, 2): support of the edge, of the arc, and |n| times the radius."""
        n = np.asarray(directions, dtype=np.float64)
        edge = np.maximum(n @ self.start, n @ self.end)
        return np.asarray(edge + arc_support(n, self.h, self.angle, self.spread) + self.radius * norm(n))

    def candidates(self) -> list[BoundaryPiece]:
        """The convolution of both sides of the arc with the edge, moved out by the radius: eqs. (20), (21), (25), (26).

        A point with outward normal n belongs to the end of the edge that is farther along n; where n is normal to the
        edge, a line runs from one to the other.
        """
        # More than half a turn to either side is the full circle.
        a, s, r = self.angle, min(self.spread, math.pi), self.radius
        found = self._run(np.zeros(2), self.h + r, a - s, a + s, Carrier.FAR)
        if s < math.pi:
            for side, on in ((1.0, Carrier.PLUS), (-1.0, Carrier.MINUS)):
                tip = a + side * s
                first = tip if side > 0.0 else tip - math.pi
                found += self._run(self.h * unit(tip), r, first, first + math.pi, on)
        if self.h > r:
            found += self._run(np.zeros(2), r - self.h, a + math.pi - s, a + math.pi + s, Carrier.NEAR)
        return found

    def _run(self, centre: Array, radius: float, first: float, last: float, on: Carrier) -> list[BoundaryPiece]:
        """The part of a circle with outward normals from `first` to `last`; a negative radius curves the other way."""
        e = self.end - self.start
        if not e.any():
            return [directed_arc(self.start + centre, radius, first, last, on)]
        across = math.atan2(e[1], e[0]) + 0.5 * math.pi
        # Where the normal is across the edge the arc changes from one of its ends to the other.
        halves = (across + k * math.pi for k in count(math.ceil((first - across) / math.pi)))
        turns, found = list(takewhile(lambda turn: turn <= last, halves)), []
        for one, other in pairwise([first, *turns, last]):
            # The end farther along the normal carries the boundary.
            base = self.end if unit(0.5 * (one + other)) @ e > 0.0 else self.start
            if other > one:
                found.append(directed_arc(base + centre, radius, one, other, on))
        # Between the arcs of both ends runs the edge itself, moved out; an inner arc of negative radius has none.
        if radius >= 0.0:
            for turn in turns:
                n = unit(turn)
                ends = [self.start + centre + radius * n, self.end + centre + radius * n]
                found.append(
                    BoundaryPiece(LineSegment(*(ends if e[1] * n[0] > e[0] * n[1] else ends[::-1])), Carrier.LINE)
                )
        return found


def vertex_position(reference: ArrayLike, phi: float, reach: Reach, spread: float, radius: float) -> ArcSum:
    """Uv: where a vertex of the grasped object may be, eqs. (7), (15)-(19).

    p_ro (2,) is the reference; φ = φ_ro + φ_go, the spread is ε_φrφg, the radius ε_prpgv. In m and rad.
    """
    return ArcSum(frozen(reference), frozen(reference), reach.h, phi + reach.gamma, spread, radius)


def directed_arc(centre: Array, radius: float, first: float, last: float, on: Carrier) -> BoundaryPiece:
    """The arc with normals from `first` to `last`; with a negative radius the set is outside its circle.

    The centre is (2,), m, the radius of either sign, m, and the bearings of outward normals are in rad.
    """
    if radius >= 0.0:
        return BoundaryPiece(Arc(centre, radius, first, last - first), on)
    return BoundaryPiece(Arc(centre, -radius, last + math.pi, first - last), on)


def arc_support(directions: Array, h: float, angle: float | Array, spread: float) -> Array:
    """max n·x over the arc about the origin, (…) in m for directions n (…, 2).

    The arc has the radius h, m, `angle` is the bearing of its middle, `spread` half its opening, rad.
    """
    off = np.abs(wrapped(np.arctan2(directions[..., 1], directions[..., 0]) - angle))
    return np.asarray(h * norm(directions) * np.cos(np.maximum(off - min(spread, math.pi), 0.0)))


def norm(vectors: Array) -> Array:
    """Lengths (…) of vectors (…, 2)."""
    return np.asarray(np.hypot(vectors[..., 0], vectors[..., 1]))


def unit(angle: float) -> Array:
    """(cos, sin) of an angle in rad."""
    return np.array([math.cos(angle), math.sin(angle)])
