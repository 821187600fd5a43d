"""Ways that tool and obstacles have no room for: their candidates are dropped before they are tried."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from fmopt.errors import SearchError
from fmopt.execution.kept_clear import KeptClear
from fmopt.execution.press_controller import begun
from fmopt.plan.evidence import TOUCH
from fmopt.plan.press import Attempt
from fmopt.planning.press.task import PressTask
from fmopt.spatial.se3 import Pose
from fmopt.spatial.values import Array

_STEPS = 5  # poses of a turn, and of the way in
_OUTSIDE = 3  # poses of a way before the mouth holds the part, which count with start errors
_SURE = 2.7  # standard deviations of a sum of uniform errors, beyond which one in a thousand is, about


def kept_clear(task: PressTask, attempts: Sequence[Attempt]) -> list[Attempt]:
    """Attempts whose way keeps clear of tool and obstacles, in their order: up to the mouth for all but rare errors.

    Raises:
        SearchError: there is none; says what comes how near where, on the best way.
    """
    if not task.problem.cell.solids:
        return [*attempts]
    over = max(one.start[2] for one in attempts)
    clear = KeptClear(task.bodies, task.problem.cell, begun(np.array([attempts[0].start]), np.zeros((1, 6))))
    least, kept = (-np.inf, ""), []
    for attempt in attempts:
        way = enumerate(_way(task, attempt, over))
        near = ((*_nearest(clear, pose, task.box * (k < _OUTSIDE)), words) for k, (words, pose) in way)
        distance, solids, words = min(near, key=lambda one: one[0])
        if distance > TOUCH:
            kept.append(attempt)
        least = max(least, (distance, f"{solids} come within {1e3 * max(distance, 0.0):.3g} mm of each other {words}"))
    if not kept:
        advice = "grip the part farther from its leading face, move the obstacle, or make it smaller"
        raise SearchError(f"no press keeps clear of tool and obstacles: on the best way {least[1]}", advice)
    return kept


def _nearest(clear: KeptClear, pose: Pose, box: Array) -> tuple[float, str]:
    """The least distance, m, and between which solids, for all but rare errors in a box of half-widths (6,)."""
    errors = np.vstack([np.zeros(6), *(sign * np.diag(box)[box > 0.0] for sign in (1.0, -1.0))])
    (distance, solids), *others = map(clear.measured, begun(np.tile(pose.vector(), (len(errors), 1)), errors))
    lost = (distance - np.reshape([one for one, _ in others], (2, -1))).max(axis=0, initial=0.0)
    return distance - min(float(lost.sum()), _SURE * math.hypot(*lost) / math.sqrt(3.0)), solids


def _way(task: PressTask, attempt: Attempt, over: float) -> Iterator[tuple[str, Pose]]:
    """Poses that an attempt leads to without errors, about, with words for where they are."""
    start, goal = Pose.from_vector(attempt.start), task.goal
    lowest = min(float(start.apply(piece)[:, 2].min()) for piece in task.bodies.moving)
    tilted, upright = start.p - [0.0, 0.0, lowest], np.array([*goal.p[:2], 0.0])
    yield "on the way over", Pose(np.array([*start.p[:2], max(over, start.p[2])]), start.R)
    yield "at the start", start
    for before, after, words in (
        (Pose(tilted, start.R), Pose(upright, goal.R), "as the part is turned upright"),
        (Pose(upright, goal.R), goal, "on the way in"),
    ):
        yield from ((words, before.moved(share * before.local(after))) for share in np.linspace(0.0, 1.0, _STEPS))
