"""Where two curves meet: crossings, tangencies, and ends that lie on the other curve, as pairs of parameters.

Pieces that run along each other meet in their ends alone, so that splitting at the answer leaves either equal pieces
or pieces that share no inner point.
"""

import math
from itertools import chain

import numpy as np

from fmopt.geometry.plane.conic import ConicArc, unit_roots
from fmopt.geometry.plane.curve import Arc, Curve, LineSegment, distance
from fmopt.spatial.values import Array

_PROBES = np.linspace(0.0, 1.0, 7)  # more than the four points that two different conics can share


def meet(a: Curve, b: Curve, tolerance: float) -> list[tuple[float, float]]:
    """Parameters (s on a, t on b) of the points where the curves come within `tolerance` (m) of each other."""
    # Ends first: a crossing next to an end is often lost to rounding, while the end itself is found.
    pairs = list(chain(_ends_on(a, b, tolerance), ((s, t) for t, s in _ends_on(b, a, tolerance))))
    if isinstance(a, ConicArc) or isinstance(b, ConicArc):
        # Conics that run along each other have no crossings to solve for, and equations full of noise instead.
        overlapping = len(pairs) > 1 and _along(a, b, pairs, tolerance)
        return pairs if overlapping else pairs + _conic(a, b, tolerance)
    if isinstance(a, LineSegment) and isinstance(b, LineSegment):
        return pairs + _lines(a, b, tolerance)
    if isinstance(a, Arc) and isinstance(b, Arc):
        return pairs + _circles(a, b, tolerance)
    if isinstance(a, LineSegment) and isinstance(b, Arc):
        return pairs + _line_circle(a, b, tolerance)
    assert isinstance(a, Arc)
    assert isinstance(b, LineSegment)
    return pairs + [(s, t) for t, s in _line_circle(b, a, tolerance)]


def _ends_on(a: Curve, b: Curve, tolerance: float) -> list[tuple[float, float]]:
    lower, upper = b.box
    (left, down), (right, up) = lower - tolerance, upper + tolerance
    found = []
    for s, end in ((0.0, a.first), (1.0, a.last)):
        x, y = end
        if not (left <= x <= right and down <= y <= up):
            continue
        # Its own ends are tried before any nearest point, so that a shared vertex has the parameters 0 and 1 on both.
        t = next((t for t, own in ((0.0, b.first), (1.0, b.last)) if math.dist(end, own) <= tolerance), None)
        if t is None:
            nearest = float(b.nearest(end[None])[0])
            t = nearest if math.dist(b.point(nearest), end) <= tolerance else None
        if t is not None:
            found.append((s, t))
    return found


def _lines(a: LineSegment, b: LineSegment, tolerance: float) -> list[tuple[float, float]]:
    (ux, uy), (vx, vy), (dx, dy) = a.end - a.start, b.end - b.start, b.start - a.start
    cross, la, lb = float(ux * vy - uy * vx), math.hypot(ux, uy), math.hypot(vx, vy)
    # Parallel: what they share was found by the ends.
    if abs(cross) <= 1e-14 * la * lb:
        return []
    return _within(float(dx * vy - dy * vx) / cross, float(dx * uy - dy * ux) / cross, tolerance / la, tolerance / lb)


def _within(s: float, t: float, slack_s: float, slack_t: float) -> list[tuple[float, float]]:
    if -slack_s <= s <= 1.0 + slack_s and -slack_t <= t <= 1.0 + slack_t:
        return [(min(max(s, 0.0), 1.0), min(max(t, 0.0), 1.0))]
    return []


def _line_circle(a: LineSegment, b: Arc, tolerance: float) -> list[tuple[float, float]]:
    along = a.end - a.start
    length = float(np.hypot(*along))
    if length == 0.0 or b.radius == 0.0:
        return []
    ux, uy = along / length
    dx, dy = b.centre - a.start
    foot, off = float(dx * ux + dy * uy), float(ux * dy - uy * dx)
    if abs(off) > b.radius + tolerance:
        return []
    # Within the tolerance of a tangent the two roots are noise about one; it is taken as that one.
    half = math.sqrt(b.radius**2 - off**2) if abs(off) < b.radius - tolerance else 0.0
    found: list[tuple[float, float]] = []
    # A set, as both signs of 0 are one step.
    for step in {half, -half}:
        x, y = step * ux + off * uy, step * uy - off * ux
        share = b.share(math.atan2(y, x), tolerance / b.radius)
        if share is not None:
            found += _within((foot + step) / length, share, tolerance / length, 0.0)
    return found


def _circles(a: Arc, b: Arc, tolerance: float) -> list[tuple[float, float]]:
    dx, dy = (float(d) for d in b.centre - a.centre)
    apart = math.hypot(dx, dy)
    # Concentric circles meet nowhere, or everywhere.
    if apart + abs(a.radius - b.radius) <= tolerance or apart == 0.0 or min(a.radius, b.radius) == 0.0:
        return []
    if apart > a.radius + b.radius + tolerance or apart < abs(a.radius - b.radius) - tolerance:
        return []
    touching = min(a.radius + b.radius - apart, apart - abs(a.radius - b.radius)) <= tolerance
    # Written as a product: a difference of squares cancels where the radii nearly agree.
    foot = 0.5 * (apart + (a.radius - b.radius) * (a.radius + b.radius) / apart)
    height = 0.0 if touching else math.sqrt(max(a.radius**2 - foot**2, 0.0))
    # At a tangency the foot is on the line of centres, at the radius itself: the height is noise.
    if touching:
        foot = math.copysign(a.radius, foot)
    ux, uy = dx / apart, dy / apart
    found = []
    for h in {height, -height}:
        x, y = foot * ux - h * uy, foot * uy + h * ux
        s = a.share(math.atan2(y, x), tolerance / a.radius)
        t = b.share(math.atan2(y - dy, x - dx), tolerance / b.radius)
        if s is not None and t is not None:
            found.append((s, t))
    return found


def _along(a: Curve, b: Curve, pairs: list[tuple[float, float]], tolerance: float) -> bool:
    """Whether the curves run along each other between the outermost of the meetings `pairs`."""
    shares = [s for s, _ in pairs]
    probes = a.point(min(shares) + (max(shares) - min(shares)) * _PROBES)
    # A run shorter than that is one point within the tolerance, where any two curves agree.
    return bool(np.max(np.linalg.norm(probes - probes[0], axis=1)) > 4.0 * tolerance) and bool(
        np.max(distance(b, probes)) <= 2.0 * tolerance
    )


def _conic(a: Curve, b: Curve, tolerance: float) -> list[tuple[float, float]]:
    """Meetings with at least one conic arc: its points put into the other's equation give a quadratic or quartic."""
    if not isinstance(a, ConicArc):
        return [(s, t) for t, s in _conic(b, a, tolerance)]
    # A conic arc flatter than the tolerance is its chord: its equation would be a double line.
    if _flat(a, tolerance):
        return _straightened(a, b, tolerance)
    if isinstance(b, ConicArc) and _flat(b, tolerance):
        return [(s, t) for t, s in _straightened(b, a, tolerance)]
    value = _equation(b, a.homogeneous)
    if value is None or sum(map(abs, value)) <= tolerance:
        return []
    found = []
    for s in unit_roots(value, 0.5 * tolerance):
        point = a.point(s)[None]
        t = b.nearest(point)
        # Roots of the implicit equation are on the whole conic of b; only those on its arc count.
        if float(np.linalg.norm(b.point(t) - point)) <= tolerance:
            found.append((s, float(t[0])))
    return found


def _equation(b: Curve, own: Array) -> list[float] | None:
    """Coefficients in s of b's implicit equation on a conic, scaled to read as a distance; None for a point."""
    x, y, w = own.T
    if isinstance(b, LineSegment):
        along = b.end - b.start
        if b.length == 0.0:
            return None
        nx, ny = -along[1] / b.length, along[0] / b.length
        return [float(c) for c in nx * (x - b.start[0] * w) + ny * (y - b.start[1] * w)]
    if isinstance(b, Arc):
        if b.radius == 0.0:
            return None
        x, y = x - b.centre[0] * w, y - b.centre[1] * w
        square = np.convolve(x, x) + np.convolve(y, y) - b.radius**2 * np.convolve(w, w)
        # Divided by 2r, the equation reads as a distance near the circle.
        return [float(c) for c in 0.5 * square / b.radius]
    # Seen from a point of the arc, since far from 0 its three corners make a matrix next to singular.
    origin = b.point(0.5)
    matrix = ConicArc(b.first - origin, b.shoulder - origin, b.last - origin, b.weight).implicit()
    # By the size of the gradient at the middle, for the same reason.
    gradient = 2.0 * float(np.hypot(*matrix[:2, 2]))
    rows = np.stack([x - origin[0] * w, y - origin[1] * w, w])
    (aa, ab, ac), (ba, bb, bc), (ca, cb, cc) = (rows.T @ (matrix / gradient) @ rows).tolist()
    return [aa, ab + ba, ac + bb + ca, bc + cb, cc]


def _flat(arc: ConicArc, tolerance: float) -> bool:
    return abs(arc.turn) <= tolerance * float(np.hypot(*(arc.last - arc.first)))


def _straightened(a: ConicArc, b: Curve, tolerance: float) -> list[tuple[float, float]]:
    chord = LineSegment(a.first, a.last)
    return [(float(a.nearest(chord.point(s)[None])[0]), t) for s, t in meet(chord, b, tolerance)]
