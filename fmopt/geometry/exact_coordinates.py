"""Exact coordinates: where the vertices of a part are when its faces are to be plane without any rounding.

Floats hold few points of a plane that is askew. The coordinates found here are rational: vertices and faces are placed
one after the other, each with at most three of those that it is incident with before it, so that a face runs through
its vertices and a vertex lies in its planes by the solution of linear equations. Taken off one by one, elements with at
most three left can be found until none is left, whatever the polyhedron without holes (its vertices and faces make a
planar graph with four sides to each region, in which one has three neighbours at most); they are placed in the reverse
order. What is plane in floats stays as it is.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from math import gcd, lcm
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from fmopt.errors import GeometryError
from fmopt.geometry.facets import place
from fmopt.geometry.polyhedron import Polyhedron

MOST = 1e-12  # m: how far exact coordinates may be from those in floats
_LEAST_LEAN = 1e-6  # of planes that are to fix a point

Exact: TypeAlias = NDArray[np.object_]  # fractions (3,)
Direction = tuple[int, int, int]


@dataclass(frozen=True, eq=False)
class _Plane:
    """The plane normal·x = offset."""

    normal: Exact
    offset: Fraction

    def holds(self, p: Exact) -> bool:
        return bool(self.normal @ p == self.offset)


def exact_vertices(
    body: Polyhedron, directions: Mapping[int, Direction] | None = None, most: float = MOST
) -> dict[int, Exact]:
    """The exact coordinates of those vertices whose floats are not in all planes of their faces.

    They may be as far from the floats as `most`, m.

    Raises:
        GeometryError: there are none within that.
    """
    alike = _alike(body)
    planes = [_own_plane(body, [n]) for n in range(len(body.faces))]
    ways = {n: None if plane is None else direction(plane.normal) for n, plane in enumerate(planes)}
    asked = {n: d for n, d in (directions or {}).items() if ways[n] != d}
    if not asked and all(plane is not None and _own_plane(body, alike[n]) for n, plane in enumerate(planes)):
        return {}
    found = _Placing(body, alike, asked).vertices()
    for n, p in found.items():
        off = max(abs(float(x)) for x in p - _point(body, n))
        if off > most:
            raise _refused(body, n, f"its exact place is {1e6 * off:.3g} µm from there")
    return found


def facing_directions(
    moving: Polyhedron, exact: Mapping[int, Exact], fixed: Polyhedron, faces: Sequence[int]
) -> dict[int, Direction]:
    """The normals that some faces of the fixed part should have because faces of the moving one lie flat in them.

    They are opposite to normals of the moving part, but for less than `MOST` over their extent.
    """
    found = {}
    for n in faces:
        corners = fixed.vertices[list(fixed.faces[n].vertices)]
        extent = float((corners.max(axis=0) - corners.min(axis=0)).max())
        turns = np.abs(moving.normals + fixed.faces[n].normal).max(axis=1) * extent
        m = int(turns.argmin())
        own = _own_plane(moving, [m], exact)
        if turns[m] <= MOST and own is not None:
            x, y, z = direction(own.normal)
            found[n] = (-x, -y, -z)
    return found


def direction(normal: Exact) -> Direction:
    """A direction by the least integers."""
    common = lcm(*(x.denominator for x in normal))
    whole = [int(x * common) for x in normal]
    shared = gcd(*whole)
    return (whole[0] // shared, whole[1] // shared, whole[2] // shared)


def _alike(body: Polyhedron) -> list[list[int]]:
    """For each face those in its plane, itself among them, to `MOST`; the same list for all of them."""
    heights = np.abs(body.vertices @ body.normals.T - body.offsets)
    found: list[list[int]] = []
    for n, face in enumerate(body.faces):
        near = (
            group
            for group in found
            if (heights[list(face.vertices), group[0]] <= MOST).all()
            and (heights[list(body.faces[group[0]].vertices), n] <= MOST).all()
            and float(body.normals[n] @ body.normals[group[0]]) > 0.0
        )
        group = next(near, [])
        group.append(n)
        found.append(group)
    return found


def _own_plane(body: Polyhedron, faces: Sequence[int], exact: Mapping[int, Exact] | None = None) -> _Plane | None:
    """The plane of the first of some faces, through floats or exact vertices; None where not all are exactly in it."""
    known = exact or {}
    points = {v: known[v] if v in known else _point(body, v) for n in faces for v in body.faces[n].vertices}
    plane = _across(points, body.faces[faces[0]].loops)
    return plane if all(plane.holds(p) for p in points.values()) else None


def _point(body: Polyhedron, n: int) -> Exact:
    return _fractions(body.vertices[n].tolist())


def _fractions(numbers: Sequence[float]) -> Exact:
    return np.array([Fraction(x) for x in numbers], dtype=object)


def _across(points: Mapping[int, Exact], loops: Sequence[Sequence[int]]) -> _Plane:
    """The plane across the area of loops, through their first point."""
    base = points[loops[0][0]]
    normal = _fractions((0, 0, 0))
    for loop in loops:
        arms = [points[n] - base for n in loop]
        for k, arm in enumerate(arms):
            normal = normal + np.cross(arms[k - 1], arm)
    return _Plane(normal, normal @ base)


class _Placing:
    """Places the vertices and faces of a part, see the module.

    Faces that are in one plane are one face here, by the number of the first.
    """

    def __init__(self, body: Polyhedron, alike: list[list[int]], directions: Mapping[int, Direction]) -> None:
        self.body = body
        self.groups = {group[0]: group for group in alike}
        self.corners = {n: {v for m in group for v in body.faces[m].vertices} for n, group in self.groups.items()}
        self.around = [{alike[n][0] for n in faces} for faces in body.vertex_faces]
        self.directions = {alike[n][0]: d for n, d in directions.items()}
        self.planes: dict[int, _Plane] = {}
        self.placed: dict[int, Exact] = {}

    def vertices(self) -> dict[int, Exact]:
        """The vertices that do not stay where they are."""
        for kind, n in reversed(self._order()):
            if kind == "face":
                self.planes[n] = self._face(n)
            else:
                self.placed[n] = self._vertex(n)
        for n, corners in self.corners.items():
            for vertex in corners:
                if not self.planes[n].holds(self.placed[vertex]):
                    raise _refused(self.body, vertex, "its faces have no point in common there")
        return {n: p for n, p in self.placed.items() if (p != _point(self.body, n)).any()}

    def _order(self) -> list[tuple[str, int]]:
        """Elements so that each has three at most of those after it to be incident with; all that can go, in rounds."""
        around = [set(faces) for faces in self.around]
        corners = {n: set(vertices) for n, vertices in self.corners.items()}
        order: list[tuple[str, int]] = []
        left = set(range(len(around))), set(corners)
        while left[0] or left[1]:
            free = sorted(n for n in left[0] if len(around[n]) <= 3)
            left[0].difference_update(free)
            order += [("vertex", n) for n in free]
            for face in corners.values():
                face.difference_update(free)
            # One point fixes a face whose direction is given.
            flat = sorted(n for n in left[1] if len(corners[n]) <= (1 if n in self.directions else 3))
            left[1].difference_update(flat)
            order += [("face", n) for n in flat]
            for faces in around:
                faces.difference_update(flat)
            if not free and not flat:
                raise _refused(self.body, min(left[0]), "too many of its faces hang together with others")
        return order

    def _face(self, n: int) -> _Plane:
        """The plane of a face through those of its vertices that are placed."""
        face = self.body.faces[n]
        on = [self.placed[v] for v in sorted(self.corners[n]) if v in self.placed]
        if n in self.directions:
            asked = _fractions(self.directions[n])
            return _Plane(asked, asked @ (on[0] if on else _point(self.body, face.vertices[0])))
        own = _own_plane(self.body, self.groups[n])
        if own is not None and all(own.holds(p) for p in on):
            return own
        normal = _fractions(face.normal.tolist())
        if not on:
            return _Plane(normal, Fraction(face.offset))
        first, arms = on[0], [p - on[0] for p in on[1:]]
        # Of all pairs the one that spans most: how far off the points are turns it least.
        spanned = _longest([np.cross(a, b) for k, a in enumerate(arms) for b in arms[:k]])
        if any(spanned):
            return _Plane(spanned, spanned @ first)
        if arms:
            along = _longest(arms)
            # Across the one line that they are on, multiplied by the square of its length to spare a division.
            normal = (along @ along) * normal - (normal @ along) * along
        return _Plane(normal, normal @ first)

    def _vertex(self, n: int) -> Exact:
        """The point of a vertex in those of its planes that are placed, with as many floats kept as they leave."""
        planes = [self.planes[f] for f in sorted(self.around[n]) if f in self.planes]
        stated = _point(self.body, n)
        if all(plane.holds(stated) for plane in planes):
            return stated
        chosen: list[_Plane] = []
        for plane in planes:
            if _lean([*chosen, plane]) > _LEAST_LEAN:
                chosen.append(plane)
        axes = [_Plane(_fractions(axis), at) for axis, at in zip(np.eye(3).tolist(), stated, strict=True)]
        while len(chosen) < 3:
            chosen.append(max(axes, key=lambda axis: _lean([*chosen, axis])))
        return _common(chosen)


def _lean(planes: Sequence[_Plane]) -> float:
    """How far one to three planes are from running alike: the volume of their unit normals."""
    # Divided before they become floats, which their integers may be beyond.
    largest = [max(abs(x) for x in plane.normal) for plane in planes]
    normals = np.array([[float(x / m) for x in plane.normal] for plane, m in zip(planes, largest, strict=True)])
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    return float(np.sqrt(max(np.linalg.det(normals @ normals.T), 0.0)))


def _common(planes: Sequence[_Plane]) -> Exact:
    """The point of three planes."""
    (a, b, c), (d, e, f) = (p.normal for p in planes), (p.offset for p in planes)
    across = np.cross(b, c)
    return np.asarray((d * across + e * np.cross(c, a) + f * np.cross(a, b)) / (a @ across))


def _longest(vectors: Sequence[Exact]) -> Exact:
    return max(vectors, key=lambda v: v @ v, default=_fractions((0, 0, 0)))


def _refused(body: Polyhedron, n: int, why: str) -> GeometryError:
    return GeometryError(
        f"vertex {n} at {place(body.vertices[n])} cannot be given exact coordinates: {why}",
        "give the part faces that are plane, with at most three at a corner",
    )
