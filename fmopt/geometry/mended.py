"""Gaps of a mesh: loops of open edges, closed where the surface that is missing is plain to see.

A gap whose loops lie in one plane is closed by flat triangles. Two loops that run along each other, as where a wall
ends short of the face below it, are joined by a band. Any other gap stays open.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fmopt.errors import GeometryError
from fmopt.geometry.facets import Indices
from fmopt.geometry.polyhedron import plane_basis
from fmopt.values import Array, Value, frozen

_BAND = 0.05  # of a loop's size: as far apart as this, two loops run along each other
_MOST_GAPS = 100  # beyond which nothing is plain to see
_MOST = 0.45  # of the whole surface: gaps beyond this are no gaps


@dataclass(frozen=True, eq=False)
class Patch(Value):
    """What closes a gap of a mesh.

    Args:
        triangles: (k, 3) vertex indices, counter-clockwise seen from outside.
        corners: (n, 3), the rim of the gap, m.
        beside: index of a triangle at the rim.
    """

    triangles: Indices
    corners: Array
    beside: int

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
    return tuple(made) if sum(_area(points, patch.triangles) for patch in made) <= _MOST * whole else ()


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


def _normal(loop: Array) -> Array:
    """Normal of a loop (n, 3) of points, twice as long as its area, m²."""
    arms = loop - loop.mean(axis=0)
    return np.asarray(np.sum(np.cross(arms, np.roll(arms, -1, axis=0)), axis=0))


def _area(points: Array, triangles: Indices) -> float:
    a, b, c = (points[triangles[:, k]] for k in range(3))
    return 0.5 * float(np.sum(np.linalg.norm(np.cross(b - a, c - a), axis=1)))
