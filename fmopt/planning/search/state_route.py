"""The shortest route through the states of a contact graph, for parts without errors in the linear picture.

States follow each other along the edges of the graph, so that contacts are made or given up by one freedom at a time.
Each change counts as some travel, and on the way parts stay off the contacts that a state has not: its poses are those
of its facet drawn together around its point. What no route can be shorter than is what any motion through these states
has to travel at least. [DakinPopplestone1993] section 3 searches the same graph.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from fmopt.contact.state_graph import ContactGraph, ContactState, vertices
from fmopt.errors import InfeasibleError
from fmopt.planning.optimise.convex_route import ConvexSets, Route, shortest_route
from fmopt.spatial.values import frozen

_REACH = 10.0  # clearances: how far a facet without end counts beyond its vertices


@dataclass(frozen=True, eq=False)
class StateRoute(Route):
    """A route through contact states, its stops their indices; costs in clearances, a turn by clearance / ρ being one.

    Attributes:
        points: (k, 6), a pose in each state, in local coordinates X, m and rad.
        states: in order.
    """

    states: tuple[ContactState, ...]


def state_route(
    graph: ContactGraph,
    start: Collection[str],
    goal: Collection[str],
    room: float = 0.5,
    change: float = 1.0,
    gap: float = 0.03,
) -> StateRoute:
    """The shortest of the routes tried from one state to another, with a bound on all.

    Args:
        start: ids of the contacts of the state in which it begins; none for free space.
        room: how far the poses of a state stay inside of it: 0 for all of its facet, 1 for its point alone.

    Raises:
        ValueError: room or gap is no share, or a change counts less than nothing.
        InfeasibleError: there is no such state.
    """
    if not 0.0 <= room <= 1.0:
        raise ValueError(f"room is a share from 0 to 1, not {room}")
    first, last = (_index(graph, contacts) for contacts in (start, goal))
    corners, on, endless = vertices(graph.space)
    names = [contact.id for contact in graph.space.contacts]
    sets = []
    for state in graph.states:
        held = on[:, np.isin(names, state.contacts)].all(axis=1)
        ends = corners[held & ~endless]
        # What has no end is a unit direction, in which the facet goes on from its middle.
        facet = np.concatenate([ends, ends.mean(axis=0) + _REACH * corners[held & endless]])
        middle = state.point / graph.space.scale
        sets.append(middle + (1.0 - room) * (facet - middle))
    made = [(i, j) for i, sons in enumerate(graph.sons) for j in sons]
    arcs = [*made, *((j, i) for i, j in made)]
    found = shortest_route(ConvexSets.of(sets, arcs, change), first, last, gap)
    states = tuple(graph.states[i] for i in found.stops)
    points = frozen(graph.space.scale * found.points)
    return StateRoute(found.stops, points, found.cost, found.lower_bound, states)


def _index(graph: ContactGraph, contacts: Collection[str]) -> int:
    found = graph.index(frozenset(contacts))
    if found is None:
        raise InfeasibleError(
            f"no state of the graph has just the contacts {', '.join(sorted(contacts)) or '(none)'}",
            advice="choose one of its `states`",
        )
    return found
