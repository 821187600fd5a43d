"""Facets of a solid from its own surfaces: planes as they are, curved faces cut as `geometry.step.grid` says.

Corners lie where surfaces meet: those of plane faces are moved onto all of their planes.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from manifold3d import triangulate
from OCP.TopoDS import TopoDS_Shape

from fmopt.geometry.facets import Indices, merged_vertices, together
from fmopt.geometry.mesh.open_edges import sewn
from fmopt.geometry.step.grid import Cuts, Grid, intervals
from fmopt.geometry.step.step_file import Same
from fmopt.geometry.step.surfaces import REACH, EdgeCurve, FaceSurface, OtherSurfaceError, read
from fmopt.spatial.se3 import cross
from fmopt.spatial.values import Array, Value

_SAMPLES = 65  # of an edge, between which it turns one way about an axis
_HALVINGS = 60
_SLIVER = 1e-6  # rad: what arcs may reach beyond a stop without counting there
_LOOSE = 1e-2  # mm: corners further from their planes than this are no corners of theirs
_FLAT = 1e-3  # of planes at a corner: the least singular value that tells them apart


@dataclass(frozen=True, eq=False)
class Facets(Value):
    """Facets of a solid: outward triangles (m, 3) between points (n, 3), mm."""

    points: Array
    triangles: Indices
    off: float | None  # how far curved surfaces are from their facets, mm; None where there are no curved faces
    around: float  # how much larger than the solid the facets are at fillets at most, mm


def exact_facets(solid: "TopoDS_Shape", deviation: float) -> Facets:
    """The facets of a solid of planes and surfaces of revolution.

    The solid is of the kernel; facets may lie from curved faces by the deviation. In mm.

    Raises:
        OtherSurfaceError: it has other surfaces, or such that meet in a way that no grid follows.
    """
    surfaces, curves = read(solid)
    work = _Work(surfaces, Grid(surfaces, curves, deviation))
    portions = [(number, portion) for number in range(len(surfaces)) for portion in work.facets(number)]
    owners = np.repeat([number for number, _ in portions], [len(sides) for _, (_, sides) in portions])
    merged, kept, numbers = merged_vertices(*together([portion for _, portion in portions]), REACH)
    # Where a corner of neighbours lies on an edge, as at the end of a flat on a shaft.
    kept, owned = sewn(merged, kept, owners[numbers], REACH)
    shifted, shift = _onto_planes(merged, kept, owned, surfaces)
    curved = [number for number, surface in enumerate(surfaces) if surface.kind != "Plane"]
    off = max((work.sum_of(number, "off") for number in curved), default=None)
    if off is not None or shift > REACH:
        off = max(off or 0.0, shift if shift > REACH else 0.0)
    return Facets(shifted, kept, off, max((work.sum_of(number, "around") for number in curved), default=0.0))


def _onto_planes(
    points: Array, triangles: Indices, owners: Indices, surfaces: list[FaceSurface]
) -> tuple[Array, float]:
    """Points moved onto all planes that meet at them, by the smallest shift, and the largest shift, mm."""
    meeting: dict[int, set[int]] = {}
    for triangle, owner in zip(triangles.tolist(), owners.tolist(), strict=True):
        if surfaces[owner].kind == "Plane":
            for index in triangle:
                meeting.setdefault(index, set()).add(owner)
    moved, largest = np.array(points), 0.0
    axes, origins = (np.array([getattr(each, name) for each in surfaces]) for name in ("axes", "origin"))
    for count in sorted({len(own) for own in meeting.values()}):
        corners = [index for index, own in meeting.items() if len(own) == count]
        own = np.array([sorted(meeting[index]) for index in corners])
        normals = axes[own, :, 2]
        heights = np.vecdot(normals, origins[own] - points[corners][:, None])
        shifts = np.einsum("nij,nj->ni", np.linalg.pinv(normals, rcond=_FLAT), heights)
        if (size := float(np.linalg.norm(shifts, axis=1).max())) > _LOOSE:
            raise OtherSurfaceError("corners that are not in their planes")
        moved[corners] += shifts
        largest = max(largest, size)
    return moved, largest


class _Work:
    """The facets of one face after the other."""

    def __init__(self, surfaces: list[FaceSurface], grid: Grid) -> None:
        self._surfaces, self._grid = surfaces, grid
        self._inner = {edge: self._stops(edge, curve) for edge, curve in grid.curves.items()}

    def sum_of(self, number: int, name: str) -> float:
        """What the cuts of a face along and across its profile add up to."""
        cuts = (self._grid.cuts((kind, number)) for kind in "uv")
        return float(sum(getattr(each, name) for each in cuts if each is not None))

    def facets(self, number: int) -> Iterator[tuple[Array, Indices]]:
        """Corners (n, 3) and outward triangles (m, 3) over them, in portions."""
        surface = self._surfaces[number]
        if surface.kind == "Plane":
            yield self._plane(surface)
        elif surface.kind in ("Sphere", "Torus"):
            yield from (_fan(quad, surface) for quad in self._net(number, surface))
        else:
            yield from (_fan(quad, surface) for quad in self._strips(number, surface))

    def _stops(self, edge: Same, curve: EdgeCurve) -> list[Array]:
        """Where an edge is cut, its ends left out; all around where it is closed and nothing else ends on it."""
        cuts = self._grid.cuts(edge)
        if curve.point_like or cuts is None:
            return []
        if cuts.axis is None:
            at = curve.first + cuts.stops[1:-1] * (curve.last - curve.first)
            return [curve.at(float(t), float(s)) for t, s in zip(at, cuts.stretch[1:-1], strict=True)]
        parameters = np.linspace(curve.first, curve.last, _SAMPLES)
        angles = np.unwrap([_angle(curve.at(t), cuts) for t in parameters])
        turns = -1.0 if angles[-1] < angles[0] else 1.0
        angles = turns * angles
        if np.diff(angles).min() <= 0.0:
            raise OtherSurfaceError("an edge that turns back")
        # Unwrapped, angles of an edge may be off the stops by whole turns.
        wanted = np.sort((turns * cuts.stops[:, None] + 2.0 * np.pi * np.arange(-2, 3)).ravel())
        first = angles[0] - _SLIVER if curve.closed else angles[0] + _SLIVER
        inside = wanted[(wanted > first) & (wanted < angles[-1] - _SLIVER)]
        return [self._on(curve, cuts, float(turns * angle), parameters, turns * angles) for angle in inside]

    def _on(self, curve: EdgeCurve, cuts: Cuts, angle: float, parameters: Array, angles: Array) -> Array:
        """The point of an edge at an angle about the axis."""
        assert cuts.axis is not None
        if curve.circle is not None:
            return _round(curve.circle, cuts, angle)
        rising = 1.0 if angles[-1] > angles[0] else -1.0
        after = int(np.clip(np.searchsorted(rising * angles, rising * angle), 1, len(angles) - 1))
        low, high = float(parameters[after - 1]), float(parameters[after])
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            beyond = rising * ((_angle(curve.at(middle), cuts) - angle + np.pi) % (2.0 * np.pi) - np.pi)
            low, high = (low, middle) if beyond > 0.0 else (middle, high)
        return curve.at(0.5 * (low + high))

    def _along(self, edge: Same, forward: bool) -> list[Array]:
        """The corners of an edge in a ring: all but the last, which the next edge begins with."""
        curve = self._grid.curves[edge]
        if curve.point_like:
            return []
        start = curve.ends[0 if forward else 1]
        corners = self._inner[edge][:: 1 if forward else -1]
        alone = curve.closed and bool(corners)
        return corners if alone or self._passed(edge, start) else [start, *corners]

    def _passed(self, edge: Same, end: Array) -> bool:
        """Whether the facets run on past an end of an edge, which is there for the sake of a seam only."""
        cuts = self._grid.cuts(edge)
        if cuts is None or cuts.axis is None or not self._grid.idle(end):
            return False
        apart = (cuts.stops - _angle(end, cuts) + np.pi) % (2.0 * np.pi) - np.pi
        return bool(np.abs(apart).min() > _SLIVER)

    def _plane(self, surface: FaceSurface) -> tuple[Array, Indices]:
        loops = [np.array([p for edge, on in ring for p in self._along(edge, on)]) for ring in surface.rings]
        if any(len(loop) < 3 for loop in loops):
            raise OtherSurfaceError("a plane face without corners")
        flat = [(loop - surface.origin) @ surface.axes[:, :2] for loop in loops]
        areas = [_area(loop) for loop in flat]
        outer = int(np.argmax(np.abs(areas)))
        for number, area in enumerate(areas):
            if (area > 0.0) != (number == outer):
                flat[number], loops[number] = flat[number][::-1], loops[number][::-1]
        triangles = np.asarray(triangulate(flat), dtype=np.int64).reshape(-1, 3)
        corners = np.vstack(loops)
        outward = surface.normal(surface.origin) @ surface.axes[:, 2] * np.linalg.det(surface.axes) > 0.0
        return corners, triangles if outward else triangles[:, ::-1]

    def _strips(self, number: int, surface: FaceSurface) -> Iterator[Array]:
        """The facets of a cylinder or cone: between neighbouring stops, from one edge up to the next."""
        cuts = self._grid.cuts(("u", number))
        assert cuts is not None
        across: dict[int, list[tuple[float, Array, Array]]] = {}
        seen: set[tuple[int, float]] = set()
        tips = []
        for edge in sorted(surface.edges, key=lambda edge: self._height(edge, surface)):
            curve = self._grid.curves[edge]
            if curve.point_like:
                tips.append(curve.at(curve.first))
            elif not self._grid.seam(edge, number) and self._grid.cuts(edge) is cuts:
                for k, a, b in self._crossed(edge, curve, cuts):
                    # Twice the height of the middle, as only the order counts; so is that of a tip below.
                    height = float((a + b - 2.0 * surface.origin) @ surface.axes[:, 2])
                    if curve.circle is None or (k, round(height, 5)) not in seen:  # arcs that meet at a seam share one
                        across.setdefault(k, []).append((height, a, b))
                        seen.add((k, round(height, 5)))
        for k in sorted(across):
            found = [*across[k]]
            if len(found) % 2 and len(tips) == 1:
                found.append((float(2.0 * (tips[0] - surface.origin) @ surface.axes[:, 2]), tips[0], tips[0]))
            if len(found) % 2:
                raise OtherSurfaceError("a strip that ends nowhere")
            found.sort(key=lambda each: each[0])
            for (_, a, b), (_, c, d) in zip(found[::2], found[1::2], strict=True):
                yield np.array([a, b, d, c])

    def _height(self, edge: Same, surface: FaceSurface) -> tuple[float, ...]:
        curve = self._grid.curves[edge]
        return tuple(np.round((curve.at(0.5 * (curve.first + curve.last)) - surface.origin) @ surface.axes, 9))

    def _crossed(self, edge: Same, curve: EdgeCurve, cuts: Cuts) -> Iterator[tuple[int, Array, Array]]:
        """The stops between which an edge runs, and its points there, in the direction of the cuts."""
        if cuts.axis is None:
            points = [curve.ends[0], *self._inner[edge], curve.ends[1]]
            ordered = points[::-1] if self._falling(curve, edge) else points
            yield from ((k, a, b) for k, (a, b) in enumerate(pairwise(ordered)))
            return
        if curve.circle is not None:
            whole = abs(curve.last - curve.first) >= 2.0 * np.pi - _SLIVER
            middle = curve.at(0.5 * (curve.first + curve.last))
            half = 0.5 * abs(curve.last - curve.first)
            for k, following, angle in intervals(cuts):
                apart = abs((angle - _angle(middle, cuts) + np.pi) % (2.0 * np.pi) - np.pi)
                own = abs((angle - cuts.stops[k] + np.pi) % (2.0 * np.pi) - np.pi)
                if whole or apart < half + own - _SLIVER:
                    a, b = (_round(curve.circle, cuts, float(cuts.stops[i])) for i in (k, following))
                    yield k, a, b
            return
        points = [*self._inner[edge]]
        points = [*points, points[0]] if curve.closed and points else [curve.ends[0], *points, curve.ends[1]]
        for a, b in pairwise(points):
            k = _interval(cuts, a, b)
            later = (_angle(b, cuts) - _angle(a, cuts) + np.pi) % (2.0 * np.pi) - np.pi > 0.0
            yield (k, a, b) if later else (k, b, a)

    def _falling(self, curve: EdgeCurve, edge: Same) -> bool:
        """Whether an edge runs against the first parameter of the face around which it runs."""
        for number in self._grid.faces[edge]:
            surface = self._surfaces[number]
            if surface.kind in ("Cylinder", "Cone") and surface.is_parallel(curve):
                start = surface.at(surface.u[0], 0.0) - surface.origin
                one, other = (arm @ surface.axes[:, :2] for arm in (start, curve.ends[0] - surface.origin))
                turned = np.arctan2(one[0] * other[1] - one[1] * other[0], one @ other)
                return bool(abs(turned) > 1e-6)
        return False

    def _net(self, number: int, surface: FaceSurface) -> Iterator[Array]:
        """The facets of a sphere or torus between two heights and two meridians."""
        around, profile = self._grid.cuts(("u", number)), self._grid.cuts(("v", number))
        assert around is not None
        assert profile is not None
        self._require_rectangle(number, surface)
        if profile.axis is not None:
            raise OtherSurfaceError("a profile that is no arc")
        heights = surface.v[0] + profile.stops * (surface.v[1] - surface.v[0])
        for ends, stretch in _meridians(surface, around):
            levels = [
                [surface.at(u, float(height), across, float(along)) for u, across in zip(ends, stretch, strict=True)]
                for height, along in zip(heights, profile.stretch, strict=True)
            ]
            for low, high in pairwise(levels):
                yield np.array([low[0], low[1], high[1], high[0]])

    def _require_rectangle(self, number: int, surface: FaceSurface) -> None:
        for edge in surface.edges:
            curve = self._grid.curves[edge]
            if curve.point_like or self._grid.seam(edge, number):
                continue
            middle = curve.at(0.5 * (curve.first + curve.last))
            x, y, z = (middle - surface.origin) @ surface.axes
            if surface.is_parallel(curve):
                rims = [(surface.at(0.0, v) - surface.origin) @ surface.axes for v in surface.v]
                off = min(float(np.hypot(np.hypot(x, y) - np.hypot(*rim[:2]), z - rim[2])) for rim in rims)
            else:
                angle = surface.around(middle)
                off = min(float(np.hypot(x, y)) * abs(np.sin(0.5 * (angle - u))) for u in surface.u)
            if off > 10.0 * REACH:
                raise OtherSurfaceError("a piece of a sphere or torus that is no rectangle of its parameters")


def _meridians(surface: FaceSurface, cuts: Cuts) -> Iterator[tuple[tuple[float, float], tuple[float, float]]]:
    """Neighbouring stops around the axis as the surface's own parameters, and how they are stretched."""
    if cuts.axis is None:
        places = surface.u[0] + cuts.stops * (surface.u[1] - surface.u[0])
        for k in range(len(places) - 1):
            yield (float(places[k]), float(places[k + 1])), (float(cuts.stretch[k]), float(cuts.stretch[k + 1]))
        return
    origin, axes = cuts.axis
    middle, half = 0.5 * sum(surface.u), 0.5 * float(np.ptp(surface.u))
    for k, following, angle in intervals(cuts):
        at = [
            surface.around(origin + axes[:, 0] * np.cos(a) + axes[:, 1] * np.sin(a))
            for a in (float(cuts.stops[k]), float(cuts.stops[following]), angle)
        ]
        if abs((at[2] - middle + np.pi) % (2.0 * np.pi) - np.pi) < half:
            yield (at[0], at[1]), (1.0, 1.0)


def _round(circle: tuple[Array, Array, float], cuts: Cuts, angle: float) -> Array:
    """The point of a circle about the axis of the cuts at an angle."""
    assert cuts.axis is not None
    centre, _, radius = circle
    axes = cuts.axis[1]
    return np.asarray(centre + radius * (axes[:, 0] * np.cos(angle) + axes[:, 1] * np.sin(angle)))


def _angle(point: Array, cuts: Cuts) -> float:
    assert cuts.axis is not None
    origin, axes = cuts.axis
    x, y, _ = (point - origin) @ axes
    return float(np.arctan2(y, x))


def _interval(cuts: Cuts, a: Array, b: Array) -> int:
    """The interval of stops in which the middle of two points lies."""
    middle = _angle(0.5 * (a + b), cuts)
    return min(intervals(cuts), key=lambda each: abs((each[2] - middle + np.pi) % (2.0 * np.pi) - np.pi))[0]


def _area(loop: Array) -> float:
    x, y = loop.T
    return 0.5 * float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))


def _fan(quad: Array, surface: FaceSurface) -> tuple[Array, Indices]:
    """A facet as triangles that look outward; corners that coincide are one."""
    corners = quad[np.linalg.norm(quad - quad[[-1, 0, 1, 2]], axis=1) > REACH]
    if len(corners) < 3:
        return np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64)
    sides = np.array([(0, i, i + 1) for i in range(1, len(corners) - 1)], dtype=np.int64)
    outward = cross(corners[1] - corners[0], corners[2] - corners[0]) @ surface.normal(corners.mean(axis=0)) > 0.0
    return corners, sides if outward else sides[:, ::-1]
