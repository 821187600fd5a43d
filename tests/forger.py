"""Forges plans: tells a lie of them and derives every other number anew, so that nothing but the lie is wrong.

python tests/forger.py --count 10000 --seed 0 --plans out/*/plan.json, to forge at length, with random mutants between.
"""

from __future__ import annotations

import argparse
import json
import random
import time
import traceback
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import lies_motion
import lies_said
import lies_solids
import numpy as np
from execution_model import execute
from lies import CONSTRUCTION, PROBLEM, Document, Lie
from plan_mutations import junk
from restate import restated
from table_plan import sealed

from fmopt.verify import CERTIFIED, PlanError, verify

LIES: tuple[Lie, ...] = (*lies_solids.LIES, *lies_motion.LIES, *lies_said.LIES)
Differences = Callable[[Document], Sequence[str]]


def forged(plan: Document, lie: Lie, seed: int) -> Document | None:
    """A plan with a lie, sealed; None where it has nothing of the kind to lie about.

    Args:
        plan: an honest one; it is left as it is.
        lie: the kind of lie.
        seed: of what is drawn.

    Raises:
        PlanError: the lie left no plan.
    """
    found: Document = json.loads(json.dumps(lie.base() if lie.base is not None else plan))
    if not lie.tell(found, random.Random(f"{lie.name} {seed}")):
        return None
    return restated(found) if lie.settled else sealed(found)


@dataclass(frozen=True)
class Judged:
    """What became of a forged plan: whether it was accepted, why it should not have been, and what the check took, s."""

    accepted: bool
    false: str
    seconds: float


def judged(plan: Document, lie: Lie, differences: Differences | None, executions: int, seed: int = 0) -> Judged:
    """Has a forged plan checked, and where it is accepted, asks the oracle whether it is false.

    Args:
        plan: the forged plan.
        lie: what was told.
        differences: what a plan states otherwise than its problem; None where it has none.
        executions: how many are sampled.
        seed: of the executions.
    """
    began = time.process_time()
    try:
        accepted = verify(plan).verdict == CERTIFIED
    except PlanError:
        accepted = False
    took = time.process_time() - began
    if not accepted:
        return Judged(False, "", took)
    if lie.oracle == CONSTRUCTION:
        return Judged(True, "false by construction", took)
    if lie.oracle == PROBLEM and differences is not None:
        told = differences(plan)
        return Judged(not told, "" if told else "false of its problem", took)
    return Judged(True, refutation(plan, executions, seed), took)


def refutation(plan: Document, executions: int, seed: int) -> str:
    """What an execution of a plan on its own geometry does that the plan rules out; empty where none does."""
    with np.errstate(all="raise", under="ignore"):
        broken = execute(plan, executions, seed, steps=4).broken
    return ", ".join(f"{check} in segment {k} by {-slack:.3g}" for (check, k), slack in sorted(broken.items())[:3])
