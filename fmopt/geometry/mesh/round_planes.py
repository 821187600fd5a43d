"""Planes fitted to the facets of round surfaces, which meet at small angles: evenly around one axis where they are so.

Where such planes meet, they are off by many times what each is off its own facet. How far round surfaces may lie from
the facets that stand for them.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from shapely import MultiPoint

from fmopt.geometry.facets import Indices, Loop, normals_of
from fmopt.geometry.polyhedron import Polyhedron
from fmopt.spatial.values import Array, Bits

if TYPE_CHECKING:
    from fmopt.geometry.part import Part

_MANY = 16  # planes about one axis stand for a round surface
_MOSTLY = 0.8  # of the side faces: as many are evenly around
_SPREAD = 0.15  # of the turn from one to the next: what normals that are evenly around are off on average
_EVEN = 1e-9  # rad
_LANDED = 1e-6  # m: what gets less far below the mouth stays on it
_FARTHEST = 0.7  # of how far planes are off one axis at most, above which they are left out together
_FLAT = 1e-4  # rad: triangles that meet at less are one facet
_SMOOTH = math.radians(30.5)  # facets that meet at less than this may stand for one curved surface: 12 to a circle
_ALIKE = 1e-6  # relative, of chord errors of one part in two frames

Planes = tuple[Array, Array]


def rings(angle: Array, slack: Array) -> Iterator[tuple[NDArray[np.intp], float, float]]:
    """Side faces (n,) around a round surface, the even turn between them, and how far they are off that, rad.

    The bearings of their outward normals are (n,), rad, as is how far each may be off its place.
    """
    if len(angle) > _MANY:
        ahead = np.sort(angle)
        # The median turn, which a flat among the facets does not change; at least 1e-3 rad where most are parallel.
        parts = round(math.tau / max(float(np.median(np.diff(ahead, append=ahead[0] + math.tau))), 1e-3))
        step = math.tau / parts
        phase = math.atan2(float(np.sin(parts * angle).mean()), float(np.cos(parts * angle).mean())) / parts
        off = np.abs(angle - phase - step * np.round((angle - phase) / step))
        own = np.flatnonzero(off <= slack)
        if parts > _MANY and len(own) > max(_MANY, _MOSTLY * len(angle)):
            spread = float(np.sqrt(np.mean(off[own] ** 2)))
            if spread <= _SPREAD * step:
                yield own, step, spread


def is_even(normals: Array) -> bool:
    """Whether most of some normals (k, 3) across z are apart by whole parts of a turn that has more than a few."""
    return bool(list(rings(np.arctan2(normals[:, 1], normals[:, 0]), np.full(len(normals), _EVEN))))


def evenly_out(normals: Array, offsets: Array, slack: float) -> Array:
    """Offsets (k,) of planes, m: those around a round surface exactly as far from its axis, but for the slack, m.

    Normals (k, 3) are in a frame that has the axis along z.
    """
    # Facets of one slope have it in common by now, but for rounding.
    made, alike = np.array(offsets), np.round(normals[:, 2], 9)
    rings = [np.flatnonzero(alike == rise) for rise in np.unique(alike[np.abs(alike) < 1.0])]
    rings = [own for ring in rings if len(own := _around_axis(normals, offsets, ring, slack)) > _MANY]
    for together in (rings, *([ring] for ring in rings)):  # about one axis where they are so
        which = np.concatenate([np.zeros(0, dtype=np.intp), *together])
        level, off = _evened(normals, offsets, together)
        if off <= slack:
            made[which] = level
            if len(together) == len(rings):
                break
    return made


def _around_axis(normals: Array, offsets: Array, ring: NDArray[np.intp], slack: float) -> NDArray[np.intp]:
    """Those planes of some (k,) that are equally far from an axis, but for the slack; few where not many are."""
    while len(ring) > _MANY:
        level, off = _evened(normals, offsets, [ring])
        if off <= slack:
            break
        away = np.abs(level - offsets[ring])
        ring = ring[away < max(_FARTHEST * float(away.max()), slack)]
    return ring


def _evened(normals: Array, offsets: Array, rings: Sequence[NDArray[np.intp]]) -> tuple[Array, float]:
    """Offsets of planes that are equally far from one axis in each ring, and by how much they differ from theirs, m."""
    which = np.concatenate([np.zeros(0, dtype=np.intp), *rings])
    if not len(which):
        return np.zeros(0), 0.0
    own = np.repeat(np.arange(len(rings)), [len(ring) for ring in rings])
    # offset = n·c + r: unknown are c, where the axis is in x and y, and the r of each ring.
    rows = np.column_stack([normals[which, :2], own[:, None] == np.arange(len(rings))])
    level = rows @ np.linalg.lstsq(rows, offsets[which], rcond=1e-9)[0]
    return level, float(np.abs(level - offsets[which]).max())


def through_columns(points: Array, faces: Sequence[Sequence[Loop]], planes: Planes, which: Bits) -> Planes:
    """The planes with those of some faces along z laid through the columns of corners in which they meet such others.

    Planes that meet at a small angle are off where they meet by many times what each is off its own corners.

    Args:
        points: (n, 3), m.
        planes: normals and offsets (k,).
        which: faces along z that meet others at small angles (k,).
    """
    around: dict[int, set[int]] = {}
    for number in np.flatnonzero(which).tolist():
        for vertex in {vertex for loop in faces[number] for vertex in loop}:
            around.setdefault(vertex, set()).add(number)
    columns: dict[frozenset[int], list[int]] = {}
    for vertex, own in around.items():
        if len(own) == 2:
            columns.setdefault(frozenset(own), []).append(vertex)
    sides: dict[int, list[Array]] = {}
    for pair, vertices in columns.items():
        for number in pair:
            sides.setdefault(number, []).append(points[vertices, :2].mean(axis=0))
    normals, offsets = np.array(planes[0]), np.array(planes[1])
    for number, places in sides.items():
        # From fewer columns a facet has no direction, and more need not be in one plane.
        if len(places) == 2:
            along = places[1] - places[0]
            normal = np.array([along[1], -along[0]]) / np.linalg.norm(along)
            normal = normal if normal @ normals[number, :2] > 0.0 else -normal
            normals[number, :2], offsets[number] = normal, float(normal @ (places[0] + places[1])) / 2.0
    return normals, offsets


def chord_error(body: Polyhedron, where: Callable[[Array], bool] = lambda corners: True) -> float:
    """The sagitta (m) of the arcs that chains of facets stand for, 0 where there are none.

    A facet with corners (n, 3) counts where `where` says so and it has neighbours that it may be one surface with
    across two or more of its edges: one alone is a chamfer or a draft.
    """
    found = list(_chords(body))
    neighbours = Counter(number for faces, _ in found for number in faces)
    return max(
        (
            height
            for faces, height in found
            if max(neighbours[number] for number in faces) > 1
            and any(where(body.vertices[list(body.faces[number].vertices)]) for number in faces)
        ),
        default=0.0,
    )


def _chords(body: Polyhedron) -> Iterator[tuple[tuple[int, int], float]]:
    """The pairs of faces that may stand for one curved surface, with the lesser sagitta (m) of their arcs.

    Facets of width c that turn by φ from one to the next are chords of an arc with the sagitta c/2 · tan(φ/4).
    """
    faces = np.array([edge.faces for edge in body.edges], dtype=np.int64).reshape(-1, 2)
    one, other = body.normals[faces[:, 0]], body.normals[faces[:, 1]]
    # By both sine and cosine: the cosine alone has lost the digits of a small turn.
    turns = np.arctan2(np.linalg.norm(np.cross(one, other), axis=1), np.vecdot(one, other))
    smooth = np.flatnonzero(turns <= _SMOOTH)
    ends = body.vertices[[body.edges[k].vertices for k in smooth]].reshape(-1, 2, 3)
    along = ends[:, 1] - ends[:, 0]
    along /= np.maximum(np.linalg.norm(along, axis=1), np.finfo(np.float64).tiny)[:, None]
    across = np.cross(body.normals[faces[smooth]], along[:, None])
    for k, ways in zip(smooth.tolist(), across, strict=True):
        pair = body.edges[k].faces
        sagittas = (
            0.5 * float(np.ptp(body.vertices[list(body.faces[number].vertices)] @ way)) * math.tan(0.25 * turns[k])
            for number, way in zip(pair, ways, strict=True)
        )
        yield pair, min(sagittas)


def sagitta(points: Array, triangles: Indices) -> float:
    """As `chord_error`, m, of a closed surface of triangles (m, 3) over points (n, 3), m."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    corners, count = points[triangles], len(triangles)
    normals = normals_of(corners)
    starts, ends = triangles.ravel(), np.roll(triangles, -1, axis=1).ravel()
    order = np.lexsort((np.maximum(starts, ends), np.minimum(starts, ends)))
    one, other = order[::2] // 3, order[1::2] // 3  # every side is there twice
    along = np.linalg.norm(points[ends[order[::2]]] - points[starts[order[::2]]], axis=1)
    cross = np.linalg.norm(np.cross(normals[one], normals[other]), axis=1)
    turn = np.arctan2(cross, np.einsum("ij,ij->i", normals[one], normals[other]))
    flat = turn <= _FLAT
    facet = connected_components(coo_array((flat[flat], (one[flat], other[flat])), (count, count)))[1]
    areas = np.bincount(facet, np.linalg.norm(normals, axis=1)) / 2.0
    smooth = (turn <= _SMOOTH) & ~flat & (along > 0.0)
    pairs = np.unique(np.sort(np.column_stack([facet[one], facet[other]])[smooth], axis=1), axis=0)
    beside = np.bincount(pairs.ravel(), minlength=len(areas)) > 1
    one, other, along, turn = facet[one[smooth]], facet[other[smooth]], along[smooth], turn[smooth]
    width = np.minimum(areas[one], areas[other]) / along
    return float((0.5 * width * np.tan(0.25 * turn))[beside[one] | beside[other]].max(initial=0.0))


def met(moving: Part, fixed: Part, depth: float, beside: float) -> tuple[Part, Part]:
    """Two parts in their mating frames, charged only with curved surfaces that meet the other one's on the way in.

    These are the ones of the moving part that get below the mouth, down to the depth of the goal, m, and of the fixed
    part those beside what does, so far, m. The holes of a flange that lands on the mouth stay above.
    """

    def is_below(corners: Array) -> bool:
        return bool(corners[:, 2].min() < depth - _LANDED)

    vertices = moving.polyhedron.vertices
    some = (vertices[list(face.vertices)] for face in moving.polyhedron.faces)
    below = [vertices[vertices[:, 2] < depth - _LANDED], *(corners for corners in some if is_below(corners))]
    around = MultiPoint(np.vstack(below)[:, :2]).convex_hull.buffer(beside)
    return (
        _charged(moving, is_below),
        _charged(fixed, lambda corners: around.intersects(MultiPoint(corners[:, :2]).convex_hull)),
    )


def _charged(part: Part, where: Callable[[Array], bool]) -> Part:
    """A part with the chord error of some facets; as stated, or of the file's surfaces, where it has any of them."""
    own = chord_error(part.polyhedron, where)
    told = own > 0.0 and not math.isclose(chord_error(part.polyhedron), part.chord_error, rel_tol=_ALIKE)
    return replace(part, chord_error=part.chord_error if told else own)
