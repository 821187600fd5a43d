"""Corners of the leading face, the one that goes in first: the sides on both ways from each, and how far it turns."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from fmopt.geometry.part import Part
from fmopt.values import Array

_SHORT = 0.25  # of the longest side of the leading face, below which a side is no wall
_NARROW = 0.1  # sine of the angle between two sides, below which they are opposite ones
_ALIKE = 0.55  # cosine above which two sides are no corner
_BLUNT, _SHARE = math.radians(40.0), 0.45  # turns at corners, and share of the width, below which a part is round


def leading_corners(moving: Part) -> Array:
    """The corners that go in first: those of the leading face, or of what stands out below it."""
    vertices = moving.polyhedron.vertices
    return np.asarray(vertices[vertices[:, 2] <= vertices[:, 2].min() + 1e-9])


def outline(tip: Array) -> Array:
    """The corners (m, 3) of the outline around a tip (n, 3), counterclockwise seen from above."""
    return np.asarray(tip[ConvexHull(tip[:, :2]).vertices])


def corner_turns(tip: Array) -> Array:
    """How far the outline around a tip (n, 3) turns at each of its corners (m,), rad."""
    x, y = _sides(tip).T
    headings = np.arctan2(y, x)
    return np.asarray((headings - np.roll(headings, 1)) % (2.0 * math.pi))


def next_to_round(moving: Part) -> bool:
    """Whether no corner of the tip is one that two walls could hold, and no side is long."""
    tip = leading_corners(moving)
    longest = float(np.linalg.norm(_sides(tip), axis=1).max())
    return float(corner_turns(tip).max()) < _BLUNT and longest < _SHARE * float(np.ptp(tip[:, :2], axis=0).max())


def corner_walls(moving: Part, corner: Array) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    """The sides of the leading face on both ways from a corner: inward normal (2,) and a point (2,) on each.

    Short sides, such as chamfers, are passed over, and so are sides on until the two stand at an angle. What is short
    is told by the longest side, of an outline so slender that two opposite sides are left by its width, or nothing is.
    """
    vertices = moving.polyhedron.vertices
    at = int(np.argmin(np.linalg.norm(vertices - corner, axis=1)))
    loop = next(f.loops[0] for f in moving.polyhedron.faces if f.normal[2] < -1.0 + 1e-9 and at in f.loops[0])
    start = loop.index(at)
    points = vertices[[*loop[start:], *loop[:start]]][:, :2]  # clockwise seen from above
    along = np.roll(points, -1, axis=0) - points
    lengths = np.linalg.norm(along, axis=1)
    inward = np.column_stack([along[:, 1], -along[:, 0]]) / lengths[:, None]
    longest = int(lengths.argmax())
    one, two = longest, longest
    for size in (float(lengths[longest]), float(np.ptp(points @ inward[longest])), 0.0):
        one, two = _at_an_angle(inward, np.flatnonzero(lengths > _SHORT * size))
        if abs(float(np.linalg.det(inward[[one, two]]))) > _NARROW:
            break
    return (inward[one], points[one]), (inward[two], points[two])


def far_edge(moving: Part, corner: Array) -> tuple[Array, Array]:
    """The long side around the tip that reaches farthest from a corner: that end (3,), and the other (3,).

    Of two that meet there, the one that runs more along x.
    """
    tip = leading_corners(moving)
    loop = outline(tip)
    after = np.roll(loop, -1, axis=0)
    lengths = np.linalg.norm(after - loop, axis=1)
    long = lengths > _SHORT * lengths.max()
    ways = [*zip(loop[long], after[long], strict=True), *zip(after[long], loop[long], strict=True)]
    apart = [float(np.linalg.norm(end - corner)) for end, _ in ways]
    farthest = [way for way, far in zip(ways, apart, strict=True) if far >= (1.0 - 1e-9) * max(apart)]
    return max(farthest, key=lambda way: abs(float(way[1][0] - way[0][0])))


def _at_an_angle(inward: Array, sides: NDArray[np.intp]) -> tuple[int, int]:
    """The first and the last of some sides around a corner, of inward normals (n, 2), that stand at an angle."""
    first, last = 0, len(sides) - 1
    if inward[sides[first]] @ inward[sides[last]] < math.cos(_BLUNT):
        return int(sides[first]), int(sides[last])
    while inward[sides[first]] @ inward[sides[last]] > _ALIKE and first + 1 < last:
        # The one from which it is less far to the corner goes on, so that of eight sides two at right angles are found.
        first, last = (first, last - 1) if first + last >= len(sides) - 1 else (first + 1, last)
    return int(sides[first]), int(sides[last])


def _sides(tip: Array) -> Array:
    """The sides (m, 2) of the outline around a tip (n, 3), from each corner to the next."""
    loop = outline(tip)[:, :2]
    return np.asarray(np.roll(loop, -1, axis=0) - loop)
