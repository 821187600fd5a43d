"""Which sequence is handed out: candidates thinned out in the engine by successive halving, then examined once.

Choices rest on streams of their own. The plan is frozen before the first draw of its evidence; at most two plans are
examined for one problem.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fmopt.errors import OverdueError, SearchError
from fmopt.execution.engines.engine import Bodies
from fmopt.execution.evidence import Examination, examine
from fmopt.execution.press_trials import carry_out, count_presses, drawn_errors
from fmopt.plan.evidence import MAX_EXAMINED, Evidence, TrialOutcome
from fmopt.plan.press import ALONE, MAX_ATTEMPTS, Attempt, Conditions, PressPlan, PressRobot, Seat, Surroundings
from fmopt.runtime.clock import clock, deadline, heed
from fmopt.runtime.process import cores

_ROUNDS = (8, 16, 32)  # draws that a candidate has seen after each round
_LEFT = 0.5  # of the candidates that a round leaves
_LEAST = 3  # candidates that are left at least, as long as there are so many
_WAVE = 6  # candidates that are looked at before others are
_SURE = 2  # of them that seat in all of the draws of two rounds end the choice; so does one in those of three
_CORNERS = 0.5  # of the draws of a choice in which all but drift is at ends of its intervals
_FASTER = 0.8  # times as long as forecast trials take at least
_CHOOSING = 0x63686F69  # sets the streams of choices apart from those of evidence


@dataclass(frozen=True, eq=False)
class Trialled:
    """A candidate with the outcomes of its draws, in their order; those that take longer than `max_time` (s) fail."""

    attempt: Attempt
    outcomes: tuple[TrialOutcome, ...]
    max_time: float = math.inf

    @property
    def seats(self) -> frozenset[int]:
        """Draws that seat in time."""
        return frozenset(k for k, one in enumerate(self.outcomes) if one.seated and one.seconds <= self.max_time)

    @property
    def score(self) -> tuple[float, float]:
        """Share that seats, then how quickly."""
        seconds = float(np.mean([one.seconds for one in self.outcomes]))
        return len(self.seats) / len(self.outcomes), -round(seconds, 3)


@dataclass(frozen=True, eq=False)
class Choosing:
    """What candidates are carried out with."""

    bodies: Bodies
    seat: Seat  # what counts as seated
    robot: PressRobot  # at strength 1
    conditions: Conditions  # that draws are taken from
    seed: int  # of the choice
    filled: bool = False  # whether the moving part has its hollows filled
    cell: Surroundings = ALONE  # what the parts are kept clear of
    max_time: float = math.inf  # s, that a trial may take

    def plan(self, attempts: Sequence[Attempt]) -> PressPlan:
        """Attempts as a plan, at the largest strength that the limits of force and torque allow."""
        over = max(one.start[2] for one in attempts)
        first = PressPlan(self.robot, tuple(attempts), over, self.seat, self.filled, self.cell)
        return first.strengthened(strength(first))

    def carried_out(self, candidates: Sequence[Attempt], numbers: range) -> list[tuple[TrialOutcome, ...]]:
        """Outcomes of each candidate, alone, for the same draws."""
        plan, count, seed = self.plan(candidates), len(numbers), self.seed ^ _CHOOSING
        once = drawn_errors(self.conditions, count_presses(plan), seed, numbers, _CORNERS)
        errors = once.of(np.tile(np.arange(count), len(candidates)))
        courses = [(k,) for k in range(len(candidates)) for _ in numbers]
        trials = [number for _ in candidates for number in numbers]
        found = carry_out(self.bodies, plan, errors, seed, trials, courses, threads=cores())
        return [tuple(found[k * count : (k + 1) * count]) for k in range(len(candidates))]


_IMPACT = 1.4  # N, filtered, that a contact met at the limits of speed adds to the force, per kg·cm/s
_ABOVE = 1.15  # times the steady force: what friction and noise add to it


def strength(plan: PressPlan) -> float:
    """Factor of all wrenches with which the force stays within its limit and the torque within its own.

    Raises:
        SearchError: contacts met at the speed of the presses exceed the limit of force already.
    """
    robot, factors = plan.robot, list[float]()
    for attempt in plan.attempts:
        for press in attempt.presses:
            force, torque = np.linalg.norm(press.wrench[:3]), np.linalg.norm(press.wrench[3:])
            torque = torque + np.linalg.norm(np.cross(press.reference, press.wrench[:3]))
            room = robot.limits[0] - _IMPACT * robot.mass * 100.0 * max(press.speed[:3])
            if force > 0.0:
                factors.append(room / (_ABOVE * float(force)))
            if torque > 0.0:
                factors.append(robot.limits[1] / (_ABOVE * float(torque)))
    found = min(factors)
    if found <= 0.0:
        raise SearchError("no press is as light as the limits of force ask for", "raise contact_force")
    return found


def halved(
    choosing: Choosing, candidates: Sequence[Attempt], progress: Callable[[str], None], pace: Pace
) -> list[Trialled]:
    """Candidates in the order of their scores after successive halving, best first.

    They come in waves: where some of a wave seat in all draws, later ones are not looked at.

    Raises:
        OverdueError: the time limit leaves no draw for any.
    """
    left: list[Trialled] = []
    for begun in range(0, len(candidates), _WAVE):
        wave = [Trialled(one, (), choosing.max_time) for one in candidates[begun : begun + _WAVE]]
        left = _halved(choosing, [*left, *wave], pace, progress)
        if _sure(left) or pace.late:
            break
    if not left:
        heed()
    return left


@dataclass
class Pace:
    """How long trials take, for the `kept` ones of the evidence to be forecast."""

    kept: int
    trials: int = 0  # that are through
    seconds: float = 0.0  # that they took by the clock

    @property
    def needed(self) -> float:
        """What the evidence takes, s."""
        return self.kept * self.seconds / max(self.trials, 1)

    @property
    def late(self) -> bool:
        """Whether another round would take time from the evidence."""
        return deadline() - clock() < self.needed

    @property
    def in_vain(self) -> bool:
        """Whether the evidence could not be through in the time that is left, even if trials were faster by much."""
        return deadline() - clock() < _FASTER * self.needed

    def words(self, seconds: float) -> str:
        """That the evidence takes too long, and how high the time limit would have to be."""
        exponent = 10.0 ** math.floor(math.log10(seconds + self.needed))
        enough = next(step * exponent for step in (2.0, 5.0, 10.0) if step * exponent > seconds + self.needed)
        left = f"its {self.kept} trials take longer than the time limit of {seconds:.0f} s leaves"
        return f"{left}: set settings.time_limit to about {enough:g} s"


def _sure(ranked: Sequence[Trialled]) -> bool:
    """Whether enough is known: candidates seat in all of many draws, or several of them in all of some."""
    perfect = [len(one.outcomes) for one in ranked if one.score[0] == 1.0]
    return max(perfect, default=0) >= _ROUNDS[-1] or sum(draws >= _ROUNDS[1] for draws in perfect) >= _SURE


def _halved(
    choosing: Choosing, candidates: list[Trialled], pace: Pace, progress: Callable[[str], None]
) -> list[Trialled]:
    """See `halved`; candidates that have seen some draws already begin with those that they have not seen."""
    left = candidates
    for draws in _ROUNDS:
        fresh = [one for one in left if len(one.outcomes) < draws]
        for seen in sorted({len(one.outcomes) for one in fresh}):
            group = [one for one in fresh if len(one.outcomes) == seen]
            progress(f"presses: {len(group)} candidates, draws {seen + 1} to {draws}")
            # The first candidate alone tells how long trials take.
            for part in (group,) if pace.trials else (group[:1], group[1:]):
                begun = clock()
                try:
                    found = choosing.carried_out([one.attempt for one in part], range(seen, draws)) if part else []
                except OverdueError:
                    break
                pace.trials, pace.seconds = pace.trials + len(part) * (draws - seen), pace.seconds + clock() - begun
                new = {one: replace(one, outcomes=one.outcomes + more) for one, more in zip(part, found, strict=True)}
                left = [new.get(one, one) for one in left]
                if pace.late:
                    break
        left = sorted((one for one in left if one.outcomes), key=lambda one: one.score, reverse=True)
        if pace.late or _sure(left):
            break
        left = left[: max(round(_LEFT * len(left)), _LEAST)]
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
) -> tuple[PressPlan, Evidence | None]:  # fmt: skip
    """The first plan whose evidence reaches what is asked, of two at most; else the better or the faster one.

    Where the time limit cuts the examination of the first one off, it has no evidence. `subject_of` is the digest of
    what is carried out.
    """
    best: tuple[PressPlan, Evidence] | None = None
    for number in range(min(MAX_EXAMINED, len(ranked))):
        plan = choosing.plan(with_retries(ranked, number))
        request = replace(asked, seed=asked.seed + number, examined=number + 1)
        try:
            found = examine(choosing.bodies, plan, choosing.conditions, request, subject_of(plan), progress)
        except OverdueError:
            return best or (plan, None)
        if best is None or _worth(found) > _worth(best[1]):
            best = plan, found
        if found.level == "tested":
            break
    assert best is not None
    return best


def _worth(evidence: Evidence) -> tuple[bool, float, int, float]:
    """By what plans are compared: of those with equal evidence the faster one is the better one."""
    _, late = evidence.cycle_times or (0.0, math.inf)
    in_time = evidence.max_time is None or late <= evidence.max_time
    return in_time, evidence.bound, evidence.vertices_seated, -late
