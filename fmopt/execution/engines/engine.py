"""What the rig asks of a physics engine: n bodies, each alone with the fixed part, moved on together in time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Protocol

import numpy as np

from fmopt.execution.rotation import from_quaternions
from fmopt.geometry.clearance import deepest
from fmopt.geometry.polyhedron import Polyhedron, convex_hull_polyhedron, placed
from fmopt.plan import Plan
from fmopt.spatial.se3 import Pose
from fmopt.spatial.values import Array, Indices

THROWN = 5e-5  # m, by which contacts do not deepen in one time step; more is a fault of the engine's collision
FIELDS = 8  # found, force (3) in axes of the engine's choice, distance, position (3)
_SIDES = ("moving", "fixed")


class Engine(Protocol):
    """n bodies about their reference points; its arrays are written in place, by the engine and by who owns it."""

    qpos: Array  # poses (n, 7): position in B, m, and quaternion, w first
    qvel: Array  # velocities (n, 6): of the reference point, axes of B, m/s, and of turning, axes of the part, rad/s
    depth: Array  # greatest penetrations (n,) so far, m
    deepest: Array  # greatest penetrations (n,) in the last period, m
    deepest_at: Array  # poses (n, 7) of these

    def advance(self, wrench: Array, period: float, bodies: Indices | None = None) -> None:
        """Moves bodies on by a period, s, under wrenches (n, 6) on reference points, axes of B, N and N·m, of all."""

    def damp(self, damping: Array) -> None:
        """Damps translations along x, y, z of B by (n, 3), N·s/m, from now on; the engine integrates it implicitly."""

    @property
    def reaction(self) -> Array:
        """Wrenches (n, 6) of the contacts in the last time step, about the reference points, axes of B."""

    @property
    def reaction_over_period(self) -> Array:
        """Means (n, 6) of such wrenches over the time steps of the last period."""

    @property
    def contacts(self) -> Array:
        """Contacts (n, k, FIELDS) of the last time step, k of the engine's choice; rows of zeros where none is."""


class Apparent(Protocol):
    """The robot as the engine sees it."""

    @property
    def mass(self) -> float:
        """Apparent mass, kg."""

    @property
    def inertia(self) -> float:
        """Apparent inertia about each axis, kg·m²."""

    @property
    def period(self) -> float:
        """Period of the controller, s."""


@dataclass(frozen=True, eq=False)
class Bodies:
    """Both parts as convex bodies: vertices (v, 3) of their pieces, m, and balls (centre, radius) of the moving part.

    The moving part is in its body frame, the fixed one in the B-frame.
    """

    moving: tuple[Array, ...]
    fixed: tuple[Array, ...]
    balls: tuple[tuple[Array, float], ...] = ()

    @staticmethod
    def of(plan: Plan) -> Bodies:
        """The parts of a plan."""
        moving, fixed = (tuple(np.array(piece.vertices) for piece in plan.parts[side].pieces) for side in _SIDES)
        body, presses = plan.moving.body, plan.press_plan
        found = Bodies(moving, fixed, tuple((np.array(body.vertices[k]), radius) for k, radius in body.balls))
        return found.filled() if presses is not None and presses.filled else found

    def filled(self) -> Bodies:
        """The moving part as one convex body: its hull."""
        return replace(self, moving=(convex_hull_polyhedron(np.vstack(self.moving)).vertices,))

    def penetration(self, q: Array) -> float:
        """Greatest penetration at a pose (7,), m, by separating planes; balls are left out.

        Engines overstate it where edges are nearly parallel: 24 µm were told of 2.6.
        """
        moving, fixed = self._hulls
        pose = Pose(q[:3], from_quaternions(q[3:]))
        return deepest([placed(body, pose) for body in moving], fixed)

    @cached_property
    def _hulls(self) -> tuple[tuple[Polyhedron, ...], tuple[Polyhedron, ...]]:
        return tuple(map(convex_hull_polyhedron, self.moving)), tuple(map(convex_hull_polyhedron, self.fixed))


@dataclass(frozen=True, eq=False)
class Setup:
    """What a scene is made of."""

    bodies: Bodies
    clearance: float
    robot: Apparent
    friction: float | Array  # coefficient, or (n,) of each body
    time_step: float | None = None  # s; None for what the clearance asks for
    threads: int = 1  # that step the bodies; one where cores are taken by processes, a chunk each


Put = Callable[[tuple[Array, Array]], Engine]
"""Puts bodies at positions (n, 3) and quaternions (n, 4), at rest."""


@dataclass(frozen=True)
class Maker:
    """An engine to choose: its library, which raises ResourceError where the extra is missing, and its scenes."""

    library: Callable[[], Any]
    scene: Callable[[Setup], Put]
