"""The order in which attitudes are tried for a motion, and which failure is told where all of them fail."""

import math
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import pytest

from fmopt.errors import FmoptError, InfeasibleError, OverdueError, SearchError
from fmopt.planning import motion
from fmopt.planning.pipeline import certified_motion
from fmopt.planning.posed import Posed, Stages
from fmopt.planning.search import entry_sampling
from fmopt.planning.search.symmetry import images
from fmopt.task.problem import Problem, load
from tests import ROOT


@pytest.fixture(scope="module")
def rectangle() -> Problem:
    """Of its parts there are two images."""
    return load(ROOT / "problems" / "factory_rect_8mm_tight_300um.toml")


def failing(monkeypatch: pytest.MonkeyPatch, errors: list[FmoptError]) -> list[tuple[int, int]]:
    """Lets all attempts fail, one after the other; for each of them which attitude it was, and with how many ways."""
    tried: list[tuple[int, int]] = []
    known: list[Any] = []

    def fail(self: Any, rounds: Iterator[Any], *_: Any) -> None:
        known.extend([] if self in known else [self])
        tried.append((known.index(self), len(list(rounds))))
        raise errors[len(tried) - 1]

    def never(*_: object) -> None:
        raise InfeasibleError("the moves can be followed under half of the errors only")

    monkeypatch.setattr(motion, "beginnings", lambda *_: [object()] * 3)
    monkeypatch.setattr(motion._Stood, "motion", fail)
    monkeypatch.setattr(motion._Stood, "grown", never)
    return tried


def test_likely_ways_of_all_attitudes_come_before_the_rest(rectangle: Problem, monkeypatch: pytest.MonkeyPatch) -> None:
    tried = failing(monkeypatch, [SearchError(f"attempt {n}") for n in range(4)])
    with pytest.raises(SearchError, match="attempt 0"):
        certified_motion(rectangle)
    assert [attitude for attitude, _ in tried] == [0, 1, 0, 1]
    assert [ways for _, ways in tried[:2]] == [32, 32]
    assert min(ways for _, ways in tried[2:]) > 32


@pytest.mark.parametrize(
    ("errors", "told"),
    [
        ([InfeasibleError("a"), SearchError("b"), SearchError("c"), SearchError("d")], "b"),
        ([SearchError("a"), InfeasibleError("b"), SearchError("c"), SearchError("d", late=True)], "d"),
        ([InfeasibleError("a"), InfeasibleError("b"), InfeasibleError("c"), InfeasibleError("d")], "a"),
    ],
)
def test_the_failure_that_says_most_of_all_attempts_is_told(
    errors: list[FmoptError], told: str, rectangle: Problem, monkeypatch: pytest.MonkeyPatch
) -> None:
    failing(monkeypatch, errors)
    with pytest.raises(FmoptError, match=f"^{told}$"):
        certified_motion(rectangle)


def test_what_the_best_sequence_takes_of_errors_is_told(rectangle: Problem, monkeypatch: pytest.MonkeyPatch) -> None:
    def nearly(*_: object) -> None:
        error = InfeasibleError("the moves can be followed under 88% of the errors only")
        error.share = 0.88
        raise error

    failing(monkeypatch, [SearchError(f"attempt {n}") for n in range(4)])
    monkeypatch.setattr(motion._Stood, "grown", nearly)
    with pytest.raises(SearchError, match=r"takes all of the errors, the best that was found about 88% of") as caught:
        certified_motion(rectangle)
    assert not caught.value.late


def test_what_was_found_counts_when_time_ends_early(rectangle: Problem, monkeypatch: pytest.MonkeyPatch) -> None:
    ample = SimpleNamespace(margin=1.0)
    found, begun = SimpleNamespace(moves=(), reached=ample), list[object]()

    def begin(_: object, entry: object) -> object:
        begun.append(entry)
        if len(begun) > 1:
            raise OverdueError("the time limit is used up")
        return SimpleNamespace(reached=ample)

    def placed(*_: object) -> None:
        error = InfeasibleError("the moves can be followed under 61% of the errors only")
        error.share = 0.61
        raise error

    posed = Posed.of(rectangle)
    stood = motion._Stood.of(posed, next(iter(images(posed.assembly, rectangle.start_box))))
    monkeypatch.setattr(entry_sampling, "begin", begin)
    monkeypatch.setattr(motion, "search", lambda *_: found)
    monkeypatch.setattr(motion, "placed_by_growing", placed)
    with pytest.raises(InfeasibleError, match="61% of the errors"):
        stood.grown(math.inf, Stages())
    assert stood.found is found  # type: ignore[comparison-overlap]
