"""S(t) from the three cut-diagrams, as [LeeHuang1985] section 4.1.2 has it: the trapezoid's contacts with GE.

On the planes x-z and y-z the section of operand 1 through its own axis moves as its projection does; on the plane x-y,
the plane of the mouth, operand 1 counts while it reaches into that plane, each stretch of its length with its own
section. Signs are those of `freedom`. The expansion is that of every orientation in the cone, not of the nominal one
alone: with the line's width 2a kept across at the nominal angle the paper's own edges come a (1/cos s − 1) short.

On each plane this is exact: s = 0 where no pose in ball × cone touches on the plane. It is not so in space, because
bodies can meet off the planes and in corners of the box of errors that no plane shows; `freedom` is the one to rely on.

Contacts of an uncertain section with a cut-diagram, and exactly when they are possible on a straight leg.

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
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from fmopt.errors import GeometryError
from fmopt.geometry.plane.curve import Arc
from fmopt.papers.lee_huang.diagram import Diagram
from fmopt.papers.lee_huang.line_contact import Leg, Lines
from fmopt.papers.lee_huang.nominal_trajectory import Bits, NominalTrajectory, Stops, intervals, together
from fmopt.papers.lee_huang.uncertainty_zone import Zone
from fmopt.plan.diagnostics import Interval
from fmopt.spatial.values import Array, Value

_BLUR = 1e-12  # of T
_SAME = 1e-12

Indices = NDArray[np.intp]

_SIGNS = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
_STILL = 1e-9  # force, or torque over size, below which a contact does not stop a degree
_ROUNDING = 1e-12  # of the size


@dataclass(frozen=True, eq=False)
class Slice(Value):
    """A section of operand 1 about its nominal centre, at the goal's orientation.

    The section is in the axes u, v of the plane, m. On the plane x-y `heights` is the stretch of operand 1 (along z,
    from the nominal centre, m) that has this section at its widest; None on the other planes.
    """

    section: Diagram
    heights: tuple[float, float] | None = None


@dataclass(frozen=True, eq=False)
class View(Value):
    """A plane with the cut-diagram of operand 2, the sections of operand 1, and the radii of ball and cone."""

    zone: Zone
    fixed: Diagram
    moving: tuple[Slice, ...]


def freedom_on_planes(views: Sequence[View], path: NominalTrajectory, free_until: float = 0.0) -> tuple[Interval, ...]:
    """S(t) along the nominal trajectory, piecewise constant, switching times exact to rounding.

    The intervals cover [0, T], neighbours different. Up to `free_until`, s, the uncertain operand 1 is known to touch
    nothing, however it turns.

    Raises:
        GeometryError: operand 1 still turns, or has not the goal's orientation, after `free_until`.
    """
    found: list[Stops] = []
    # How far the uncertain operand 1 strays along z (m), and how far it tilts (rad).
    upright = [view.zone for view in views if view.zone.plane.v == 2]
    reach = (max((z.radius for z in upright), default=0.0), max((z.half_angle for z in upright), default=0.0))
    for k in range(len(path.times) - 1):
        end = float(path.times[k + 1])
        if np.abs(path.nodes[k : k + 2, 3:] - path.nodes[-1, 3:]).max() > _SAME:
            # While it turns, sections are not those of the goal: no contact is said of it, so that it has to be clear
            # then.
            if end > free_until + _BLUR * path.duration:
                message = f"operand 1 turns until {end:.6g} s and is known to be clear of operand 2 until"
                advice = "let it reach the goal's orientation before the mouth, or start higher above it"
                raise GeometryError(f"{message} {free_until:.6g} s only", advice)
            continue
        for view in views:
            found += _stops(view, path, k, reach)
    return intervals(together(found), path.duration, _BLUR * path.duration)


def _stops(view: View, path: NominalTrajectory, k: int, reach: tuple[float, float]) -> Iterator[Stops]:
    plane, times = view.zone.plane, path.times[k : k + 2]
    a, b = path.nodes[k, [plane.u, plane.v]], path.nodes[k + 1, [plane.u, plane.v]]
    for one in view.moving:
        low, high = 0.0, 1.0
        if one.heights is not None:
            # A stretch of operand 1 counts while it is in the plane of the mouth, errors of height and tilt included.
            low, high = _within(one, path.nodes[k : k + 2, 2], reach)
        if low <= high:
            leg = Leg(a, b - a, view.zone.radius, view.zone.half_angle, max(one.section.size, 1e-9))
            found = spans(one.section, view.fixed, leg)
            start, end = np.maximum(found.start, low), np.minimum(found.end, high)
            on = start <= end
            start, end = (times[0] + share[on] * (times[1] - times[0]) for share in (start, end))
            yield Stops(start, end, _bits(view, found.stops[on]))


def _within(one: Slice, z: np.ndarray, reach: tuple[float, float]) -> tuple[float, float]:
    """Shares of a leg on which a stretch of operand 1 can reach into the plane z = 0; none when low > high."""
    assert one.heights is not None
    grow = reach[0] + one.section.width * math.sin(reach[1])
    low, high = -one.heights[1] - grow, -one.heights[0] + grow  # of z
    travel = float(z[1] - z[0])
    if travel == 0.0:
        return (0.0, 1.0) if low <= z[0] <= high else (1.0, 0.0)
    ends = sorted(((low - float(z[0])) / travel, (high - float(z[0])) / travel))
    return max(0.0, ends[0]), min(1.0, ends[1])


def _bits(view: View, stops: Bits) -> Bits:
    """Bits (n, 6, 2) of the plane's stops (n, 6): a counter-clockwise turn on x-z goes against rotation about y."""
    plane = view.zone.plane
    bits = np.zeros((len(stops), 6, 2), dtype=bool)
    bits[:, plane.u], bits[:, plane.v] = stops[:, 0:2], stops[:, 2:4]
    # A turn about y is counted from z to x, on x-z from x to z.
    bits[:, plane.turn] = stops[:, 4:6] if plane.sense > 0 else stops[:, [5, 4]]
    return bits


@dataclass(frozen=True, eq=False)
class Spans(Value):
    """Contacts possible for shares `start` to `end` (n,) of a leg, and the motions (n, 6) stopped: u±, v±, ψ±."""

    start: Array
    end: Array
    stops: Bits


def spans(moving: Diagram, fixed: Diagram, leg: Leg) -> Spans:
    """Every contact that is possible on a leg, with the shares of the leg and the motions that it stops.

    The moving section is about its nominal centre at the nominal angle; the fixed diagram is that of operand 2.
    """
    lines = _lines(moving, fixed, leg.half_angle)
    rows, shares = lines.spans(leg)
    halted = stops(lines.force[rows], lines.arms(rows, leg.at(shares[:, 2])), leg.size)
    found = [Spans(shares[:, 0], shares[:, 1], halted)]
    found += [contact.spans(leg) for arc in moving.arcs for contact in _rounds(arc, fixed)]
    return Spans(*(np.concatenate([getattr(one, name) for one in found]) for name in ("start", "end", "stops")))


def _lines(moving: Diagram, fixed: Diagram, half_angle: float) -> Lines:
    """Every pair of a corner and an edge, and of a circle about the nominal centre and an edge that it stays off."""
    edge, corner, *turns = _meeting(fixed, moving, -1.0, half_angle)
    own_edge, own_corner, *own_turns = _meeting(moving, fixed, 1.0, half_angle)
    radii = np.repeat([arc.radius for arc in moving.arcs], len(fixed.ends))
    normals = np.tile(fixed.normals, (len(moving.arcs), 1))
    # A circle touches an edge where its centre lies on the edge moved out by the radius.
    pushed = np.tile(fixed.ends, (len(moving.arcs), 1, 1)) + radii[:, None, None] * normals[:, None]
    twice = np.array([1, 1])
    return Lines(
        np.concatenate([fixed.ends[edge], fixed.points[own_corner[:, None] * twice], pushed]),
        np.concatenate([moving.points[corner[:, None] * twice], moving.ends[own_edge], np.zeros_like(pushed)]),
        np.concatenate([fixed.normals[edge], -moving.normals[own_edge], normals]),
        np.concatenate([np.column_stack(turns), np.column_stack(own_turns), np.zeros_like(normals)]),
        np.concatenate([np.zeros(len(edge) + len(own_edge)), radii]),
    )


def _meeting(one: Diagram, other: Diagram, sense: float, half_angle: float) -> tuple[Indices, Indices, Array, Array]:
    """Edges of one and corners of the other that can meet from outside, with opposite normals, at turns of the cone.

    The sense is 1 when the edges turn with ψ, −1 when the corners do; half the angle of the cone is s. The answer is
    which edges and corners (n,), and the first and the last of the turns (n,), rad.
    """
    angle = np.arctan2(-one.normals[:, 1], -one.normals[:, 0])
    away = angle[:, None] - other.fans[:, 0]
    # The opposite normal lies in the corner's fan for some turn: angles are compared on one branch.
    from_first = away - 2.0 * math.pi * np.round(away / (2.0 * math.pi))
    ends = np.sort([-sense * from_first, sense * (other.fans[:, 1] - from_first)], axis=0)
    shifts = 2.0 * math.pi * np.array([0.0, 1.0, -1.0])[:, None, None]
    low, high = np.maximum(ends[0] + shifts, -half_angle), np.minimum(ends[1] + shifts, half_angle)
    meets = low <= high + _ROUNDING
    i, j = np.nonzero(meets.any(axis=0))
    k = np.argmax(meets, axis=0)[i, j]
    low, high = low[k, i, j], high[k, i, j]
    return i, j, np.minimum(low, high), np.maximum(low, high)


def _rounds(arc: Arc, fixed: Diagram) -> Iterator[_Round]:
    """Contacts of a circle about the nominal centre with corners and arcs: its centre stays off them by its radius."""
    for point, (first, opening) in zip(fixed.points, fixed.fans.tolist(), strict=True):
        for begin, turn in _quarters(first, opening):
            yield _Round(point, arc.radius, begin, turn, arc.radius)
    for other in fixed.arcs:
        # A smaller circle touches a hollow one from inside, at the difference of the radii; a larger one not at all.
        sign = math.copysign(1.0, other.sweep)
        reach = other.radius + sign * arc.radius
        if reach > 0.0:
            for begin, turn in _quarters(min(other.start, other.start + other.sweep), abs(other.sweep)):
                yield _Round(other.centre, reach, begin, turn, arc.radius, sign)


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

    def spans(self, leg: Leg) -> Spans:
        """When the contact is possible."""
        r, ends = leg.radius, self._points(np.array([0.0, 1.0]))
        cuts = [leg.on_circle(self.centre + r * sign, self.reach) for sign in _SIGNS]
        for axis in (0, 1):
            cuts.append(leg.on_level(np.eye(2)[axis], (ends[:, axis, None] + np.array([-r, r])).ravel()))
        inside = np.concatenate(cuts)
        # Cuts of the leg where the answer may change; between them it is asked once, in the middle.
        shares = np.unique(np.concatenate([[0.0, 1.0], inside[(inside > 0.0) & (inside < 1.0)]]))
        middle = 0.5 * (shares[1:] + shares[:-1])
        met = self._met(leg.at(middle), r + _ROUNDING * leg.size)
        start, end = shares[:-1][met], shares[1:][met]
        if not met[-1] and self._met(leg.at(np.ones(1)), r + 1e3 * _ROUNDING * leg.size)[0]:
            start, end = np.append(start, 1.0), np.append(end, 1.0)
        force = self.sign * (self._points(np.array([0.5])) - self.centre) / self.reach
        return Spans(start, end, np.repeat(stops(force, -self.radius * force, leg.size), len(start), axis=0))

    def _points(self, shares: Array) -> Array:
        angles = self.first + shares * self.opening
        return np.asarray(self.centre + self.reach * np.column_stack([np.cos(angles), np.sin(angles)]))

    def _met(self, points: Array, reach: float) -> Bits:
        """Whether the square about each point meets the arc, which rises or falls all along."""
        ends = self._points(np.array([0.0, 1.0]))
        low, high = np.sort(ends, axis=0)
        u = np.clip(np.column_stack([points[:, 0] - reach, points[:, 0] + reach]), low[0], high[0])
        # On a quarter arc v is a monotonic function of u, so that the square's ends bound it.
        rising = np.sqrt(np.maximum(self.reach**2 - (u - self.centre[0]) ** 2, 0.0))
        v = self.centre[1] + (1.0 if math.sin(self.first + 0.5 * self.opening) >= 0.0 else -1.0) * rising
        meets = (points[:, 0] - reach <= high[0]) & (points[:, 0] + reach >= low[0])
        return np.asarray(meets & (v.min(axis=1) <= points[:, 1] + reach) & (v.max(axis=1) >= points[:, 1] - reach))


def stops(force: Array, arm: Array, size: float) -> Bits:
    """The motions (n, 6), u+, u−, v+, v−, ψ+, ψ−, that unit forces (n, 2) on operand 1 stop.

    They act at `arm` (n, 2), m, from the nominal centre; `size`, m, is there to compare torques with forces.
    """
    # Torque over size is a force, so that one threshold serves all three.
    torque = (arm[:, 0] * force[:, 1] - arm[:, 1] * force[:, 0]) / size
    value = np.column_stack([force, torque])
    return np.stack([value < -_STILL, value > _STILL], axis=2).reshape(-1, 6)
