"""Recovery as a plan says it: which start to try next when a move failed, and the way of the part back to it.

The robot knows how its own part has moved since it began, not by what it was off: heights are those of the commanded
start and of the motion since, and a new start is the old one, shifted.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from fmopt.execution.rotation import between, from_quaternions, product, quaternions
from fmopt.plan import Plan
from fmopt.spatial.se3 import Pose
from fmopt.spatial.values import Array, Bits, Value

EARLY, LATE = "early", "late"  # the part stands before its travel is used up; it is used up, and nothing was felt
_SPEED = 0.05  # m/s and
_TURNING = 0.5  # rad/s, with nothing in the way
_REST = 0.2  # s in which the part comes to rest at its new start
_THERE = (5e-4, 5e-3)  # m and rad, by which it may then be off


@dataclass(frozen=True, eq=False)
class Recovery(Value, shifts=(None, 3), points=(None, 3)):
    """What a plan says of recovery."""

    above: float  # m in B, above which the part's lowest point has to lie for it to be lifted
    clear: float  # m in B, to which that is lifted before it is carried
    turn: float  # rad, the furthest that the part may be turned back
    sunk: float  # m, by how much start errors may lower points of the part
    shifts: Array  # of the start (k, 3), m
    orders: tuple[Mapping[str, tuple[int, ...]], ...]  # of them, for each move, after it failed `EARLY` or `LATE`
    start: Pose
    points: Array
    radii: Array  # of the balls about them (v,), m, 0 of those that are points

    @staticmethod
    def of(plan: Plan) -> Recovery | None:
        """The recovery of a plan; None where it has none, or nothing to try."""
        said = plan.recovery
        if said is None or said.lift is None or not said.retries:
            return None
        points, box = np.array(plan.moving.body.vertices), np.array(plan.start_box)
        radii = np.zeros(len(points))
        for vertex, radius in plan.moving.body.balls:
            radii[vertex] = radius
        reach = float((np.linalg.norm(points, axis=1) + radii).max())
        # A turn δ moves a point w by δ × w and at most |w||δ|²/2 more; only tilts lower it to first order.
        sunk = box[2] + reach * (box[3] + box[4] + 0.5 * float(box[3:] @ box[3:]))
        shifts = np.array(said.retries)[:, :3]  # they turn nothing, which the check of a plan sees to
        orders = tuple({EARLY: move.early, LATE: move.late} for move in said.moves)
        lift, start = said.lift, Pose.from_vector(plan.segments[0].start)
        return Recovery(lift.above, lift.clear, lift.turn, float(sunk), shifts, orders, start, points, radii)

    def next(self, move: int, felt: str, tried: Sequence[int]) -> int | None:
        """The shift to try after a move failed; None when all have been tried."""
        return next((k for k in self.orders[move][felt] if k not in tried), None)

    def lowest(self, q: Array, begun: Array, at: Array) -> float:
        """The commanded height (m) of the part's lowest point, turned by `at` (4,), at a pose (7,) begun at another."""
        turned = from_quaternions(product(at, begun[3:] * np.array([1.0, -1.0, -1.0, -1.0])))
        points = self.points @ (turned @ self.start.R).T
        return float(self.start.p[2] + q[2] - begun[2] + (points[:, 2] - self.radii).min())

    def liftable(self, q: Array, begun: Array) -> bool:
        """Whether the plan says that the part, begun at a pose (7,), m, can be lifted from another, and turned back."""
        turned = float(np.linalg.norm(between(q[3:], begun[3:])))
        return self.lowest(q, begun, q[3:]) - self.sunk > self.above and turned <= self.turn


@dataclass(frozen=True, eq=False)
class WayBack(Value):
    """Where n parts are led: up, over, down to their new start; each leg straight, at a constant rate, then a rest."""

    corners: Array  # positions (4, n, 3), m
    turned: Array  # quaternions (4, n, 4) there
    times: Array  # (4, n) at which they are reached, s, the first 0

    @staticmethod
    def of(recovery: Recovery, poses: Array, begun: Array, shifts: Sequence[int]) -> WayBack:
        """The ways of parts at poses (n, 7), begun at others (n, 7), to the starts with these shifts."""
        goal = begun[:, :3] + recovery.shifts[list(shifts)]
        # As it is turned, the lowest point is another one: each end of the way over has its own height.
        up = [recovery.clear - recovery.lowest(q, b, q[3:]) for q, b in zip(poses, begun, strict=True)]
        over = [recovery.clear - recovery.lowest(b, b, b[3:]) for b in begun]
        # Never down: who is clear already is carried as high as it is.
        lifted = poses[:, :3] + np.maximum(up, 0.0)[:, None] * np.array([0.0, 0.0, 1.0])
        carried = goal + np.maximum(over, 0.0)[:, None] * np.array([0.0, 0.0, 1.0])
        corners = np.stack([poses[:, :3], lifted, carried, goal])
        # It turns on the way over alone: out of the hole, and down to its start, the part goes straight.
        turned = np.stack([poses[:, 3:], poses[:, 3:], begun[:, 3:], begun[:, 3:]])
        ways = np.linalg.norm(np.diff(corners, axis=0), axis=2) / _SPEED
        turns = np.linalg.norm(between(turned[1:], turned[:-1]), axis=2) / _TURNING
        times = np.concatenate([np.zeros((1, len(poses))), np.cumsum(np.maximum(ways, turns), axis=0)])
        return WayBack(corners, turned, times)

    @property
    def ends(self) -> Array:
        """Times (n,) at which the parts are at rest at their new starts, s."""
        return np.asarray(self.times[-1] + _REST)

    def at(self, time: float) -> tuple[Array, Array, Array]:
        """Positions (n, 3), quaternions (n, 4) and twists (n, 6) of the references, m/s and rad/s, in axes of B."""
        n = np.arange(self.times.shape[1])
        leg = np.minimum((self.times[1:] <= time).sum(axis=0), len(self.times) - 2)
        span = self.times[leg + 1, n] - self.times[leg, n]
        # A leg of no length, as that up of a part that is clear, takes no time and has no rate.
        rate = np.where((time < self.times[-1]) & (span > 0.0), 1.0 / np.maximum(span, 1e-9), 0.0)
        share = np.clip((time - self.times[leg, n]) / np.maximum(span, 1e-9), 0.0, 1.0)[:, None]
        shift = self.corners[leg + 1, n] - self.corners[leg, n]
        turn = between(self.turned[leg + 1, n], self.turned[leg, n])
        p, q = self.corners[leg, n] + share * shift, product(quaternions(share * turn), self.turned[leg, n])
        return p, q, rate[:, None] * np.hstack([shift, turn])

    def arrived(self, poses: Array) -> Bits:
        """Which parts (n,) are at their new starts."""
        off = np.linalg.norm(poses[:, :3] - self.corners[-1], axis=1)
        turned = np.linalg.norm(between(poses[:, 3:], self.turned[-1]), axis=1)
        return np.asarray((off <= _THERE[0]) & (turned <= _THERE[1]), dtype=np.bool_)
