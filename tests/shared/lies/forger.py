"""Forges plans: tells a lie of them and derives every other number anew, so that nothing but the lie is wrong.

See forging.py for how to do so at length.
"""

import json
import random
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from fmopt.verify import CERTIFIED, PlanError, verify
from tests.shared.executions.model import execute
from tests.shared.lies import edge as lies_edge
from tests.shared.lies import motion as lies_motion
from tests.shared.lies import problem as lies_problem
from tests.shared.lies import said as lies_said
from tests.shared.lies import solids as lies_solids
from tests.shared.lies.lie import CONSTRUCTION, PROBLEM, Document, Lie
from tests.shared.lies.restate import restated
from tests.shared.plans.table_plan import sealed

LIES: tuple[Lie, ...] = (*lies_solids.LIES, *lies_edge.LIES, *lies_motion.LIES, *lies_problem.LIES, *lies_said.LIES)
Differences = Callable[[Document], Sequence[str]]
_MOTION = ("parts", "contacts", "segments", "uncertainty", "touch_tolerance")  # what executions look at


def forged(plan: Document, lie: Lie, seed: int) -> Document | None:
    """An honest plan, left as it is, with a lie, sealed; None where it has nothing of the kind to lie about."""
    # Through text, so that nothing that a part and its piece share in memory is altered in both.
    found: Document = json.loads(json.dumps(lie.base() if lie.base is not None else plan))
    if not lie.tell(found, random.Random(f"{lie.name} {seed}")):
        return None
    return restated(found) if lie.settled else sealed(found)


@dataclass(frozen=True)
class Judged:
    """What became of a plan that was tampered with, and the processor time of its check, s.

    `false` says why it should not have been accepted, empty where nothing says so.
    """

    accepted: bool
    false: str
    seconds: float


@dataclass(frozen=True)
class Court:
    """Who judges plans that were made of an honest one."""

    honest: Document  # the plan that they were made of
    differences: Differences | None  # what a plan states otherwise than its problem; None where it has none
    executions: int  # how many are sampled of a plan that passes

    def judge(self, plan: Document, oracle: str) -> Judged:
        """Has a plan checked, and where it passes, asks an oracle whether it is false."""
        began = time.process_time()
        try:
            accepted = verify(plan).verdict == CERTIFIED
        except PlanError:
            accepted = False
        took = time.process_time() - began
        if accepted and oracle == PROBLEM and self.differences is not None:
            accepted = not self.differences(plan)
            return Judged(accepted, "false of its problem" if accepted else "", took)
        if accepted and oracle == CONSTRUCTION:
            return Judged(True, "false by construction", took)
        return Judged(accepted, self._refutation(plan) if accepted else "", took)

    def _refutation(self, plan: Document) -> str:
        """What an execution of a plan on its own geometry does that the plan rules out; empty where none does."""
        if all(plan.get(key) == self.honest.get(key) for key in _MOTION):
            return ""
        broken = execute(plan, self.executions, seed=0, steps=4).broken
        return ", ".join(f"{check} in segment {k} by {-slack:.3g}" for (check, k), slack in sorted(broken.items())[:3])
