"""Ways to begin drawn at random, from the parts and the errors alone: a corner goes in however the part is tilted.

It goes in at once, touches the top first, or the part lies flat on it, in turn. Nothing is known here of what leads
anywhere: what can be certified is spread over cells of heading and tilt, and the rest is for the search to say.
"""

import math
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import chain, islice, product, zip_longest

import numpy as np
from scipy.spatial import KDTree

from fmopt.certificate.error_set import ErrorSet
from fmopt.errors import OverdueError
from fmopt.geometry.part import Part
from fmopt.geometry.section import corner_walls, leading_corners, outline, walls_around
from fmopt.planning.moves.moves import Move, Reached
from fmopt.planning.search.best_first import begin
from fmopt.planning.search.entry import Approach, Entry, lowest, start_spread, swung_by, turned_axes
from fmopt.planning.search.entry_room import funnel
from fmopt.planning.search.guarded_move import ContactPose
from fmopt.planning.search.successors import Node, SearchTask, successor_by
from fmopt.spatial.values import Array

# Between which values numbers are drawn, evenly in their logarithms: each spans what can be certified at all.
_TILT = (0.15, 1.0)  # of the greatest tilt, about either axis
_ROOM = (1.0, 6.0)  # of the lateral errors, how far from the walls next to it the corner goes in
_DEEP = (1.5, 8.0)  # of what the corner's height is uncertain by, how deep it goes in at once
_DEEP_TOLD = (2.0, 12.0)  # the same after the top was touched, of what errors of velocity add on the way from there
_AWAY = (1.05, 1.6)  # of the lateral errors, how far from the walls the corner is as the top is touched
_RISE = (0.03, 0.1)  # of the way from there, how high the corner is lifted
_LEAN = (1.2, 3.0)  # of the errors of angle, how far a part leans that is laid flat
_TURN = 0.2  # rad, how far it is turned about its own axis at most, either way, drawn evenly
_PLAY = 0.25  # of the play between walls, what a laid part's height is taken to be uncertain by at least
_OBTUSE = math.radians(55.0)  # corners that turn by less are held by two walls next to parallel
_BEST = math.radians(100.0)  # of the angles of corners, which of them goes in first
_SAME = 1e-6  # of the part's width, by which a part that looks the same once turned may differ
_CELL = 0.4  # rad, the directions of tilts that are one
_LEFT_FLAT = np.array([1.0, 1.0, 0.0, 0.0, 0.0, 1.0])  # which errors are left to a part that has lain flat

_Towards = tuple[float, tuple[int, int] | None]
"""A heading, and the walls between which something goes in with it, by number; None for those next to a corner."""


@dataclass(frozen=True, eq=False)
class EntryDraws:
    """What ways to begin are drawn for."""

    moving: Part
    fixed: Part
    play: tuple[float, float]  # free travel (x, y) of the upright part between the walls, m
    start_box: Array  # half-widths (6,) of the errors at the start, m and rad
    rate: float
    max_tilt: float  # greatest tilt about each axis, rad

    def shapes(self, seed: int) -> Iterator[Approach]:
        """Shapes of entries without end, the same for the same seed."""
        rng = np.random.default_rng(seed)
        while True:
            for towards, complete in product(self._towards, (self._at_once, self._touching, self._flat)):
                yield complete(self._tilted(towards[int(rng.integers(len(towards)))], rng), rng)

    @cached_property
    def _towards(self) -> list[list[_Towards]]:
        """Headings that put something between two walls, which lie towards −x and −y then: what, and which walls.

        First corners that turn enough for it, between those next to them, if there are any, then what is between two
        that stand at an angle, wherever they are.
        """
        around = walls_around(self.moving)
        corners: list[_Towards] = [(heading, None) for heading in headings(self.moving)]
        pairs = list[_Towards]()
        for pair in around.pairs:
            x, y = -around.inward[list(pair)].sum(axis=0)
            pairs.append((math.atan2(y, x) + 0.75 * math.pi, pair))  # outwards is −135° then
        return [ways for ways in (corners, pairs) if ways] or [[(0.0, None)]]

    def _tilted(self, way: _Towards, rng: np.random.Generator) -> Approach:
        """A shape without a depth."""
        about_y, about_x = (self.max_tilt * drawn(rng, _TILT) for _ in range(2))
        room = self._spread * drawn(rng, _ROOM), self._spread * drawn(rng, _ROOM)
        turn = float(rng.uniform(-_TURN, _TURN))
        return Approach(about_y, about_x, turn, 0.0, room, heading=way[0], between=way[1])

    def _at_once(self, shape: Approach, rng: np.random.Generator) -> Approach:
        """With the corner going in at once."""
        uncertain = float(self.start_box[2]) + self._swing(shape)
        return replace(shape, depth=self._funnel[0] + drawn(rng, _DEEP) * uncertain)

    def _touching(self, shape: Approach, rng: np.random.Generator) -> Approach:
        """With the corner touching the top first."""
        beyond = self._funnel[1] + drawn(rng, _AWAY) * self._lateral(shape)
        way = min(shape.room) + beyond
        depth = self._funnel[0] + drawn(rng, _DEEP_TOLD) * self.rate * way
        return replace(shape, depth=depth, touch=(beyond, drawn(rng, _RISE) * way))

    def _flat(self, shape: Approach, rng: np.random.Generator) -> Approach:
        """With the part lying flat on the top first."""
        away = self._funnel[1] + drawn(rng, _AWAY) * self._lateral(shape)
        corner = lowest(leading_corners(self.moving), shape)
        way = float(np.linalg.norm(corner)) * math.hypot(shape.about_y, shape.about_x)
        uncertain = max(self.rate * way, _PLAY * min(self.play))
        depth = self._funnel[0] + drawn(rng, _DEEP_TOLD) * uncertain
        lean = drawn(rng, _LEAN) * float(np.linalg.norm(self.start_box[3:]))
        return replace(shape, depth=depth, flat=(away, drawn(rng, _RISE) * way, lean))

    @cached_property
    def _spread(self) -> float:
        """How far the errors displace the tip's corners sideways, m."""
        return start_spread(self.moving, self.start_box)

    @cached_property
    def _funnel(self) -> tuple[float, float]:
        """How deep below the mouth the walls begin, and how far outside them the top does, m."""
        return funnel(self.fixed)

    def _swing(self, shape: Approach) -> float:
        return swung_by(lowest(leading_corners(self.moving), shape)[None], self.start_box)

    def _lateral(self, shape: Approach) -> float:
        return float(self.start_box[:2].max()) + self._swing(shape)


def headings(moving: Part) -> list[float]:
    """Turns about z, rad, that put a corner of the tip between its walls, one of each that look the same.

    None comes first. Obtuse corners are left out, whose walls are next to parallel, and with them the first.
    """
    loop = outline(leading_corners(moving))
    found, obtuse = list[tuple[float, float]](), False
    for corner in loop:
        (one, _), (two, _) = corner_walls(moving, corner)
        turn = math.acos(float(np.clip(one @ two, -1.0, 1.0)))
        obtuse = obtuse or turn < _OBTUSE
        if turn >= _OBTUSE:
            found.append((round(abs(math.pi - turn - _BEST), 6), math.atan2(*(one + two)[::-1]) - 0.25 * math.pi))
    found.sort(key=lambda way: (way[0], abs(way[1])))
    ways, seen = list[float](), list[KDTree]()
    for heading in [*([] if obtuse else [0.0]), *(heading for _, heading in found)]:
        sight = loop[:, :2] @ turned_axes(heading)[:2, :2]
        if all(np.max(before.query(sight)[0]) > _SAME * float(np.ptp(sight)) for before in seen):
            ways.append(heading)
            seen.append(KDTree(sight))
    return ways


def drawn(rng: np.random.Generator, between: tuple[float, float]) -> float:
    """A number between two positive ones, its logarithm evenly distributed."""
    low, high = between
    return float(low * (high / low) ** rng.random())


def beginnings(
    task: SearchTask, shapes: Iterator[Approach], entry_of: Callable[[Approach], Entry], count: int
) -> tuple[Entry, ...]:
    """Of so many ways to begin those that can be certified with a margin, one of each cell and of each kind in turn."""
    cells: dict[tuple[int, float, tuple[int, ...], int], tuple[float, Entry]] = {}
    with suppress(OverdueError):  # those that could begin by then count
        for shape in islice(shapes, count):
            entry = entry_of(shape)
            node = begin(task, entry) if _could_enter(task, entry) else None
            if node is not None and node.reached.margin > 0.0:
                tilt = round(math.atan2(shape.about_x, shape.about_y) / _CELL)
                kind = 1 if shape.touch is not None else 2 if shape.flat is not None else 0
                cell = kind, round(shape.heading, 9), shape.between or (), tilt
                if cell not in cells or node.reached.margin > cells[cell][0]:
                    cells[cell] = node.reached.margin, entry
    order = sorted(cells.items(), key=lambda item: (-item[1][0], item[0]))
    kinds = [[entry for cell, (_, entry) in order if cell[0] == kind] for kind in range(3)]
    return tuple(entry for entry in chain.from_iterable(zip_longest(*kinds)) if entry is not None)


def _could_enter(task: SearchTask, entry: Entry) -> bool:
    """Whether a part that has lain flat could go in from there with the errors that this leaves for sure.

    These are sideways and about the vertical. Lying flat takes far more to certify, and that is mostly in vain.
    """
    if entry.leant is None or entry.over is None:
        return True
    left = ErrorSet.from_box(_LEFT_FLAT * task.start.support(np.eye(6)))
    over = Node(entry, ContactPose(entry.over, (), (), entry.corner), Reached(left, (), ()), (), (), 0.0, 0)
    inside = successor_by(task, over, Move(entry.over, entry.inside, (), ()), "enter")
    return inside is not None and inside.reached.margin > 0.0
