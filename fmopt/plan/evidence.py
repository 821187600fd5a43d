"""Evidence that a plan seats: outcomes of trials in the physics engine, with the lower bound of their rate."""

import re
from collections.abc import Sequence
from typing import Annotated, Any, Literal, TypeAlias

from pydantic import ConfigDict, Field, TypeAdapter
from pydantic.dataclasses import dataclass

from fmopt.plan.description import TracePose
from fmopt.plan.field_types import validated
from fmopt.plan.press import Conditions
from fmopt.verify.reading.reader import PlanError

_FORM = ConfigDict(extra="forbid", allow_inf_nan=False)
CONFIDENCE = 0.975  # of the bound: two plans at most are examined, so that the answer holds at 0.95
MAX_EXAMINED = 2  # plans for one problem
MIN_VERTICES = 58  # of the 64 that have to seat
VERTICES = 64
MAX_WAYS = 8  # of trials that do not seat, which are kept pose by pose
TOUCH = 1e-4  # m, distance at which solids around the parts count as touching: about the way of a period

Share: TypeAlias = Annotated[float, Field(ge=0.0, le=1.0)]
Count: TypeAlias = Annotated[int, Field(ge=0, le=100_000)]
Three: TypeAlias = tuple[float, float, float]


@dataclass(frozen=True, config=_FORM)
class TrialOutcome:
    """One trial: whether it seats, at which attempt (from 0), how long (s), greatest force (N) and penetration (m).

    `press` is the last one that it was at, `reasons` say what speaks against it; `offset` (m) and `turn` (rad) are from
    the goal. `rests` has, for each attempt, where the reference point was at the end of each press that it came to, m;
    `way` the poses of a trial that does not seat, and nothing where it is not kept. What is around the parts stayed at
    least `distance` (m) away; None where there is nothing.
    """

    seated: bool
    attempt: Count
    press: str
    seconds: float
    peak_force: float
    penetration: float
    reasons: tuple[str, ...]
    offset: Three
    turn: Three
    rests: tuple[tuple[Three, ...], ...] = ()
    way: tuple[TracePose, ...] = ()
    distance: float | None = None

    @property
    def kind(self) -> str:
        """The first reason against it, without the numbers of the one trial; empty where it seats."""
        words = self.reasons[-1] if self.reasons[:1] == ("stopped on the way",) else next(iter(self.reasons), "")
        return re.sub(r"^[-.\d ]+(mm )?|( of)? [-.\d]+ (µm|N)$", "", words)


@dataclass(frozen=True, config=_FORM)
class Evidence:
    """What trials of the plan came to.

    Attributes:
        level: "tested" where the bound is at least `min_rate`, enough vertices seat, and 95 % of the draws that seat
            are through within `max_time` (s), else "below".
        draws, seated, first_tries: uniform draws, how many of them seat, and how many at the first attempt.
        confidence, bound: one-sided Clopper–Pearson lower bound of the rate with which draws seat.
        min_rate: asked for.
        vertices, vertices_seated: of the start box, with the ends of the other intervals; no bound is told of these.
        examined: which plan this is of those that were examined for the problem, from 1; there are two at most.
        seed: of the draws; `engine` with its version.
        conditions: boxes and intervals that are drawn from.
        subject: SHA-256 of parts, presses, robot and goal that were carried out.
        outcomes, vertex_outcomes: of each draw in order.
    """

    level: Literal["tested", "below"]
    draws: Count
    seated: Count
    first_tries: Count
    confidence: Share
    bound: Share
    min_rate: Share
    vertices: Count
    vertices_seated: Count
    examined: Annotated[int, Field(ge=1, le=MAX_EXAMINED)]
    seed: Annotated[int, Field(ge=0, lt=2**63)]
    engine: str
    conditions: Conditions
    subject: str
    outcomes: tuple[TrialOutcome, ...]
    vertex_outcomes: tuple[TrialOutcome, ...]
    max_time: float | None = None

    @property
    def by_name(self) -> dict[str, TrialOutcome]:
        """Outcomes by name, "draw 14" or "vertex 3": draws come first."""
        kinds = ("draw", self.outcomes), ("vertex", self.vertex_outcomes)
        return {f"{kind} {number}": one for kind, outcomes in kinds for number, one in enumerate(outcomes)}

    @property
    def cycle_times(self) -> tuple[float, float] | None:
        """Median and 95 % of the cycle times of the draws that seat, s; None where none does."""
        return cycle_times(self.outcomes)

    @property
    def peak_force(self) -> float:
        """The greatest force of the draws, N."""
        return max((one.peak_force for one in self.outcomes), default=0.0)

    @property
    def distance(self) -> float | None:
        """The least distance of all trials, m, between parts and solids around them; None where there are none."""
        distances = (one.distance for one in (*self.outcomes, *self.vertex_outcomes))
        return min((one for one in distances if one is not None), default=None)


def cycle_times(outcomes: Sequence[TrialOutcome]) -> tuple[float, float] | None:
    """Median and 95 % of the cycle times of the trials that seat, s; None where none does."""
    return median_and_late([one.seconds for one in outcomes if one.seated])


def median_and_late(seconds: Sequence[float]) -> tuple[float, float] | None:
    """Median and 95 % of times, s; None where there are none."""
    ranked = sorted(seconds)
    late = min(int(0.95 * len(ranked)), len(ranked) - 1)
    return (ranked[len(ranked) // 2], ranked[late]) if ranked else None


def evidence_of(value: Any, counts: Sequence[int]) -> Evidence:
    """The evidence of a plan file, whose attempts have so many presses.

    Raises:
        PlanError: it is none; says where, and what is wrong.
    """
    found = validated(_ADAPTER, value, "evidence")
    for name, one in found.by_name.items():
        fits = all(0 < len(rests) <= count for rests, count in zip(one.rests, counts, strict=False))
        if not fits or len(one.rests) > len(counts) or any(pose.press >= sum(counts) for pose in one.way):
            raise PlanError(f"evidence, {name}", "rests or goes on in presses that the plan does not have")
    return found


def evidence_record(evidence: Evidence) -> dict[str, Any]:
    """Evidence as a plan file holds it."""
    found: dict[str, Any] = _ADAPTER.dump_python(evidence, exclude_none=True)
    return found


_ADAPTER = TypeAdapter(Evidence)
