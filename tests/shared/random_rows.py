"""Random features of parts with their rows, and poses a small turn apart."""

import numpy as np

from fmopt.certificate.rows import Forms, directions_along, edges_apart, faces_above, points_above
from fmopt.spatial.se3 import Pose, exp
from fmopt.spatial.values import Array

KINDS = ("points", "directions", "faces", "edges")


def unit(rng: np.random.Generator, count: int) -> Array:
    vectors = rng.normal(size=(count, 3))
    return np.asarray(vectors / np.linalg.norm(vectors, axis=1, keepdims=True))


def forms(kind: str, rng: np.random.Generator, count: int = 6) -> Forms:
    points = rng.uniform(-0.03, 0.03, (count, 3))
    if kind == "points":
        return points_above(points, unit(rng, count), rng.uniform(-0.03, 0.03, count))
    if kind == "directions":
        return directions_along(unit(rng, count) * 0.7, points)
    if kind == "faces":
        return faces_above(unit(rng, count), rng.uniform(-0.03, 0.03, count), points)
    return edges_apart(unit(rng, 1)[0], unit(rng, 1)[0], rng.uniform(-0.03, 0.03, 3), points)


def pose(rng: np.random.Generator) -> Pose:
    return Pose(rng.uniform(-0.02, 0.02, 3), exp(rng.normal(size=3)))


def moved(rng: np.random.Generator, start: Pose, turn: float) -> tuple[Pose, Array]:
    """A pose some way off, turned by an angle, and the twist that leads there."""
    twist = np.concatenate([rng.uniform(-2e-3, 2e-3, 3) * (turn > 0.0), unit(rng, 1)[0] * turn])
    return start.moved(twist), twist


def box(angles: tuple[float, float, float], offset: tuple[float, float, float] = (4e-4, 1e-4, 0.0)) -> Array:
    return np.array([*offset, *angles])
