"""From a problem to a plan: the way through the house as one function."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from fmopt import plan
from fmopt.certificate.knowledge import Assembly
from fmopt.certificate.segment import Tolerance
from fmopt.compiled import clock
from fmopt.errors import InfeasibleError, SearchError
from fmopt.knowledge.command import answer
from fmopt.motion import FINE, Progress, motion
from fmopt.nominal.freedom import freedom, half_widths
from fmopt.nominal.mapping import answered
from fmopt.nominal.trajectory import critical_poses
from fmopt.placement.bisection import ATTEMPTS, largest_share
from fmopt.placement.states import Scale, contact_spaces
from fmopt.placement.tolerated import Tolerated, tolerated
from fmopt.placement.visited import visited
from fmopt.plan import Plan
from fmopt.plan_record import Moved, Nominal, plan_document, proof_document
from fmopt.task.command import task_command
from fmopt.task.problem import Problem
from fmopt.task.sizes import characteristic_length, measured_clearance
from fmopt.uncertainty.error_set import ErrorSet
from fmopt.values import few_collections
from fmopt.verify import CERTIFIED, Verdict, verify


@dataclass(frozen=True, eq=False)
class Synthesis:
    """A finished synthesis: the plan document, the verdict of the independent check on it, and how long stages took."""

    document: dict[str, Any]
    verdict: Verdict
    seconds: dict[str, float]

    @cached_property
    def plan(self) -> Plan:
        """The plan, read back from the document."""
        return plan.parsed(self.document)

    @property
    def proved(self) -> bool:
        """Whether the plan is certified."""
        return _certified(self.verdict)


@few_collections()
def synthesise(problem: Problem, progress: Progress = lambda _: None) -> Synthesis:
    """Solves a problem, or as much of its start errors as there is a plan for where its settings ask for that.

    Then half of the time limit is for all of the errors, the other half for shares of them, the same for each.

    Args:
        problem: the task.
        progress: told what is being done.

    Raises:
        InterferenceError: the parts overlap when assembled, or their clearance is not positive.
        SearchError: no motion was found.
        InfeasibleError: no bias force holds the contacts.
    """
    if not problem.settings.reduce_errors:
        return _completed(_sketched(problem, progress), progress)
    settings = problem.settings
    half = replace(problem, settings=replace(settings, time_limit=0.5 * settings.time_limit))
    try:
        whole = _sketched(half, progress)
        verdict = proved(half, whole.done)[1]
        if _certified(verdict):
            return _completed(whole, progress)
        short = verdict.findings[0].message
    except (SearchError, InfeasibleError) as error:
        whole, short = None, error.message
    found = largest_share(lambda share: _for_share(problem, share, progress))
    if found is not None:
        share, part = found
        return _reduced(problem, share, _completed(part, progress), short)
    if whole is None:
        raise SearchError(f"no motion was found for any share of the start errors; for all of them: {short}")
    return _completed(whole, progress)


@dataclass(frozen=True, eq=False)
class _Sketch:
    """A problem with its motion, of which nothing else has been worked out, and the time that took."""

    problem: Problem
    done: Moved
    clock: _Clock


def _sketched(problem: Problem, progress: Progress) -> _Sketch:
    """A problem's motion; errors as of `synthesise`."""
    clock = _Clock()
    return _Sketch(problem, moved(problem, clock.lap, progress), clock)


def _completed(sketch: _Sketch, progress: Progress) -> Synthesis:
    """The synthesis that a motion is part of."""
    problem, done, clock = sketch.problem, sketch.done, sketch.clock
    progress("how much error the motion tolerates")
    x, y = (0.5 * play for play in done.clearance.play)
    under = done.under(problem, FINE)
    if problem.settings.method != "dakin1993":  # whose margins are others than those that the moves were certified with
        under = replace(under, known=done.placed.reached)
    measured = tolerated(under, (x, y))
    clock.lap("tolerances")
    document, verdict = planned(problem, done, clock.lap, progress, measured)
    return Synthesis(document, verdict, clock.laps)


def _for_share(problem: Problem, share: float, progress: Progress) -> _Sketch | None:
    """The motion for a share of the start errors, if it is proved; None when there is none."""
    settings = replace(problem.settings, time_limit=0.5 * problem.settings.time_limit / ATTEMPTS)
    part = replace(problem, start_box=share * problem.start_box, settings=settings)
    try:
        found = _sketched(part, lambda words: progress(f"{share:.0%} of the errors: {words}"))
        verdict = proved(part, found.done)[1]
    except (SearchError, InfeasibleError):
        return None
    return found if _certified(verdict) else None


def _certified(verdict: Verdict) -> bool:
    return str(verdict.verdict) == CERTIFIED


def _reduced(problem: Problem, share: float, found: Synthesis, short: str) -> Synthesis:
    """A plan for a share of the start errors, which proves nothing for all of them, and says so."""
    words = f"it is certified for {share:.0%} of the start errors that the problem states; for all of them: {short}"
    verdict = found.verdict.unless([words])
    verdict = replace(verdict, stated=str(verdict.verdict))
    document = {
        **found.document,
        "verdict": str(verdict.verdict),
        "diagnostics": {
            **found.document["diagnostics"],
            "reduced": {"share": share, "stated_start_box": problem.start_box.tolist(), "short": plan.line(short)},
        },
    }
    return Synthesis(plan.sealed(document), verdict, found.seconds)


@few_collections()
def moved(problem: Problem, lap: Callable[[str], None], progress: Progress = lambda _: None) -> Moved:
    """Measures the parts and finds the motion; errors as of `synthesise`.

    Args:
        problem: the task.
        lap: told which stage has ended.
        progress: told what is being done.
    """
    progress("measuring the parts")
    clearance = measured_clearance(problem)
    rho = characteristic_length(problem, clearance)
    assembly = Assembly(problem.moving, problem.fixed, planar=problem.plane is not None)
    tolerance = Tolerance((problem.velocity_error.translation, problem.velocity_error.rotation), rho)
    errors = ErrorSet.of(problem.start_box, problem.framing)
    lap("geometry")
    found, placed = motion(problem, assembly, clearance, errors, tolerance, lap, progress)
    return Moved(assembly, clearance, errors, tolerance, found, placed)


@few_collections()
def planned(
    problem: Problem,
    done: Moved,
    lap: Callable[[str], None],
    progress: Progress = lambda _: None,
    measured: Tolerated | None = None,
) -> tuple[dict[str, Any], Verdict]:
    """The sealed plan of a motion, and the verdict of the independent check on it; errors as of `synthesise`.

    Args:
        problem: the task.
        done: its motion.
        lap: told which stage has ended.
        progress: told what is being done.
        measured: how much error the motion tolerates, where that is to be in the plan.
    """
    rho = done.tolerance.rho
    progress("nominal trajectory")
    nominal = nominal_motion(problem, done.errors, rho)
    lap("nominal")

    progress("contact states on the way")
    scale = Scale(done.clearance.per_side, rho)
    spaces = contact_spaces(done.assembly, nominal.critical, scale)
    states = visited(done.assembly, done.placed.reached.claims, spaces, scale)
    lap("contact")

    progress("control strategies")
    document = plan_document(problem, nominal, states, done, measured)
    lap("control")

    progress("checking the certificate")
    checked = _checked(document)
    lap("verify")
    return checked


def proved(problem: Problem, done: Moved) -> tuple[dict[str, Any], Verdict]:
    """The plan of a motion without what its verdict does not rest on: nominal trajectory, contact states, tolerances.

    Raises:
        InfeasibleError: no bias force holds the contacts.
    """
    return _checked(proof_document(problem, done))


def _checked(document: dict[str, Any]) -> tuple[dict[str, Any], Verdict]:
    """The sealed plan with its verdict, which the independent check gives."""
    hoped = plan.sealed({**document, "verdict": CERTIFIED})
    verdict = verify(hoped)
    if _certified(verdict):
        return hoped, verdict
    stated = str(verdict.verdict)
    return plan.sealed({**document, "verdict": stated}), replace(verdict, stated=stated)


class _Clock:
    def __init__(self) -> None:
        self.laps: dict[str, float] = {}
        self._last = clock()

    def lap(self, name: str) -> None:
        now = clock()
        self.laps[name] = self.laps.get(name, 0.0) + now - self._last
        self._last = now


def nominal_motion(problem: Problem, errors: ErrorSet, rho: float) -> Nominal:
    """T-C mapping: the nominal trajectory, its critical poses, and S(t) for the start errors or the given trapezoid.

    P(t) comes from the cut-diagrams. S(t) is that of the parts in space, which holds where three planes see too little.
    """
    box = errors.support(np.eye(6)) if problem.trapezoid is None else half_widths(*problem.trapezoid)
    found = answer(*task_command(problem))
    made = answered(found, box, rho)
    reach = float(np.linalg.norm(box[:3]) + 2.0 * rho * np.linalg.norm(box[3:]))
    critical = critical_poses(problem.moving, problem.fixed, made.path, max(reach, 1e-3))
    freedoms = freedom(problem.moving, problem.fixed, made.path, box)
    return Nominal(made.path, critical, freedoms, found, made)
