"""Best-first search for a sequence of contact states from free space to the seated part.

Nodes are contact states with their error sets; arcs are guarded moves along one freedom of the compliance frame. The
cost of a sequence has the three terms of [DakinPopplestone1993] section 3: the number of transitions, how hard the
force signature of a wanted contact is to tell from that of the likeliest wrong one, and the danger of meeting an
obstacle on the way, as a reciprocal of the certified margin. Each freedom that is still to be taken away costs one
transition and one roomy move at least. That bound is admissible; the order of expansion weighs it more, so that an
answer comes soon, and the least bound among the states left open, or dropped for a way to the same contacts that costs
and risks no more, says how much better another sequence could be: the gap.
"""

import heapq
import math
import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from itertools import islice

import numpy as np

from fmopt.contact.c_surface import Surfaces
from fmopt.errors import OverdueError, SearchError
from fmopt.planning.moves.moves import Care, Move, Reached
from fmopt.planning.search.entry import Entry, Leant
from fmopt.planning.search.guarded_move import ContactPose, Freedom, guarded, insides, meetings, neighbourhood, tips
from fmopt.planning.search.successors import ASKEW, Costs, Node, SearchTask, successor_by, successors, ways_on
from fmopt.planning.search.symmetry import Searched, SearchNode
from fmopt.runtime.clock import clock
from fmopt.spatial.se3 import Pose
from fmopt.spatial.values import Array

_LOOKS = 4  # sequences without a margin, of which the best is taken then
_DIGITS, _PLACES = 9, 12  # of costs (1) and margins (m), decimals that tell one from another
_SMALLER = "allow a larger tilt, lower the start errors"
_BEGIN = _SMALLER + ", or begin at another start.height"
_MORE, _WORTH = 16, 0.5  # further rounds for a steady sequence, and the share of the margin that it may cost


@dataclass(frozen=True, eq=False)
class MoveSequence:
    """A sequence of moves with what it cost."""

    entry: Entry
    moves: tuple[Move, ...]
    names: tuple[str, ...]
    reached: Reached
    cost: float
    lower_bound: float
    expanded: int
    states: tuple[SearchNode, ...]
    way: tuple[int, ...]

    @property
    def searched(self) -> Searched:
        """What is said of the search."""
        told = Searched(self.entry.heading, self.names, self.cost, self.lower_bound, self.expanded).of(self.moves)
        return replace(told, states=self.states, way=self.way)


@dataclass(frozen=True, eq=False)
class Closest:
    """The state that came closest to the seated part in a search for a task that found no sequence."""

    task: SearchTask
    node: Node

    @property
    def order(self) -> tuple[bool, int, float]:
        """What makes one state come closer than another: seated, freedoms taken away, margin."""
        return self.task.seated(self.node.place.pose), self.node.rank, round(self.node.reached.margin, _PLACES)

    @property
    def ways_on(self) -> tuple[tuple[str, Move], ...]:
        """The guarded moves from there, each with the name of its freedom, whether or not they can be certified."""
        return () if self.task.seated(self.node.place.pose) else tuple(ways_on(self.task, self.node))


@dataclass(order=True)
class _Open:
    order: tuple[bool, float]
    number: int
    bound: float = field(compare=False)
    final: int = field(compare=False)
    node: Node = field(compare=False)


def best_sequences(
    task: SearchTask,
    rounds: Iterator[Sequence[Entry]],
    deadline: float = math.inf,
    progress: Callable[[str], None] = lambda _: None,
    steady: Callable[[MoveSequence], bool] = lambda _: True,
    more: Iterator[Sequence[Entry]] | None = None,
) -> tuple[MoveSequence, ...]:
    """The first sequence with a margin, or the first few that there are, that with most of it first.

    Where the first one with a margin is not steady, the first steady one in the next few rounds with half of its margin
    is taken in its place; where there is none, those with a margin follow the first in the order in which they came.
    Each round has several ways to begin, to be weighed against each other; the rest stay for another call. In a steady
    sequence friction leaves all contacts closed.

    Raises:
        SearchError: no round has a sequence.
    """
    found = _first_sequences(task, rounds, deadline, progress)
    first = found[0]
    if first.reached.margin <= 0.0 or steady(first):
        return found
    others: list[MoveSequence] = []
    for entries in islice(more or rounds, _MORE):
        if clock() > deadline:
            break
        try:
            other = search(task, entries, deadline, progress)
        except SearchError:
            continue  # no sequence begins like this
        if other.reached.margin >= _WORTH * first.reached.margin and steady(other):
            return (other,)
        if other.reached.margin > 0.0:
            others.append(other)
    return (*found, *others)


def _first_sequences(
    task: SearchTask, rounds: Iterator[Sequence[Entry]], deadline: float, progress: Callable[[str], None]
) -> tuple[MoveSequence, ...]:
    found: list[MoveSequence] = []
    failures: list[SearchError] = []
    for entries in rounds:
        try:
            found.append(search(task, entries, deadline, progress))
        except SearchError as error:
            failures = [farther(error.with_traceback(None), *failures)]  # a traceback would hold on to this frame
        else:
            if found[-1].reached.margin > 0.0:
                return (found[-1],)
        if len(found) >= _LOOKS or clock() > deadline:
            break
    if not found:
        raise failures.pop() if failures else SearchError("no way to begin is left", advice=_BEGIN)
    return tuple(sorted(found, key=lambda sequence: -round(sequence.reached.margin, _PLACES)))


def farther(error: SearchError, before: SearchError | None = None) -> SearchError:
    """The latest failure, with the attempt of the one before where that came farther."""
    known = None if before is None else before.attempt
    if known is not None and (error.attempt is None or known.order > error.attempt.order):
        error.attempt = known
    return error


def search(
    task: SearchTask,
    entries: Sequence[Entry],
    deadline: float = math.inf,
    progress: Callable[[str], None] = lambda _: None,
) -> MoveSequence:
    """The cheapest sequence of guarded moves to the goal.

    Raises:
        SearchError: no sequence was found.
    """
    nodes = list[Node]()
    with suppress(OverdueError):  # those that could begin by then count
        for entry in entries:
            node = begin(task, entry)
            nodes += [] if node is None else [node]
    # A part that stands upright in the mouth with room for its errors may go straight down, all freedoms left.
    final = 0 if any(task.upright(node.place.pose) for node in nodes) else task.final_rank
    front = _Frontier(final, task.costs, nodes, placed=bool(task.care))
    closest: Node | None = None
    ready: Node | None = None  # what there is when time runs out
    expanded = 0
    while expanded < task.costs.states and (expanded == 0 or clock() <= deadline):
        node = front.pop()
        if node is None:
            break
        if task.seated(node.place.pose):
            return _sequence(node, front, expanded)
        expanded += 1
        progress(" ".join(node.names).replace(ASKEW, ""))
        try:
            for successor in successors(task, node):
                front.push(successor, 0 if task.seated(successor.place.pose) else final, node)
                closest = successor if closest is None else min(successor, closest, key=lambda n: (-n.rank, n.cost))
                if task.seated(successor.place.pose) and successor.reached.margin > 0.0:
                    ready = successor if ready is None else min(successor, ready, key=lambda n: n.cost)
        except OverdueError:
            break
    if ready is not None:
        return _sequence(ready, front, expanded)
    late = clock() > deadline
    names = " ".join(closest.names).replace(ASKEW, "") if closest else ""
    advice = _SMALLER if expanded else _BEGIN  # without a state nothing could begin
    farthest = closest or max(nodes, key=lambda node: node.reached.margin, default=None)
    raise SearchError(
        f"no sequence of contacts to the seated part was found among {expanded} states"
        + (", the time limit is used up" if late else "")
        + (f", the closest came after {names}{shortfall(closest)}" if closest else ""),
        advice="raise settings.time_limit" if late else advice,
        late=late,
        attempt=None if farthest is None else Closest(task, farthest),
    )


def _sequence(node: Node, front: "_Frontier", expanded: int) -> MoveSequence:
    come = node.entry, node.moves, node.names, node.reached, node.cost
    return MoveSequence(*come, front.bound(node), expanded, *front.graph(node))


def shortfall(node: Node) -> str:
    """What is short on the way to a state, in words; nothing where all of it is certified."""
    worst = min(node.reached.claims, key=lambda claim: claim.margin)
    if worst.margin > 0.0:
        return ""
    what = worst.binding
    if pair := re.fullmatch(r"pieces (\d+)/(\d+)", what):
        what = f"the distance of piece {pair[1]} of the moving part from piece {pair[2]} of the fixed one"
    return f", where {what} is short by {-1e6 * worst.margin:.1f} um for the stated errors"


class _Frontier:
    """States to expand, those with a margin first, by what they promise to cost.

    Left out are ways to the same contacts as another at no less cost, and no more margin if poses are not placed anew.
    """

    def __init__(self, final: int, costs: Costs, nodes: Sequence[Node], placed: bool = False) -> None:
        self._costs, self._placed = costs, placed
        self._queue: list[_Open] = []
        self._best: dict[tuple[frozenset[str], int], list[tuple[float, float]]] = {}
        self._dropped = math.inf
        self._origins: dict[Node, Node | None] = {}  # of all states, in the order in which they were come to
        self._popped = set[Node]()
        for node in nodes:
            self.push(node, final)

    def push(self, node: Node, final: int, origin: Node | None = None) -> None:
        """Adds a state from which `final` freedoms are to be taken away in all, come to from another one."""
        left = max(final - node.rank, 0) * (self._costs.transition + self._costs.danger)
        self._origins[node] = origin
        # Mirror images cost the same: which of them comes first is for the order of the moves, not for rounding.
        order = (node.reached.margin <= 0.0, round(node.cost + self._costs.greed * left, _DIGITS))
        heapq.heappush(self._queue, _Open(order, len(self._origins), node.cost + left, final, node))

    def pop(self) -> Node | None:
        """The next state, None when there is none."""
        while self._queue:
            entry = heapq.heappop(self._queue)
            # A part may slide to its seat without another contact: seated is another state.
            held = frozenset(c.id for c in entry.node.place.held)
            state = held, entry.final
            cost, margin = round(entry.node.cost, _DIGITS), round(entry.node.reached.margin, _PLACES)
            # Without contacts it is the pose that tells states apart, which is no part of the key.
            if held and any(c <= cost and (self._placed or m >= margin) for c, m in self._best.get(state, ())):
                self._dropped = min(self._dropped, entry.bound)
                continue
            self._best.setdefault(state, []).append((cost, margin))
            self._popped.add(entry.node)
            return entry.node
        return None

    def graph(self, found: Node) -> tuple[tuple[SearchNode, ...], tuple[int, ...]]:
        """All states that were come to, and the numbers of those on the way to one that was found."""
        numbers, states = {node: k for k, node in enumerate(self._origins)}, list[SearchNode]()
        for node, origin in self._origins.items():
            begun = 0 if origin is None else len(origin.names)
            names = tuple(name.rstrip(ASKEW) for name in node.names[begun:])
            told = Searched(node.entry.heading, names, node.cost, node.cost, 0).of(node.moves[begun:])
            way = None if origin is None else numbers[origin], told.names, node.place.held, node.rank
            expanded = node in self._popped and node is not found
            states.append(SearchNode(*way, node.cost, node.reached.margin, expanded))
        back = [numbers[found]]
        while (at := states[back[-1]].origin) is not None:
            back.append(at)
        return tuple(states), tuple(reversed(back))

    def bound(self, found: Node) -> float:
        """What any sequence from the same entries costs at least, when this one is found."""
        return min([found.cost, self._dropped, *(entry.bound for entry in self._queue)])


def begin(task: SearchTask, entry: Entry) -> Node | None:
    """The state with a corner inside, None when the approach cannot be certified.

    With a pose above the mouth the corner first goes down to touch the top, or the part is laid flat there, and leaves
    it to get there.
    """
    place = ContactPose(entry.start, (), (), entry.corner)
    # The approach itself is no transition.
    above = Node(entry, place, Reached(task.start, (), ()), (), (), -task.costs.transition, 0)
    if entry.over is None:
        return successor_by(task, above, Move(entry.start, entry.inside, (), ()), "approach")
    if entry.leant is not None:
        return _from_flat(task, above, entry, entry.over, entry.leant)
    height = float(entry.start.apply(entry.corner)[2])
    down = Freedom("-z", np.array([0.0, 0.0, -1.0, 0.0, 0.0, 0.0]), 1.5 * height)
    move = guarded(task.assembly, place, down, neighbourhood(task.assembly, place, down, task.costs.reach))
    touched = None if move is None else successor_by(task, above, move, "approach", Care.MARGIN)
    if touched is None:
        return None
    lifted = successor_by(task, touched, Move(touched.place.pose, entry.over, (), (), touched.place.held), "leave")
    return None if lifted is None else successor_by(task, lifted, Move(entry.over, entry.inside, (), ()), "enter")


def _from_flat(task: SearchTask, above: Node, entry: Entry, over: Pose, leant: Leant) -> Node | None:
    """The state with a corner inside after the part has lain flat on the top, on one corner first, then on an edge."""
    node: Node | None = replace(above, place=replace(above.place, pivot=leant.edge[0]))
    height = float(entry.start.apply(leant.edge[0])[2])
    edge, face = (np.append(np.zeros(3), axis) for axis in leant.axes)
    down = Freedom("approach", np.array([0.0, 0.0, -1.0, 0.0, 0.0, 0.0]), 1.5 * height)
    for freedom, corners in (
        (down, leant.edge[:1]),
        (Freedom("edge", edge, task.max_turn), leant.edge[1:]),
        (Freedom("face", face, task.max_turn), task.assembly.moving.polyhedron.vertices),
    ):
        node = None if node is None else _onto_top(task, node, freedom, corners)
    if node is None:
        return None
    flat, last = node.place.pose, node.moves[-1]
    lifted = flat.moved([0.0, 0.0, float(over.apply(entry.corner)[2]), 0.0, 0.0, 0.0])
    ways = (
        ("leave", flat, lifted, (*last.held, *last.making)),
        ("tilt", lifted, over, ()),
        ("enter", over, entry.inside, ()),
    )
    for name, at, to, left in ways:
        node = None if node is None else successor_by(task, node, Move(at, to, (), (), left), name)
    return None if node is None else replace(node, place=replace(node.place, pivot=entry.corner))


def _onto_top(task: SearchTask, node: Node, freedom: Freedom, corners: Array) -> Node | None:
    """The state after a guarded move that brings one of some corners (n, 3) of the body onto a face.

    Of several that come down together, one that comes down well inside the face counts, the farther the better, and
    where it leaves no margin the next.
    """
    assembly, start = task.assembly, node.place.pose
    vertices = assembly.moving.polyhedron.vertices
    near = [
        contact
        for contact in tips(assembly, node.place, freedom, task.costs.reach)
        if (corners == vertices[contact.moving_feature]).all(axis=1).any()
    ]
    spread = float(node.reached.errors.support(np.eye(2, 6)).max())

    def well_inside(move: Move) -> tuple[bool, float]:
        contact = move.making[0]
        height = float(start.apply(vertices[contact.moving_feature])[2])
        return bool(insides(assembly, [contact], move.goal)[0] > spread), round(height, 9)

    best: Node | None = None
    surfaces = Surfaces.of(near, assembly.moving.polyhedron, assembly.fixed.polyhedron)
    moves = meetings(assembly, node.place, freedom, surfaces)
    for move in sorted(moves, key=well_inside, reverse=True):
        after = successor_by(task, node, move, freedom.name, Care.MARGIN)
        if after is not None and (best is None or after.reached.margin > best.reached.margin):
            best = after
        if best is not None and best.reached.margin > 0.0:
            break
    return best
