"""The convex solids of model files as stacks of parallel outlines, or as points to be hulled; lengths in m.

A curved solid stands for the polyhedron inscribed in it: the corners of its outlines lie on the true circle, midway
between them one flat looks along +x. By its sagitta it stands for the one around it, where it is not taken away.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from fmopt.verify.problem.quantities import LENGTH
from fmopt.verify.problem.tables import Table

Point = tuple[float, float, float]
Flat = tuple[float, float]
MOST_CORNERS, MOST_POINTS = 4096, 100


@dataclass(frozen=True)
class Convex:
    """A convex solid: outlines of equally many corners, one above the other, or loose points.

    Attributes:
        rings: the outlines; neighbouring ones have parallel sides. None of them for loose points.
        points: the corners.
        turned: whether it is a solid of revolution about its z axis, for which the polyhedron stands.
    """

    rings: tuple[tuple[Point, ...], ...]
    points: tuple[Point, ...]
    turned: bool = False


SHAPES = {
    "box": ("size", "chamfer"),
    "cylinder": ("radius", "height", "sides", "sagitta"),
    "cone": ("radius_bottom", "radius_top", "height", "sides", "sagitta"),
    "sphere": ("radius", "sides"),
    "wedge": ("size", "top_x"),
    "hull": ("points",),
}


def shape(table: Table, kind: str, hollow: bool) -> Convex:
    """The convex solid that a table describes.

    Args:
        hollow: whether it is taken away.

    Raises:
        ProblemError: a key is missing or wrong.
    """
    if kind == "box":
        return _box(table)
    if kind == "cylinder":
        radius, height = table.number("radius", LENGTH, 1e-9), table.number("height", LENGTH, 1e-9)
        return _turned(table, [(radius, 0.0), (radius, height)], hollow)
    if kind == "cone":
        return _cone(table, hollow)
    if kind == "sphere":
        return _sphere(table.number("radius", LENGTH, 1e-9), table.count("sides", 16, 256))
    if kind == "wedge":
        return _wedge(table)
    items = table.items("points", 4, MOST_CORNERS)
    points = [table.row(f"points[{i}]", item) for i, item in enumerate(items)]
    return Convex((), tuple((x, y, z) for x, y, z in points))


def _box(table: Table) -> Convex:
    x, y, z = table.size("size")
    c = table.maybe("chamfer", LENGTH) or 0.0
    a, b = 0.5 * x, 0.5 * y
    if c >= min(a, b):
        raise table.error("chamfer", "takes half a side and more")
    if c == 0.0:
        outline = [(-a, -b), (a, -b), (a, b), (-a, b)]
    else:
        outline = [(a, c - b), (a, b - c), (a - c, b), (c - a, b), (-a, b - c), (-a, c - b), (c - a, -b), (a - c, -b)]
    return _stack([(outline, 0.0), (outline, z)])


def _cone(table: Table, hollow: bool) -> Convex:
    bottom, top = table.number("radius_bottom", LENGTH), table.number("radius_top", LENGTH)
    if not max(bottom, top) > 0.0:
        raise table.error("radius_top", "is zero, as is radius_bottom")
    return _turned(table, [(bottom, 0.0), (top, table.number("height", LENGTH, 1e-9))], hollow)


def _turned(table: Table, levels: Sequence[tuple[float, float]], hollow: bool) -> Convex:
    """The polyhedron of circles by radius and height, with as many sides as the table has, or as its sagitta asks."""
    sides, factor = table.count("sides", 64, MOST_CORNERS), 1.0
    if table.has("sagitta"):
        if table.has("sides"):
            raise table.error("sagitta", "is given beside sides")
        radius = max(radius for radius, _ in levels)
        turn = math.acos(radius / (radius + table.number("sagitta", LENGTH, 1e-9)))
        sides = 4 * math.ceil(0.25 * math.pi / turn)
        if sides > MOST_CORNERS:
            raise table.error("sagitta", f"asks for more than {MOST_CORNERS} sides")
        factor = 1.0 if hollow else 1.0 / math.cos(math.pi / sides)
    return _stack([(_ring(factor * radius, sides), z) for radius, z in levels], turned=True)


def _sphere(radius: float, sides: int) -> Convex:
    bands = max(sides // 2, 2)
    levels = []
    for k in range(bands + 1):
        angle = math.pi * k / bands
        across = 0.0 if k in (0, bands) else radius * math.sin(angle)  # sin π is not 0 in floats
        levels.append((_ring(across, sides), -radius * math.cos(angle)))
    return _stack(levels, turned=True)


def _wedge(table: Table) -> Convex:
    x, y, z = table.size("size")
    top = table.number("top_x", LENGTH, 0.0, x) - 0.5 * x
    a, b = 0.5 * x, 0.5 * y
    return _stack([([(-a, -b), (a, -b), (a, b), (-a, b)], 0.0), ([(-a, -b), (top, -b), (top, b), (-a, b)], z)])


def _ring(radius: float, sides: int) -> list[Flat]:
    angles = [math.pi * j / sides for j in range(1, 2 * sides, 2)]
    return [(radius * math.cos(angle), radius * math.sin(angle)) for angle in angles]


def _stack(levels: Sequence[tuple[Sequence[Flat], float]], *, turned: bool = False) -> Convex:
    rings = tuple(tuple((x, y, z) for x, y in outline) for outline, z in levels)
    return Convex(rings, tuple(point for ring in rings for point in ring), turned)


def corners_of(table: Table, key: str, items: object) -> list[Flat]:
    """The corners of a polygon as they are listed.

    Raises:
        ProblemError: it is none.
    """
    if not isinstance(items, list) or not 3 <= len(items) <= MOST_CORNERS:
        raise table.error(key, "must be an array of three corners or more")
    rows = [table.row(f"{key}[{i}]", item, count=2) for i, item in enumerate(items)]
    return [(x, y) for x, y in rows]


def polygon_of(table: Table, key: str, items: object) -> list[Flat]:
    """The corners of a convex polygon, counter-clockwise.

    Raises:
        ProblemError: it is none.
    """
    corners = corners_of(table, key, items)
    around = 0.0
    for (ax, ay), (bx, by), (cx, cy) in zip(corners, corners[1:] + corners[:1], corners[2:] + corners[:2], strict=True):
        turn = (bx - ax) * (cy - by) - (by - ay) * (cx - bx)
        around += math.atan2(turn, (bx - ax) * (cx - bx) + (by - ay) * (cy - by))
        if turn <= 0.0:
            raise table.error(key, "is not convex and counter-clockwise")
    if around > 7.0:  # one round is 2π, two are 4π
        raise table.error(key, "goes round more than once")
    return corners


def extruded(polygons: Sequence[Sequence[Flat]], *, moving: bool) -> tuple[Convex, ...]:
    """The solids that stand for a part in the plane of x and z.

    What moves is a ridge: its polygon at y = 0, drawn in by a quarter towards its centroid at both ends, as thick as
    the polygon is wide where it is narrowest. What stands is extruded along y as far as it is wide.

    Args:
        polygons: convex, in x and z, m; only one where it moves.
        moving: whether it is the part that moves.
    """
    if not moving:
        xs, zs = ([p[axis] for polygon in polygons for p in polygon] for axis in (0, 1))
        half = 0.5 * max(max(xs) - min(xs), max(zs) - min(zs))
        return tuple(_along_y([(polygon, -half), (polygon, half)]) for polygon in polygons)
    (polygon,) = polygons
    n, half = len(polygon), 0.5 * _width(polygon)
    cx, cz = math.fsum(x for x, _ in polygon) / n, math.fsum(z for _, z in polygon) / n
    ends = [(0.75 * x + 0.25 * cx, 0.75 * z + 0.25 * cz) for x, z in polygon]
    return (_along_y([(ends, -half), (polygon, 0.0), (ends, half)]),)


def _along_y(levels: Sequence[tuple[Sequence[Flat], float]]) -> Convex:
    rings = tuple(tuple((x, y, z) for x, z in outline) for outline, y in levels)
    return Convex(rings, tuple(point for ring in rings for point in ring))


def _width(polygon: Sequence[Flat]) -> float:
    """The least width of a convex polygon."""
    widths = []
    for (ax, az), (bx, bz) in zip(polygon, [*polygon[1:], polygon[0]], strict=True):
        size = math.hypot(bx - ax, bz - az)
        across = [((ax - bx) * z - (az - bz) * x) / size for x, z in polygon]
        widths.append(max(across) - min(across))
    return min(widths)
