"""The seat of a candidate: how deep the straight way in goes, and the pose in which all levels have the most room."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from fmopt.geometry.fit.layers import INSIDE, MERGED, Layers, Outline, common, united
from fmopt.geometry.fit.placing import Facing, OutlinePlacement, moved
from fmopt.geometry.section import shrunk
from fmopt.spatial.values import Array

_HEIGHTS = 5  # at which what sweeps by is held against openings
_GROWN = 1.002  # times the area of a section, below which what sweeps by further up is the same
_TOUCH = 2e-8  # m: by which sections may overlap where they touch
_THIN = 1e-7  # m: slabs that are thinner are rounding
_NEAR = 5e-7  # m: how far before and behind a level of both solids it is asked whether that stops the way
_EXACT = 1e-9  # m
_NOTHING = 1e-14  # m²
_STAGES = 3  # of the least clearance, then of the least that does not bind, and so on
_MOVES = 0.05  # of the size: the first steps of a placement
_SHRINKS = 8  # secant steps to how much an outline that is too thick has to shrink
_SHRUNK = 100.0  # times the accuracy: how well that is found


@dataclass(frozen=True, eq=False)
class Led:
    """A solid that is led along a direction: its layers, tip down."""

    layers: Layers

    @cached_property
    def swept(self) -> tuple[Outline, ...]:
        """What of it passes a place on the way up to the top of each slab of the search."""
        found = list[Outline]()
        for section in self.layers.sections:
            grown = section.shape if not found else united([found[-1].shape, section.shape])
            more = not found or grown.area > found[-1].shape.area * (1.0 + 1e-9)
            found.append(Outline.of(grown.simplify(1e-9)) if more else found[-1])
        return tuple(found)

    @cached_property
    def heights(self) -> tuple[int, ...]:
        """Slabs above which more sweeps by, at most five of them."""
        areas = [one.shape.area for one in self.swept]
        last = [k for k, (a, b) in enumerate(pairwise([*areas, math.inf])) if a > 0.0 and b > _GROWN * a]
        return tuple(dict.fromkeys(last[round(x)] for x in np.linspace(0, len(last) - 1, min(_HEIGHTS, len(last)))))


class Way:
    """A solid that is led straight into the other one's material, at any depth of its tip below the top of that."""

    def __init__(self, led: Led, material: Layers, pivot: Array) -> None:
        """Cut nothing yet; the pivot (2,), m, is of the solid's layers."""
        self.led, self.own, self.material, self.pivot = led, led.layers, material, pivot
        self._swept = dict[float, Outline]()

    @cached_property
    def _passed(self) -> list[BaseGeometry]:
        """What of the solid sweeps by up to each of its levels."""
        passed: list[BaseGeometry] = [shapely.Polygon()]
        for low, high in pairwise(self.own.bounds):
            ends = self.own.section(low + INSIDE), self.own.section(high - INSIDE)
            slab = ends[0].shape if ends[0].is_like(ends[1]) else united([ends[0].shape, ends[1].shape])
            whole = united([passed[-1], slab])
            passed.append(whole if whole.area > passed[-1].area * (1.0 + 1e-9) else passed[-1])
        return passed

    def swept(self, height: float) -> Outline:
        """What of the solid sweeps by a place that lies at a height above its tip at last, m."""
        key = round(height, 9)
        if key not in self._swept:
            at, levels = self.own.low + height, self.own.bounds
            slab = min(max(int(np.searchsorted(levels, at)) - 1, 0), len(levels) - 2)
            shape = self._passed[-1]
            if at < self.own.high:
                begun = self.own.section(levels[slab] + INSIDE).shape
                shape = united([self._passed[slab], begun, self.own.section(at).shape])
            self._swept[key] = Outline.of(shape.simplify(_EXACT))
        return self._swept[key]

    def pairs(self, depth: float) -> list[tuple[Outline, Outline]]:
        """What has swept by at each level of the material on the way to a depth (m), with the material there."""
        tip = self.material.high - depth
        cuts = np.concatenate([self.material.bounds, self.own.bounds - self.own.low + tip, [tip]])
        low, high = max(tip, self.material.low), self.material.high
        cuts = np.unique(np.round(cuts[(cuts >= low - _EXACT) & (cuts <= high + _EXACT)], 10))
        made = list[tuple[Outline, Outline]]()
        for bottom, top in pairwise(cuts):
            if top - bottom < _THIN:
                continue
            for height in (bottom + INSIDE, top - INSIDE):
                material, swept = self.material.section(height), self.swept(height - tip)
                known = any(swept.is_like(a) and material.is_like(b) for a, b in made)
                if not (known or material.is_empty or swept.is_empty):
                    made.append((swept, material))
        return made

    def _highest(self, level: float) -> float:
        """The least depth near a level of both solids at which any two corners meet: those of a level may differ."""
        own, other = (np.unique(one.points[:, 2]) for one in (self.own, self.material))
        depths = (self.material.high - other)[:, None] + (own - self.own.low)
        near = MERGED * (self.own.high - self.own.low + self.material.high - self.material.low)
        return float(depths[np.abs(depths - level) <= near].min(initial=level))

    def is_blocked(self, depth: float, at: Array, spare: float) -> bool:
        """Whether the solid at (3,), `spare` (m) thinner than it is, overlaps the material on the way to a depth, m."""
        for swept, material in self.pairs(depth):
            thin = moved(shrunk(swept.shape, spare + _TOUCH), self.pivot, at)
            if material.shape.intersects(thin) and common(material.shape, thin) > _NOTHING:
                return True
        return False

    def stop(self, at: Array, spare: float) -> tuple[float, bool]:
        """Depth of the tip at the first stop, m, placed at (3,); and if there is one, else it is all the way."""
        full = self.material.high - self.material.low
        heights = self.own.bounds - self.own.low
        depths = np.round([self.material.high - e + a for e in self.material.bounds for a in heights], 9)
        depths = np.unique(np.clip(depths, 0.0, full + heights[-1]))
        depths = depths[np.append(True, np.diff(depths) > _THIN)]
        # What is blocked at a depth is blocked at all greater ones.
        low, high = 0, len(depths) - 1
        while low < high:
            middle = (low + high) // 2
            if self.is_blocked(0.5 * float(depths[middle] + depths[middle + 1]), at, spare):
                high = middle
            else:
                low = middle + 1
        if low == len(depths) - 1:
            return full, False
        level = self._highest(float(depths[low]))
        if low == 0 or (
            self.is_blocked(level + _NEAR, at, spare) and not self.is_blocked(max(level - _NEAR, 0.0), at, spare)
        ):
            return level, True
        clear, stuck = 0.5 * float(depths[low - 1] + level), 0.5 * float(level + depths[low + 1])
        while stuck - clear > _EXACT:  # walls that lean
            half = 0.5 * (clear + stuck)
            clear, stuck = (clear, half) if self.is_blocked(half, at, spare) else (half, stuck)
        return clear, True


def most_room(
    pairs: Sequence[tuple[Outline, Outline]], pivot: Array, at: Array, size: float, closed: bool, accuracy: float
) -> tuple[float, Array]:
    """The greatest least clearance of outlines beside material, m, near a placement, and its place (3,).

    The rest of the freedom goes into the least of the clearances that do not bind, and so on. Where the outlines
    overlap the clearance is minus by how much they have to shrink.

    Args:
        size: of the outlines, m.
        closed: whether the material is all round; else there is no end to the room on one side, which is not sought.
        accuracy: of the clearance, m.
    """
    by, tried, found = 0.0, list[tuple[float, float]](), None
    for _ in range(_SHRINKS):
        thin = [(Outline.of(shrunk(swept.shape, by)) if by else swept, material) for swept, material in pairs]
        facing = [Facing(*pair, pivot) for pair in thin if not pair[0].is_empty]
        if not facing:
            return -size, at
        found = OutlinePlacement(facing, at, size, accuracy).improved(_MOVES * size)
        at = found.at
        tried.append((by, found.clearance))
        if abs(found.clearance) < _SHRUNK * accuracy or (by == 0.0 and found.clearance > 0.0):
            break
        by = _less(tried)
    assert found is not None  # there is at least one step
    best = found.clearance - by
    for _ in range(1, _STAGES):
        if not (closed and found.hold()):
            break
        found.improved(_MOVES * size)
    return best, found.at


def _less(tried: Sequence[tuple[float, float]]) -> float:
    """By how much to shrink next, for no clearance: the secant of the last two."""
    (by, clearance), slope = tried[-1], 1.0
    if len(tried) > 1:
        (before, last) = tried[-2]
        slope = (clearance - last) / (by - before) if by != before else 1.0
    return max(by - clearance / min(max(slope, 0.2), 5.0), 0.0)
