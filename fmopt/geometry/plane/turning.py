"""Regions swept by a rotation about the origin."""

import math
from itertools import pairwise

import numpy as np

from fmopt.geometry.plane.boolean import union
from fmopt.geometry.plane.conic import ConicArc, unit_roots
from fmopt.geometry.plane.curve import Arc, Curve, LineSegment
from fmopt.geometry.plane.region import Region
from fmopt.spatial.values import Array

_CENTRED = 1e-14  # of the radius: an arc so nearly about the origin keeps its distance
_END = 1e-9  # of the parameter


def turned(region: Region, angle: float) -> Region:
    """The region turned about the origin through an angle in rad."""
    return region.moved(rotation(angle), (0.0, 0.0))


def turn_swept(region: Region, first: float, last: float) -> Region:
    """The union of a region's images under the rotations about the origin from `first` to `last` (rad), exact.

    The images at both ends and what each boundary curve sweeps. Along a curve whose distance r from the origin grows,
    every r has one polar angle ψ(r), and it sweeps ψ(r) + first ≤ angle ≤ ψ(r) + last: the curve at both ends and two
    arcs about the origin. From a full turn on every orientation is taken.
    """
    if region.empty:
        return region
    # A full turn is the most there is; more would count the same points again.
    sweep = min(last - first, math.tau)
    begin = turned(region, first)
    if sweep <= 0.0:
        return begin
    # Pieces along which the distance from the origin is monotonic sweep simple regions, whose union is all.
    swept = [Region((_swept(piece, sweep),)) for curve in begin.curves for piece in _pieces(curve)]
    return union([begin, turned(region, first + sweep), *swept])


def rotation(angle: float) -> Array:
    """The matrix (2, 2) of a counter-clockwise turn through an angle, rad."""
    cos, sin = math.cos(angle), math.sin(angle)
    return np.array([[cos, -sin], [sin, cos]])


def _pieces(curve: Curve) -> list[Curve]:
    """The curve in pieces along which the distance from the origin grows, or falls; none where it stays the same."""
    match curve:
        case LineSegment():
            along = curve.end - curve.start
            stops = [-float(curve.start @ along) / float(along @ along)]
        case Arc():
            x, y = curve.centre
            if math.hypot(x, y) <= _CENTRED * curve.radius:
                # About the origin itself the arc sweeps along itself.
                return []
            shares = [curve.share(math.atan2(y, x) + turn) for turn in (0.0, math.pi)]
            stops = [share for share in shares if share is not None]
        case ConicArc():
            stops = _turning_points(curve)
    cuts = [0.0, *sorted(t for t in stops if _END < t < 1.0 - _END), 1.0]
    return [curve.part(a, b) for a, b in pairwise(cuts)]


def _turning_points(conic: ConicArc) -> list[float]:
    """Parameters at which the distance of a conic arc's points from the origin is stationary.

    p·p′ = 0: with p = X/ω that is X·X′ ω − X·X ω′ = 0, whose terms in t⁵ cancel.
    """
    # d/dt of (x² + y²)/w² vanishes where (x² + y²)′ w = 2 (x² + y²) w′.
    x, y, w = conic.homogeneous.T
    square = np.convolve(x, x) + np.convolve(y, y)
    rate = np.polynomial.polynomial.polyder(square)
    value = 0.5 * np.convolve(rate, w) - np.convolve(square, np.polynomial.polynomial.polyder(w))
    scale = float(np.max(np.abs(value)))
    return unit_roots([float(c) / scale for c in value], 0.0) if scale > 0.0 else []


def _swept(piece: Curve, sweep: float) -> tuple[Curve, ...]:
    """The loop round what a piece sweeps counter-clockwise."""
    # Outward first, then along the circle: the loop has the swept region on its left.
    outward = piece if float(np.hypot(*piece.last)) > float(np.hypot(*piece.first)) else piece.reversed()
    back = outward.moved(rotation(sweep), (0.0, 0.0)).reversed()
    return (outward, *_circle(outward.last, sweep), back, *_circle(back.last, -sweep))


def _circle(start: Array, sweep: float) -> list[Curve]:
    radius = float(np.hypot(*start))
    return [Arc(np.zeros(2), radius, math.atan2(start[1], start[0]), sweep)] if radius > 0.0 else []
