"""What the rig asks of a physics engine: n bodies, each alone with the fixed part, moved on together in time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

from fmopt.execution.robot import Robot
from fmopt.plan import Plan
from fmopt.spatial.values import Array

THROWN = 5e-5  # m, by which contacts do not deepen in one time step; more is a fault of the engine's collision
FIELDS = 8  # found, force (3) in axes of the engine's choice, distance, position (3)


class Engine(Protocol):
    """n bodies about their reference points; its arrays are written in place, by the engine and by who owns it.

    Attributes:
        qpos: poses (n, 7): position in B, m, and quaternion, w first.
        qvel: velocities (n, 6): of the reference point, axes of B, m/s, and of turning, axes of the part, rad/s.
        depth: greatest penetrations (n,) so far, m.
    """

    qpos: Array
    qvel: Array
    depth: Array

    def advance(self, wrench: Array, period: float) -> None:
        """Moves the bodies on.

        Args:
            wrench: (n, 6), about the reference points, axes of B, N and N·m.
            period: s; at least one step of the engine.
        """
        ...

    @property
    def reaction(self) -> Array:
        """Wrenches (n, 6) of the contacts in the last time step, about the reference points, axes of B."""
        ...

    @property
    def contacts(self) -> Array:
        """Contacts (n, k, FIELDS) of the last time step, k of the engine's choice; rows of zeros where none is."""
        ...


@dataclass(frozen=True, eq=False)
class Setup:
    """What a scene is made of.

    Args:
        plan: its parts are used.
        clearance: a side, m, which says how hard contacts have to be.
        robot: whose apparent mass and period it is.
        friction: coefficient.
        time_step: s; None for what the clearance asks for.
    """

    plan: Plan
    clearance: float
    robot: Robot
    friction: float
    time_step: float | None = None


Put = Callable[[tuple[Array, Array]], Engine]
"""Puts bodies at positions (n, 3) and quaternions (n, 4), at rest."""


@dataclass(frozen=True)
class Maker:
    """An engine to choose: its library, which raises ResourceError where the extra is missing, and its scenes."""

    library: Callable[[], Any]
    scene: Callable[[Setup], Put]
