"""Motions of shipped problems, and those that the search finds from one way to begin, in fine pieces, not placed."""

from dataclasses import replace
from functools import cache
from itertools import islice
from typing import Any

from fmopt.certificate.assembly import Assembly
from fmopt.certificate.error_set import ErrorSet
from fmopt.certificate.segment_linearisation import Tolerance
from fmopt.planning.motion import drawing
from fmopt.planning.moves.moves import Reached
from fmopt.planning.pipeline import certified_motion, planned
from fmopt.planning.placement.sequence_program import certified
from fmopt.planning.posed import FINE, Posed
from fmopt.planning.robustness.error_tolerance import CertifiedMotion
from fmopt.planning.search.best_first import search
from fmopt.planning.search.entry import Approach, Entry, start_spread, tilted_entry
from fmopt.planning.search.entry_room import room
from fmopt.planning.search.successors import Costs, SearchTask
from fmopt.spatial.se3 import Pose
from fmopt.task.problem import Problem, VelocityError, load
from fmopt.task.sizes import characteristic_length, drift, measured_clearance
from tests import PROBLEMS


@cache
def shipped_motion(name: str) -> tuple[Problem, CertifiedMotion]:
    """A shipped problem and its motion."""
    problem = load(PROBLEMS / f"{name}.toml")
    return problem, certified_motion(problem)


def steadier(problem: Problem) -> Problem:
    """A problem with velocity errors whose two bounds, held at once, reach as far as one ball of what it states."""
    error, share = problem.velocity_error, 0.5**0.5
    return replace(problem, velocity_error=VelocityError(share * error.translation, share * error.rotation))


def drawn_shapes(problem: Problem, kind: int, count: int, seed: int = 0) -> list[Approach]:
    """Shapes that are drawn for a problem: the corner going in at once (0), touching (1), or laid flat first (2)."""
    shapes = drawing(Posed.of(problem)).shapes(seed)
    asked = (shape for shape in shapes if kind == (shape.touch is not None) + 2 * (shape.flat is not None))
    return [*islice(asked, count)]


def task_of(problem: Problem) -> SearchTask:
    """What a problem's search is about."""
    clearance = measured_clearance(problem)
    assembly = Assembly(problem.moving, problem.fixed, planar=problem.plane is not None)
    rates = problem.velocity_error.translation, problem.velocity_error.rotation
    tolerance = Tolerance(rates, characteristic_length(problem, clearance))
    roomy = room(assembly, clearance.per_side, problem.start_box, drift(problem, clearance))
    return SearchTask(
        assembly,
        Pose.from_vector(problem.goal),
        ErrorSet.from_box(problem.start_box),
        tolerance,
        Costs.of(start_spread(problem.moving, roomy), clearance.per_side),
        1.3 * problem.settings.max_tilt,
    )


def motion_from(problem: Problem, entry: Entry) -> CertifiedMotion:
    """What a problem's search and certificate make of an entry."""
    task = task_of(problem)
    found = search(task, [entry])
    done = certified(task.assembly, found.moves, Reached(task.start, (), ()), task.tolerance, FINE)
    return CertifiedMotion(task.assembly, measured_clearance(problem), task.start, task.tolerance, found.searched, done)


def certified_plan(problem: Problem, motion: CertifiedMotion) -> dict[str, Any]:
    """The plan of a motion, which the check certifies."""
    document, verdict = planned(problem, motion)
    assert str(verdict.verdict) == "CERTIFIED"
    return document


def leaving(plan: dict[str, Any]) -> int:
    """The number of the one segment that gives contacts up."""
    (number,) = (k for k, segment in enumerate(plan["segments"]) if "leaving" in segment)
    return number


def tilted_motion(problem: Problem, shape: Approach) -> CertifiedMotion:
    """What a problem's search and certificate make of a tilted entry."""
    play = measured_clearance(problem).play
    return motion_from(problem, tilted_entry(problem.moving, play, problem.approach, shape))
