"""Where the tip comes down: inside the mouth for every start error, each wall one row of a linear program."""

from __future__ import annotations

import math

import numpy as np
from scipy.optimize import linprog

from fmopt.errors import SearchError
from fmopt.planning.press.task import Corner, PressTask
from fmopt.spatial.se3 import Pose, exp
from fmopt.spatial.values import Array

_HEIGHT = 0.05  # of the size, from the lowest point for every error to the mouth
_LOW = 0.02  # of the tilted height of the tip, by which vertices count as lowest
_FAR = 1.1  # times its support that the tip keeps from walls that it is not pressed against
_SURE = 1.05  # likewise from those that it is
_LEANING = 0.8  # likewise beyond what the part leans out by
_TIPS = 0.35  # of the height of the outline's middle over the tip, up to which vertices go into the mouth with it
_AHEAD = 0.3  # cosine of the angle between the way to the corner and a wall's normal, from which going back makes room
_NEAR = 0.1  # of the size, from a seat to the walls that are at it


def attitude(lean: float, tilt: float) -> Array:
    """Rotation matrix (3, 3) of a part that leans by `tilt` with its low side in direction `lean`, rad."""
    return exp(tilt * np.array([-math.sin(lean), math.cos(lean), 0.0]))


def low_vertex(task: PressTask, R: Array, towards: Array) -> Array:
    """The lowest vertex (3,) of the tip in an attitude, of several the one farthest in a direction (2,)."""
    tips = task.tip @ R.T
    spread = max(float(np.ptp(tips[:, 2])), 1e-9)
    low = tips[:, 2] <= tips[:, 2].min() + _LOW * spread
    return np.asarray(task.tip[low][int(np.argmax((tips[low, :2] @ towards).round(9)))])


def support(task: PressTask, direction: Array, arm: Array) -> float:
    """How far start errors move a point in a unit direction (3,) at most, m, by its arm (3,), m, both in axes of B."""
    return float(np.abs(direction) @ task.box[:3] + np.abs(np.cross(arm, direction)) @ task.box[3:])


def corner_entry(
    task: PressTask, corner: Corner, tilt: float, lean: float, distance: float, below: float, yaw: float = 0.0
) -> tuple[Pose, float, float]:
    """The tip beside a corner: at a distance (m) from its walls, inside of all others, for every start error.

    The part leans out over the mouth still where its tip is `below` it, m; angles are in rad, yaw is from the goal.
    Returns the pose, the way of its lowest point to the mouth's plane, m, and the share of the wanted distances from
    walls that all keep, less than one in too narrow a mouth.

    Raises:
        SearchError: the mouth leaves no place.
    """
    from shapely import LineString, Point

    R = attitude(lean, tilt) @ exp(np.array([0.0, 0.0, yaw])) @ task.goal.R
    u, leaning = (np.array([math.cos(angle), math.sin(angle)]) for angle in (corner.angle, lean))
    tip = low_vertex(task, R, u)
    own = (task.goal.R @ tip + task.goal.p)[:2]
    edges = [edge for edge in task.edges if not any(edge[0] @ wall > 1.0 - 1e-6 for wall in corner.walls)]
    walls, offsets, wanted = [], [], []
    for vertex in (tip, *task.tip[(task.tip != tip).any(axis=1)]):
        high, aside = float((R @ (vertex - tip))[2]), (R @ (vertex - tip))[:2]
        if high > _TIPS * 0.5 * task.size * math.sin(tilt):  # it may land on the rim
            continue
        seat = (task.goal.R @ vertex + task.goal.p)[:2]
        rows = [(n, float(n @ own), bool(n @ seat < n @ own + 1e-6), True) for n in corner.walls]
        # Walls that the seat is not inside of belong to other arms of the mouth.
        rows += [
            (n, float(n @ a), LineString((a, b)).distance(Point(seat)) < _NEAR * task.size, False)
            for n, a, b in edges
            if n @ seat <= n @ a
        ]
        for normal, offset, near, pressed in rows:
            # Beside a vertex that is not the tip no way back from the corner makes room, nor far from it.
            if vertex is not tip and (normal @ u < _AHEAD or not near):
                continue
            off = support(task, np.append(normal, 0.0), R @ vertex)
            out = (below - max(high, 0.0)) * math.tan(tilt) * max(float(normal @ leaning), 0.0)
            walls.append(normal)
            offsets.append(offset - float(normal @ aside))
            keeps = max(_SURE * off, out + _LEANING * off) if pressed else _FAR * off
            wanted.append(max(keeps, distance) if pressed and vertex is tip else keeps)
    place, share = _placed(np.array(walls), np.array(offsets), np.array(wanted))
    height = lowest_height(task, R, tip)
    return Pose(np.append(place, height) - R @ tip, R), height, share


def lowest_height(task: PressTask, R: Array, tip: Array) -> float:
    """Height of the tip over the mouth at which no start error takes the part below, with some room, m."""
    down = np.array([0.0, 0.0, -1.0])
    drop = max(support(task, down, R @ vertex) - float((R @ (vertex - tip))[2]) for vertex in task.tip)
    return max(_HEIGHT * task.size + max(drop, 0.0), task.problem.approach) + task.ahead


def _placed(walls: Array, offsets: Array, wanted: Array) -> tuple[Array, float]:
    """The place (2,) that keeps the largest share, up to one, of its distances; then the one nearest to two walls."""
    bounds = [(None, None), (None, None), (None, 1.0)]
    rows = np.hstack([walls, wanted[:, None]])
    first = linprog([0.0, 0.0, -1.0], A_ub=rows, b_ub=offsets, bounds=bounds, method="highs")
    if first.x is None or first.x[2] <= 0.0:
        raise SearchError("the mouth leaves no place for the tip", "lower the start errors")
    share = float(first.x[2]) - 1e-9
    second = linprog(
        -walls[:2].sum(axis=0), A_ub=walls, b_ub=offsets - share * wanted, bounds=[(None, None)] * 2, method="highs"
    )
    return np.array(first.x[:2] if second.x is None else second.x), share
