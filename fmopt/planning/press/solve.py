"""From a problem to a plan of presses with its evidence."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from fmopt.execution.evidence import Examination
from fmopt.plan.evidence import Evidence
from fmopt.plan.press import Conditions, PressPlan
from fmopt.planning.posed import Posed, Progress
from fmopt.planning.press.choice import Choosing, examined, halved
from fmopt.planning.press.library import robot_of
from fmopt.planning.press.propose import proposals
from fmopt.planning.press.task import PressTask


@dataclass(frozen=True, eq=False)
class PressSolution:
    """A plan of presses and what its trials came to."""

    task: PressTask
    plan: PressPlan
    evidence: Evidence


def press_solution(
    posed: Posed, subject_of: Callable[[PressPlan], str], progress: Progress = lambda _: None
) -> PressSolution:
    """Propose sequences of presses, choose by trials, and examine the choice.

    Args:
        posed: the problem with its parts measured.
        subject_of: digest of what is carried out.
        progress: told in words.

    Raises:
        SearchError: no sequence comes down inside the mouth.
    """
    problem = posed.problem
    task = PressTask(problem, problem.moving, problem.fixed, posed.clearance, problem.start_box)
    stated = problem.robot
    robot = robot_of(task, (stated.stiffness, stated.turning), (stated.mass, stated.mass * stated.gyration**2))
    drift = max(problem.velocity_error.translation, problem.velocity_error.rotation, Conditions.drift)
    x, y, z, rx, ry, rz = problem.start_box.tolist()
    conditions = Conditions((x, y, z, rx, ry, rz), problem.friction, drift=drift)
    settings = problem.settings
    choosing = Choosing(task.bodies, task.seat, robot, conditions, settings.seed)
    progress("presses: sections of the parts")
    ranked = halved(choosing, proposals(task), progress)
    asked = Examination(settings.draws, settings.min_rate, settings.seed)
    plan, evidence = examined(choosing, ranked, asked, subject_of, progress)
    return PressSolution(task, plan, evidence)
