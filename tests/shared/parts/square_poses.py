"""Poses of the square peg at and in its hole, and how far it is off the block by separating axes."""

import numpy as np

from fmopt.spatial.se3 import Pose, exp
from tests.shared.parts.square import MID_DEPTH, block, peg

PEG, BLOCK = peg(), block()
HALF = 0.0101
BOXES = [
    ((HALF, -0.03, -0.04), (0.03, 0.03, 0.0)),
    ((-0.03, -0.03, -0.04), (-HALF, 0.03, 0.0)),
    ((-HALF, HALF, -0.04), (HALF, 0.03, 0.0)),
    ((-HALF, -0.03, -0.04), (HALF, -HALF, 0.0)),
    ((-HALF, -HALF, -0.04), (HALF, HALF, -0.03)),
]


def lowered(turn: tuple[float, float, float], depth: float) -> Pose:
    """The peg turned, its lowest corner 0.2 mm off the walls at +x and +y and `depth` below the mouth."""
    R = exp(np.radians(turn))
    tip = PEG.vertices[:4] @ R.T
    low = tip[int(np.argmin(tip[:, 2]))]
    return Pose(np.array([0.0099 - abs(low[0]), 0.0099 - abs(low[1]), -depth - low[2]]), R)


POSES = {
    "mid-depth": (MID_DEPTH, 1.5e-4, 0.01, 16),
    "corner in the mouth": (lowered((-5.0, 5.0, 0.0), 0.0005), 3e-4, 0.01, 4),
    "edge in the mouth": (Pose(np.array([-6e-5, 0.0, -1.28e-4]), exp([0.0, np.radians(5.0), 0.0])), 3e-4, 0.01, 8),
    "on the rim": (Pose(np.array([3e-4, 1e-4, 1e-4]), np.eye(3)), 3e-4, 0.01, 4),
    "just below the mouth": (Pose(np.array([0.0, 0.0, -5e-5]), exp([0.0, 0.0, 0.002])), 2e-4, 0.005, 16),
}


def gap(pose: Pose) -> float:
    """Signed gap between the peg and the nearest box of the block by separating axes, m; negative when they overlap."""
    axes = [*np.eye(3), *pose.R.T, *(np.cross(a, b) for a in np.eye(3) for b in pose.R.T)]
    A = np.array([a / np.linalg.norm(a) for a in axes if np.linalg.norm(a) > 1e-9])
    v = pose.apply(PEG.vertices) @ A.T
    gaps = []
    for low, high in BOXES:
        corners = np.array(np.meshgrid(*zip(low, high, strict=True))).reshape(3, 8).T @ A.T
        gaps.append(np.max(np.maximum(v.min(axis=0) - corners.max(axis=0), corners.min(axis=0) - v.max(axis=0))))
    return float(min(gaps))
