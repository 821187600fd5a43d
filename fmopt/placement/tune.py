"""The shape of an entry, varied for the largest margin of the whole sequence of guarded moves that follows from it.

All later poses follow from the first: each guarded move ends where it meets its contact. A few numbers then decide what
every piece of the motion has for margin, and a pattern search over them needs no derivative of error sets.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fmopt.placement.entry import Entry, Shape
from fmopt.placement.search import MoveSequence
from fmopt.placement.step import Node, Task, begin, follow

_STEPS = (0.16, 0.08, 0.04)  # shares of the first shape's numbers
_GAIN = 0.01  # of the clearance, the least gain that counts


@dataclass(frozen=True)
class Limits:
    """Until when (`time.monotonic()`) an entry is varied, and how often it may be tried, at most."""

    deadline: float
    tries: int


def tuned(
    task: Task,
    found: MoveSequence,
    entry_of: Callable[[Shape], Entry],
    clearance: float,
    limits: Limits,
    progress: Callable[[float], None] = lambda _: None,
) -> MoveSequence:
    """The same sequence of moves from an entry of another shape, with the largest margin that was met.

    Args:
        task: parts, errors, goal and costs.
        found: the sequence; one that does not start tilted is given back.
        entry_of: makes an entry of a shape.
        clearance: clearance a side, m, the unit of gains; a margin as large is enough.
        limits: when to stop.
        progress: told the margin (m) after each gain.
    """
    first = found.entry.shape
    if first is None:
        return found
    size = len(first.numbers)
    factors, best, tries = np.ones(size), found, 0
    for share in _STEPS:
        improved = True
        while improved:
            improved = False
            for step in share * np.vstack([-np.eye(size), np.eye(size)]):
                # Once a number has been changed for the better, it goes on that way.
                while tries < limits.tries and best.reached.margin < clearance and time.monotonic() < limits.deadline:
                    tries += 1
                    entry = entry_of(Shape.of(first.numbers * (factors + step)))
                    least = best.reached.margin + _GAIN * clearance
                    node = replayed(task, entry, found.names, least)
                    if node is None:
                        break
                    factors, improved = factors + step, True
                    best = replace(
                        found,
                        entry=node.entry,
                        moves=node.moves,
                        reached=node.reached,
                        cost=node.cost,
                        lower_bound=min(found.lower_bound, node.cost),  # the bound is of other entries
                    )
                    progress(best.reached.margin)
    return best


def replayed(task: Task, entry: Entry, names: Sequence[str], least: float) -> Node | None:
    """The state after the same guarded moves from another entry, None where one fails, ends elsewhere or lacks margin.

    Args:
        task: parts, errors, goal and costs.
        entry: how to begin.
        names: the freedoms of the moves, those that begin it first.
        least: the margin that has to be exceeded, m.
    """
    node = begin(task, entry)
    for name in names[len(node.names) if node else 0 :]:
        if node is None or node.reached.margin <= least:
            return None
        node = follow(task, node, name)
    return node if node is not None and node.reached.margin > least and task.seated(node.place.pose) else None
