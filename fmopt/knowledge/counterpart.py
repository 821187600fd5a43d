"""From the task that fits the assumptions back to the task that was given: poses, twists and wrenches.

Let X be the pose of operand 1 in the B-frame. When the operands were not exchanged, operand 1 is what the hand holds.
When they were, the hand holds operand 2, and its pose in the frame of operand 1, which stands still, is X⁻¹.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from fmopt.knowledge.command import Answer
from fmopt.se3 import Pose
from fmopt.values import Array


def grasped_pose(found: Answer, X: ArrayLike) -> Pose:
    """Pose of the grasped feature in the frame of the one that stays, of X (6,) in m and rad."""
    pose = Pose.from_vector(X)
    return pose.inverse() if found.exchanged else pose


def world_pose(found: Answer, X: ArrayLike) -> Pose:
    """Pose of the grasped feature in the global reference frame, for an X (6,) in m and rad."""
    base = found.moving.frame if found.exchanged else found.fixed.frame
    return base.compose(grasped_pose(found, X))


def hand_pose(found: Answer, X: ArrayLike) -> Pose:
    """Pose of the hand in the global reference frame, by the grasp H_ho, for an X (6,) in m and rad."""
    return world_pose(found, X).compose(found.task.grasp.inverse())


def grasped_twist(found: Answer, X: ArrayLike, V: ArrayLike) -> Array:
    """Twist (v, ω) of the grasped feature against the one that stays, in the axes of the latter.

    Args:
        found: the answer.
        X: pose (6,) of operand 1 in the B-frame, m and rad.
        V: its twist (6,): velocity of its frame's origin (m/s) and angular velocity (rad/s), in the B-frame's axes.
    """
    v, w = np.split(np.asarray(V, dtype=np.float64), 2)
    if not found.exchanged:
        return np.concatenate([v, w])
    pose = Pose.from_vector(X)
    return np.concatenate([pose.R.T @ (np.cross(w, pose.p) - v), -pose.R.T @ w])


def grasped_wrench(found: Answer, X: ArrayLike, F: ArrayLike) -> Array:
    """Wrench (f, τ) on the grasped object about its feature's origin, in the axes of the feature that stays.

    What acts on operand 1 acts on operand 2 with the opposite sign. The power with `grasped_twist` is that of F with V.

    Args:
        found: the answer.
        X: pose (6,) of operand 1 in the B-frame, m and rad.
        F: wrench (6,) on operand 1 about its frame's origin, in N and N·m, in the B-frame's axes.
    """
    f, tau = np.split(np.asarray(F, dtype=np.float64), 2)
    if not found.exchanged:
        return np.concatenate([f, tau])
    pose = Pose.from_vector(X)
    return np.concatenate([-pose.R.T @ f, -pose.R.T @ (tau + np.cross(pose.p, f))])
