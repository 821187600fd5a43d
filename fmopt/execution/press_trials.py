"""Trials of presses: what is off in each is drawn from its seed and number, or is a vertex of all intervals."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import fields, replace
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np

from fmopt.errors import PlanFormatError
from fmopt.execution.engines.catalogue import ENGINES
from fmopt.execution.engines.engine import Bodies, Setup
from fmopt.execution.kept_clear import KeptClear
from fmopt.execution.noise import Noise
from fmopt.execution.press_controller import Errors, begun
from fmopt.execution.press_rig import PressRig
from fmopt.plan import Plan
from fmopt.plan.evidence import VERTICES, Evidence, TrialOutcome
from fmopt.plan.press import Conditions, PressPlan
from fmopt.spatial.values import Array

if TYPE_CHECKING:
    from fmopt.execution.trials import Trials

SOFT = 2.0  # times as soft as for guarded moves contacts may be: presses meet them at half the speed
# Columns of a two-level design: each is the product of the signs of these start errors.
_FRICTION, _STIFFNESS, _ADMITTANCE = (0, 1, 2), (1, 3, 4), (2, 4, 5)
_OFFSETS = ((0, 3), (1, 4), (2, 5), (0, 1, 5), (0, 2, 4), (1, 2, 3))
_DRIFTS = ((0, 4), (1, 5), (2, 3), (0, 5), (1, 3), (2, 4))
_BEYOND = 0x6265796F  # sets the streams of sizes beyond the box apart
_NOISE = 0x6E6F6973  # sets the streams of noise apart from those of errors


def drawn_errors(
    conditions: Conditions, presses: int, seed: int, numbers: Sequence[int], corners: float = 0.0
) -> Errors:
    """Errors of numbered trials, each from its own stream of the seed.

    In a share `corners` of the trials all but drift is at ends of its intervals, for choosing among plans.
    """
    return errors_at(conditions, *drawn_shares(presses, seed, numbers, corners))


def drawn_shares(presses: int, seed: int, numbers: Sequence[int], corners: float = 0.0) -> tuple[Array, Array]:
    """Where the unknowns of numbered trials lie in their intervals, (n, 15) from -1 to 1, and the drift as a share.

    Unknowns are the start error (6), friction, the logarithms of stiffness and admittance, the offset of the wrench
    (6); drift is (n, 6, presses), of the greatest one.
    """
    rows = [_drawn(presses, np.random.default_rng([seed, number]), corners) for number in numbers]
    shares, drift = (np.array(column) for column in zip(*rows, strict=True))
    return shares, drift


def errors_at(conditions: Conditions, shares: Array, drift: Array) -> Errors:
    """Errors of trials whose unknowns lie at these shares of their intervals, see `drawn_shares`."""
    rows = np.array([conditions.friction, np.log(conditions.stiffness), np.log(conditions.admittance)])
    scalars = rows.mean(axis=1) + shares[:, 6:9] * (0.5 * np.ptp(rows, axis=1))
    stiffness, admittance = ([*map(math.exp, column)] for column in scalars.T[1:].tolist())
    start, offset = shares[:, :6] * np.array(conditions.start), shares[:, 9:] * np.repeat(conditions.offset, 3)
    return Errors(
        start, scalars[:, 0].copy(), np.array(stiffness), np.array(admittance), offset, conditions.drift * drift
    )


def _drawn(presses: int, random: np.random.Generator, corners: float) -> tuple[Array, Array]:
    start, at_vertex = random.uniform(-1.0, 1.0, 6), random.uniform() < corners
    shares = np.concatenate([start, random.uniform(-1.0, 1.0, 9)])
    ball = random.normal(size=(presses, 2, 3))
    ball *= random.uniform(size=(presses, 2, 1)) ** (1.0 / 3.0) / np.linalg.norm(ball, axis=2, keepdims=True)
    return np.sign(shares) if at_vertex else shares, ball.reshape(presses, 6).T


def vertex_errors(conditions: Conditions, presses: int) -> Errors:
    """Errors at the 64 vertices of the start box; the ends of the other intervals follow a two-level design."""
    signs = np.array(list(product((-1.0, 1.0), repeat=6)))

    def column(axes: Sequence[int]) -> Array:
        return np.asarray(signs[:, list(axes)].prod(axis=1))

    def ends(interval: tuple[float, float], axes: Sequence[int]) -> Array:
        return np.where(column(axes) > 0.0, interval[1], interval[0])

    offset = np.stack([column(axes) for axes in _OFFSETS], axis=1) * np.repeat(conditions.offset, 3)
    drift = np.stack([column(axes) for axes in _DRIFTS], axis=1) / math.sqrt(3.0) * conditions.drift
    named = ((conditions.friction, _FRICTION), (conditions.stiffness, _STIFFNESS), (conditions.admittance, _ADMITTANCE))
    friction, stiffness, admittance = (ends(*each) for each in named)
    start, drift = signs * np.array(conditions.start), np.repeat(drift[:, :, None], presses, axis=2)
    return Errors(start, friction, stiffness, admittance, offset, drift)


def carry_out(
    bodies: Bodies,
    plan: PressPlan,
    errors: Errors,
    seed: int,
    numbers: Sequence[int],
    courses: Sequence[Sequence[int]] | None = None,
    engine: str = "mujoco",
    time_step: float | None = None,
    threads: int = 1,
    look: Callable[[PressRig], None] | None = None,
) -> list[TrialOutcome]:
    """Carries a plan out, once for each row of errors.

    Streams of noise are numbered under the seed. Courses are for each trial its attempts in order, by number, else all
    of them. The time step of the physics (s) is, if None, what the clearance asks for.
    """
    friction = errors.friction if np.ptp(errors.friction) > 0.0 else float(errors.friction[0])
    put = ENGINES[engine].scene(Setup(bodies, SOFT * plan.seat.clearance, plan.robot, friction, time_step, threads))
    courses = courses or [range(len(plan.attempts))] * len(errors.start)
    starts = begun(np.array([plan.attempts[course[0]].start for course in courses]), errors.start)
    noise = Noise(seed ^ _NOISE, numbers, width=12)
    clear = KeptClear(bodies, plan.cell, starts) if plan.cell.solids else None
    begin = put((starts[:, :3], starts[:, 3:]))
    return PressRig(begin, plan, courses, errors, bodies.penetration, noise, look, clear).run()


def count_presses(plan: PressPlan) -> int:
    """Presses of all attempts of a plan."""
    return sum(len(attempt.presses) for attempt in plan.attempts)


def stated(plan: Plan, trials: Trials) -> tuple[PressPlan, Evidence, Conditions]:
    """Presses of a plan, their evidence, and what trials are drawn from.

    Raises:
        PlanFormatError: the plan does not say what its errors are.
    """
    presses, evidence = plan.press_plan, plan.trials
    if presses is None or evidence is None:
        raise PlanFormatError("the plan has no evidence that says what to draw from", "solve its problem again")
    conditions = evidence.conditions
    if trials.friction is not None:
        conditions = replace(conditions, friction=(trials.friction, trials.friction))
    return presses, evidence, conditions


def carried(
    presses: PressPlan, bodies: Bodies, trials: Trials, errors: Errors, numbers: Sequence[int], threads: int = 1,
    look: Callable[[PressRig], None] | None = None,
) -> list[TrialOutcome]:  # fmt: skip
    """Carry presses out for errors as trials ask for it: their offset, recovery, engine and time step."""
    errors.start[:, 0] += trials.offset
    courses = None if trials.recovery else [(0,)] * len(numbers)
    return carry_out(
        bodies, presses, errors, trials.seed, numbers, courses, trials.engine, trials.time_step, threads, look
    )


def press_records(
    plan: Plan, bodies: Bodies, trials: Trials, numbers: Sequence[int], look: Callable[[PressRig], None] | None = None
) -> list[dict[str, Any]]:
    """Carries a plan of presses out, one record a trial.

    The bodies, both parts, need not be the plan's. Trials with the seed of the plan's evidence are its draws, then its
    vertices.

    Raises:
        PlanFormatError: the plan does not say what its errors are.
    """
    presses, evidence, conditions = stated(plan, trials)
    count = count_presses(presses)
    errors = drawn_errors(conditions, count, trials.seed, numbers)
    vertices = vertex_errors(conditions, count)
    box, size = np.array(conditions.start), np.zeros(len(numbers))
    for row, number in enumerate(numbers):
        vertex = number - evidence.draws
        if trials.seed == evidence.seed and 0 <= vertex < VERTICES and number < trials.inside:
            for field in fields(errors):
                getattr(errors, field.name)[row] = getattr(vertices, field.name)[vertex]
        share = np.abs(errors.start[row][box > 0.0] / box[box > 0.0]).max(initial=0.0)
        if number >= trials.inside and share > 0.0:
            random = np.random.default_rng([trials.seed, number, _BEYOND])
            errors.start[row] *= random.uniform(1.0, trials.reach) / share
        size[row] = np.abs(errors.start[row][box > 0.0] / box[box > 0.0]).max(initial=0.0)
    outcomes = carried(presses, bodies, trials, errors, numbers, look=look)
    return [
        {
            "trial": number,
            "size": float(size[row]),
            "error": errors.start[row].tolist(),
            "success": one.seated,
            "reasons": [*one.reasons],
            "departures": [],
            "seconds": one.seconds,
            "peak_force": one.peak_force,
            "impact_force": one.peak_force,
            "penetration": one.penetration,
            "offset": list(one.offset),
            "turn": list(one.turn),
            "retries": [{"press": one.press}] * one.attempt,
        }
        for row, (number, one) in enumerate(zip(numbers, outcomes, strict=True))
    ]
