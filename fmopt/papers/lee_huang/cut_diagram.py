"""CUT_DIA: the cut-diagram of a solid, by divide and conquer over its tree of instances.

The cut-diagram of a tree is the same tree of regularised operators over the cut-diagrams of its instances
([LeeHuang1985] Assertion 2). Round sections stay exact: circles, ellipses, parabolas, hyperbolas.

Sections of single instances: convex loops of segments, circular arcs and conic arcs, the interior on the left.

A round instance about z has radius R(z) = a + b z. On a plane that is not horizontal let s run along its steepest
line and w across, w = 0 nearest the axis: the section is w² ≤ (R − D)(R + D), with D the signed distance of the
steepest line's point from the axis. R − D and R + D are linear in s, so that the boundary is a rational quadratic
whose control points are closed forms without cancellation.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal, TypeAlias, assert_never

import numpy as np

from fmopt.geometry import csg
from fmopt.geometry.csg import Primitive, Solid
from fmopt.geometry.plane.boolean import difference, intersection, union
from fmopt.geometry.plane.conic import ConicArc
from fmopt.geometry.plane.curve import Arc, Curve, LineSegment
from fmopt.geometry.plane.region import Region
from fmopt.runtime.clock import heed
from fmopt.spatial.se3 import Pose, cross
from fmopt.spatial.values import Array

Limit: TypeAlias = Literal[-1, 1]

ON_PLANE = 1e-12  # m: nearer corners and discs lie in the plane
_EXACT = 1e-14  # of the size: what is under a root by less is rounding
_STRAIGHT = 1e-15  # relative: flatter arcs are their chords
_FLAT = 1e-13  # of the size of an outline, or its square: the length of a side that rounding made, a corner's area
_LEAST_WEIGHT = 0.5  # of a conic piece: below it a rational quadratic crowds its points at the ends


def cut_diagram(solid: Solid, plane: Pose) -> Region:
    """The regularised section of a solid by the plane z = 0 of a pose in its frame, in the plane's x (u) and y (v), m.

    The boundary is a list of parametric curve pairs: `curve.point(t)` gives (u(t), v(t)), the interior on the left.

    Where the plane runs in a face the answer is what both sides share, the seam of two stacked bodies full, the top of
    a body empty: as [LeeHuang1985] Assertion 2 can only hold for sections that a small shift of the plane does not
    change, each limit is built over the whole tree, and the two are intersected.
    """
    above, below = zip(*_leaves(solid, plane), strict=True)
    # Nearly always the plane runs in no face, and both limits are one: half the booleans are spared.
    if all(map(same, above, below)):
        return _section(solid, iter(above))
    return intersection(_section(solid, iter(above)), _section(solid, iter(below)))


def section_limit(solid: Solid, plane: Pose, limit: Limit) -> Region:
    """The limit of the solid's sections as the plane comes from above (1, from its positive z) or from below (−1)."""
    return _section(solid, (above if limit > 0 else below for above, below in _leaves(solid, plane)))


def _leaves(solid: Solid, plane: Pose) -> Iterator[tuple[Region, Region]]:
    """Both limits of the sections of all instances, from left to right."""
    for primitive, pose, _ in csg.operands(solid, csg.exact_pose(plane).inverse()):
        yield instance_sections(primitive, pose)


def _section(solid: Solid, leaves: Iterator[Region]) -> Region:
    """The section of a tree, of those of its instances."""
    heed()
    match solid:
        case csg.Box() | csg.Cylinder() | csg.Cone() | csg.Sphere() | csg.Prism() | csg.Wedge() | csg.Hull():
            return next(leaves)
        case csg.Moved(inner, _):
            return _section(inner, leaves)
        case csg.Union(parts):
            return union([_section(part, leaves) for part in parts])
        case csg.Difference(base, tools):
            body, cuts = _section(base, leaves), [_section(tool, leaves) for tool in tools]
            # An empty base has nothing to be cut, and booleans of nothing would be computed for it.
            return difference(body, union(cuts)) if not body.empty else body
        case _:
            assert_never(solid)


def same(first: Region, second: Region) -> bool:
    """Whether two regions have the same curves to the bit, in the same order."""
    if first is second:
        return True
    mine, other = first.curves, second.curves
    return len(mine) == len(other) and all(
        # Three points of each curve tell conics apart, as both have the same order of curves.
        type(a) is type(b) and np.array_equal(a.point((0.0, 0.5, 1.0)), b.point((0.0, 0.5, 1.0)))
        for a, b in zip(mine, other, strict=True)
    )


def instance_sections(primitive: Primitive, pose: Pose) -> tuple[Region, Region]:
    """The sections by z = 0 of a primitive placed by `pose`, in x and y, as the plane comes from above and from below.

    Where the plane does not run in a face both are the section; where it does one is the face, one is empty.
    """
    match primitive:
        case csg.Cylinder(radius, height, _):
            return _round(RoundProfile(radius, 0.0, height), pose)
        case csg.Cone(bottom, top, height, _):
            return _round(RoundProfile(bottom, (top - bottom) / height, height), pose)
        case csg.Sphere(radius, _):
            ball = _ball(radius, pose)
            return ball, ball
        case _:
            return _polytope(csg.exact_pose(pose).apply(csg.corners(primitive)))


@dataclass(frozen=True)
class RoundProfile:
    """A round instance: radius a + b z in m for 0 ≤ z ≤ height."""

    a: float
    b: float
    height: float

    def radius(self, z: float) -> float:
        """The radius in m at height z."""
        return max(self.a + self.b * z, 0.0)


@dataclass(frozen=True, eq=False)
class Slant:
    """A plane that is not horizontal, seen from a round instance: the section's coordinates s (steepest) and w.

    Args:
        low: (R − D) = low[0] + low[1] s, in m.
        span: first and last s at which the section has points, last ≤ first when it has none.
        origin: of (s, w) on the plane (2,).
        along: direction of s on the plane (2,).
        across: direction of w on the plane (2,), along turned left.
    """

    low: tuple[float, float]
    high: tuple[float, float]
    span: tuple[float, float]
    origin: Array
    along: Array
    across: Array


def slant(profile: RoundProfile, pose: Pose) -> Slant:
    """How z = 0 cuts the round instance placed by `pose` in the frame of that plane, its axis not along z."""
    axis, base = pose.R[:, 2], pose.p
    rise = float(np.hypot(axis[0], axis[1]))
    along = axis[:2] / rise
    across = np.array([-along[1], along[0]])
    outward = cross(np.array([*across, 0.0]), axis)  # square to the axis and to w
    z0, z1 = float(-base @ axis), rise
    d0, d1 = float(-base @ outward), float(axis[2])
    radius = (profile.a + profile.b * z0, profile.b * z1)
    low, high = (radius[0] - d0, radius[1] - d1), (radius[0] + d0, radius[1] + d1)
    middle = float(base[:2] @ across)
    # Within the height of the instance, and where its circle reaches the plane: intervals of s, as bounds are linear.
    span = _positive([(z0, z1), (profile.height - z0, -z1), low, high])
    return Slant(low, high, span, middle * across, along, across)


def _positive(lines: list[tuple[float, float]]) -> tuple[float, float]:
    """The s at which every c₀ + c₁ s is at least zero, as (first, last)."""
    first, last = -math.inf, math.inf
    for c0, c1 in lines:
        if c1 > 0.0:
            first = max(first, -c0 / c1)
        elif c1 < 0.0:
            last = min(last, -c0 / c1)
        elif c0 < 0.0:
            return 0.0, 0.0
    return first, last


def _round(profile: RoundProfile, pose: Pose) -> tuple[Region, Region]:
    axis, base = pose.R[:, 2], pose.p
    reach = 2.0 * max(profile.radius(0.0), profile.radius(profile.height)) + profile.height
    # The axis is square to the plane as far as any of its points can tell.
    if float(np.hypot(axis[0], axis[1])) * reach <= ON_PLANE:
        height = -base[2] * math.copysign(1.0, axis[2])
        above, below = (_disc(profile, base[:2], float(height), limit) for limit in (1, -1))
        return (above, below) if axis[2] > 0.0 else (below, above)
    plane = slant(profile, pose)
    first, last = plane.span
    found = Region(())
    if last - first > ON_PLANE:
        # A section no wider than the tolerance is a tangent line: no area, hence no regularised section.
        widest = max(math.prod(_roots(plane, s, reach)) for s in (first, 0.5 * (first + last), last))
        found = Region((tuple(_outline(plane, first, last, reach)),) if widest > ON_PLANE else ())
    return found, found


def _disc(profile: RoundProfile, centre: Array, height: float, limit: int) -> Region:
    """The circle at a height over the instance's base, which the plane approaches from higher (1) or lower (−1)."""
    # The limit is a disc only if the body goes on beyond the plane on that side.
    depth = height if limit < 0 else profile.height - height  # how far the body reaches on the plane's other side
    beyond = profile.height - height if limit < 0 else height
    radius = profile.radius(min(max(height, 0.0), profile.height))
    if depth <= ON_PLANE or beyond < -ON_PLANE or radius <= ON_PLANE:
        return Region(())
    return Region(((Arc(centre, radius, 0.0, math.tau),),))


def _ball(radius: float, pose: Pose) -> Region:
    square = radius**2 - float(pose.p[2]) ** 2
    if square <= 0.0 or radius - abs(float(pose.p[2])) <= ON_PLANE:
        return Region(())
    return Region(((Arc(pose.p[:2], math.sqrt(square), 0.0, math.tau),),))


def _roots(plane: Slant, s: float, scale: float) -> tuple[float, float]:
    """√(R − D) and √(R + D) at s, rounding below 1e-14 of the size taken for zero."""
    values = (line[0] + line[1] * s for line in (plane.low, plane.high))
    # At the end of the interval the root is exactly zero, which rounding makes a small number of either sign.
    x, y = (math.sqrt(value) if value > _EXACT * scale else 0.0 for value in values)
    return x, y


def _outline(plane: Slant, first: float, last: float, scale: float) -> list[Curve]:
    """The loop w = −√((R−D)(R+D)) forth, the chord at the last s, w = +√… back, the chord at the first s."""
    stops = _stops(plane, first, last, scale)
    lower = [_branch(plane, a, b, -1.0, scale) for a, b in pairwise(stops)]
    upper = [_branch(plane, a, b, 1.0, scale).reversed() for a, b in pairwise(stops)][::-1]
    loop = list(lower)
    for following in (*upper, lower[0]):
        # A cut cap leaves a chord between the two branches; where a branch ends in a point there is none.
        if float(np.hypot(*(following.first - loop[-1].last))) > 0.0:
            loop.append(LineSegment(loop[-1].last, following.first))
        loop.append(following)
    return loop[:-1]


def _stops(plane: Slant, first: float, last: float, scale: float) -> list[float]:
    """s from first to last such that every piece has a weight of at least ½."""
    (xa, ya), (xb, yb) = _roots(plane, first, scale), _roots(plane, last, scale)
    if xa * ya + xb * yb >= _LEAST_WEIGHT * (xa * yb + xb * ya):
        return [first, last]
    middle = 0.5 * (first + last)
    return [*_stops(plane, first, middle, scale)[:-1], *_stops(plane, middle, last, scale)]


def _branch(plane: Slant, first: float, last: float, sign: float, scale: float) -> Curve:
    """The boundary curve between two s, with x = √(R−D) and y = √(R+D) at its ends a and b.

    Its weight is (x_a y_a + x_b y_b) / (x_a y_b + x_b y_a); its shoulder lies at the share
    x_a y_a / (x_a y_a + x_b y_b) of s, at w = (x_a y_b + x_b y_a)² / 2 (x_a y_a + x_b y_b).
    """
    (xa, ya), (xb, yb) = _roots(plane, first, scale), _roots(plane, last, scale)
    own, mixed = xa * ya + xb * yb, xa * yb + xb * ya

    def place(s: float, w: float) -> Array:
        return np.asarray(plane.origin + s * plane.along + sign * w * plane.across)

    start, end = place(first, xa * ya), place(last, xb * yb)
    if (xa * yb - xb * ya) ** 2 <= _STRAIGHT * own * mixed:
        return LineSegment(start, end)
    # The shoulder from the ends alone: tangents at a root, where the outline turns back, need no slope.
    shoulder = place(first + (last - first) * xa * ya / own, 0.5 * mixed**2 / own)
    return ConicArc(start, shoulder, end, own / mixed)


def _polytope(points: Array) -> tuple[Region, Region]:
    """The sections of the convex hull of points (n, 3): the hull of where pairs of them straddle the plane."""
    # Corners in the plane by rounding are in it: they belong to the section from both sides.
    height = np.where(np.abs(points[:, 2]) <= ON_PLANE, 0.0, points[:, 2])
    above, below = np.flatnonzero(height > 0.0), np.flatnonzero(height < 0.0)
    a, b = np.repeat(above, len(below)), np.tile(below, len(above))
    share = (height[a] / (height[a] - height[b]))[:, None]
    met = np.vstack([points[height == 0.0, :2], points[a, :2] + share * (points[b, :2] - points[a, :2])])
    outline = _convex_outline(met)
    found = nothing = Region(())
    if len(outline):
        found = Region((tuple(LineSegment(p, q) for p, q in zip(outline, np.roll(outline, -1, axis=0), strict=True)),))
    # With no corner above, the plane that comes from above meets nothing until it runs in the face.
    return found if len(above) else nothing, found if len(below) else nothing


def _convex_outline(points: Array) -> Array:
    """Corners (k, 2) of the convex hull, counter-clockwise, none that rounding made; no corners when flat."""
    from scipy.spatial import ConvexHull, QhullError

    try:
        outline = points[ConvexHull(points).vertices]
    except (QhullError, ValueError):  # flat, or no points
        return np.zeros((0, 2))
    size = float(np.ptp(points, axis=0).max())
    a = outline - np.roll(outline, 1, axis=0)
    outline = outline[np.linalg.norm(a, axis=1) > _FLAT * size]
    a, b = outline - np.roll(outline, 1, axis=0), np.roll(outline, -1, axis=0) - outline
    outline = outline[a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0] > _FLAT * size**2]
    return outline if len(outline) > 2 else np.zeros((0, 2))
