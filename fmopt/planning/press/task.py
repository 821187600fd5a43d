"""An insertion as presses see it: the mouth and its corners, the tip, the shelves on the way, and what is known."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from fmopt.execution.engines.engine import Bodies
from fmopt.execution.kept_clear import KeptClear
from fmopt.execution.press_controller import begun
from fmopt.geometry.clearance import Clearance, deepest, interference
from fmopt.geometry.part import Part
from fmopt.geometry.polyhedron import convex_hull_polyhedron, placed
from fmopt.geometry.section import section_limit
from fmopt.plan.field_types import numbers
from fmopt.plan.press import Seat
from fmopt.spatial.se3 import Pose
from fmopt.spatial.values import Array
from fmopt.task.problem import Problem
from fmopt.task.sizes import characteristic_length

if TYPE_CHECKING:
    from shapely import Polygon
    from shapely.geometry.base import BaseGeometry

_LEVEL, _TIP = 2e-6, 1e-6  # m, from a step to its sections, and within which vertices belong to the leading face
_NEAR = 2.0  # lateral errors, from which walls are out of reach for what leads
_BLUNT = 0.2  # of the depth, that what leads and never mates may be long
_STRAIGHT = 1e-6  # m by which corners of an outline may be off a straight side
_PLAY_DROP = 0.6  # of the play above a shelf, below which the play is smaller there
_MAX_SYMMETRY, _FEW = 60, 3  # turns, and corners that sequences are made for
_HEIGHTS, _HALVINGS = 40, 30  # at which walls are looked for; of a way, from the size to less than 1 nm
_STEADY = 0.7  # of the limit of force
_SURE = 1.5  # times the offset of the torque, from which a press turns the part against it
_ROUND = 0.02  # of the radius, by which an outline that counts as round is off its circle
_ROOM, _OVERSHOOT = 0.6, 0.02  # of the distance; rad, while a turn is measured
_CLEAR = 4.0  # lateral errors, by which hollows that are filled stay away from the walls


@dataclass(frozen=True, eq=False)
class Corner:
    """A corner of the mouth that its convex hull has, too."""

    at: Array  # (2,), m
    walls: Array  # outward unit normals (2, 2) of the sides before and after it
    angle: float  # direction of the mean of these normals, rad
    turn: float  # exterior angle, rad


@dataclass(frozen=True)
class Shelf:
    """Where a step of the one part reaches a step of the other, and the play drops."""

    gone: float  # how far the origin of the moving part is below the mouth there, m
    lever: float  # middle of the walls that are engaged over that origin, m
    height: float  # of these walls, m


@dataclass(frozen=True)
class Engaged:
    """The walls of least play: lowest, highest and mean height over the origin of the moving part, and that play, m."""

    low: float
    high: float
    middle: float
    play: float


@dataclass(frozen=True, eq=False)
class PressTask:
    """What presses are proposed for; the parts are as presses take them."""

    problem: Problem
    moving: Part
    fixed: Part
    clearance: Clearance  # as measured
    box: Array  # half-widths (6,) of the start errors, m and rad

    @property
    def goal(self) -> Pose:
        """Pose of the moving part when seated."""
        return Pose.from_vector(self.problem.goal)

    @property
    def lateral(self) -> float:
        """Greatest start error across the axis along x or y, m."""
        return float(max(self.box[0], self.box[1]))

    @property
    def depth(self) -> float:
        """How far the leading face goes below the mouth, m."""
        return -float(self.problem.goal[2])

    @cached_property
    def through(self) -> bool:
        """Whether nothing stops the part within a clearance of the goal."""
        lowered = Pose(self.goal.p - np.array([0.0, 0.0, self.clearance.per_side]), self.goal.R)
        return interference(self.moving, self.fixed, lowered).depth <= 1e-9

    @cached_property
    def ahead(self) -> float:
        """How far the part reaches below the tip, m: what leads and never comes near the walls is no tip."""
        levels, stops = self._levels(self.moving), self._levels(self.fixed)
        near = _NEAR * math.hypot(self.box[0], self.box[1])
        for low, high in pairwise(levels):
            if low - levels[0] > _BLUNT * self.depth:
                break
            walls = (0.0, *(z for z in stops if low - self.depth < z < 0.0))
            if any(self._play(own, z - _LEVEL) < near for own in (low + _LEVEL, high - _LEVEL) for z in walls):
                return low - levels[0]
        return 0.0

    @cached_property
    def tip(self) -> Array:
        """Vertices (n, 3) of the leading face, m, in the frame of the moving part."""
        vertices = np.vstack([body.vertices for body in self.moving.bodies])
        heights = vertices[:, 2] - vertices[:, 2].min() - self.ahead
        return np.unique(vertices[(heights > -_TIP) & (heights < _TIP)].round(12), axis=0)

    @cached_property
    def outline(self) -> Polygon:
        """The outline of the moving part at its widest below the mouth, seated, m, in the B-frame."""
        heights = sorted({0.0, *(z for z in self._levels(self.moving) if 0.0 < z < self.depth)})
        return max((self._outline(z + _LEVEL) for z in heights), key=lambda shape: float(shape.area))

    @cached_property
    def size(self) -> float:
        """Length of the longer side of the outline's least rectangle, m."""
        return float(np.linalg.norm(_rectangle(self.outline)[0]))

    @cached_property
    def width(self) -> float:
        """Length of the shorter side of the least rectangle about the mouth, m."""
        return float(np.linalg.norm(_rectangle(self.mouth)[1]))

    @cached_property
    def narrow(self) -> float:
        """Length of the shorter side of the outline's least rectangle, m."""
        return float(np.linalg.norm(_rectangle(self.outline)[1]))

    @property
    def long_axis(self) -> float:
        """Direction of the longer side of the mouth, rad."""
        x, y = _rectangle(self.mouth)[0]
        return math.atan2(y, x)

    @cached_property
    def mouth(self) -> Polygon:
        """The opening of the fixed part just below the mouth's plane, m."""
        return self._opening(0.0)

    @cached_property
    def top(self) -> BaseGeometry:
        """Where the fixed part ends in the mouth's plane, m."""
        below, above = (section_limit(self.fixed.bodies, _level(0.0), side) for side in (-1, 1))
        return below.difference(above)

    @cached_property
    def round(self) -> bool:
        """Whether the part turns freely about its axis: the circle around it is inside the opening all the way down."""
        axis = self.outline.centroid

        def radius(shape: Polygon) -> float:
            return float(shape.exterior.hausdorff_distance(axis))

        if radius(self.outline) > (1.0 + _ROUND) * self.outline.exterior.distance(axis):
            return False
        top = min(self.depth, self._levels(self.moving)[-1])
        levels = sorted((*self._levels(self.moving), *(z + self.depth for z in self._levels(self.fixed)), top))
        engaged = [ends for ends in pairwise(levels) if -_LEVEL < ends[0] < ends[1] - 3.0 * _LEVEL and ends[1] <= top]
        heights = (z for low, high in engaged for z in (low + _LEVEL, high - _LEVEL))
        return all(radius(self._outline(z)) < self._opening(z - self.depth).exterior.distance(axis) for z in heights)

    @cached_property
    def filled(self) -> bool:
        """Whether trials may fill hollows of the moving part, as the fixed part stays out of them all the way."""
        if len(self.moving.pieces) == 1:
            return False
        hull = convex_hull_polyhedron(self.moving.polyhedron.vertices)
        levels, within = self._levels(self.moving), self.mouth.buffer(-_CLEAR * self.lateral)
        for a, b in pairwise(levels):
            whole, own = (section_limit(bodies, _level(0.5 * (a + b)), 1) for bodies in ((hull,), self.moving.bodies))
            if not within.contains(self._seated(whole.difference(own).buffer(-_STRAIGHT))):
                return False
        return deepest([placed(hull, self.goal)], self.fixed.pieces) < _STRAIGHT

    @cached_property
    def room_to_turn(self) -> float:
        """How far the part may turn in the mouth, rad, until its tool comes near what stands around."""
        if not self.problem.cell.solids:
            return math.inf
        goal = self.goal.vector()
        poses = begun(np.array([[*goal[:2], 0.0, *goal[3:]], goal]), np.zeros((2, 6)))
        clear = KeptClear(self.bodies, self.problem.cell, poses)
        return _ROOM * float(clear.least.min()) / clear.reach - _OVERSHOOT

    @property
    def steady_force(self) -> float:
        """Force of the last press, N, about; the rest of the limit is for impacts and friction."""
        return _STEADY * self.problem.specification.contact_force

    @property
    def keeps_attitude(self) -> bool:
        """Whether its attitude can be held all the way in: its error is less than the play at the depth."""
        return float(self.box[3:5].max()) < 2.0 * self.clearance.per_side / self.depth

    @cached_property
    def turned_flat(self) -> tuple[bool, bool]:
        """Whether the last press turns the part flat about x and about y, whatever the torque is off by.

        About other axes the attitude is held, which has to leave the part within its clearance of the goal.
        """
        if self.landing.is_empty:
            return False, False
        west, south, east, north = self.landing.bounds
        arms, least = np.array([min(-south, north), min(-west, east)]), _SURE * self.problem.robot.torque_offset
        found = (self.steady_force * arms > least) | (self.box[3:5] * arms > self.clearance.per_side)
        return bool(found[0]), bool(found[1])

    @cached_property
    def landing(self) -> BaseGeometry:
        """Where the seated part stands on the fixed one, m; empty where nothing stops it."""
        from shapely import union_all

        stops = np.array(self._levels(self.fixed))
        heights = [z for z in self._levels(self.moving) if np.abs(z - self.depth - stops).min() < _LEVEL]
        below = (section_limit(self.fixed.bodies, _level(z - self.depth - _LEVEL), -1) for z in heights)
        above = (self._seated(section_limit(self.moving.bodies, _level(z + _LEVEL), 1)) for z in heights)
        return union_all([a.intersection(b) for a, b in zip(above, below, strict=True)])

    @cached_property
    def symmetry(self) -> int:
        """Number of turns about the axis that take the outline to itself."""
        from shapely.affinity import rotate

        least = 0.1 * self.clearance.per_side * float(self.outline.length)
        for count in range(_MAX_SYMMETRY, 1, -1):
            turned = rotate(self.outline, 360.0 / count, origin=(0.0, 0.0))
            if float(turned.symmetric_difference(self.outline).area) < least:
                return count
        return 1

    @cached_property
    def edges(self) -> tuple[tuple[Array, Array, Array], ...]:
        """Outward normal (2,) and both ends (2,), m, of each edge of the mouth, counter-clockwise."""
        from shapely.geometry.polygon import orient

        ring = np.array(orient(self.mouth.simplify(_STRAIGHT)).exterior.coords)
        sides = [(b - a, a, b) for a, b in pairwise(ring)]
        return tuple((np.array([v[1], -v[0]]) / np.linalg.norm(v), a, b) for v, a, b in sides)

    @cached_property
    def corners(self) -> tuple[Corner, ...]:
        """Corners of the mouth on its convex hull, sharpest first."""
        from shapely import Point

        hull, found = self.mouth.convex_hull.exterior, []
        for (before, _, at), (after, *_) in pairwise((self.edges[-1], *self.edges)):
            if before[0] * after[1] - before[1] * after[0] > 0.0 and hull.distance(Point(at)) < _STRAIGHT:
                mean = before + after
                turn = math.acos(float(np.clip(before @ after, -1.0, 1.0)))
                found.append(Corner(at, np.array([before, after]), math.atan2(mean[1], mean[0]), turn))
        return tuple(sorted(found, key=lambda corner: (-round(corner.turn, 6), corner.angle)))

    @property
    def few_corners(self) -> tuple[Corner, ...]:
        """The sharpest corner, and some of the others in their order."""
        return (*self.corners[:1], *self.corners[1 :: max((len(self.corners) - 1) // (_FEW - 1), 1)])[:_FEW]

    @cached_property
    def shelves(self) -> tuple[Shelf, ...]:
        """Shelves in the order that they are met."""
        met, depth, eps, tip = [], self.depth, _LEVEL, self._levels(self.moving)[0] + self.ahead
        for own in (tip, *(z for z in self._levels(self.moving) if tip + eps < z < depth)):
            grows = own == tip or self._outline(own + eps).area > 1.01 * self._outline(own - eps).area
            for other in (*(z for z in self._levels(self.fixed) if -depth + eps < z < -eps), 0.0):
                gone = own - other
                if not grows or not tip + eps < gone < depth - eps:
                    continue
                above = self._play(own + eps, other + eps) if other < 0.0 else self._play(own - eps, other - eps)
                engaged = self.engaged(gone)
                if self._play(own + eps, other - eps) < _PLAY_DROP * above and engaged is not None:
                    met.append((gone, engaged.middle, engaged.high - engaged.low))
        return tuple(Shelf(*one) for one in sorted(met))

    def engaged(self, gone: float) -> Engaged | None:
        """The walls that guide the part whose origin is so far below the mouth, m; None before its tip is inside."""
        tip = self._levels(self.moving)[0] + self.ahead
        heights = np.linspace(tip + _LEVEL, gone - _LEVEL, _HEIGHTS)
        if heights[-1] <= heights[0]:
            return None
        plays = np.array([self._play(h, h - gone) for h in heights])
        walls = heights[plays < 1.1 * plays.min() + 1e-7]
        return Engaged(float(walls[0]), float(walls[-1]), float(walls.mean()), float(plays.min()))

    def way_to_walls(self, shelf: Shelf, u: Array) -> float:
        """How far the part that stands on a shelf goes in a direction (3,) from its middle to the walls, m."""
        from shapely.affinity import translate

        own, opening = self._outline(shelf.lever), self._opening(shelf.lever - shelf.gone)
        low, high = 0.0, self.size
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            inside = opening.contains(translate(own, middle * u[0], middle * u[1]))
            low, high = (middle, high) if inside else (low, middle)
        return low

    @property
    def bodies(self) -> Bodies:
        """Both parts as the engine takes them."""
        body = self.moving.polyhedron
        balls = tuple((body.vertices[n], radius) for n, radius in body.balls)
        moving, fixed = (tuple(piece.vertices for piece in part.pieces) for part in (self.moving, self.fixed))
        found = Bodies(moving, fixed, balls)
        return found.filled() if self.filled else found

    @property
    def seat(self) -> Seat:
        """What counts as seated."""
        rho = characteristic_length(self.problem, self.clearance)
        loose = float(self.box[2]) if self.through else 0.0
        goal = numbers(self.problem.goal)
        return Seat(goal, self.clearance.per_side, self.depth, rho, loose, self.round, self.symmetry)

    def _outline(self, z: float) -> Polygon:
        """The largest outline of the moving part at a height in its own frame, m, as it is seated."""
        from shapely import Polygon

        shapes = section_limit(self.moving.bodies, _level(z), 1).geoms
        return self._seated(Polygon(max(shapes, key=lambda shape: float(shape.area)).exterior if shapes else None))

    def _seated(self, shape: BaseGeometry) -> BaseGeometry:
        """A section of the moving part as it is seated."""
        from shapely.affinity import affine_transform

        R, p = self.goal.R, self.goal.p
        return affine_transform(shape, [R[0, 0], R[0, 1], R[1, 0], R[1, 1], p[0], p[1]])

    def _opening(self, z: float) -> Polygon:
        """The opening of the fixed part just below a height, m: what of the plane around the axis has no material."""
        from shapely import Point, Polygon, box

        reach = 4.0 * float(np.abs(self.outline.bounds).max()) + 4.0 * float(self.box[0] + self.box[1])
        material = section_limit(self.fixed.bodies, _level(z), -1)
        free = box(-reach, -reach, reach, reach).difference(material)
        axis = Point(self.outline.centroid)
        found: Polygon = min(getattr(free, "geoms", [free]), key=lambda shape: float(shape.distance(axis)))
        return Polygon(found.exterior)

    def _play(self, own: float, other: float) -> float:
        """Distance between the outline at a height of the moving part and the opening at one of the fixed part, m."""
        return float(self._outline(own).exterior.distance(self._opening(other).exterior))

    @staticmethod
    def _levels(part: Part) -> list[float]:
        return sorted({round(float(z), 8) for body in part.bodies for z in body.vertices[:, 2]})


def _level(z: float) -> Pose:
    return Pose(np.array([0.0, 0.0, z]), np.eye(3))


def _rectangle(shape: Polygon) -> list[Array]:
    """The sides (2,) of the least rectangle about a shape, m, the longer one first."""
    sides = np.diff(np.array(shape.minimum_rotated_rectangle.exterior.coords), axis=0)[:2]
    return sorted(sides, key=lambda side: -round(float(np.linalg.norm(side)), 9))
