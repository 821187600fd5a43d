"""The rig for presses: many bodies in a physics engine, each at its own press, with what is off in each trial.

The controller decides by the measured pose since the start and the filtered wrench, each with its noise, as late as
the robot's delay; damping of translations is integrated implicitly by the engine.
"""

from __future__ import annotations

from bisect import bisect
from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np

from fmopt.execution.engines.engine import Engine
from fmopt.execution.kept_clear import KeptClear
from fmopt.execution.press_controller import Controller, Errors
from fmopt.execution.press_servo import Ints
from fmopt.execution.rotation import between
from fmopt.execution.summary import SHARE
from fmopt.plan.description import TracePose
from fmopt.plan.evidence import TOUCH, Three, TrialOutcome
from fmopt.plan.field_types import numbers
from fmopt.plan.press import PressPlan
from fmopt.runtime.clock import heed
from fmopt.spatial.values import Array

_MAX_POSES = 60  # of a way, beside those at which a press begins or ends


class PressRig(Controller):
    """n bodies in a physics engine, each with attempts of its own among those of a plan.

    Args:
        penetration: of a pose (7,), m, which is asked where the engine's own is more than a trial may have.
        noise: source of raw noise, (n, 12) standard normal at each call: of force, torque, position and angle.
        clear: of what the bodies have to keep clear, if of anything.
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
        clear: KeptClear | None = None,
    ) -> None:
        count, late = len(engine.qpos), round(plan.robot.delay / plan.robot.period) + 1
        super().__init__(plan, count, courses, errors, late, plan.robot.noise)
        self.engine, self.noise, self.look, self.penetration, self.clear = engine, noise, look, penetration, clear
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
        if self.clear is not None:
            self.clear.see(engine.qpos, active)
        for k in active[engine.deepest[active] > SHARE * self.fit.clearance].tolist():
            self._depth[k] = max(self._depth[k], self.penetration(engine.deepest_at[k]))
        self.observe(active, engine.qpos, engine.qvel, engine.reaction_over_period, self.noise())

    def _finish(self, k: int, stopped: str, depth: float = 0.0) -> tuple[Array, Array]:
        depth = max(float(self._depth[k]), min(float(self.engine.depth[k]), SHARE * self.fit.clearance))
        off, turned = super()._finish(k, stopped, depth)
        (x, y, z), (rx, ry, rz) = off.tolist(), turned.tolist()
        distance = None if self.clear is None else float(self.clear.least[k])
        if self.clear is not None and self.clear.least[k] <= TOUCH:
            self.reasons[k].insert(0, f"{self.clear.nearest[k]} touch")
        self._outcomes[k] = TrialOutcome(
            seated=not self.reasons[k],
            attempt=int(self.tried[k]),
            press=self.presses[self.state.step[k]].name,
            seconds=round(self.time, 6),
            peak_force=float(self.state.peak[k]),
            penetration=depth,
            reasons=tuple(self.reasons[k]),
            offset=(x, y, z),
            turn=(rx, ry, rz),
            rests=self._rests(k),
            way=self._way(k) if self.reasons[k] else (),
            distance=distance,
        )
        return off, turned

    def _rests(self, k: int) -> tuple[tuple[Three, ...], ...]:
        """Where body k was at the end of each press, to 0.1 µm, by attempt."""
        ends = [begin for begin, _, _ in self._begins[k][1:]] + [len(self._trail)]
        # Later entries of a press are the hold after it, by which it is judged.
        found = {step: end for end, (_, step, back) in zip(ends, self._begins[k], strict=True) if not back}
        rests = {step: np.round(self._trail[max(end - 1, 0)][k, :3], 7) + 0.0 for step, end in found.items()}
        attempts = [range(first, last) for first, last in pairwise([*self._first, len(self.presses)])]
        at = [[rests[step].tolist() for step in attempts[number] if step in rests] for number in self.courses[k]]
        return tuple(tuple((x, y, z) for x, y, z in points) for points in at if points)

    def _way(self, k: int) -> tuple[TracePose, ...]:
        """The way of body k so far, to 0.1 µm."""
        begins, steps, backs = zip(*self._begins[k], strict=True)
        count, every = len(self._trail), self._keep * self.plan.robot.period
        even = np.linspace(0, count - 1, _MAX_POSES).astype(int).tolist()
        shown = sorted({*even, *(min(one, count - 1) for one in begins)})
        q, rows = np.array([self._trail[at][k] for at in shown]), [bisect(begins, at) - 1 for at in shown]
        poses = np.round(np.hstack([q[:, :3], between(q[:, 3:], np.array([1.0, 0.0, 0.0, 0.0]))]), 7) + 0.0
        parts = zip(shown, rows, poses, strict=True)
        return tuple(TracePose(round(at * every, 6), steps[n], numbers(pose), backs[n]) for at, n, pose in parts)
