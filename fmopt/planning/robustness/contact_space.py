"""Local contact spaces: around the critical poses of the nominal path, and where a motion makes its contacts.

Each holds the contacts near its pose, their states in the linear picture, and what the true surfaces say of these.

Contact states of the linear picture confirmed on the true C-surfaces, or refuted with what stands against them.

The linear picture bends: a state may lie elsewhere than its linear facet, or nowhere. Each state is searched for from
many starts, its own facet first, then half way to its neighbours and from poses where those were found. A state is
confirmed by a pose. Refuted means that none of the starts led to one, and says what was in the way at the best of them.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property
from itertools import chain

import numpy as np

from fmopt.certificate.assembly import Assembly
from fmopt.contact.facet_bounds import INSIDE, BoundTable, cell, touching
from fmopt.contact.polytope import PolytopeFaces
from fmopt.contact.primitive import PrimitiveContact, near_contacts
from fmopt.contact.realisation import Measures, Met, Neighbourhood, Poses, meet, project
from fmopt.contact.state_graph import ContactCell, ContactGraph, LocalSpace, Scale, contact_graph, faces, local_space
from fmopt.errors import SolverError
from fmopt.geometry.polyhedron import Polyhedron
from fmopt.papers.lee_huang.nominal_trajectory import CriticalPose
from fmopt.plan.description import CriticalPoint
from fmopt.plan.diagnostics import Graph, State
from fmopt.plan.field_types import numbers
from fmopt.runtime.clock import heed
from fmopt.spatial.se3 import Pose
from fmopt.spatial.values import Array, Bits, Indices, Value

_STEP = 1e-3  # m; off the plane in which a face ends: there the part has just entered, or is about to leave
_WIDE = 10.0  # how much farther than its contacts are looked for a space at a critical pose reaches
_CONTACTS = 40  # near a pose; states of more are not enumerated: their number grows like a power of that of contacts
_STATES = 1000  # in one space, which are confirmed one by one; of more only free space is told
_MANY = 300  # states that are written into a plan for one space; of more, those near the motion

RESIDUAL = 1e-10  # clearances; a contact this close to touching touches
APART = 1e-3  # clearances; a contact further than this is apart
_ROOMS = (0.1, 0.01)  # clearances of room that are asked for, first and then
_NEIGHBOURS = 2  # how many neighbours of either dimension a state is searched from
_ROUNDS = 3  # of further starts: a neighbour found in one leads on in the next
_OUTSIDE = -1e-6  # scaled units


@dataclass(frozen=True, eq=False)
class Space:
    """A local contact space: its name, the pose (6,) that it belongs to, its states, and what was found of each.

    Where there are too many contacts or states, or they lie awkwardly, states are not `enumerated`: only free space is.
    """

    name: str
    pose: Array
    graph: ContactGraph
    found: "tuple[Confirmation, ...]"
    enumerated: bool

    def state(self, contacts: frozenset[str]) -> int | None:
        """The confirmed state with exactly these contacts, None without."""
        index = self._places.get(contacts)
        return index if index is not None and self.found[index].verdict is StateAdvice.CONFIRMED else None

    @cached_property
    def _places(self) -> dict[frozenset[str], int]:
        """The states by their contacts."""
        return {frozenset(state.contacts): i for i, state in enumerate(self.graph.states)}

    def near(self, pose: Pose, scale: Scale) -> bool:
        """Whether a pose is as near as contacts are to the space's own pose, or to where it was linearised."""
        apart = [np.abs(own.local(pose)) for own in (Pose.from_vector(self.pose), self.graph.space.pose)]
        return any(x[:3].max() <= scale.reach and x[3:].max() <= scale.angle for x in apart)

    def critical_point(self) -> CriticalPoint:
        """The plan's entry among `critical_points`."""
        verdicts = [confirmation.verdict for confirmation in self.found]
        return CriticalPoint(
            name=self.name,
            pose=numbers(self.pose),
            contacts=tuple(c.id for c in self.graph.space.contacts),
            enumerated=self.enumerated,
            states_by_dimension={str(d): n for d, n in sorted(self.graph.count().items())},
            states_by_verdict={verdict.name.lower(): verdicts.count(verdict) for verdict in StateAdvice},
        )

    def graph_near(self, chosen: Sequence[int]) -> Graph:
        """The plan's entry among `graphs`, with states that a motion goes through; large graphs only near those."""
        graph = self.graph
        kept = _near(graph, chosen)
        place = {state: i for i, state in enumerate(kept)}
        return Graph(
            critical_point=self.name,
            states=tuple(State(s.id, tuple(sorted(s.contacts)), s.dimension) for s in (graph.states[i] for i in kept)),
            sons=tuple(tuple(place[j] for j in graph.sons[i] if j in place) for i in kept),
            verdicts=tuple(self.found[i].verdict.name.lower() for i in kept),
            chosen=tuple(place[i] for i in chosen),
        )


def _near(graph: ContactGraph, chosen: Sequence[int]) -> list[int]:
    """All states, or of many the chosen ones and rings of neighbours around them as long as there are not too many."""
    if len(graph.states) <= _MANY:
        return list(range(len(graph.states)))
    kept = set(chosen)
    while True:
        wider = kept | {j for i in kept for j in chain(graph.sons[i], graph.fathers[i])}
        if len(wider) > _MANY or wider == kept:
            return sorted(kept)
        kept = wider


def contact_spaces(assembly: Assembly, critical: Sequence[CriticalPose], scale: Scale) -> tuple[Space, ...]:
    """The contact spaces around the critical poses of the nominal path."""
    down, up = (0.0, 0.0, -_STEP, 0.0, 0.0, 0.0), (0.0, 0.0, _STEP, 0.0, 0.0, 0.0)
    found = []
    for at in critical:
        pose = Pose.from_vector(at.pose)
        aside = [pose.moved(up)] if at is critical[-1] else [pose.moved(down), pose.moved(up)]
        found.append(space_at(assembly, at.name, pose, aside, scale, _WIDE))
    return tuple(found)


def space_at(
    assembly: Assembly, name: str, pose: Pose, aside: Sequence[Pose], scale: Scale, wide: float = 1.0
) -> Space:
    """Enumerates and confirms the contact states around a pose; of very many contacts or states, only free space.

    Where a contact could begin or end at the very pose, there is no telling which contacts count: then the space is
    that of the first pose aside of which this is not so.
    """
    body, fixed = assembly.moving.polyhedron, assembly.fixed.polyhedron
    for reference in (pose, *aside):
        near = near_contacts(body, fixed, reference, scale.reach, scale.angle)
        if _regular(assembly, near, reference):
            break
    heed()
    kept, limits = cell(near, body, fixed, reference, scale.reach + scale.angle * scale.rho)
    space = local_space(
        kept, body, fixed, reference, scale, ContactCell(limits, wide * scale.reach, wide * scale.angle)
    )
    states = _enumerated(space)
    # Free space is the only face that is told of a space whose states are not enumerated.
    free = PolytopeFaces(np.zeros((1, len(kept)), dtype=np.bool_), np.full(1, 6), np.zeros((1, 6)), 0)
    graph = contact_graph(space, free if states is None else states)
    return Space(name, pose.vector(), graph, confirm(graph, body, fixed), states is not None)


def _enumerated(space: LocalSpace) -> PolytopeFaces | None:
    """All faces of a space; None where there are too many of them or of contacts, or Qhull cannot tell them apart."""
    if len(space.contacts) > _CONTACTS:
        return None
    try:
        found = faces(space)
    except SolverError:
        return None
    return found if len(found.points) <= _STATES else None


def _regular(assembly: Assembly, near: Sequence[PrimitiveContact], pose: Pose) -> bool:
    """Whether each contact near a pose either counts there or does not.

    A contact is in doubt on the end of its face or edge, unless it is out of another bound, or what ends it is a
    contact that touches and would have to be violated.
    """
    body, fixed = assembly.moving.polyhedron, assembly.fixed.polyhedron
    table = BoundTable.of(near, body, fixed, pose)
    depths, which = table.depths(table.surfaces.values(pose))
    held = {contact.id for contact in touching(near, body, fixed, pose)}
    for i in range(len(near)):
        ends = [table.listed[b] for b in which[i][np.abs(depths[i]) <= INSIDE]]
        out = bool((depths[i] < -INSIDE).any()) or any(b.sign > 0 and b.contact.id in held for b in ends)
        if ends and not out:
            return False
    return True


class StateAdvice(StrEnum):
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
    """A state on the true surfaces."""

    state: str
    verdict: StateAdvice
    pose: Pose
    residual: float  # largest |f| of its contacts there, m; of a split one, in the middle of its linear facet
    clearance: float  # least f of the other contacts within their bounds, m; inf when there are none
    inside: float  # how far the pose is inside the bounds of its contacts, m; inf when there are none
    against: str  # id of the contact, or of the neighbour across a bound, that stands against the state; "" without


def confirm(graph: ContactGraph, moving: Polyhedron, fixed: Polyhedron) -> tuple[Confirmation, ...]:
    """Every state of the graph taken to its true C-surfaces."""
    near = Neighbourhood.of(graph.space, moving, fixed)
    on = _contacts(graph)
    points = np.array([state.point for state in graph.states])
    facets = Poses.around(graph.space.pose, points)
    best = _Best.of(near, on, meet(near, on, facets, _ROOMS[0]))
    tried = set[tuple[int, bytes]]()
    for _ in range(_ROUNDS):
        heed()
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
    def of(near: Neighbourhood, on: Bits, met: Met) -> "_Best":
        at = near.measured(on, met.poses)
        inside = at.limits.min(axis=1, initial=np.inf) > _OUTSIDE
        found = (at.residual <= RESIDUAL) & (at.slack > APART) & inside
        return _Best(found, met.poses, np.where(found, -1.0, met.short), met.settled)  # nothing beats what was found

    def improved(self, near: Neighbourhood, on: Bits, which: Indices, met: Met) -> "_Best":
        """With further searches for states `which` (m,), several for each."""
        new = _Best.of(near, on[which], met)
        # By states, and within each by what is short: the first of each is its best.
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
    graph: ContactGraph, best: _Best, points: Array, left: Indices, tried: set[tuple[int, bytes]]
) -> tuple[Indices, Poses]:
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
        verdict, by, pose, residual = against.get(i, (StateAdvice.CONFIRMED, "", poses[i], residuals[i]))
        found.append(Confirmation(state.id, verdict, pose, unit * residual, clearances[i], insides[i], by))
    return tuple(found)


def _refuted(
    graph: ContactGraph, near: Neighbourhood, on: Bits, best: _Best, facets: Poses
) -> dict[int, tuple[StateAdvice, str, Pose, float]]:
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
            found[i] = StateAdvice.SPLIT, by, middles[n], float(half.residual[n])
        else:
            verdict, by = _least(near, at, n) if best.settled[i] else (StateAdvice.UNDECIDED, "")
            found[i] = verdict, by, best.poses.pose(i), float(at.residual[n])
    return found


def _least(near: Neighbourhood, at: Measures, i: int) -> tuple[StateAdvice, str]:
    """What has least room at a pose: another contact, the bound of an own one, or the limits of the local space."""
    if at.limits[i].min(initial=np.inf) < at.slack[i]:
        return StateAdvice.UNDECIDED, ""
    if at.clearance[i] <= at.inside[i]:
        return StateAdvice.BLOCKED, near.space.contacts[int(np.argmin(at.others[i]))].id
    where = np.unravel_index(int(np.argmin(at.depths[i])), at.depths[i].shape)
    return StateAdvice.OUT_OF_BOUNDS, near.table.listed[int(at.binding[i][where])].contact.id
