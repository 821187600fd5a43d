"""Facets that were meant to be plane, made plane: planes are fitted to them, corners are where these planes meet.

Numbers of a file are rounded, and tessellation leaves corners off the planes that they stand for. Neighbouring facets
are joined, those first that lie closest to one plane, up to the widest gap in how far they lie off it: below are
facets of one face, above faces that are meant to be two. Normals that are parallel, square to each other, or apart by
whole parts of a turn, but for what the fit leaves open, are so exactly afterwards.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from heapq import heapify, heappop, heappush

import numpy as np

from fmopt.errors import GeometryError
from fmopt.geometry.facets import Indices, Loop, Patchwork, faces_of, patchwork, place
from fmopt.geometry.mesh_repair import MOST_OFF
from fmopt.geometry.polyhedron import Polyhedron, from_faces, plane_basis
from fmopt.values import Array, Value, frozen

_SHARE = 2.5e-3  # of the diameter: the same for small parts
_NOISE = 2e-6  # of the diameter: facets this close to one plane are one face, whatever the gap
_EXACT = 1e-12  # m: what is this close to a plane lies in it
_TURN = 3.0  # times how far facets are off their planes: what a normal may be turned by, over the width of its face
_GAP = 1.25  # the least ratio of two neighbouring distances that tells facets of one face from faces
_TRIES = 8  # gaps that are looked at, the widest first
_LEAST_LEAN = 1e-3  # of planes that are to fix a corner
_STRAY = 100.0  # times how far facets are off their planes: corners may move so far along an edge
_ROUNDS = 20  # of Newton's method
_TURNS = (
    4,
    24,
    5,
    7,
    9,
    11,
    16,
    18,
    22,
    32,
    36,
)  # into how many parts a turn is divided by normals that belong together

Planes = tuple[Array, Array]


@dataclass(frozen=True, eq=False)
class Flattened(Value):
    """A surface of plane faces beside the facets that it stands for.

    Args:
        body: the surface, m.
        off: how far apart it and the facets are at most, m.
        where: the place (3,) of that, m.
    """

    body: Polyhedron
    off: float
    where: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "where", frozen(self.where, 3, name="place"))


def flattened(points: Array, triangles: Indices, numbers: Indices, noise: float = 0.0) -> Flattened:
    """The polyhedron of a closed mesh whose facets are plane but for noise.

    A mesh whose facets are plane to 1e-12 m is kept to the bit.

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
    parts = patchwork(points, triangles, 0.5 * _NOISE * span, numbers, len(triangles))
    order = _joined(parts, min(MOST_OFF, _SHARE * span))
    fault: GeometryError | None = None
    for count in _gaps([cost for cost, _, _ in order], _NOISE * span):
        try:
            return _made_plane(parts, _labels(parts, order[:count]), noise)
        except GeometryError as error:
            fault = fault or error
    raise fault if fault is not None else GeometryError("the mesh has no plane faces", "export it again")


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
        corners = parts.vertices[parts.triangles] - parts.vertices.mean(axis=0)
        count = len(parts.members)
        self.size, self.sums, self.products, self.areas = (
            np.zeros(count),
            np.zeros((count, 3)),
            np.zeros((count, 3, 3)),
            np.zeros((count, 3)),
        )
        np.add.at(self.size, parts.region, 3.0)
        np.add.at(self.sums, parts.region, corners.sum(axis=1))
        np.add.at(self.products, parts.region, np.einsum("nki,nkj->nij", corners, corners))
        np.add.at(self.areas, parts.region, parts.areas)
        self.most, self.around = most, parts.neighbours
        self.age = [0] * count
        pairs = np.array([(a, b) for a, row in enumerate(self.around) for b in sorted(row) if a < b], dtype=np.int64)
        costs = self._costs(pairs[:, 0], pairs[:, 1])
        self.heap = [(cost, a, b, 0, 0) for cost, (a, b) in zip(costs.tolist(), pairs.tolist(), strict=True)]
        heapify(self.heap)

    def nearest(self) -> tuple[float, int, int] | None:
        """The pair closest to one plane."""
        while self.heap:
            cost, a, b, age_a, age_b = heappop(self.heap)
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
        opposed = np.einsum("ij,ij->i", self.areas[one], self.areas[other]) <= 0.0
        thin = np.minimum(self._thickness(one), self._thickness(other)) <= self.most
        return np.where(opposed & ~thin, np.inf, off)

    def _thickness(self, which: Indices) -> Array:
        """About how wide regions are where they are narrow (k,), m."""
        middle = self.sums[which] / self.size[which, None]
        spread = np.trace(self.products[which], axis1=1, axis2=2) / self.size[which] - np.sum(middle**2, axis=1)
        return np.linalg.norm(self.areas[which], axis=1) / np.sqrt(np.maximum(spread, 1e-24))


def _off_plane(points: Array) -> float:
    """How far points (n, 3) are off the plane that fits them best, m, at most."""
    normal, offset = _fit(points)
    return float(np.abs(points @ normal - offset).max())


def _fit(points: Array) -> tuple[Array, float]:
    """The plane that fits points (n, 3) best, with the least largest distance for its normal."""
    centre = points.mean(axis=0)
    arms = points - centre
    normal = np.linalg.eigh(arms.T @ arms)[1][:, 0]
    heights = arms @ normal
    return normal, float(normal @ centre + 0.5 * (heights.min() + heights.max()))


def _gaps(costs: Sequence[float], floor: float) -> Iterator[int]:
    """How many pairs to join, the widest gap between what is joined and what is not first."""
    running = np.maximum.accumulate(np.maximum(costs, floor)) if costs else np.zeros(0)
    low = np.concatenate([[floor], running[:-1]])
    ratios = running / low
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
    names, region = np.unique(region, return_inverse=True)
    faces = faces_of(parts, region)
    members = [np.flatnonzero(region == k) for k in range(len(names))]
    corners = [np.unique(parts.triangles[which]) for which in members]
    off = max(_off_plane(parts.vertices[which]) for which in corners)
    if off <= _EXACT:
        return Flattened(from_faces(parts.vertices, faces), 0.0, parts.vertices[0])
    areas = np.array([parts.areas[which].sum(axis=0) for which in members])
    off = max(off + noise, 0.1 * _NOISE * float(np.linalg.norm(np.ptp(parts.vertices, axis=0))))
    normals, slack = [], []
    for which, area in zip(corners, areas, strict=True):
        normal = _fit(parts.vertices[which])[0]
        normals.append(normal if normal @ area > 0.0 else -normal)
        slack.append(_TURN * off / max(_width(parts.vertices[which], normal), off))
    turn, normals_ = _aligned(np.array(normals), np.linalg.norm(areas, axis=1), np.array(slack))
    points = parts.vertices @ turn
    offsets = np.array([_middle(points[which] @ n) for which, n in zip(corners, normals_, strict=True)])
    moved = _corners(points, faces, (normals_, offsets), off)
    body = from_faces(moved @ turn.T if not np.array_equal(turn, np.eye(3)) else moved, faces)
    apart, where = _apart(parts, members, faces, moved @ turn.T)
    return Flattened(body, apart, where)


def _middle(heights: Array) -> float:
    return 0.5 * float(heights.min() + heights.max())


def _width(points: Array, normal: Array) -> float:
    """The least extent of points (n, 3) of a plane, m."""
    flat = (points - points.mean(axis=0)) @ plane_basis(normal)
    axes = np.linalg.eigh(flat.T @ flat)[1]
    return float(np.ptp(flat @ axes, axis=0).min())


def _aligned(normals: Array, areas: Array, slack: Array) -> tuple[Array, Array]:
    """A frame (3, 3) along the faces, and the normals (k, 3) in it, exactly along, square, or at equal turns.

    Args:
        normals: (k, 3).
        areas: of the faces (k,), m².
        slack: by how much each normal may be turned (k,), rad.
    """
    z = _axis(normals, areas, slack)
    parallel = np.abs(normals @ z) > np.cos(np.minimum(slack, 0.1))
    square = np.abs(normals @ z) < np.sin(np.minimum(slack, 0.1))
    sides = np.flatnonzero(square)
    first = normals[sides[np.argmax(areas[sides])]] if len(sides) else plane_basis(z)[:, 0]
    x = first - (first @ z) * z
    turn = _near_axes(np.column_stack([x / np.linalg.norm(x), np.cross(z, x / np.linalg.norm(x)), z]), slack.min())
    inside = normals @ turn
    if len(sides):
        angle = np.arctan2(inside[sides, 1], inside[sides, 0])
        base = _common_turn(angle, areas[sides], slack[sides])
        turn = turn @ _about_z(base)
        if np.abs(base) > 0.0:
            turn = _near_axes(turn, slack.min())
        inside = normals @ turn
    turns = (*_TURNS, len(sides), 2 * len(sides)) if len(sides) > 2 else _TURNS
    for k in range(len(inside)):
        if parallel[k]:
            inside[k] = (0.0, 0.0, math.copysign(1.0, inside[k, 2]))
        elif square[k]:
            inside[k] = _direction(_whole_part(math.atan2(inside[k, 1], inside[k, 0]), slack[k], turns))
        else:
            inside[k] = _leaning(inside[k], slack[k])
    return turn, inside


def _axis(normals: Array, areas: Array, slack: Array) -> Array:
    """The direction along or across which most of the faces lie."""
    large = np.argsort(-areas, kind="stable")[:12]
    choices = [normals[i] for i in large]
    crossed = [np.cross(normals[i], normals[j]) for n, i in enumerate(large[:6]) for j in large[:n]]
    choices += [axis / np.linalg.norm(axis) for axis in crossed if np.linalg.norm(axis) > 0.1]
    best, found = -1.0, choices[0]
    for axis in choices:
        lean = np.abs(normals @ axis)
        along, across = lean > np.cos(np.minimum(3.0 * slack, 0.1)), lean < np.sin(np.minimum(3.0 * slack, 0.1))
        score = float(areas[along | across].sum() + 1e-6 * areas[along].sum())
        if score > best * (1.0 + 1e-9):
            weight = areas / slack**2
            spread = np.einsum("k,ki,kj->ij", weight * across, normals, normals)
            spread += (weight * along).sum() * np.eye(3) - np.einsum("k,ki,kj->ij", weight * along, normals, normals)
            refined = np.linalg.eigh(spread)[1][:, 0]
            best, found = score, refined if refined @ axis > 0.0 else -refined
    return found


def _near_axes(turn: Array, slack: float) -> Array:
    """The frame, along the model's axes where it is so but for the slack."""
    nearest = np.round(turn)
    alike = np.abs(turn - nearest).max() <= slack and np.array_equal(np.abs(nearest).sum(axis=0), np.ones(3))
    if alike:
        return np.asarray(nearest + 0.0)
    for k in range(3):  # one axis may lie along the model's
        axis = np.round(turn[:, k])
        if np.abs(turn[:, k] - axis).max() <= slack and np.abs(axis).sum() == 1.0:
            other = turn[:, (k + 1) % 3] - (turn[:, (k + 1) % 3] @ axis) * axis
            other /= np.linalg.norm(other)
            made = np.empty((3, 3))
            made[:, k], made[:, (k + 1) % 3], made[:, (k + 2) % 3] = axis, other, np.cross(axis, other)
            return made
    return turn


def _common_turn(angle: Array, areas: Array, slack: Array) -> float:
    """By how much side faces at equal turns from the largest are turned from it on average, rad."""
    parts = np.array([_whole_part(a, s) for a, s in zip(angle, slack, strict=True)])
    known = parts != angle
    weight = areas[known] / slack[known] ** 2
    return float(np.sum(weight * (angle - parts)[known]) / weight.sum()) if known.any() else 0.0


def _whole_part(angle: float, slack: float, turns: Sequence[int] = _TURNS) -> float:
    """The whole part of a turn nearest to an angle, within the slack; else the angle itself."""
    for parts in turns:
        step = 2.0 * math.pi / parts
        near = step * round(angle / step)
        if abs(angle - near) <= slack:
            return near
    return angle


def _direction(angle: float) -> tuple[float, float, float]:
    """The unit vector at an angle from x about z, with exact zeros and ones."""
    quarter, rest = divmod(angle + 0.25 * math.pi, 0.5 * math.pi)
    rest -= 0.25 * math.pi
    c, s = (1.0, 0.0) if abs(rest) < 1e-14 else (math.cos(rest), math.sin(rest))
    x, y = ((c, s), (-s, c), (-c, -s), (s, -c))[int(quarter) % 4]
    return x + 0.0, y + 0.0, 0.0


def _about_z(angle: float) -> Array:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def _leaning(normal: Array, slack: float) -> Array:
    """A normal that is neither along z nor across it: its turn about z and its slope where these are whole parts."""
    around = math.atan2(normal[1], normal[0])
    slope = _whole_part(math.atan2(normal[2], math.hypot(normal[0], normal[1])), slack)
    x, y, _ = _direction(_whole_part(around, slack / max(math.hypot(normal[0], normal[1]), 0.05)))
    return np.array([math.cos(slope) * x, math.cos(slope) * y, math.sin(slope)])


def _corners(points: Array, faces: Sequence[Sequence[Loop]], planes: Planes, off: float) -> Array:
    """The points (n, 3) with the corners of the faces moved into all of their planes.

    Where more than three planes meet, offsets give way, and normals that are neither along z nor across it.

    Raises:
        GeometryError: there is no such place near a corner; names it.
    """
    around: dict[int, list[int]] = {}
    for number, loops in enumerate(faces):
        for vertex in {vertex for loop in loops for vertex in loop}:
            around.setdefault(vertex, []).append(number)
    normals, offsets = planes
    if any(len(own) > 3 for own in around.values()):
        normals, offsets = _agreed(points, around, planes)
    moved = np.array(points)
    for vertex, own in around.items():
        rows, wanted = normals[own], offsets[own]
        lean = np.linalg.svd(rows, compute_uv=False)
        if lean[2] < _LEAST_LEAN:
            message = f"the faces at {place(points[vertex])} are {1e6 * off:.3g} µm off planes that meet there"
            raise GeometryError(message, "export the mesh with more digits")
        for _ in range(2):
            moved[vertex] += np.linalg.lstsq(rows, wanted - rows @ moved[vertex], rcond=None)[0]
        for normal, offset in zip(rows, wanted, strict=True):
            for axis in np.flatnonzero(np.abs(normal) == 1.0):
                moved[vertex, axis] = normal[axis] * offset
        missed = float(np.abs(rows @ moved[vertex] - wanted).max())
        if missed > _EXACT or np.linalg.norm(moved[vertex] - points[vertex]) > _STRAY * max(off, _EXACT):
            message = f"the faces at {place(points[vertex])} have no corner in common near it"
            raise GeometryError(message, "export the mesh with more digits")
    return moved


def _agreed(points: Array, around: dict[int, list[int]], planes: Planes) -> Planes:
    """Normals and offsets of planes (k,) that meet in corners, changed by as little as does it, by Newton's method.

    Unknown are corners, offsets, and normals that are neither along z nor across it; the step is the shortest one that
    solves the linear equations n·v = o.
    """
    from scipy.sparse import coo_array, diags_array, eye_array
    from scipy.sparse.linalg import splu

    normals, offsets = np.array(planes[0]), np.array(planes[1])
    vertices = np.array(sorted(around))
    at, face = np.array([(i, f) for i, v in enumerate(vertices.tolist()) for f in around[v]]).T
    row = np.arange(len(at))
    moved, free = points[vertices], (normals[:, 2] != 0.0) & (np.abs(normals[:, 2]) != 1.0)
    size = float(np.linalg.norm(np.ptp(moved, axis=0)))
    first = 3 * len(vertices)
    weights = np.concatenate([np.ones(first), np.full(len(offsets), 0.1), np.repeat(0.1 / size**2 * free, 3)])
    weigh = diags_array(weights)
    for _ in range(_ROUNDS):
        missed = np.einsum("ij,ij->i", normals[face], moved[at]) - offsets[face]
        if np.abs(missed).max() <= 0.1 * _EXACT:
            break
        columns = [
            *(3 * at + k for k in range(3)),
            first + face,
            *(first + len(offsets) + 3 * face + k for k in range(3)),
        ]
        values = [*normals[face].T, -np.ones(len(at)), *moved[at].T]
        slope = coo_array(
            (np.concatenate(values), (np.tile(row, 7), np.concatenate(columns))), shape=(len(at), len(weights))
        ).tocsr()
        square = (slope @ weigh @ slope.T + 1e-12 * eye_array(len(at))).tocsc()
        step = -(weigh @ (slope.T @ splu(square).solve(missed)))
        moved = moved + step[:first].reshape(-1, 3)
        offsets = offsets + step[first : first + len(offsets)]
        normals = normals + step[first + len(offsets) :].reshape(-1, 3)
        length = np.linalg.norm(normals[free], axis=1)
        normals[free] /= length[:, None]
        offsets[free] /= length
    return normals, offsets


def _apart(
    parts: Patchwork, members: Sequence[Indices], faces: Sequence[Sequence[Loop]], moved: Array
) -> tuple[float, Array]:
    """How far facets and faces are apart at most, m, and where: facets from their face, corners from their facets."""
    from shapely import Polygon, distance
    from shapely import points as dots

    most, where = 0.0, moved[0]
    for which, loops in zip(members, faces, strict=True):
        corners = np.unique(parts.triangles[which])
        normal, offset = _fit(moved[[vertex for loop in loops for vertex in loop]])
        basis = plane_basis(normal)
        outer, *holes = (moved[list(loop)] @ basis for loop in loops)
        beside = distance(Polygon(outer, holes), dots(parts.vertices[corners] @ basis))
        apart = np.hypot(beside, parts.vertices[corners] @ normal - offset)
        if apart.max() > most:
            most, where = float(apart.max()), parts.vertices[corners[int(apart.argmax())]]
    around: dict[int, list[int]] = {}
    used = {vertex for loops in faces for loop in loops for vertex in loop}
    for number, triangle in enumerate(parts.triangles.tolist()):
        for vertex in triangle:
            if vertex in used:
                around.setdefault(vertex, []).append(number)
    for vertex, own in around.items():
        near = min(_from_triangle(moved[vertex], parts.vertices[parts.triangles[k]]) for k in own)
        if near > most:
            most, where = near, moved[vertex]
    return most, where


def _from_triangle(p: Array, corners: Array) -> float:
    """Distance of a point from a triangle (3, 3), m."""
    a, b, c = corners
    normal = np.cross(b - a, c - a)
    size = float(np.linalg.norm(normal))
    ends = zip(corners, (b, c, a), strict=True)
    if size > 0.0 and all(float(np.cross(v - u, p - u) @ normal) >= 0.0 for u, v in ends):
        return abs(float((p - a) @ normal)) / size
    return min(_from_segment(p, u, v) for u, v in ((a, b), (b, c), (c, a)))


def _from_segment(p: Array, a: Array, b: Array) -> float:
    along = b - a
    square = float(along @ along)
    share = min(max(float((p - a) @ along) / square, 0.0), 1.0) if square > 0.0 else 0.0
    return float(np.linalg.norm(p - a - share * along))
