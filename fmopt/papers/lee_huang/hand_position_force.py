"""C-PF along the axes for the nominal trajectory, [LeeHuang1985] section 4.2: Pₐ(t) and Fₐ(t) from P(t) and S(t).

What the hand does: the motion of what is grasped, and the wrenches on it, from a plan of operand 1 in operand 2.

Where the hollow part is in the hand the plan moves the peg in the frame of the hole all the same, and the hand makes
the counterpart of that motion. Where the task gives the grasp transform H_ho the poses are those of the hand itself.

From the task that fits the assumptions back to the task that was given: poses, twists and wrenches.

Let X be the pose of operand 1 in the B-frame. When the operands were not exchanged, operand 1 is what the hand holds.
When they were, the hand holds operand 2, and its pose in the frame of operand 1, which stands still, is X⁻¹.
"""

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from fmopt.papers.lee_huang.nominal_trajectory import NominalTrajectory
from fmopt.plan.description import PositionForce
from fmopt.plan.diagnostics import Hand, HandMove, Interval
from fmopt.plan.field_types import numbers
from fmopt.plan.position_force import gamma, natural_constraints, omega
from fmopt.spatial.se3 import Pose
from fmopt.spatial.values import Array
from fmopt.task.object_model.command import Answer, grasped_pose


def position_force(path: NominalTrajectory, freedom: Sequence[Interval], f: ArrayLike) -> tuple[PositionForce, ...]:
    """C-PF: P(t) × S(t) → Pₐ(t) × Fₐ(t), one row for each stretch on which P is straight and S constant.

    S(t) is known on [0, T]; forces f (6,) are in N and N·m.
    """
    rows = []
    for interval in freedom:
        # Nodes within the interval part it, as P is straight only between them.
        inner = [float(t) for t in path.times if interval.start < t < interval.end]
        for a, b in pairwise([interval.start, *inner, interval.end]):
            pa, pn = ([split(interval.s, path.at(t)) for t in (a, b)] for split in (gamma, natural_constraints))
            rows.append(PositionForce(a, b, interval.s, *(numbers(x) for x in (*pa, *pn, omega(interval.s, f)))))
    return tuple(rows)


def hand_motion(found: Answer, segments: Sequence[Mapping[str, Any]]) -> Hand | None:
    """The motion of the hand in the frame of the feature that stays; None where that is the plan's.

    Returns:
        Names of both features, and for each segment poses (6,) of the hand at its ends, the twist (6,) of the grasped
        feature at the goal about its origin (m/s, rad/s), and the bias wrench (6,) on it about that origin (N, N·m).
    """
    task = found.task
    # The hand is where the feature is: a record of it would repeat the plan.
    if not (found.exchanged or task.grasp.vector().any()):
        return None
    made = tuple(_move(found, segment) for segment in segments)
    return Hand(str(task.moving), str(task.fixed), found.exchanged, made)


def _move(found: Answer, segment: Mapping[str, Any]) -> HandMove:
    goal, hybrid = segment["goal"], segment["hybrid"]
    velocity = hybrid["speed"] * np.asarray(hybrid["velocity"], dtype=np.float64)
    return HandMove(
        start=numbers(_held(found, segment["start"]).vector()),
        goal=numbers(_held(found, goal).vector()),
        velocity=numbers(grasped_twist(found, goal, velocity)),
        bias_wrench=numbers(grasped_wrench(found, goal, hybrid["bias_wrench"])),
    )


def _held(found: Answer, X: Array) -> Pose:
    """Pose of the hand in the frame of the feature that stays."""
    return grasped_pose(found, X).compose(found.task.grasp.inverse())


def world_pose(found: Answer, X: ArrayLike) -> Pose:
    """Pose of the grasped feature in the global reference frame, for an X (6,) in m and rad."""
    return (found.moving.frame if found.exchanged else found.fixed.frame).compose(grasped_pose(found, X))


def hand_pose(found: Answer, X: ArrayLike) -> Pose:
    """Pose of the hand in the global reference frame, by the grasp H_ho, for an X (6,) in m and rad."""
    return world_pose(found, X).compose(found.task.grasp.inverse())


def grasped_twist(found: Answer, X: ArrayLike, V: ArrayLike) -> Array:
    """Twist (v, ω) of the grasped feature against the one that stays, in the axes of the latter.

    Given are the pose X (6,) of operand 1 in the B-frame, m and rad, and its twist V (6,): velocity of its frame's
    origin (m/s) and angular velocity (rad/s), in the B-frame's axes.
    """
    v, w = np.split(np.asarray(V, dtype=np.float64), 2)
    if not found.exchanged:
        return np.concatenate([v, w])
    pose = Pose.from_vector(X)
    # The other part's motion seen from this one: minus the twist, carried to its origin and axes.
    return np.concatenate([pose.R.T @ (np.cross(w, pose.p) - v), -pose.R.T @ w])


def grasped_wrench(found: Answer, X: ArrayLike, F: ArrayLike) -> Array:
    """Wrench (f, τ) on the grasped object about its feature's origin, in the axes of the feature that stays.

    What acts on operand 1 acts on operand 2 with the opposite sign. The power with `grasped_twist` is that of F with V.
    F is the wrench (6,) on operand 1 about its frame's origin, in N and N·m, in the B-frame's axes, and X (6,) its pose
    there, m and rad.
    """
    f, tau = np.split(np.asarray(F, dtype=np.float64), 2)
    if not found.exchanged:
        return np.concatenate([f, tau])
    pose = Pose.from_vector(X)
    # Reaction for action: the sign turns, and the moment is taken about the other origin.
    return np.concatenate([-pose.R.T @ f, -pose.R.T @ (tau + np.cross(pose.p, f))])
