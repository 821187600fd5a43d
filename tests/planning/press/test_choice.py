"""Choosing among candidates, on outcomes made up by hand, and the strength of presses."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from fmopt.errors import OverdueError, SearchError
from fmopt.execution.evidence import Examination
from fmopt.plan.evidence import TrialOutcome
from fmopt.plan.press import Attempt, Force, Press, Time
from fmopt.planning.press import choice
from fmopt.planning.press.choice import Choosing, Pace, Trialled, examined, halved, strength, with_retries
from fmopt.runtime.clock import clock, until
from tests.shared.plans.press_plan import press_choosing, press_plan

ZERO = (0.0, 0.0, 0.0)


def candidate(name: str) -> Attempt:
    press = Press("press", (True,) * 6, (0.0,) * 6, (0.0, 0.0, -1.0, *ZERO), (0.01,) * 6, (0.1, 1.0), (Time(1.0),))
    return Attempt((0.0,) * 6, (press,), name)


def outcome(seated: bool, seconds: float = 5.0) -> TrialOutcome:
    return TrialOutcome(seated, 0, "press", seconds, 10.0, 0.0, () if seated else ("tilted",), ZERO, ZERO)


class Carried:
    """Candidates "0", "1", … that fail in so many of sixteen draws; notes what is carried out."""

    def __init__(self, failures: Sequence[int], seconds: Sequence[float]) -> None:
        self.failures, self.seconds, self.seen = failures, seconds, list[tuple[str, int]]()

    def __call__(self, candidates: Sequence[Attempt], numbers: range) -> list[tuple[TrialOutcome, ...]]:
        found = []
        for one in candidates:
            k = int(one.source)
            self.seen += [(one.source, number) for number in numbers]
            found.append(tuple(outcome(5 * n % 16 >= self.failures[k], self.seconds[k]) for n in numbers))
        return found


def ranked(monkeypatch: pytest.MonkeyPatch, failures: Sequence[int], seconds: Sequence[float] = (5.0,) * 15) -> Carried:
    carried = Carried(failures, seconds)
    monkeypatch.setattr(Choosing, "carried_out", carried)
    return carried


@pytest.mark.parametrize("best", [0, 3, 7, 14])
def test_halving_keeps_the_best_and_carries_no_draw_out_twice(best: int, monkeypatch: pytest.MonkeyPatch) -> None:
    failures = [6 + k % 5 for k in range(15)]
    failures[best] = 2
    carried = ranked(monkeypatch, failures)
    words: list[str] = []
    left = halved(press_choosing(), [candidate(str(k)) for k in range(15)], words.append, Pace(160))
    assert left[0].attempt.source == str(best)
    assert len(left[0].outcomes) == 32
    assert [one.score for one in left] == sorted((one.score for one in left), reverse=True)
    assert len(set(carried.seen)) == len(carried.seen)
    assert len(carried.seen) < 15 * 32
    assert words[0] == "presses: 6 candidates, draws 1 to 8"


def test_of_those_that_always_seat_the_quicker_leads_and_later_waves_are_not_looked_at(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    carried = ranked(monkeypatch, [9, 0, 9, 0, 9, 9, *[0] * 9], [5.0, 6.0, 5.0, 4.0, *[1.0] * 11])
    left = halved(press_choosing(), [candidate(str(k)) for k in range(15)], lambda _: None, Pace(160))
    assert [one.attempt.source for one in left[:2]] == ["3", "1"]
    assert {source for source, _ in carried.seen} == {str(k) for k in range(6)}
    assert max(number for _, number in carried.seen) == 15  # two that seat in all of sixteen draws are enough


@pytest.mark.parametrize("rounds", [0, 1, 3])
def test_a_choice_that_is_cut_off_ranks_what_was_carried_out(rounds: int, monkeypatch: pytest.MonkeyPatch) -> None:
    carried, calls = Carried([5] * 15, [5.0] * 15), list[int]()

    def cut(self: Choosing, candidates: Sequence[Attempt], numbers: range) -> list[tuple[TrialOutcome, ...]]:
        calls.append(len(numbers))
        if len(calls) > rounds:
            raise OverdueError("the time limit is used up")
        return carried(candidates, numbers)

    monkeypatch.setattr(Choosing, "carried_out", cut)
    candidates = [candidate(str(k)) for k in range(15)]
    with until(clock() + 1e3 if rounds else 0.0):
        if not rounds:
            with pytest.raises(OverdueError):
                halved(press_choosing(), candidates, lambda _: None, Pace(160))
            return
        left = halved(press_choosing(), candidates, lambda _: None, Pace(160))
    assert left
    assert all(one.outcomes for one in left)
    assert sum(len(one.outcomes) for one in left) <= len(carried.seen)


@pytest.mark.parametrize(
    ("seconds", "late", "in_vain"), [(2000.0, False, False), (1000.0, True, False), (700.0, True, True)]
)
def test_evidence_that_cannot_be_through_is_forecast(seconds: float, late: bool, in_vain: bool) -> None:
    pace = Pace(160, trials=8, seconds=53.0)
    with until(clock() + seconds):
        assert (pace.late, pace.in_vain) == (late, in_vain)
    wanted = "its 160 trials take longer than the time limit of 700 s leaves: set settings.time_limit to about 2000 s"
    assert pace.words(700.0) == wanted


def test_an_examination_that_is_cut_off_leaves_the_plan_without_evidence() -> None:
    choosing, left = press_choosing(), [Trialled(one, (outcome(True),) * 8) for one in press_plan().attempts]
    with until(0.0):
        plan, evidence = examined(choosing, left, Examination(96, 0.9, 1), lambda _: "0" * 64, lambda _: None)
    assert evidence is None
    assert plan.attempts[0] == left[0].attempt


def test_retries_seat_what_the_first_leaves() -> None:
    def one(name: str, seats: set[int]) -> Trialled:
        return Trialled(candidate(name), tuple(outcome(n in seats) for n in range(8)))

    first, alike = one("first", {0, 1, 2, 3, 4, 5}), one("alike", {0, 1, 2, 3, 4})
    other, last = one("other", {6, 0}), one("last", {7})
    assert [a.source for a in with_retries([first, alike, other, last])] == ["first", "other", "last"]
    assert [a.source for a in with_retries([first, alike, other, last], 1)] == ["alike", "first", "other"]
    assert [a.source for a in with_retries([first])] == ["first"]


def test_strength_keeps_every_press_within_the_limits_and_one_at_them() -> None:
    plan = press_plan()
    robot, shares = plan.robot, []
    for press in (press for attempt in plan.attempts for press in attempt.presses):
        force = float(np.linalg.norm(press.wrench[:3]))
        impact = choice._IMPACT * 100.0 * robot.mass * max(press.speed[:3])
        torque = np.linalg.norm(press.wrench[3:]) + np.linalg.norm(np.cross(press.reference, press.wrench[:3]))
        shares.append((choice._ABOVE * force + impact) / robot.limits[0])
        shares.append(choice._ABOVE * float(torque) / robot.limits[1])
    assert max(shares) == pytest.approx(1.0)
    assert strength(plan) == pytest.approx(1.0)
    # Ways and speeds stay: damping and thresholds of force are scaled alike.
    one = replace(candidate("0").presses[0], ends=(Force(8.0), Time(1.0)))
    weaker = replace(plan, attempts=(replace(candidate("0"), presses=(one,)),)).strengthened(0.5)
    assert weaker.attempts[0].presses[0].wrench[2] == -0.5
    assert weaker.attempts[0].presses[0].ends[0] == Force(4.0)
    assert np.allclose(weaker.robot.damping, 0.5 * np.array(robot.damping))
    fast = replace(plan, robot=replace(robot, mass=100.0))
    with pytest.raises(SearchError, match="as light as the limits"):
        strength(fast)


def test_a_candidate_that_is_late_loses_to_one_that_is_in_time(monkeypatch: pytest.MonkeyPatch) -> None:
    ranked(monkeypatch, [0, 0, 4], [9.0, 7.0, 3.0])
    candidates = [candidate(str(k)) for k in range(3)]
    for max_time, best in ((5.0, "2"), (8.0, "1")):
        left = halved(replace(press_choosing(), max_time=max_time), candidates, lambda _: None, Pace(160))
        assert left[0].attempt.source == best


@pytest.mark.parametrize(("seconds", "level"), [((4.0, 4.0), "tested"), ((9.0, 6.0), "below")])
def test_of_plans_with_equal_evidence_the_faster_is_taken_and_no_late_one_is_tested(
    seconds: tuple[float, float], level: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls = list[int]()

    def carried(*arguments: object, **_: object) -> list[TrialOutcome]:
        calls.append(1)
        return [outcome(True, seconds[len(calls) - 1])] * 160

    monkeypatch.setattr("fmopt.execution.evidence.carry_out", carried)
    left = [Trialled(one, (outcome(True),) * 8) for one in press_plan().attempts]
    asked = Examination(96, 0.9, 1, max_time=5.0)
    plan, evidence = examined(press_choosing(), left, asked, lambda _: "0" * 64, lambda _: None)
    assert evidence is not None
    assert (evidence.level, evidence.cycle_times, evidence.max_time) == (level, (seconds[-1],) * 2, 5.0)
    assert (len(calls), plan.attempts[0]) == ((1, left[0].attempt) if level == "tested" else (2, left[1].attempt))
