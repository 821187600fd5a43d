"""Exact tests between points, triangles and half-spaces whose coordinates are integers.

Points are multiples of 2⁻¹⁰⁰ m: floats above 10⁻¹⁴ m are such, and what is between two of them is moved to one by less
than `MOVED`. A surface whose vertices are moved by so much bounds the same solid but for what is within that of it.
Points where planes meet are held as (x, y, z, w), w > 0, for (x, y, z)/w.
"""

from collections.abc import Sequence

from fmopt.verify.arithmetic.exact import height as elevation
from fmopt.verify.arithmetic.exact import inner, outer
from fmopt.verify.arithmetic.rational import BITS, ONE, Vector, sub

FINENESS = 100
MOVED = ONE >> (FINENESS - 1)  # m, in fixed point

Point = tuple[int, int, int]
Place = tuple[int, int, int, int]
HalfSpace = tuple[int, int, int, int]  # (a, b, c, d): a x + b y + c z ≤ d
Flat = tuple[int, int]
Corners = tuple[Point, Point, Point]
Loops = tuple[tuple[int, ...], ...]
Bounds = tuple[int, int, int, int, int, int]  # least x, y, z, greatest x, y, z


class TooMuchWork(Exception):
    """The bodies would take more steps to compare than bodies of their size may."""


class WorkLeft:
    """Steps of work left."""

    def __init__(self, steps: int) -> None:
        self.left = steps

    def spend(self, steps: int) -> None:
        """Takes steps off.

        Raises:
            TooMuchWork: none are left.
        """
        self.left -= steps
        if self.left < 0:
            raise TooMuchWork


def on_lattice(v: Vector) -> Point:
    """A fixed-point vector in units of 2⁻¹⁰⁰ m."""
    shift = BITS - FINENESS
    return (v[0] >> shift, v[1] >> shift, v[2] >> shift)


def place(p: Point) -> Place:
    """A point of the lattice as a place."""
    return (p[0], p[1], p[2], 1)


def bounds(points: Sequence[Place]) -> Bounds:
    """A box around places, rounded outwards."""
    least = [(x // w, y // w, z // w) for x, y, z, w in points]
    most = [(-(-x // w), -(-y // w), -(-z // w)) for x, y, z, w in points]
    low, high = ([choose(v[axis] for v in ends) for axis in range(3)] for choose, ends in ((min, least), (max, most)))
    return (low[0], low[1], low[2], high[0], high[1], high[2])


def apart(a: Bounds, b: Bounds) -> bool:
    """Whether two boxes have no point in common."""
    return a[3] < b[0] or b[3] < a[0] or a[4] < b[1] or b[4] < a[1] or a[5] < b[2] or b[5] < a[2]


def through(a: Point, b: Point, c: Point) -> HalfSpace:
    """The half-space behind the plane of three points, which run counter-clockwise seen from its front.

    On a line they make a normal of 0.
    """
    n = outer(sub(b, a), sub(c, a))
    return (*n, inner(n, a))


def height(h: HalfSpace, p: Point) -> int:
    """A number of the sign of a point's height over the plane of a half-space."""
    return h[0] * p[0] + h[1] * p[1] + h[2] * p[2] - h[3]


def elevations(h: HalfSpace, points: Sequence[Place]) -> list[int]:
    """The elevation of each of some places."""
    a, b, c, d = h
    return [a * x + b * y + c * z - d * w for x, y, z, w in points]


def common(points: Sequence[Place], spaces: Sequence[HalfSpace]) -> bool:
    """Whether the convex hull of places that lie in one plane, in order around it, has a point in all half-spaces."""
    crossing = []
    for space in spaces:
        heights = elevations(space, points)
        if min(heights) > 0:
            return False
        # What holds all corners cuts nothing off.
        if max(heights) > 0:
            crossing.append(space)
    for space in crossing:
        points = _behind(points, space)
        if not points:
            return False
    return True


def _behind(points: Sequence[Place], space: HalfSpace) -> list[Place]:
    """The corners of the part of a convex polygon, segment or point in a closed half-space."""
    kept: list[Place] = []
    p, h = points[-1], elevation(space, points[-1])
    for q in points:
        g = elevation(space, q)
        if (h < 0 < g) or (g < 0 < h):
            # A mean of both ends with their heights as weights, without division: w stays positive as both are.
            s, t = abs(g), abs(h)
            kept.append((s * p[0] + t * q[0], s * p[1] + t * q[1], s * p[2] + t * q[2], s * p[3] + t * q[3]))
        if g <= 0:
            kept.append(q)
        p, h = q, g
    return kept


def turn(a: Flat, b: Flat, c: Flat) -> int:
    """A number that is positive where a, b, c run counter-clockwise, 0 where they are on a line."""
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def cross_or_touch(p: Flat, q: Flat, a: Flat, b: Flat) -> bool:
    """Whether the segments p q and a b have a point in common."""
    if max(p[0], q[0]) < min(a[0], b[0]) or max(a[0], b[0]) < min(p[0], q[0]):
        return False
    if max(p[1], q[1]) < min(a[1], b[1]) or max(a[1], b[1]) < min(p[1], q[1]):
        return False
    one, two = turn(p, q, a), turn(p, q, b)
    if (one > 0 and two > 0) or (one < 0 and two < 0):
        return False
    three, four = turn(a, b, p), turn(a, b, q)
    # On one line their boxes meet where they do.
    return not ((three > 0 and four > 0) or (three < 0 and four < 0))


def folds_back(a: Flat, b: Flat, c: Flat) -> bool:
    """Whether the way from b to c goes back along the way from a to b."""
    return turn(a, b, c) == 0 and (b[0] - a[0]) * (c[0] - b[0]) + (b[1] - a[1]) * (c[1] - b[1]) < 0


def seen_along(axis: int, p: Point) -> Flat:
    """A point without one coordinate (0, 1 or 2), the others in cyclic order."""
    return (p[(axis + 1) % 3], p[(axis + 2) % 3])


def steepest(n: Sequence[int]) -> int:
    """The axis along which a direction goes most."""
    return max(range(3), key=lambda axis: abs(n[axis]))


def meets(p: Point, q: Point, corners: Corners, plane: HalfSpace) -> bool:
    """Whether the segment p q has a point in a triangle that has an area."""
    h, g = height(plane, p), height(plane, q)
    if (h > 0 and g > 0) or (h < 0 and g < 0):
        return False
    a, b, c = corners
    if h == 0 and g == 0:
        # Left out is the axis along which the plane is steepest, so that no triangle with an area becomes a line.
        axis = steepest(plane)
        u, v = seen_along(axis, p), seen_along(axis, q)
        flat = [seen_along(axis, x) for x in corners]
        sides = [(flat[0], flat[1]), (flat[1], flat[2]), (flat[2], flat[0])]
        turns = [turn(s, t, u) for s, t in sides]
        # Seen from behind, the triangle runs clockwise.
        return min(turns) >= 0 or max(turns) <= 0 or any(cross_or_touch(u, v, s, t) for s, t in sides)
    # The line p q goes through the triangle where it passes all three sides on the same hand.
    sides3 = [height(through(p, q, s), t) for s, t in ((a, b), (b, c), (c, a))]
    return min(sides3) >= 0 or max(sides3) <= 0
