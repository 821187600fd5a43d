"""Random planar contacts and the configurations that sampled deviations lead to, without the sets' formulas."""

import math
from dataclasses import dataclass

import numpy as np

from fmopt.papers.basanez_suarez.contact import CU, ContactType, Range
from fmopt.papers.basanez_suarez.edge import Case, TurnedEdge

ALL = Range(-math.pi, math.pi)


@dataclass(frozen=True, eq=False)
class Instance:
    """A contact with the two radii that its set has the sum of."""

    cu: CU
    phi: float
    epsilon_p: float
    epsilon_a: float

    @property
    def uncertainty(self) -> float:
        """How far deviations move the contact in all, m."""
        return self.cu.radius + self.cu.reach * min(self.cu.spread, math.pi)

    def configurations(self, q: np.ndarray) -> np.ndarray:
        """Reference points (…, 2) at which the contact is made, for deviations q (…, 6) in the unit cube.

        q holds k, the turn, and direction and size of the deviations of the grasped and of the static point.
        """
        cu = self.cu
        k, turn = q[..., 0:1], self.phi + cu.spread * (2.0 * q[..., 1] - 1.0)
        shift = self.epsilon_p * disc(q[..., 2], q[..., 3])
        static_shift = self.epsilon_a * disc(q[..., 4], q[..., 5])
        on_edge = cu.edge[0] + k * (cu.edge[1] - cu.edge[0])
        grasped, static = (cu.vertex, on_edge) if cu.kind is ContactType.TYPE_1 else (on_edge, cu.vertex)
        c, s = np.cos(turn), np.sin(turn)
        grasped = np.broadcast_to(grasped, (*turn.shape, 2))
        x, y = grasped[..., 0], grasped[..., 1]
        return static + static_shift - np.stack([c * x - s * y, s * x + c * y], axis=-1) - shift


def disc(direction: np.ndarray, size: np.ndarray) -> np.ndarray:
    """Points (…, 2) of the unit disc."""
    theta = 2.0 * math.pi * direction
    return size[..., None] * np.stack([np.cos(theta), np.sin(theta)], axis=-1)


def instances(kind: ContactType, case: Case | None, count: int, seed: int) -> list[Instance]:
    """Random contacts of one type, for type 2 of one case, sizes from 1 mm to 1 m, deviations from 10⁻⁴ of that up."""
    rng = np.random.default_rng([seed, kind is ContactType.TYPE_2, case is Case.A])
    found: list[Instance] = []
    while len(found) < count:
        scale = 10.0 ** rng.uniform(-3.0, 0.0)
        edge, vertex = scale * rng.normal(size=(2, 2)), scale * rng.normal(size=2)
        spread = 10.0 ** rng.uniform(-4.0, 0.0)
        epsilon_p, epsilon_a = scale * 10.0 ** rng.uniform(-4.0, 0.0, size=2)
        cu = CU(kind, 0, 0, edge, vertex, ALL, ALL, spread, epsilon_p + epsilon_a)
        instance = Instance(cu, rng.uniform(-10.0, 10.0), epsilon_p, epsilon_a)
        at = cu.at(instance.phi)
        if case is None or (isinstance(at, TurnedEdge) and at.case is case):
            found.append(instance)
    return found


def deviations(rng: np.random.Generator, count: int) -> np.ndarray:
    """Points (count, 6) of the unit cube, many of them on its faces, most with both points shifted the same way."""
    q = rng.uniform(size=(count, 6))
    q[:, [3, 5]] = np.sqrt(q[:, [3, 5]])
    at_limit = rng.uniform(size=(count, 4)) < 0.6
    q[:, [0, 1]] = np.where(at_limit[:, :2], np.round(q[:, [0, 1]]), q[:, [0, 1]])
    q[:, [3, 5]] = np.where(at_limit[:, 2:], 1.0, q[:, [3, 5]])
    together = rng.uniform(size=count) < 0.7
    # The static point adds, the grasped one subtracts: opposite shifts add up.
    q[together, 4] = np.mod(q[together, 2] + 0.5, 1.0)
    return q


def nearest(instance: Instance, points: np.ndarray) -> np.ndarray:
    """Distance (n,) of points (n, 2) from the nearest configuration, by zooming grids over the turn, m.

    At a fixed turn the configurations without deviations of position are a segment; those deviations then make up for
    any distance up to the sum of their limits.
    """
    best, width = np.full(len(points), 0.5), 0.5
    for _ in range(6):
        turns = np.clip(best[:, None] + np.linspace(-width, width, 201), 0.0, 1.0)
        q = np.zeros((2, *turns.shape, 6))
        q[1, ..., 0], q[..., 1] = 1.0, turns
        first, last = instance.configurations(q)
        e, to = last - first, points[:, None] - first
        t = np.clip(np.sum(to * e, axis=-1) / np.maximum(np.sum(e * e, axis=-1), 1e-300), 0.0, 1.0)
        apart = np.hypot(*np.moveaxis(to - t[..., None] * e, -1, 0))
        pick = np.argmin(apart, axis=1)
        best = turns[np.arange(len(points)), pick]
        width *= 0.05
    return np.maximum(apart[np.arange(len(points)), pick] - instance.epsilon_p - instance.epsilon_a, 0.0)
