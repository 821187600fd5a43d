"""Contacts of an uncertain section with a cut-diagram, and exactly when they are possible on a straight leg.

The moving section is at Φ₀ + d, turned by ψ from its nominal angle, with |d|∞ ≤ r and |ψ| ≤ s. A contact is a pair of a
corner and an edge, or of two circles about points that do not move when the section turns. Its feature on the expanded
diagram GE(ψ) is a line between P₀(ψ) and P₁(ψ), with Pᵢ(ψ) = cᵢ − R(ψ) mᵢ: a corner m on the edge from c₀ to c₁, or an
edge from m₀ to m₁ on the corner c. The contact is possible when the line meets the ball about Φ₀ for some ψ of the cone
that the two features' normals allow.

While Φ₀ runs along a leg, that begins and ends where Φ₀ crosses one of finitely many lines and circles: the corners of
ball ⊕ line run on circles, its sides touch circles or stop where the cone ends. All crossings are closed formulas, and
between neighbouring ones one test decides. Nothing is sampled.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from fmopt.nominal.diagram import Arc, Corner, Diagram
from fmopt.nominal.leg import Leg, turns_of
from fmopt.values import Array, Value

Bits = NDArray[np.bool_]

_SIGNS = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
_STILL = 1e-9  # force, or torque over size, below which a contact does not stop a degree
_ROUNDING = 1e-12  # of the size


@dataclass(frozen=True)
class Span:
    """A contact is possible for a share of a leg from `start` to `end`; `stops` has (u+, u−, v+, v−, ψ+, ψ−)."""

    start: float
    end: float
    stops: tuple[bool, ...]


def spans(moving: Diagram, fixed: Diagram, leg: Leg) -> Iterator[Span]:
    """Every contact that is possible on a leg, with the shares of the leg and the motions that it stops.

    Args:
        moving: section of operand 1 about its nominal centre at the nominal angle.
        fixed: cut-diagram of operand 2.
        leg: path of the nominal centre.
    """
    for contact in _contacts(moving, fixed, leg):
        yield from contact.spans(leg)


def _contacts(moving: Diagram, fixed: Diagram, leg: Leg) -> Iterator[_Line | _Round]:
    for edge in fixed.edges:
        for corner in moving.corners:
            allowed = _allowed(math.atan2(-edge.normal[1], -edge.normal[0]), corner, -1.0, leg.half_angle)
            if allowed:
                yield _Line(np.array([edge.start, edge.end]), np.array([corner.point] * 2), edge.normal, *allowed)
    for corner in fixed.corners:
        for edge in moving.edges:
            allowed = _allowed(math.atan2(-edge.normal[1], -edge.normal[0]), corner, 1.0, leg.half_angle)
            if allowed:
                yield _Line(np.array([corner.point] * 2), np.array([edge.start, edge.end]), -edge.normal, *allowed)
    for arc in moving.arcs:
        yield from _round(arc, fixed)


def _allowed(angle: float, corner: Corner, sense: float, half_angle: float) -> tuple[float, float] | None:
    """The turns ψ of the cone at which a corner can lie on an edge from outside: opposite normals.

    Args:
        angle: of the opposite of the edge's outward normal.
        corner: its normals fill the angles from `corner.first` over `corner.opening`.
        sense: 1 when the edge turns with ψ, −1 when the corner does.
        half_angle: s.
    """
    from_first = math.remainder(angle - corner.first, 2.0 * math.pi)
    ends = sorted((-sense * from_first, sense * (corner.opening - from_first)))
    for shift in (0.0, 2.0 * math.pi, -2.0 * math.pi):
        low, high = max(ends[0] + shift, -half_angle), min(ends[1] + shift, half_angle)
        if low <= high + 1e-12:
            return min(low, high), max(low, high)
    return None


def _round(arc: Arc, fixed: Diagram) -> Iterator[_Line | _Round]:
    """Contacts of a circle about the nominal centre: its centre stays off edges, corners and arcs by its radius."""
    for edge in fixed.edges:
        shift = arc.radius * edge.normal
        ends = np.array([edge.start, edge.end]) + shift
        yield _Line(ends, np.zeros((2, 2)), edge.normal, 0.0, 0.0, arc.radius)
    for corner in fixed.corners:
        for first, opening in _quarters(corner.first, corner.opening):
            yield _Round(np.array(corner.point), arc.radius, first, opening, arc.radius)
    for other in fixed.arcs:
        reach = other.radius - arc.radius if other.hollow else other.radius + arc.radius
        if reach > 0.0:
            for first, opening in _quarters(other.first, other.opening):
                yield _Round(np.array(other.centre), reach, first, opening, arc.radius, -1.0 if other.hollow else 1.0)


def _quarters(first: float, opening: float) -> Iterator[tuple[float, float]]:
    """An arc of angles cut at the multiples of a right angle."""
    cuts = [first]
    k = math.floor(first / (0.5 * math.pi)) + 1
    while 0.5 * math.pi * k < first + opening - 1e-12:
        if 0.5 * math.pi * k > first + 1e-12:
            cuts.append(0.5 * math.pi * k)
        k += 1
    cuts.append(first + opening)
    for a, b in pairwise(cuts):
        yield a, b - a


@dataclass(frozen=True, eq=False)
class _Line(Value):
    """A contact whose feature on GE(ψ) is the line from c₀ − R m₀ to c₁ − R m₁.

    Args:
        c: (2, 2), m; one of c and m holds one point twice.
        m: (2, 2), m.
        force: direction (2,) of the force on the moving section at ψ = 0.
        low, high: turns at which the features can meet, rad.
        shift: m, how far the contact point lies from P along the force's opposite, for circles.
    """

    c: Array
    m: Array
    force: Array
    low: float
    high: float
    shift: float = 0.0

    @property
    def turns(self) -> bool:
        """Whether the line itself turns with ψ."""
        return bool(np.any(self.m[0] != self.m[1]))

    def spans(self, leg: Leg) -> Iterator[Span]:
        """When the contact is possible."""
        if not self._near(leg):
            return
        cuts = np.concatenate([self._cuts(leg), self._balanced(leg)])
        cuts = np.unique(np.concatenate([[0.0, 1.0], cuts[(cuts > 0.0) & (cuts < 1.0)]]))
        middle = 0.5 * (cuts[1:] + cuts[:-1])
        met = self._met(leg, leg.at(middle), 0.0)
        for a, b, share in zip(cuts[:-1][met], cuts[1:][met], middle[met], strict=True):
            yield Span(float(a), float(b), self._stops(leg, float(share)))
        if not met[-1] and self._met(leg, leg.at(np.ones(1)), 1e3 * _ROUNDING * leg.size)[0]:
            yield Span(1.0, 1.0, self._stops(leg, 1.0))

    def _near(self, leg: Leg) -> bool:
        reach = leg.radius + float(np.linalg.norm(self.m, axis=1).max()) * (1.0 + 1e-9) + 1e-6 * leg.size
        ends = np.array([leg.start, leg.start + leg.travel])
        low, high = self.c.min(axis=0) - reach, self.c.max(axis=0) + reach
        return bool(np.all(ends.min(axis=0) <= high) and np.all(low <= ends.max(axis=0)))

    def _stops(self, leg: Leg, share: float) -> tuple[bool, ...]:
        at = leg.start + share * leg.travel
        arm = self.c[0] - at if self.turns else self.m[0] - self.shift * self.force
        return stops(self.force, arm, leg.size)

    def _balanced(self, leg: Leg) -> Array:
        """Where the torque of an edge on a corner changes its sign."""
        if not self.turns:
            return np.zeros(0)
        at_start, rate = _turning(self.c[0] - leg.start, self.force), _turning(-leg.travel, self.force)
        return np.array([-at_start / rate]) if rate != 0.0 else np.zeros(0)

    def _ends(self, turn: Array) -> Array:
        """P₀ and P₁ (n, 2, 2) at turns (n,)."""
        cosine, sine = np.cos(turn)[:, None], np.sin(turn)[:, None]
        x, y = self.m[:, 0], self.m[:, 1]
        return np.asarray(self.c - np.stack([cosine * x - sine * y, sine * x + cosine * y], axis=-1))

    def _cuts(self, leg: Leg) -> Array:
        """Shares at which Φ₀ crosses a line or circle that can bound the set of contact."""
        r, found = leg.radius, []
        lengths = np.linalg.norm(self.m, axis=1)
        for c, length in zip(self.c, lengths, strict=True):
            found += [leg.on_circle(c + r * sign, float(length)) for sign in _SIGNS]
            for axis in (0, 1):
                levels = c[axis] + r * np.array([-1.0, 1.0])[:, None] + length * np.array([-1.0, 1.0])
                found.append(leg.on_level(np.eye(2)[axis], levels.ravel()))
        for P in self._ends(np.array([self.low, self.high])):
            n = _across(P[1] - P[0])
            for axis in (0, 1):
                found.append(leg.on_level(np.eye(2)[axis], (P[:, axis, None] + np.array([-r, r])).ravel()))
            found.append(leg.on_level(n, n @ P[0] + r * np.abs(n).sum() * np.array([-1.0, 1.0])))
        if self.turns:
            span = self.m[1] - self.m[0]
            distance = abs(_turning(self.m[0], span)) / float(np.linalg.norm(span))
            found += [leg.on_circle(self.c[0] + r * sign, distance) for sign in _SIGNS]
        else:
            n = _across(self.c[1] - self.c[0])
            reach = r * np.abs(n).sum() * np.array([-1.0, 1.0])[:, None] + lengths[0] * np.array([-1.0, 1.0])
            found.append(leg.on_level(n, n @ self.c[0] + reach.ravel()))
        return np.concatenate(found)

    def _met(self, leg: Leg, points: Array, slack: float) -> Bits:
        """Whether the ball about each point (n, 2) meets the line for some allowed turn."""
        breaks = np.clip(np.nan_to_num(self._breaks(leg, points), nan=self.low), self.low, self.high)
        ends = np.broadcast_to([self.low, self.high], (len(points), 2))
        turns = np.sort(np.concatenate([ends, breaks], axis=1), axis=1)
        turns = 0.5 * (turns[:, 1:] + turns[:, :-1]) if slack == 0.0 else turns
        P = self._ends(turns.ravel()).reshape(*turns.shape, 2, 2) - points[:, None, None]
        reach = leg.radius + _ROUNDING * leg.size + slack
        n = P[..., 1, :] - P[..., 0, :]
        n = np.stack([-n[..., 1], n[..., 0]], axis=-1)
        level = np.abs((P[..., 0, :] * n).sum(axis=-1)) - (leg.radius * np.abs(n).sum(axis=-1))
        meets = level <= (_ROUNDING * leg.size + slack) * np.linalg.norm(n, axis=-1)
        meets &= np.all((P.min(axis=-2) <= reach) & (P.max(axis=-2) >= -reach), axis=-1)
        return np.asarray(meets.any(axis=1))

    def _breaks(self, leg: Leg, points: Array) -> Array:
        """Turns (n, k) at which a side of the ball reaches an end of the line, or a corner of the ball the line."""
        r, found = leg.radius, []
        for c, m in zip(self.c, self.m, strict=True):
            for sign in (-1.0, 1.0):
                found.append(turns_of(m[0], -m[1], c[0] - points[:, 0] + sign * r))
                found.append(turns_of(m[1], m[0], c[1] - points[:, 1] + sign * r))
        for sign in _SIGNS if r > 0.0 else _SIGNS[:1]:
            arm = self.c[0] - points + r * sign
            if self.turns:
                n = _across(self.m[1] - self.m[0])
                level = np.full(len(points), n @ self.m[0])
                A, B = arm @ n, arm @ np.array([-n[1], n[0]])
                found.append(turns_of(A, B, level))
            else:
                n = _across(self.c[1] - self.c[0])
                m = self.m[0]
                found.append(turns_of(n @ m, n @ np.array([-m[1], m[0]]), arm @ n))
        return np.concatenate(found, axis=1)


@dataclass(frozen=True, eq=False)
class _Round(Value):
    """A contact of a circle about the nominal centre: Φ on a quarter arc about `centre` with radius `reach`.

    Args:
        centre: (2,), m.
        reach: m.
        first, opening: angles from the centre to Φ, rad, within one quarter.
        radius: of the moving circle, m.
        sign: 1 when the force on the moving section points away from the centre, −1 towards it.
    """

    centre: Array
    reach: float
    first: float
    opening: float
    radius: float
    sign: float = 1.0

    def spans(self, leg: Leg) -> Iterator[Span]:
        """When the contact is possible."""
        r, ends = leg.radius, self._points(np.array([0.0, 1.0]))
        cuts = [leg.on_circle(self.centre + r * sign, self.reach) for sign in _SIGNS]
        for axis in (0, 1):
            cuts.append(leg.on_level(np.eye(2)[axis], (ends[:, axis, None] + np.array([-r, r])).ravel()))
        inside = np.concatenate(cuts)
        shares = np.unique(np.concatenate([[0.0, 1.0], inside[(inside > 0.0) & (inside < 1.0)]]))
        middle = 0.5 * (shares[1:] + shares[:-1])
        met = self._met(leg.at(middle), r + _ROUNDING * leg.size)
        force = self.sign * (self._points(np.array([0.5])) - self.centre)[0] / self.reach
        halted = stops(force, -self.radius * force, leg.size)
        for a, b in zip(shares[:-1][met], shares[1:][met], strict=True):
            yield Span(float(a), float(b), halted)
        if not met[-1] and self._met(leg.at(np.ones(1)), r + 1e3 * _ROUNDING * leg.size)[0]:
            yield Span(1.0, 1.0, halted)

    def _points(self, shares: Array) -> Array:
        angles = self.first + shares * self.opening
        return np.asarray(self.centre + self.reach * np.column_stack([np.cos(angles), np.sin(angles)]))

    def _met(self, points: Array, reach: float) -> Bits:
        """Whether the square about each point meets the arc, which rises or falls all along."""
        ends = self._points(np.array([0.0, 1.0]))
        low, high = np.sort(ends, axis=0)
        u = np.clip(np.column_stack([points[:, 0] - reach, points[:, 0] + reach]), low[0], high[0])
        rising = np.sqrt(np.maximum(self.reach**2 - (u - self.centre[0]) ** 2, 0.0))
        v = self.centre[1] + (1.0 if math.sin(self.first + 0.5 * self.opening) >= 0.0 else -1.0) * rising
        meets = (points[:, 0] - reach <= high[0]) & (points[:, 0] + reach >= low[0])
        return np.asarray(meets & (v.min(axis=1) <= points[:, 1] + reach) & (v.max(axis=1) >= points[:, 1] - reach))


def stops(force: Array, arm: Array, size: float) -> tuple[bool, ...]:
    """The motions (u+, u−, v+, v−, ψ+, ψ−) that a force (2,) at `arm` (2,) m from the nominal centre works against."""
    torque = _turning(arm, force) / size
    found: list[bool] = []
    for value in (*force, torque):
        found += [bool(value < -_STILL), bool(value > _STILL)]
    return tuple(found)


def _turning(arm: Array, force: Array) -> float:
    return float(arm[0] * force[1] - arm[1] * force[0])


def _across(along: Array) -> Array:
    """The unit vector a quarter turn on from a direction (2,)."""
    return np.array([-along[1], along[0]]) / float(np.linalg.norm(along))
