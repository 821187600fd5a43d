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

When it begins and ends while Φ₀ runs along a leg, `line_contact` finds by closed formulas. Nothing is sampled.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from fmopt.errors import GeometryError
from fmopt.papers.lee_huang.diagram import PlaneDiagram
from fmopt.papers.lee_huang.line_contact import Leg, Lines
from fmopt.papers.lee_huang.nominal_trajectory import NominalTrajectory, Stops, intervals, together
from fmopt.papers.lee_huang.uncertainty_zone import Zone
from fmopt.plan.diagnostics import Interval
from fmopt.spatial.values import Array, Bits, Indices, Value

_BLUR = 1e-12  # of T
_SAME = 1e-12
_STILL = 1e-9  # force, or torque over size, below which a contact does not stop a degree
_ROUNDING = 1e-12  # of the size


@dataclass(frozen=True, eq=False)
class OperandSlice(Value):
    """A section of operand 1 about its nominal centre, at the goal's orientation.

    The section is in the axes u, v of the plane, m. On the plane x-y `heights` is the stretch of operand 1 (along z,
    from the nominal centre, m) that has this section at its widest; None on the other planes.
    """

    section: PlaneDiagram
    heights: tuple[float, float] | None = None


@dataclass(frozen=True, eq=False)
class PlaneView(Value):
    """A plane with the cut-diagram of operand 2, the sections of operand 1, and the radii of ball and cone."""

    zone: Zone
    fixed: PlaneDiagram
    moving: tuple[OperandSlice, ...]


def freedom_on_planes(
    views: Sequence[PlaneView], path: NominalTrajectory, free_until: float = 0.0
) -> tuple[Interval, ...]:
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
            # While it turns, sections are not those of the goal: no contact is said of it, which has to be clear then.
            if end > free_until + _BLUR * path.duration:
                message = f"operand 1 turns until {end:.6g} s and is known to be clear of operand 2 until"
                advice = "let it reach the goal's orientation before the mouth, or start higher above it"
                raise GeometryError(f"{message} {free_until:.6g} s only", advice)
            continue
        for view in views:
            found += _stops(view, path, k, reach)
    return intervals(together(found), path.duration, _BLUR * path.duration)


def _stops(view: PlaneView, path: NominalTrajectory, k: int, reach: tuple[float, float]) -> Iterator[Stops]:
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


def _within(one: OperandSlice, z: np.ndarray, reach: tuple[float, float]) -> tuple[float, float]:
    """Shares of a leg on which a stretch of operand 1 can reach into the plane z = 0; none when low > high."""
    assert one.heights is not None
    grow = reach[0] + one.section.width * math.sin(reach[1])
    low, high = -one.heights[1] - grow, -one.heights[0] + grow  # of z
    travel = float(z[1] - z[0])
    if travel == 0.0:
        return (0.0, 1.0) if low <= z[0] <= high else (1.0, 0.0)
    ends = sorted(((low - float(z[0])) / travel, (high - float(z[0])) / travel))
    return max(0.0, ends[0]), min(1.0, ends[1])


def _bits(view: PlaneView, stops: Bits) -> Bits:
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


def spans(moving: PlaneDiagram, fixed: PlaneDiagram, leg: Leg) -> Spans:
    """Every contact that is possible on a leg, with the shares of the leg and the motions that it stops.

    The moving section is about its nominal centre at the nominal angle; the fixed diagram is that of operand 2.
    """
    lines = _lines(moving, fixed, leg.half_angle)
    rows, shares = lines.spans(leg)
    halted = stops(lines.force[rows], lines.arms(rows, leg.at(shares[:, 2])), leg.size)
    return Spans(shares[:, 0], shares[:, 1], halted)


def _lines(moving: PlaneDiagram, fixed: PlaneDiagram, half_angle: float) -> Lines:
    """Every pair of a corner and an edge, and of a circle about the nominal centre and what it stays off."""
    edge, corner, turns = _meeting(fixed, moving, -1.0, half_angle)
    own_edge, own_corner, own_turns = _meeting(moving, fixed, 1.0, half_angle)
    radii = np.repeat([arc.radius for arc in moving.arcs], len(fixed.ends))
    normals = np.tile(fixed.normals, (len(moving.arcs), 1))
    # A circle touches an edge where its centre lies on the edge moved out by the radius.
    pushed = np.tile(fixed.ends, (len(moving.arcs), 1, 1)) + radii[:, None, None] * normals[:, None]
    rounds = np.reshape([row for arc in moving.arcs for row in _rounds(arc.radius, fixed)], (-1, 7))
    about, (reach, middle, half, own, sign) = rounds[:, :2], rounds[:, 2:].T
    out = np.column_stack([np.cos(middle), np.sin(middle)])
    off, still = sign[:, None] * out, np.zeros((len(own_edge), 2))
    parts = [
        (fixed.ends[edge], _twice(moving.points[corner]), fixed.normals[edge], turns, moving.points[corner]),
        (_twice(fixed.points[own_corner]), moving.ends[own_edge], -moving.normals[own_edge], own_turns, still),
        (pushed, np.zeros_like(pushed), normals, np.zeros_like(normals), -radii[:, None] * normals),
        (_twice(about), _twice(-reach[:, None] * out), off, half[:, None] * (-1.0, 1.0), -own[:, None] * off),
    ]
    return Lines(*map(np.concatenate, zip(*parts, strict=True)))


def _twice(points: Array) -> Array:
    """Points (n, 2) as lines (n, 2, 2) of no length."""
    return np.repeat(points[:, None], 2, axis=1)


def _meeting(one: PlaneDiagram, other: PlaneDiagram, sense: float, half_angle: float) -> tuple[Indices, Indices, Array]:
    """Edges of one and corners of the other that can meet from outside, with opposite normals, at turns of the cone.

    The sense is 1 when the edges turn with ψ, −1 when the corners do; half the angle of the cone is s. The answer is
    which edges and corners (n,), and the first and the last of the turns (n, 2), rad.
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
    return i, j, np.sort(np.stack([low[k, i, j], high[k, i, j]], axis=1), axis=1)


def _rounds(radius: float, fixed: PlaneDiagram) -> Iterator[tuple[float, ...]]:
    """Contacts of a circle about the nominal centre with corners and arcs: its centre stays off them by its radius.

    Each is the quarter of an arc on which the centre is then: x and y of the arc's centre, its radius, m, the bearing
    of its middle and half its opening, rad, the circle's radius, m, and 1 where the force points away from the arc's
    centre, −1 towards it.
    """
    for (x, y), (first, opening) in zip(fixed.points.tolist(), fixed.fans.tolist(), strict=True):
        for middle, half in _quarters(first, opening):
            yield x, y, radius, middle, half, radius, 1.0
    for arc in fixed.arcs:
        # A smaller circle touches a hollow one from inside, at the difference of the radii; a larger one not at all.
        sign = math.copysign(1.0, arc.sweep)
        if (reach := arc.radius + sign * radius) > 0.0:
            for middle, half in _quarters(min(arc.start, arc.start + arc.sweep), abs(arc.sweep)):
                yield *arc.centre.tolist(), reach, middle, half, radius, sign


def _quarters(first: float, opening: float) -> Iterator[tuple[float, float]]:
    """Middles and halves of an arc of angles cut at the multiples of a right angle."""
    last, quarter = first + opening, 0.5 * math.pi
    cuts = [quarter * k for k in range(math.floor(first / quarter) + 1, math.ceil(last / quarter))]
    for a, b in pairwise([first, *(cut for cut in cuts if first + 1e-12 < cut < last - 1e-12), last]):
        yield 0.5 * (a + b), 0.5 * (b - a)


def stops(force: Array, arm: Array, size: float) -> Bits:
    """The motions (n, 6), u+, u−, v+, v−, ψ+, ψ−, that unit forces (n, 2) on operand 1 stop.

    They act at `arm` (n, 2), m, from the nominal centre; `size`, m, is there to compare torques with forces.
    """
    # Torque over size is a force, so that one threshold serves all three.
    torque = (arm[:, 0] * force[:, 1] - arm[:, 1] * force[:, 0]) / size
    value = np.column_stack([force, torque])
    return np.stack([value < -_STILL, value > _STILL], axis=2).reshape(-1, 6)
