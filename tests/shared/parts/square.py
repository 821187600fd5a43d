"""A square peg, a block with a square blind hole and a spike, by hand."""

import numpy as np

from fmopt.geometry.polyhedron import Polyhedron, from_faces
from fmopt.spatial.se3 import Pose

MID_DEPTH = Pose(np.array([0.0, 0.0, -0.015]), np.eye(3))


def ring(x: float, y: float, z: float) -> list[tuple[float, float, float]]:
    return [(-x, -y, z), (x, -y, z), (x, y, z), (-x, y, z)]


def peg(width: float = 0.020, length: float = 0.040) -> Polyhedron:
    sides = [[[i, (i + 1) % 4, 4 + (i + 1) % 4, 4 + i]] for i in range(4)]
    points = ring(width / 2, width / 2, 0.0) + ring(width / 2, width / 2, length)
    return from_faces(points, [[[3, 2, 1, 0]], [[4, 5, 6, 7]], *sides])


def block(x: float = 0.0202, y: float = 0.0202, depth: float = 0.030) -> Polyhedron:
    points = ring(0.03, 0.03, -0.04) + ring(0.03, 0.03, 0.0) + ring(x / 2, y / 2, -depth) + ring(x / 2, y / 2, 0.0)
    sides = [[[i, (i + 1) % 4, 4 + (i + 1) % 4, 4 + i]] for i in range(4)]
    walls = [[[12 + i, 12 + (i + 1) % 4, 8 + (i + 1) % 4, 8 + i]] for i in range(4)]
    faces = [[[3, 2, 1, 0]], [[4, 5, 6, 7], [15, 14, 13, 12]], [[8, 9, 10, 11]], *sides, *walls]
    return from_faces(points, faces)


def tilted(angles: tuple[float, float, float], depth: float = 0.002) -> Pose:
    return Pose.from_vector((0.0, 0.0, -depth, *angles))


def spike() -> tuple[list[tuple[float, float, float]], list[list[list[int]]]]:
    """A pyramid with its tip at the origin."""
    base = ring(0.01, 0.01, -0.01)
    return [*base, (0.0, 0.0, 0.0)], [[[3, 2, 1, 0]], *[[[i, (i + 1) % 4, 4]] for i in range(4)]]
