"""Convex bodies that enclose a solid with curved faces, nowhere smaller than the solid but for rounding.

The solid is cut through its reflex edges, by the plane that holds most of them first, until each body is convex but for
a small distance; the hull of each body stands for it. A hull of many facets becomes the intersection of the half-spaces
that bound it best. Planes of large faces stay as they are.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from heapq import heapify, heappop, heappush
from itertools import count, product

import numpy as np
from manifold3d import Manifold, OpType
from numpy.typing import NDArray

from fmopt.errors import GeometryError
from fmopt.geometry.convex_pieces import snapped
from fmopt.geometry.facets import Indices, normals_of, require_few
from fmopt.geometry.polyhedron import (
    Polyhedron,
    halfspace_corners,
    manifold_of,
    mesh_of,
    of_manifold,
    plane_basis,
    with_vertices,
)
from fmopt.runtime.clock import heed
from fmopt.spatial.values import Array, Value

_MAX_CONCAVITY = 1e-4  # of the diameter: bodies that are off their hulls by less are convex
_MAX_BODIES, _MAX_PLANES, _MIN_PLANES = 200, 240, 8  # planes of one body
_PLANES_OF_ALL = 1200  # of all bodies, beyond which each has few
_MAX_CUTS = 600  # planes that are held against the reflex edges
_MIN_RISE = 1e-7  # of the diameter, by which faces rise above each other at a reflex edge
_IN_PLANE = 1e-7  # of the diameter: an edge so near to a plane lies in it
_NORMAL_DECIMALS = 9  # decimals of normals by which planes of a hull are one
_PLANE_DECIMALS = 6  # decimals of normals, and of offsets over the diameter, by which planes are one
_MIN_THICKNESS = 1e-6  # of the diameter: what is thinner is a skin that rounding leaves
_MIN_SINE = 1e-3  # sine of the angle between edges that span a plane
_PLANES_AT_ONCE = 8  # planes that are added to a body before it is measured again
_MAX_EXCESS = 2e-3  # of the diameter: by so much planes of a hull may be exceeded for there to be few
_MIN_EXCESS = 2e-7  # of the diameter: planes of a hull that are exceeded by less count once
_WIDENINGS = 1e-7, 2e-7, 5e-7  # of the diameter: by how much bodies are wider where they are united
_CUT_GAP = 1e-8  # of the diameter: how far beside a plane it is cut, twice `_IN_PLANE` where points are off
_SPREAD = 1e-2  # of the diameter: corners that fix a plane
_NOISY = 8.0  # times as far as points are off, at least
_FLATNESS = 1e-8  # of the diameter of a body: corners so near to a face are on it
_CHUNK_PLANES = 256  # planes that points are measured from at once


@dataclass(frozen=True, eq=False)
class Enclosure(Value, where=(3,), labels={"where": "place"}):
    """Convex bodies that enclose a solid, the boundary of all, by how much it stands out at most, m, and where (3,)."""

    bodies: tuple[Polyhedron, ...]
    boundary: Polyhedron
    off: float
    where: Array


def enclosing(points: Array, triangles: Indices, noise: float = 0.0) -> Enclosure:
    """Enclose the solid of a closed surface in convex bodies.

    Triangles (m, 3) are counter-clockwise seen from outside; points (n, 3), m, may be off by as much as the noise, m.

    Raises:
        GeometryError: the surface does not close, or what it bounds is too thin.
    """
    whole = solid_of(points, triangles)
    size = float(np.linalg.norm(np.ptp(points, axis=0)))
    number, done, gap = count(), list[_Body](), max((2.0 * _IN_PLANE if noise else _CUT_GAP) * size, _NOISY * noise)
    queue = [(-body.off, next(number), body) for body in (_Body(one, size, gap) for one in whole.decompose())]
    heapify(queue)
    while queue and len(queue) + len(done) < _MAX_BODIES:
        heed()
        _, _, body = heappop(queue)
        halves = body.halves() if body.off > _MAX_CONCAVITY * size else []
        if len(halves) < 2:
            done.append(body)
            continue
        for half in halves:
            heappush(queue, (-half.off, next(number), half))
    done += [body for *_, body in sorted(queue)]
    few = min(_PLANES_OF_ALL // len(done), _MAX_PLANES)
    while True:
        try:
            return _enclosure(done, points, max(few, _MIN_PLANES))
        except GeometryError:  # of more faces than are taken
            if few <= _MIN_PLANES:
                raise
            few //= 2


def solid_of(points: Array, triangles: Indices) -> Manifold:
    """The solid of a closed surface of triangles (m, 3) over points (n, 3), m.

    Raises:
        GeometryError: the surface does not close, or what it bounds is too thin.
    """
    whole, size = manifold_of(points, triangles), float(np.linalg.norm(np.ptp(points, axis=0)))
    if whole.is_empty() or 2.0 * whole.volume() <= _MIN_THICKNESS * size * whole.surface_area():
        raise GeometryError("the surface bounds no solid")
    return whole


def _enclosure(done: Sequence[_Body], known: Array, few: int) -> Enclosure:
    """Bodies with at most so many faces each; coordinates that differ from known ones (n, 3) by rounding are those."""
    from scipy.spatial import QhullError

    size = done[0].size
    try:
        bounds = [_bounds(body, few) for body in done]
    except QhullError as error:
        raise GeometryError("what it is cut into is too thin") from error
    spots = [(one.off, one.where) for one in done] + [(one.off, one.where) for one in bounds]
    off, where = max(spots, key=lambda spot: spot[0])
    boundary = _boundary(bounds, size)
    require_few(len(boundary.faces))
    hulls = [Manifold.hull_points(snapped(one.corners(size), known)) for one in bounds]
    bodies = tuple(of_manifold(hull.simplify(_FLATNESS * size), _FLATNESS * size) for hull in hulls)
    return Enclosure(bodies, boundary, off, where)


class _Body:
    """A solid with its hull."""

    def __init__(self, shape: Manifold, size: float, gap: float) -> None:
        """Take the surface of a shape cut from a solid of this diameter, m, to be cut by a gap, m, beside planes."""
        self.shape, self.size, self.gap = shape, size, gap
        self.points, self.triangles = mesh_of(shape)
        corners = self.points[self.triangles]
        normals = normals_of(corners)
        self.areas = np.linalg.norm(normals, axis=1)
        self.normals = normals / np.maximum(self.areas, np.finfo(np.float64).tiny)[:, None]
        self.offsets = np.einsum("ij,ij->i", self.normals, corners[:, 0])
        ends, sides = mesh_of(shape.hull())
        self.planes = _hull_planes(ends, sides, size)
        # Corners and triangles of the hull itself lie in it, which most do of a round part.
        number = {end: k for k, end in enumerate(map(bytes, ends))}
        own = np.array([number.get(point, -1) for point in map(bytes, self.points)])
        outer = {*map(bytes, np.sort(sides))}
        below = np.array([side not in outer for side in map(bytes, np.sort(own[self.triangles]))])
        below &= self.areas > 1e-9 * self.areas.max()
        centres = ((corners[:, 0] + corners[:, 1] + corners[:, 2]) / 3.0)[below]
        self.below = np.zeros(len(self.points))
        self.below[own < 0] = _depth(self.planes, self.points[own < 0])
        depth = np.concatenate([self.below, _depth(self.planes, centres)])
        self.off, self.where = float(depth.max()), np.vstack([self.points, centres])[depth.argmax()]

    def _reflex(self) -> tuple[Indices, NDArray[np.intp]]:
        """Ends (k, 2) of the reflex edges below the hull, and the triangles (k, 2) at each."""
        corners, wide = self.triangles, len(self.points)
        start, end, ahead = corners.ravel(), np.roll(corners, -1, axis=1).ravel(), np.roll(corners, -2, axis=1).ravel()
        order = np.argsort(start * wide + end)
        keys = (start * wide + end)[order]
        back = np.minimum(np.searchsorted(keys, end * wide + start), len(keys) - 1)
        one = np.flatnonzero((keys[back] == end * wide + start) & (start < end))
        other = order[back[one]]
        sides = np.column_stack([one // 3, other // 3])
        rise = [
            np.einsum("ij,ij->i", self.normals[own], self.points[ahead[across]]) - self.offsets[own]
            for own, across in zip(sides.T, (other, one), strict=True)
        ]
        reflex = (np.maximum(*rise) > _MIN_RISE * self.size) & (self.areas[sides] > 0.0).all(axis=1)
        return np.column_stack([start[one], end[one]])[reflex], sides[reflex]

    def _cut(self) -> tuple[Array, float] | None:
        """The plane that holds most reflex edges, each by its length, depth and angle.

        Candidates are the planes of the faces at reflex edges, and those through two of them that share a corner.
        """
        edges, sides = self._reflex()
        depth = np.maximum(
            _depth(self.planes, self.points[edges].mean(axis=1)), self.below[edges].max(axis=1, initial=0.0)
        )
        deep = depth > 0.5 * _MAX_CONCAVITY * self.size
        edges, sides, depth = edges[deep], sides[deep], depth[deep]
        if not len(edges):
            return None
        along = self.points[edges[:, 1]] - self.points[edges[:, 0]]
        lengths = np.linalg.norm(along, axis=1)
        cosine = np.einsum("ij,ij->i", self.normals[sides[:, 0]], self.normals[sides[:, 1]])
        weights = lengths * depth * np.sqrt(np.maximum(1.0 - cosine, 0.0))
        normals, offsets = [self.normals[sides.T].reshape(-1, 3)], [self.offsets[sides.T].ravel()]
        heavy = [np.tile(weights, 2)]
        corner, own = edges.T.ravel(), np.tile(np.arange(len(edges)), 2)
        order = np.argsort(corner, kind="stable")
        corner, own = corner[order], own[order]
        for lag in (1, 2, 3):
            at = np.flatnonzero(corner[lag:] == corner[:-lag])
            one, other = own[at], own[at + lag]
            across = np.cross(along[one], along[other]) / (lengths[one] * lengths[other])[:, None]
            sine = np.linalg.norm(across, axis=1)
            wide = sine > _MIN_SINE
            across = across[wide] / sine[wide, None]
            normals.append(across)
            offsets.append(np.einsum("ij,ij->i", across, self.points[corner[at][wide]]))
            heavy.append((weights[one] + weights[other])[wide])
        planes = np.column_stack([np.vstack(normals), np.concatenate(offsets) / self.size])
        first = np.sort(np.unique(np.round(planes, _PLANE_DECIMALS), axis=0, return_index=True)[1])
        first = np.sort(first[np.argsort(-np.concatenate(heavy)[first], kind="stable")[:_MAX_CUTS]])
        normal, offset = planes[first, :3], self.size * planes[first, 3]
        away = np.abs(self.points[edges.ravel()] @ normal.T - offset).reshape(len(edges), 2, -1).max(axis=1)
        held = away <= _IN_PLANE * self.size
        score = (held * weights[:, None]).sum(axis=0)
        best = int(np.argmax(np.round(score / score.max(), 9)))
        if self.gap > _CUT_GAP * self.size:  # planes of narrow facets are off by much elsewhere
            corners = self.points[np.unique(edges[held[:, best]])]
            middle = corners.mean(axis=0)
            wide, across = np.linalg.svd(corners - middle)[1:]
            if wide[1] > _SPREAD * self.size:
                return across[2], float(across[2] @ middle)
        return normal[best], float(offset[best])

    def halves(self) -> list[_Body]:
        """The bodies on both sides of the best cut; none where there is no cut."""
        if (plane := self._cut()) is None:
            return []
        parts = [part for side in (1.0, -1.0) for part in self._half(*plane, side).decompose()]
        thick = [part for part in parts if 2.0 * part.volume() > _MIN_THICKNESS * self.size * part.surface_area()]
        # Slivers along a cut hide the reflex edges that end there.
        return [_Body(part.simplify(_IN_PLANE * self.size), self.size, self.gap) for part in thick]

    def _half(self, normal: Array, offset: float, side: float) -> Manifold:
        """What is not on a side of a plane.

        It is cut a little off the plane, and put back onto it: no skin is left of faces that lie in the plane.
        """
        room = _room(self.points, normal, offset - side * self.gap, side, 2.0 * self.size)
        points, triangles = mesh_of(self.shape - room)
        away = points @ normal - offset
        points -= np.where(np.abs(away) <= 2.0 * self.gap, away, 0.0)[:, None] * normal
        return manifold_of(points, triangles)


def _hull_planes(points: Array, triangles: Indices, size: float) -> Array:
    """Planes (k, 4) of a convex hull's triangles, but slivers: outward normals, and minus how far out, m."""
    sides = [points[triangles[:, (k + 1) % 3]] - points[triangles[:, k]] for k in range(3)]
    normals = np.cross(sides[0], sides[1])
    areas, longest = np.linalg.norm(normals, axis=1), np.max([np.linalg.norm(side, axis=1) for side in sides], axis=0)
    normals = normals[areas > _MIN_EXCESS * size * longest] / areas[areas > _MIN_EXCESS * size * longest, None]
    normals = normals[np.sort(np.unique(np.round(normals, _NORMAL_DECIMALS), axis=0, return_index=True)[1])]
    far = np.concatenate(
        [(points @ some.T).max(axis=0) for some in np.array_split(normals, len(normals) // _CHUNK_PLANES + 1)]
    )
    return np.column_stack([normals, -far])


def _depth(planes: Array, points: Array) -> Array:
    """How far points (n, 3) lie below the nearest of some planes (k, 4), m, 0 above."""
    least = np.full(len(points), np.inf)
    for first in range(0, len(planes), _CHUNK_PLANES):
        some = planes[first : first + _CHUNK_PLANES]
        least = np.minimum(least, -(points @ some[:, :3].T + some[:, 3]).max(axis=1, initial=-np.inf))
    return np.asarray(np.maximum(least, 0.0))


def _room(points: Array, normal: Array, offset: float, side: float, reach: float) -> Manifold:
    """A box around points on one side of a plane, in which one of its faces lies."""
    middle = points.mean(axis=0)
    middle = middle - (normal @ middle - offset) * normal
    axes = np.vstack([plane_basis(normal).T, side * normal])
    corners = np.array(list(product((-1.0, 1.0), (-1.0, 1.0), (0.0, 1.0))))
    return Manifold.hull_points(middle + reach * corners @ axes)


@dataclass(frozen=True, eq=False)
class _Bounds:
    """Half-spaces (k, 4) that hold a body, a point inside (3,), how far they exceed its hull at most, m, and where."""

    planes: Array
    inside: Array
    off: float
    where: Array

    def corners(self, size: float, out: float = 0.0) -> Array:
        """The corners (n, 3) of what the planes bound, m, each of them a distance farther out."""
        return halfspace_corners(self.planes[:, :3], out - self.planes[:, 3], self.inside, size)


def _bounds(body: _Body, few: int) -> _Bounds:
    """Few half-spaces of a body's hull: those that the others exceed the most, added one after the other."""
    middle, size = body.points.mean(axis=0), body.size
    # About the middle and in sizes, so that what is equal but for rounding counts as equal.
    planes = np.column_stack([body.planes[:, :3], (body.planes[:, 3] + body.planes[:, :3] @ middle) / size])
    box = np.column_stack([np.vstack([np.eye(3), -np.eye(3)]), np.full(6, -2.0)])
    chosen = list[int]()
    while True:
        taken = np.vstack([box, planes[chosen]])
        corners = halfspace_corners(taken[:, :3], -taken[:, 3], np.zeros(3), 1.0)
        beyond = corners @ planes[:, :3].T + planes[:, 3]
        order = np.argsort(-np.round(beyond.max(axis=0), 12), kind="stable")
        most, seen = float(beyond[:, order[0]].max()), set[int]()
        if most <= _MIN_EXCESS or len(chosen) >= _MAX_PLANES or (len(chosen) >= few and most <= _MAX_EXCESS):
            where = middle + size * corners[beyond[:, order[0]].argmax()]
            return _Bounds(body.planes[chosen], middle, size * max(most, 0.0), where)
        for plane in order[: 8 * _PLANES_AT_ONCE].tolist():
            at = int(beyond[:, plane].argmax())
            if beyond[at, plane] > 0.5 * most and at not in seen and len(chosen) < _MAX_PLANES:
                seen.add(at)
                chosen.append(plane)


def _boundary(bounds: Sequence[_Bounds], size: float) -> Polyhedron:
    """The boundary of the union of bodies.

    They are united a little larger than they are, so that no skin is left where they touch, and corners are put back.
    """
    for skin in (times * size for times in _WIDENINGS):
        wider = [Manifold.hull_points(one.corners(size, skin)) for one in bounds]
        try:
            body = of_manifold(Manifold.batch_boolean(wider, OpType.Add).simplify(skin), 2.0 * skin)
            break
        except GeometryError:  # of slivers where several of them meet, which differ with the distance
            if skin == _WIDENINGS[-1] * size:
                raise
    points = np.array(body.vertices)
    for number, faces in enumerate(body.vertex_faces):
        normals = body.normals[list(faces)]
        points[number] += np.linalg.pinv(normals, rcond=1e-3) @ (
            body.offsets[list(faces)] - skin - normals @ points[number]
        )
    return with_vertices(body, points)
