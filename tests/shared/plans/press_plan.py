"""A plan of presses for the square peg, from the first sequences of the library, with evidence made up by hand.

Nothing is carried out for it: the check takes outcomes as they are stated.
"""

import copy
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np

from fmopt.execution.confidence import lower_bound
from fmopt.execution.press_controller import Errors
from fmopt.execution.press_trials import carry_out, count_presses, drawn_errors
from fmopt.plan import digest, sealed
from fmopt.plan.description import TracePose
from fmopt.plan.evidence import CONFIDENCE, Evidence, TrialOutcome
from fmopt.plan.field_types import numbers
from fmopt.plan.press import Conditions, PressPlan
from fmopt.planning.posed import Posed
from fmopt.planning.press.choice import Choosing
from fmopt.planning.press.library import robot_of
from fmopt.planning.press.propose import proposals
from fmopt.planning.press.record import press_document
from fmopt.planning.press.task import PressTask
from fmopt.spatial.se3 import Pose, exp
from fmopt.task.problem import Problem, load
from fmopt.verify.reading.parse import SUBJECT
from tests import PROBLEMS

BASE = Pose(np.array([0.4, -0.1, 0.2]), exp([0.2, -0.4, 0.7]))  # of the hole, for robots that carry the plan out
DRAWS, MIN_RATE = 10, 0.5


@cache
def press_problem() -> Problem:
    """The square peg, with a tested plan asked for."""
    problem = load(PROBLEMS / "square_peg.toml")
    settings = replace(problem.settings, evidence="tested", draws=DRAWS, min_rate=MIN_RATE)
    return replace(problem, settings=settings)


def press_task(problem: Problem) -> PressTask:
    """The insertion of a problem as presses see it."""
    return PressTask(problem, problem.moving, problem.fixed, Posed.of(problem).clearance, problem.start_box)


def choosing_of(task: PressTask) -> Choosing:
    """What candidates for an insertion are carried out with."""
    conditions = Conditions(numbers(task.box), task.problem.friction)
    return Choosing(task.bodies, task.seat, robot_of(task, (2e4, 100.0), (2.0, 0.0098)), conditions, seed=0)


@cache
def press_choosing() -> Choosing:
    """What candidates for the square peg are carried out with."""
    return choosing_of(press_task(press_problem()))


@cache
def press_plan() -> PressPlan:
    """Two attempts at one corner."""
    return press_choosing().plan(proposals(press_task(press_problem()))[:2])


def drawn(count: int) -> tuple[Errors, list[TrialOutcome]]:
    """The first draws of its evidence, and what becomes of the part in them."""
    errors = drawn_errors(press_choosing().conditions, count_presses(press_plan()), 1, range(count))
    return errors, carry_out(press_choosing().bodies, press_plan(), errors, 1, range(count))


def outcomes(seats: Sequence[bool]) -> tuple[TrialOutcome, ...]:
    """Outcomes of trials that seat at once, or go back from the third press and fail in the next attempt."""
    zero, failed = (0.0, 0.0, 0.0), ("stopped on the way", "tilted")
    places = ((0, False, 5e-3), (2, False, 1e-3), (2, True, 1e-3), (11, False, 5e-3), *((17, False, 0.0),) * 2)
    way = tuple(TracePose(float(k), n, (0.0, 0.0, z, 0.1, 0.0, 0.0), back) for k, (n, back, z) in enumerate(places))
    good = TrialOutcome(True, 0, "go in", 8.0, 14.0, 0.0, (), zero, zero, ((zero,) * 7,))
    bad = TrialOutcome(False, 1, "go in", 8.0, 14.0, 0.0, failed, zero, zero, ((zero,) * 3, (zero,) * 7), way)
    return tuple(good if seat else bad for seat in seats)


@cache
def _document() -> dict[str, Any]:
    evidence = Evidence(
        *("tested", DRAWS, DRAWS, DRAWS, CONFIDENCE, lower_bound(DRAWS, DRAWS), MIN_RATE, 64, 63, 1, 0, "by hand"),
        *(press_choosing().conditions, "0" * 64, outcomes([True] * DRAWS), outcomes([True] * 63 + [False])),
    )
    return restated({**press_document(Posed.of(press_problem()), press_plan(), evidence), "verdict": "TESTED"})


def press_plan_document() -> dict[str, Any]:
    """The plan file, sealed and TESTED; a copy to be changed at will."""
    return copy.deepcopy(_document())


def restated(document: dict[str, Any], subject: bool = True) -> dict[str, Any]:
    """The document sealed anew, with its evidence stated to be of its own parts, presses and goal if asked for."""
    if subject:
        stated = digest({key: document[key] for key in SUBJECT})
        document = {**document, "evidence": {**document["evidence"], "subject": stated}}
    return sealed(document)
