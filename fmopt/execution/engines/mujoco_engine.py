"""MuJoCo as the rig's engine: all bodies in one batch of the scene."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from fmopt.execution.engines.engine import FIELDS, THROWN, Maker, Put, Setup
from fmopt.execution.engines.physics import Physics
from fmopt.execution.engines.scene import CONTACTS, compiled, engine, scene
from fmopt.execution.rotation import from_quaternions
from fmopt.spatial.values import Array

_SHIFTS = (1e-9, -2e-9, 4e-9)  # m, by which a part is moved for a time step to be taken again


class MujocoEngine:
    """n bodies in a scene; see `Engine`.

    Args:
        model: of the scene.
        starts: positions (n, 3) and quaternions (n, 4) of the bodies.
    """

    def __init__(self, model: Any, starts: tuple[Array, Array]) -> None:
        from mujoco.batch import Batch

        n = len(starts[0])
        self._batch: Any = Batch(model, n, 1)  # one thread: cores are taken by processes, a chunk each
        # Views of the batch's own memory: what is written to them is the state of the next time step.
        self.qpos, self.qvel, self._applied, self._constraint, self._sensor = (
            self._batch.bind(name) for name in ("qpos", "qvel", "qfrc_applied", "qfrc_constraint", "sensordata")
        )
        # With the warm start, too: a time step that is taken back leaves no trace in the next one.
        self._fields = [self.qpos, self.qvel, self._batch.bind("qacc_warmstart")]
        self.qpos[:, :3], self.qpos[:, 3:] = starts
        self._time_step = float(model.opt.timestep)
        self.depth, self._deepest = np.zeros(n), np.zeros(n)  # greatest penetration so far and now, m

    @property
    def reaction(self) -> Array:
        """As `Engine`; the library has torques in axes of the part."""
        R = from_quaternions(self.qpos[:, 3:])
        return np.hstack([self._constraint[:, :3], np.einsum("nij,nj->ni", R, self._constraint[:, 3:])])

    @property
    def contacts(self) -> Array:
        """As `Engine`."""
        return np.asarray(self._sensor).reshape(len(self.qpos), CONTACTS, FIELDS)

    def advance(self, wrench: Array, period: float) -> None:
        """As `Engine`."""
        R = from_quaternions(self.qpos[:, 3:])
        self._applied[:, :3] = wrench[:, :3]
        self._applied[:, 3:] = np.einsum("nji,nj->ni", R, wrench[:, 3:])
        for _ in range(max(round(period / self._time_step), 1)):
            self._step()

    def _step(self) -> None:
        """One time step, taken again by bodies for which the engine found a contact that cannot be.

        Where faces lie flat on each other, the engine's collision of convex bodies now and then, at one pose and not at
        the next, takes another face for the nearest, and a contact as deep as the part is thick throws the part away.
        """
        before = [field.copy() for field in self._fields]
        self._batch.step()
        deepest = self._deepest_now()
        for shift in _SHIFTS:
            thrown = np.flatnonzero(deepest > self._deepest + THROWN)
            if not len(thrown):
                break
            for now, then in zip(self._fields, before, strict=True):
                now[thrown] = then[thrown]
            self.qpos[thrown, :3] += shift
            self._batch.step(thrown)
            deepest = self._deepest_now()
        self._deepest = deepest
        np.maximum(self.depth, deepest, out=self.depth)

    def _deepest_now(self) -> Array:
        """Greatest penetrations (n,) of the last time step, m."""
        found = self.contacts
        return np.asarray(-np.where(found[:, :, 0] > 0.0, found[:, :, 4], 0.0).min(axis=1))


def _put(setup: Setup) -> Put:
    physics, robot = Physics.of_fit(setup.clearance, setup.robot.period, setup.time_step), setup.robot
    model = compiled(scene(setup.plan, physics, robot.mass, robot.inertia, setup.friction))
    return partial(MujocoEngine, model)


MUJOCO = Maker(engine, _put)
