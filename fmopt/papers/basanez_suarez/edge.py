"""Rotated edge ⊕ disc: where an edge of the grasped object may be, and which vertex it may touch, eqs. (35)-(41).

[BasanezSuarez] calls it case A when the perpendicular from the reference point meets the edge, case B otherwise. An
edge that turns about the reference point has its nearest point sweep an arc exactly in case A: there the boundary has
four segments and the additional arc (36), in case B two segments. The paper's text has the two the other way round.
"""

import math
from dataclasses import dataclass, replace
from enum import Enum

import numpy as np
from numpy.typing import ArrayLike

from fmopt.geometry.plane.curve import LineSegment
from fmopt.papers.basanez_suarez.boundary import TURN, BoundaryPiece, Carrier
from fmopt.papers.basanez_suarez.gap import segment_arc_gap
from fmopt.papers.basanez_suarez.planar_set import PlanarSet
from fmopt.papers.basanez_suarez.sources import require
from fmopt.papers.basanez_suarez.vertex import ArcSum, arc_support, directed_arc, norm, unit
from fmopt.spatial.values import Array, frozen

ON_LINE = 1e-13  # of the size: a foot nearer than this to an end, or to the pivot, is there


class Case(Enum):
    """Whether the foot of the perpendicular from the reference point lies inside the edge (A) or not (B)."""

    A = "A"
    B = "B"


@dataclass(frozen=True, eq=False)
class TurnedEdge(PlanarSet, pivot=(2,), start=(2,), end=(2,)):
    """The set {c + R(δ)(s + k(e − s)) + ρ : |δ| ≤ spread, k ∈ [0, 1], |ρ| ≤ radius}.

    Args:
        pivot: c (2,), m.
        start: s (2,) relative to the pivot, m.
        end: e (2,) relative to the pivot, m.
        spread: ε_φ, rad; π or more is a full turn.
        radius: of the disc, m.

    Raises:
        ValueError: a number is not finite, or a length or opening is negative.
    """

    pivot: Array
    start: Array
    end: Array
    spread: float
    radius: float

    def __post_init__(self) -> None:
        super().__post_init__()
        require(spread=self.spread, radius=self.radius)

    @property
    def size(self) -> float:
        """Bound of the set's extent from the pivot, m."""
        return max(math.hypot(*self.start), math.hypot(*self.end)) + self.radius

    @property
    def origin(self) -> Array:
        """The pivot (2,), m."""
        return self.pivot

    def widened(self, radius: float) -> "TurnedEdge":
        """The Minkowski sum with a further disc of this radius in m."""
        return replace(self, radius=self.radius + radius)

    def displaced(self, by: Array) -> "TurnedEdge":
        """The set displaced by a vector (2,) in m."""
        return replace(self, pivot=np.add(self.pivot, by))

    @property
    def case(self) -> Case:
        """Case A or B of the edge."""
        return Case.B if self._foot() is None else Case.A

    def core_distance(self, points: ArrayLike) -> Array:
        """Distance (…) in m of points (…, 2) from the turned edge: the point, turned back, is an arc."""
        x = np.asarray(points, dtype=np.float64) - self.pivot
        start, end = np.broadcast_to(self.start, x.shape), np.broadcast_to(self.end, x.shape)
        return segment_arc_gap(start, end, norm(x), np.arctan2(x[..., 1], x[..., 0]), self.spread)

    def support(self, directions: ArrayLike) -> Array:
        """max n·x, (…) in m for n (…, 2): the larger of both ends' arcs, and |n| times the radius."""
        n = np.asarray(directions, dtype=np.float64)
        arcs = [arc_support(n, math.hypot(*v), math.atan2(v[1], v[0]), self.spread) for v in (self.start, self.end)]
        return np.asarray(n @ self.pivot + np.maximum(*arcs) + self.radius * norm(n))

    def candidates(self) -> list[BoundaryPiece]:
        """Arcs about the pivot, arcs about the ends of both extreme edges, and those edges moved out by the radius.

        The edge is cut at the foot of the perpendicular; along each half the distance from the pivot grows.
        """
        # The foot decides the case: the nearest point of the edge is inside it, or one of its ends.
        foot = self._foot()
        if not (self.end - self.start).any():
            arc = ArcSum(self.pivot, self.pivot, float(norm(self.start)), _angle(self.start), self.spread, self.radius)
            return arc.candidates()
        # Turned all the way round, the edge sweeps a ring.
        if self.spread >= math.pi:
            return self._ring(foot)
        if foot is not None:
            x, y = self.end - self.start
            towards = foot if foot.any() else np.array([-y, x])
            halves = self._half(foot, self.start) + self._half(foot, self.end)
            return halves + self._inner(foot, _angle(towards), Carrier.FOOT)
        near, far = sorted((self.start, self.end), key=lambda v: float(v @ v))
        # An edge that begins at the pivot has no direction of its own there: the other end gives it.
        ahead = _angle(near) if near.any() else _angle(far - near)
        found = self._half(near, far) + self._inner(near, ahead, Carrier.NEAR)
        # The rounded tips of the near end in both extreme positions.
        s, along = self.spread, _angle(far - near)
        for side, on in ((1.0, Carrier.PLUS), (-1.0, Carrier.MINUS)):
            found += self._tip(near, side, along + side * (s + 0.5 * math.pi), ahead + side * (s + math.pi), on)
        return found

    def _foot(self) -> Array | None:
        """Foot (2,) of the perpendicular from the pivot, when it lies between the ends."""
        e = self.end - self.start
        length = math.hypot(*e)
        if length == 0.0:
            return None
        along = -float(self.start @ e) / length
        # At an end or at the pivot to rounding: cases meet there, and either is right.
        margin = ON_LINE * self.size
        if not margin < along < length - margin:
            return None
        foot = self.start + (along / length) * e
        return np.asarray(foot if math.hypot(*foot) > ON_LINE * self.size else np.zeros(2))

    def _ring(self, foot: Array | None) -> list[BoundaryPiece]:
        """Both circles of an edge that may be turned any way."""
        outer = max(math.hypot(*self.start), math.hypot(*self.end)) + self.radius
        inner = math.hypot(*(min((self.start, self.end), key=lambda v: float(v @ v)) if foot is None else foot))
        found = [directed_arc(self.pivot, outer, -math.pi, math.pi, Carrier.FAR)]
        # No hole where the disc reaches over it.
        if inner > self.radius:
            on = Carrier.NEAR if foot is None else Carrier.FOOT
            found.append(directed_arc(self.pivot, self.radius - inner, -math.pi, math.pi, on))
        return found

    def _half(self, near: Array, far: Array) -> list[BoundaryPiece]:
        """Both extreme positions of a half edge with the rounded tips and the arc of its far end."""
        s, r = self.spread, self.radius
        h, ahead, along = math.hypot(*far), _angle(far), _angle(far - near)
        found = [directed_arc(self.pivot, h + r, ahead - s, ahead + s, Carrier.FAR)]
        for side, on in ((1.0, Carrier.PLUS), (-1.0, Carrier.MINUS)):
            normal = along + side * (s + 0.5 * math.pi)
            ends = [self.pivot + _turned(v, side * s) + r * unit(normal) for v in (far, near)]
            found.append(BoundaryPiece(LineSegment(*(ends if side > 0.0 else ends[::-1])), Carrier.LINE))
            found += self._tip(far, side, ahead + side * s, normal, on)
        return found

    def _tip(self, vertex: Array, side: float, one: float, other: float, on: Carrier) -> list[BoundaryPiece]:
        """The arc about a vertex turned to side × ε_φ, from one outward normal to the other, at most half a turn."""
        quarter = 0.5 * math.pi
        # The turn around the tip is at least none and at most half of one; `remainder` is centred to keep both.
        turn = min(max(math.remainder(side * (other - one) - quarter, TURN) + quarter, 0.0), math.pi)
        first, last = (one, one + turn) if side > 0.0 else (one - turn, one)
        return [directed_arc(self.pivot + _turned(vertex, side * self.spread), self.radius, first, last, on)]

    def _inner(self, nearest: Array, ahead: float, on: Carrier) -> list[BoundaryPiece]:
        """The arc that the nearest point sweeps, moved in by the radius; none when that passes the pivot."""
        # The hole is filled up by the disc.
        inner, s = math.hypot(*nearest) - self.radius, self.spread
        return [directed_arc(self.pivot, -inner, ahead + math.pi - s, ahead + math.pi + s, on)] if inner > 0.0 else []


def edge_position(
    reference: ArrayLike, phi: float, first: ArrayLike, second: ArrayLike, spread: float, radius: float
) -> TurnedEdge:
    """Ul: where an edge of the grasped object may be, eqs. (12), (35)-(37).

    Its ends b₁ and b₂ (2,) are in the gripper's frame, p_ro (2,) is the reference; φ = φ_ro + φ_go, the spread is
    ε_φrφg, the radius ε_prpgv. In m and rad.
    """
    ends = [_turned(frozen(b, 2, name="end of an edge"), phi) for b in (first, second)]
    return TurnedEdge(frozen(reference), ends[0], ends[1], spread, radius)


def _turned(v: Array, angle: float) -> Array:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([c * v[0] - s * v[1], s * v[0] + c * v[1]])


def _angle(v: Array) -> float:
    return math.atan2(v[1], v[0])
