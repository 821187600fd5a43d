"""The frame rules of [LeeHuang1985] section 3, checked on the solids.

A line is a central line of a feature when it passes all sections across it at their centre: the centroid, or the
centre of the smallest circle around, or that of a largest circle inside (a shaft with a flat or a key has its central
line in its axis, which is not its centroid). One of the three has to hold for all sections. Between the levels of
vertices the area of a section is quadratic and its first moment cubic in the height, so that four sections a stretch
decide about centroids exactly; the circles are asked at the same heights. Along z that is asked of every feature; a
slot, which is open sideways, may have x or y along its central line instead.

Solids along the z axis and across it, by the same operators on their instances, [LeeHuang1985] assertion 2.

Intervals of the axis and polygons across it are enough to judge a frame; they cost far less than the solid's pieces.
"""

from __future__ import annotations

from collections.abc import Callable, Container, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from fmopt.errors import TaskError
from fmopt.geometry.convex_pieces import polyhedron
from fmopt.geometry.csg import Difference, Placed, Primitive, Solid, Union, convex_polyhedron
from fmopt.geometry.polyhedron import Polyhedron
from fmopt.geometry.section import sealed, section_limit
from fmopt.spatial.se3 import Pose
from fmopt.spatial.values import Array, remembered
from fmopt.task.object_model.tree import Feature, FeatureClass, ObjectTree, moved

if TYPE_CHECKING:
    from shapely.geometry.base import BaseGeometry


CENTRAL = "the frame is on the central line of its feature, z (of a slot any axis) along it"
INSIDE = "the z axis runs inside the feature over its whole length"
MOUTH = "the z axis of a hollow feature passes through its mouth"

_NOISE = 1e-5  # of the size of a section: how far from its centre counts as at the centre
_SHORT = 1e-6  # of the feature's length: shorter stretches of an axis are noise
_HEIGHTS = (0.125, 0.375, 0.625, 0.875)  # shares of a stretch, inside it: at its ends sections may change at once
_AXES = (  # frames whose z is x, or y, of the one that they are in
    Pose(np.zeros(3), np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])),
    Pose(np.zeros(3), np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])),
)

Intervals: TypeAlias = tuple[tuple[float, float], ...]
Cutter: TypeAlias = "Callable[[float], BaseGeometry]"


def checked(tree: ObjectTree, found: Container[str] = ()) -> ObjectTree:
    """The tree itself, when the frames of all its features with a length obey the rules.

    Args:
        found: names of features whose frames were found on the part, and are not judged.

    Raises:
        TaskError: with the feature and the rule.
    """
    for feature in tree.features:
        if feature.length is not None and feature.name not in found:
            check_frame(tree, feature)
    return tree


def check_frame(tree: ObjectTree, feature: Feature) -> None:
    """Checks the frame of one feature with a length.

    Raises:
        TaskError: with the feature and the rule.
    """
    _check(feature, tree.name, tree.classes, tree.order)


@remembered(1)
def _check(feature: Feature, name: str, classes: tuple[FeatureClass, ...], order: tuple[str, ...]) -> None:
    """Checks the frame of a feature of the object of these classes, wherever that is."""
    tree, span = ObjectTree(name, Pose.identity(), classes, order), feature.length
    if span is None:
        message = f"the feature {feature.name!r} of {name!r} has no length and no mating frame"
        raise TaskError(message, feature.name, INSIDE, "give it a length, and a frame on its central line")
    body = moved(feature.body, feature.frame.inverse())
    whole = moved(tree.solid, feature.frame.inverse())
    low, high = (-span, 0.0) if feature.hollow else (0.0, span)
    along, material = on_axis(body), on_axis(whole)
    for missing in (_gaps(along, low, high), clipped(material, low, high) if feature.hollow else ()):
        if length(missing) > _SHORT * span:
            longest = max(missing, key=lambda stretch: stretch[1] - stretch[0])
            raise TaskError(_left(tree, feature, longest), feature.name, INSIDE, _turned(feature))
    if feature.hollow:
        _check_mouth(tree, feature, along, material)
    _check_central(tree, feature, body, whole, (low, high))


def _gaps(intervals: Intervals, low: float, high: float) -> Intervals:
    """What between two heights lies in none of the intervals."""
    # low, a₁, b₁, a₂, b₂, …, high: taken in pairs, these are the gaps.
    levels = [low, *(level for interval in clipped(intervals, low, high) for level in interval), high]
    return tuple((a, b) for a, b in zip(levels[::2], levels[1::2], strict=True) if a < b)


def _left(tree: ObjectTree, feature: Feature, stretch: tuple[float, float]) -> str:
    words = f"from z = {_mm(stretch[0])} to {_mm(stretch[1])} mm"
    return f"the z axis of feature {feature.name!r} of {tree.name!r} is not inside it {words}"


def _mm(length: float) -> str:
    return f"{round(1e3 * length, 6) + 0.0:.4g}"


def _exactly(length: float) -> str:
    """Of a place to which a frame may be moved: digits that are left out would put it beside the line again."""
    return f"{round(1e3 * length, 6) + 0.0:.9g}"


def _turned(feature: Feature) -> str:
    if feature.hollow:
        return "put the frame's origin into the mouth, z pointing out of it, and check the depth"
    return "put the frame's origin into the leading end, z pointing back into the part, and check the length"


def _check_mouth(tree: ObjectTree, feature: Feature, along: Intervals, material: Intervals) -> None:
    """From the origin up the axis leaves the hollow feature into the open, not into material."""
    noise = _SHORT * (feature.length or 0.0)
    end = max((b for a, b in along if a <= noise), default=0.0)
    # What comes after a gap does not close the mouth: an arm may be above it.
    for a, b in material:
        if a <= max(end, 0.0) + noise and b > noise:
            message = f"feature {feature.name!r} of {tree.name!r} has no mouth along its z axis, which meets material "
            message += f"{_mm(max(a, 0.0))} mm above the origin"
            raise TaskError(message, feature.name, MOUTH, "turn z out of the mouth, or open the feature")


def _check_central(tree: ObjectTree, feature: Feature, body: Solid, whole: Solid, window: tuple[float, float]) -> None:
    outlines, enclosed = _outlines(feature, body, whole, window)
    if _is_central(outlines):
        return
    if not enclosed and any(_is_open_along(axis, body, whole) for axis in _AXES):
        return
    centres = (_centroid(outline) for outline in outlines)
    x, y = max(centres, key=lambda centre: float(np.linalg.norm(centre)), default=np.zeros(2))
    message = f"the frame of feature {feature.name!r} of {tree.name!r} is not on a central line: along z a section has "
    message += f"its centroid at ({_exactly(x)}, {_exactly(y)}) mm{_even(outlines)}"
    advice = "move the frame's origin there, or to the centre of the largest circle inside, which an even gap around "
    advice += "leaves where it is; or turn an axis along the line; or leave `at` out, to have it found"
    raise TaskError(message, feature.name, CENTRAL, advice)


def _outlines(feature: Feature, body: Solid, whole: Solid, window: tuple[float, float]) -> tuple[list[Array], bool]:
    """Outlines (n, 2) around the z axis: of a solid feature's material, or of the opening of a hollow one.

    Also whether they are closed all the way. A slot is not, and its body stands for it.
    """
    cut, own = across(whole), across(body)
    found, enclosed = [], True
    for height in _heights(polyhedron(whole), *window):
        polygons = _rings(cut(height))
        if feature.hollow:
            rings = [ring for _, inner in polygons for ring in inner]
            if not any(map(_around, rings)):
                rings, enclosed = [outer for outer, _ in _rings(own(height))], False
        else:
            rings = [outer for outer, _ in polygons]
        found += sorted((ring for ring in rings if _around(ring)), key=_size)[:1]
    return found, enclosed


def _is_open_along(axis: Pose, body: Solid, whole: Solid) -> bool:
    """Whether the z axis of the frame `axis` is a central line of a slot, and leaves it into the open at an end."""
    slot, rest = moved(body, axis.inverse()), moved(whole, axis.inverse())
    material = on_axis(rest)
    ends = np.array([end for stretch in material for end in stretch])
    for a, b in on_axis(slot):
        if a < 0.0 < b and not all(np.any(np.abs(ends - end) <= _SHORT * (b - a)) for end in (a, b)):
            return _is_central(_body_outlines(slot))
    return False


def _body_outlines(body: Solid) -> list[Array]:
    cut = across(body)
    outers = [[outer for outer, _ in _rings(cut(height))] for height in _heights(polyhedron(body), -np.inf, np.inf)]
    return [rings[0] for rings in outers] if all(len(rings) == 1 for rings in outers) else []


def _heights(shell: Polyhedron, low: float, high: float) -> list[float]:
    levels = np.unique(np.round(np.clip(shell.vertices[:, 2], low, high), 12))  # pm: rounding makes no levels
    wide = _SHORT * float(levels[-1] - levels[0])
    return [a + share * (b - a) for a, b in pairwise(levels) if b - a > wide for share in _HEIGHTS]


def _rings(section: BaseGeometry) -> list[tuple[Array, list[Array]]]:
    """The polygons of a section: outer ring (n, 2), and the rings of its holes; no point twice."""
    shapes = [shape for shape in getattr(section, "geoms", [section]) if shape.geom_type == "Polygon" and shape.area]
    return [
        (np.array(shape.exterior.coords)[:-1], [np.array(ring.coords)[:-1] for ring in shape.interiors])
        for shape in shapes
    ]


def _around(ring: Array) -> bool:
    """Whether the ring goes around the origin."""
    angle = np.arctan2(ring[:, 1], ring[:, 0])
    turn = (np.roll(angle, -1) - angle + np.pi) % (2.0 * np.pi) - np.pi
    return bool(abs(np.sum(turn)) > np.pi)  # 2π around it, 0 beside it


def _is_central(outlines: Sequence[Array]) -> bool:
    notions: tuple[Callable[[Array], bool], ...] = (_at_centroid, _at_outer_circle, _at_inner_circle, _at_even_centre)
    return bool(outlines) and any(all(notion(ring) for ring in outlines) for notion in notions)


def _size(ring: Array) -> float:
    return float(np.max(np.ptp(ring, axis=0)))


def _centroid(ring: Array) -> Array:
    ahead = np.roll(ring, -1, axis=0)
    area = ring[:, 0] * ahead[:, 1] - ring[:, 1] * ahead[:, 0]
    return np.asarray((area @ (ring + ahead)) / (3.0 * np.sum(area)))


def _at_centroid(ring: Array) -> bool:
    return float(np.linalg.norm(_centroid(ring))) <= _NOISE * _size(ring)


def _at_outer_circle(ring: Array) -> bool:
    """Whether the smallest circle around the ring is about the origin: its farthest points leave no half-plane free."""
    distance = np.linalg.norm(ring, axis=1)
    return _gap(ring[distance >= distance.max() - _NOISE * _size(ring)]) <= np.pi + _NOISE


def _at_inner_circle(ring: Array) -> bool:
    """Whether a largest circle inside the ring is about the origin: its nearest points leave less than a half-plane."""
    side = np.roll(ring, -1, axis=0) - ring
    share = np.clip(-np.sum(ring * side, axis=1) / np.sum(side * side, axis=1), 0.0, 1.0)
    nearest = ring + share[:, None] * side
    distance = np.linalg.norm(nearest, axis=1)
    # Two parallel walls leave just a half-plane: a circle between them could slide.
    return _gap(nearest[distance <= distance.min() + _NOISE * _size(ring)]) < np.pi - 1e-3


def _even(outlines: Sequence[Array]) -> str:
    """Where the frame would be found, in words."""
    from fmopt.geometry.centre import centre

    if not outlines:
        return ""
    ring = outlines[0]
    x, y = centre(ring if _signed_area(ring) > 0.0 else ring[::-1])
    return f", and is found at ({_exactly(x)}, {_exactly(y)}) mm of the frame"


def _at_even_centre(ring: Array) -> bool:
    """Whether a point that an even gap leaves where it is is the origin."""
    from fmopt.geometry.centre import centres

    facing = ring if _signed_area(ring) > 0.0 else ring[::-1]
    return any(float(np.linalg.norm(point)) <= _NOISE * _size(ring) for point in centres(facing))


def _signed_area(ring: Array) -> float:
    ahead = np.roll(ring, -1, axis=0)
    return 0.5 * float(np.sum(ring[:, 0] * ahead[:, 1] - ring[:, 1] * ahead[:, 0]))


def _gap(points: Array) -> float:
    """The widest angle in rad at the origin between neighbouring points."""
    angles = np.sort(np.arctan2(points[:, 1], points[:, 0]))
    return float(np.max(np.diff(np.append(angles, angles[0] + 2.0 * np.pi))))


def on_axis(solid: Solid, pose: Pose | None = None) -> Intervals:
    """Stretches (from, to) in m of the z axis inside the solid, ascending and apart."""
    pose = pose or Pose.identity()
    match solid:
        case Placed(inner, move):
            return on_axis(inner, pose.compose(move))
        case Union(parts):
            return _combined([on_axis(part, pose) for part in parts], [])
        case Difference(base, tools):
            return _combined([on_axis(base, pose)], [on_axis(tool, pose) for tool in tools])
        case _:
            return _through(solid, pose)


def clipped(intervals: Intervals, low: float, high: float) -> Intervals:
    """What of the intervals lies between two heights.

    Args:
        intervals: of heights, apart and in order, m.
        low, high: m.
    """
    cut = ((max(a, low), min(b, high)) for a, b in intervals)
    return tuple((a, b) for a, b in cut if a < b)


def length(intervals: Intervals) -> float:
    """Total length, m."""
    return sum(b - a for a, b in intervals)


def _combined(added: list[Intervals], taken: list[Intervals]) -> Intervals:
    levels = np.unique([level for some in (*added, *taken) for interval in some for level in interval])
    kept: list[tuple[float, float]] = []
    for a, b in pairwise(levels.tolist()):
        # Between neighbouring levels nothing begins or ends: the middle stands for the stretch.
        middle = 0.5 * (a + b)
        if any(_holds(some, middle) for some in added) and not any(_holds(some, middle) for some in taken):
            joins = bool(kept) and kept[-1][1] == a
            kept[-1:] = [(kept[-1][0], b)] if joins else [*kept[-1:], (a, b)]
    return tuple(kept)


def _holds(intervals: Intervals, height: float) -> bool:
    return any(a < height < b for a, b in intervals)


def _through(primitive: Primitive, pose: Pose) -> Intervals:
    """The z axis between the half-spaces n·x ≤ d of a convex primitive."""
    hull = convex_polyhedron(primitive, pose)
    slope, offset = hull.normals[:, 2], hull.offsets
    flat = np.abs(slope) < 1e-12
    # A face along the axis does not bound it, but may have all of it outside.
    if np.any(offset[flat] < 0.0):
        return ()
    bounds = offset[~flat] / slope[~flat]
    up = slope[~flat] > 0.0
    enter, leave = float(np.max(bounds[~up])), float(np.min(bounds[up]))
    return ((enter, leave),) if enter < leave else ()


def across(solid: Solid, pose: Pose | None = None) -> Cutter:
    """The function of the height z (m) that gives the solid's section there, just above it, as polygons in x and y.

    Args:
        pose: of its frame where z is counted; the identity if None.
    """
    pose = pose or Pose.identity()
    match solid:
        case Placed(inner, move):
            return across(inner, pose.compose(move))
        case Union(parts):
            return _united([across(part, pose) for part in parts])
        case Difference(base, tools):
            whole, cut = across(base, pose), _united([across(tool, pose) for tool in tools])
            return lambda height: sealed(whole(height).difference(cut(height)))
        case _:
            hull = convex_polyhedron(solid, pose)
            return lambda height: section_limit([hull], Pose(np.array([0.0, 0.0, height]), np.eye(3)), 1)


def _united(cutters: list[Cutter]) -> Cutter:
    def union(height: float) -> BaseGeometry:
        first, *others = (cutter(height) for cutter in cutters)
        for other in others:
            first = first.union(other)
        return sealed(first) if others else first

    return union
