"""S(t) from the three cut-diagrams, as [LeeHuang1985] section 4.1.2 has it: the trapezoid's contacts with GE.

On the planes x-z and y-z the section of operand 1 through its own axis moves as its projection does; on the plane x-y,
the plane of the mouth, operand 1 counts while it reaches into that plane, each stretch of its length with its own
section. Signs are those of `freedom`. The expansion is that of every orientation in the cone, not of the nominal one
alone: with the line's width 2a kept across at the nominal angle the paper's own edges come a (1/cos s − 1) short.

On each plane this is exact: s = 0 where no pose in ball × cone touches on the plane. It is not so in space, because
bodies can meet off the planes and in corners of the box of errors that no plane shows; `freedom` is the one to rely on.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from fmopt.errors import GeometryError
from fmopt.nominal.diagram import Diagram
from fmopt.nominal.diagram_contact import spans
from fmopt.nominal.intervals import Bits, FreedomInterval, Stops, intervals, together
from fmopt.nominal.leg import Leg
from fmopt.nominal.trajectory import NominalTrajectory
from fmopt.nominal.uncertainty_zone import Zone
from fmopt.values import Value

_BLUR = 1e-12  # of T
_SAME = 1e-12


@dataclass(frozen=True, eq=False)
class Slice(Value):
    """A section of operand 1 about its nominal centre, at the goal's orientation.

    Args:
        section: in the axes u, v of the plane, m.
        heights: on the plane x-y the stretch of operand 1 (along z, from the nominal centre, m) that has this section
            at its widest; None on the other planes.
    """

    section: Diagram
    heights: tuple[float, float] | None = None


@dataclass(frozen=True, eq=False)
class View(Value):
    """A plane with the cut-diagram of operand 2, the sections of operand 1, and the radii of ball and cone."""

    zone: Zone
    fixed: Diagram
    moving: tuple[Slice, ...]


def freedom_on_planes(
    views: Sequence[View], path: NominalTrajectory, free_until: float = 0.0
) -> tuple[FreedomInterval, ...]:
    """S(t) along the nominal trajectory, piecewise constant, switching times exact to rounding.

    Args:
        views: the planes, with what is seen on them.
        path: P(t).
        free_until: s; up to here the uncertain operand 1 is known to touch nothing, however it turns.

    Returns:
        Intervals that cover [0, T], neighbours different.

    Raises:
        GeometryError: operand 1 still turns, or has not the goal's orientation, after `free_until`.
    """
    found: list[Stops] = []
    for k in range(len(path.times) - 1):
        end = float(path.times[k + 1])
        if np.abs(path.nodes[k : k + 2, 3:] - path.nodes[-1, 3:]).max() > _SAME:
            if end > free_until + _BLUR * path.duration:
                _refuse(end, free_until)
            continue
        for view in views:
            found += _stops(view, path, k, _reach(views))
    return intervals(together(found), path.duration, _BLUR * path.duration)


def _refuse(end: float, free_until: float) -> None:
    raise GeometryError(
        f"operand 1 turns until {end:.6g} s and is known to be clear of operand 2 until {free_until:.6g} s only",
        "let it reach the goal's orientation before the mouth, or start higher above it",
    )


def _reach(views: Sequence[View]) -> tuple[float, float]:
    """How far the uncertain operand 1 strays along z (m), and how far it tilts (rad)."""
    upright = [view.zone for view in views if view.zone.plane.v == 2]
    return max((zone.radius for zone in upright), default=0.0), max((zone.half_angle for zone in upright), default=0.0)


def _stops(view: View, path: NominalTrajectory, k: int, reach: tuple[float, float]) -> Iterator[Stops]:
    plane, times = view.zone.plane, path.times[k : k + 2]
    a, b = path.nodes[k, [plane.u, plane.v]], path.nodes[k + 1, [plane.u, plane.v]]
    for one in view.moving:
        low, high = 0.0, 1.0
        if one.heights is not None:
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
    bits[:, plane.turn] = stops[:, 4:6] if plane.sense > 0 else stops[:, [5, 4]]
    return bits
