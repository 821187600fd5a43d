"""What a run of a study computes: named quantities of one problem, as plain numbers and words."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias, TypeVar

from fmopt import plan
from fmopt.errors import FmoptError, InfeasibleError, InputError, InterferenceError, SearchError
from fmopt.plan import Plan
from fmopt.study.running.batch import Run, StudyContext
from fmopt.study.running.store import Row, Scalar
from fmopt.study.targets import assigned
from fmopt.task.loading import problem_of
from fmopt.task.problem import Problem
from fmopt.task.toml.source import Source, canonical_digest, read

if TYPE_CHECKING:
    from fmopt.geometry.clearance import Clearance
    from fmopt.planning.robustness.error_tolerance import CertifiedMotion

T = TypeVar("T")
NoAnswer: TypeAlias = InterferenceError | InfeasibleError | SearchError
TRIALS = 100  # of a plan that is executed, seed 0
_LONGEST = 500  # characters of a reason
_MOTIONS: dict[str, CertifiedMotion | NoAnswer] = {}  # the last of this process, by everything that it depends on


@dataclass(frozen=True)
class ComputedQuantity:
    """Something that can be computed of a problem, its columns in the order of the table."""

    columns: tuple[str, ...]
    answer: Callable[[Solved], Mapping[str, Scalar]]


class Solved:
    """One problem, and what is known of it so far: each stage is done when it is first asked for, wholly if `kept`."""

    def __init__(
        self, source: Source, problem: Problem, inputs: str, question: StudyContext, presses: Path | None
    ) -> None:
        self._source, self.problem, self._inputs, self._presses = source, problem, inputs, presses
        self._kept, self._tests = "plan" in question.keep, "evidence" in question.quantities

    @cached_property
    def clearance(self) -> Clearance:
        """The clearance as measured on the parts."""
        from fmopt.task.sizes import measured_clearance

        return measured_clearance(self.problem)

    @property
    def motion(self) -> CertifiedMotion:
        """The motion; runs that differ in the specification alone have the same one.

        Raises:
            InterferenceError, InfeasibleError, SearchError: there is none, found out once.
        """
        return _given(self._motion)

    @cached_property
    def _motion(self) -> CertifiedMotion | NoAnswer:
        from fmopt.planning.pipeline import certified_motion

        data = {key: value for key, value in self._source.data.items() if key not in ("title", "specification")}
        key = f"{self._inputs} {canonical_digest(data)}"
        if key not in _MOTIONS:
            done = _tried(lambda: certified_motion(self.problem))
            # One is enough where axes over the specification come last, as the last one varies fastest.
            _MOTIONS.clear()
            _MOTIONS[key] = done
        return _MOTIONS[key]

    @property
    def document(self) -> dict[str, Any]:
        """The plan; without what its verdict does not rest on unless it is kept.

        Raises:
            InterferenceError, InfeasibleError, SearchError: there is none, found out once.
        """
        return _given(self._written)

    @cached_property
    def plan(self) -> Plan:
        """The same, read back; errors as of `document`."""
        return plan.parsed(self.document)

    @cached_property
    def _written(self) -> dict[str, Any] | NoAnswer:
        from fmopt.planning.pipeline import planned, proved, tried_presses

        if self._tests:
            known = None if self._presses is None else plan.read(self._presses).press_plan
            return _tried(lambda: tried_presses(self.problem, known))
        return _tried(lambda: (planned if self._kept else proved)(self.problem, self.motion)[0])


def _tried(stage: Callable[[], T]) -> T | NoAnswer:
    try:
        return stage()
    except (InterferenceError, InfeasibleError, SearchError) as error:
        return error


def _given(found: T | NoAnswer) -> T:
    if isinstance(found, (InterferenceError, InfeasibleError, SearchError)):
        # It is raised for each quantity that asks: its traceback would grow each time, and hold what the frames hold.
        raise found.with_traceback(None)
    return found


def evaluate(run: Run, folder: Path) -> Row:
    """The row of a run: depends on the run, the files in the folder, and the program alone."""
    question = run.question
    source = assigned(read(folder / question.problem), run.assigned)
    try:
        presses = folder / question.plan if question.plan else None
        solved = Solved(source, problem_of(source), folder.name, question, presses)
    except InputError as error:
        words = "; ".join(f"{fault.key}: {fault.message}" for fault in error.faults)
        # The folder has another name on each host, and a row is the same on all of them.
        return Row(run.key, "input", words.replace(f"{folder}/", "")[:_LONGEST], {})
    answers: dict[str, Scalar] = {}
    reason = ""
    for name in question.quantities:
        quantity = QUANTITIES[name]
        # Columns without an answer are there, and empty; what an earlier quantity answered stays.
        answers = {**dict.fromkeys(quantity.columns), **answers}
        try:
            answers |= quantity.answer(solved)
        except (InterferenceError, InfeasibleError, SearchError) as error:
            verdict = "NOT_FOUND" if isinstance(error, SearchError) else "INFEASIBLE"
            answers |= {"verdict": verdict, "shortfall": _shortfall(error)}
            reason = reason or _why(error)
    kept = b""
    if "plan" in question.keep and answers.get("verdict") in ("CERTIFIED", "NOT_PROVED", "REFUTED", "TESTED"):
        kept = zlib.compress(plan.canonical(solved.document).encode(), 6)
    return Row(run.key, "done", reason, answers, kept)


def missing(name: str) -> str:
    """Why a quantity cannot be computed here; nothing when it can."""
    return "it needs MuJoCo" if name in ("execution", "evidence") and find_spec("mujoco") is None else ""


def _why(error: NoAnswer) -> str:
    """Why there is no answer, the same on any machine."""
    if isinstance(error, SearchError) and error.late:
        return "no motion was found before settings.time_limit"
    return " ".join(error.message.split())[:_LONGEST]


def _shortfall(error: FmoptError) -> float | None:
    """How much was missing, m, where the error says."""
    if isinstance(error, InterferenceError):
        return float(error.interference)
    return float(error.shortfall) if isinstance(error, InfeasibleError) and error.shortfall else None


def _clearance(solved: Solved) -> dict[str, Scalar]:
    """Measured clearance on each side, m."""
    # Play is infinite where nothing stops the part, and the store takes finite numbers only.
    x, y = (0.5 * float(width) if width < float("inf") else None for width in solved.clearance.play)
    return {"clearance": solved.clearance.per_side, "clearance_x": x, "clearance_y": y}


def _plan(solved: Solved) -> dict[str, Scalar]:
    found, search = solved.plan, solved.motion.found
    return {
        "verdict": found.verdict,
        "moves": len(search.names),
        "segments": len(found.segments),
        "cost": search.cost,
        "lower_bound": search.lower_bound,
    }


def _margins(solved: Solved) -> dict[str, Scalar]:
    """Least margin of the plan, m, and what binds it."""
    from fmopt.report.naming import binding_label

    found = solved.plan
    least = min(found.segments, key=lambda segment: segment.margin)
    return {
        "verdict": found.verdict,
        "margin": least.margin,
        "nominal_clearance": least.clearance,
        "binding_contact": least.binding,
        "binding_words": binding_label(found, least.binding),
        "binding_move": least.move + 1,
    }


def _tolerated(solved: Solved) -> dict[str, Scalar]:
    """The largest factor of the whole start box at which this motion, moved alike, is still certified."""
    from fmopt.planning.posed import under_errors
    from fmopt.planning.robustness.error_tolerance import largest_factor

    return {"tolerated_factor": largest_factor(under_errors(solved.motion, solved.problem))}


def _bias(solved: Solved) -> dict[str, Scalar]:
    """Whether every held contact can be held while the next is felt: the least normal force over all segments, N."""
    from fmopt.planning.control.controlled_motion import controlled

    try:
        strategies = [piece.strategy for piece in controlled(solved.problem, solved.motion).pieces]
    except InfeasibleError:
        return {"holds": False, "least_normal_force": 0.0}
    # No number where no contact is held: 0 would say that one can hardly be held.
    least = min((force for strategy in strategies for force in strategy.normal_forces.tolist()), default=None)
    push = max(strategy.push for strategy in strategies)
    return {"holds": True, "least_normal_force": least, "greatest_push": push}


def _execution(solved: Solved) -> dict[str, Scalar]:
    """Trials of the plan in the physics engine, errors uniform in the certified box; the share with its interval."""
    from fmopt.execution.trials import Trials, run
    from fmopt.study.results.shares import share

    successes = sum(bool(record["success"]) for record in run(solved.plan, Trials(TRIALS), range(TRIALS)))
    found = share(successes, TRIALS)
    return {
        "verdict": solved.plan.verdict,
        "trials": TRIALS,
        "successes": successes,
        "success": found.value,
        "success_low": found.low,
        "success_high": found.high,
    }


def _evidence(solved: Solved) -> dict[str, Scalar]:
    """Trials of presses, their errors the same draws in every run; `seats` has a digit for each, 1 where it seats."""
    found = solved.plan.trials
    assert found is not None  # else there is no plan
    median, late = found.cycle_times or (None, None)
    return {
        "verdict": solved.plan.verdict,
        "draws": found.draws,
        "seated": found.seated,
        "rate": found.seated / found.draws,
        "bound": found.bound,
        "first_tries": found.first_tries,
        "vertices_seated": found.vertices_seated,
        "cycle_time": median,
        "cycle_time_95": late,
        "seats": "".join(str(int(one.seated)) for one in found.outcomes),
    }


def _quantity(columns: str, answer: Callable[[Solved], Mapping[str, Scalar]]) -> ComputedQuantity:
    return ComputedQuantity(tuple(columns.split()), answer)


# Each has a verdict and a shortfall, which `evaluate` fills in where it has no answer.
QUANTITIES: Mapping[str, ComputedQuantity] = {
    "clearance": _quantity("clearance clearance_x clearance_y verdict shortfall", _clearance),
    "plan": _quantity("verdict shortfall moves segments cost lower_bound", _plan),
    "margins": _quantity(
        "verdict shortfall margin nominal_clearance binding_contact binding_words binding_move", _margins
    ),
    "tolerated_error": _quantity("verdict shortfall tolerated_factor", _tolerated),
    "bias": _quantity("verdict shortfall holds least_normal_force greatest_push", _bias),
    "execution": _quantity("verdict shortfall trials successes success success_low success_high", _execution),
    "evidence": _quantity(
        "verdict shortfall draws seated rate bound first_tries vertices_seated cycle_time cycle_time_95 seats",
        _evidence,
    ),
}
