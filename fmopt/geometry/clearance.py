"""Clearance as measured on the parts: gaps between mating sections, play, and the overlap of assembled parts.

The moving part is in its body frame (origin at the centre of the peg's leading end, z up along the peg), the fixed
part in the B-frame (origin at the centre of the mouth, z out of the hole). Inserted by d, the moving part stands at
(0, 0, −d), not turned.

How far convex polyhedra overlap or stand apart, by the separating axes of their faces and edges.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from shapely import MultiPolygon, Point, Polygon, get_coordinates
from shapely.ops import nearest_points

from fmopt.errors import GeometryError, InterferenceError
from fmopt.geometry.convex_pieces import faceted, union_manifold
from fmopt.geometry.facets import place
from fmopt.geometry.part import Part
from fmopt.geometry.polyhedron import Polyhedron, diameter, placed, plane_basis
from fmopt.geometry.section import section_limit, shrunk
from fmopt.spatial.se3 import Pose, cross
from fmopt.spatial.values import Array, Value, remembered

_TOUCH = 1e-9  # m, overlaps up to this count as touching


def deepest(bodies: Sequence[Polyhedron], others: Sequence[Polyhedron]) -> float:
    """The largest `penetration` over all pairs, m; negative when every pair is apart, −∞ when there is no pair."""
    return max((penetration(body, other) for body in bodies for other in others), default=-np.inf)


def penetration(body: Polyhedron, other: Polyhedron) -> float:
    """Length in m of the shortest shift that takes two convex polyhedra in one frame apart.

    Negative when they are apart: then its size is the gap between two parallel planes that separate them, which is at
    most their distance. Only `body` may have balls.
    """
    faces = np.vstack([body.normals, -other.normals])
    if body.balls:
        faces = np.vstack([faces, *(towards(other, centre) for centre in body.vertices)])
        return overlap(body.vertices, other.vertices, faces, body.radii)
    shallow = overlap(body.vertices, other.vertices, faces)
    # Apart by a face already: axes across edges, by far the most, are asked of other pairs only.
    if shallow <= _TOUCH:
        return shallow
    return min(shallow, overlap(body.vertices, other.vertices, axes_across(directions(body), directions(other))))


def overlap(points: Array, others: Array, axes: Array, radii: Array | float = 0.0) -> float:
    """Smallest over the axes n (k, 3) of max n·points − min n·others, m, of balls about the points with radii, m."""
    return float(np.min(np.max(axes @ points.T + radii, axis=1) - np.min(axes @ others.T, axis=1)))


def axes_across(one: Array, other: Array) -> Array:
    """Unit vectors (k, 3) across each of some directions (n, 3) and each of others (m, 3), both ways."""
    crossed = cross(one[:, None], other[None]).reshape(-1, 3)
    length = np.linalg.norm(crossed, axis=1)
    axes = crossed[length > 1e-9] / length[length > 1e-9, None]
    return np.vstack([axes, -axes])


def towards(body: Polyhedron, centre: Array) -> Array:
    """Unit directions (k, 3) from a ball's centre (3,), m, to the nearest points of the edges of a polyhedron."""
    start, end = body.vertices[np.array([edge.vertices for edge in body.edges]).T]
    along = end - start
    share = np.clip(np.vecdot(centre - start, along) / np.vecdot(along, along), 0.0, 1.0)
    way = start + share[:, None] * along - centre
    far = np.linalg.norm(way, axis=1)
    return np.asarray(way[far > 0.0] / far[far > 0.0, None])


@remembered(1)
def directions(body: Polyhedron) -> Array:
    """Unit directions (k, 3) of the edges, parallel ones once; none of a ball."""
    if not body.edges:
        return np.zeros((0, 3))
    start, end = body.vertices[np.array([edge.vertices for edge in body.edges]).T]
    along = (end - start) / np.linalg.norm(end - start, axis=1)[:, None]
    # Turned so that the first component that is not 0 is positive: opposite directions are one.
    leading = np.argmax(np.abs(along) > 1e-9, axis=1)
    along *= np.sign(along[np.arange(len(along)), leading])[:, None]
    return np.asarray(along[np.unique(np.round(along, 9), axis=0, return_index=True)[1]])


@dataclass(frozen=True, eq=False)
class Clearance(Value, where=(3,), labels={"where": "place of the smallest gap"}):
    """Measured clearance of a mating.

    Args:
        per_side: smallest gap in m between centred peg and hole over the whole insertion; when they overlap, minus the
            depth by which the peg's section would have to shrink all around.
        play: free travel (x, y) in m from stop to stop, infinite where nothing stops it, 0 when they overlap.
        where: place of the smallest gap, B-frame, m, with the peg at the depth where the two sections meet.
        half_diagonal: half the diagonal of the peg's section there, m: the characteristic length ρ.
    """

    per_side: float
    play: tuple[float, float]
    where: Array
    moving_face: int
    fixed_face: int
    half_diagonal: float


@dataclass(frozen=True)
class Interference:
    """Overlap of two placed parts: volume (m³), depth (m, at least 0), and the centre of the overlap in words."""

    volume: float
    depth: float
    place: str


@dataclass(frozen=True)
class PartSlice:
    """A section of a part, just above its height, m, where `side` is 1, else just below."""

    height: float
    side: int
    shape: MultiPolygon


def mating_clearance(moving: Part, fixed: Part, depth: float) -> Clearance:
    """Clearance of the moving part's peg in the fixed part's hole, measured on their sections.

    Every section of the peg's first `depth` metres is held against every section of the hole that it passes. Sections
    are taken at both ends and the middle of each stretch between vertex levels.

    Raises:
        GeometryError: peg or hole has no material at those depths.
    """
    pairs, least = facing(moving, fixed, depth), math.inf
    for one, two in pairs:
        # Once two overlap, only pairs that still overlap when shrunk by as much are measured.
        if (least > 0.0 or overlap_shrunk(one.shape, two.shape, -least)) and (g := gap(one.shape, two.shape)) < least:
            peg, hole, least = one, two, g
    travel = np.array([_travel(one.shape, two.shape) for one, two in pairs]).min(axis=0)
    play = (0.0, 0.0) if least <= 0.0 else (float(travel[0] + travel[1]), float(travel[2] + travel[3]))
    at_peg, at_hole = _closest(peg.shape, hole.shape, least)
    across = at_hole - at_peg
    return Clearance(
        least,
        play,
        np.append(0.5 * (at_peg + at_hole), hole.height),
        _face_at(moving.polyhedron, np.append(at_peg, peg.height), np.append(across, 0.0)),
        _face_at(fixed.polyhedron, np.append(at_hole, hole.height), np.append(-across, 0.0)),
        0.5 * diameter(get_coordinates(peg.shape)),
    )


def facing(moving: Part, fixed: Part, depth: float) -> list[tuple[PartSlice, PartSlice]]:
    """Sections of the peg with those of the hole that they pass.

    Raises:
        GeometryError: peg or hole has no material at those depths.
    """
    pegs, holes = _slices(moving, 0.0, depth), _slices(fixed, -depth, 0.0)
    return [(peg, hole) for peg in pegs for hole in holes if _meet(peg, hole, depth)]


def interference(moving: Part, fixed: Part, pose: Pose) -> Interference:
    """Overlap of the moving part at `pose` in the B-frame with the fixed part.

    The volume is that of the boolean intersection; the depth is the largest over all pairs of convex pieces of the
    shortest shift that takes the pair apart, so that parts which only touch have depth 0.
    """
    bodies = [placed(body, pose) for body in moving.bodies]
    depth = deepest(bodies, fixed.pieces)
    if depth <= _TOUCH:
        return Interference(0.0, max(depth, 0.0), "nowhere")
    common = union_manifold([*map(faceted, bodies)]) ^ union_manifold(fixed.pieces)
    if moving.balls and common.is_empty():  # a ball overlaps with what its facets leave out
        body = max((body for body in bodies if body.balls), key=lambda body: deepest([body], fixed.pieces))
        return Interference(0.0, depth, place(body.vertices[0]))
    centre = 0.5 * np.sum(np.reshape(common.bounding_box(), (2, 3)), axis=0)
    return Interference(float(common.volume()), depth, place(centre))


def checked_clearance(moving: Part, fixed: Part, seated: Pose, depth: float) -> Clearance:
    """The measured clearance of parts that can be assembled, and end at the pose `seated` in the B-frame.

    Raises:
        InterferenceError: the clearance is not positive, or the parts overlap when seated.
        GeometryError: the facets of round surfaces overlap by less than they lie from these.
    """
    measured = mating_clearance(moving, fixed, depth)
    if measured.per_side <= _TOUCH:
        short = abs(min(measured.per_side, 0.0))
        if short < sum(part.chord_error + part.larger for part in (moving, fixed)):
            raise _untold(moving, fixed, measured, short)
        fit = "it is too thick by" if short > _TOUCH else "there is no clearance, which is"
        raise InterferenceError(
            f"{moving.name!r} does not go into {fixed.name!r}: {fit} {1e3 * short + 0.0:.6f} mm a side at "
            f"{place(measured.where)} of the hole, face {measured.moving_face} on face {measured.fixed_face}",
            short,
            f"{place(measured.where)} in the B-frame",
            "make the peg thinner or the hole wider, and check the units of both",
        )
    overlap = interference(moving, fixed, seated)
    if overlap.depth > _TOUCH:
        raise InterferenceError(
            f"{moving.name!r} overlaps {fixed.name!r} by {1e6 * overlap.depth:.3g} µm when seated, around "
            f"{overlap.place} in the B-frame",
            overlap.depth,
            f"{overlap.place} in the B-frame",
            "seat it less deep, or move the features' frames",
        )
    return measured


def _untold(moving: Part, fixed: Part, measured: Clearance, short: float) -> GeometryError:
    """Facets overlap by less than they, or what encloses them, lie from the surfaces that they stand for."""
    off = [1e3 * (part.chord_error + part.larger) for part in (moving, fixed)]
    told = f"whether {moving.name!r} goes into {fixed.name!r} cannot be told at these facets: they overlap by"
    told = f"{told} {1e3 * short:.4g} mm a side, and lie up to {off[0]:.4g} and {off[1]:.4g} mm from the true surfaces"
    if rough := [repr(part.name) for part in (moving, fixed) if part.larger > 0.0]:
        return GeometryError(told, f"describe {' and '.join(rough)} by shapes: an enclosure is larger than the part")
    level = Pose(np.append(np.zeros(2), measured.where[2]), np.eye(3))
    rings = [len(ring.coords) - 1 for shape in section_limit(fixed.pieces, level, 1).geoms for ring in shape.interiors]
    # A quarter of the room that there is at the best; the sagitta goes with the square of the number of facets.
    room = max(0.25 * (fixed.chord_error - short), _TOUCH)
    count = math.ceil(max(rings, default=0) * math.sqrt(max(moving.chord_error, fixed.chord_error) / room))
    return GeometryError(told, f"give {f'about {count} facets around' if count else 'finer facets'}, or a STEP file")


def _slices(part: Part, low: float, high: float) -> list[PartSlice]:
    """Sections of the part between two heights: limits at both ends and the middle of each stretch without vertices."""
    heights = np.unique(np.clip([low, high, *(z for body in part.bodies for z in body.vertices[:, 2])], low, high))
    # Levels that only rounding tells apart have no room for a section between them, nor at the wrong one of them.
    apart = np.flatnonzero(np.diff(heights) > 1e-9)
    made = []
    for bottom, top in zip(heights[apart], heights[apart + 1], strict=True):
        for height, side in ((bottom, 1), (0.5 * (bottom + top), 1), (top, -1)):
            shape = section_limit(part.bodies, Pose(np.array([0.0, 0.0, height]), np.eye(3)), 1 if side > 0 else -1)
            if not shape.is_empty:
                made.append(PartSlice(float(height), side, shape))
    if not made:
        raise GeometryError(
            f"part {part.name!r} has no material between z = {1e3 * low:g} and {1e3 * high:g} mm of its mating frame",
            "check the feature's frame: z points out of a hole, and back into the part from a peg's leading end",
        )
    return made


def _meet(peg: PartSlice, hole: PartSlice, depth: float) -> bool:
    """Whether the peg's section passes the hole's section on the way to `depth`."""
    ahead = hole.height - (peg.height - depth)
    # Sections at one level meet at the goal, but for the peg's just above it and the hole's just below.
    return ahead > _TOUCH or (abs(ahead) <= _TOUCH and not peg.side > hole.side)


def gap(peg: MultiPolygon, hole: MultiPolygon) -> float:
    """Distance between two sections, m; for overlapping ones minus the offset by which the peg's has to shrink."""
    if (apart := float(peg.distance(hole))) > 0.0:
        return apart
    low, high = 0.0, 0.5 * diameter(get_coordinates(peg))
    if not overlap_shrunk(peg, hole, low):
        return 0.0
    while high - low > 1e-3 * _TOUCH:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if overlap_shrunk(peg, hole, middle) else (low, middle)
    return -high


def overlap_shrunk(peg: MultiPolygon, hole: MultiPolygon, offset: float) -> bool:
    """Whether two sections overlap still when the peg's has shrunk by an offset (m, not negative)."""
    # 1e-15 m², 1 nm by 1 µm: less is what rounding leaves where they touch.
    return bool(shrunk(peg, offset).intersection(hole).area > 1e-6 * _TOUCH)


def _travel(peg: MultiPolygon, hole: MultiPolygon) -> tuple[float, float, float, float]:
    """Free travel of the peg's section along +x, −x, +y and −y until it touches the hole's section, m."""
    a, b = _sides(peg), _sides(hole)
    return (_run(a, b, 0), _run(b, a, 0), _run(a, b, 1), _run(b, a, 1))


def _run(ahead: Array, fixed: Array, axis: int) -> float:
    """Smallest distance along +axis from the sides `ahead` to the sides `fixed`, both (n, 2, 2)."""
    # Polygons that approach touch with a corner of either one on a side of the other.
    steps = np.concatenate([_rays(ahead[:, 0], fixed, axis), -_rays(fixed[:, 0], ahead, axis)])
    # What is behind is a side that it moves away from.
    return float(np.min(steps, where=steps > -_TOUCH, initial=np.inf))


def _rays(points: Array, sides: Array, axis: int) -> Array:
    """Signed distances along `axis` from points (n, 2) to the sides (m, 2, 2) beside them, shape (k,)."""
    u, v = points[:, axis, None], points[:, 1 - axis, None]
    (u0, v0), (u1, v1) = ((sides[:, end, axis], sides[:, end, 1 - axis]) for end in (0, 1))
    beside = (v >= np.minimum(v0, v1)) & (v <= np.maximum(v0, v1)) & (v0 != v1)
    share = (v - v0) / np.where(v0 != v1, v1 - v0, 1.0)
    return np.asarray((u0 + share * (u1 - u0) - u)[beside])


def _closest(peg: MultiPolygon, hole: MultiPolygon, gap: float) -> tuple[Array, Array]:
    if gap > 0.0:
        one, two = nearest_points(peg, hole)
        return np.array(one.coords[0]), np.array(two.coords[0])
    spot = np.array(peg.intersection(hole).representative_point().coords[0][:2])
    return spot, spot


def _face_at(body: Polyhedron, point: Array, across: Array) -> int:
    """The side face nearest to a point, among equally near ones the one that looks most along `across`."""
    sides = np.abs(body.normals[:, 2]) < 1.0
    distances = np.array([_face_distance(body, i, point) if side else np.inf for i, side in enumerate(sides)])
    return int(np.argmax(np.where(distances <= distances.min() + _TOUCH, body.normals @ across, -np.inf)))


def _face_distance(body: Polyhedron, number: int, point: Array) -> float:
    face = body.faces[number]
    basis = plane_basis(face.normal)
    outer, *holes = ([tuple(corner) for corner in body.vertices[list(loop)] @ basis] for loop in face.loops)
    return float(np.hypot(point @ face.normal - face.offset, Polygon(outer, holes).distance(Point(point @ basis))))


def _sides(shape: MultiPolygon) -> Array:
    rings = [np.array(ring.coords) for polygon in shape.geoms for ring in (polygon.exterior, *polygon.interiors)]
    return np.vstack([np.stack([ring[:-1], ring[1:]], axis=1) for ring in rings])
