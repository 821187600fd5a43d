"""The whole way from a problem to a plan, each stage with what it hands to the next.

Problem → Posed (assembly, errors) → CertifiedMotion → ControlledMotion → plan document → Verdict
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any, TypeVar

import numpy as np

from fmopt import plan
from fmopt.certificate.error_set import ErrorSet
from fmopt.contact.state_graph import Scale
from fmopt.errors import FmoptError, InfeasibleError, OverdueError, SearchError
from fmopt.geometry.clearance import Clearance
from fmopt.papers.lee_huang.freedom import freedom, half_widths
from fmopt.papers.lee_huang.mapping import answered
from fmopt.papers.lee_huang.nominal_trajectory import critical_poses
from fmopt.plan import Plan
from fmopt.plan.description import CarriedOut, Description
from fmopt.plan.diagnostics import ErrorTolerance, Reduced
from fmopt.plan.evidence import median_and_late
from fmopt.plan.field_types import numbers
from fmopt.plan.press import PressPlan
from fmopt.planning.control.controlled_motion import controlled
from fmopt.planning.motion import Failed, motion
from fmopt.planning.optimise.bisection import ATTEMPTS, largest_share
from fmopt.planning.plan_record import Described, NominalMotion, plan_document, proof_document
from fmopt.planning.posed import Posed, Progress, Stages, under_errors
from fmopt.planning.robustness.contact_space import contact_spaces
from fmopt.planning.robustness.error_tolerance import CertifiedMotion, error_tolerance
from fmopt.planning.robustness.state_trace import Visited, visited
from fmopt.runtime.clock import clock, deadline, heed, until
from fmopt.runtime.compiled import undisturbed
from fmopt.runtime.pool import share_out
from fmopt.runtime.process import cores
from fmopt.task.problem import Problem, Settings, VelocityError
from fmopt.task.task_command import problem_answer
from fmopt.verify import CERTIFIED, TESTED, Verdict, verify

_CHECKING = 4.0  # s beyond the time limit for the check of what there is by then
_ALONE = 0.5  # of the time for the nearest problem, what is for start errors alone
RESERVED = 0.25  # of the time limit, what commands keep to find the nearest problem that works

T = TypeVar("T")


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
        return str(self.verdict.verdict) == CERTIFIED

    def carried_out(self, settings: Settings, progress: Progress = lambda _: None) -> "Synthesis":
        """The same with trials of its guarded moves, as many as settings have draws, which change no verdict."""
        if not (self.proved and settings.draws) or self.plan.description.carried_out is not None:
            return self
        from fmopt.execution.confidence import lower_bound
        from fmopt.execution.engines.mujoco_engine import version
        from fmopt.execution.trials import Trials, run

        progress(f"trials: {settings.draws} draws")
        draws, workers, records = settings.draws, cores(), list[Any]()
        trials = partial(run, self.plan, Trials(draws, seed=settings.seed))
        chunks = [range(k, draws, workers) for k in range(min(workers, draws))]
        share_out([partial(trials, chunk) for chunk in chunks], workers, records.extend)
        seated = sum(record["success"] for record in records)
        times = median_and_late([record["seconds"] for record in records if record["success"]])
        bound = lower_bound(seated, draws)
        found = CarriedOut(draws, seated, bound, settings.min_rate, settings.seed, version(), times)
        described = replace(Description.parsed(self.document["description"]), carried_out=found)
        document = plan.sealed(plan.clean({**self.document, "description": described.record()}))
        return replace(self, document=document)


@dataclass(frozen=True)
class CertifiedShare:
    """The largest share of the start errors, or 0, that is proved, its least margin, m, and whether time ran out."""

    share: float
    margin: float
    late: bool
    velocity: VelocityError


@undisturbed()
def synthesise(problem: Problem, progress: Progress = lambda _: None, reserved: float = 0.0) -> Synthesis:
    """Solves a problem, or as much of its start errors as there is a plan for where its settings ask for that.

    Raises:
        InterferenceError: the parts overlap when assembled, or their clearance is not positive.
        SearchError: no motion was found.
        InfeasibleError: no bias force holds the contacts.
    """
    with until(clock() + problem.settings.time_limit):
        if problem.settings.evidence == "certified" and _is_enclosed(problem):
            raise SearchError("nothing is certified of enclosed parts", advice='state settings.evidence = "tested"')
        if problem.settings.evidence == "tested" and problem.plane is None:
            return _tested(problem, Stages(progress))
        if problem.settings.reduce_errors:
            return _for_as_much(problem, progress)
        stages = Stages(progress)
        found = certified_motion(_within(problem, (1.0 - reserved) * problem.settings.time_limit), stages)
        return _completed(problem, found, stages)


def _tested(problem: Problem, stages: Stages) -> Synthesis:
    """A plan of presses, carried out; where it stays below the rate asked for, guarded moves that reach it.

    Raises:
        SearchError, InfeasibleError, OverdueError: there are neither presses nor guarded moves.
    """
    from fmopt.planning.press.record import press_document
    from fmopt.planning.press.solve import press_solution

    stages.progress("measuring the parts")
    posed = Posed.of(problem)
    stages.ended("geometry")
    try:
        found = press_solution(posed, stages.progress)
    except (SearchError, OverdueError) as error:
        if _only_presses(problem):
            raise
        stages.progress(f"presses: {error.message}")
        stages.ended("presses")
        heed()
        left = _within(problem, deadline() - clock())
        return _completed(left, certified_motion(left, stages), stages)
    stages.ended("presses")
    share = None
    if found.evidence is not None and found.evidence.level != "tested" and not _only_presses(problem):
        stages.progress("guarded moves: for all of the errors, then for shares of them")
        whole = _certified_whole(problem, stages)
        if whole is None:
            share = nearest(problem, max(deadline() - clock(), 0.0), stages.progress).share
        else:
            share, whole = 1.0, whole.carried_out(problem.settings, stages.progress)
            carried = whole.plan.description.carried_out
            most = problem.settings.max_time or math.inf
            in_time = carried is not None and (carried.times is None or carried.times[1] <= most)
            if carried is not None and carried.bound >= problem.settings.min_rate and in_time:
                return whole
        stages.ended("share")
    described = {"certified_share": share, "untried": found.untried}
    document, verdict = _checked(
        press_document(posed, found.plan, found.evidence, found.trace, placed=found.placed, **described), TESTED
    )
    stages.ended("verify")
    return Synthesis(document, verdict, stages.seconds)


@undisturbed()
def tried_presses(problem: Problem, known: PressPlan | None = None) -> dict[str, Any]:
    """The sealed plan of presses with its evidence; of known presses as they are, if any.

    Raises:
        InterferenceError, SearchError: there are no presses, or there is no time for their trials.
    """
    from fmopt.planning.press.record import press_document
    from fmopt.planning.press.solve import press_solution, tried_again

    with until(clock() + problem.settings.time_limit):
        posed = Posed.of(problem)
        try:
            found = press_solution(posed) if known is None else tried_again(posed, known)
        except OverdueError as error:
            raise SearchError(error.message, error.advice, late=True) from error
    if found.evidence is None:
        raise SearchError(found.untried, late=True)
    return _checked(press_document(posed, found.plan, found.evidence, found.trace, placed=found.placed), TESTED)[0]


def _only_presses(problem: Problem) -> bool:
    """Whether no guarded moves are planned: nothing is proved of enclosed parts, and nothing kept clear of."""
    return _is_enclosed(problem) or bool(problem.cell.solids)


def _is_enclosed(problem: Problem) -> bool:
    return problem.moving.enclosed or problem.fixed.enclosed


def _certified_whole(problem: Problem, stages: Stages) -> Synthesis | None:
    """A certified plan of guarded moves in half of the time that is left, or none."""
    part = _within(problem, 0.5 * (deadline() - clock()))
    try:
        with until(clock() + part.settings.time_limit):
            found = _completed(part, certified_motion(part, stages), stages)
    except (SearchError, InfeasibleError, OverdueError):
        return None
    return found if found.proved else None


def nearest(problem: Problem, seconds: float, progress: Progress = lambda _: None) -> CertifiedShare:
    """The largest share of the start errors, in steps of 5 %, below that of 1 %, for which a plan is proved.

    Where there is none with the errors of velocity as they are, which add up on the way however little is off at the
    start, that of all errors alike is looked for.
    """
    stated, lates, end = problem.velocity_error, list[bool](), clock() + seconds
    moves = bool(stated.translation or stated.rotation)
    found = _largest_share(problem, _ALONE * seconds if moves else seconds, progress, lambda _: stated, lates)
    if found is None and moves:
        found = _largest_share(problem, end - clock(), progress, stated.scaled, lates)
    if found is None:
        return CertifiedShare(0.0, 0.0, any(lates), stated)
    share, (part, motion, _) = found
    return CertifiedShare(share, motion.placed.margin, any(lates), part.velocity_error)


_Part = tuple[Problem, CertifiedMotion, Stages]
"""A problem with a share of the errors, its motion, and the stages that led to it."""


def _largest_share(
    problem: Problem, seconds: float, progress: Progress, velocity: Callable[[float], VelocityError], lates: list[bool]
) -> tuple[float, _Part] | None:
    """The largest share of the start errors, each with its errors of velocity, for which a motion is proved.

    Each try has the same part of the time that is left; whether one failed for want of time is noted in `lates`.
    """
    end, before = clock() + seconds, len(lates)

    def of(share: float) -> _Part | None:
        left = max(end - clock(), 0.0) / max(ATTEMPTS - (len(lates) - before), 1)
        part = replace(_within(problem, left).under(share), velocity_error=velocity(share))
        return _for_share(part, share, progress, lates)

    with until(end):
        return largest_share(of)


def _within(problem: Problem, seconds: float) -> Problem:
    """The problem with another time limit."""
    return replace(problem, settings=replace(problem.settings, time_limit=seconds))


def tried(problem: Problem) -> Clearance:
    """The measured clearance of a problem, once all has been tried that a plan of it needs to begin with.

    Raises:
        InterferenceError: the parts overlap when assembled, or their clearance is not positive.
        GeometryError, TaskError: a plan cannot be made of the problem as it is; as `synthesise` would raise them.
    """
    posed = Posed.of(problem)
    problem_answer(problem)
    return posed.clearance


@undisturbed()
def certified_motion(problem: Problem, stages: Stages | None = None) -> CertifiedMotion:
    """Measures the parts and finds the motion; errors as of `synthesise`.

    Raises:
        SearchError: tool or obstacles are to be kept clear of.
    """
    if problem.cell.solids:
        message = "guarded moves do not keep clear of tool and obstacles"
        raise SearchError(message, 'ask for evidence = "tested", or leave them out')
    stages = stages or Stages()
    stages.progress("measuring the parts")
    posed = Posed.of(problem)
    stages.ended("geometry")
    return posed.certified(*motion(posed, stages))


def _completed(problem: Problem, motion: CertifiedMotion, stages: Stages) -> Synthesis:
    """A motion with its plan, and how much error it tolerates, where there is time to find out."""
    stages.progress("how much error the motion tolerates")
    measured, notes = _described("how much error it tolerates", lambda: _error_tolerance(problem, motion))
    stages.ended("tolerances")
    try:
        document, verdict = planned(problem, motion, stages, measured, notes)
    except InfeasibleError as error:
        error.attempt = Failed("control", motion.placed.moves, motion.found.names, seated=True)
        raise
    return Synthesis(document, verdict, stages.seconds)


@undisturbed()
def planned(
    problem: Problem,
    motion: CertifiedMotion,
    stages: Stages | None = None,
    measured: ErrorTolerance | None = None,
    notes: tuple[str, ...] = (),
) -> tuple[dict[str, Any], Verdict]:
    """The sealed plan of a motion, and the verdict of the independent check on it; errors as of `synthesise`.

    What its verdict does not rest on is left out where there is no time for it.
    """
    stages = stages or Stages()
    try:
        heed()
        stages.progress("nominal trajectory")
        task = problem_answer(problem)
        nominal, lost = _described(
            "the nominal trajectory", lambda: nominal_motion(problem, motion.errors, motion.tolerance.rho)
        )
        stages.ended("nominal")
        states, unseen = _described("its way through contact states", lambda: _contact_states(motion, nominal))
        stages.ended("contact")
        stages.progress("control strategies")
        told = Described(task, nominal, states, measured, (*notes, *lost, *unseen))
        with until(math.inf):  # strategies are part of the proof, not of what only describes the motion
            document = plan_document(problem, told, controlled(problem, motion, ranges=True))
    except OverdueError:
        with until(math.inf):  # a motion that is certified is worth the second that this takes
            document = proof_document(problem, controlled(problem, motion))
    stages.ended("control")
    stages.progress("checking the certificate")
    checked = _checked(document)
    stages.ended("verify")
    return checked


def _described(name: str, found: Callable[[], T]) -> tuple[T | None, tuple[str, ...]]:
    """What only describes a motion; None with a note why where it cannot be found, which costs no plan."""
    try:
        heed()
        return found(), ()
    except FmoptError as error:
        return None, (f"{name} is left out: {error.message}",)


def proved(problem: Problem, motion: CertifiedMotion) -> tuple[dict[str, Any], Verdict]:
    """The plan of a motion without what its verdict does not rest on: nominal trajectory, contact states, tolerances.

    Raises:
        InfeasibleError: no bias force holds the contacts.
    """
    return _checked(proof_document(problem, controlled(problem, motion)))


def nominal_motion(problem: Problem, errors: ErrorSet, rho: float) -> NominalMotion:
    """T-C mapping: the nominal trajectory, its critical poses, and S(t) for the start errors or the given trapezoid.

    P(t) comes from the cut-diagrams. S(t) is that of the parts in space, which holds where three planes see too little.
    """
    found = problem_answer(problem)
    box = errors.support(np.eye(6)) if problem.trapezoid is None else half_widths(*problem.trapezoid)
    made = answered(found, box, rho)
    reach = float(np.linalg.norm(box[:3]) + 2.0 * rho * np.linalg.norm(box[3:]))
    critical = critical_poses(problem.moving, problem.fixed, made.path, max(reach, 1e-3))
    return NominalMotion(made.path, critical, freedom(problem.moving, problem.fixed, made.path, box), found, made)


def _contact_states(motion: CertifiedMotion, nominal: NominalMotion | None) -> Visited:
    """The contact states that a motion goes through, in the spaces around critical poses."""
    scale = Scale(motion.clearance.per_side, motion.tolerance.rho)
    spaces = contact_spaces(motion.assembly, () if nominal is None else nominal.critical, scale)
    return visited(motion.assembly, motion.claims, spaces, scale)


def _error_tolerance(problem: Problem, motion: CertifiedMotion) -> ErrorTolerance:
    """How much error a motion tolerates, from the margins that its moves were certified with where these are sound."""
    x, y = (0.5 * play for play in motion.clearance.play)
    under = under_errors(motion, problem)
    if problem.settings.method != "dakin1993":
        under = replace(under, known=motion.placed.reached)
    return error_tolerance(under, (x, y))


def _checked(document: dict[str, Any], hope: str = CERTIFIED) -> tuple[dict[str, Any], Verdict]:
    """The sealed plan with its verdict, which the independent check gives."""
    # The verdict is sealed with the rest: the check reads the very plan that there is if it agrees.
    hoped, last = plan.sealed({**document, "verdict": hope}), deadline() + _CHECKING
    verdict = verify(hoped, overdue=lambda: clock() > last)
    if str(verdict.verdict) == hope:
        return hoped, verdict
    stated = str(verdict.verdict)
    return plan.sealed({**document, "verdict": stated}), replace(verdict, stated=stated)  # what it read was a hope


def _for_as_much(problem: Problem, progress: Progress) -> Synthesis:
    """A plan for all of the start errors if there is one, else for the largest share for which one is proved.

    Half of the time limit is for all of the errors, the other half for shares of them.
    """
    settings, stages = problem.settings, Stages(progress)
    half = _within(problem, 0.5 * settings.time_limit)
    try:
        whole = certified_motion(half, stages)
        verdict = proved(half, whole)[1]
        if str(verdict.verdict) == CERTIFIED:
            return _completed(half, whole, stages)
        short = verdict.findings[0].message
    except (SearchError, InfeasibleError) as error:
        whole, short = None, error.message
    found = _largest_share(problem, 0.5 * settings.time_limit, progress, lambda _: problem.velocity_error, [])
    if found is not None:
        share, (part, motion, own) = found
        return _reduced(problem, share, _completed(part, motion, own), short)
    if whole is None:
        raise SearchError(f"no motion was found for any share of the start errors; for all of them: {short}")
    return _completed(half, whole, stages)


def _for_share(part: Problem, share: float, progress: Progress, lates: list[bool]) -> _Part | None:
    """The motion for a problem with a share of the errors, if it is proved in its time; None when there is none."""
    stages = Stages(lambda words: progress(f"{share:.0%} of the errors: {words}"))
    try:
        motion = certified_motion(part, stages)
        verdict = proved(part, motion)[1]
    except (SearchError, InfeasibleError, OverdueError) as error:
        lates.append(isinstance(error, OverdueError) or (isinstance(error, SearchError) and error.late))
        return None
    lates.append(False)
    return (part, motion, stages) if str(verdict.verdict) == CERTIFIED else None


def _reduced(problem: Problem, share: float, found: Synthesis, short: str) -> Synthesis:
    """A plan for a share of the start errors, which proves nothing for all of them, and says so."""
    words = f"it is certified for {share:.0%} of the start errors that the problem states; for all of them: {short}"
    verdict = found.verdict.unless([words])
    verdict = replace(verdict, stated=str(verdict.verdict))
    reduced = Reduced(share, numbers(problem.start_box), plan.line(short))
    described = Description.parsed(found.document["description"])
    assert described.diagnostics is not None
    described = replace(described, diagnostics=replace(described.diagnostics, reduced=reduced))
    document = {**found.document, "verdict": str(verdict.verdict), "description": described.record()}
    return Synthesis(plan.sealed(plan.clean(document)), verdict, found.seconds)
