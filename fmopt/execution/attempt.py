"""Attempts: bodies run a program, and those whose moves fail are led back and try again while the plan has starts.

Each attempt after the first has a rig of its own for the bodies that make it, which begins with all of them where they
failed: what becomes of a body depends on no other, and those that do not fail see nothing of recovery.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from fmopt.execution.program import FAILED
from fmopt.execution.recovery import EARLY, LATE, Recovery, WayBack
from fmopt.execution.rig import Event, Rig
from fmopt.execution.summary import Fit, Log, Retry, note, rest, watch
from fmopt.plan.contact_geometry import Contact
from fmopt.plan.guarded_moves import PlanMove
from fmopt.spatial.values import Array

_QUIET = 0.15  # s after the end of a program, before the pose at rest is judged
_LONGEST = 30.0  # s that an attempt may take
MakeRig = Callable[[tuple[Array, Array], Sequence[int], int], Rig]
"""A rig from positions and quaternions, for these of the bodies, at this attempt."""


@dataclass(frozen=True, eq=False)
class ReferenceCourse:
    """What bodies are held against on their way."""

    recovery: Recovery | None
    moves: Sequence[PlanMove]
    known: Mapping[str, Contact]
    fit: Fit
    look: Callable[[Rig], None] | None = None
    told: Callable[[Sequence[tuple[int, Log]]], None] | None = None


@dataclass(frozen=True, eq=False)
class _Broken:
    """Where a body was as its move failed: pose (7,), velocity (6,), greatest penetration so far, m, and time, s."""

    body: int
    pose: Array
    velocity: Array
    depth: float
    time: float


def carried_out(course: ReferenceCourse, rig_of: MakeRig, starts: tuple[Array, Array]) -> list[Log]:
    """Runs bodies from starts, positions (n, 3), m, and quaternions (n, 4), until each has seated or given up."""
    begun = np.hstack(starts)  # of the first attempt for all of them: shifts of retries count from there
    logs = [Log() for _ in begun]
    bodies = list(range(len(begun)))
    rig, attempt = rig_of(starts, bodies, 0), 0
    while broken := _attempt(course, rig, logs, bodies, begun):
        attempt += 1
        bodies = [one.body for one in broken]
        poses = np.stack([one.pose for one in broken])
        rig = rig_of((poses[:, :3], poses[:, 3:]), bodies, attempt)
        rig.qvel[:] = np.stack([one.velocity for one in broken])  # in place: these are the engine's own arrays
        # Penetration is judged over all attempts.
        rig.depth[:] = [one.depth for one in broken]
        assert course.recovery is not None
        shifts = [logs[body].retries[-1].shift for body in bodies]
        rig.lead_back(WayBack.of(course.recovery, poses, begun[bodies], shifts))
        for one in broken:
            logs[one.body].spent += one.time
    return logs


def _attempt(
    course: ReferenceCourse, rig: Rig, logs: Sequence[Log], bodies: Sequence[int], begun: Array
) -> list[_Broken]:
    """Runs a rig until each of its bodies has an outcome or is to try again; returns those that are."""
    own = [logs[body] for body in bodies]
    broken: dict[int, _Broken] = {}
    while any(log.outcome is None and k not in broken for k, log in enumerate(own)):
        for event in rig.tick():
            # First, as it takes the time of the end: a body that tries again has it taken back.
            note(own[event.body], event, rig, course.moves, course.known, course.fit)
            if _again(course, rig, event, own[event.body], begun[bodies[event.body]]):
                k = event.body
                # Copies: the engine moves the body on until all others are done.
                pose, velocity = np.array(rig.qpos[k]), np.array(rig.qvel[k])
                broken[k] = _Broken(bodies[k], pose, velocity, float(rig.depth[k]), event.time)
        for k in rig.stranded():
            if k not in broken and not np.isfinite(own[k].ended):
                own[k].departures.append("not brought back to a start")
                own[k].ended = rig.time
        watch(own, rig, broken)
        if course.look is not None:
            course.look(rig)
        ended = []
        for k, log in enumerate(own):
            late = rig.time >= log.ended + _QUIET or rig.time > _LONGEST
            if log.outcome is None and k not in broken and late:
                log.outcome = rest(log, rig, k, course.fit)
                ended.append((bodies[k], log))
        if ended and course.told is not None:
            course.told(ended)
    return list(broken.values())


def _again(course: ReferenceCourse, rig: Rig, event: Event, log: Log, begun: Array) -> bool:
    """Whether a body whose step ended tries again; if so, its log says how."""
    recovery, k = course.recovery, event.body
    if recovery is None or rig.state.step[k] != FAILED or not recovery.liftable(np.array(rig.qpos[k]), begun):
        return False
    step = rig.program.steps[event.step]
    felt = LATE if rig.state.gone[k] >= step.travel else EARLY
    shift = recovery.next(step.move, felt, [retry.shift for retry in log.retries])
    if shift is None:
        return False
    log.retries.append(Retry(step.move, felt, shift))
    log.ended = np.inf
    return True
