"""Candidates for an insertion, from every generator that has any. A new generator is a file and a line in here."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

from fmopt.errors import SearchError
from fmopt.plan.press import Attempt
from fmopt.planning.press.crossing import crossings
from fmopt.planning.press.library import LIBRARY, corner_attempt
from fmopt.planning.press.round_pin import is_short, round_presses
from fmopt.planning.press.straight import straight_presses
from fmopt.planning.press.task import PressTask
from fmopt.planning.press.touch_top import touching_first
from fmopt.planning.press.yaw_sweep import yaw_sweeps

_LONG = 2.0  # sides of the mouth, from which a part leans along the longer one as well
GENERATORS = (straight_presses, round_presses, crossings, yaw_sweeps)


def proposals(task: PressTask) -> list[Attempt]:
    """Different attempts that could seat the part, in the order of their generators.

    Raises:
        SearchError: no generator has any.
    """
    found = [attempt for generator in GENERATORS for attempt in generator(task)]
    found += [*corner_presses(task)] if not task.round or is_short(task) else []
    if not found:
        raise SearchError("no press was found that comes down inside the mouth", "lower the start errors")
    return [*dict.fromkeys(_keeping(one, task.through) if task.keeps_attitude else one for one in found)]


def _keeping(attempt: Attempt, through: bool) -> Attempt:
    """The attempt with held attitudes as commanded, but after turns that the level in a through hole may cut short."""
    cut = [through and (press.rocking is not None or any(press.twist[3:])) for press in attempt.presses]
    first, *others = attempt.presses
    return replace(attempt, presses=(first, *(replace(one, keeps=not k) for one, k in zip(others, cut, strict=False))))


def corner_presses(task: PressTask) -> Iterator[Attempt]:
    """Sequences of the library at a few corners, leaning towards the corner, or along a mouth that is long."""
    for corner in task.few_corners:
        leans: list[float | None] = [None]
        if task.size >= _LONG * task.width:
            along = task.long_axis
            leans.insert(0, along if math.cos(corner.angle - along) >= 0.0 else along + math.pi)
        for lean in leans:
            for numbers in LIBRARY:
                try:
                    attempt = corner_attempt(task, corner, numbers, lean)
                    yield touching_first(task, attempt, corner.at, corner.walls, numbers.down * task.size)
                except SearchError:  # another corner may have room where this one has none
                    break
