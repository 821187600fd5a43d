"""The description in a plan: nominal trajectory, search, contact states, planar sets, tolerated errors.

Nothing of a certificate rests on it, and the check does not read it. Each value validates its own form as it is made,
whether a planner fills it or a file is read; the keys of a file are the names of the fields.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Sequence
from functools import cache
from itertools import pairwise
from typing import Annotated, Any

from pydantic import Field, TypeAdapter, model_validator
from pydantic.dataclasses import dataclass

from fmopt.plan.diagnostics import Diagnostics, Interval
from fmopt.plan.field_types import (
    FORM,
    Flag,
    Index,
    Label,
    Line,
    Many,
    MoveName,
    NonNegative,
    Number,
    Six,
    StateVerdict,
    check_indices,
    one_of,
    validated,
)
from fmopt.plan.press_rows import PlacedAttempt

_SAME = 1e-12  # s: two statements of one moment


def _check_cover(spans: Sequence[Interval], end: float) -> None:
    """Refuse intervals that do not cover the time from 0 to `end` (s); only the last one may be an instant."""
    joined = all(abs(a.end - b.start) <= _SAME for a, b in pairwise(spans))
    forward = all(span.start < span.end for span in spans[:-1]) and spans[-1].start <= spans[-1].end
    if not joined or not forward or abs(spans[0].start) > _SAME or abs(spans[-1].end - end) > _SAME:
        raise ValueError("intervals do not cover the nominal time from its start to its end")


@dataclass(frozen=True, config=FORM)
class Nominal:
    """The nominal trajectory: poses (6,) at times (s), straight between, and S(t) along it."""

    nodes: Many[Six]
    times: Annotated[Many[NonNegative], Field(min_length=2)]
    intervals: Annotated[Many[Interval], Field(min_length=1)]

    @model_validator(mode="after")
    def _check_times(self) -> Nominal:
        if len(self.nodes) != len(self.times) or self.times[0] != 0.0 or any(a >= b for a, b in pairwise(self.times)):
            raise ValueError("nodes need increasing times from zero")
        _check_cover(self.intervals, self.times[-1])
        return self


@dataclass(frozen=True, config=FORM)
class PositionForce(Interval):
    """Pₐ(t), Pₙ(t) and Fₐ(t) on an interval on which P is straight and S constant.

    Attributes:
        pa_start, pa_end: artificial position constraints (6,) at both ends, m and rad.
        pn_start, pn_end: natural ones likewise.
        fa: reaction (6,) on the moving part, N and N·m.
    """

    pa_start: Six
    pa_end: Six
    pn_start: Six
    pn_end: Six
    fa: Six

    @model_validator(mode="after")
    def _check_axes(self) -> PositionForce:
        for axis, (s, force) in enumerate(zip(self.s, self.fa, strict=True)):
            # A press may let an axis give way without a force on it, which is stopped both ways by none.
            if ((s == 0) != (force == 0.0) and s != 2) or (s != 0 and force * (-1.0 if s == 1 else 1.0) < 0.0):
                raise ValueError(f"entry {axis} of fa is not the reaction that s = {s} stands for")
            positions = (self.pn_start, self.pn_end) if s == 0 else (self.pa_start, self.pa_end)
            if any(at[axis] != 0.0 for at in positions):
                raise ValueError(f"entry {axis} of {'pn' if s == 0 else 'pa'} must be 0, as s = {s}")
        return self

    @property
    def either_sign(self) -> tuple[int, ...]:
        """Degrees whose reaction may have either sign."""
        return tuple(axis for axis, s in enumerate(self.s) if s == 2)


@dataclass(frozen=True, config=FORM)
class CriticalPoint:
    """A pose (6,) near which contact states were looked for.

    Attributes:
        contacts: ids of the primitive contacts possible near it.
        enumerated: whether all states near it were enumerated.
        states_by_dimension: how many states there are of each dimension.
        states_by_verdict: how many came to which verdict.
    """

    name: Label
    pose: Six
    contacts: Many[Label]
    enumerated: Flag
    states_by_dimension: dict[Annotated[str, one_of("0", "1", "2", "3", "4", "5", "6")], Index]
    states_by_verdict: dict[StateVerdict, Index]


@dataclass(frozen=True, config=FORM)
class SearchedState:
    """A contact state that the search came to.

    Attributes:
        moves: the freedoms of the moves from `origin`.
        contacts: that are held in it.
        freedoms: that are taken away in it.
        margin: the least on the way to it, m.
        expanded: whether moves were looked for from it.
        origin: number of the state that it was come to from; None where a way to begin ends in it.
        cost: of the way to it; None where a margin on it is so short that no cost is stated.
    """

    moves: Many[MoveName]
    contacts: Many[Label]
    freedoms: Annotated[Index, Field(le=6)]
    margin: Number
    expanded: Flag
    origin: Index | None = None
    cost: Number | None = None


@dataclass(frozen=True, config=FORM)
class Search:
    """How the sequence of moves was found.

    Attributes:
        objective: what its cost is made of.
        cost, lower_bound: of the sequence, and of any.
        states_expanded: states looked at.
        moves: the freedom of each move, "approach" or an axis with its sign.
        heading: turn about z of the axes that moves go along and about, rad.
        states: all states that were come to, in that order, before the way to begin was varied and poses were placed.
        way: numbers of those that the sequence goes through.
    """

    objective: Line
    cost: Number
    lower_bound: Number
    states_expanded: Index
    moves: Many[MoveName]
    heading: Annotated[Number, Field(ge=-4.0, le=4.0)]
    states: Many[SearchedState] = ()
    way: Many[Index] = ()

    @model_validator(mode="after")
    def _check_states(self) -> Search:
        if self.lower_bound > self.cost:
            raise ValueError("the lower bound exceeds the cost")
        if any(state.origin is not None and state.origin >= number for number, state in enumerate(self.states)):
            raise ValueError("a state must be come to from one listed before it")
        check_indices("way", self.way, len(self.states))
        return self

    @property
    def gap(self) -> float:
        """Difference of cost and lower bound."""
        return self.cost - self.lower_bound


@dataclass(frozen=True, config=FORM)
class TracePose:
    """A pose (6,) of a trial at a time (s), in a press of the plan, by number, or on the way back from it."""

    time: NonNegative
    press: Index
    pose: Six
    back: Flag = False


@dataclass(frozen=True, config=FORM)
class CarriedOut:
    """Draws of the stated errors in the physics engine: how many seat, the lower bound of their rate, and its aim.

    `times` are median and 95 % of how long those take that seat, s.
    """

    draws: Index
    seated: Index
    bound: Annotated[NonNegative, Field(le=1.0)]
    min_rate: Annotated[NonNegative, Field(le=1.0)]
    seed: Index
    engine: Line
    times: tuple[NonNegative, NonNegative] | None = None


@dataclass(frozen=True, config=FORM)
class OwnTrials:
    """Trials on a robot: how many seat, the lower bound of their rate, its 95 % interval, median seconds of these.

    Attributes:
        source, sha256: name and digest of the file that they are from.
        contradicts: whether the rate in the physics engine and this one lie outside of each other's intervals.
    """

    source: Line
    sha256: Line
    trials: Annotated[Index, Field(ge=1)]
    seated: Index
    bound: Annotated[NonNegative, Field(le=1.0)]
    low: Annotated[NonNegative, Field(le=1.0)]
    high: Annotated[NonNegative, Field(le=1.0)]
    seconds: NonNegative | None = None
    contradicts: Flag = False


@dataclass(frozen=True, config=FORM)
class Description:
    """All that a plan describes; what could not be found, or is not asked for, is None or empty.

    Attributes:
        critical_points: poses near which contact states were looked for.
        places: for each segment the index of the critical point near which it runs.
        trace: the way of a trial of presses without errors.
        placed: rows of the presses of each attempt.
        carried_out: trials of guarded moves before the plan was written; None where there were none.
        certified_share: of the start errors, the largest for which guarded moves are certified where presses stay below
            the rate that is asked for; None where it was not looked for.
        untried: why presses have no evidence, in words.
        tcp: pose (6,) of the tool's centre point in the frame of the moving part, m and rad.
    """

    search: Search | None = None
    nominal: Nominal | None = None
    position_force: Many[PositionForce] = ()
    critical_points: Many[CriticalPoint] = ()
    places: Many[Index] = ()
    diagnostics: Diagnostics | None = None
    trace: Many[TracePose] = ()
    placed: Many[PlacedAttempt] = ()
    carried_out: CarriedOut | None = None
    certified_share: Annotated[NonNegative, Field(le=1.0)] | None = None
    untried: Line = ""
    own_trials: Many[OwnTrials] = ()
    tcp: Six = (0.0,) * 6

    @model_validator(mode="after")
    def _check_agreement(self) -> Description:
        """Refuse rows beside the nominal trajectory, and indices of critical points that are none."""
        if self.position_force:
            intervals = () if self.nominal is None else self.nominal.intervals
            _check_cover(self.position_force, intervals[-1].end if intervals else 0.0)
            for row in self.position_force:
                middle = 0.5 * (row.start + row.end)
                at = bisect_left(intervals, middle, key=lambda span: span.end)
                # A row that is an instant at the end has the s of the next interval as well as that of its own.
                if not any(row.s == span.s and span.start <= middle <= span.end for span in intervals[at : at + 2]):
                    raise ValueError("a row of position_force has another s than the nominal interval that it lies in")
        visits = () if self.diagnostics is None else self.diagnostics.sequence
        if any(at >= len(self.critical_points) for at in (*self.places, *(at for v in visits for at, _ in v.held_in))):
            raise ValueError(f"a critical point is named beyond the {len(self.critical_points)} that there are")
        return self

    @staticmethod
    def parsed(value: Any) -> Description:
        """The description of a JSON value.

        Raises:
            PlanError: it is none; says where in it, and what is wrong.
        """
        return validated(_adapter(), value, "description")

    def record(self) -> dict[str, Any]:
        """The description as tables and lists, without optional fields that hold nothing."""
        found: dict[str, Any] = _adapter().dump_python(self, exclude_defaults=True)
        return found


@cache
def _adapter() -> TypeAdapter[Description]:
    return TypeAdapter(Description)
