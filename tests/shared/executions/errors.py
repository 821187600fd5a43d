"""Errors of simulated executions, drawn on the boundary of every stated set, each in the frame of its source."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from tests.shared.executions.geometry import Array, Poses, cross, rotations

if TYPE_CHECKING:
    from tests.shared.executions.model import Piece

Sources = Sequence[tuple[str, Sequence[float]]]


@dataclass(frozen=True)
class Fixed:
    """Errors of executions that are fixed in the hole or in the hand."""

    origin: Array  # where the motion starts (3,), about which the hole is turned
    hole: Array  # shifts and turns (n, 6) of the hole, as the part is seen in its frame
    hand: Array  # shifts and turns (n, 6) of the part in the hand, in the part's frame

    def seen(self, poses: Poses) -> Poses:
        """Poses in the hole's frame of what is held as it is: H⁻¹ · X · G."""
        p, R = poses
        askew = rotations(self.hole[:, 3:])
        p = p + np.einsum("nij,nj->ni", R, self.hand[:, :3]) - self.origin
        p = self.origin + self.hole[:, :3] + np.einsum("nij,nj->ni", askew, p)
        return p, askew @ R @ rotations(self.hand[:, 3:])

    def summed(self, world: Array, nominal: Poses) -> Array:
        """Errors (n, 6) of all sources about a nominal pose, as error sets add them up: to first order."""
        turn = self.hole[:, 3:]
        swung = self.hole[:, :3] + cross(turn, np.broadcast_to(nominal[0][0] - self.origin, turn.shape))
        hand = self.hand.reshape(-1, 2, 3)
        return np.asarray(world + np.hstack([swung, turn]) + (hand @ nominal[1][0].T).reshape(-1, 6))


def sources_of(plan: dict[str, Any]) -> Sources:
    """Boxes of errors with their frames; one box fixed in the world where the plan names none."""
    uncertainty = plan["uncertainty"]
    stated = uncertainty.get("sources") or [{"frame": "world", "box": uncertainty["start_box"]}]
    return [(source["frame"], source["box"]) for source in stated]


def start_errors(sources: Sources, start: Poses, count: int, rng: np.random.Generator) -> tuple[Array, Fixed]:
    """Errors (n, 6) of the world, and the others, on the boundary of the sources' boxes where the motion starts.

    Three in five lie at corners, one on edges, one on faces. In half of the executions all sources err alike, so that
    corners of the sum are reached, too.
    """
    by_frame = {frame: np.zeros((count, 6)) for frame in ("world", "hole", "hand")}
    alike, common = rng.random((count, 1)) < 0.5, rng.choice([-1.0, 1.0], (count, 6))
    for frame, stated in sources:
        box = np.array(stated)
        inside, corner = rng.uniform(-1.0, 1.0, (count, 6)), rng.choice([-1.0, 1.0], (count, 6))
        corner = np.where(alike, common, corner)
        one = np.eye(6, dtype=bool)[rng.choice(np.flatnonzero(box) if box.any() else np.arange(6), count)]
        kind = rng.integers(5, size=(count, 1))
        pushed = (kind < 3) | ((kind == 3) & ~one) | ((kind == 4) & one)
        drawn = np.where(pushed, corner, inside) * box
        by_frame[frame] = by_frame[frame] + drawn
    grip = (by_frame["hand"].reshape(-1, 2, 3) @ start[1][0]).reshape(-1, 6)
    return by_frame["world"], Fixed(start[0][0], by_frame["hole"], grip)


def drifts(piece: "Piece", count: int, rng: np.random.Generator) -> Array:
    """Velocity errors (n, 6) per unit of travel, translation and rotation each on its bound.

    A third in any direction, a third along axes, a third straight along the way to the contact being made.
    """
    translation, rotation = piece.scene.plan["uncertainty"]["velocity_error"]
    kind, found = rng.integers(3, size=(count, 1)), []
    sign = rng.choice([-1.0, 1.0], (count, 1))
    for part, rate in enumerate((translation, rotation / piece.scene.rho)):
        y = rng.normal(size=(count, 3))
        y = np.where(kind == 1, rng.choice([-1.0, 1.0], (count, 1)) * np.eye(3)[rng.integers(3, size=count)], y)
        if piece.made is not None and piece.way_row[3 * part : 3 * part + 3].any():
            y = np.where(kind == 2, sign * piece.way_row[3 * part : 3 * part + 3], y)
        found.append(y / np.linalg.norm(y, axis=1, keepdims=True) * rate)
    return np.hstack(found)
