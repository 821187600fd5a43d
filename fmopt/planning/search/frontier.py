"""The states that a search has come to: those still to be expanded in order, and the graph of all of them."""

from __future__ import annotations

import heapq
import math
from collections.abc import Sequence
from dataclasses import dataclass, field

from fmopt.planning.search.successors import ASKEW, Costs, Node
from fmopt.planning.search.symmetry import Searched, SearchedState

_DIGITS = 9  # decimals of costs that tell one from another


@dataclass(order=True)
class _Open:
    order: tuple[bool, float]
    number: int
    bound: float = field(compare=False)
    final: int = field(compare=False)
    node: Node = field(compare=False)


class Frontier:
    """States to expand, the cheapest way to each only: those with a margin first, by what they promise to cost."""

    def __init__(self, final: int, costs: Costs, nodes: Sequence[Node]) -> None:
        self._costs = costs
        self._queue: list[_Open] = []
        self._best: dict[tuple[frozenset[str], int], float] = {}
        self._dropped = math.inf
        self._nodes: dict[Node, Node | None] = {}  # that were come to, in that order, with where each was come to from
        self._expanded = set[Node]()
        for node in nodes:
            self.push(node, final)

    def push(self, node: Node, final: int, origin: Node | None = None) -> None:
        """Adds a state from which `final` freedoms are to be taken away in all, come to from another one."""
        left = max(final - node.rank, 0) * (self._costs.transition + self._costs.danger)
        self._nodes[node] = origin
        # Mirror images cost the same: which of them comes first is for the order of the moves, not for rounding.
        order = (node.reached.margin <= 0.0, round(node.cost + self._costs.greed * left, _DIGITS))
        heapq.heappush(self._queue, _Open(order, len(self._nodes), node.cost + left, final, node))

    def pop(self) -> Node | None:
        """The next state, None when there is none."""
        while self._queue:
            entry = heapq.heappop(self._queue)
            # A part may slide to its seat without another contact: seated is another state.
            held = frozenset(c.id for c in entry.node.place.held)
            state = held, entry.final
            cost = round(entry.node.cost, _DIGITS)
            if held and self._best.get(state, math.inf) <= cost:
                self._dropped = min(self._dropped, entry.bound)
                continue
            self._best[state] = cost
            return entry.node
        return None

    def expanded(self, node: Node) -> None:
        """Notes that moves are looked for from a state."""
        self._expanded.add(node)

    def states(self) -> tuple[SearchedState, ...]:
        """All states that were come to, with where each was come to from."""
        numbers, found = {node: number for number, node in enumerate(self._nodes)}, list[SearchedState]()
        for node, origin in self._nodes.items():
            begun = 0 if origin is None else len(origin.names)
            names = tuple(name.rstrip(ASKEW) for name in node.names[begun:])
            told = Searched(node.entry.heading, names, 0.0, 0.0, 0).of(node.moves[begun:])
            at, done = None if origin is None else numbers[origin], node in self._expanded
            found.append(
                SearchedState(at, told.names, node.place.held, node.rank, node.cost, node.reached.margin, done)
            )
        return tuple(found)

    def way(self, node: Node) -> tuple[int, ...]:
        """The numbers of the states on the way to one."""
        numbers, found = {node: number for number, node in enumerate(self._nodes)}, list[int]()
        at: Node | None = node
        while at is not None:
            found.append(numbers[at])
            at = self._nodes[at]
        return tuple(reversed(found))

    def bound(self, found: Node) -> float:
        """What any sequence from the same entries costs at least, when this one is found."""
        return min([found.cost, self._dropped, *(entry.bound for entry in self._queue)])
