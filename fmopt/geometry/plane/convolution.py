"""Minkowski sums: the convolution of two boundaries, and the points that it winds round.

A boundary is a run of features over the direction θ of travel: lines with one θ, and turns over a range of θ: arcs,
conic arcs, and corners, which are arcs of radius 0. Left turns count 1, right turns −1. The convolution holds a line
translated by the point of the other boundary where that has the same θ, and the sum of two turns where their ranges
overlap, each as often as the product of their signs says. Its winding number round p is the Euler characteristic of
A ∩ (p − B), so that for A and B without holes it is at least 1 in the sum and 0 outside.

A point p stays free of the sum inside a hole H of A when p − B fits into H. The convolution of the hole with B alone
then winds −1 times round p, and not less than 0 times elsewhere, if B has the smaller area; else nothing is free and
the hole takes no part. Holes of B likewise.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import TypeAlias

import numpy as np

from fmopt.geometry.plane.boolean import positive, union
from fmopt.geometry.plane.conic import ConicArc
from fmopt.geometry.plane.curve import Arc, Curve, LineSegment
from fmopt.geometry.plane.region import Region
from fmopt.spatial.values import Array, Indices

_CUSP = 1e-6  # rad: nearer to a half turn the side is read off the curves, not the tangents
_FLAT = 1e-14  # sine between the legs of a conic arc, below which it counts as its chord
_EQUAL = 1e-12  # of an area: a hole has to be larger than the other operand by more than rounding
_PROBES = 33  # directions, between neighbours of which the sum of two radii is taken to change its sign once at most

_INSIDE = 0.4142135623730951  # a parameter at which hardly any curve touches another

_INNER = np.linspace(0.0, 1.0, 17)[1:-1]  # shares of a range of directions, its ends aside
_MARGIN = 0.5  # of the spread of the weights that were seen, for those between the points
_LEAST_TURN = 1e-4  # rad

_Row: TypeAlias = tuple[Array, float, float, float, float, ConicArc | None]


def minkowski_sum(first: Region, second: Region, tolerance: float) -> Region:
    """The regularised Minkowski sum A ⊕ B = {a + b}; empty when an operand is.

    Exact for boundaries of segments and circular arcs, and where a conic arc meets edges and corners. Where it meets
    curves of the other operand the sum of the two is no conic: conic arcs outside of it and within `tolerance` are
    fitted, as 15 points of each tell: there the answer contains the sum, with a margin but without a proof.
    """
    return union([_sum(a, b, tolerance) for a in components(first) for b in components(second)])


def _sum(first: Region, second: Region, tolerance: float) -> Region:
    """The sum of two connected regions."""
    areas = [[sum(curve.moment() for curve in loop) for loop in region.loops] for region in (first, second)]
    whole = [max(area) for area in areas]
    curves: list[Curve] = []
    for loop, area in zip(first.loops, areas[0], strict=True):
        for other, beside in zip(second.loops, areas[1], strict=True):
            # A hole survives only if the other operand fits into it, and that needs a larger area: an easy test that
            # drops most.
            fits = -area > whole[1] * (1.0 + _EQUAL) if area < 0.0 else -beside > whole[0] * (1.0 + _EQUAL)
            if (area > 0.0 and beside > 0.0) or (area * beside < 0.0 and fits):
                curves += convolution(loop, other, tolerance)
    return positive(curves)


@dataclass(frozen=True, eq=False)
class _Lines:
    """Straight features: ends (n, 2) in m and directions (n,) in [0, 2π)."""

    start: Array
    end: Array
    angle: Array


@dataclass(frozen=True, eq=False)
class _Turns:
    """Turning features c + ρ n(θ), n to the right of θ, for low ≤ θ ≤ high within [0, 2π]."""

    centre: Array  # c (n, 2) in m
    radius: Array  # ρ (n,) in m: 0 corners, negative right turns; nan where a conic arc takes the place of the formula
    low: Array  # (n,) in rad
    high: Array  # (n,) in rad
    sign: Array  # (n,), 1 for left turns, −1 for right turns
    conics: tuple[ConicArc | None, ...]  # the conic arc of a row, None elsewhere


def convolution(first: Sequence[Curve], second: Sequence[Curve], tolerance: float) -> list[Curve]:
    """The convolution of two closed loops, as curves in no order; sums that are no conics as in `minkowski_sum`.

    Equal directions are told apart as if the first loop were turned right by an infinitesimal angle.
    """
    lines, turns = _features(first)
    other_lines, other_turns = _features(second)
    # Directions of 0 count as 2π on one side and as 0 on the other, so that each pair of equal ones is taken once.
    late = np.where(lines.angle == 0.0, math.tau, lines.angle)[:, None]
    i, j = np.nonzero((other_turns.low < late) & (late <= other_turns.high))
    found = _translated(lines, i, other_turns, j)
    early = other_lines.angle[:, None]
    j, i = np.nonzero((turns.low <= early) & (early < turns.high))
    return found + _translated(other_lines, j, turns, i) + _turned(turns, other_turns, tolerance)


def _translated(lines: _Lines, rows: Indices, turns: _Turns, places: Indices) -> list[Curve]:
    """Each line moved by the point of a turn that has its direction, run through backward for right turns."""
    offsets = _points(turns, places, lines.angle[rows])
    starts, ends = lines.start[rows] + offsets, lines.end[rows] + offsets
    # The convolution is a cycle with signs; right turns are reflex corners, whose lines enter backward.
    ahead = turns.sign[places] > 0.0
    return [LineSegment(a, b) if on else LineSegment(b, a) for a, b, on in zip(starts, ends, ahead, strict=True)]


def _points(turns: _Turns, rows: Indices, angles: Array) -> Array:
    """Points (n, 2) of the turns in `rows` at directions (n,) in rad."""
    points = turns.centre[rows] + turns.radius[rows, None] * np.stack([np.sin(angles), -np.cos(angles)], axis=-1)
    for row in np.unique(rows[np.isnan(turns.radius[rows])]).tolist():
        conic, here = turns.conics[row], rows == row
        assert conic is not None
        points[here] = conic.point(_shares(conic, angles[here]))
    return np.asarray(points)


def _turned(turns: _Turns, others: _Turns, tolerance: float) -> list[Curve]:
    """Sums of turns over the directions that they have in common."""
    low, high = np.maximum(turns.low[:, None], others.low), np.minimum(turns.high[:, None], others.high)
    radius = turns.radius[:, None] + others.radius
    found: list[Curve] = []
    for i, j in zip(*(rows.tolist() for rows in np.nonzero((low < high) & (radius != 0.0))), strict=True):
        # Radii that cancel make a turn of no size, a point; nan, of a conic, compares unequal to 0 and stays.
        a, b = float(low[i, j]), float(high[i, j])
        one, two = (turns, i), (others, j)
        size = float(radius[i, j])
        if not math.isnan(size):
            ahead = turns.sign[i] * others.sign[j] > 0.0
            start, sweep = (a, b - a) if ahead else (b, a - b)
            # n(θ) is to the right of the direction θ, hence 90° back; for a negative radius ahead.
            start -= math.copysign(0.5 * math.pi, size)
            found.append(Arc(turns.centre[i] + others.centre[j], abs(size), start, sweep))
        elif others.radius[j] == 0.0:
            found.append(_piece(one, two, a, b))
        elif turns.radius[i] == 0.0:
            found.append(_piece(two, one, a, b))
        else:
            found += _blended(one, two, a, b, tolerance)
    return found


_Turn: TypeAlias = tuple[_Turns, int]


def _piece(turn: _Turn, corner: _Turn, low: float, high: float) -> Curve:
    """The piece of a conic arc between two directions, moved to a corner, and run through backward for a reflex one."""
    conic = turn[0].conics[turn[1]]
    assert conic is not None
    a, b = np.sort(_shares(conic, np.array([low, high]))).tolist()
    piece = conic.part(a, b).moved(np.eye(2), corner[0].centre[corner[1]])
    return piece if corner[0].sign[corner[1]] > 0.0 else piece.reversed()


def _blended(one: _Turn, two: _Turn, low: float, high: float, tolerance: float) -> list[Curve]:
    """The sum of two curved turns, in pieces along which the sum of their radii of curvature keeps its sign."""

    def sum_of(value: Callable[[_Turns, Indices, Array], Array], angles: Array) -> Array:
        a, b = (value(turns, np.full(len(angles), row), angles) for turns, row in (one, two))
        return np.asarray(a + b)

    points, probes = partial(sum_of, _points), np.linspace(low, high, _PROBES)
    positive_ = sum_of(_radii, probes) > 0.0
    stops = [low]
    # Where the sum of radii of curvature changes its sign, the sum has a cusp: no conic runs through that.
    for k in np.flatnonzero(positive_[1:] != positive_[:-1]).tolist():
        a, b = float(probes[k]), float(probes[k + 1])
        # 60 halvings: to the last bit.
        for _ in range(60):
            middle = 0.5 * (a + b)
            if (sum_of(_radii, np.array([middle]))[0] > 0.0) == positive_[k]:
                a = middle
            else:
                b = middle
        stops.append(b)
    ahead = bool(one[0].sign[one[1]] * two[0].sign[two[1]] > 0.0)
    spans = [(a, b) for a, b in pairwise([*stops, high]) if a < b]
    return [curve for a, b in spans for curve in _fitted(points, a, b, ahead, tolerance)]


def _radii(turns: _Turns, rows: Indices, angles: Array) -> Array:
    """Signed radii of curvature (n,) in m at directions (n,) in rad."""
    radii = turns.radius[rows]
    for row in np.unique(rows[np.isnan(radii)]).tolist():
        conic, here = turns.conics[row], rows == row
        assert conic is not None
        radii[here] = 1.0 / conic.curvature(_shares(conic, angles[here]))
    return radii


def _shares(conic: ConicArc, angles: Array) -> Array:
    """The parameters (n,) at which a conic arc runs in the directions (n,) in rad.

    With n to the right of the direction the tangent is along it where a (1−t)² + c t (1−t) + e t² = 0,
    a = w (p₁−p₀)·n, c = (p₂−p₀)·n, e = w (p₂−p₁)·n: of its roots in t / (1−t) one is positive, as a and e differ in
    sign.
    """
    # Support functions in place of angles of tangents: no inverse of a rational function is needed.
    normals = math.copysign(1.0, conic.turn) * np.stack([np.sin(angles), -np.cos(angles)])
    a = np.maximum(conic.weight * (conic.shoulder - conic.first) @ normals, 0.0)
    c = (conic.last - conic.first) @ normals
    e = np.maximum(-conic.weight * (conic.last - conic.shoulder) @ normals, 0.0)
    root = np.sqrt(c**2 + 4.0 * a * e)
    # Of the two forms of the root the one whose terms have one sign, so that nothing cancels.
    top = np.where(c > 0.0, c + root, 2.0 * a)
    return np.asarray(top / (top + np.where(c > 0.0, 2.0 * e, root - c)))


def _features(loop: Sequence[Curve]) -> tuple[_Lines, _Turns]:
    """The lines and turns of a closed loop."""
    curves = [_plain(curve) for curve in loop if curve.length > 0.0]
    stops = [_directions(curve) for curve in curves]
    lines = [(curve.first, curve.last, at[0]) for curve, at in zip(curves, stops, strict=True) if len(at) == 1]
    rows: list[_Row] = []
    for k, (curve, at) in enumerate(zip(curves, stops, strict=True)):
        after = (k + 1) % len(curves)
        for a, b in pairwise(at):
            if isinstance(curve, Arc):
                sign = math.copysign(1.0, curve.sweep)
                rows += _ranges(curve.centre, sign * curve.radius, a, b, sign, None)
            elif isinstance(curve, ConicArc):
                rows += _ranges(np.zeros(2), math.nan, a, b, math.copysign(1.0, curve.turn), curve)
        sign = _corner_sign(curve, curves[after], at[-1], stops[after][0])
        rows += _ranges(curve.last, 0.0, at[-1], stops[after][0], sign, None)
    start, end, angle = zip(*lines, strict=True) if lines else ((), (), ())
    return _Lines(_points_of(start), _points_of(end), np.array(angle, dtype=np.float64)), _as_turns(rows)


def _as_turns(rows: list[_Row]) -> _Turns:
    numbers = np.array([row[1:5] for row in rows], dtype=np.float64).reshape(-1, 4)
    radius, low, high, sign = numbers.T
    return _Turns(_points_of([row[0] for row in rows]), radius, low, high, sign, tuple(row[5] for row in rows))


def _points_of(points: Sequence[Array]) -> Array:
    return np.array(points, dtype=np.float64).reshape(-1, 2)


def _plain(curve: Curve) -> Curve:
    """The curve, or its chord for a conic arc that hardly turns."""
    if isinstance(curve, ConicArc):
        legs = float(np.hypot(*(curve.shoulder - curve.first)) * np.hypot(*(curve.last - curve.shoulder)))
        if abs(curve.turn) <= _FLAT * legs:
            return LineSegment(curve.first, curve.last)
    return curve


def _directions(curve: Curve) -> list[float]:
    """Directions of travel in [0, 2π): first and last one, and for arcs some between, at most 90° apart."""
    if isinstance(curve, LineSegment):
        return [_direction(curve.end - curve.start)]
    if isinstance(curve, ConicArc):
        return [_direction(curve.shoulder - curve.first), _direction(curve.last - curve.shoulder)]
    count = max(math.ceil(abs(curve.sweep) / (0.5 * math.pi) - 1e-9), 1)  # so much longer is rounding
    begin = curve.start + math.copysign(0.5 * math.pi, curve.sweep)
    return [_reduced(begin + curve.sweep * k / count) for k in range(count + 1)]


def _direction(along: Array) -> float:
    return _reduced(math.atan2(along[1], along[0]))


def _reduced(angle: float) -> float:
    """The same angle in [0, 2π)."""
    # `%` may round up to the full turn for tiny negative angles.
    turned = angle % math.tau
    return turned if turned < math.tau else 0.0


def _corner_sign(curve: Curve, following: Curve, before: float, after: float) -> float:
    """1 where the boundary turns left from one curve to the next, −1 where it turns right."""
    turn = math.remainder(after - before, math.tau)
    if abs(turn) < math.pi - _CUSP:
        return math.copysign(1.0, turn)
    # A turn by 180° has either sign: the curves themselves tell, a little way off the corner.
    radius = 0.5 * min(float(np.hypot(*(one.last - one.first))) or one.length / 4.0 for one in (curve, following))
    inner = _bearing(following, radius) - _bearing(curve.reversed(), radius)
    return 1.0 if math.remainder(inner, math.tau) <= 0.0 else -1.0


def _bearing(curve: Curve, radius: float) -> float:
    """Polar angle (rad) of the point where a curve leaves the circle of a radius (m) round its first point."""
    low, high = 0.0, 1.0
    for _ in range(60):  # to the last bit of a parameter
        middle = 0.5 * (low + high)
        inside = float(np.hypot(*(curve.point(middle) - curve.first))) < radius
        low, high = (middle, high) if inside else (low, middle)
    x, y = curve.point(high) - curve.first
    return math.atan2(y, x)


def _ranges(centre: Array, radius: float, begin: float, end: float, sign: float, conic: ConicArc | None) -> list[_Row]:
    """The rows of a turn from one direction to another: two where it passes direction 0, none where it has no range."""
    low, high = (begin, end) if sign > 0.0 else (end, begin)
    if low == high:
        return []
    # Where the range runs through direction 0 it is cut there: comparisons of angles then need no wrapping.
    spans = [(low, high)] if low < high else [(low, math.tau), (0.0, high)]
    return [(centre, radius, a, b, sign, conic) for a, b in spans if a < b]


def components(region: Region) -> list[Region]:
    """The parts of a region with one outer loop each: a hole belongs to the smallest loop round it."""
    areas = np.array([sum(curve.moment() for curve in loop) for loop in region.loops])
    outer, holes = np.flatnonzero(areas > 0.0), np.flatnonzero(areas <= 0.0)
    if len(outer) < 2:
        return [] if region.empty else [region]
    parts = {k: [region.loops[k]] for k in outer.tolist()}
    bounds = {k: Region((region.loops[k],)) for k in outer[np.argsort(areas[outer], kind="stable")].tolist()}
    for k in holes.tolist():
        point = max(region.loops[k], key=lambda curve: curve.length).point(_INSIDE)
        parts[next(one for one, bound in bounds.items() if bound.contains(point)[0])].append(region.loops[k])
    return [Region(tuple(loops)) for loops in parts.values()]


def _fitted(points: Callable[[Array], Array], low: float, high: float, ahead: bool, tolerance: float) -> list[Curve]:
    """Curves on the right of a given one with its ends and end tangents, within `tolerance` of it.

    The fit is halved until the weights at 15 points differ by less than the tolerance, and half as much is added.

    Points of it are (n, 2), m; its tangents run in directions from `low` to `high`, at most 90° further, rad, or
    against them all. It is travelled from low to high, which turns left, if `ahead`, else the other way.
    """
    p0, p2 = points(np.array([low, high]))
    t0, t2 = ((math.cos(angle), math.sin(angle)) for angle in (low, high))
    chord = p2 - p0
    # End tangents meet at p1; the sine of a small turn is near 0, which `_LEAST_TURN` keeps it away from.
    reach = float(chord[0] * t2[1] - chord[1] * t2[0]) / math.sin(high - low)
    p1 = p0 + reach * np.array(t0)
    height = float(np.hypot(*(p1 - 0.5 * (p0 + p2))))
    # Flat enough: the tangents lie outside, the chord inside. What is meant to hold the sum gets the outer one.
    if height <= tolerance or high - low <= _LEAST_TURN:
        run = [p0, p1, p2] if ahead else [p0, p2]
        return [LineSegment(a, b) for a, b in pairwise(run if ahead else run[::-1])]
    weights = _weights(points(low + (high - low) * _INNER), p0, p1, p2)
    least, most = float(weights.min()), float(weights.max())
    if least > 0.0 and height * (most / (1.0 + most) - least / (1.0 + least)) * (1.0 + 2.0 * _MARGIN) <= tolerance:
        spread = _MARGIN * (most - least)
        # On the safe side of every weight that was seen, by some of their spread.
        weight = most + spread if ahead else max(least - spread, 0.5 * least)  # it has to stay positive
        return [ConicArc(p0, p1, p2, weight) if ahead else ConicArc(p2, p1, p0, weight)]
    middle = 0.5 * (low + high)
    halves = [_fitted(points, low, middle, ahead, tolerance), _fitted(points, middle, high, ahead, tolerance)]
    return [curve for half in (halves if ahead else halves[::-1]) for curve in half]


def _weights(points: Array, p0: Array, p1: Array, p2: Array) -> Array:
    """Weights (n,) of the conics with given end tangents through points (n, 2), 0 for points outside the triangle."""
    u, v, d = p1 - p0, p2 - p0, points - p0
    area = u[0] * v[1] - u[1] * v[0]
    shoulder = (d[:, 0] * v[1] - d[:, 1] * v[0]) / area
    last = (u[0] * d[:, 1] - u[1] * d[:, 0]) / area
    inside = (shoulder > 0.0) & (last > 0.0) & (shoulder + last < 1.0)
    return np.where(inside, 0.5 * shoulder / np.sqrt(np.where(inside, (1.0 - shoulder - last) * last, 1.0)), 0.0)
