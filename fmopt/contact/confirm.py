"""Contact states of the linear picture confirmed on the true C-surfaces, or refuted with what stands against them.

The linear picture bends: a state may lie elsewhere than its linear facet, or nowhere. Each state is searched for from
many starts, its own facet first, then half way to its neighbours and from poses where those were found. A state is
confirmed by a pose. Refuted means that none of the starts led to one, and says what was in the way at the best of them.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from fmopt.contact.descent import Bits
from fmopt.contact.graph import ContactGraph
from fmopt.contact.meet import Measures, Met, Neighbourhood, Poses, meet, project
from fmopt.geometry.polyhedron import Polyhedron
from fmopt.se3 import Pose
from fmopt.values import Array, Value

RESIDUAL = 1e-10  # clearances; a contact this close to touching touches
APART = 1e-3  # clearances; a contact further than this is apart
_ROOMS = (0.1, 0.01)  # clearances of room that are asked for, first and then
_NEIGHBOURS = 2  # how many neighbours of either dimension a state is searched from
_ROUNDS = 3
_OUTSIDE = -1e-6  # scaled units


class Verdict(StrEnum):
    """What the true surfaces say of a state; the value is the advice."""

    CONFIRMED = "the state exists: its contacts touch, the others are apart, all within bounds"
    SPLIT = (
        "the curvature of its surfaces parts them: they meet nowhere near here, or only where another one touches too"
    )
    BLOCKED = "where its contacts meet, another one is violated"
    OUT_OF_BOUNDS = "its contacts meet beyond the end of a face or an edge only"
    UNDECIDED = "no pose was found near here, and nothing that stands against one; linearise at a nearer pose"


@dataclass(frozen=True, eq=False)
class Confirmation(Value):
    """A state on the true surfaces.

    Attributes:
        state: id of the state.
        verdict: whether it exists.
        pose: the pose found, or the best one.
        residual: largest |f| of its contacts there, m; of a split one, in the middle of its linear facet.
        clearance: least f of the other contacts within their bounds, m; inf when there are none.
        inside: how far the pose is inside the bounds of its contacts, m; inf when there are none.
        against: id of the contact, or of the neighbour across a bound, that stands against the state; "" without.
    """

    state: str
    verdict: Verdict
    pose: Pose
    residual: float
    clearance: float
    inside: float
    against: str


def confirm(graph: ContactGraph, moving: Polyhedron, fixed: Polyhedron) -> tuple[Confirmation, ...]:
    """Every state of the graph taken to its true C-surfaces.

    Args:
        graph: contact states with a point on each linear facet.
        moving: the moving part in its body frame.
        fixed: the fixed part.
    """
    near = Neighbourhood.of(graph.space, moving, fixed)
    on = _contacts(graph)
    points = np.array([state.point for state in graph.states])
    facets = Poses.around(graph.space.pose, points)
    best = _Best.of(near, on, meet(near, on, facets, _ROOMS[0]))
    tried = set[tuple[int, bytes]]()
    for _ in range(_ROUNDS):
        left = np.flatnonzero(~best.found)
        which, starts = _starts(graph, best, points, left, tried)
        before = int(best.found.sum())
        if len(which):
            best = best.improved(near, on, which, meet(near, on[which], starts, _ROOMS[1]))
        if int(best.found.sum()) == before:
            break
    return _verdicts(graph, near, on, best, facets)


def _contacts(graph: ContactGraph) -> Bits:
    """Which contacts of the space (k) each state (n) has: (n, k)."""
    number = {contact.id: i for i, contact in enumerate(graph.space.contacts)}
    on = np.zeros((len(graph.states), len(number)), dtype=np.bool_)
    states = np.repeat(np.arange(len(on)), [len(state.contacts) for state in graph.states])
    on[states, [number[c] for state in graph.states for c in state.contacts]] = True
    return on


@dataclass(frozen=True, eq=False)
class _Best:
    """The best search so far for each of n states: whether it found the state, where, how much is short, if final."""

    found: Bits
    poses: Poses
    short: Array
    settled: Bits

    @staticmethod
    def of(near: Neighbourhood, on: Bits, met: Met) -> _Best:
        at = near.measured(on, met.poses)
        inside = at.limits.min(axis=1, initial=np.inf) > _OUTSIDE
        found = (at.residual <= RESIDUAL) & (at.slack > APART) & inside
        return _Best(found, met.poses, np.where(found, -1.0, met.short), met.settled)

    def improved(self, near: Neighbourhood, on: Bits, which: NDArray[np.intp], met: Met) -> _Best:
        """With further searches for states `which` (m,), several for each."""
        new = _Best.of(near, on[which], met)
        order = np.lexsort((new.short, which))
        first = order[np.unique(which[order], return_index=True)[1]]
        first = first[new.short[first] < self.short[which[first]]]
        found, short, settled = self.found.copy(), self.short.copy(), self.settled.copy()
        p, R = self.poses.p.copy(), self.poses.R.copy()
        states = which[first]
        found[states], short[states], settled[states] = new.found[first], new.short[first], new.settled[first]
        p[states], R[states] = new.poses.p[first], new.poses.R[first]
        return _Best(found, Poses(p, R), short, settled)


def _starts(
    graph: ContactGraph, best: _Best, points: Array, left: NDArray[np.intp], tried: set[tuple[int, bytes]]
) -> tuple[NDArray[np.intp], Poses]:
    """Further starts for states: their own point, half way to neighbours, and where neighbours were found.

    None of those tried before; these are added to them.
    """
    which: list[int] = []
    starts: list[Array] = []
    there = best.poses.local(graph.space.pose)
    for i in left:
        found = [points[i]]
        for around in (graph.sons[i], graph.fathers[i]):
            found += [0.5 * (points[i] + points[j]) for j in around[:_NEIGHBOURS]]
            found += [there[j] for j in around if best.found[j]][:_NEIGHBOURS]
        new = [point for point in found if (int(i), point.tobytes()) not in tried]
        tried.update((int(i), point.tobytes()) for point in new)
        which += [int(i)] * len(new)
        starts += new
    return np.array(which, dtype=np.intp), Poses.around(graph.space.pose, np.reshape(starts, (-1, 6)))


def _verdicts(
    graph: ContactGraph, near: Neighbourhood, on: Bits, best: _Best, facets: Poses
) -> tuple[Confirmation, ...]:
    unit, at = float(near.space.scale[0]), near.measured(on, best.poses)
    poses, residuals = best.poses.each(), at.residual.tolist()
    clearances, insides = (unit * at.clearance).tolist(), (unit * at.inside).tolist()
    against = _refuted(graph, near, on, best, facets)
    found = []
    for i, state in enumerate(graph.states):
        verdict, by, pose, residual = against.get(i, (Verdict.CONFIRMED, "", poses[i], residuals[i]))
        found.append(Confirmation(state.id, verdict, pose, unit * residual, clearances[i], insides[i], by))
    return tuple(found)


def _refuted(
    graph: ContactGraph, near: Neighbourhood, on: Bits, best: _Best, facets: Poses
) -> dict[int, tuple[Verdict, str, Pose, float]]:
    """For each state that was not found: the verdict, what stands against it, the pose to look at, and |f| there.

    A state is split when its contacts do not meet in the middle of its linear facet, short of leaving it: what joins
    them, when they are drawn together with no room asked for anything else, stands against it.
    """
    left = np.flatnonzero(~best.found)
    own, start = on[left], facets.kept(left)
    middle = project(near, own, start, 6 - np.array([graph.states[i].dimension for i in left], dtype=np.intp))
    joined = meet(near, own, start, 0.0)
    half, meeting, at = (near.measured(own, poses) for poses in (middle, joined.poses, best.poses.kept(left)))
    middles, found = middle.each(), {}
    for n, i in enumerate(left.tolist()):
        if half.residual[n] > RESIDUAL:
            by = _least(near, meeting, n)[1] if meeting.residual[n] <= RESIDUAL else ""
            found[i] = Verdict.SPLIT, by, middles[n], float(half.residual[n])
        else:
            verdict, by = _least(near, at, n) if best.settled[i] else (Verdict.UNDECIDED, "")
            found[i] = verdict, by, best.poses.pose(i), float(at.residual[n])
    return found


def _least(near: Neighbourhood, at: Measures, i: int) -> tuple[Verdict, str]:
    """What has least room at a pose: another contact, the bound of an own one, or the limits of the local space."""
    if at.limits[i].min(initial=np.inf) < at.slack[i]:
        return Verdict.UNDECIDED, ""
    if at.clearance[i] <= at.inside[i]:
        return Verdict.BLOCKED, near.space.contacts[int(np.argmin(at.others[i]))].id
    where = np.unravel_index(int(np.argmin(at.depths[i])), at.depths[i].shape)
    return Verdict.OUT_OF_BOUNDS, near.table.listed[int(at.binding[i][where])].contact.id
