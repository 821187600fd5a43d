"""Errors of simulated executions, drawn on the boundary of every stated set, each in the frame of its source."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from execution_geometry import Array, rotations

if TYPE_CHECKING:
    from execution_model import Piece

Sources = Sequence[tuple[str, Sequence[float]]]


@dataclass(frozen=True)
class Fixed:
    """Errors of executions by the frame in which their source is fixed: how they change as the part moves.

    A hole that is askew turns the whole way: e(t) = e(0) + (exp([ε]×) − 1)(p̄(t) − p̄(0)), ε constant. What is fixed in
    the hand turns with the part, e and ε alike. What is fixed in the world stays.

    Attributes:
        askew: turns of the hole about where the motion starts, as matrices less the identity (n, 3, 3).
        grip: errors (n, 2, 3) of the hand in the part's frame: e and ε.
    """

    askew: Array
    grip: Array

    def change(self, piece: Piece, travel: Array) -> Array:
        """By how much errors (n, 6) have changed since a piece began, at a travel (n,), as shares of it."""
        turned = rotations(travel[:, None] * piece.omega) @ piece.R - piece.R
        e, eps = (self.grip @ turned.transpose(0, 2, 1)).transpose(1, 0, 2)
        return np.hstack([(self.askew @ piece.delta) * travel[:, None] + e, eps])


def sources_of(plan: dict[str, Any]) -> Sources:
    """Boxes of errors with their frames; one box fixed in the world where the plan names none."""
    uncertainty = plan["uncertainty"]
    stated = uncertainty.get("sources") or [{"frame": "world", "box": uncertainty["start_box"]}]
    return [(source["frame"], source["box"]) for source in stated]


def start_errors(sources: Sources, piece: Piece, count: int, rng: np.random.Generator) -> tuple[Array, Fixed]:
    """Errors (n, 6) on the boundary of the sources' boxes, as they are where the first piece starts.

    Three in five lie at corners, one on edges, one on faces. In half of the executions all sources err alike, so that
    corners of the sum are reached, too.
    """
    total, by_frame = np.zeros((count, 6)), {frame: np.zeros((count, 6)) for frame in ("world", "hole", "hand")}
    alike, common = rng.random((count, 1)) < 0.5, rng.choice([-1.0, 1.0], (count, 6))
    for frame, stated in sources:
        box = np.array(stated)
        inside, corner = rng.uniform(-1.0, 1.0, (count, 6)), rng.choice([-1.0, 1.0], (count, 6))
        corner = np.where(alike, common, corner)
        one = np.eye(6, dtype=bool)[rng.choice(np.flatnonzero(box) if box.any() else np.arange(6), count)]
        kind = rng.integers(5, size=(count, 1))
        pushed = (kind < 3) | ((kind == 3) & ~one) | ((kind == 4) & one)
        drawn = np.where(pushed, corner, inside) * box
        total, by_frame[frame] = total + drawn, by_frame[frame] + drawn
    askew = rotations(by_frame["hole"][:, 3:]) - np.eye(3)
    return total, Fixed(askew, by_frame["hand"].reshape(-1, 2, 3) @ piece.R[0])


def drifts(piece: Piece, count: int, rng: np.random.Generator) -> Array:
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
