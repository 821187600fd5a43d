"""What a plan tells besides its segments: nominal trajectory, position/force rows, critical poses, search, clearance.

Nothing of the certificate rests on these. They are judged all the same, as far as they must agree with each other and
with the segments, because people and controllers read them.

What a plan tells of how it was found, held against its segments: the contact states that the motion comes to.

The states themselves were found by enumeration, which nothing here repeats. But where a state begins, and how, follows
from the segments: a contact is made where the last piece of a move meets it, and left where the first piece of a move
gives it up; and a state is the same in the sequence as in the graph of the critical point that holds it.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Sequence
from itertools import pairwise

from fmopt.verify.arithmetic.rational import ArithmeticRefusal, doubles, logarithm, product, sub, transposed
from fmopt.verify.findings import CERTIFIED, Notes
from fmopt.verify.parts.reach import dot
from fmopt.verify.parts.rows import pose
from fmopt.verify.reading.diagnostics import Diagnostics, Interval, Search, Visit
from fmopt.verify.reading.document import CriticalPoint, Nominal, Plan, PositionForce, Segment
from fmopt.verify.reading.reader import NOT_COVERED, NOT_COVERED_OFF_FORM, Numbers

_SAME = 1e-12  # m, rad, s: stated twice, from one number
_FOLLOWS = 1e-9  # m, rad: interpolated again
_SEATED = 1e-6  # m, rad: walls of rounded numbers seat a part a little off the pose of its goal
_SIGNS = {1: -1.0, -1: 1.0, 2: 1.0}  # of the reaction, s = 2 standing for either sign

_SAME_WIDTH = 1e-9  # of a half-width


def check_outline(plan: Plan, notes: Notes) -> None:
    """Judges what stands beside the segments; what is absent is not judged.

    Args:
        plan: as it was read.
        notes: findings are added.
    """
    if plan.not_covered != (NOT_COVERED_OFF_FORM if plan.moving.form or plan.fixed.form else NOT_COVERED):
        notes.add("not_covered", "does not say what plans of this kind leave out")
    if plan.nominal is not None:
        _nominal(plan.nominal, plan, notes)
    if plan.critical_points is not None:
        _critical(plan.critical_points, plan, notes)
    if plan.search is not None:
        _search(plan.search, plan, notes)
    moving, fixed = plan.moving.measured_clearance, plan.fixed.measured_clearance
    if moving != fixed or not moving > 0.0:
        notes.add("measured_clearance", "must be positive and the same on both parts")


def _nominal(nominal: Nominal, plan: Plan, notes: Notes) -> None:
    nodes, times = nominal.nodes, nominal.times
    if len(nodes) != len(times) or times[0] != 0.0 or any(a >= b for a, b in pairwise(times)):
        notes.add("nominal", "its nodes need increasing times from zero")
        return
    # Walls that seat the part hold it off the axis, on which the nominal way ends: x and y are not compared.
    if _apart(nodes[-1][2:], plan.goal[2:]) > _SEATED:
        notes.add("nominal", "does not end at the goal's depth and orientation")
    _cover("nominal.intervals", nominal.intervals, times[-1], notes)
    if plan.position_force is not None:
        _cover("position_force", [row.interval for row in plan.position_force], times[-1], notes)
        for k, row in enumerate(plan.position_force):
            _row(f"position_force[{k}]", row, nominal, plan.specification.contact_force, notes)


def _cover(what: str, spans: Sequence[Interval], end: float, notes: Notes) -> None:
    joined = all(abs(a.end - b.start) <= _SAME for a, b in pairwise(spans))
    *before, last = spans
    # Without start errors the floor is touched at the very end, for an instant.
    forward = all(span.start < span.end for span in before) and last.start <= last.end
    if not joined or not forward or abs(spans[0].start) > _SAME or abs(last.end - end) > _SAME:
        notes.add(what, "do not cover the nominal time from its start to its end")


def _row(what: str, row: PositionForce, nominal: Nominal, most: float, notes: Notes) -> None:
    """One row of Pa(t) and Fa(t): Γ(S, P), Ω(S), and the S of the interval that it lies in."""
    s = row.interval.s
    middle = 0.5 * (row.interval.start + row.interval.end)
    at = bisect_left(nominal.intervals, middle, key=lambda span: span.end)
    # One that is an instant at the end has the next one's s as well as its own.
    if not any(s == span.s and span.start <= middle <= span.end for span in nominal.intervals[at : at + 2]):
        notes.add(what, "has another s than the nominal interval that it lies in")
    for t, end, pa, pn in (
        (row.interval.start, "start", row.pa_start, row.pn_start),
        (row.interval.end, "end", row.pa_end, row.pn_end),
    ):
        P = _at(t, nominal.nodes, nominal.times)
        if _apart(pa, [p if free == 0 else 0.0 for p, free in zip(P, s, strict=True)]) > _FOLLOWS:
            notes.add(f"{what}.pa_{end}", "is not the nominal pose on the free axes and zero on the others")
        if _apart(pn, [0.0 if free == 0 else p for p, free in zip(P, s, strict=True)]) > _FOLLOWS:
            notes.add(f"{what}.pn_{end}", "is not the nominal pose on the stopped axes and zero on the others")
    for axis, force in enumerate(row.fa):
        sign = _SIGNS.get(s[axis], 0.0)
        if (sign == 0.0) != (force == 0.0) or force * sign < 0.0 or (axis < 3 and abs(force) > most * (1.0 + 1e-9)):
            notes.add(f"{what}.fa", f"entry {axis} is not the reaction that s = {s[axis]} stands for")
    if any(x != -y for x, y in zip(row.applied, row.fa, strict=True)):
        notes.add(f"{what}.applied", "is not opposite to the reaction fa")
    if row.either_sign != tuple(axis for axis in range(6) if s[axis] == 2):
        notes.add(f"{what}.either_sign", "does not list the axes with s = 2")


def _at(t: float, nodes: Sequence[Numbers], times: Sequence[float]) -> list[float]:
    i = min(max(bisect_left(times, t), 1), len(times) - 1)
    share = (t - times[i - 1]) / (times[i] - times[i - 1])
    return [x + share * (y - x) for x, y in zip(nodes[i - 1], nodes[i], strict=True)]


def _critical(points: Sequence[CriticalPoint], plan: Plan, notes: Notes) -> None:
    for k, point in enumerate(points):
        if point.states_by_verdict["confirmed"] != point.states_confirmed:
            notes.add(f"critical_points[{k}].states_confirmed", "is not the number of states confirmed")
    for k, segment in enumerate(plan.segments):
        if segment.critical_point >= len(points):
            notes.add(f"segments[{k}].critical_point", f"is {segment.critical_point} of {len(points)}")


def _states(search: Search, notes: Notes) -> None:
    """The states that the search came to, where they are told, and the way through them."""
    states, way = search.states, search.way
    if not states and not way:
        return
    if sum(state.expanded for state in states) != search.states_expanded:
        notes.add("search.states", "does not mark as expanded as many states as were")
    origins = [states[at].origin for at in way]
    if not way or origins != [None, *way[:-1]]:
        notes.add("search.way", "does not go from a way to begin on, each state come to from the one before")
    elif sum(len(states[at].moves) for at in way) != len(search.moves):
        notes.add("search.way", "does not have as many moves as the sequence")
    if any(state.origin is not None and not states[state.origin].expanded for state in states):
        notes.add("search.states", "has a state come to from one that was not expanded")


def _search(search: Search, plan: Plan, notes: Notes) -> None:
    cost, bound = search.cost, search.lower_bound
    if bound > cost or abs(cost - bound - search.gap) > _SAME * max(cost, 1.0):
        notes.add("search", "its gap is not the difference of cost and lower bound, or the bound exceeds the cost")
    _states(search, notes)
    moves: dict[int, list[Segment]] = {}
    for segment in plan.segments:
        moves.setdefault(segment.move, []).append(segment)
    if sorted(moves) != list(range(len(search.moves))):
        notes.add("search.moves", "does not name each move of the segments once")
        return
    for move, name in enumerate(search.moves):
        try:
            # A word such as "approach" names no axis to hold the motion against.
            agrees = name[0] not in "+-" or _along(name, search.heading, moves[move])
        except ArithmeticRefusal as error:
            notes.add(f"search.moves[{move}]", str(error))
            return
        if not agrees:
            notes.add(f"search.moves[{move}]", f"does not go along or about {name}, its axes turned by the heading")


def _along(name: str, heading: float, pieces: Sequence[Segment]) -> bool:
    """Whether a move goes mostly along an axis, or turns mostly about it, in the direction of its sign."""
    way = [0.0] * 3
    for piece in pieces:
        start, goal = pose(piece.start), pose(piece.goal)
        step = logarithm(product(goal.R, transposed(start.R))) if name[1] == "r" else sub(goal.p, start.p)
        way = [x + y for x, y in zip(way, doubles(step), strict=True)]
    c, s = math.cos(heading), math.sin(heading)
    axis = {"x": (c, s, 0.0), "y": (-s, c, 0.0), "z": (0.0, 0.0, 1.0)}[name[-1]]
    return dot(way, axis) * (1.0 if name[0] == "+" else -1.0) > 0.5 * math.hypot(*way)  # within 60°


def _apart(a: Sequence[float], b: Sequence[float]) -> float:
    return max(abs(x - y) if math.isfinite(x) else math.inf for x, y in zip(a, b, strict=True))


def check_diagnostics(plan: Plan, notes: Notes) -> None:
    """Judges what of the diagnostics must agree with the rest of a plan; a plan without any is not judged.

    Args:
        plan, notes: as for `check_outline`.
    """
    found = plan.diagnostics
    if found is None:
        return
    if plan.critical_points is None and not (found.sequence or found.graphs):
        if not found.notes:
            notes.add("diagnostics.notes", "do not say why its way through contact states is left out")
    else:
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
    if any(abs(x - factor * y) > _SAME_WIDTH * max(abs(x), abs(factor * y)) for x, y in zip(box, other, strict=True)):
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
    # Moves that end by their travel are not felt to end, and make no contact.
    ends = [k for k, s in enumerate(segments) if s.progress[1] == 1.0 and s.hybrid.felt]
    made = [visit.segment for visit in visits if visit.change == "made"]
    # A contact made is told as unexplained where no critical point holds the states before and after it.
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
