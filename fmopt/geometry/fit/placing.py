"""Placing outlines in the plane beside others for the greatest clearance, by programs over corners and sides.

The clearance of a placement is the least distance of any corner of the one to a side of the other, or of two corners;
where they overlap, minus how deep the deepest corner is in the other. Each program has a row for every corner before a
side: s ≤ d + g·(Δx, Δy, Δturn), with the distance d and its gradient g, solved by daqp in a trust region.
"""

from collections.abc import Sequence

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.affinity import affine_transform
from shapely.geometry.base import BaseGeometry

from fmopt.geometry.fit.layers import Outline
from fmopt.geometry.plane.turning import rotation
from fmopt.runtime.clock import heed
from fmopt.spatial.values import Array, Bits, Indices

_NONE = 1e30  # daqp's infinity
_CURVATURE = np.diag([1e-6, 1e-6, 1e-6, 1e-9])  # what daqp wants, and of steps that are as good the shortest
_SOLVED = 1
_STEPS = 60  # programs of one placement
_TOUCH = 1e-11  # m: nearer points have no direction from one to the other
_AHEAD = 4.0  # trust regions, by which rows that do not bind are asked too
_NEARBY = 0.3  # of how far corners are from the pivot: as near are sides to corners for which they are rows
_MANY = 150  # sides of an outline that moves: with more, sides are as much nearer
_FAR = 1.6  # times how far corners are from the pivot: material beyond that is left out
_GIVE = 1e-7  # of the size, by which rows that are held may give way
_BINDS = 1e-7  # of the size, by which rows that bind lie above the least one


class Facing:
    """An outline that moves, and material that it is placed beside."""

    def __init__(self, moving: Outline, material: Outline, pivot: Array) -> None:
        """Measure nothing yet; the pivot (2,) of the outline, m, is put at (x, y), and the outline turned about it."""
        self.pivot, self._material = pivot, material.shape
        self._own_sides, self._material_sides = moving.sides, material.sides
        self._own, self._walls = (moving.start - pivot, moving.end - pivot), (material.start, material.end)
        self._shape = moved(moving.shape, pivot, np.zeros(3))
        shapely.prepare(self._shape)
        self._arm = float(np.hypot(*self._own[0].T).max())
        self._reach = _NEARBY * self._arm * min(1.0, _MANY / len(moving.start))
        self._about: Array | None = None

    def rows(self, at: Array) -> tuple[Array, Array, NDArray[np.int64]]:
        """Signed distances (n,), m, at x, y (m) and turn (rad), gradients (n, 3) by these, numbers (n,) of pairs."""
        turn = rotation(float(at[2]))
        start, end = (corners @ turn.T + at[:2] for corners in self._own)
        walls = self._walls
        back = (walls[0] - at[:2]) @ turn
        within = shapely.contains_xy(self._material, start), shapely.contains_xy(self._shape, back)
        sides = ((start, walls, within[0], 1.0), (walls[0], (start, end), within[1], -1.0))
        if self._about is None or self._far(at) > 0.25 * self._reach:
            self._about = at
            far = np.hypot(*back.T)
            near = far <= max(_FAR * self._arm, float(far.min()))
            every = np.ones(len(start), dtype=np.bool_)
            self._pairs = (
                _close(start, every, self._material_sides, self._reach),
                _close(back + self.pivot, near, self._own_sides, self._reach),
            )
        found = [_distances(*side, at, pairs) for side, pairs in zip(sides, self._pairs, strict=True)]
        distance, gradient, number = zip(*found, strict=True)
        return (
            np.concatenate(distance),
            np.vstack(gradient),
            np.concatenate([number[0], number[1] + len(start) * len(walls[0])]),
        )

    def _far(self, at: Array) -> float:
        """How far corners have moved at most since the pairs were chosen, m."""
        assert self._about is not None
        step = at - self._about
        return float(np.hypot(*step[:2])) + self._arm * abs(float(step[2]))


Sides = tuple[Array, Array]
Pairs = tuple[Indices, Indices]


def _close(points: Array, used: Bits, sides: shapely.STRtree, reach: float) -> Pairs:
    """Used points (n, 2) and sides that may come to be the nearest while both move by a quarter of `reach` (m)."""
    points, at = points[used], np.flatnonzero(used)
    _, far = sides.query_nearest(shapely.points(points), return_distance=True, all_matches=False)
    around = np.maximum(far + 0.5 * reach, reach)[:, None]
    i, j = sides.query(shapely.box(*(points - around).T, *(points + around).T))
    return at[i], j


def _distances(
    points: Array, sides: Sides, within: Bits, sign: float, at: Array, pairs: Pairs
) -> tuple[Array, Array, NDArray[np.int64]]:
    """Rows of points (n, 2) before sides (m, 2): of each the nearest side, and those it lies square in front of.

    Args:
        within: whether each point is on the other side, in what the sides bound.
        sign: 1 where the points move, −1 where the sides do.
    """
    i, j = pairs
    along = sides[1] - sides[0]
    length = np.hypot(*along.T)
    along = (along / length[:, None])[j]
    ahead = points[i] - sides[0][j]
    share = np.clip(np.vecdot(ahead, along), 0.0, length[j])
    off = ahead[:, 0] * along[:, 1] - ahead[:, 1] * along[:, 0]
    way = ahead - share[:, None] * along
    distance = np.hypot(way[:, 0], way[:, 1])
    first = np.flatnonzero(np.append(True, np.diff(i) > 0))  # every point has a pair, in their order
    least = np.minimum.reduceat(distance, first)[np.cumsum(np.append(False, np.diff(i) > 0))]
    used = ((off > 0.0) & (share > 0.0) & (share < length[j]) & ~within[i]) | (distance == least)
    i, j, way, far, along = i[used], j[used], way[used], distance[used], along[used]
    inside = within[i]
    # A point on a side goes away from it along the side's normal.
    out = np.where((far > _TOUCH)[:, None], way / np.maximum(far, _TOUCH)[:, None], 0.0)
    out = np.where(inside[:, None], -out, out)
    out = np.where((far > _TOUCH)[:, None], out, np.column_stack([along[:, 1], -along[:, 0]]))
    arm = (points[i] if sign > 0.0 else points[i] - way) - at[:2]
    g = sign * out
    gradient = np.column_stack([g, arm[:, 0] * g[:, 1] - arm[:, 1] * g[:, 0]])
    return np.where(inside, -far, far), gradient, i * len(length) + j


def moved(shape: BaseGeometry, pivot: Array, at: Array) -> BaseGeometry:
    """A plane shape turned about a pivot (2,) and put with it at x, y, m, by at (3,)."""
    R = rotation(float(at[2]))
    shift = at[:2] - R @ pivot
    return affine_transform(shape, [*R.ravel().tolist(), *shift.tolist()])


class OutlinePlacement:
    """Outlines placed beside material together, from where they are on to where they have the greatest clearance."""

    def __init__(self, facing: Sequence[Facing], at: Array, size: float, tolerance: float) -> None:
        """Placed as they are.

        Args:
            at: (3,), x, y in m and turn in rad.
            size: of the outlines, m, on which a turn moves their corners.
            tolerance: of the clearance, m.
        """
        self.facing, self.size, self.tolerance = facing, size, tolerance
        self._held = dict[int, float]()
        self._put(np.array(at, dtype=float))

    def _put(self, at: Array) -> None:
        self.at = at
        rows = [facing.rows(at) for facing in self.facing]
        self._far, self._slope = np.concatenate([row[0] for row in rows]), np.vstack([row[1] for row in rows])
        self._number = np.concatenate([row[2] + (k << 40) for k, row in enumerate(rows)])
        held = self._held
        self._kept = np.array([held.get(n, -np.inf) for n in self._number.tolist()] if held else [-np.inf])
        self._kept = np.broadcast_to(self._kept, self._far.shape)
        self._free = ~np.isfinite(self._kept)
        self.clearance = float(self._far[self._free].min(initial=self.size))

    def improved(self, trust: float) -> "OutlinePlacement":
        """Itself, moved to the greatest clearance nearby, in steps of at most `trust` (m) to begin with."""
        for _ in range(_STEPS):
            heed()
            found = self._step(trust)
            if found is None:
                trust *= 0.4
                continue
            step, promised = found
            before, best = self.at, self.clearance
            if promised < best + 0.1 * self.tolerance:
                break
            self._put(before + step)
            if self.clearance > best + 0.01 * self.tolerance and not self._breaks():
                trust = min(1.5 * trust, 0.2 * self.size) if self.clearance > best + self.tolerance else 0.1 * trust
            else:
                self._put(before)
                trust *= 0.3
            if trust < 10.0 * self.tolerance:
                break
        return self

    def hold(self) -> bool:
        """Keeps the distances that bind from now on, so that the others are raised; whether any are left."""
        binds = self._free & (self._far < self.clearance + _BINDS * self.size)
        self._held |= dict(zip(self._number[binds].tolist(), (self._far[binds] - _TOUCH).tolist(), strict=True))
        self._put(self.at)
        return bool(self._free.any())

    def _breaks(self) -> bool:
        held = ~self._free
        return bool((self._far[held] < self._kept[held] - _GIVE * self.size).any())

    def _step(self, trust: float) -> tuple[Array, float] | None:
        """The step (3,) to the greatest clearance, m, of the rows as they are linear here, within a trust region."""
        import daqp

        used = ~self._free | (self._far < self.clearance + _AHEAD * trust)
        room = (self._far - np.where(self._free, 0.0, self._kept))[used] / trust
        scale = np.array([1.0, 1.0, 1.0 / self.size])
        rows = np.column_stack([-self._slope[used] * scale, self._free[used].astype(float)])
        upper, lower = np.append([1.0, 1.0, 1.0, _NONE], room), np.append([-1.0] * 3, np.full(1 + len(room), -_NONE))
        sense = np.zeros(len(upper), dtype=np.int32)
        z, _, flag, _ = daqp.solve(_CURVATURE, np.array([0.0, 0.0, 0.0, -1.0]), rows, upper, lower, sense)
        return (np.asarray(z[:3]) * trust * scale, float(z[3]) * trust) if flag == _SOLVED else None
