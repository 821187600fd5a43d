"""Mating features found on a part that does not name them: holes, bosses, and the part itself where it is a peg.

A face with a second outline has a hole there where the edges of that outline are convex, a boss where they are reflex.
A part that is a prism to a flat end, up to a shoulder or over its whole length, is a peg along its longest such axis.
Frames: the origin in the centre of the section half-way along, z by the rule of `Feature`, x along the longest
side of that section, both by `fmopt.geometry.centre`, so that a peg and a hole of one shape get frames that agree up to
its symmetry; of a round section x is along the model's where that lies across.

Named mating features of a part: solid ones (pegs) and hollow ones (holes), each with a frame on its centre line.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from fmopt.errors import GeometryError
from fmopt.geometry.facets import Loop, chords
from fmopt.geometry.polyhedron import Face, Polyhedron, plane_basis
from fmopt.geometry.section import section_limit
from fmopt.spatial.se3 import Pose
from fmopt.spatial.values import Array, Value

if TYPE_CHECKING:
    from shapely import Polygon


_SLENDER = 1.5  # a part with holes is a peg too when it is this many times as long as its section is wide
_SAME = 1e-6  # of the diameter, and rad
_ROUND = 1e-9  # m: to which origins are rounded
_ALIKE = 1e-3  # of lengths and areas that are meant to be equal
_REPEATED = 1e-12  # m: origins this close to multiples of a nanometre are meant to be them

FeatureKind = Literal["solid", "hollow"]

DESCRIBE = (
    "describe where it mates under [features] of a model file: a hole, or a slot that is open to the side, by kind = "
    '"hollow", at = [x, y, z] in the middle of its mouth, turn = [rx, ry, rz] such that z points out of the mouth, '
    'length = its depth; a peg by kind = "solid", at = [x, y, z] in the middle of its leading end, turn such that z '
    "points from there into the part, length = how long it is"
)

_NARROW = 2e-3  # of the diameter: facets of curved surfaces are off them by less


@dataclass(frozen=True)
class _Found:
    """A feature without its name, its section's area in m² and how wide its mouth is, m².

    Of a hole also the loop of its mouth, and that of its far one where it is through.
    """

    kind: FeatureKind
    frame: Pose
    length: float
    through: bool
    area: float
    mouth: float
    rim: Loop = ()
    far: Loop = ()


def found_features(body: Polyhedron, pieces: Sequence[Polyhedron]) -> tuple[Feature, ...]:
    """The pegs and holes of a part, largest first: "peg" and "hole", or "hole_1", "hole_2", … where there are more.

    Args:
        body: the part's boundary, m.

    Raises:
        GeometryError: there are none, or the part is as much a peg along one axis as along another.
    """
    found = _without_steps(_without_far_mouths([*_around_inner_loops(body, pieces)]), _SAME * body.diameter)
    tips = [one.frame.p for one in found if one.kind == "solid"]
    for peg in _slenderest(_ends(body, pieces)):
        known = any(np.linalg.norm(peg.frame.p - tip) <= _SAME * body.diameter for tip in tips)
        if not found or (not known and peg.length >= _SLENDER * np.sqrt(peg.area)):
            found.append(peg)
    if not found:
        raise GeometryError("no peg or hole was found on it", DESCRIBE)
    made = []
    for kind, name in (("solid", "peg"), ("hollow", "hole")):
        level = _levels([f.area for f in found])
        own = sorted((f for f in found if f.kind == kind), key=lambda f: (-level[f.area], *_rank(f)))
        names = [name] if len(own) == 1 else [f"{name}_{i}" for i in range(1, len(own) + 1)]
        made += [Feature(n, f.kind, f.frame, f.length, f.through) for n, f in zip(names, own, strict=True)]
    return tuple(made)


def _rank(found: _Found) -> tuple[float, ...]:
    x, y, z = found.frame.p
    return (round(float(x), 6), round(float(y), 6), round(float(z), 6))


def _around_inner_loops(body: Polyhedron, pieces: Sequence[Polyhedron]) -> Iterator[_Found]:
    convex = {edge.vertices: edge.convex for edge in body.edges}
    for face in body.faces:
        for loop in face.loops[1:]:
            sides = [tuple(sorted(side)) for side in zip(loop, loop[1:] + loop[:1], strict=True)]
            flags = [convex[a, b] for a, b in sides]
            if all(flags):
                made = _hole(body, pieces, face, loop)
            elif not any(flags):
                made = _boss(pieces, face, body.vertices[list(loop)])
            else:
                made = None
            if made is not None:
                yield made


def _hole(body: Polyhedron, pieces: Sequence[Polyhedron], face: Face, rim: Loop) -> _Found | None:
    mouth, size = _inside(body.vertices[list(rim)], face.normal)
    below = [a for a, b in _material(pieces, mouth, -face.normal) if b > _SAME * body.diameter]
    through = not below
    depth, far = _far_mouth(body, face, mouth) if through else (min(below), ())
    if depth <= _SAME * body.diameter or not np.isfinite(depth):  # through, with no mouth on the other side
        return None
    ring = section_ring(pieces, mouth, face.normal, -0.5 * depth, hollow=True)
    if ring is None:
        return None
    return _Found("hollow", _frame(ring, mouth, face.normal), depth, through, ring.area, size, rim, far)


def _far_mouth(body: Polyhedron, face: Face, mouth: Array) -> tuple[float, Loop]:
    """Distance from the mouth to the nearest face on the other side with an outline around the axis, and that outline.

    Infinite where there is none.
    """
    from shapely import Point, Polygon

    found: tuple[float, Loop] = (np.inf, ())
    for other in body.faces:
        if other.normal @ face.normal > -1.0 + 1e-9:
            continue
        basis, depth = plane_basis(other.normal), float(face.offset + other.offset)  # normals are opposite
        for loop in other.loops[1:]:
            if depth < found[0] and Polygon(body.vertices[list(loop)] @ basis).contains(Point(mouth @ basis)):
                found = depth, loop
    return found


def _boss(pieces: Sequence[Polyhedron], face: Face, rim: Array) -> _Found | None:
    base, size = _inside(rim, face.normal)
    spans = [b for a, b in _material(pieces, base, face.normal) if a <= _ROUND]
    height = max(spans, default=0.0)
    if height <= _ROUND:
        return None
    ring = section_ring(pieces, base, -face.normal, -0.5 * height, hollow=False)
    if ring is None:
        return None
    tip = base + height * face.normal
    return _Found("solid", _frame(ring, tip, -face.normal), height, False, ring.area, size)


def other_ends(body: Polyhedron, pieces: Sequence[Polyhedron], feature: Feature) -> list[Pose]:
    """The frames of a found feature by its other end, where that leads too: of a prism, a hole with like mouths."""
    found = _ends(body, pieces) if feature.kind == "solid" else [*_around_inner_loops(body, pieces)]
    z, beside = feature.frame.R[:, 2], _SAME * body.diameter
    own = [f for f in found if np.linalg.norm(f.frame.p - feature.frame.p) <= beside and f.frame.R[:, 2] @ z > 0.0][:1]
    return [
        other.frame
        for one in own
        for other in found
        if other.frame.R[:, 2] @ z < -1.0 + 1e-9 and set(other.rim) == set(one.far)
        if all(len(set(_levels(sizes).values())) == 1 for sizes in zip(_sizes(one), _sizes(other), strict=True))
    ]


def _sizes(found: _Found) -> tuple[float, float]:
    return found.length, found.mouth


def _ends(body: Polyhedron, pieces: Sequence[Polyhedron]) -> list[_Found]:
    """The ends that the part could lead with as a peg."""
    reach = _SAME * body.diameter
    ends = []
    strips = _strips(body)
    for number, face in enumerate(body.faces):
        if number in strips:
            continue
        heights = body.vertices @ face.normal - face.offset
        along = body.normals @ face.normal
        levels = body.offsets - face.offset  # of the faces that look the same way; others are not asked
        shoulders = (along > 1.0 - 1e-9) & (levels < -reach)
        inside = _around(body, face, shoulders, reach)
        undercut = (along < -1.0 + 1e-9) & (-body.offsets - face.offset > heights.min() + reach)
        if heights.max() > reach or np.count_nonzero(np.abs(along) < 1e-9) < 3 or undercut.any():
            continue
        length = float(-levels[inside].max()) if inside.any() else float(-heights.min())
        tip, _ = _inside(body.vertices[list(face.loops[0])], face.normal)
        ring = section_ring(pieces, tip, -face.normal, 0.5 * length, hollow=False, alone=True)
        if ring is not None:
            frame = _frame(ring, tip, -face.normal)
            ends.append(_Found("solid", frame, length, False, ring.area, ring.area))
    return ends


def _around(body: Polyhedron, end: Face, shoulders: NDArray[np.bool_], reach: float) -> NDArray[np.bool_]:
    """Those of some faces that look the way an end looks which reach out of its outline; the others are floors."""
    from shapely import Polygon

    basis = plane_basis(end.normal)
    tip = Polygon(body.vertices[list(end.loops[0])] @ basis).buffer(reach)
    found = np.zeros_like(shoulders)
    for number in np.flatnonzero(shoulders):
        found[number] = not tip.contains(Polygon(body.vertices[list(body.faces[number].loops[0])] @ basis))
    return found


def _strips(body: Polyhedron) -> set[int]:
    """The faces that are facets of a curved surface, such as a fillet: they turn little from two neighbours, and are
    narrow for it."""
    narrow = _NARROW * body.diameter
    found = Counter(
        number
        for faces, sagittas in chords(body)
        for number, sagitta in zip(faces, sagittas, strict=True)
        if sagitta <= narrow
    )
    return {number for number, count in found.items() if count > 1}


def _slenderest(ends: Sequence[_Found]) -> list[_Found]:
    """The end of the longest peg for its width, if any; of equal ends of one axis that which points down in the model.

    Raises:
        GeometryError: ends of several axes are equal.
    """

    def slender(end: _Found) -> float:
        return end.length / float(np.sqrt(end.area))

    best = max(map(slender, ends), default=0.0)
    near = [end for end in ends if slender(end) > 0.99 * best]
    if any(abs(end.frame.R[:, 2] @ near[0].frame.R[:, 2]) < 1.0 - 1e-9 for end in near):
        message = "it is as much a peg along one axis as along another"
        raise GeometryError(message, DESCRIBE)
    return [max(near, key=lambda end: _upward(end.frame.R[:, 2]))] if near else []


def _without_far_mouths(found: Sequence[_Found]) -> list[_Found]:
    """Of the two mouths of a through hole the wider one, of equal ones that which looks up in the model."""
    kept: list[_Found] = []
    level = _levels([one.mouth for one in found])
    for one in sorted(found, key=lambda f: (level[f.mouth], _upward(f.frame.R[:, 2])), reverse=True):
        if not (one.far and any(other.far and one.rim in (other.rim, other.far) for other in kept)):
            kept.append(one)
    return kept


def _without_steps(found: Sequence[_Found], reach: float) -> list[_Found]:
    """Holes, without those that open in another one's step: they are its lower end."""

    def within(one: _Found, other: _Found) -> bool:
        z = other.frame.R[:, 2]
        depth = -float(z @ (one.frame.p - other.frame.p))
        beside = float(np.linalg.norm(one.frame.p - other.frame.p + depth * z))
        ahead = one.kind == other.kind == "hollow" and one.frame.R[:, 2] @ z > 1.0 - 1e-9
        return bool(ahead and reach < depth < other.length - reach and beside <= 0.5 * np.sqrt(other.mouth))

    return [one for one in found if not any(within(one, other) for other in found)]


def _levels(sizes: Sequence[float]) -> dict[float, int]:
    """Sizes that are alike have the same number, larger ones a larger one."""
    level, found, before = 0, {}, 0.0
    for size in sorted(sizes):
        level += size > before * (1.0 + _ALIKE)
        found[size], before = level, size
    return found


def _upward(z: Array) -> tuple[float, float, float]:
    return (round(float(z[2]), 9), round(float(z[1]), 9), round(float(z[0]), 9))


def _material(pieces: Sequence[Polyhedron], start: Array, along: Array) -> list[tuple[float, float]]:
    """Where a line runs inside each convex piece: distances (low, high) from its start, m."""
    spans = []
    for piece in pieces:
        room, rate = piece.offsets - piece.normals @ start, piece.normals @ along
        if np.any((np.abs(rate) < 1e-12) & (room < _ROUND)):
            continue
        ahead, back = rate >= 1e-12, rate <= -1e-12
        low, high = float((room[back] / rate[back]).max()), float((room[ahead] / rate[ahead]).min())
        if high > low + _ROUND:
            spans.append((low, high))
    return spans


def _inside(rim: Array, normal: Array) -> tuple[Array, float]:
    """A point (3,) well inside a plane outline (n, 3), and the outline's area in m²."""
    from shapely import Polygon

    from fmopt.geometry.centre import inside

    basis = plane_basis(normal)
    return basis @ inside(rim @ basis) + normal * float(np.mean(rim @ normal)), float(Polygon(rim @ basis).area)


def section_ring(
    pieces: Sequence[Polyhedron], origin: Array, z: Array, height: float, hollow: bool, alone: bool = False
) -> Polygon | None:
    """Outline around an origin (3,), m, across z (3,) at a height, in the plane's basis: of an opening or the material.

    `alone`: only where there is no other material at that height.
    """
    from shapely import Point, Polygon

    shapes = section_limit(pieces, Pose(origin + height * z, np.column_stack([plane_basis(z), z])), 1)
    if alone and len(shapes.geoms) > 1:
        return None
    rings = [ring for shape in shapes.geoms for ring in (shape.interiors if hollow else (shape.exterior,))]
    around = [Polygon(ring) for ring in rings if Polygon(ring).contains(Point(0.0, 0.0))]
    return _straightened(min(around, key=lambda shape: shape.area)) if around else None  # the innermost one


def _straightened(shape: Polygon) -> Polygon:
    """The outline without corners that lie between their neighbours but for rounding."""
    from shapely import Polygon

    corners = np.array(shape.exterior.coords)[:-1]
    corners = corners[np.hypot(*(corners - np.roll(corners, 1, axis=0)).T) > _ROUND]
    ahead = np.roll(corners, -1, axis=0) - np.roll(corners, 1, axis=0)
    arms = corners - np.roll(corners, 1, axis=0)
    beside = np.abs(ahead[:, 0] * arms[:, 1] - ahead[:, 1] * arms[:, 0])
    kept = corners[beside > _ROUND * np.hypot(*ahead.T)]
    return Polygon(kept) if len(kept) >= 3 else shape


def _frame(ring: Polygon, at: Array, z: Array) -> Pose:
    """The frame at height 0 over the centre of a section that is given in the basis of `section_ring`."""
    from shapely.geometry.polygon import orient

    from fmopt.geometry.centre import axis, centre, is_round

    basis = plane_basis(z)
    corners = np.array(orient(ring).exterior.coords)[:-1]
    if is_round(corners):
        across = [d - (d @ z) * z for d in np.eye(3) if abs(d @ z) < 0.9]
        x = max((d / np.linalg.norm(d) for d in across), key=lambda d: np.round(d, 6).tolist())
    else:
        x = basis @ axis(corners, basis.T)
    z = _straight(z)
    x = _straight(x - (x @ z) * z)
    turn = np.column_stack([x, np.cross(z, x), z])
    origin = at + basis @ centre(corners)
    near = np.round(origin / _ROUND) * _ROUND + 0.0
    return Pose(np.where(np.abs(near - origin) <= _REPEATED, near, origin), turn)


def _straight(axis: Array) -> Array:
    """A direction (3,) as a unit vector, along an axis of the model where it differs by rounding only."""
    kept = np.where(np.abs(axis) < _SAME, 0.0, axis)
    return np.asarray(kept / np.linalg.norm(kept))


@dataclass(frozen=True, eq=False)
class Feature(Value):
    """A mating feature, a leaf of the tree object, feature class, feature, instances of [LeeHuang1985] section 3.

    Args:
        frame: pose in the part's model frame. Hollow: origin at the centre of the mouth, z out of the mouth.
            Solid: origin at the centre of the leading end face, z from there back into the part.
        length: depth or length along z, m.
        through: whether a hollow feature is open at both ends.

    Raises:
        GeometryError: a length that is not positive, or a solid feature that is through.
    """

    name: str
    kind: FeatureKind
    frame: Pose
    length: float
    through: bool = False

    def __post_init__(self) -> None:
        if not (math.isfinite(self.length) and self.length > 0.0):
            raise GeometryError(f"feature {self.name!r} has length {self.length} m", "make it positive")
        if self.kind == "solid" and self.through:
            raise GeometryError(f"feature {self.name!r} is solid and cannot be through", "drop `through`")


def in_frame(feature: Feature, pose: Pose) -> Feature:
    """The feature with its frame expressed in the frame `pose`, itself given in the feature's model frame."""
    return replace(feature, frame=pose.inverse().compose(feature.frame))
