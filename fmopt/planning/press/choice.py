"""Which sequence is handed out: candidates thinned out in the engine by successive halving, then examined once.

Choices rest on streams of their own. The plan is frozen before the first draw of its evidence; at most two plans are
examined for one problem.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fmopt.errors import SearchError
from fmopt.execution.engines.engine import Bodies
from fmopt.execution.evidence import Examination, examine
from fmopt.execution.press_rig import Outcome
from fmopt.execution.press_trials import carry_out, count_presses, drawn_errors
from fmopt.plan.evidence import Evidence
from fmopt.plan.press import MAX_ATTEMPTS, Attempt, Conditions, PressPlan, PressRobot, Seat
from fmopt.runtime.compiled import clock, deadline
from fmopt.runtime.process import cores

_ROUNDS = (8, 16, 32)  # draws that a candidate has seen after each round
_LEFT = 0.5  # of the candidates that a round leaves
_LEAST = 4  # candidates that are left at least, as long as there are so many
_CORNERS = 0.5  # of the draws of a choice that are at vertices of the start box
_CHOOSING = 0x63686F69  # sets the streams of choices apart from those of evidence


@dataclass(frozen=True, eq=False)
class Trialled:
    """A candidate with the outcomes of its draws, in their order."""

    attempt: Attempt
    outcomes: tuple[Outcome, ...]

    @property
    def seats(self) -> frozenset[int]:
        """Draws that seat."""
        return frozenset(k for k, one in enumerate(self.outcomes) if one.seated)

    @property
    def score(self) -> tuple[float, float]:
        """Share that seats, then how quickly."""
        seconds = float(np.mean([one.seconds for one in self.outcomes]))
        return len(self.seats) / len(self.outcomes), -round(seconds, 3)


@dataclass(frozen=True, eq=False)
class Choosing:
    """What candidates are carried out with.

    Attributes:
        bodies: both parts.
        seat: what counts as seated.
        robot: at strength 1.
        conditions: that draws are taken from.
        seed: of the choice.
    """

    bodies: Bodies
    seat: Seat
    robot: PressRobot
    conditions: Conditions
    seed: int

    def plan(self, attempts: Sequence[Attempt]) -> PressPlan:
        """Attempts as a plan, at the largest strength that the limits of force and torque allow."""
        first = PressPlan(self.robot, tuple(attempts), max(one.start[2] for one in attempts), self.seat)
        return first.strengthened(strength(first))

    def carried_out(self, candidates: Sequence[Attempt], numbers: range) -> list[tuple[Outcome, ...]]:
        """Outcomes of each candidate, alone, for the same draws."""
        plan, count = self.plan(candidates), len(numbers)
        seed = self.seed ^ _CHOOSING
        once = drawn_errors(self.conditions, count_presses(plan), seed, numbers, _CORNERS)
        errors = once.of(np.tile(np.arange(count), len(candidates)))
        courses = [(k,) for k in range(len(candidates)) for _ in numbers]
        trials = [number for _ in candidates for number in numbers]
        found = carry_out(self.bodies, plan, errors, seed, trials, courses, threads=cores())
        return [tuple(found[k * count : (k + 1) * count]) for k in range(len(candidates))]


_IMPACT = 1.4  # N, filtered, that a contact met at the limits of speed adds to the force, per kg·cm/s
_ABOVE = 1.15  # times the steady force: what friction and noise add to it


def strength(plan: PressPlan) -> float:
    """Factor of all wrenches with which the force stays within its limit and the torque within its own."""
    robot, factors = plan.robot, list[float]()
    for attempt in plan.attempts:
        for press in attempt.presses:
            force, torque = np.linalg.norm(press.wrench[:3]), np.linalg.norm(press.wrench[3:])
            torque = torque + np.linalg.norm(np.cross(press.reference, press.wrench[:3]))
            speed = max(press.speed[:3])
            room = robot.limits[0] - _IMPACT * robot.mass * 100.0 * speed
            if force > 0.0:
                factors.append(room / (_ABOVE * float(force)))
            if torque > 0.0:
                factors.append(robot.limits[1] / (_ABOVE * float(torque)))
    found = min(factors)
    if found <= 0.0:
        raise SearchError("no press is as light as the limits of force ask for", "raise contact_force")
    return found


def halved(choosing: Choosing, candidates: Sequence[Attempt], progress: Callable[[str], None]) -> list[Trialled]:
    """Candidates in the order of their scores after successive halving, best first.

    Args:
        choosing: how they are carried out.
        candidates: in the order of their generators.
        progress: told in words.
    """
    left, begun = [Trialled(one, ()) for one in candidates], 0
    for draws in _ROUNDS:
        progress(f"presses: {len(left)} candidates, {draws} draws each")
        found = choosing.carried_out([one.attempt for one in left], range(begun, draws))
        left = [replace(one, outcomes=one.outcomes + new) for one, new in zip(left, found, strict=True)]
        left.sort(key=lambda one: one.score, reverse=True)
        begun = draws
        if clock() >= deadline():
            break
        left = left[: max(round(_LEFT * len(left)), _LEAST)]
        if len([one for one in left if one.score[0] == 1.0]) >= MAX_ATTEMPTS and draws >= _ROUNDS[1]:
            break
    return left


def with_retries(ranked: Sequence[Trialled], first: int = 0) -> list[Attempt]:
    """The candidate at a place of the ranking, then those that seat most of the draws that fail with it."""
    chosen = [ranked[first]]
    others = [one for k, one in enumerate(ranked) if k != first]
    while others and len(chosen) < MAX_ATTEMPTS:
        seated = frozenset().union(*(one.seats for one in chosen))
        best = max(others, key=lambda one: (len(one.seats - seated), one.score))
        chosen.append(best)
        others.remove(best)
    return [one.attempt for one in chosen]


def examined(
    choosing: Choosing, ranked: Sequence[Trialled], asked: Examination, subject_of: Callable[[PressPlan], str],
    progress: Callable[[str], None],
) -> tuple[PressPlan, Evidence]:  # fmt: skip
    """The first plan whose evidence reaches what is asked, of two at most; else the better one.

    Args:
        choosing: how candidates were carried out.
        ranked: by their scores.
        asked: of the evidence.
        subject_of: digest of what is carried out.
        progress: told in words.
    """
    best: tuple[PressPlan, Evidence] | None = None
    for number in range(min(2, len(ranked))):
        plan = choosing.plan(with_retries(ranked, number))
        request = replace(asked, seed=asked.seed + number, examined=number + 1)
        found = examine(choosing.bodies, plan, choosing.conditions, request, subject_of(plan), progress)
        if best is None or (found.level, found.bound) > (best[1].level, best[1].bound):
            best = plan, found
        if found.level == "tested" or clock() >= deadline():
            break
    assert best is not None
    return best
