"""The contact-state graph of a local contact space. [DakinPopplestone1993] sections 2 and 3."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import Any, TypeVar

import numpy as np

from fmopt.contact.lattice import Numbers, covers, held
from fmopt.contact.polytope import Faces
from fmopt.contact.space import LocalSpace
from fmopt.values import Array, Value, frozen

Item = TypeVar("Item")


@dataclass(frozen=True, eq=False)
class ContactState(Value):
    """The contacts that are active together on one facet, merged.

    Attributes:
        id: name within the graph, "free" for free space.
        contacts: ids of the active contacts.
        dimension: of the facet, 6 − rank.
        point: (6,), local coordinates X in m and rad of a point in its relative interior.
    """

    id: str
    contacts: tuple[str, ...]
    dimension: int
    point: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "point", frozen(self.point, 6, name="point"))

    @staticmethod
    def all_of(
        ids: Sequence[str], contacts: Sequence[tuple[str, ...]], dimensions: Sequence[int], points: Array
    ) -> tuple[ContactState, ...]:
        """Many states with their points (n, 6), which are checked and frozen together: a tenth of the time."""
        found = []
        for name, touching, dimension, point in zip(
            ids, contacts, dimensions, frozen(points, len(ids), 6), strict=True
        ):
            state = object.__new__(ContactState)
            own = state.__dict__
            own["id"], own["contacts"], own["dimension"], own["point"] = name, touching, dimension, point
            found.append(state)
        return tuple(found)


@dataclass(frozen=True, eq=False)
class ContactGraph(Value):
    """Contact states, largest dimension first, and for each the adjacent ones of lower and of higher dimension.

    Attributes:
        space: the local contact space.
        states: the states.
        sons: for each state the indices of the states on the boundary of its facet, one dimension lower.
        fathers: for each state the indices of the states whose facets it bounds, one dimension higher.
    """

    space: LocalSpace
    states: tuple[ContactState, ...]
    sons: tuple[tuple[int, ...], ...]
    fathers: tuple[tuple[int, ...], ...]

    def index(self, contacts: frozenset[str]) -> int | None:
        """The state with exactly these active contacts, if there is one."""
        return next((i for i, state in enumerate(self.states) if frozenset(state.contacts) == contacts), None)

    def obstacles(self, state: int, goal: int, start: int | None = None) -> tuple[str, ...]:
        """Contacts a segment in `state` that comes from `start` and ends in `goal` has to stay clear of.

        The contacts of the state's sons, minus those of the state, its goal and its start.
        """
        own = {c for i in (state, goal, start) if i is not None for c in self.states[i].contacts}
        near = {c for son in self.sons[state] for c in self.states[son].contacts}
        return tuple(contact.id for contact in self.space.contacts if contact.id in near - own)

    def count(self) -> dict[int, int]:
        """Number of states by dimension."""
        dimensions = [state.dimension for state in self.states]
        return {d: dimensions.count(d) for d in sorted(set(dimensions))}

    def network(self) -> Any:
        """The graph as a networkx digraph from fathers to sons, nodes by state id."""
        import networkx

        graph = networkx.DiGraph()
        for state in self.states:
            graph.add_node(state.id, contacts=state.contacts, dimension=state.dimension)
        for i, sons in enumerate(self.sons):
            graph.add_edges_from((self.states[i].id, self.states[j].id) for j in sons)
        return graph


def contact_graph(space: LocalSpace, faces: Faces) -> ContactGraph:
    """The contact-state graph of a local space and its faces."""
    n, names = len(faces.points), np.array([contact.id for contact in space.contacts], dtype=np.object_)
    ends, rows = held(faces.active)
    contacts = _cut(names[rows].tolist(), ends)
    ids = _ids(n) if contacts[0] else ("free", *_ids(n)[1:])
    states = ContactState.all_of(ids, contacts, faces.dimensions.tolist(), space.scale * faces.points)
    sons, son, fathers, father = covers(faces.active, faces.dimensions)
    return ContactGraph(space, states, _cut(son.tolist(), sons), _cut(father.tolist(), fathers))


@lru_cache
def _ids(n: int) -> tuple[str, ...]:
    """Names of as many states."""
    return tuple(f"s{i}" for i in range(n))


def _cut(listed: Sequence[Item], ends: Numbers) -> tuple[tuple[Item, ...], ...]:
    """A list in n pieces, by where they begin and the last one ends (n + 1,)."""
    whole = tuple(listed)
    return tuple([whole[begin:end] for begin, end in pairwise(ends.tolist())])
