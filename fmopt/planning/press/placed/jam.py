"""Sets of contacts that errors can reach together, and the largest friction that jams the part on none of them.

To first order distances are linear in the pose, so that the poses that errors reach are a polytope; contacts that touch
at one of its vertices are a set that no other one of them can join. An escape from a set is one from each of its
subsets.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fmopt.plan.press_rows import FREE_OF_JAMS
from fmopt.planning.press.placed.touches import PressWrench, Touches, frictions, largest_friction
from fmopt.spatial.values import Array

_MOST = 1024  # sets that are looked at, nearest first
_TOUCHING = 1e-3  # of the clearance, within which a contact touches at a vertex
_NARROW = 1e-9  # of its widest interval, below which a coordinate is none


@dataclass(frozen=True, eq=False)
class Jam:
    """The largest friction without a jam, the contacts that jam next, how many sets were looked at and left out.

    `friction` is −1 where the part can rest without any; `twist` (6,) escapes from these contacts up to it.
    """

    friction: float
    contacts: tuple[str, ...]
    twist: Array
    sets: int
    left_out: int


def jam(sets: Sequence[frozenset[int]], touches: Touches, push: PressWrench) -> Jam:
    """The largest friction that jams the part on none of some sets of contacts, nearest first."""
    least, twist, contacts, known = FREE_OF_JAMS, np.zeros(6), tuple[str, ...](), np.zeros((0, len(touches)))
    for one in sets[:_MOST]:
        at = sorted(one)
        if (known[:, at].min(axis=1) >= least).any():
            continue
        held = touches.some(at)
        friction, way = largest_friction(held, push, least)
        known = np.vstack([known, frictions(touches, push, way)])
        if friction < least:
            least, twist, contacts = friction, way, held.names
        if least < 0.0:
            break
    return Jam(least, contacts, twist, min(len(sets), _MOST), max(len(sets) - _MOST, 0))


def reached_sets(touches: Touches, box: Array, along: Array, clearance: float) -> list[frozenset[int]]:
    """Sets of contacts that poses of a box can touch together, those with the shortest way there first.

    The box has half-widths (6,), m and rad, about the pose of the contacts; `along` is the gradient (6,) of what stays
    as it is there, such as the progress of a press, 0 for nothing. The clearance is a side, m.
    """
    vertices = _vertices(touches, box, along)
    sets = dict[frozenset[int], float]()
    with np.errstate(divide="ignore", invalid="ignore"):
        way = np.nan_to_num(np.abs(vertices / box), nan=0.0).max(axis=1, initial=0.0)
    for f, far in zip(touches.f + vertices @ touches.N.T, way, strict=True):
        one = frozenset(np.flatnonzero(f < _TOUCHING * clearance).tolist())
        sets[one] = min(sets.get(one, np.inf), float(far))
    most = [one for one in sets if one and not any(one < other for other in sets)]
    return sorted(most, key=lambda one: (round(sets[one], 9), sorted(one)))


def _vertices(touches: Touches, box: Array, along: Array) -> Array:
    """Vertices (n, 6) of the poses of a box at which no distance is negative."""
    from scipy.optimize import linprog
    from scipy.spatial import HalfspaceIntersection, QhullError

    axes = np.flatnonzero(box > _NARROW * box.max())
    # Within what stays as it is: an orthogonal basis of the scaled coordinates.
    basis = np.diag(box)[:, axes]
    if np.linalg.norm(along @ basis) > 0.0:
        basis = basis @ np.linalg.svd((along @ basis)[None])[2][1:].T
    walls = np.vstack([-touches.N @ basis, basis[axes] / box[axes, None], -basis[axes] / box[axes, None]])
    offsets = np.concatenate([touches.f, np.ones(2 * len(axes))])
    size = np.linalg.norm(walls, axis=1)
    walls, offsets = walls[size > 0.0] / size[size > 0.0, None], offsets[size > 0.0] / size[size > 0.0]
    n = walls.shape[1]
    room = linprog(
        np.append(np.zeros(n), -1.0), A_ub=np.hstack([walls, np.ones((len(walls), 1))]), b_ub=offsets,
        bounds=[(None, None)] * n + [(None, 1.0)],
    )  # fmt: skip
    if room.x is None or room.x[-1] <= _NARROW:
        return np.zeros((0, 6))
    cut = np.hstack([walls, -offsets[:, None]])
    try:
        found = HalfspaceIntersection(cut, room.x[:-1]).intersections
    except QhullError:  # walls that are nearly one are told apart by a joggle
        found = HalfspaceIntersection(cut, room.x[:-1], qhull_options="QJ").intersections
    return np.asarray(np.unique(found.round(9), axis=0) @ basis.T)
