"""Room on the way of a press: how far pieces that it does not slide along stay apart, whatever the error is."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

import numpy as np

from fmopt.geometry.clearance import axes_across, directions
from fmopt.geometry.polyhedron import Polyhedron
from fmopt.planning.optimise.cone_program import ConeProgram, Norm
from fmopt.planning.optimise.solvers import ClarabelSolver
from fmopt.planning.press.task import PressTask
from fmopt.spatial.se3 import Pose
from fmopt.spatial.values import Array

_OWN = 2.5  # clearances, within which pieces that a press slides along are on its way
_TURNED = 0.5  # length of a unit normal, below which the program has none


def least_room(task: PressTask, stations: Sequence[Pose], errors: Array) -> float | None:
    """The least room, m, at poses of a way for errors (6, g), a zonotope; None where there are no other pieces."""
    pairs = [*product(task.moving.pieces, task.fixed.pieces)]
    rooms = np.array([[room(*pair, pose, errors) for pair in pairs] for pose in stations])
    rooms[:, rooms[..., 1].min(axis=0) < _OWN * task.clearance.per_side] = np.inf
    least = np.inf
    for k in np.argsort(rooms[..., 0], axis=None).tolist():
        at, pair = divmod(k, len(pairs))
        bound = float(rooms[at, pair, 0])
        if bound >= least:
            break
        body, other = pairs[pair]
        least = min(least, max(bound, widest_room(body, other, stations[at], errors)))
    return least if np.isfinite(least) else None


def room(body: Polyhedron, other: Polyhedron, pose: Pose, errors: Array) -> tuple[float, float]:
    """The room between two convex pieces, m, for every error and without any, by planes along faces and edges."""
    across = axes_across(directions(body) @ pose.R.T, directions(other))
    kept, gaps = _rooms(np.vstack([other.normals, -body.normals @ pose.R.T, across]), body, other, pose, errors)
    return float(kept.max()), float(gaps.max())


def _rooms(axes: Array, body: Polyhedron, other: Polyhedron, pose: Pose, errors: Array) -> tuple[Array, Array]:
    """The room along unit normals (k, 3) of planes between the pieces, for every error and without any."""
    arms = body.vertices @ pose.R.T
    moved = np.abs(axes @ errors[:3] + np.cross(arms[:, None], axes[None]) @ errors[3:]).sum(axis=-1)
    nearest = (arms + pose.p) @ axes.T - np.array(body.radii)[:, None]
    far = (other.vertices @ axes.T).max(axis=0)
    return (nearest - moved).min(axis=0) - far, nearest.min(axis=0) - far


def widest_room(body: Polyhedron, other: Polyhedron, pose: Pose, errors: Array) -> float:
    """The room between two convex pieces, m, for every error: the plane with the most on either side, if there is one.

    A cone program proposes it, and the room along it is computed again; −inf where errors bring the pieces together.

    Over its normal n, its offset and the room: each vertex at an arm r, moved by an error (d, δ) by n·(d + δ × r),
    stays on its side; the support of the errors is a sum of |generator·row|.
    """
    arms, size = body.vertices @ pose.R.T, body.diameter
    V, Q, g = len(arms), len(other.vertices), errors.shape[1]
    rows = np.zeros((V + Q + 1, 5))
    rows[:V, :3], rows[:V, 3:] = arms + pose.p - other.vertices[0], -size
    rows[V:-1, :3], rows[V:-1, 3] = other.vertices[0] - other.vertices, size
    moved = errors[:3].T[None] + np.cross(errors[3:].T[None], arms[:, None])
    norms = [Norm(np.append(way, [0.0, 0.0])[None], np.zeros(1)) for way in moved.reshape(-1, 3)]
    norms.append(Norm(np.eye(3, 5), np.zeros(3)))
    W = np.zeros((len(rows), len(norms)))
    W[np.repeat(np.arange(V), g), np.arange(V * g)] = 1.0
    W[:V, -1], W[-1, -1] = body.radii, 1.0
    program = ConeProgram(np.eye(5)[-1], G=rows, h=np.append(np.zeros(V + Q), 1.0), W=W, norms=tuple(norms))
    n = ClarabelSolver().proposed(program)[:3]
    length = float(np.linalg.norm(n))
    return float(_rooms(n[None] / length, body, other, pose, errors)[0][0]) if length > _TURNED else -np.inf
