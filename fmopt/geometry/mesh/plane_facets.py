"""Facets that were meant to be plane, made plane: planes are fitted to them, corners are where these planes meet.

Numbers of a file are rounded, and tessellation leaves corners off the planes that they stand for. Neighbouring facets
are joined, those first that lie closest to one plane, up to the widest gap in how far they lie off it: below are
facets of one face, above faces that are meant to be two. Normals that are parallel, square to each other, or apart by
whole parts of a turn, but for what the fit leaves open, are so exactly afterwards.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from heapq import heapify, heappop, heappush

import numpy as np
import shapely

from fmopt.errors import GeometryError
from fmopt.geometry.facets import MAX_FACES, Indices, Loop, Patchwork, faces_of, patchwork, require_few
from fmopt.geometry.mesh.fitted_planes import EXACT, Fits, aligned, corners_of
from fmopt.geometry.mesh.open_edges import MOST_OFF
from fmopt.geometry.mesh.round_planes import evenly_out, is_even, through_columns
from fmopt.geometry.polyhedron import Polyhedron, from_faces, plane_basis
from fmopt.spatial.values import Array, Value

_SHARE = 2.5e-3  # of the diameter: the same for small parts
_NOISE = 2e-6  # of the diameter: facets this close to one plane are one face, whatever the gap
_TURN = (12.0, 3.0)  # times how far facets are off their planes: what a normal may be turned by, over its width
_GAP = 1.25  # the least ratio of two neighbouring distances that tells facets of one face from faces
_APART = 0.4  # of the least angle to a face beside it: by how much a normal may be turned at most
_SMALL = 0.38  # rad: faces that meet at less stand for a curved surface, of more than 16 to a turn
_TRIES = 8  # gaps that are looked at, the widest first
_STEP = 1e-9  # m: what planes lie apart by is a multiple of this
_TINY = 1e-300  # m², in place of the square of no length


@dataclass(frozen=True, eq=False)
class Flattened(Value, where=(3,), labels={"where": "place"}):
    """A surface of plane faces, how far the facets that it stands for lie off at most, m, and where (3,), m."""

    body: Polyhedron
    off: float
    where: Array


def flattened(points: Array, triangles: Indices, numbers: Indices, noise: float = 0.0) -> Flattened:
    """The polyhedron of a closed mesh whose facets are plane but for noise.

    A mesh whose facets are plane to 1e-12 m is kept to the bit, but where noise may have turned its faces.

    Args:
        points: (n, 3), m.
        triangles: (m, 3), counter-clockwise seen from outside.
        numbers: what to call each triangle (m,) in an error.
        noise: how far the points are known to be off, m.

    Raises:
        GeometryError: the mesh is open or its triangles disagree about orientation, naming a triangle and an edge; or
            its faces do not meet in corners near those of the file, naming the place.
    """
    span = float(np.linalg.norm(np.ptp(points, axis=0)))
    parts = patchwork(points, triangles, 0.5 * _NOISE * span, numbers)
    order = _joined(parts, min(MOST_OFF, _SHARE * span))
    faults: list[GeometryError] = []
    for count in _gaps([cost for cost, _, _ in order], _NOISE * span):
        try:
            return _made_plane(parts, _labels(parts, order[:count]), noise)
        except GeometryError as error:
            faults.append(error)
    # Of the widest gap, which most likely is what was meant.
    raise faults[0]


def _joined(parts: Patchwork, most: float) -> list[tuple[float, int, int]]:
    """Pairs of regions in the order in which they are joined, with how far the two together lie off one plane, m.

    That is twice the root of the mean square of their corners' distances from the plane that fits best. The last entry
    is the first pair that lies off by more than `most`: it stays apart.
    """
    heap_ = _Heap(parts, most)
    made: list[tuple[float, int, int]] = []
    while (pair := heap_.nearest()) is not None:
        made.append(pair)
        if pair[0] > most:
            break
        heap_.join(pair[1], pair[2])
    return made


class _Heap:
    """Regions and how far pairs of neighbours lie off one plane, kept by the sums of their corners and of products."""

    def __init__(self, parts: Patchwork, most: float) -> None:
        # About the middle: spreads are differences of squares, which would cancel far from it.
        corners = parts.vertices[parts.triangles] - parts.vertices.mean(axis=0)
        count = len(parts.members)
        self.size, self.sums, self.products, self.areas = (np.zeros((count, *n)) for n in ((), (3,), (3, 3), (3,)))
        np.add.at(self.size, parts.region, 3.0)
        np.add.at(self.sums, parts.region, corners.sum(axis=1))
        np.add.at(self.products, parts.region, np.einsum("nki,nkj->nij", corners, corners))
        np.add.at(self.areas, parts.region, parts.areas)
        self.most, self.around = most, parts.neighbours
        self.age = [0] * count
        pairs = np.array([(a, b) for a, row in enumerate(self.around) for b in sorted(row) if a < b], dtype=np.int64)
        pairs = pairs.reshape(-1, 2)
        costs = self._costs(pairs[:, 0], pairs[:, 1])
        self.heap = [(cost, a, b, 0, 0) for cost, (a, b) in zip(costs.tolist(), pairs.tolist(), strict=True)]
        heapify(self.heap)

    def nearest(self) -> tuple[float, int, int] | None:
        """The pair closest to one plane."""
        while self.heap:
            cost, a, b, age_a, age_b = heappop(self.heap)
            # Entries of regions that have changed since stay in the heap; their ages no longer agree.
            if (self.age[a], self.age[b]) == (age_a, age_b):
                return cost, a, b
        return None

    def join(self, a: int, b: int) -> None:
        """Makes the second region part of the first."""
        for sums in (self.size, self.sums, self.products, self.areas):
            sums[a] += sums[b]
        self.around[a] = (self.around[a] | self.around[b]) - {a, b}
        self.age[a], self.age[b] = self.age[a] + 1, -1
        near = sorted(self.around[a])
        for c in near:
            self.around[c].discard(b)
            self.around[c].add(a)
        costs = self._costs(np.full(len(near), a), np.array(near, dtype=np.int64)) if near else np.zeros(0)
        for cost, c in zip(costs.tolist(), near, strict=True):
            low, high = min(a, c), max(a, c)
            heappush(self.heap, (cost, low, high, self.age[low], self.age[high]))

    def _costs(self, one: Indices, other: Indices) -> Array:
        """How far pairs of regions (k,) lie off one plane, m; infinite where they look different ways."""
        size = self.size[one] + self.size[other]
        middle = (self.sums[one] + self.sums[other]) / size[:, None]
        spread = (self.products[one] + self.products[other]) / size[:, None, None] - middle[:, :, None] * middle[
            :, None
        ]
        off = 2.0 * np.sqrt(np.maximum(np.linalg.eigvalsh(spread)[:, 0], 0.0))
        # What looks opposite ways are two faces of a wall, unless one is so thin that its normal says nothing.
        opposed = np.einsum("ij,ij->i", self.areas[one], self.areas[other]) <= 0.0
        thin = np.minimum(self._thickness(one), self._thickness(other)) <= self.most
        return np.where(opposed & ~thin, np.inf, off)

    def _thickness(self, which: Indices) -> Array:
        """About how wide regions are where they are narrow (k,), m."""
        middle = self.sums[which] / self.size[which, None]
        spread = np.trace(self.products[which], axis1=1, axis2=2) / self.size[which] - np.sum(middle**2, axis=1)
        return np.asarray(np.linalg.norm(self.areas[which], axis=1) / np.sqrt(np.maximum(spread, 1e-24)))


def _gaps(costs: Sequence[float], floor: float) -> Iterator[int]:
    """How many pairs to join, the widest gap between what is joined and what is not first."""
    running = np.maximum.accumulate(np.maximum(costs, floor)) if costs else np.zeros(0)
    ratios = running / np.concatenate([[floor], running[:-1]])
    wide = [int(k) for k in np.flatnonzero(ratios >= _GAP)]
    wide = sorted(wide, key=lambda k: (-ratios[k], k))[:_TRIES]
    last = len(costs) - 1 if costs and (not math.isfinite(costs[-1]) or costs[-1] > floor) else len(costs)
    yield from dict.fromkeys([*wide, max(last, 0)])


def _labels(parts: Patchwork, pairs: Sequence[tuple[float, int, int]]) -> Indices:
    """The face of each triangle (m,) once pairs of regions are joined."""
    into = np.arange(int(parts.region.max()) + 1)
    for _, a, b in pairs:
        into[into == b] = a
    return into[parts.region]


def _made_plane(parts: Patchwork, region: Indices, noise: float) -> Flattened:
    """The surface of regions, each of which is one face.

    Normals are made to belong together as far as the noise may have turned them. Of few corners nothing much follows
    about the noise: more is tried first, and kept where it takes the surface no farther off.
    """
    require_few(len(np.unique(region)), 2 * MAX_FACES)  # more of them are rather taken as the facets that they are
    faces, region = faces_of(parts, region)
    parts = replace(parts, region=np.unique(region, return_inverse=True)[1].astype(np.int64))
    corners = [np.unique(parts.triangles[which]) for which in parts.members]
    fits = Fits.of(parts.vertices, corners)
    surface, off = _Surface(parts, faces, corners, fits), fits.off
    if off <= EXACT:  # rounding turns side faces of a prism, which stay plane
        kept = Flattened(from_faces(parts.vertices, faces), 0.0, parts.vertices[0])
        straight = _attempt(surface, noise, _TURN[0]) if noise > 0.0 else kept
        return straight if isinstance(straight, Flattened) and EXACT < straight.off <= 4.0 * noise else kept
    off = max(off + noise, 0.1 * _NOISE * float(np.linalg.norm(np.ptp(parts.vertices, axis=0))))
    far = _attempt(surface, off, _TURN[0])
    if isinstance(far, Flattened) and far.off <= 4.0 * off:
        return far
    near = _attempt(surface, off, _TURN[1])
    if isinstance(near, Flattened):
        return near if isinstance(far, GeometryError) or far.off > 2.0 * near.off else far
    if isinstance(far, GeometryError):
        raise near
    return far


@dataclass(frozen=True)
class _Surface:
    """Facets with the faces that they are to become, by region: loops, vertices and plane of each."""

    parts: Patchwork
    faces: Sequence[Sequence[Loop]]
    corners: Sequence[Indices]
    fits: Fits

    def turns(self, normals: Array) -> Array:
        """The least angle (k,) between the normal of each face and those of the faces beside it, rad."""
        own = self.parts.region
        one, other = np.repeat(own, 3), own[np.array(self.parts.across)[:, :, 0]].ravel()
        between = np.linalg.norm(np.cross(normals[one], normals[other]), axis=1)
        angle = np.arctan2(between, np.einsum("ij,ij->i", normals[one], normals[other]))
        least = np.full(len(normals), np.pi)
        np.minimum.at(least, one[one != other], angle[one != other])
        return least


def _attempt(surface: _Surface, off: float, times: float) -> Flattened | GeometryError:
    """The surface where normals may be turned by so many times what the noise does, or why there is none."""
    parts = surface.parts
    areas = np.array([parts.areas[which].sum(axis=0) for which in parts.members])
    normals = np.where(np.vecdot(surface.fits.normals, areas) > 0.0, 1.0, -1.0)[:, None] * surface.fits.normals
    slack = times * off / np.maximum(surface.fits.widths, off)
    turns = surface.turns(normals)
    wide = np.minimum(slack, _APART * turns)
    turn, straight = aligned(
        normals, np.linalg.norm(areas, axis=1), np.minimum(wide, slack * np.minimum(turns, 1.0)), wide
    )
    points = parts.vertices @ turn
    heights = [points[which] @ n for which, n in zip(surface.corners, straight, strict=True)]
    offsets = np.array([0.5 * (height.min() + height.max()) for height in heights])
    offsets = evenly_out(straight, np.round(offsets / _STEP) * _STEP, 2.0 * off)
    fine = (straight[:, 2] == 0.0) & (turns < _SMALL)
    if fine.any() and not is_even(straight[fine]):
        straight, offsets = through_columns(points, surface.faces, (straight, offsets), fine)
    try:
        moved = corners_of(points, surface.faces, (straight, offsets), off, turn)
        moved = moved if np.array_equal(turn, np.eye(3)) else moved @ turn.T
        return Flattened(from_faces(moved, surface.faces), *_apart(surface, moved))
    except GeometryError as error:
        return error


def _apart(surface: _Surface, moved: Array) -> tuple[float, Array]:
    """How far facets and faces are apart at most, m, and where: facets from their face, corners from their facets."""
    parts = surface.parts
    outlines = [[vertex for loop in loops for vertex in loop] for loops in surface.faces]
    fits = Fits.of(moved, outlines)
    bases = np.array([plane_basis(normal) for normal in fits.normals])
    face = np.repeat(np.arange(len(outlines)), [len(outline) for outline in outlines])
    lengths = [len(loop) for loops in surface.faces for loop in loops]
    flat = np.einsum("ni,nij->nj", moved[np.concatenate(outlines)], bases[face])
    rings = shapely.linearrings(flat, indices=np.repeat(np.arange(len(lengths)), lengths))
    plates = shapely.polygons(
        rings, indices=np.repeat(np.arange(len(outlines)), [len(loops) for loops in surface.faces])
    )
    own = np.repeat(np.arange(len(outlines)), [len(corners) for corners in surface.corners])
    corners = parts.vertices[np.concatenate(surface.corners)]
    beside = shapely.distance(plates[own], shapely.points(np.einsum("ni,nij->nj", corners, bases[own])))
    apart = np.hypot(beside, np.vecdot(corners, fits.normals[own]) - fits.offsets[own])
    most, where = float(apart.max()), corners[int(apart.argmax())]
    numbers, slots = np.nonzero(np.isin(parts.triangles, np.unique(np.concatenate(outlines))))
    around = parts.triangles[numbers, slots]
    near = np.full(len(moved), np.inf)
    np.minimum.at(near, around, _from_triangles(moved[around], parts.vertices[parts.triangles[numbers]]))
    farthest = int(np.argmax(np.where(np.isfinite(near), near, 0.0)))
    return max((most, where), (float(near[farthest]), moved[farthest]), key=lambda one: one[0])


def _from_triangles(p: Array, corners: Array) -> Array:
    """Distances (n,) of points (n, 3), each from its own triangle (n, 3, 3), m."""
    along, to_p = np.roll(corners, -1, axis=1) - corners, p[:, None] - corners
    normal = np.cross(along[:, 0], along[:, 1])
    size = np.linalg.norm(normal, axis=1)
    inside = (size > 0.0) & np.all(np.vecdot(np.cross(along, to_p), normal[:, None]) >= 0.0, axis=1)
    share = np.clip(np.vecdot(to_p, along) / np.maximum(np.vecdot(along, along), _TINY), 0.0, 1.0)
    beside = np.linalg.norm(to_p - share[..., None] * along, axis=2).min(axis=1)
    return np.asarray(np.where(inside, np.abs(np.vecdot(to_p[:, 0], normal)) / np.maximum(size, _TINY), beside))
