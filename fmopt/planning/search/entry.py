"""Where a motion begins: straight above the mouth, or tilted so that one corner of the leading face enters it.

How deep the corner goes in is uncertain by the start errors, those of rotation too, and a part that is to turn upright
against a wall may be in by little: its other side has to pass the mouth on the far side. The corner may touch the top
beside the mouth first. Then its height is known but for what errors of velocity add on the way into the mouth. So are
the part's tilts where it is laid flat on the top.

Everywhere `start_box` has half-widths (6,) of the start error, m and rad; `approach` is the height of the lowest point
above the mouth at the start, m; `play` the free travel (x, y) of the upright part between the walls, m; `max_tilt` the
greatest tilt, rad; `tip` corners (n, 3) in the body frame, m.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from fmopt.geometry.part import Part
from fmopt.geometry.section import (
    corner_turns,
    corner_walls,
    far_edge,
    leading_corners,
    leading_face,
    lowest_point,
    outline,
    reaching_below,
    walls_around,
)
from fmopt.spatial import se3
from fmopt.spatial.se3 import Pose
from fmopt.spatial.values import Array

# What the errors are multiplied with in the plane: how deep the corner goes in below a level.
_LEVELS = (4.5, 5.5, 3.5, 7.0, 2.5)
_DIGITS = 12  # of distances (m) from walls, decimals that tell one from another
_LEAST = 0.03  # of the part's width, which what its height is uncertain by is taken to be at least
_ACROSS = 2.0  # times as far as along the edge that it comes down on, a part leans across it at least
_HOVERING = (2.0, 3.0, 1.5, 0.0)  # times the errors that a ball is away from walls
# The same for a corner once caught on a slope; where it goes in, as shares of the way from the middle to a wall.
_DEEPER, _ASIDE = (2.6, 3.2, 4.5), (0.5, 0.0)


@dataclass(frozen=True)
class Approach:
    """A tilted way to begin, by numbers that may be varied."""

    about_y: float  # tilt about y that lowers the leading corner, rad
    about_x: float  # tilt about x that does, rad
    turn: float  # turn about the part's own axis, rad
    depth: float  # how far below the mouth the corner goes, m
    room: tuple[float, float]  # how far from the walls next to it the corner goes in, along x and y, m
    # How far outside the nearest of these walls the corner touches the top first, and how high above the mouth it is
    # then brought over the place where it goes in, m; None where it goes in at once
    touch: tuple[float, float] | None = None
    # How far from both walls the corner is at least while the part lies flat on the top first, how high above the mouth
    # it is then brought over the place where it goes in, m, and how far the part leans along the edge that it comes
    # down on, rad; it leans twice as far away from that
    flat: tuple[float, float, float] | None = None
    # Turn about z of the axes that the other numbers are about, rad: of the axes turned so, the leading corner lies
    # towards −x and −y
    heading: float = 0.0
    between: tuple[int, int] | None = None

    @property
    def numbers(self) -> Array:
        """What may be varied: (6,), (8,) with those of the touch, or (9,) with those of lying flat."""
        more = self.touch or self.flat or ()
        return np.array([self.about_y, self.about_x, self.turn, self.depth, *self.room, *more])

    def varied(self, numbers: Array) -> Approach:
        """The shape with other such numbers, rad and m."""
        about_y, about_x, turn, depth, x, y, *more = numbers.tolist()
        touch, flat = (tuple(more) if own else None for own in (self.touch, self.flat))
        return Approach(about_y, about_x, turn, depth, (x, y), touch, flat, self.heading, self.between)


@dataclass(frozen=True, eq=False)
class Entry:
    """A way to begin."""

    start: Pose
    inside: Pose
    corner: Array  # that corner (3,) in the body
    shape: Approach | None = None  # what it was made of
    # Whether the corner is still among the slopes of the mouth; caught on one, it may go in deeper
    shallow: bool = False
    # Pose above the mouth to which it goes after the corner has touched the top below the start; None where it goes in
    # at once
    over: Pose | None = None
    leant: Leant | None = None  # how it is laid flat on the top first; None where it is not
    # Inward normals (2, 2) of those that it goes in between; None for those next to the corner
    walls: Array | None = None

    @property
    def heading(self) -> float:
        """Turn about z of the axes that moves go along and about from then on, rad."""
        if self.walls is not None:
            return math.atan2(self.walls[0, 1], self.walls[0, 0])
        return self.shape.heading if self.shape else 0.0


@dataclass(frozen=True, eq=False)
class Leant:
    """How a part that comes down leaning on one corner is laid flat on the top.

    It comes down on the edge with ends (2, 3) in the body, the first of which touches first; two turns (2, 3) about
    unit vectors lay it flat, one after the other.
    """

    edge: Array
    axes: Array


def tilted_entry(moving: Part, play: tuple[float, float], approach: float, shape: Approach) -> Entry:
    """The entry of a shape."""
    tip, axes = leading_corners(moving), turned_axes(shape.heading)
    corner = lowest(tip, shape)
    mouth = _Mouth.of(moving, corner, play, shape)
    sx, sy = (math.copysign(1.0, x) for x in (axes.T @ corner)[:2]) if shape.between is None else (-1.0, -1.0)
    # Turning about +x by α moves y-negative points down by α; about +y by β moves x-positive points down.
    tilt = se3.exp([-sy * shape.about_x, 0.0, 0.0]) @ se3.exp([0.0, sx * shape.about_y, 0.0])
    R = axes @ tilt @ axes.T @ se3.exp([0.0, 0.0, shape.turn])
    hung = Pose(np.array([0.0, 0.0, -shape.depth]) - R @ corner, R)
    # Walls that do not meet at the corner may have other points below the mouth nearer to them than it.
    low = np.zeros((1, 2)) if shape.between is None else reaching_below(moving, hung)
    place = mouth.beside(shape.room, low)
    inside = Pose(np.append(place, -shape.depth) - R @ corner, R)
    sunk = -lowest_point(moving, inside)
    above = inside.moved([0.0, 0.0, approach + sunk, 0.0, 0.0, 0.0])
    entry = Entry(above, inside, corner, shape, walls=None if shape.between is None else mouth.inward[:2])
    if shape.flat is not None:
        return _laid_flat(moving, approach, shape, mouth, entry)
    if shape.touch is None:
        return entry
    beyond, rise = shape.touch
    over = inside.moved([0.0, 0.0, sunk + rise, 0.0, 0.0, 0.0])
    return replace(entry, start=above.moved([*mouth.outwards(place, beyond), 0.0, 0.0, 0.0, 0.0]), over=over)


def _laid_flat(moving: Part, approach: float, shape: Approach, mouth: _Mouth, entry: Entry) -> Entry:
    """The entry of a part that lies flat on the top first, its leading corner over the mouth.

    It leans on a corner opposite to that, comes down on a long edge that ends there, and then altogether.
    """
    assert shape.flat is not None
    away, rise, lean = shape.flat
    tip = leading_face(moving)
    room = (max(shape.room[0], away), max(shape.room[1], away))
    at = np.append(mouth.beside(room, np.zeros((1, 2))), entry.corner[2] - tip[0, 2])
    R = se3.exp([0.0, 0.0, shape.turn])
    first, second = far_edge(moving, entry.corner)
    along = R @ (second - first) / float(np.linalg.norm(second - first))
    to_edge = np.cross([0.0, 0.0, 1.0], along)
    to_face = along * -math.copysign(1.0, float(to_edge @ R @ (entry.corner - first)))
    turns = np.array([to_edge, to_face])
    turn = float(corner_turns(tip)[np.argmin(np.linalg.norm(outline(tip) - first, axis=1))])
    across = max(_ACROSS, 1.0 / math.tan(0.5 * turn))
    leaning = se3.exp(-lean * (to_edge + across * to_face)) @ R
    start = Pose(at - R @ entry.corner + R @ first - leaning @ first, leaning)
    over = entry.inside.moved([0.0, 0.0, rise - lowest_point(moving, entry.inside), 0.0, 0.0, 0.0])
    start = start.moved([0.0, 0.0, approach - lowest_point(moving, start), 0.0, 0.0, 0.0])
    return replace(entry, start=start, over=over, leant=Leant(np.array([first, second]), turns))


def planar_entries(
    moving: Part, fixed: Part, start_box: Array, approach: float, max_tilt: float
) -> Iterator[tuple[Entry, ...]]:
    """Entries in the plane of x and z: the part tilted about y, one end of its leading edge in the mouth, in rounds.

    The corner goes in below a level of the fixed part, such as the end of a chamfer, by a few times what its height is
    uncertain by, the lowest level first: the deeper, the better the side of the part turns about that level, the nearer
    the other side comes. It goes in near the middle, from where it can reach either wall.
    """
    tip = leading_corners(moving)
    end = np.array([float(tip[:, 0].min()), 0.0, 0.0])
    width = float(np.ptp(tip[:, 0]))
    levels = _levels(fixed, width)
    error, angle = float(start_box[0]), float(start_box[4])
    for level, deep, share in product(levels, _LEVELS, (0.9, 0.8, 0.7, 1.0)):
        tilt = share * max_tilt
        swing = max(-float(end[0]) * angle * math.cos(tilt) + float(start_box[2]), _LEAST * width)
        found = []
        for side in (-0.2, 0.0, 0.1):
            R = se3.exp([0.0, -tilt, 0.0])
            inside = Pose(np.array([side * error, 0.0, level - deep * swing]) - R @ end, R)
            raised = inside.moved([0.0, 0.0, approach - lowest_point(moving, inside), 0.0, 0.0, 0.0])
            found.append(Entry(raised, inside, end, shallow=level > levels[0]))
        yield tuple(found)


def deeper(moving: Part, fixed: Part, pose: Pose, corner: Array, spread: Array) -> Iterator[Pose]:
    """Poses in the plane of x and z from which to go on once a corner was caught on a slope of the mouth.

    The part stays turned as it is. The corner (3,), in the body, goes in below the lowest level of the mouth, by a few
    times what the errors displace its height by, of their `spread` (3,), m, between the middle and the wall on the side
    from which it leans.
    """
    width = float(np.ptp(leading_corners(moving)[:, 0]))
    level = _levels(fixed, width)[0]
    side = math.copysign(0.5 * width, float(corner[0]))
    height = max(float(spread[2]), _LEAST * width)
    for deep, share in product(_DEEPER, _ASIDE):
        at = np.array([share * side, 0.0, level - deep * height])
        yield Pose(at - pose.R @ corner, pose.R)


def _levels(fixed: Part, reach: float) -> list[float]:
    """Heights of the fixed part's vertices down to so far below the mouth, the lowest first, m."""
    # Rounded, so that corners of one chamfer make one level.
    return sorted({round(float(z), 9) for z in fixed.polyhedron.vertices[:, 2] if -reach < z <= 0.0})


def straight_entry(moving: Part, play: tuple[float, float], start_box: Array, approach: float) -> tuple[Entry, ...]:
    """The entry of an upright part on the axis, where the start errors leave room for it in the mouth; else none."""
    slack = 0.5 * min(play)
    if start_spread(moving, start_box) >= slack:
        return ()
    tip = leading_corners(moving)
    heights = (np.array([0.0, 0.0, level - float(tip[0, 2])]) for level in (approach, -slack))
    start, inside = (Pose(at, np.eye(3)) for at in heights)
    return (Entry(start, inside, tip[0]),)


def hovering_entries(moving: Part, start_box: Array, approach: float) -> Iterator[tuple[Entry, ...]]:
    """Entries of an upright part that stays above the mouth, to meet walls that stand beside it, in rounds.

    A ball has no corner that could go in first: where walls go on above the mouth it touches them there, from a few
    times away what the errors displace it.
    """
    spread = start_spread(moving, start_box)
    corner = moving.polyhedron.vertices[moving.polyhedron.balls[0][0]]
    lowest = float(leading_corners(moving)[0, 2])
    for far in _HOVERING:
        found = []
        for way in product((1.0, -1.0, 0.0), repeat=2):
            aside = far * spread * np.array(way)
            start, inside = (Pose(np.append(aside, share * approach - lowest), np.eye(3)) for share in (1.0, 0.5))
            found.append(Entry(start, inside, corner))
        yield tuple(found)


def start_spread(moving: Part, start_box: Array) -> float:
    """How far the start errors displace the tip's corners sideways at most, about: half-widths and swing, m."""
    return float(start_box[:2].max()) + swung_by(leading_corners(moving), start_box)


def swung_by(tip: Array, start_box: Array) -> float:
    """How far rotation errors move the tip's outermost corner, m."""
    return float(np.linalg.norm(tip[:, :2], axis=1).max()) * float(np.linalg.norm(start_box[3:]))


@dataclass(frozen=True, eq=False)
class _Mouth:
    """Walls of the hole at its mouth, first the two that a part goes in between; inside, `inward` · (x, y) ≥ `offsets`.

    These are unit normals (n, 2), and offsets (n,), m.
    """

    inward: Array
    offsets: Array

    @staticmethod
    def of(moving: Part, corner: Array, play: tuple[float, float], shape: Approach) -> _Mouth:
        """The walls that the part's sides face. Next to a corner the first is the one that faces more along x."""
        if shape.between is None:
            along = turned_axes(shape.heading)[:2, 0]
            sides = corner_walls(moving, corner)
            (one, on_one), (two, on_two) = sorted(sides, key=lambda side: -abs(float(side[0] @ along)))
            inward, offsets = np.array([one, two]), np.array([one @ on_one, two @ on_two])
        else:
            around = walls_around(moving)
            order = [*shape.between, *(n for n in range(len(around.offsets)) if n not in shape.between)]
            inward, offsets = around.inward[order], around.offsets[order]
        # A part in the middle of the play is half of it away from the walls that its sides face.
        return _Mouth(inward, offsets - 0.5 * np.abs(inward) @ np.asarray(play))

    def beside(self, room: tuple[float, float], low: Array) -> Array:
        """Where (2,) something goes in, points (k, 2) of which relative to it have so much room from the first two."""
        inward = self.inward[:2]
        return np.asarray(np.linalg.solve(inward, self.offsets[:2] + np.asarray(room) - (low @ inward.T).min(axis=0)))

    def outwards(self, place: Array, beyond: float) -> Array:
        """The way (2,) from a place inside to so far outside the nearest wall."""
        away = self.inward @ place - self.offsets
        nearest = int(np.argmin(np.round(away, _DIGITS)))
        return np.asarray(-(away[nearest] + beyond) * self.inward[nearest])


def turned_axes(heading: float) -> Array:
    """Axes (3, 3) turned about z by a heading, rad."""
    return se3.exp([0.0, 0.0, heading])


def lowest(tip: Array, shape: Approach) -> Array:
    """The corner (3,) that a shape's tilts and heading make the lowest, of those next to the walls at −x and −y."""
    x, y, _ = turned_axes(shape.heading).T @ tip.T
    return np.asarray(tip[int(np.argmin(np.sin(shape.about_y) * x + np.sin(shape.about_x) * y))])
