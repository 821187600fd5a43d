"""What a plan tells besides its segments: nominal trajectory, position/force rows, critical poses, search, clearance.

Nothing of the certificate rests on these. They are judged all the same, as far as they must agree with each other and
with the segments, because people and controllers read them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

from fmopt.verify.document import NOT_COVERED, Numbers, Plan
from fmopt.verify.findings import Notes
from fmopt.verify.reader import Reader

_SAME = 1e-12  # m, rad, s: stated twice, from one number
_SEATED = 1e-6  # m, rad: walls of rounded numbers seat a part a little off the pose of its goal
_SIGNS = {1: -1.0, -1: 1.0, 2: 1.0}  # of the reaction, s = 2 standing for either sign


def check_outline(document: Any, plan: Plan, notes: Notes) -> None:
    """Judges what stands beside the segments; what is absent is not judged.

    Raises:
        PlanError: something has the wrong form.
    """
    top = Reader(document)
    if plan.not_covered != NOT_COVERED:
        notes.add("not_covered", "does not say what plans of this kind leave out")
    if top.has("nominal"):
        _nominal(top, plan, notes)
    if top.has("critical_points"):
        _critical(top.at("critical_points"), plan, notes)
    if top.has("search"):
        _search(top.at("search"), notes)
    parts = top.at("parts")
    if any(parts.at(name).has("measured_clearance") for name in ("moving", "fixed")):
        _clearance(parts, notes)


def _nominal(top: Reader, plan: Plan, notes: Notes) -> None:
    place = top.at("nominal").only(("nodes", "times", "intervals"))
    nodes = place.at("nodes").matrix(None)
    times = [item.number(0.0) for item in place.at("times").items(2)]
    if len(nodes) != len(times) or times[0] != 0.0 or any(a >= b for a, b in pairwise(times)):
        notes.add("nominal", "its nodes need increasing times from zero")
        return
    if _apart(nodes[-1][2:], plan.goal[2:]) > _SEATED:
        notes.add("nominal", "does not end at the goal's depth and orientation")
    spans = [_span(item) for item in place.at("intervals").items(1)]
    _cover("nominal.intervals", spans, times[-1], notes)
    if top.has("position_force"):
        rows = top.at("position_force").items(1)
        _cover("position_force", [_span(row) for row in rows], times[-1], notes)
        for k, row in enumerate(rows):
            _row(k, row, spans, nodes, times, plan.specification.contact_force, notes)


def _span(place: Reader) -> tuple[float, float, tuple[int, ...]]:
    s = tuple(int(item.number(-1.0, 2.0)) for item in place.at("s").items(exact=6))
    return place.at("t0").number(0.0), place.at("t1").number(0.0), s


def _cover(what: str, spans: Sequence[tuple[float, float, tuple[int, ...]]], end: float, notes: Notes) -> None:
    joined = all(abs(a[1] - b[0]) <= _SAME for a, b in pairwise(spans))
    *before, last = spans
    # Without start errors the floor is touched at the very end, for an instant.
    forward = all(a < b for a, b, _ in before) and last[0] <= last[1]
    if not joined or not forward or abs(spans[0][0]) > _SAME or abs(last[1] - end) > _SAME:
        notes.add(what, "do not cover the nominal time from its start to its end")


def _row(
    k: int,
    place: Reader,
    spans: Sequence[tuple[float, float, tuple[int, ...]]],
    nodes: Sequence[Numbers],
    times: Sequence[float],
    most: float,
    notes: Notes,
) -> None:
    """One row of Pa(t) and Fa(t): Γ(S, P), Ω(S), and the S of the interval that it lies in."""
    t0, t1, s = _span(place)
    what = f"position_force[{k}]"
    middle = 0.5 * (t0 + t1)
    if not any(a <= middle <= b and s == other for a, b, other in spans):
        notes.add(what, "has another s than the nominal interval that it lies in")
    for t, key in ((t0, "pa_start"), (t1, "pa_end")):
        wanted = [p if free == 0 else 0.0 for p, free in zip(_at(t, nodes, times), s, strict=True)]
        if _apart(place.at(key).numbers(6), wanted) > 1e-9:
            notes.add(f"{what}.{key}", "is not the nominal pose on the free axes and zero on the others")
    for axis, force in enumerate(place.at("fa").numbers(6)):
        sign = _SIGNS.get(s[axis], 0.0)
        if (sign == 0.0) != (force == 0.0) or force * sign < 0.0 or (axis < 3 and abs(force) > most * (1.0 + 1e-9)):
            notes.add(f"{what}.fa", f"entry {axis} is not the reaction that s = {s[axis]} stands for")
    place.at("fa_sign").text(("reaction",))
    either = tuple(item.integer(6) for item in place.at("either_sign").items())
    if either != tuple(axis for axis in range(6) if s[axis] == 2):
        notes.add(f"{what}.either_sign", "does not list the axes with s = 2")


def _at(t: float, nodes: Sequence[Numbers], times: Sequence[float]) -> list[float]:
    for (a, b), (p, q) in zip(pairwise(times), pairwise(nodes), strict=True):
        if t <= b or b == times[-1]:
            share = (t - a) / (b - a)
            return [x + share * (y - x) for x, y in zip(p, q, strict=True)]
    raise AssertionError


def _critical(place: Reader, plan: Plan, notes: Notes) -> None:
    points = place.items()
    for item in points:
        item.at("pose").numbers(6)
        for name in item.at("pcs").items():
            name.text()
        counts = item.at("states_by_dimension").value
        if not isinstance(counts, dict) or not all(
            isinstance(n, int) and n >= 0 and key.isdigit() and int(key) <= 6 for key, n in counts.items()
        ):
            raise item.at("states_by_dimension").fail("must count states by dimension")
    for k, segment in enumerate(plan.segments):
        if segment.critical_point >= len(points):
            notes.add(f"segments[{k}].critical_point", f"is {segment.critical_point} of {len(points)}")


def _search(place: Reader, notes: Notes) -> None:
    cost, bound, gap = (place.at(key).number() for key in ("cost", "lower_bound", "gap"))
    place.at("states_expanded").integer()
    place.at("objective").text()
    if bound > cost or abs(cost - bound - gap) > _SAME * max(cost, 1.0):
        notes.add("search", "its gap is not the difference of cost and lower bound, or the bound exceeds the cost")


def _clearance(place: Reader, notes: Notes) -> None:
    stated = [place.at(name).at("measured_clearance").number() for name in ("moving", "fixed")]
    for name in ("moving", "fixed"):
        for item in place.at(name).at("declared_clearance").items():
            item.number(0.0)
    if stated[0] != stated[1] or not stated[0] > 0.0:
        notes.add("measured_clearance", "must be positive and the same on both parts")


def _apart(a: Sequence[float], b: Sequence[float]) -> float:
    return max(abs(x - y) if math.isfinite(x) else math.inf for x, y in zip(a, b, strict=True))
