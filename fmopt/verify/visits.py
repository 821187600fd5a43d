"""What a plan tells of how it was found, held against its segments: the contact states that the motion comes to.

The states themselves were found by enumeration, which nothing here repeats. But where a state begins, and how, follows
from the segments: a contact is made where the last piece of a move meets it, and left where the first piece of a move
gives it up; and a state is the same in the sequence as in the graph of the critical point that holds it.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

from fmopt.verify.diagnostics import Diagnostics, Visit
from fmopt.verify.document import Plan
from fmopt.verify.findings import CERTIFIED, Notes

_SAME = 1e-9  # of a half-width


def check_diagnostics(plan: Plan, notes: Notes) -> None:
    """Judges what of the diagnostics must agree with the rest of a plan; a plan without any is not judged."""
    found = plan.diagnostics
    if found is None:
        return
    _sequence(found.sequence, plan, notes)
    _graphs(found, plan, notes)
    if found.hand is not None and len(found.hand.segments) != len(plan.segments):
        notes.add("diagnostics.hand", "has not one move of the hand for each segment")
    if found.reduced is not None:
        if plan.verdict == CERTIFIED:
            notes.add("diagnostics.reduced", "the plan is for a share of the stated errors, and cannot be certified")
        _scaled("diagnostics.reduced", plan.start_box, found.reduced.share, found.reduced.stated_start_box, notes)
    if found.tolerated is not None:
        _scaled("diagnostics.tolerated", found.tolerated.start_box, found.tolerated.factor, plan.start_box, notes)


def _scaled(what: str, box: Sequence[float], factor: float, other: Sequence[float], notes: Notes) -> None:
    if any(abs(x - factor * y) > _SAME * max(abs(x), abs(factor * y)) for x, y in zip(box, other, strict=True)):
        notes.add(what, "its start errors are not the plan's by its factor")


def _sequence(visits: Sequence[Visit], plan: Plan, notes: Notes) -> None:
    what, segments = "diagnostics.sequence", plan.segments
    starts = [visit.change == "start" for visit in visits]
    if not visits or visits[0].segment != -1 or starts != [True, *[False] * (len(visits) - 1)]:
        notes.add(what, "does not begin at the start, once")
        return
    if any(a.segment > b.segment for a, b in pairwise(visits)) or visits[-1].segment >= len(segments):
        notes.add(what, "does not follow the segments")
        return
    ends = [k for k, s in enumerate(segments) if s.progress[1] == 1.0 and s.hybrid.felt]
    made = [visit.segment for visit in visits if visit.change == "made"]
    told = {visit.segment for visit in visits if visit.change in ("made", "unexplained")}
    if len(set(made)) != len(made) or not set(made) <= set(ends) <= told:
        notes.add(what, "does not tell of each contact that ends a move, and of these alone, that it is made")
    _places(visits, plan, notes)
    for before, visit in pairwise(visits):
        segment = segments[visit.segment]
        if visit.change == "made" and not set(visit.contacts) & (set(segment.goal_state) - set(segment.state)):
            notes.add(what, f"the state made by segment {visit.segment} has none of the contacts that it makes")
        if visit.change == "left" and (
            segment.progress[0] != 0.0 or set(visit.contacts) != set(before.contacts) - set(segment.leaving)
        ):
            notes.add(what, f"segment {visit.segment} does not leave what it is said to")


def _places(visits: Sequence[Visit], plan: Plan, notes: Notes) -> None:
    """That each segment runs near the critical point that last held a state before it, or near the first one."""
    held = [(visit.segment, visit.held_in[-1][0]) for visit in visits if visit.held_in]
    at, place = 0, 0
    for k, segment in enumerate(plan.segments):
        while at < len(held) and held[at][0] < k:
            place = held[at][1]
            at += 1
        if segment.critical_point != place:
            notes.add(f"segments[{k}].critical_point", f"is not {place}, which holds the state that it starts in")


def _graphs(found: Diagnostics, plan: Plan, notes: Notes) -> None:
    """That each state of the sequence is the one of its name in the graph of the critical point that holds it."""
    names = [point.name for point in plan.critical_points or ()]
    states: dict[str, set[tuple[str, frozenset[str]]]] = {}
    for graph in found.graphs:
        told = states.setdefault(graph.critical_point, set())
        told.update((state.id, frozenset(state.contacts)) for state in graph.states)
    if sorted(graph.critical_point for graph in found.graphs) != sorted(names):
        notes.add("diagnostics.graphs", "are not those of the critical points")
        return
    for visit in found.sequence:
        for at, state in visit.held_in:
            if at >= len(names):
                notes.add("diagnostics.sequence", f"names critical point {at} of {len(names)}")
                return
            if (state, frozenset(visit.contacts)) not in states[names[at]]:
                notes.add("diagnostics.sequence", f"state {state} near {names[at]} has other contacts")
                return
