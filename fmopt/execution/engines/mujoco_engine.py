"""MuJoCo as the rig's engine: all bodies in one batch of the scene."""

from functools import partial
from typing import Any

import numpy as np

from fmopt.execution.engines.engine import FIELDS, THROWN, Maker, Put, Setup
from fmopt.execution.engines.physics import Physics
from fmopt.execution.engines.scene import CONTACTS, compiled, engine, scene
from fmopt.execution.kernels_rotation import rotated
from fmopt.spatial.values import Array, Indices

_SHIFTS = (1e-9, -2e-9, 4e-9)  # m, by which a part is moved for a time step to be taken again


class MujocoEngine:
    """n bodies of friction (n,), or the model's, begun at positions (n, 3) and quaternions (n, 4); see `Engine`."""

    def __init__(self, model: Any, starts: tuple[Array, Array], friction: Any = None, threads: int = 1) -> None:
        from mujoco.batch import Batch

        n = len(starts[0])
        self._batch: Any = Batch(model, n, threads)
        if friction is not None:
            self._batch.expand("geom_friction")[:, :, 0] = friction[:, None]
        # Views of the batch's own memory: what is written to them is the state of the next time step.
        self.qpos, self.qvel, self._applied, self._constraint, self._sensor = (
            self._batch.bind(name) for name in ("qpos", "qvel", "qfrc_applied", "qfrc_constraint", "sensordata")
        )
        # With the warm start, too: a time step that is taken back leaves no trace in the next one.
        self._fields = [self.qpos, self.qvel, self._batch.bind("qacc_warmstart")]
        self.qpos[:, :3], self.qpos[:, 3:] = starts
        self._time_step = float(model.opt.timestep)
        self._damping: Array | None = None
        self._pressed = np.zeros((n, 6))
        self.depth, self.deepest, self._last = np.zeros((3, n))
        self.deepest_at = np.array(self.qpos)

    @property
    def reaction(self) -> Array:
        """As `Engine`."""
        return self._in_base(self._constraint)

    @property
    def reaction_over_period(self) -> Array:
        """As `Engine`."""
        return self._in_base(self._pressed)

    def _in_base(self, wrench: Array) -> Array:
        """Wrenches (n, 6) as the library has them, with torques in axes of the part, in axes of B."""
        found = np.array(wrench)
        rotated(self.qpos[:, 3:], wrench[:, 3:], False, found[:, 3:])
        return found

    @property
    def contacts(self) -> Array:
        """As `Engine`."""
        return np.asarray(self._sensor).reshape(len(self.qpos), CONTACTS, FIELDS)

    def advance(self, wrench: Array, period: float, bodies: Indices | None = None) -> None:
        """As `Engine`.

        Where faces lie flat on each other, the engine's collision of convex bodies now and then, at one pose and not at
        the next, takes another face for the nearest, and a contact as deep as the part is thick throws the part away.
        Bodies for which that happens take the period again, step by step.
        """
        self._applied[:, :3] = wrench[:, :3]
        rotated(self.qpos[:, 3:], wrench[:, 3:], True, self._applied[:, 3:])
        steps, every = max(round(period / self._time_step), 1), np.arange(len(wrench)) if bodies is None else bodies
        before = [field[every] for field in self._fields]
        found = self._batch.rollout(steps, record=("qpos", "qfrc_constraint", "sensordata"), ids=every)
        # The sensor tells of the pose that a time step begins at.
        deepest, poses = _deepest(found["sensordata"]), np.roll(found["qpos"], 1, axis=1)
        poses[:, 0], last = before[0], np.roll(deepest, 1, axis=1)
        last[:, 0] = self._last[every]
        thrown = np.flatnonzero((deepest > last + THROWN).any(axis=1))
        self._pressed[every] = found["qfrc_constraint"].mean(axis=1)
        if len(thrown):
            again, now = every[thrown], last[thrown, 0]
            for field, rows in zip(self._fields, before, strict=True):
                field[again] = rows[thrown]
            self._pressed[again] = 0.0
            for step in range(steps):
                poses[thrown, step] = self.qpos[again]
                deepest[thrown, step] = now = self._step(again, now)
                self._pressed[again] += self._constraint[again] / steps
        self._last[every], self.deepest[every] = deepest[:, -1], deepest.max(axis=1)
        self.deepest_at[every] = poses[np.arange(len(every)), deepest.argmax(axis=1)]
        self.depth[every] = np.maximum(self.depth[every], self.deepest[every])

    def damp(self, damping: Array) -> None:
        """As `Engine`; a free body has its translations along the axes of the world."""
        if self._damping is None:
            self._damping = self._batch.expand("dof_damping")
        self._damping[:, :3] = damping

    def _step(self, bodies: Indices, last: Array) -> Array:
        """One time step, taken again from next to where they were by bodies that are thrown; penetrations (n,), m."""
        before = [field[bodies] for field in self._fields]
        self._batch.step(bodies)
        for shift in _SHIFTS:
            thrown = np.flatnonzero(_deepest(self._sensor[bodies]) > last + THROWN)
            if not len(thrown):
                break
            for field, rows in zip(self._fields, before, strict=True):
                field[bodies[thrown]] = rows[thrown]
            self.qpos[bodies[thrown], :3] += shift
            self._batch.step(bodies[thrown])
        return _deepest(self._sensor[bodies])


def _deepest(sensor: Array) -> Array:
    """Greatest penetrations (…), m, of what the sensor of contacts says (…, CONTACTS · FIELDS)."""
    found = sensor.reshape(*sensor.shape[:-1], CONTACTS, FIELDS)
    return np.asarray(-np.where(found[..., 0] > 0.0, found[..., 4], 0.0).min(axis=-1))


def _put(setup: Setup) -> Put:
    physics, robot = Physics.of_fit(setup.clearance, setup.robot.period, setup.time_step), setup.robot
    model = compiled(scene(setup.bodies, physics, robot.mass, robot.inertia, float(np.min(setup.friction))))
    friction = None if isinstance(setup.friction, float) else setup.friction
    return partial(MujocoEngine, model, friction=friction, threads=setup.threads)


MUJOCO = Maker(engine, _put)


def version() -> str:
    """The engine with the version of its library, as plans state it."""
    return f"mujoco {MUJOCO.library().__version__}"
