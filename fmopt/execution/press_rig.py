"""The rig for presses: many bodies in a physics engine, each at its own press, with what is off in each trial.

The controller decides by the measured pose since the start and the filtered wrench, each with its noise, as late as
the robot's delay; damping of translations is integrated implicitly by the engine.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from fmopt.execution.engines.engine import Engine
from fmopt.execution.press_controller import Controller, Errors
from fmopt.execution.press_servo import Ints
from fmopt.execution.summary import SHARE
from fmopt.plan.evidence import TrialOutcome
from fmopt.plan.press import PressPlan
from fmopt.runtime.clock import heed
from fmopt.spatial.values import Array


class PressRig(Controller):
    """n bodies in a physics engine, each with attempts of its own among those of a plan.

    Args:
        penetration: of a pose (7,), m, which is asked where the engine's own is more than a trial may have.
        noise: source of raw noise, (n, 12) standard normal at each call: of force, torque, position and angle.
    """

    def __init__(
        self,
        engine: Engine,
        plan: PressPlan,
        courses: Sequence[Sequence[int]],
        errors: Errors,
        penetration: Callable[[Array], float],
        noise: Callable[[], Array],
        look: Callable[[PressRig], None] | None = None,
    ) -> None:
        count, late = len(engine.qpos), round(plan.robot.delay / plan.robot.period) + 1
        super().__init__(plan, count, courses, errors, late, plan.robot.noise)
        self.engine, self.noise, self.look, self.penetration = engine, noise, look, penetration
        self._depth, self._outcomes = np.zeros(count), dict[int, TrialOutcome]()

    def run(self) -> list[TrialOutcome]:
        """Runs all bodies until each has an outcome.

        Raises:
            OverdueError: the time limit is used up.
        """
        while (active := np.flatnonzero(~self.done)).size:
            self.advance(active)
            if self.look is not None:
                self.look(self)
        return [self._outcomes[k] for k in range(len(self.done))]

    def advance(self, active: Ints) -> None:
        """One period of the bodies that are not done."""
        engine = self.engine
        if self.ticks % self._keep == 0:
            heed()
        wrench = self.command(active, engine.qpos, engine.qvel)
        engine.damp(self.state.resist[:, :3])
        engine.advance(wrench, self.plan.robot.period, active)
        for k in active[engine.deepest[active] > SHARE * self.fit.clearance].tolist():
            self._depth[k] = max(self._depth[k], self.penetration(engine.deepest_at[k]))
        self.observe(active, engine.qpos, engine.qvel, engine.reaction_over_period, self.noise())

    def _finish(self, k: int, stopped: str, depth: float = 0.0) -> tuple[Array, Array]:
        depth = max(float(self._depth[k]), min(float(self.engine.depth[k]), SHARE * self.fit.clearance))
        off, turned = super()._finish(k, stopped, depth)
        (x, y, z), (rx, ry, rz) = off.tolist(), turned.tolist()
        self._outcomes[k] = TrialOutcome(
            seated=not self.reasons[k],
            attempt=int(self.tried[k]),
            press=self.presses[self.last[k]].name,
            seconds=round(self.time, 6),
            peak_force=float(self.state.peak[k]),
            penetration=depth,
            reasons=tuple(self.reasons[k]),
            offset=(x, y, z),
            turn=(rx, ry, rz),
        )
        return off, turned
