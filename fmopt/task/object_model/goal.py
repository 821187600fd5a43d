"""Goal states: six entries in the B-frame, some of them free, and how the free ones are settled.

A free entry that the lower pair constrains takes the pair's value; one that the pair leaves free keeps the start's: for
rotations the goal nearest to the start's orientation. The rotation entries are a rotation vector, as everywhere here.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import Literal, TypeAlias

import numpy as np

from fmopt.errors import TaskError
from fmopt.spatial.se3 import Pose, exp, log
from fmopt.spatial.values import Array
from fmopt.task.object_model.workcell import LowerPair

Free: TypeAlias = Literal["free"]
FREE: Free = "free"
Entry: TypeAlias = float | Free
Goal: TypeAlias = tuple[Entry, Entry, Entry, Entry, Entry, Entry]

ENTRIES = ("p_x", "p_y", "p_z", "q_x", "q_y", "q_z")
ON_AXIS = "the goal lies on the axis of the fixed feature"
INSERTED = "the goal of an insertion lies inside the hollow feature"
SETTLED = "a free entry is settled by the pair or by the start"
INSERTIONS: frozenset[LowerPair] = frozenset({"cylindrical", "prismatic", "screw", "revolute"})
# Entries that the pair holds at 0: the frames of the two feature-operands lie in one another so far.
HELD: dict[LowerPair, tuple[int, ...]] = {
    "cylindrical": (0, 1, 3, 4),
    "prismatic": (0, 1, 3, 4),
    "screw": (0, 1, 3, 4),
    "revolute": (0, 1, 3, 4),
    "planar": (2, 3, 4),
    "spherical": (0, 1, 2),
}
_NEAR = 1e-9  # m or rad
_GRID, _DESCENTS = 9, 4  # values of a free entry, 45° apart; how many of all are begun from


@dataclass(frozen=True)
class Settled:
    """How a free entry was settled: its name, its value in m or rad, and why."""

    entry: str
    value: float
    why: str

    def __str__(self) -> str:
        value = f"{math.degrees(self.value):.6g} deg" if self.entry[0] == "q" else f"{1e3 * self.value:.6g} mm"
        return f"{self.entry} is free: {value}, {self.why}"


def settle(goal: Goal, start: Pose, pair: LowerPair, seated: float, feature: str) -> tuple[Array, tuple[Settled, ...]]:
    """The goal (6,) in m and rad with its free entries settled, p_z at full depth as `seated`, and why.

    Raises:
        TaskError: an entry that is no finite number, or a free rotation that the start does not settle.
    """
    values = np.zeros(6)
    why = {}
    for i, entry in enumerate(goal):
        if entry != FREE:
            values[i] = float(entry)
            continue
        # A prismatic pair keeps any angle that is stated, so that it is not among what is held at 0.
        if i in HELD[pair] or (pair == "prismatic" and i == 5):
            why[i] = f"as the {pair} pair holds it"
        elif i == 2 and pair in INSERTIONS:
            values[i] = seated
            why[i] = "at full depth"
        elif i < 3:
            values[i] = start.p[i]
            why[i] = "as at the start"
    if not np.isfinite(values).all():
        raise TaskError(f"the goal {goal} holds a number that is not finite", feature, SETTLED, "give finite numbers")
    turning = [i for i, entry in enumerate(goal) if i >= 3 and entry == FREE and i not in why]
    if turning and pair == "screw":
        message = f"the goal of {feature!r} leaves {ENTRIES[turning[0]]} free, which the lead of the screw settles"
        raise TaskError(message, feature, SETTLED, "give the angle that goes with the depth")
    if turning:
        values[3:] = _nearest_rotation(values[3:], [i - 3 for i in turning], start.R, feature)
        why.update(dict.fromkeys(turning, "nearest to the orientation at the start"))
    values += 0.0  # no entry is −0
    return values, tuple(Settled(ENTRIES[i], float(values[i]), why[i]) for i in sorted(why))


def _nearest_rotation(fixed: Array, free: Sequence[int], start: Array, feature: str) -> Array:
    """The rotation vector with given entries but the free ones whose rotation is nearest to `start`.

    By local descents, from the nearest of a grid over the free entries and from the start's own; the best end counts.
    Of vectors that mean the same rotation the shortest is taken. Good to about 1e-8 rad, the distance being flat.
    """
    grid = np.array(list(product(np.linspace(-math.pi, math.pi, _GRID), repeat=len(free)))).reshape(-1, len(free))
    trials = np.tile(fixed, (len(grid) + 1, 1))
    trials[:, list(free)] = np.vstack([log(start)[list(free)], grid])
    nearest = sorted(range(1, len(trials)), key=lambda i: _distance(trials[i], start))[:_DESCENTS]
    ends = [_descend(trials[i], free, start) for i in (0, *nearest)]
    least = min(_distance(q, start) for q in ends)
    best = min((q for q in ends if _distance(q, start) <= least + _NEAR), key=lambda q: float(q @ q))
    # No rotations are more than π apart: then every goal is that far, and none the nearest.
    if _distance(best, start) > math.pi - 1e-6:
        names = ", ".join(ENTRIES[3 + i] for i in free)
        message = f"the start of {feature!r} is turned by 180 deg against every goal, which leaves {names} open"
        raise TaskError(message, feature, SETTLED, "give a number instead of free")
    return best


def _descend(q: Array, free: Sequence[int], start: Array) -> Array:
    """The rotation vector near one whose free entries bring its rotation the nearest to `start`."""
    from scipy.optimize import least_squares

    def error(entries: Array) -> Array:
        trial = np.array(q)
        trial[list(free)] = entries
        return log(exp(trial) @ start.T)

    found = np.array(q)
    found[list(free)] = least_squares(error, q[list(free)], xtol=1e-15, ftol=1e-15, gtol=1e-15).x
    return found


def _distance(q: Array, start: Array) -> float:
    return float(np.linalg.norm(log(exp(q) @ start.T)))


def check_goal(goal: Array, pair: LowerPair, deepest: float, sign: float, feature: str) -> None:
    """Checks a settled goal (6,) against its pair and how deep hole and peg allow, m and rad; `sign` is +1 up, −1 down.

    Raises:
        TaskError: the goal is off the axis, or not inside the hollow feature.
    """
    off = goal[list(HELD[pair])]
    if np.max(np.abs(off)) > _NEAR:
        worst = HELD[pair][int(np.argmax(np.abs(off)))]
        amount = f"{1e3 * goal[worst]:.6g} mm" if worst < 3 else f"{math.degrees(goal[worst]):.6g} deg"
        message = f"the goal of {feature!r} has {ENTRIES[worst]} = {amount}, which the {pair} pair holds at 0"
        raise TaskError(message, feature, ON_AXIS, "set it to 0, or leave it free")
    depth = sign * float(goal[2])
    if pair in INSERTIONS and not 0.0 < depth <= deepest + _NEAR:
        where = f"{1e3 * depth:.9g} mm inside, where at most {1e3 * deepest:.9g} mm can be"
        where = f"{-1e3 * depth:.6g} mm outside the mouth" if depth <= 0.0 else where
        advice = f"give p_z between 0 and {sign * 1e3 * deepest:.9g} mm, or leave it free"
        raise TaskError(f"the goal of {feature!r} is {where}", feature, INSERTED, advice)
