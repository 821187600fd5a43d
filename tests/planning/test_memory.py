"""What is worked out about an object is worked out once, and goes with it."""

import gc
import pickle
import weakref
from dataclasses import dataclass
from pathlib import Path

from threadpoolctl import threadpool_info

from fmopt.certificate.assembly import Assembly
from fmopt.planning.pipeline import certified_motion
from fmopt.runtime.compiled import undisturbed
from fmopt.spatial.values import remembered
from fmopt.task.problem import load
from tests import ROOT
from tests.shared.studies.problems import straight


@dataclass(frozen=True, eq=False)
class Owner:
    number: int


def test_once_for_each_object_and_arguments() -> None:
    asked: list[tuple[int, int]] = []

    @remembered(2)
    def added(owner: Owner, more: int) -> int:
        asked.append((owner.number, more))
        return owner.number + more

    one, two = Owner(1), Owner(2)
    assert [added(one, 3), added(one, 3), added(two, 3), added(two, 3)] == [4, 4, 5, 5]
    assert asked == [(1, 3), (2, 3)]
    # Of more than two results of one object the one that was not asked for the longest goes.
    assert [added(one, n) for n in (4, 3, 5, 3, 4)] == [5, 4, 6, 4, 5]
    assert asked[2:] == [(1, 4), (1, 5), (1, 4)]
    assert pickle.loads(pickle.dumps(one)).number == 1


def assemblies() -> int:
    """How many there are, whether anybody can still get at them or not."""
    return sum(isinstance(found, Assembly) for found in gc.get_objects())


def test_nothing_holds_on_to_a_problem_that_was_solved(tmp_path: Path) -> None:
    problems = (load(straight(tmp_path)), load(ROOT / "problems" / "factory_rect_8mm_tight_300um.toml"))
    for problem in problems:
        certified_motion(problem)  # kernels that are still to be compiled are now: a compiler leaves cycles of its own
    gc.collect()
    gc.disable()  # nothing waits for that
    try:
        before = assemblies()
        for problem in problems:
            done = certified_motion(problem)
            parts = [weakref.ref(done.assembly), weakref.ref(done.placed)]
            del done
            assert [part() for part in parts] == [None, None]
            assert assemblies() == before  # nor on those of images, for which the poses were placed
    finally:
        gc.enable()


def test_linear_algebra_has_one_thread_while_a_problem_is_solved() -> None:
    def threads() -> list[int]:
        return [library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas"]

    before = threads()
    assert before
    with undisturbed():
        assert set(threads()) == {1}
        with undisturbed():
            pass
        assert set(threads()) == {1}
    assert threads() == before


def test_collections_are_as_before_once_they_were_few() -> None:
    before = gc.get_threshold()
    with undisturbed():
        assert min(gc.get_threshold()) >= min(before)
        assert gc.get_threshold()[0] > before[0]
        with undisturbed():
            pass
        assert gc.get_threshold()[0] > before[0]
    assert gc.get_threshold() == before
    gc.set_threshold(0)
    try:
        with undisturbed():
            assert gc.get_threshold()[0] == 0
    finally:
        gc.set_threshold(*before)
