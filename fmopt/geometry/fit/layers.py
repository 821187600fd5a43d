"""Sections of a polyhedron across a direction, as outlines with their sides, and the openings that they leave.

Sections are taken between the levels of corners, where they are no limits: of upright walls they are exact, of leaning
ones within 10 nm of the limit at the end of a slab.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations, pairwise

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry
from shapely.geometry.polygon import orient

from fmopt.geometry.polyhedron import Polyhedron
from fmopt.runtime.clock import heed
from fmopt.spatial.values import Array, Indices

MERGED = 1e-5  # of the extent along the direction: corners whose heights differ by less are on one level
_MOST_SLABS = 12
_MOST_TONGUES = 3
_LEAST_SLABS = 4
_FLAT = 1e-6  # of a normal across the direction, up to which a face is level
_STRAIGHT = 1e-9  # m: corners of an outline that lie off by less are none
_SHORTEST = 1e-10  # m: sides that are shorter are none
_SMALL = 1e-4  # of the hull of a section: openings of less area are none
_GRID = 1e-10  # m
_OPEN = 1e-8  # m: openings so near to the hull are open to the side
INSIDE = 1e-8  # m: how far inside a slab a section at its end is taken


@dataclass(frozen=True, eq=False)
class Outline:
    """A plane region, and its sides (n, 2) from `start` to `end` with the region on their left, m."""

    shape: BaseGeometry
    start: Array
    end: Array

    @staticmethod
    def of(shape: BaseGeometry) -> "Outline":
        """The outline of a plane shape, without the points and lines that it may hold."""
        whole = shape if shape.is_valid else shape.buffer(0.0)
        parts = [part for part in shapely.get_parts(whole) if part.geom_type == "Polygon" and part.area > 0.0]
        whole = shapely.MultiPolygon([orient(part) for part in parts])
        rings = [np.asarray(ring.coords)[:-1] for part in whole.geoms for ring in (part.exterior, *part.interiors)]
        shapely.prepare(whole)
        nothing = np.zeros((0, 2))
        start = np.vstack([nothing, *rings])
        end = np.vstack([nothing, *(np.roll(ring, -1, axis=0) for ring in rings)])
        long = np.hypot(*(end - start).T) > _SHORTEST
        return Outline(whole, start[long], end[long])

    @property
    def is_empty(self) -> bool:
        """Whether there is no region."""
        return not len(self.start)

    @cached_property
    def hull(self) -> BaseGeometry:
        """The convex hull of the region."""
        return self.shape.convex_hull

    @cached_property
    def sides(self) -> shapely.STRtree:
        """The sides of the region, to be found by where they are."""
        return shapely.STRtree(shapely.linestrings(np.stack([self.start, self.end], axis=1)))

    @cached_property
    def openings(self) -> list[tuple[shapely.Polygon, bool]]:
        """The free regions inside the hull, each with whether it is closed all round."""
        return [
            (region, bool(region.distance(self.hull.exterior) > _OPEN))
            for region in (() if self.is_empty else shapely.get_parts(without(self.hull, self.shape)))
            if region.geom_type == "Polygon" and region.area > _SMALL * self.hull.area
        ]

    @cached_property
    def tongues(self) -> list[shapely.Polygon]:
        """What stands between two notches, as a dovetail on its base."""
        notches = [notch for notch, is_closed in self.openings if not is_closed]
        between = [without(shapely.union(a, b).convex_hull, shapely.union(a, b)) for a, b in combinations(notches, 2)]
        parts = [part for one in between[:_MOST_TONGUES] for part in shapely.get_parts(one.intersection(self.shape))]
        return [part for part in parts if part.geom_type == "Polygon" and part.area > _SMALL * self.hull.area]

    def is_like(self, other: "Outline") -> bool:
        """Whether two outlines differ by less than rounding."""
        if len(self.start) != len(other.start):
            return False
        if np.abs(self.start - other.start).max(initial=0.0) < _STRAIGHT:
            return True
        if abs(self.shape.area - other.shape.area) > _STRAIGHT * self.shape.length:
            return False
        return bool(self.shape.symmetric_difference(other.shape).area < _STRAIGHT * self.shape.length)


class Layers:
    """A polyhedron seen along a direction."""

    def __init__(self, body: Polyhedron, turn: Array) -> None:
        """Cut nothing yet; the turn (3, 3) takes the body's frame to one whose z runs along the direction."""
        self.turn = turn
        self.points = body.vertices @ turn.T
        self.low, self.high = float(self.points[:, 2].min()), float(self.points[:, 2].max())
        loops = [(number, np.array(loop)) for number, face in enumerate(body.faces) for loop in face.loops]
        self._face = np.concatenate([np.full(len(loop), number) for number, loop in loops])
        self._from = np.concatenate([loop for _, loop in loops])
        self._to = np.concatenate([np.roll(loop, -1) for _, loop in loops])
        normals = body.normals @ turn.T
        self._along = np.column_stack([-normals[:, 1], normals[:, 0]])  # the material is on its left
        self._level = np.abs(normals[:, 2]) > 1.0 - _FLAT
        self._found = dict[float, Outline]()

    @cached_property
    def levels(self) -> Array:
        """Heights (n,) of the corners, ascending, m."""
        heights = np.sort(self.points[:, 2])
        group = np.cumsum(np.append(False, np.diff(heights) > MERGED * (self.high - self.low)))
        levels = np.bincount(group, heights) / np.bincount(group)
        levels[[0, -1]] = self.low, self.high
        return levels

    @cached_property
    def edges(self) -> Array:
        """Levels (n,) that bound the slabs of a search: all, or those with the most level faces and some between."""
        kept = self.levels
        if len(kept) > _MOST_SLABS + 1:
            ends = self.points[self._from[self._level[self._face]], 2]
            often = np.bincount(np.abs(kept[:, None] - ends).argmin(axis=0), minlength=len(kept))
            flat = np.argsort(-often[1:-1], kind="stable")[: _MOST_SLABS // 2] + 1
            even = np.linspace(0, len(kept) - 1, _MOST_SLABS - len(flat) + 1).astype(int)
            kept = kept[np.union1d(even, flat)]
        while len(kept) <= _LEAST_SLABS:
            thickest = int(np.argmax(np.diff(kept)))
            kept = np.insert(kept, thickest + 1, 0.5 * (kept[thickest] + kept[thickest + 1]))
        return kept

    @cached_property
    def bounds(self) -> Array:
        """Levels (n,) for the seat: all, or those of the search where a curved surface has too many."""
        return self.levels if len(self.levels) <= 4 * _MOST_SLABS else self.edges

    @cached_property
    def middles(self) -> tuple[float, ...]:
        """Heights half-way up the slabs of a search, m."""
        return tuple(0.5 * float(low + high) for low, high in pairwise(self.edges))

    @cached_property
    def sections(self) -> tuple[Outline, ...]:
        """Sections half-way up the slabs of a search, one and the same where neighbours are alike."""
        found = list[Outline]()
        for section in map(self.section, self.middles):
            found.append(found[-1] if found and section.is_like(found[-1]) else section)
        return tuple(found)

    def section(self, height: float) -> Outline:
        """The section at a height that is none of a corner, m."""
        if height not in self._found:
            heed()
            self._found[height] = self._cut(height)
        return self._found[height]

    def _cut(self, height: float) -> Outline:
        above = self.points[:, 2] - height
        cut = np.flatnonzero((above[self._from] > 0.0) != (above[self._to] > 0.0))
        low, high = (pick(self._from[cut], self._to[cut]) for pick in (np.minimum, np.maximum))
        # The same order of ends for both faces of an edge gives both the same point, to the bit.
        share = (above[low] / (above[low] - above[high]))[:, None]
        points = self.points[low, :2] + share * (self.points[high, :2] - self.points[low, :2])
        face = self._face[cut]
        order = np.lexsort((np.sum(points * self._along[face], axis=1), face))
        edge = (low * len(self.points) + high)[order]
        return Outline.of(_region(_rings(points[order], edge[::2], edge[1::2])))


def _rings(points: Array, begins: Indices, ends: Indices) -> list[Array]:
    """Closed rings of segments, each from points[2k], on the edge begins[k] of a body, to one on its edge ends[k]."""
    at = dict(zip(begins.tolist(), range(len(begins)), strict=True))
    left, rings = dict.fromkeys(range(len(begins))), list[Array]()
    while left:
        k, ring = next(iter(left)), list[int]()
        while k in left:
            del left[k]
            ring.append(2 * k)
            k = at.get(int(ends[k]), -1)
        if len(ring) > 2:
            rings.append(points[ring])
    return rings


def _region(rings: Sequence[Array]) -> BaseGeometry:
    """The region of rings of which outer ones are counter-clockwise and holes clockwise."""
    shapes = [shapely.Polygon(ring) for ring in rings]
    valid = [shape if shape.is_valid else shape.buffer(0.0) for shape in shapes]
    outer, holes = (
        [shape for shape, ring in zip(valid, shapes, strict=True) if ring.exterior.is_ccw == ccw]
        for ccw in (True, False)
    )
    return without(united(outer), united(holes)).simplify(_STRAIGHT)


def united(shapes: Sequence[BaseGeometry]) -> BaseGeometry:
    """The union of plane shapes, formed on a grid where rounding along a common side defeats it."""
    try:
        return shapely.union_all(shapes)
    except shapely.GEOSException:
        return shapely.union_all(shapes, grid_size=_GRID)


def without(shape: BaseGeometry, other: BaseGeometry) -> BaseGeometry:
    """A plane shape less another one, formed on a grid where rounding along a common side defeats it."""
    try:
        return shapely.difference(shape, other)
    except shapely.GEOSException:
        return shapely.difference(shape, other, grid_size=_GRID)


def common(shape: BaseGeometry, other: BaseGeometry) -> float:
    """Area that two plane shapes have in common, m², mended and on a grid where rounding defeats it."""
    try:
        return float(shapely.intersection(shape, other).area)
    except shapely.GEOSException:
        return float(shapely.intersection(shape.buffer(0.0), other.buffer(0.0), grid_size=_GRID).area)
