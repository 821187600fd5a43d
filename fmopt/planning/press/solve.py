"""From a problem to a plan of presses with its evidence."""

from __future__ import annotations

import math
from collections.abc import Sequence
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
from fmopt.plan.evidence import Evidence
from fmopt.plan.field_types import numbers
from fmopt.plan.press import Attempt, Conditions, PressPlan, PressRobot, first_presses
from fmopt.plan.press_rows import PlacedAttempt
from fmopt.planning.posed import Posed, Progress
from fmopt.planning.press.choice import Choosing, Pace, examined, halved, with_retries
from fmopt.planning.press.library import robot_of
from fmopt.planning.press.nominal_way import kept_clear
from fmopt.planning.press.placed.rows import placed_attempts
from fmopt.planning.press.propose import proposals
from fmopt.planning.press.record import subject
from fmopt.planning.press.task import PressTask
from fmopt.runtime.clock import clock, deadline, until
from fmopt.task.problem import Problem, Settings

_CLEAR_OF_OFFSET = 3.0  # times the accuracy of the force, that a press has at least
_MORE = 1.1  # times that much is advised: forces against an offset do not grow with the limit
_TRACE_SECONDS = 60.0  # for a trial of each attempt and its rows, shown even where the time limit is used up
_TRACE_EVERY = 25  # periods between poses that are shown


@dataclass(frozen=True, eq=False)
class PressSolution:
    """A plan of presses and what its trials came to."""

    plan: PressPlan
    evidence: Evidence | None  # None where no trials were asked for, or there was no time for them, as `untried` says
    trace: tuple[TracePose, ...] = ()  # the way of the first attempt without errors
    untried: str = ""
    placed: tuple[PlacedAttempt, ...] = ()  # rows of each attempt


def press_solution(posed: Posed, progress: Progress = lambda _: None) -> PressSolution:
    """Propose sequences of presses, choose by trials, and examine the choice.

    Raises:
        SearchError: no sequence comes down inside the mouth, or none keeps clear of tool and obstacles.
        OverdueError: the time limit leaves no draw for any.
    """
    problem, task, settings = posed.problem, task_of(posed), posed.problem.settings
    conditions, late = conditions_of(problem), settings.max_time or math.inf
    parts = task.bodies, task.seat, robot_for(task), conditions
    choosing = Choosing(*parts, settings.seed, task.filled, problem.cell, late)
    progress("presses: sections of the parts")
    asked = _examination(settings)
    pace, limit = Pace(asked.trials), deadline() - clock()
    proposed = kept_clear(task, proposals(task))
    if weak := weakness(choosing, proposed, problem):
        progress(weak)
    ranked = halved(choosing, proposed, progress, pace)
    plan, evidence = choosing.plan(with_retries(ranked)), None
    if settings.draws and not pace.in_vain:
        plan, evidence = examined(choosing, ranked, asked, partial(subject, posed), progress)
    solution = PressSolution(plan, evidence, untried="" if evidence or not settings.draws else pace.words(limit))
    with until(clock() + _TRACE_SECONDS), suppress(OverdueError):
        traces = traced(task, plan, conditions)
        solution = replace(solution, trace=traces[0])
        progress("presses: rows of each")
        return replace(solution, placed=placed_attempts(task, plan, traces, conditions))
    return solution


def tried_again(posed: Posed, plan: PressPlan) -> PressSolution:
    """Presses that were chosen for another variant, tried as they are: parts, errors and hardware are of this one."""
    problem, task = posed.problem, task_of(posed)
    robot = replace(robot_for(task), damping=plan.robot.damping, limits=plan.robot.limits, arm=plan.robot.arm)
    same = replace(plan, robot=robot, seat=task.seat, filled=task.filled, cell=problem.cell)
    asked = replace(_examination(problem.settings), threads=1)
    return PressSolution(same, examine(task.bodies, same, conditions_of(problem), asked, subject(posed, same)))


def _examination(wanted: Settings) -> Examination:
    return Examination(wanted.draws, wanted.min_rate, wanted.seed, max_time=wanted.max_time, vertices=wanted.vertices)


def task_of(posed: Posed) -> PressTask:
    """A problem as presses see it."""
    problem = posed.problem
    return PressTask(problem, problem.moving, problem.fixed, posed.clearance, problem.start_box)


def robot_for(task: PressTask) -> PressRobot:
    """The robot that a problem states, at strength 1."""
    stated = task.problem.robot
    robot = robot_of(task, (stated.stiffness, stated.turning), (stated.mass, stated.mass * stated.gyration**2))
    return replace(robot, delay=stated.delay, noise=(stated.force_noise, stated.torque_noise, *robot.noise[2:]))


def conditions_of(problem: Problem) -> Conditions:
    """What trials of a problem are drawn from."""
    drift = max(problem.velocity_error.translation, problem.velocity_error.rotation, Conditions.drift)
    offset = problem.robot.force_offset, problem.robot.torque_offset
    return Conditions(numbers(problem.start_box), problem.friction, offset=offset, drift=drift)


def weakness(choosing: Choosing, proposed: Sequence[Attempt], problem: Problem) -> str:
    """A warning where each sequence has a press below three times the accuracy of the robot's force; else empty.

    A press counts by the larger of its forces across and along the axis, but for the first one, which ends where it
    meets the part, and for those that turn it by a torque.
    """
    robot, wanted = problem.robot, problem.specification
    wrenches = [[press.wrench for press in choosing.plan([one]).attempts[0].presses[1:]] for one in proposed]
    least = max(
        min((max(math.hypot(x, y), abs(z)) for x, y, z, *turning in some if not any(turning)), default=math.inf)
        for some in wrenches
    )
    share = _CLEAR_OF_OFFSET * robot.force_offset / least
    if share <= 1.0:
        return ""
    force, torque = (_MORE * share * one for one in (wanted.contact_force, wanted.torque_limit))
    if force <= robot.max_force and torque <= robot.max_torque:
        advice = f"raise contact_force to {math.ceil(force)} N and torque_limit to {torque:.2g} N m"
    else:
        advice = f"take a sensor that is accurate to {least / _CLEAR_OF_OFFSET:.2g} N, or zero it where it presses"
    return (
        f"warning: the weakest press of the strongest sequence has {least:.3g} N, less than {_CLEAR_OF_OFFSET:g} times "
        f"the {robot.force_offset:.3g} N by which the robot's force may be off; {advice}"
    )


def traced(task: PressTask, plan: PressPlan, conditions: Conditions) -> tuple[tuple[TracePose, ...], ...]:
    """The way of each attempt without start error and offset, in the middle of all intervals, its presses from 0."""
    count, firsts = len(plan.attempts), first_presses(plan.attempts)
    friction = 0.5 * sum(conditions.friction)
    nothing = Conditions((0.0,) * 6, (friction, friction), (1.0, 1.0), (1.0, 1.0), (0.0, 0.0), 0.0)
    errors = drawn_errors(nothing, count_presses(plan), 0, [0] * count)
    found: list[list[TracePose]] = [[] for _ in range(count)]

    def look(rig: PressRig) -> None:
        if rig.ticks % _TRACE_EVERY:
            return
        for k in np.flatnonzero(rig.state.mode == RUNNING).tolist():
            step, q = int(rig.state.step[k]) - firsts[k], np.array(rig.engine.qpos[k])
            if 0 <= step < len(plan.attempts[k].presses):
                pose = numbers([*q[:3], *between(q[3:], np.array([1.0, 0.0, 0.0, 0.0]))])
                found[k].append(TracePose(rig.time, step, pose))

    carry_out(task.bodies, plan, errors, 0, range(count), [(k,) for k in range(count)], look=look)
    return tuple(map(tuple, found))
