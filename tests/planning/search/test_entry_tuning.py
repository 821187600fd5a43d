"""Entries varied for margin: more of it, by the same moves, and a bound that stays below the cost."""

import math
from dataclasses import replace
from functools import partial

import pytest

from fmopt.planning.motion import drawing
from fmopt.planning.posed import Posed
from fmopt.planning.search.best_first import MoveSequence, best_sequences
from fmopt.planning.search.entry import Approach, Entry, tilted_entry
from fmopt.planning.search.entry_sampling import beginnings
from fmopt.planning.search.entry_tuning import TuningLimits, tuned
from fmopt.planning.search.successors import SearchTask
from fmopt.task.problem import Problem, load
from fmopt.task.sizes import measured_clearance
from tests import PROBLEMS
from tests.shared.searched import task_of


@pytest.fixture(scope="module")
def problem() -> Problem:
    return load(PROBLEMS / "factory_rect_8mm_tight_300um.toml")


def entry(problem: Problem, shape: Approach) -> Entry:
    return tilted_entry(problem.moving, measured_clearance(problem).play, problem.approach, shape)


@pytest.fixture(scope="module")
def task(problem: Problem) -> SearchTask:
    return task_of(problem)


@pytest.fixture(scope="module")
def found(problem: Problem, task: SearchTask) -> MoveSequence:
    begun = beginnings(task, drawing(Posed.of(problem)).shapes(0), partial(entry, problem), 100)
    return best_sequences(task, ((one,) for one in begun))[0]


def test_the_same_moves_get_more_margin(problem: Problem, task: SearchTask, found: MoveSequence) -> None:
    clearance = measured_clearance(problem).per_side
    best = tuned(task, (found,), lambda shape: entry(problem, shape), TuningLimits(math.inf, 12, clearance))
    assert best.names == found.names
    assert best.reached.margin > found.reached.margin
    assert best.lower_bound <= best.cost
    # A bound of the first entry says nothing of another one that costs less.
    dear = replace(found, cost=found.cost + 5.0, lower_bound=found.cost + 4.0)
    cheaper = tuned(task, (dear,), lambda shape: entry(problem, shape), TuningLimits(math.inf, 12, clearance))
    assert cheaper.cost == best.cost < dear.lower_bound
    assert cheaper.lower_bound == cheaper.cost


def test_the_next_sequence_counts_where_one_is_short(problem: Problem, task: SearchTask, found: MoveSequence) -> None:
    entry_of = partial(entry, problem)
    better = tuned(task, (found,), entry_of, TuningLimits(math.inf, 12, measured_clearance(problem).per_side))
    assert 0.0 < found.reached.margin < better.reached.margin
    for candidates in ((found, better), (better, found)):
        assert tuned(task, candidates, entry_of, TuningLimits(math.inf, 0, 8.0 * better.reached.margin)) is better
        assert tuned(task, candidates, entry_of, TuningLimits(math.inf, 0, found.reached.margin)) is candidates[0]
