"""Plane sections of solids given as convex pieces: the union of the pieces' sections, never a slice of a mesh.

How large a part is, and whether a part can be that large: most often it is the unit that is wrong. The tip of a part:
its corners, the sides on both ways from each, and how far the outline turns there.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING, Literal

import numpy as np

from fmopt.errors import SizeError
from fmopt.geometry.csg import Solid, corners, exact_pose, operands
from fmopt.geometry.polyhedron import Polyhedron
from fmopt.spatial.se3 import Pose
from fmopt.spatial.values import Array, Indices, remembered

if TYPE_CHECKING:
    from shapely import MultiPolygon
    from shapely.geometry.base import BaseGeometry

if TYPE_CHECKING:
    from fmopt.geometry.part import Part


_SHORT = 0.25  # of the longest side of the leading face, below which a side is no wall
_NARROW = 0.1  # sine of the angle between two sides, below which they are opposite ones
_ALIKE = 0.55  # cosine above which two sides are no corner
_APART = 0.7  # sine of the angle between two walls, from which each of them tells little of what the other does
_FLUSH = 1e-7  # of the longest side, by which corners of a side may be off it
_DOWN = -0.9  # upward part of a normal, below which a face is one that leads
_BLUNT = math.cos(math.radians(40.0))  # between the inward normals of two sides, below which they stand at an angle
_UPRIGHT, _SAME = 1e-9, 1e-9  # upward part of a wall's normal, and m, that are nothing but rounding
_TAPERED = 0.5  # of the part's width, how far up chamfers of its tip reach at most
_ON_PLANE = 1e-12  # m
_GAP = 1e-11  # m: as wide may a crack be
_CRACK = 1e-9  # m: what an outline is shorter by where there is a crack less
_QUARTER = 128  # sides of the polygon that stands for a quarter of a ball's section

LARGEST = 4.0  # m: what the check of a plan takes
SMALLEST = 1e-4  # m


def section(bodies: Sequence[Polyhedron], frame: Pose) -> MultiPolygon:
    """The regularised section of a union of convex bodies by the plane z = 0 of `frame`, in the frame's x and y (m).

    Where the plane runs in a face the answer is what both sides share: the seam of two stacked bodies is full, the top
    of a body empty.
    """
    return _polygons(section_limit(bodies, frame, 1).intersection(section_limit(bodies, frame, -1)))


def section_limit(bodies: Sequence[Polyhedron], frame: Pose, side: Literal[-1, 1]) -> MultiPolygon:
    """The limit of `section` where the plane comes from above (1) or below (−1)."""
    from shapely import MultiPoint, Point

    to_frame = exact_pose(frame).inverse()
    parts = []
    for body in bodies:
        points = to_frame.apply(body.vertices)
        for (x, y, z), radius in zip(points, body.radii, strict=True) if body.balls else ():
            if abs(z) < radius:
                parts.append(Point(x, y).buffer(float(np.sqrt(radius**2 - z**2)), quad_segs=_QUARTER))
        if not body.faces:
            continue
        if np.any(side * points[:, 2] > _ON_PLANE):
            outline = MultiPoint(_crossings(body, points)).convex_hull
            if outline.geom_type == "Polygon":
                parts.append(outline)
    # simplify(0.0) drops corners at which sides of several pieces go straight on.
    return _polygons(sealed(united(parts)).simplify(0.0))


def united(parts: Sequence[BaseGeometry]) -> BaseGeometry:
    """The union of plane shapes, formed on a grid where rounding along a common side loses one of them."""
    import shapely
    from shapely import get_coordinates, union_all

    found = union_all(parts)
    shapely.prepare(found)
    lost = not shapely.dwithin(found, shapely.points(get_coordinates(parts)), _GAP).all()
    return union_all(parts, grid_size=_GAP) if lost else found


def sealed(shape: BaseGeometry) -> BaseGeometry:
    """A plane shape without the cracks and skins that rounding leaves where polygons share a side."""
    import shapely
    from shapely import union_all

    closed = shapely.set_precision(union_all([shape], grid_size=_GAP), _GAP)
    return closed if closed.length < shape.length - _CRACK else shape


def shrunk(shape: BaseGeometry, by: float) -> BaseGeometry:
    """A plane shape drawn in by a distance, m, its corners still corners, as those of a thinner peg would be."""
    with np.errstate(invalid="ignore"):  # GEOS raises the flag where a mitre has no corner
        return shape.buffer(-by, join_style="mitre", mitre_limit=1e3) if by > 0.0 else shape


def _crossings(body: Polyhedron, points: Array) -> Array:
    """Where the body's edges meet z = 0, shape (k, 2); vertices on the plane as they are."""
    height = np.where(np.abs(points[:, 2]) <= _ON_PLANE, 0.0, points[:, 2])
    a, b = np.array([edge.vertices for edge in body.edges]).T
    cut = height[a] * height[b] < 0.0
    a, b = a[cut], b[cut]
    share = height[a] / (height[a] - height[b])
    return np.vstack([points[height == 0.0, :2], points[a, :2] + share[:, None] * (points[b, :2] - points[a, :2])])


def _polygons(geometry: BaseGeometry) -> MultiPolygon:
    import shapely
    from shapely import MultiPolygon, Polygon

    return MultiPolygon([part for part in shapely.get_parts(geometry) if isinstance(part, Polygon) and part.area > 0.0])


def reach(solid: Solid) -> Array:
    """Points (n, 3) in m whose bounding box holds the solid: what is taken away from it does not count."""
    found = operands(solid, Pose.identity())
    return np.vstack([pose.apply(corners(primitive)) for primitive, pose, taken in found if not taken])


def require_plausible(points: Array) -> None:
    """Refuses parts, by points (n, 3) in m, that no robot has in its hand.

    Raises:
        SizeError: they extend over more than 4 m along an axis, or over less than 0.1 mm along all of them.
    """
    size = float(np.max(np.ptp(points, axis=0)))
    if not SMALLEST <= size <= LARGEST:
        bound = f"more than {told(LARGEST)}" if size > LARGEST else f"less than {told(SMALLEST)}"
        raise SizeError(f"the part is {told(size)} long, {bound}", size, "check the unit of its numbers")


def told(size: float) -> str:
    """A length (m) in the unit in which one says it."""
    for least, factor, name in ((1.0, 1.0, "m"), (1e-3, 1e3, "mm"), (0.0, 1e6, "µm")):
        if size >= least:
            return f"{factor * size:.4g} {name}"
    return f"{size:.4g} m"


def lowest_point(moving: Part, pose: Pose) -> float:
    """How high the lowest point of the moving part, at a pose in the B-frame, is above the mouth z = 0, m."""
    return float((pose.apply(moving.polyhedron.vertices)[:, 2] - moving.polyhedron.radii).min())


def leading_corners(moving: Part) -> Array:
    """The corners (n, 3) with which the walls of a moving part begin: of its leading face, or above its chamfers, m."""
    ring = _above_chamfers(moving)
    return leading_face(moving) if ring is None else np.asarray(moving.polyhedron.vertices[list(ring)])


def leading_face(moving: Part) -> Array:
    """The corners (n, 3) that go in first: of the leading face, what stands out below it, or a box round a ball, m."""
    vertices, radii = moving.polyhedron.vertices, moving.polyhedron.radii
    heights = vertices[:, 2] - radii
    first = heights <= heights.min() + 1e-9
    if not radii[first].any():
        return np.asarray(vertices[first])
    sides = np.array([(x, y, -1.0) for x, y in product((-1.0, 1.0), repeat=2)])
    return np.vstack([v + r * sides if r else v[None] for v, r in zip(vertices[first], radii[first], strict=True)])


@remembered(1)
def _above_chamfers(moving: Part) -> tuple[int, ...] | None:
    """The vertices in which the walls begin above the chamfers of the tip, clockwise seen from above; None without any.

    What slopes farther up than half of the width is a taper.
    """
    body = moving.polyhedron
    first, last = float(body.vertices[:, 2].min()), float(body.vertices[:, 2].max())
    upright = [face for face in body.faces if abs(face.normal[2]) <= _UPRIGHT]
    begins = min((float(body.vertices[list(face.loops[0]), 2].min()) for face in upright), default=last)
    if body.balls or not _SAME < begins - first < _TAPERED * float(np.ptp(body.vertices[:, :2], axis=0).min()):
        return None
    before = dict[int, int]()
    for face in upright:
        loop = face.loops[0]
        ends = zip(loop, (*loop[1:], loop[0]), strict=True)
        before |= {b: a for a, b in ends if max(body.vertices[[a, b], 2]) <= begins + _SAME}
    ring = [next(iter(before))]
    while before.get(ring[-1]) not in (None, ring[0]) and len(ring) < len(before):
        ring.append(before[ring[-1]])
    return tuple(ring) if before.get(ring[-1]) == ring[0] else None


def outline(tip: Array) -> Array:
    """The corners (m, 3) of the outline around a tip (n, 3), counterclockwise seen from above."""
    from scipy.spatial import ConvexHull

    return np.asarray(tip[ConvexHull(tip[:, :2]).vertices])


def corner_turns(tip: Array) -> Array:
    """How far the outline around a tip (n, 3) turns at each of its corners (m,), rad."""
    x, y = _sides(tip).T
    headings = np.arctan2(y, x)
    return np.asarray((headings - np.roll(headings, 1)) % (2.0 * math.pi))


def corner_walls(moving: Part, corner: Array) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    """The sides of the leading face on both ways from its corner (3,): inward normal (2,) and a point (2,) on each.

    Short sides, such as chamfers, are passed over, and so are sides on until the two stand at an angle. What is short
    is told by the longest side, of an outline so slender that two opposite sides are left by its width, or nothing is.
    """
    vertices = moving.polyhedron.vertices
    at = int(np.argmin(np.linalg.norm(vertices - corner, axis=1)))
    loop = _above_chamfers(moving)
    if loop is None or at not in loop:
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


@dataclass(frozen=True, eq=False)
class Walls:
    """Sides (n) around a tip that hold its hull, none for a star: inside, `inward` · (x, y) ≥ `offsets`, m."""

    inward: Array
    offsets: Array
    lengths: Array

    @property
    def pairs(self) -> tuple[tuple[int, int], ...]:
        """Two of them, the second on the left of the first seen from outside, that stand at an angle to each other.

        Short ones are passed over as `corner_walls` does.
        """
        if not len(self.lengths):
            return ()
        x, y = self.inward.T
        sines, longest = np.outer(x, y) - np.outer(y, x), int(self.lengths.argmax())
        width = float(np.max(self.lengths * np.abs(sines[longest])))
        for size in (float(self.lengths[longest]), width, 0.0):
            long = self.lengths > _SHORT * size
            # Where no two stand at such an angle, those that come nearest to it.
            found = np.argwhere(np.outer(long, long) & (sines >= min(_APART, float(sines.max()))))
            if len(found):
                break
        return tuple((int(i), int(j)) for i, j in found)


@remembered(1)
def walls_around(moving: Part) -> Walls:
    """The sides of the part's walls around its tip that its hull has, too."""
    body, tip = moving.polyhedron, leading_corners(moving)
    loop, along = outline(tip)[:, :2], _sides(tip)
    lengths = np.linalg.norm(along, axis=1)
    inward = np.column_stack([-along[:, 1], along[:, 0]]) / lengths[:, None]
    offsets = np.einsum("ij,ij->i", inward, loop)
    first = (body.vertices[:, None] == tip).all(axis=2).any(axis=1)
    on = first[:, None] & (np.abs(body.vertices[:, :2] @ inward.T - offsets) <= _FLUSH * lengths.max())  # (v, n)
    walls = [list(face.vertices) for face in body.faces if face.normal[2] > _DOWN]
    real = np.any([on[wall].sum(axis=0) >= 2 for wall in walls], axis=0)  # over a notch the hull has no wall
    return Walls(inward[real], offsets[real], lengths[real])


def reaching_below(moving: Part, pose: Pose) -> Array:
    """Where (n, 2) the moving part at a pose in the B-frame is below the mouth z = 0 at most, x and y there, m."""
    points = pose.apply(moving.polyhedron.vertices)
    return np.vstack([points[points[:, 2] < 0.0, :2], _crossings(moving.polyhedron, points)])


def far_edge(moving: Part, corner: Array) -> tuple[Array, Array]:
    """The long side around the tip that reaches farthest from a corner (3,): that end (3,), and the other (3,).

    Of two that meet there, the one that runs more along x.
    """
    loop = outline(leading_face(moving))
    after = np.roll(loop, -1, axis=0)
    lengths = np.linalg.norm(after - loop, axis=1)
    long = lengths > _SHORT * lengths.max()
    ways = [*zip(loop[long], after[long], strict=True), *zip(after[long], loop[long], strict=True)]
    apart = [float(np.linalg.norm(end - corner)) for end, _ in ways]
    farthest = [way for way, far in zip(ways, apart, strict=True) if far >= (1.0 - 1e-9) * max(apart)]
    return max(farthest, key=lambda way: abs(float(way[1][0] - way[0][0])))


def _at_an_angle(inward: Array, sides: Indices) -> tuple[int, int]:
    """The first and the last of some sides around a corner, of inward normals (n, 2), that stand at an angle."""
    first, last = 0, len(sides) - 1
    if inward[sides[first]] @ inward[sides[last]] < _BLUNT:
        return int(sides[first]), int(sides[last])
    while inward[sides[first]] @ inward[sides[last]] > _ALIKE and first + 1 < last:
        # The one from which it is less far to the corner goes on, so that of eight sides two at right angles are found.
        first, last = (first, last - 1) if first + last >= len(sides) - 1 else (first + 1, last)
    return int(sides[first]), int(sides[last])


def _sides(tip: Array) -> Array:
    """The sides (m, 2) of the outline around a tip (n, 3), from each corner to the next."""
    loop = outline(tip)[:, :2]
    return np.asarray(np.roll(loop, -1, axis=0) - loop)
