"""Open edges of a mesh: corners of both rims made one, sides split at corners that lie on them, gaps closed.

A gap whose loops lie in one plane is closed by flat triangles. Two loops that run along each other, as where a wall
ends short of the face below it, are joined by a band. Any other gap stays open.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from manifold3d import triangulate

from fmopt.errors import GeometryError
from fmopt.geometry.facets import Indices, first_within, normals_of
from fmopt.geometry.polyhedron import plane_basis
from fmopt.spatial.values import Array, Value

_BAND = 0.05  # of a loop's size: as far apart as this, two loops run along each other
_MOST_GAPS = 100  # beyond which nothing is plain to see
MOST_OFF = 2.5e-5  # m: facets farther off one plane are meant to be several
_ALIKE = 0.9  # of the cosine: what looks the same way
_MOST = 0.45  # of the whole surface: gaps beyond this are no gaps
MOST_OPEN = 5_000  # open edges: more are no rims of gaps
_MOST_SPLITS = 10  # times that triangles are split at the rims of gaps


@dataclass(frozen=True, eq=False)
class Patch(Value, corners=(None, 3), labels={"corners": "rim of a gap"}):
    """Triangles (k, 3) that close a gap of a mesh, within its rim (n, 3), m."""

    triangles: Indices  # vertex indices, counter-clockwise seen from outside
    corners: Array
    beside: int
    flush: bool = False  # whether it goes on a face that is there, in its plane


@dataclass(frozen=True)
class _EdgeLoop:
    """A loop of open edges, as the missing surface has it around itself, with the triangle beside its first edge."""

    loop: tuple[int, ...]
    beside: int


def open_sides(triangles: Indices) -> Indices:
    """The sides of triangles (m, 3) without another one across: 3 i + k is that from corner k of triangle i on."""
    there, back = _directed(triangles)
    return np.flatnonzero(~np.isin(back, there))


def closes(triangles: Indices) -> bool:
    """Whether every side of triangles (m, 3) has one other across it."""
    return len(np.unique(_directed(triangles)[0])) == triangles.size and not len(open_sides(triangles))


def _rim(triangles: Indices, sides: Indices) -> Indices:
    """The vertices at sides of triangles (m, 3) that are numbered so."""
    return np.unique([triangles.ravel()[sides], triangles[sides // 3, (sides + 1) % 3]])


def _directed(triangles: Indices) -> tuple[Indices, Indices]:
    """A number for each side of triangles (m, 3), and that of a side which runs the other way."""
    start, end = triangles.ravel(), np.roll(triangles, -1, axis=1).ravel()
    wide = int(triangles.max(initial=0)) + 1
    return start * wide + end, end * wide + start


def joined(points: Array, triangles: Indices, numbers: Indices, reach: float) -> tuple[Indices, Indices, float]:
    """Triangles with one vertex for those of open edges that lie together, and how far these were moved for it, m.

    A rim that is cut differently on its two sides may have corners in the same place that noise has set apart, by no
    more than `reach`, m. Triangles (m, 3) over points (n, 3), m, that are left keep what they are called (m,).
    """
    rim = _rim(triangles, open_sides(triangles))
    if not 0 < len(rim) <= MOST_OPEN:
        return triangles, numbers, 0.0
    became = np.arange(len(points))
    became[rim] = rim[first_within(points[rim], reach)]
    found = became[triangles]
    alive = np.all(found != np.roll(found, 1, axis=1), axis=1)
    return found[alive], numbers[alive], float(np.max(np.linalg.norm(points[became] - points, axis=1)))


def sewn(points: Array, triangles: Indices, numbers: Indices, reach: float) -> tuple[Indices, Indices]:
    """Triangles with an open edge are split at the vertices that lie on it, as where a rim was subdivided on one side.

    Only vertices of open edges count, so that the surface stays where it is. Where there are too many to be a rim, it
    is left as open as it is. Parts of triangles (m, 3) over points (n, 3), m, keep what these are called (m,); vertices
    within `reach` of an edge, m, lie on it.
    """
    for _ in range(_MOST_SPLITS):
        loose = open_sides(triangles)
        if len(loose) > MOST_OPEN:
            break
        rim = _rim(triangles, loose)
        splits: dict[int, tuple[int, list[int]]] = {}
        for i, k in zip(*divmod(loose, 3), strict=True):
            if between := _between(points, triangles[i, k], triangles[i, (k + 1) % 3], rim, reach):
                # One side of a triangle at a time: what lies on another one is for the next round.
                splits.setdefault(int(i), (int(k), between))
        if not 0 < sum(len(between) for _, between in splits.values()) <= MOST_OPEN:
            break
        kept = [triangle for i, triangle in enumerate(triangles.tolist()) if i not in splits]
        called = [number for i, number in enumerate(numbers.tolist()) if i not in splits]
        for i, (k, between) in splits.items():
            a, b, c = np.roll(triangles[i], -k).tolist()
            parts = [[one, two, c] for one, two in pairwise([a, *between, b])]
            kept.extend(parts)
            called.extend([int(numbers[i])] * len(parts))
        triangles, numbers = np.array(kept, dtype=np.int64), np.array(called, dtype=np.int64)
    return triangles, numbers


def _between(points: Array, a: int, b: int, candidates: Indices, reach: float) -> list[int]:
    """The candidates strictly inside the segment from a to b, in order along it."""
    along = points[b] - points[a]
    length = float(np.linalg.norm(along))
    arms = points[candidates] - points[a]
    run = arms @ along / length
    off = np.linalg.norm(arms - np.outer(run / length, along), axis=1)
    on = (off <= reach) & (run > reach) & (run < length - reach)
    return [int(index) for index in candidates[on][np.argsort(run[on])]]


def patches(points: Array, triangles: Indices, tol: float) -> tuple[Patch, ...]:
    """What closes the gaps of a mesh, as far as that is plain to see; nothing where triangles disagree.

    These (m, 3), over points (n, 3), m, are counter-clockwise seen from outside; what is within `tol`, m, of a plane
    lies in it.
    """
    gaps = _gaps(triangles)
    made = []
    while gaps:
        first = gaps.pop(0)
        # Bands before caps: each of two rims that run along each other is often flat by itself.
        twin = next((gap for gap in gaps if _along(points, first, gap, tol)), None)
        if twin is not None:
            gaps.remove(twin)
            made.append(_patch(points, _band(points, first.loop, twin.loop), (first, twin)))
            continue
        level = [first, *(gap for gap in gaps if _is_flat(points, (first, gap), tol))]
        if not _is_flat(points, level, tol):
            continue
        gaps = [gap for gap in gaps if gap not in level]
        made.append(_patch(points, _cap(points, level), level))
    whole = _area(points, triangles)
    made = [replace(patch, flush=_is_flush(points, triangles, patch)) for patch in made]
    return tuple(made) if sum(_area(points, patch.triangles) for patch in made) <= _MOST * whole else ()


def _gaps(triangles: Indices) -> list[_EdgeLoop]:
    """The gaps of a mesh; none where they are too many."""
    loose = open_sides(triangles)
    beside = loose // 3
    starts, ends = triangles.ravel()[loose], triangles[beside, (loose + 1) % 3]
    # The missing surface runs the other way; fewer starts than edges tell that rims meet in a vertex.
    following = dict(zip(ends.tolist(), zip(starts.tolist(), beside.tolist(), strict=True), strict=True))
    if len(np.unique(_directed(triangles)[0])) < triangles.size or len(following) < len(loose):
        return []
    found = list[_EdgeLoop]()
    while following:
        if len(found) == _MOST_GAPS:
            return []
        start = min(following)
        loop, first = [start], following[start][1]
        while (ahead := following.pop(loop[-1], (start, first))[0]) != start:
            loop.append(ahead)
        found.append(_EdgeLoop(tuple(loop), first))
    return found


def _is_flat(points: Array, gaps: Sequence[_EdgeLoop], tol: float) -> bool:
    corners = points[[index for gap in gaps for index in gap.loop]]
    centred = corners - corners.mean(axis=0)
    return bool(np.abs(centred @ np.linalg.svd(centred, full_matrices=False)[2][-1]).max() <= tol)


def _along(points: Array, one: _EdgeLoop, other: _EdgeLoop, tol: float) -> bool:
    """Whether two loops, not in one plane, run along each other in opposite directions."""
    from scipy.spatial import cKDTree

    a, b = points[list(one.loop)], points[list(other.loop)]
    reach = _BAND * float(min(np.linalg.norm(np.ptp(a, axis=0)), np.linalg.norm(np.ptp(b, axis=0))))
    apart = max(float(np.max(cKDTree(a).query(b)[0])), float(np.max(cKDTree(b).query(a)[0])))
    return float(_normal(a) @ _normal(b)) < 0.0 and apart <= reach and not _is_flat(points, (one, other), tol)


def _band(points: Array, one: tuple[int, ...], other: tuple[int, ...]) -> Indices:
    """Triangles between two loops that run against each other, by the shorter diagonal each time."""
    back = other[::-1]
    near = int(np.argmin(np.linalg.norm(points[list(back)] - points[one[0]], axis=1)))
    a, b = [*one, one[0]], [*back[near:], *back[:near], back[near]]
    made, i, j = [], 0, 0
    while i < len(one) or j < len(back):
        ahead = i < len(one) and (
            j == len(back)
            or np.linalg.norm(points[a[i + 1]] - points[b[j]]) <= np.linalg.norm(points[a[i]] - points[b[j + 1]])
        )
        made.append((a[i], a[i + 1], b[j]) if ahead else (a[i], b[j + 1], b[j]))
        i, j = (i + 1, j) if ahead else (i, j + 1)
    return np.array(made, dtype=np.int64)


def _cap(points: Array, gaps: Sequence[_EdgeLoop]) -> Indices:
    """Flat triangles inside loops of one plane, outer ones counter-clockwise about the outward normal."""
    loops = [np.array(gap.loop) for gap in gaps]
    normal = np.sum([_normal(points[loop]) for loop in loops], axis=0)
    length = float(np.linalg.norm(normal))
    if length == 0.0:
        raise GeometryError("the surface is open along two equal loops", "close the mesh")
    flat = points @ plane_basis(normal / length)
    return np.concatenate(loops)[np.asarray(triangulate([flat[loop] for loop in loops]), dtype=np.int64)]


def _patch(points: Array, triangles: Indices, gaps: Sequence[_EdgeLoop]) -> Patch:
    return Patch(triangles, points[[index for gap in gaps for index in gap.loop]], min(gap.beside for gap in gaps))


def _is_flush(points: Array, triangles: Indices, patch: Patch) -> bool:
    """Whether a flat patch lies in the plane of a triangle at its rim that looks the same way."""
    corners = points[np.unique(patch.triangles)]
    area = normals_of(points[patch.triangles]).sum(axis=0)
    size = float(np.linalg.norm(area))
    if size == 0.0 or np.ptp(corners @ area) > MOST_OFF * size:
        return False
    normal = area / size
    rim = set(np.unique(patch.triangles).tolist())
    for triangle in triangles[np.isin(triangles, list(rim)).sum(axis=1) == 2]:
        own = _normal(points[triangle])
        near = np.abs(points[triangle] @ normal - np.mean(corners @ normal)).max() <= MOST_OFF
        if near and own @ normal > _ALIKE * np.linalg.norm(own):
            return True
    return False


def _normal(loop: Array) -> Array:
    """Normal of a loop (n, 3) of points, twice as long as its area, m²."""
    arms = loop - loop.mean(axis=0)
    return np.asarray(np.sum(np.cross(arms, np.roll(arms, -1, axis=0)), axis=0))


def _area(points: Array, triangles: Indices) -> float:
    return 0.5 * float(np.sum(np.linalg.norm(normals_of(points[triangles]), axis=1)))
