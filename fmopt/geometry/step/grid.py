"""Where the curved faces and edges of a solid are cut: which of them are cut alike, how finely, on which side.

Edges around one axis, and edges opposite each other in a face, are cut at the same angles, so that faces meet. Whole
rounds and arcs that may mate become polygons with their corners on the surface, as the house's own cylinders are.
Fillets become polygons around the solid: tangents where it is convex, chords where it is hollow.
"""

from collections.abc import Hashable, Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.cluster.hierarchy import DisjointSet

from fmopt.geometry.step.step_file import Same
from fmopt.geometry.step.surfaces import REACH, EdgeCurve, FaceSurface, OtherSurfaceError
from fmopt.spatial.values import Array

_LEAST, _MOST = 16, 4096  # sides of a round
_FILLET = np.deg2rad(120.0)  # the most that a fillet turns
_COARSE = np.deg2rad(30.5)  # of the profile of a fillet all around, which mates with nothing
_SMOOTH = 1e-3  # rad: between normals of faces that run into each other
_SAME = 1e-7  # rad: between angles that are one
_SPARE = 0.1  # of a step: an arc this little longer than some steps takes no further one


@dataclass(frozen=True, eq=False)
class Cuts:
    """Where the members of one class are cut: stops (k,), rad or fractions, in a frame in mm."""

    # The frame of the angles: a point (3,) on the axis, mm, and the axes (3, 3) in columns; None where stops are
    # fractions of each member's own range
    axis: tuple[Array, Array] | None
    stops: Array  # angles (k,) in rad, ascending, or fractions from 0 to 1
    stretch: Array  # how much further out than the surface each stop (k,) lies, 1 on it
    off: float  # how far the surface may lie outside of its facets, or inside of those around a hole, mm
    around: float  # how much larger the facets make the solid at most, mm


class Grid:
    """The cuts of all curved faces and edges of a solid."""

    def __init__(self, surfaces: list[FaceSurface], curves: dict[Same, EdgeCurve], deviation: float) -> None:
        self.surfaces, self.curves = surfaces, curves
        self._deviation = deviation
        self.faces = _faces(surfaces)
        self._alike = DisjointSet()
        for number, surface in enumerate(surfaces):
            if surface.kind != "Plane":
                self._join(number, surface)
        self._classes: dict[Hashable, list[Hashable]] = {}
        for member in self._alike:
            self._classes.setdefault(self._alike[member], []).append(member)
        self._seams = self._idle_ends()
        self._cuts = {root: self._cut(members) for root, members in self._classes.items()}

    def cuts(self, member: Hashable) -> Cuts | None:
        """The cuts of an edge, or of ("u", face) or ("v", face); None of straight edges."""
        return self._cuts[self._alike[member]] if member in self._alike else None

    def idle(self, point: Array) -> bool:
        """Whether a vertex (3,), mm, is there for the sake of a seam only."""
        return any(np.linalg.norm(point - seam) <= REACH for seam in self._seams)

    def seam(self, edge: Same, number: int) -> bool:
        """Whether an edge is where a face meets itself."""
        return self.faces[edge] == [number, number]

    def _join(self, number: int, surface: FaceSurface) -> None:
        profile = surface.kind in ("Sphere", "Torus")
        self._alike.add(("u", number))
        if profile:
            self._alike.add(("v", number))
        for edge in surface.edges:
            curve = self.curves[edge]
            if curve.point_like or self.seam(edge, number):
                continue
            if surface.is_parallel(curve):
                self._unite(edge, ("u", number))
            elif surface.is_meridian(curve):
                if profile:
                    self._unite(edge, ("v", number))
            elif profile:
                raise OtherSurfaceError("an edge across a sphere or torus")
            else:
                self._unite(edge, ("u", number))

    def _unite(self, edge: Same, node: Hashable) -> None:
        self._alike.add(edge)
        self._alike.merge(edge, node)

    def _idle_ends(self) -> list[Array]:
        """Ends of seams at which nothing else happens: the edges there run on in the same circle, or are closed."""
        seams = [edge for edge, numbers in self.faces.items() if len(numbers) == 2 and numbers[0] == numbers[1]]
        edges = [(edge, curve) for edge, curve in self.curves.items() if not curve.point_like]
        ends = np.array([curve.ends for _, curve in edges]).reshape(-1, 2, 3)
        places = [end for edge in seams if not self.curves[edge].point_like for end in self.curves[edge].ends]
        near = [(np.linalg.norm(ends - place, axis=2) <= REACH).any(axis=1) for place in places]
        meeting = ([edges[k] for k in np.flatnonzero(each)] for each in near)
        return [place for place, each in zip(places, meeting, strict=True) if self._runs_on(each)]

    def _runs_on(self, meeting: list[tuple[Same, EdgeCurve]]) -> bool:
        rest = [(edge, curve) for edge, curve in meeting if len(set(self.faces[edge])) == 2]
        if len(rest) == 1:
            return rest[0][1].closed
        if len(rest) != 2 or any(curve.circle is None or curve.closed for _, curve in rest):
            return False
        (one, first), (other, second) = rest
        assert first.circle is not None
        assert second.circle is not None
        return set(self.faces[one]) == set(self.faces[other]) and bool(
            np.linalg.norm(first.circle[0] - second.circle[0]) <= REACH
        )

    def _cut(self, members: list[Hashable]) -> Cuts:
        """The cuts of a class."""
        edges = [(edge, self.curves[edge]) for edge in members if isinstance(edge, Same)]
        nodes = [node for node in members if isinstance(node, tuple)]
        radius = max([*(self._radius(node) for node in nodes), *(c.circle[2] for _, c in edges if c.circle)])
        whole = any(curve.closed for _, curve in edges)
        whole |= any(kind == "u" and _whole(self.surfaces[number]) for kind, number in nodes)
        sweeps = [curve.last - curve.first for _, curve in edges if curve.circle] + [
            float(np.ptp(getattr(self.surfaces[number], kind))) for kind, number in nodes
        ]
        if whole or np.ptp(sweeps) > _SAME or any(curve.circle is None for _, curve in edges):
            return self._about_axis(nodes, [edge for edge, _ in edges], radius)
        return self._fractions(nodes, sweeps[0], radius)

    def _radius(self, node: tuple[str, int]) -> float:
        """How far the face is from the axis, or the centre, that an angle of it turns about."""
        kind, number = node
        surface = self.surfaces[number]
        if kind == "v":
            return surface.tube
        if surface.kind == "Cone":
            return max(abs(surface.radius + v * float(np.sin(surface.slope))) for v in surface.v)
        return surface.radius + surface.tube

    def _about_axis(self, nodes: list[tuple[str, int]], edges: list[Same], radius: float) -> Cuts:
        """Angles about the one axis of a class: those of its vertices, and equal steps between them."""
        first = self.surfaces[nodes[0][1]]
        for kind, number in nodes:
            other = self.surfaces[number]
            aside = np.cross(other.origin - first.origin, first.axes[:, 2])
            askew = np.cross(other.axes[:, 2], first.axes[:, 2])
            if kind != "u" or np.linalg.norm(aside) > REACH or np.linalg.norm(askew) > _SAME:
                raise OtherSurfaceError("curved faces that cross")
        axes = _frame(first.axes[:, 2])
        sides = _sides(radius, self._deviation)
        ends = [end for edge in edges if not self.curves[edge].closed for end in self.curves[edge].ends]
        given = _angles([end for end in ends if not self.idle(end)], first.origin, axes)
        stops = _even(given, sides) if len(given) else (2.0 * np.arange(sides) + 1.0) * np.pi / sides
        steps = np.diff(np.append(stops, stops[0] + 2.0 * np.pi))
        off = radius * (1.0 - float(np.cos(0.5 * steps.max())))
        return Cuts((first.origin, axes), stops, np.ones(len(stops)), off, 0.0)

    def _fractions(self, nodes: list[tuple[str, int]], sweep: float, radius: float) -> Cuts:
        """Equal steps over the range that all members of a class have, on the safe side of fillets."""
        hollow = {self._hollow(node) for node in nodes if self._is_fillet(node, sweep)}
        fillet = len(hollow) == 1 and all(self._is_fillet(node, sweep) for node in nodes)
        step = 2.0 * np.pi / _sides(radius, self._deviation)
        if fillet:
            ring = all(_whole(self.surfaces[number]) for _, number in nodes)
            # Tangents lie r/cos − r outside of the round, which is the deviation at this step.
            step = max(2.0 * float(np.arccos(radius / (radius + self._deviation))), _COARSE if ring else 0.0)
        count = max(1, int(np.ceil(sweep / step - _SPARE)))
        half = 0.5 * sweep / count
        if fillet and not hollow.pop():
            # It begins and ends on the surface, where its neighbours do; between are the corners of its tangents.
            stops = np.concatenate([[0.0], (np.arange(count) + 0.5) / count, [1.0]])
            stretch = np.concatenate([[1.0], np.full(count, 1.0 / np.cos(half)), [1.0]])
            return Cuts(None, stops, stretch, 0.0, radius * (1.0 / float(np.cos(half)) - 1.0))
        sagitta = radius * (1.0 - float(np.cos(half)))
        stops = np.linspace(0.0, 1.0, count + 1)
        return Cuts(None, stops, np.ones(count + 1), 0.0 if fillet else sagitta, sagitta if fillet else 0.0)

    def _is_fillet(self, node: tuple[str, int], sweep: float) -> bool:
        """Whether a face turns little, and runs smoothly into its neighbours where it begins and ends to turn."""
        kind, number = node
        surface = self.surfaces[number]
        if sweep > _FILLET:
            return False
        for edge in surface.edges:
            curve = self.curves[edge]
            across = surface.is_meridian(curve) if kind == "u" else surface.is_parallel(curve)
            if curve.point_like or not across:
                continue
            middle = curve.at(0.5 * (curve.first + curve.last))
            normals = [self.surfaces[face].normal(middle) for face in self.faces[edge]]
            if np.linalg.norm(np.cross(normals[0], normals[-1])) > _SMOOTH or normals[0] @ normals[-1] < 0.0:
                return False
        return True

    def _hollow(self, node: tuple[str, int]) -> bool:
        """Whether the solid is outside of the curve in which a face turns."""
        kind, number = node
        surface = self.surfaces[number]
        u, v = (0.5 * sum(surface.u), 0.5 * sum(surface.v))
        point = surface.at(u, v)
        out = surface.at(u, v, across=1.01) if kind == "u" else surface.at(u, v, along=1.01)
        return bool((out - point) @ surface.normal(point) < 0.0)


def _faces(surfaces: list[FaceSurface]) -> dict[Same, list[int]]:
    """The faces at each edge, one twice where it meets itself."""
    found: dict[Same, list[int]] = {}
    for number, surface in enumerate(surfaces):
        for ring in surface.rings:
            for edge, _ in ring:
                found.setdefault(edge, []).append(number)
    return found


def _whole(surface: FaceSurface) -> bool:
    return float(np.ptp(surface.u)) >= 2.0 * np.pi - _SAME


def _sides(radius: float, deviation: float) -> int:
    """Sides of the round, a power of two, so that those of a peg and of its hole agree."""
    sides = _LEAST
    while sides < _MOST and radius * (1.0 - np.cos(np.pi / sides)) > deviation:
        sides *= 2
    return sides


def _frame(axis: Array) -> Array:
    """Axes in columns about a direction: x along the model's x where that lies across, else along its y.

    The direction is turned to the side on which its largest part is positive, for both ends of a round alike.
    """
    z = axis if axis[int(np.argmax(np.abs(np.round(axis, 6))))] > 0.0 else -axis
    across = [e - (e @ z) * z for e in np.eye(3) if abs(e @ z) < 0.9]
    x = max((e / np.linalg.norm(e) for e in across), key=lambda e: np.round(e, 6).tolist())
    return np.column_stack([x, np.cross(z, x), z])


def _angles(points: list[Array], origin: Array, axes: Array) -> Array:
    """The different angles (n,) of points about an axis, ascending from 0 to 2π."""
    if not points:
        return np.zeros(0)
    flat = (np.array(points) - origin) @ axes[:, :2]
    angles = np.sort(np.arctan2(flat[:, 1], flat[:, 0]) % (2.0 * np.pi))
    return np.asarray(np.sort(angles[np.diff(angles, append=angles[0] + 2.0 * np.pi) > _SAME]))


def _even(given: Array, sides: int) -> Array:
    """Given angles, and equal steps between them of about those of a round of so many sides."""
    ends = np.append(given, given[0] + 2.0 * np.pi)
    counts = [max(1, round(float(turn) * sides / (2.0 * np.pi))) for turn in np.diff(ends)]
    spans = zip(pairwise(ends.tolist()), counts, strict=True)
    return np.concatenate([np.linspace(one, other, count, endpoint=False) for (one, other), count in spans])


def intervals(cuts: Cuts) -> Iterator[tuple[int, int, float]]:
    """Neighbouring stops about an axis, by index, and the angle half-way."""
    count = len(cuts.stops)
    for k in range(count):
        following = cuts.stops[(k + 1) % count] + (2.0 * np.pi if k + 1 == count else 0.0)
        yield k, (k + 1) % count, 0.5 * float(cuts.stops[k] + following)
