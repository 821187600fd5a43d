"""Directed plane curves with exact parameters: the segment and the circular arc; the conic arc is next door.

A curve runs over t in [0, 1]; the region it bounds lies on its left. Lengths in m, angles in rad.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from fmopt.geometry.plane.conic import ConicArc
from fmopt.spatial.values import Array, Value, frozen

Side: TypeAlias = Literal["on", "left", "right"]


@dataclass(frozen=True, eq=False)
class LineSegment(Value, start=(2,), end=(2,)):
    """The straight piece from `start` (2,) to `end` (2,), both in m."""

    start: Array
    end: Array

    def point(self, t: ArrayLike) -> Array:
        """Points (…, 2) in m at parameters t (…)."""
        t = np.asarray(t, dtype=np.float64)[..., None]
        return np.asarray((1.0 - t) * self.start + t * self.end)

    def tangent(self, t: ArrayLike) -> Array:
        """Unit tangents (…, 2); zero for a segment of no length."""
        along = self.end - self.start
        # A segment of no length has no direction, and is not to raise nan for it.
        length = float(np.hypot(*along))
        return np.broadcast_to(along / length if length > 0.0 else along, (*np.shape(t), 2))

    def reversed(self) -> LineSegment:
        """The same points run through the other way."""
        return LineSegment(self.end, self.start)

    def part(self, a: float, b: float) -> LineSegment:
        """The piece between the parameters a < b."""
        # Ends are kept to the bit: shared vertices stay shared.
        return LineSegment(self.start if a == 0.0 else self.point(a), self.end if b == 1.0 else self.point(b))

    def moved(self, R: ArrayLike, offset: ArrayLike) -> LineSegment:
        """The image under p ↦ R p + offset with R (2, 2) orthogonal."""
        R, offset = np.asarray(R, dtype=np.float64), np.asarray(offset, dtype=np.float64)
        return LineSegment(R @ self.start + offset, R @ self.end + offset)

    @property
    def first(self) -> Array:
        """The first point (2,)."""
        return self.start

    @property
    def last(self) -> Array:
        """The last point (2,)."""
        return self.end

    @property
    def length(self) -> float:
        """Length in m."""
        return float(np.hypot(*(self.end - self.start)))

    def moment(self) -> float:
        """½ ∫ (x dy − y dx) in m²: what the curve adds to the area that a closed loop encloses."""
        return 0.5 * float(self.start[0] * self.end[1] - self.start[1] * self.end[0])

    def nearest(self, points: ArrayLike) -> Array:
        """Parameters (n,) of the nearest points of the curve to `points` (n, 2)."""
        along = self.end - self.start
        square = float(along @ along)
        if square == 0.0:
            return np.zeros(len(np.asarray(points)))
        return np.clip((np.asarray(points, dtype=np.float64) - self.start) @ along / square, 0.0, 1.0)

    @cached_property
    def box(self) -> tuple[Array, Array]:
        """Lower and upper corner (2,) of the bounding box."""
        return frozen(np.minimum(self.start, self.end)), frozen(np.maximum(self.start, self.end))

    def polyline(self, tolerance: float, side: Side = "on") -> Array:
        """Points (n, 2) of a polyline; a segment is its own."""
        return np.stack([self.start, self.end])


@dataclass(frozen=True, eq=False)
class Arc(Value):
    """A circular arc about `centre` (2,) from the angle `start` through the signed angle `sweep`, |sweep| ≤ 2π (rad).

    A positive sweep runs counter-clockwise.
    """

    centre: Array
    radius: float
    start: float
    sweep: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "centre", frozen(self.centre, 2, name="centre"))
        if not (math.isfinite(self.radius) and self.radius >= 0.0):
            raise ValueError(f"an arc of radius {self.radius} m")
        if not (math.isfinite(self.start) and abs(self.sweep) <= 2.0 * math.pi + 1e-12):
            raise ValueError(f"an arc from {self.start} rad through {self.sweep} rad")

    def point(self, t: ArrayLike) -> Array:
        """Points (…, 2) in m at parameters t (…)."""
        # Angles go without reduction, so that a full turn does not become none.
        angle = self.start + np.asarray(t, dtype=np.float64) * self.sweep
        return np.asarray(self.centre + self.radius * np.stack([np.cos(angle), np.sin(angle)], axis=-1))

    @cached_property
    def first(self) -> Array:
        """The first point (2,)."""
        return self._on(self.start)

    @cached_property
    def last(self) -> Array:
        """The last point (2,)."""
        return self._on(self.start + self.sweep)

    def _on(self, angle: float) -> Array:
        x, y = self.centre
        return frozen((x + self.radius * math.cos(angle), y + self.radius * math.sin(angle)))

    def tangent(self, t: ArrayLike) -> Array:
        """Unit tangents (…, 2)."""
        angle = self.start + np.asarray(t, dtype=np.float64) * self.sweep
        return math.copysign(1.0, self.sweep) * np.stack([-np.sin(angle), np.cos(angle)], axis=-1)

    def reversed(self) -> Arc:
        """The same points run through the other way."""
        return Arc(self.centre, self.radius, self.start + self.sweep, -self.sweep)

    def part(self, a: float, b: float) -> Arc:
        """The piece between the parameters a < b."""
        return Arc(self.centre, self.radius, self.start + a * self.sweep, (b - a) * self.sweep)

    def moved(self, R: ArrayLike, offset: ArrayLike) -> Arc:
        """The image under p ↦ R p + offset with R (2, 2) orthogonal; a reflection turns the sweep round."""
        R, offset = np.asarray(R, dtype=np.float64), np.asarray(offset, dtype=np.float64)
        x, y = R @ (math.cos(self.start), math.sin(self.start))
        # A reflection has determinant −1 and runs the arc the other way round.
        sweep = math.copysign(self.sweep, self.sweep * float(R[0, 0] * R[1, 1] - R[0, 1] * R[1, 0]))
        return Arc(R @ self.centre + offset, self.radius, math.atan2(y, x), sweep)

    @property
    def length(self) -> float:
        """Length in m."""
        return self.radius * abs(self.sweep)

    def moment(self) -> float:
        """½ ∫ (x dy − y dx) in m²: what the curve adds to the area that a closed loop encloses."""
        # Green's theorem about the centre: the sector ½ r² sweep, and the triangle that moving the centre adds.
        step = self.last - self.first
        return 0.5 * float(self.centre[0] * step[1] - self.centre[1] * step[0] + self.radius**2 * self.sweep)

    def share(self, angle: float, slack: float = 0.0) -> float | None:
        """The parameter at which the arc passes the polar `angle` (rad) of its circle, None when it does not.

        An overshoot by the slack (rad) still counts as an end.
        """
        if self.sweep == 0.0:
            return 0.0 if abs(math.remainder(angle - self.start, math.tau)) <= slack else None
        # `fmod` keeps the sign of its first argument; what is negative goes once round.
        run = math.fmod((angle - self.start) * math.copysign(1.0, self.sweep), math.tau)
        run += math.tau if run < 0.0 else 0.0
        if run <= abs(self.sweep):
            return run / abs(self.sweep)
        # Just before the start, or just past the end, counts as that end: slack is of an angle here.
        if math.tau - run <= slack:
            return 0.0
        return 1.0 if run - abs(self.sweep) <= slack else None

    def nearest(self, points: ArrayLike) -> Array:
        """Parameters (n,) of the nearest points of the curve to `points` (n, 2)."""
        d = np.asarray(points, dtype=np.float64) - self.centre
        if self.sweep == 0.0:
            return np.zeros(len(d))
        run = np.mod((np.arctan2(d[:, 1], d[:, 0]) - self.start) * math.copysign(1.0, self.sweep), math.tau)
        size = abs(self.sweep)
        # Past the end: the nearer of the two ends, in angle, which on a circle is the nearer in distance as well.
        return np.where(run <= size, run / size, np.where(run - size < math.tau - run, 1.0, 0.0))

    @cached_property
    def box(self) -> tuple[Array, Array]:
        """Lower and upper corner (2,) of the bounding box."""
        low, high = sorted((self.start, self.start + self.sweep))
        quarter = 0.5 * math.pi
        lower, upper = np.minimum(self.first, self.last), np.maximum(self.first, self.last)
        # Only multiples of 90° within the sweep are extrema; ends were taken above.
        for k in range(math.ceil(low / quarter), math.floor(high / quarter) + 1):
            side = lower if k % 4 >= 2 else upper
            side[k % 2] = self.centre[k % 2] + (self.radius if k % 4 < 2 else -self.radius)
        return frozen(lower), frozen(upper)

    def polyline(self, tolerance: float, side: Side = "on") -> Array:
        """Points (n, 2) of a polyline within `tolerance` (m) of the arc.

        With "on" every corner is on the arc; "left" and "right" keep the whole polyline on that side of it.
        """
        share = min(1.0, tolerance / self.radius) if self.radius > 0.0 else 1.0
        outside = side != "on" and (side == "right") == (self.sweep > 0.0)
        # Chords lie inside by r (1 − cos), tangents outside by r (1 / cos − 1): each has a step of its own for one
        # tolerance.
        widest = 2.0 * math.acos(1.0 / (1.0 + share) if outside else 1.0 - share)
        # A tolerance that rounds away beside the radius makes `widest` 0; 1e-6 rad is off by 2e-13 radii at most.
        count = max(math.ceil(abs(self.sweep) / max(widest, 1e-6)), 1, math.ceil(abs(self.sweep) / (0.5 * math.pi)))
        if not outside:
            return self.point(np.linspace(0.0, 1.0, count + 1))
        half = 0.5 * abs(self.sweep) / count
        # Where the corners are the meeting points of tangents, the polyline holds the arc.
        corners = self.centre + (self.point((np.arange(count) + 0.5) / count) - self.centre) / math.cos(half)
        return np.vstack([self.first, corners, self.last])


Curve: TypeAlias = LineSegment | Arc | ConicArc


def distance(curve: Curve, points: ArrayLike) -> Array:
    """Distances (n,) in m of points (n, 2) from a curve."""
    points = np.asarray(points, dtype=np.float64)
    return np.asarray(np.linalg.norm(points - curve.point(curve.nearest(points)), axis=1))


def boxes_of(curves: Sequence[Curve]) -> Array:
    """Bounding boxes (n, 4) in m: lower x, lower y, upper x, upper y."""
    # The ends of a segment do for its box: they are put in order below, and no box is made and kept for each.
    corners = [(curve.start, curve.end) if isinstance(curve, LineSegment) else curve.box for curve in curves]
    pairs = np.array(corners).reshape(-1, 2, 2)
    return np.concatenate([pairs.min(axis=1), pairs.max(axis=1)], axis=1)
