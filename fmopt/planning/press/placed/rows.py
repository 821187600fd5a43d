"""Rows of each press of a plan: room on the way, the state it is to reach, friction, and errors from press to press.

They are taken along the way of a trial without errors, to first order, whoever proposed the press. They prove nothing
of a trial: the plan's evidence is from the engine.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fmopt.plan.description import TracePose
from fmopt.plan.field_types import numbers
from fmopt.plan.press import Attempt, Conditions, Press, PressPlan, Standstill
from fmopt.plan.press_rows import DepthRow, PlacedAttempt, PressRows
from fmopt.planning.press.placed.jam import Jam, jam, reached_sets
from fmopt.planning.press.placed.rest import Rest, rest_of
from fmopt.planning.press.placed.room import least_room
from fmopt.planning.press.placed.touches import PressWrench, Touches
from fmopt.planning.press.task import PressTask
from fmopt.spatial.se3 import Pose, cross
from fmopt.spatial.values import Array

_STATIONS = 6  # poses of a way that are looked at
_DEPTHS = 12  # of the curve of going down
_PLAY = 4.0  # clearances by which axes that give way move off the way, beside errors
_TURN = 0.2  # rad, likewise
_NONE = 2e-6  # m and rad: smaller errors are none
_RANK = 1e-6  # relative singular value
_SIDES = 24  # directions that stand for a circle
_STANDS = 2e-5  # m from pose to pose of a trial
_LEVEL = 0.9  # upward part of a normal, from which a contact stops the part rather than guides it
_UPRIGHT = 0.05  # rad
_DRIFT = 0.01  # of a twist


def placed_attempts(
    task: PressTask, plan: PressPlan, traces: Sequence[Sequence[TracePose]], conditions: Conditions
) -> tuple[PlacedAttempt, ...]:
    """Rows of the presses of each attempt, along the way of its trial without errors."""
    return tuple(_attempt_rows(task, plan, *pair, conditions) for pair in zip(plan.attempts, traces, strict=True))


def _attempt_rows(
    task: PressTask, plan: PressPlan, attempt: Attempt, trace: Sequence[TracePose], conditions: Conditions
) -> PlacedAttempt:
    """See `placed_attempts`; presses are numbered in the attempt."""
    rows = list[PressRows]()
    presses, at = attempt.presses[: 1 + max(one.press for one in trace)], Pose.from_vector(attempt.start)
    errors = np.diag(conditions.start)[:, np.array(conditions.start) > 0.0]
    for k, press in enumerate(presses):
        way = [at, *(Pose.from_vector(one.pose) for one in trace if one.press == k and not one.back)]
        at = way[-1]
        row, errors = _press_rows(task, plan, press, way, errors, conditions)
        rows.append(row)
    whole = any(end.then == "seated" for end in presses[-1].ends)
    depths = _depth_rows(task, presses[-1], errors) if whole else ()
    datum, friction = _shown(rows) if whole else (None, None)
    return PlacedAttempt(tuple(rows), depths, datum, friction)


def _press_rows(
    task: PressTask, plan: PressPlan, press: Press, way: Sequence[Pose], errors: Array, conditions: Conditions
) -> tuple[PressRows, Array]:
    """The rows of a press, and the errors (6, g) after it."""
    stations = [way[k] for k in np.unique(np.linspace(0, len(way) - 1, _STATIONS).astype(int))]
    push = _push(task, press)
    led = any(press.twist) or press.rocking is not None or push.size == 0.0
    slow = len(way) > 2 and bool(np.linalg.norm(way[-2].local(way[-1])[:3]) < _STANDS)
    stands = not led and any(isinstance(end, Standstill) for end in press.ends) and slow
    seats = any(end.then == "seated" for end in press.ends)
    rest = rest_of(task, push, stations[-1], seats) if stands else None
    found = None if led else _jam(task, push, stations, errors, rest)
    after = _after(plan, press, way, errors, rest)
    least = -np.inf if rest is None else rest.least_force(conditions.friction[1])
    box = np.abs(after).sum(axis=1)
    return PressRows(
        margin=least_room(task, stations, errors),
        contacts=() if rest is None else rest.touches.names,
        rank=0 if rest is None else rest.rank,
        least_force=float(least) if np.isfinite(least) else None,
        holds=None if rest is None else rest.friction,
        largest_friction=None if found is None else found.friction,
        jams_on=() if found is None else found.contacts,
        escape=(0.0,) * 6 if found is None else numbers(found.twist),
        sets=0 if found is None else found.sets,
        left_out=0 if found is None else found.left_out,
        error=numbers(np.where(box < _NONE, 0.0, box)),
    ), after


def _push(task: PressTask, press: Press) -> PressWrench:
    wrench = np.array(press.wrench)
    wrench[3:] += cross(task.goal.R @ press.reference, wrench[:3])
    return PressWrench(wrench, np.array(press.gives), task.seat.rho)


def _jam(task: PressTask, push: PressWrench, stations: Sequence[Pose], errors: Array, rest: Rest | None) -> Jam:
    """The largest friction without a jam at all stations; the state that the press is to reach is none."""
    wanted, found = None if rest is None else {*rest.touches.names}, list[Jam]()
    for pose in stations:
        touches, sets = _sets(task, push, pose, errors)
        short = [one for one in sets if wanted is None or not wanted <= {touches.names[k] for k in one}]
        found.append(jam(short, touches, push))
    worst = min(found, key=lambda one: one.friction)
    return replace(worst, sets=sum(one.sets for one in found), left_out=sum(one.left_out for one in found))


def _sets(task: PressTask, push: PressWrench, pose: Pose, errors: Array) -> tuple[Touches, list[frozenset[int]]]:
    """Contacts about a pose, and sets of them that errors reach while the press is as far on."""
    clearance = task.clearance.per_side
    box = np.abs(errors).sum(axis=1) + np.repeat([_PLAY * clearance, _TURN], 3) * push.gives
    if (touches := _circles(task, pose)) is None:
        reach, angle = 1.5 * float(np.linalg.norm(box[:3])), float(np.linalg.norm(box[3:]))
        parts = task.moving.polyhedron, task.fixed.polyhedron
        touches = Touches.near(*parts, pose, reach, angle, clearance)
    return touches, reached_sets(touches, box, push.wrench * push.gives, clearance)


def _circles(task: PressTask, pose: Pose) -> Touches | None:
    """The contacts of a round part that stands upright in its bore; None of others, and where it does not."""
    tilt = np.linalg.norm(task.goal.local(pose)[3:5])
    if not task.round or tilt > _UPRIGHT or (engaged := task.engaged(-pose.p[2])) is None:
        return None
    turns = np.arange(_SIDES) * (2.0 * np.pi / _SIDES)
    out = np.column_stack([np.cos(turns), np.sin(turns), np.zeros(_SIDES)])
    radius = float(task.outline.exterior.distance(task.outline.centroid))
    arms = np.concatenate([radius * out + [0.0, 0.0, z] for z in (engaged.low, engaged.high)])
    names = tuple(f"{where}-{k}" for where in ("low", "high") for k in range(_SIDES))
    return Touches.at(names, np.full(2 * _SIDES, engaged.play), np.concatenate([-out, -out]), arms)


def _after(plan: PressPlan, press: Press, way: Sequence[Pose], errors: Array, rest: Rest | None) -> Array:
    """Errors (6, g) after a press: projected onto its contacts; along the others it may stand anywhere on its way."""
    drifted = _DRIFT * np.abs(way[0].local(way[-1])) * ~np.array(press.gives) if any(press.twist) else np.zeros(6)
    errors = np.column_stack([errors, np.diag(drifted)[:, drifted > 0.0]])
    if rest is None:
        return errors
    admittance = np.repeat(1.0 / np.array(plan.robot.damping), 3) * press.gives
    N = rest.touches.N
    projector = np.eye(6) - (admittance[:, None] * N.T) @ np.linalg.pinv(N * admittance @ N.T, rcond=_RANK) @ N
    swept = projector @ (way[-1].local(way[0]) * press.gives)
    found = projector @ np.column_stack([errors, swept])
    return np.asarray(found[:, np.abs(found).max(axis=0) > 1e-12])


def _depth_rows(task: PressTask, last: Press, errors: Array) -> tuple[DepthRow, ...]:
    """The largest friction without a jam from depth to depth, all the way down."""
    push, rows = _push(task, last), list[DepthRow]()
    for depth in np.linspace(0.0, task.depth, _DEPTHS + 2)[1:-1]:
        engaged = task.engaged(float(depth))
        pose = Pose(np.append(task.goal.p[:2], -depth), task.goal.R)
        touches, sets = _sets(task, push, pose, errors)
        guiding = np.abs(touches.N[:, 2]) < _LEVEL
        sets = [one for one in sets if all(guiding[k] for k in one)]
        friction = jam(sets, touches, push).friction
        high = 0.0 if engaged is None else engaged.high - engaged.low
        rows.append(DepthRow(float(depth), friction, high / task.narrow))
    return tuple(rows)


def _shown(rows: Sequence[PressRows]) -> tuple[int | None, float | None]:
    """From which press on rows show that the part comes to its goal, and up to which friction; None where they do not.

    It is a datum, whose contacts fix all six coordinates: it and each press after it have room for all errors, and jam
    on no contacts short of the state that they are to reach.
    """
    for k, row in enumerate(rows):
        if row.rank < 6 or not row.holds:
            continue
        roomy = all(one.margin is None or one.margin > 0.0 for one in rows[k:])
        friction = min(one.largest_friction for one in rows[k:] if one.largest_friction is not None)
        if k + 1 < len(rows) and roomy and friction > 0.0:
            return k, friction
    return None, None
