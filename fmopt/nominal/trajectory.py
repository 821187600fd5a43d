"""The nominal trajectory P(t) of an insertion along the mating axis, [LeeHuang1985] section 4.1.1, step 3."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from fmopt.errors import GeometryError
from fmopt.se3 import Pose, turns
from fmopt.values import Array, Value, frozen


@dataclass(frozen=True, eq=False)
class NominalTrajectory(Value):
    """P(t), piecewise linear in the six numbers (x, y, z, r) of the moving part's pose in the B-frame.

    Args:
        nodes: poses (n, 6), m and rad; neighbouring rotation vectors belong to one branch, |r| may exceed π.
        times: (n,), s, from 0 up, no two equal.
    """

    nodes: Array
    times: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "nodes", frozen(self.nodes, None, 6, name="nodes"))
        object.__setattr__(self, "times", frozen(self.times, len(self.nodes), name="times"))
        if len(self.times) < 2 or self.times[0] != 0.0 or np.any(np.diff(self.times) <= 0.0):
            raise ValueError(f"the times of a trajectory start at 0 and grow, not {self.times}")

    @property
    def duration(self) -> float:
        """T, s."""
        return float(self.times[-1])

    def at(self, t: float) -> Array:
        """P(t) as six numbers (x, y, z, r) in m and rad; before 0 and after T the part rests."""
        return np.array([np.interp(t, self.times, self.nodes[:, axis]) for axis in range(6)])

    def pose(self, t: float) -> Pose:
        """P(t) as a pose."""
        return Pose.from_vector(self.at(t))

    def frames(self, times: Array) -> tuple[Array, Array]:
        """Positions (n, 3) in m and rotation matrices (n, 3, 3) at times (n,)."""
        P = np.stack([np.interp(times, self.times, self.nodes[:, axis]) for axis in range(6)], axis=-1)
        return P[:, :3], turns(P[:, 3:])


def insertion(start: ArrayLike, goal: ArrayLike, speed: float, rho: float, turned: float = 1.0) -> NominalTrajectory:
    """The paper's three nodes: N₁ above the mouth, N₂ on the axis in the mouth's plane, N_T seated.

    The orientation of the goal is reached at N₂, or before it. Each leg is as long as ‖ΔP‖ = √(|Δp|² + ρ²|Δr|²) and
    takes that over the speed, so that no point within ρ of the reference point's axis of turning outruns the
    specification.

    Args:
        start: pose (6,) in the B-frame, m and rad, not below the mouth's plane z = 0.
        goal: pose (6,), below that plane.
        speed: of the specification, m/s.
        rho: characteristic length, m.
        turned: share of the way from N₁ to N₂ after which the goal's orientation is reached, above 0, at most 1; below
            1 it is one more node, where the part turns.

    Raises:
        GeometryError: the goal is not inside the hollow feature, or the start not outside.
    """
    first, last = np.asarray(start, dtype=np.float64).copy(), np.asarray(goal, dtype=np.float64)
    if last[2] >= 0.0:
        raise GeometryError(
            f"the goal lies {last[2]:.6g} m above the mouth of the hollow feature, where nothing is inserted",
            "give a goal with z below 0 in the B-frame, whose z points out of the mouth",
        )
    if first[2] < 0.0:
        raise GeometryError(
            f"the start lies {-first[2]:.6g} m below the mouth of the hollow feature",
            "give a start with z of 0 or more in the B-frame",
        )
    return through([first[:3], np.zeros(3), last[:3]], first[3:], last[3:], speed, rho, (0, turned))


def through(
    positions: Sequence[ArrayLike],
    start_turn: ArrayLike,
    goal_turn: ArrayLike,
    speed: float,
    rho: float,
    turned: tuple[int, float] = (0, 1.0),
) -> NominalTrajectory:
    """P(t) through position nodes N₁ … N_T, its orientation nodes M, and its times.

    The part turns on one leg, evenly, from its start up to a share of it; before it has the start's orientation, after
    it the goal's.

    Args:
        positions: nodes (3,) in m.
        start_turn: M₁, rotation vector (3,), rad.
        goal_turn: M_T.
        speed: of the specification, m/s.
        rho: characteristic length, m.
        turned: the leg on which the part turns, from 0, and the share of it, above 0, at most 1.

    Raises:
        ValueError: there is no such leg, or no such share.
    """
    points = [np.asarray(position, dtype=np.float64) for position in positions]
    leg, share = turned
    if not (0 <= leg < len(points) - 1 and 0.0 < share <= 1.0):
        raise ValueError(f"a part cannot turn on the share {share} of leg {leg} of {len(points) - 1}")
    last = np.asarray(goal_turn, dtype=np.float64)
    first = nearest_branch(np.asarray(start_turn, dtype=np.float64), last)
    nodes = [np.concatenate([point, first if k <= leg else last]) for k, point in enumerate(points)]
    if share < 1.0 and np.any(first != last):
        nodes.insert(leg + 1, np.concatenate([points[leg] + share * (points[leg + 1] - points[leg]), last]))
    steps = np.diff(nodes, axis=0)
    lengths = [float(np.hypot(np.linalg.norm(d[:3]), rho * np.linalg.norm(d[3:]))) for d in steps]
    kept = [nodes[0], *(node for node, length in zip(nodes[1:], lengths, strict=True) if length > 0.0)]
    times = np.cumsum([length for length in lengths if length > 0.0]) / speed
    return NominalTrajectory(np.array(kept), np.concatenate([[0.0], times]))


def nearest_branch(r: Array, target: Array) -> Array:
    """Of the rotation vectors (3,) r + 2πk r/|r| that mean one rotation, the one nearest to `target` (3,), rad."""
    angle = float(np.linalg.norm(r))
    if angle == 0.0:
        return r
    choices = [r * (1.0 + 2.0 * np.pi * k / angle) for k in (0, -1, 1)]
    return min(choices, key=lambda choice: float(np.linalg.norm(choice - target)))
