"""Gaps of a mesh: loops of open edges, closed where the surface that is missing is plain to see.

A gap whose loops lie in one plane is closed by flat triangles. Two loops that run along each other, as where a wall
ends short of the face below it, are joined by a band. Any other gap stays open.

Triangles that face the other way than those around them, and shells that are inside out: turned round.

Triangles of a mesh that cross each other: a surface that passes through itself bounds no solid.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from fmopt.errors import GeometryError
from fmopt.geometry.facets import Indices
from fmopt.geometry.polyhedron import plane_basis
from fmopt.spatial.values import Array, Value, frozen

_BAND = 0.05  # of a loop's size: as far apart as this, two loops run along each other
_MOST_GAPS = 100  # beyond which nothing is plain to see
MOST_OFF = 2.5e-5  # m: facets farther off one plane are meant to be several
_ALIKE = 0.9  # of the cosine: what looks the same way
_MOST = 0.45  # of the whole surface: gaps beyond this are no gaps

Crossing: TypeAlias = tuple[int, int, Array]
_AT_ONCE = 100_000  # pairs of triangles looked at together
_ROWS = 200  # triangles whose neighbours are looked for together
_MOST_PAIRS = 10_000_000  # of triangles whose boxes meet: a mesh that is no heap has some dozens for each triangle


@dataclass(frozen=True, eq=False)
class Patch(Value):
    """What closes a gap of a mesh.

    Args:
        triangles: (k, 3) vertex indices, counter-clockwise seen from outside.
        corners: (n, 3), the rim of the gap, m.
        beside: index of a triangle at the rim.
        flush: whether it goes on a face that is there, in its plane.
    """

    triangles: Indices
    corners: Array
    beside: int
    flush: bool = False

    def __post_init__(self) -> None:
        object.__setattr__(self, "corners", frozen(self.corners, None, 3, name="rim of a gap"))


@dataclass(frozen=True)
class _Gap:
    """A loop of open edges, as the missing surface has it around itself, with the triangle beside its first edge."""

    loop: tuple[int, ...]
    beside: int


def patches(points: Array, triangles: Indices, tol: float) -> tuple[Patch, ...]:
    """What closes the gaps of a mesh, as far as that is plain to see; nothing where triangles disagree.

    Args:
        points: (n, 3), m.
        triangles: (m, 3), counter-clockwise seen from outside.
        tol: points this close to a plane lie in it, m.
    """
    gaps = _gaps(triangles)
    made = []
    while gaps:
        first = gaps.pop(0)
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


def turned_alike(points: Array, triangles: Indices) -> Indices:
    """Triangles (m, 3) turned so that neighbours run along their common side in opposite directions.

    Of triangles that hang together those of the smaller area are turned. Where more than two share a side nothing
    follows from it; where triangles cannot agree, as in a band with a twist, they stay as they are.

    Args:
        points: (n, 3), m.
        triangles: (m, 3), indices of them.
    """
    turned = _turns(points, triangles)
    return np.where(turned[:, None], triangles[:, [0, 2, 1]], triangles) if turned.any() else triangles


def _turns(points: Array, triangles: Indices) -> NDArray[np.bool_]:
    """Which triangles (m,) have to be turned."""
    sides: dict[tuple[int, int], list[tuple[int, bool]]] = {}
    for number, (a, b, c) in enumerate(triangles.tolist()):
        for u, v in ((a, b), (b, c), (c, a)):
            sides.setdefault((min(u, v), max(u, v)), []).append((number, u < v))
    beside: list[list[tuple[int, bool]]] = [[] for _ in range(len(triangles))]
    for pair in sides.values():
        if len(pair) == 2 and pair[0][0] != pair[1][0]:
            (one, up), (other, down) = pair
            beside[one].append((other, up == down))
            beside[other].append((one, up == down))
    corners = points[triangles]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    turned, seen = np.zeros(len(triangles), dtype=bool), np.zeros(len(triangles), dtype=bool)
    for start in range(len(triangles)):
        if seen[start]:
            continue
        seen[start], group, agree = True, [start], True
        for number in group:
            for other, opposed in beside[number]:
                if not seen[other]:
                    seen[other], turned[other] = True, turned[number] ^ opposed
                    group.append(other)
                agree &= bool(turned[other] == (turned[number] ^ opposed))
        if not agree:
            turned[group] = False
        elif area[group] @ turned[group] > 0.5 * area[group].sum():
            turned[group] = ~turned[group]
    return turned


def turned_outward(points: Array, triangles: Indices) -> Indices:
    """Closed shells that are inside out, and inside no other one, turned round; shells inside others are cavities.

    Where there are very many, they are no bodies.

    Args:
        points: (n, 3), m.
        triangles: (m, 3), indices of them.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    pairs = np.vstack([triangles[:, [0, 1]], triangles[:, [1, 2]]])
    links = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(points), len(points)))
    shell = connected_components(links, directed=False)[1][triangles[:, 0]]
    names = np.unique(shell)
    if len(names) > _MOST_GAPS:
        return triangles
    low = np.array([points[triangles[shell == n]].min(axis=(0, 1)) for n in names])
    high = np.array([points[triangles[shell == n]].max(axis=(0, 1)) for n in names])
    turned = np.zeros(len(triangles), dtype=bool)
    for k, name in enumerate(names):
        a, b, c = (points[triangles[shell == name][:, i]] - low[k] for i in range(3))
        inside = np.all(low <= low[k], axis=1) & np.all(high >= high[k], axis=1) & (names != name)
        if float(np.einsum("ij,ij->", a, np.cross(b, c))) < 0.0 and not inside.any():
            turned |= shell == name
    return np.where(turned[:, None], triangles[:, [0, 2, 1]], triangles) if turned.any() else triangles


def _gaps(triangles: Indices) -> list[_Gap]:
    """The gaps of a mesh; none where they are too many."""
    sides: dict[tuple[int, int], int] = {}
    for number, triangle in enumerate(triangles.tolist()):
        for k in range(3):
            if sides.setdefault((triangle[k], triangle[(k + 1) % 3]), number) != number:
                return []
    missing = {(b, a): number for (a, b), number in sides.items() if (b, a) not in sides}
    following = dict(missing.keys())
    if len(following) != len(missing):
        return []
    found = list[_Gap]()
    while following:
        if len(found) == _MOST_GAPS:
            return []
        start = min(following)
        loop = [start]
        while (ahead := following.pop(loop[-1], start)) != start:
            loop.append(ahead)
        found.append(_Gap(tuple(loop), missing[loop[0], loop[1]]))
    return found


def _is_flat(points: Array, gaps: Sequence[_Gap], tol: float) -> bool:
    corners = points[[index for gap in gaps for index in gap.loop]]
    centred = corners - corners.mean(axis=0)
    return bool(np.abs(centred @ np.linalg.svd(centred, full_matrices=False)[2][-1]).max() <= tol)


def _along(points: Array, one: _Gap, other: _Gap, tol: float) -> bool:
    """Whether two loops, not in one plane, run along each other in opposite directions."""
    from scipy.spatial import cKDTree

    a, b = points[list(one.loop)], points[list(other.loop)]
    reach = _BAND * float(min(np.linalg.norm(np.ptp(a, axis=0)), np.linalg.norm(np.ptp(b, axis=0))))
    apart = max(float(np.max(cKDTree(a).query(b)[0])), float(np.max(cKDTree(b).query(a)[0])))
    opposite = float(_normal(a) @ _normal(b)) < 0.0
    return opposite and apart <= reach and not _is_flat(points, (one, other), tol)


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


def _cap(points: Array, gaps: Sequence[_Gap]) -> Indices:
    """Flat triangles inside loops of one plane, outer ones counter-clockwise about the outward normal."""
    from manifold3d import triangulate

    loops = [np.array(gap.loop) for gap in gaps]
    normal = np.sum([_normal(points[loop]) for loop in loops], axis=0)
    length = float(np.linalg.norm(normal))
    if length == 0.0:
        raise GeometryError("the surface is open along two equal loops", "close the mesh")
    flat = points @ plane_basis(normal / length)
    return np.concatenate(loops)[np.asarray(triangulate([flat[loop] for loop in loops]), dtype=np.int64)]


def _patch(points: Array, triangles: Indices, gaps: Sequence[_Gap]) -> Patch:
    corners = points[[index for gap in gaps for index in gap.loop]]
    return Patch(triangles, corners, min(gap.beside for gap in gaps))


def _is_flush(points: Array, triangles: Indices, patch: Patch) -> bool:
    """Whether a flat patch lies in the plane of a triangle at its rim that looks the same way."""
    corners = points[np.unique(patch.triangles)]
    a, b, c = (points[patch.triangles[:, k]] for k in range(3))
    area = np.cross(b - a, c - a).sum(axis=0)
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
    a, b, c = (points[triangles[:, k]] for k in range(3))
    return 0.5 * float(np.sum(np.linalg.norm(np.cross(b - a, c - a), axis=1)))


def first_crossing(points: Array, triangles: Indices, tol: float) -> Crossing | None:
    """The first two triangles of which one has an edge that passes through the other, and where; None if none do.

    What touches, shares an edge or a corner, or overlaps in one plane does not cross.

    Args:
        points: (n, 3), m.
        triangles: (m, 3) vertex indices.
        tol: what passes by less than this does not cross, m.

    Returns:
        Indices of the triangle and of the one whose edge passes through it, and the place (3,) in m.

    Raises:
        GeometryError: the triangles lie in heaps.
    """
    corners = points[triangles]
    one, other = _near(corners)
    for start in range(0, len(one), _AT_ONCE):
        i, j = one[start : start + _AT_ONCE], other[start : start + _AT_ONCE]
        for k in range(3):
            hit, where = _pierced(corners[i], corners[j][:, k], corners[j][:, (k + 1) % 3], tol)
            if len(found := np.flatnonzero(hit)):
                return int(i[found[0]]), int(j[found[0]]), where[found[0]]
    return None


def _near(corners: Array) -> tuple[Indices, Indices]:
    """Ordered pairs of triangles whose boxes meet."""
    from shapely import STRtree, box

    low, high = corners.min(axis=1), corners.max(axis=1)
    flat = box(low[:, 0], low[:, 1], high[:, 0], high[:, 1])
    tree, pairs, seen = STRtree(flat), [np.zeros((2, 0), dtype=np.int64)], 0
    for start in range(0, len(flat), _ROWS):
        one, other = tree.query(flat[start : start + _ROWS])
        one += start
        meet = (one != other) & (low[one, 2] <= high[other, 2]) & (low[other, 2] <= high[one, 2])
        pairs.append(np.array([one[meet], other[meet]]))
        seen += len(one)
        if seen > _MOST_PAIRS:
            raise GeometryError(f"too many of the {len(flat)} triangles lie over each other", "export the mesh coarser")
    one, other = np.hstack(pairs)
    order = np.lexsort((other, one))
    return one[order], other[order]


def _pierced(triangles: Array, start: Array, end: Array, tol: float) -> tuple[np.ndarray, Array]:
    """Whether segments (n, 3) pass through triangles (n, 3, 3), and where they meet the triangles' planes (n, 3)."""
    a, b, c = (triangles[:, k] for k in range(3))
    normal = np.cross(b - a, c - a)
    size = np.linalg.norm(normal, axis=1)
    normal /= np.where(size > 0.0, size, 1.0)[:, None]
    before, after = (np.einsum("ij,ij->i", normal, end_ - a) for end_ in (start, end))
    through = (size > 0.0) & (np.minimum(before, after) < -tol) & (np.maximum(before, after) > tol)
    share = before / np.where(through, before - after, 1.0)
    where = start + share[:, None] * (end - start)
    for one, two in ((a, b), (b, c), (c, a)):
        side = two - one
        length = np.linalg.norm(side, axis=1)
        inward = np.einsum("ij,ij->i", np.cross(normal, side), where - one)
        through &= inward > tol * length
    return through, where
