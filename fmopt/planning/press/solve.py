"""From a problem to a plan of presses with its evidence."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from fmopt.errors import OverdueError
from fmopt.execution.evidence import Examination, examine
from fmopt.execution.press_rig import PressRig
from fmopt.execution.press_servo import RUNNING
from fmopt.execution.press_trials import carry_out, count_presses, drawn_errors
from fmopt.execution.rotation import between
from fmopt.plan.description import TracePose
from fmopt.plan.evidence import VERTICES, Evidence
from fmopt.plan.field_types import numbers
from fmopt.plan.press import Conditions, PressPlan, PressRobot
from fmopt.planning.posed import Posed, Progress
from fmopt.planning.press.choice import Choosing, Pace, examined, halved, with_retries
from fmopt.planning.press.library import robot_of
from fmopt.planning.press.propose import proposals
from fmopt.planning.press.record import subject
from fmopt.planning.press.task import PressTask
from fmopt.runtime.clock import clock, deadline, until
from fmopt.task.problem import Problem

_TRACE_SECONDS = 30.0  # for a single trial, which is shown even where the time limit is used up
_TRACE_EVERY = 25  # periods between poses that are shown


@dataclass(frozen=True, eq=False)
class PressSolution:
    """A plan of presses and what its trials came to.

    Attributes:
        evidence: None where no trials were asked for, or the time limit leaves no time for them, as `untried` says.
    """

    plan: PressPlan
    evidence: Evidence | None
    trace: tuple[TracePose, ...] = ()
    untried: str = ""


def press_solution(posed: Posed, progress: Progress = lambda _: None) -> PressSolution:
    """Propose sequences of presses, choose by trials, and examine the choice.

    Raises:
        SearchError: no sequence comes down inside the mouth.
        OverdueError: the time limit leaves no draw for any.
    """
    problem = posed.problem
    task = PressTask(problem, problem.moving, problem.fixed, posed.clearance, problem.start_box)
    robot, conditions = robot_for(task), conditions_of(problem)
    settings = problem.settings
    choosing = Choosing(task.bodies, task.seat, robot, conditions, settings.seed, settings.draws, task.filled)
    progress("presses: sections of the parts")
    pace, limit = Pace(settings.draws + VERTICES), deadline() - clock()
    ranked = halved(choosing, proposals(task), progress, pace)
    asked = Examination(settings.draws, settings.min_rate, settings.seed)
    plan, evidence = choosing.plan(with_retries(ranked)), None
    if settings.draws and not pace.in_vain:
        plan, evidence = examined(choosing, ranked, asked, partial(subject, posed), progress)
    solution = PressSolution(plan, evidence, untried="" if evidence or not settings.draws else pace.words(limit))
    with until(clock() + _TRACE_SECONDS), suppress(OverdueError):
        return replace(solution, trace=traced(task, plan, conditions))
    return solution


def tried_again(posed: Posed, plan: PressPlan) -> PressSolution:
    """Presses that were chosen for another variant, tried as they are: parts, errors and hardware are of this one."""
    problem, settings = posed.problem, posed.problem.settings
    task = PressTask(problem, problem.moving, problem.fixed, posed.clearance, problem.start_box)
    stated = robot_for(task)
    robot = replace(plan.robot, stiffness=stated.stiffness, mass=stated.mass, inertia=stated.inertia)
    same = replace(plan, robot=robot, seat=task.seat, filled=task.filled)
    asked = Examination(settings.draws, settings.min_rate, settings.seed, threads=1)
    return PressSolution(same, examine(task.bodies, same, conditions_of(problem), asked, subject(posed, same)))


def robot_for(task: PressTask) -> PressRobot:
    """The robot that a problem states, at strength 1."""
    stated = task.problem.robot
    return robot_of(task, (stated.stiffness, stated.turning), (stated.mass, stated.mass * stated.gyration**2))


def conditions_of(problem: Problem) -> Conditions:
    """What trials of a problem are drawn from."""
    drift = max(problem.velocity_error.translation, problem.velocity_error.rotation, Conditions.drift)
    return Conditions(numbers(problem.start_box), problem.friction, drift=drift)


def traced(task: PressTask, plan: PressPlan, conditions: Conditions) -> tuple[TracePose, ...]:
    """The way of the first attempt without start error and offset, in the middle of all intervals."""
    friction = 0.5 * sum(conditions.friction)
    nothing = Conditions((0.0,) * 6, (friction, friction), (1.0, 1.0), (1.0, 1.0), (0.0, 0.0), 0.0)
    errors = drawn_errors(nothing, count_presses(plan), 0, [0])
    found: list[TracePose] = []

    def look(rig: PressRig) -> None:
        step = int(rig.state.step[0])
        if rig.ticks % _TRACE_EVERY == 0 and rig.state.mode[0] == RUNNING and step < len(plan.attempts[0].presses):
            q = np.array(rig.engine.qpos[0])
            found.append(TracePose(rig.time, step, numbers([*q[:3], *between(q[3:], np.array([1.0, 0.0, 0.0, 0.0]))])))

    carry_out(task.bodies, plan, errors, 0, [0], [(0,)], look=look)
    return tuple(found)
