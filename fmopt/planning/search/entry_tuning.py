"""The shape of an entry, varied for the largest margin of the whole sequence of guarded moves that follows from it.

All later poses follow from the first: each guarded move ends where it meets its contact. A few numbers then decide what
every piece of the motion has for margin, and a pattern search over them needs no derivative of error sets.

Placement of the whole sequence does not replace it: from entries as they are drawn it comes to 0.5 to 1.2 times the
margin on the shipped problems, 0.8 times in the median.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fmopt.errors import OverdueError
from fmopt.planning.search.best_first import MoveSequence, begin
from fmopt.planning.search.entry import Approach, Entry
from fmopt.planning.search.successors import Node, SearchTask, follow
from fmopt.runtime.clock import clock
from fmopt.spatial.values import Array

_STEPS = (0.16, 0.08, 0.04)  # shares of the first shape's numbers
_GAIN = 0.01  # of what is enough, the least gain that counts
_ENOUGH, _PATIENCE = 0.25, 10  # share of what is enough below which a margin is worth so many times the tries


@dataclass(frozen=True)
class TuningLimits:
    """Until when (`clock()`) an entry is varied, how often it may be tried, at most, and for what margin, m, at most.

    The last is the unit of gains as well, such as the clearance a side. An entry with next to no margin is tried ten
    times as often.
    """

    deadline: float
    tries: int
    enough: float


def tuned(
    task: SearchTask,
    candidates: Sequence[MoveSequence],
    entry_of: Callable[[Approach], Entry],
    limits: TuningLimits,
    progress: Callable[[float], None] = lambda _: None,
    steady: Callable[[MoveSequence], bool] = lambda _: True,
) -> MoveSequence:
    """One of some sequences of moves, the best first, from an entry of another shape, with the largest margin met.

    One that is steady, friction leaving all of its contacts closed, stays so; one that does not start tilted is not
    varied. The numbers are varied one after the other. Where that leaves next to no margin, so are those of the next.
    """
    best: MoveSequence | None = None
    for found in candidates:
        if found.entry.shape is None:
            return found if best is None else best
        kept = steady if steady(found) else lambda _: True
        varied = _varied(task, found, found.entry.shape, entry_of, limits, progress, kept)
        best = varied if best is None or varied.reached.margin > best.reached.margin else best
        if best.reached.margin >= _ENOUGH * limits.enough:
            break
    assert best is not None
    return best


def _varied(
    task: SearchTask,
    found: MoveSequence,
    shape: Approach,
    entry_of: Callable[[Approach], Entry],
    limits: TuningLimits,
    progress: Callable[[float], None],
    kept: Callable[[MoveSequence], bool],
) -> MoveSequence:
    """The sequence with the largest margin met as the numbers of its shape are varied; others have to be `kept`."""
    best, factors, tries = found, np.ones(len(shape.numbers)), 0

    def left() -> bool:
        most = limits.tries * (_PATIENCE if best.reached.margin < _ENOUGH * limits.enough else 1)
        return tries < most and best.reached.margin < limits.enough and clock() < limits.deadline

    def gains(step: Array) -> bool:
        nonlocal best, factors, tries
        tries += 1
        entry = entry_of(shape.varied(shape.numbers * (factors + step)))
        try:
            node = replayed(task, entry, found.names, best.reached.margin + _GAIN * limits.enough)
        except OverdueError:
            return False  # and there is no time for another try
        if node is None:
            return False
        bound = min(found.lower_bound, node.cost)  # that of the sequence is of other entries
        come = replace(found, entry=node.entry, moves=node.moves, reached=node.reached)
        other = replace(come, cost=node.cost, lower_bound=bound)
        if not kept(other):
            return False
        factors, best = factors + step, other
        progress(other.reached.margin)
        return True

    for share in _STEPS:
        improved = True
        while improved:
            improved = False
            for step in share * np.vstack([-np.eye(len(factors)), np.eye(len(factors))]):
                # Once a number has been changed for the better, it goes on that way.
                while left() and gains(step):
                    improved = True
    return best


def replayed(task: SearchTask, entry: Entry, names: Sequence[str], least: float) -> Node | None:
    """The state after the same moves from another entry; None where one fails, ends elsewhere or lacks margin, m."""
    node = begin(task, entry)
    for name in names[len(node.names) if node else 0 :]:
        if node is None or node.reached.margin <= least:
            return None
        node = follow(task, node, name)
    return node if node is not None and node.reached.margin > least and task.seated(node.place.pose) else None
