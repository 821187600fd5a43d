"""Best-first search for a sequence of contact states from free space to the seated part.

Nodes are contact states with their error sets; arcs are guarded moves along one freedom of the compliance frame. The
cost of a sequence has the three terms of [DakinPopplestone1993] section 3: the number of transitions, how hard the
force signature of a wanted contact is to tell from that of the likeliest wrong one, and the danger of meeting an
obstacle on the way, as a reciprocal of the certified margin. Each freedom that is still to be taken away costs one
transition and one roomy move at least. That bound is admissible; the order of expansion weighs it more, so that an
answer comes soon, and the least bound among the states left open or dropped for a cheaper way to the same contacts says
how much better another sequence could be: the gap.
"""

from __future__ import annotations

import heapq
import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from fmopt.certificate.functions import contact_rows
from fmopt.certificate.knowledge import Assembly
from fmopt.certificate.segment import Tolerance
from fmopt.contact.primitive import PrimitiveContact, near_contacts
from fmopt.contact.surface import Surfaces
from fmopt.errors import InfeasibleError, SearchError
from fmopt.placement.entry import Entry
from fmopt.placement.explore import Place, freedoms, guarded, implied, neighbourhood, pinned
from fmopt.placement.motion import Move, Reached, described, unroll
from fmopt.se3 import Pose
from fmopt.uncertainty.error_set import ErrorSet
from fmopt.values import Array


@dataclass(frozen=True)
class Costs:
    """Weights of the search, and when a transition is given up.

    Args:
        transition: cost of each transition.
        signature: cost of a contact whose wrench cannot be told from that of the likeliest wrong one.
        danger: cost of a transition with no margin at all.
        reach: how far a move may go to its contact, turns and the way down apart, m.
        asymptote: margin (m, negative) at which danger becomes infinite, the paper's C.
        scale: margin (m) that is roomy; more of it is not less dangerous.
        coarse: greatest turn of one piece while searching, rad.
        states: most states that are expanded.
        greed: weight of the transitions still to come in the order of expansion, at least 1.
    """

    reach: float
    asymptote: float
    scale: float
    transition: float = 1.0
    signature: float = 0.25
    danger: float = 1.0
    coarse: float = math.radians(1.5)
    states: int = 400
    greed: float = 1.2

    @classmethod
    def of(cls, spread: float, clearance: float) -> Costs:
        """The costs for a start error that displaces the tip by up to `spread` and a clearance a side, both in m."""
        return cls(reach=7.0 * spread + 10.0 * clearance, asymptote=-0.35 * spread - 0.1 * clearance, scale=clearance)


@dataclass(frozen=True, eq=False)
class MoveSequence:
    """A sequence of moves with what it cost.

    Args:
        moves: from the start to the seated part.
        names: the freedom of each move.
        reached: the claims, as coarse as the search makes them.
        cost: of the sequence.
        lower_bound: no sequence from the same entries costs less.
        expanded: states looked at.
    """

    moves: tuple[Move, ...]
    names: tuple[str, ...]
    reached: Reached
    cost: float
    lower_bound: float
    expanded: int


@dataclass(frozen=True, eq=False)
class _Node:
    place: Place
    reached: Reached
    moves: tuple[Move, ...]
    names: tuple[str, ...]
    cost: float
    rank: int


@dataclass(order=True)
class _Open:
    order: float
    number: int
    bound: float = field(compare=False)
    node: _Node = field(compare=False)


def danger(margin: float, costs: Costs) -> float:
    """The reciprocal cost of a margin (m), [DakinPopplestone1993] eq. 2 with its sign right; inf past the asymptote."""
    room = min(margin, costs.scale) - costs.asymptote
    return costs.danger * (costs.scale - costs.asymptote) / room if room > 0.0 else math.inf


def signature(assembly: Assembly, move: Move, tolerance: Tolerance, errors: ErrorSet) -> float:
    """How alike the new contact's wrench is to that of the likeliest wrong contact: 1 the same, 0 orthogonal.

    The likely wrong ones are the contacts that the errors at the goal could reach. Wrenches are compared modulo those
    of the contacts already held, in the metric of ρ.
    """
    if not move.making:
        return 0.0
    scale = np.array([1.0, 1.0, 1.0, *[1.0 / tolerance.rho] * 3])
    near = near_contacts(assembly.moving.polyhedron, assembly.fixed.polyhedron, move.goal, *_likely(errors))
    others = [
        c
        for c in near
        if c not in move.held and c not in move.making and not implied(assembly, move.held, move.making[0], c)
    ]
    if not others:
        return 0.0
    f, N = Surfaces.of(others, assembly.moving.polyhedron, assembly.fixed.polyhedron).values_and_rows(move.goal)
    reachable = (f > 1e-9) & (f < errors.support(N)) & np.isfinite(f)
    if not reachable.any():
        return 0.0
    wanted = contact_rows(assembly, [move.making[0]], move.making, move.goal).N[0] * scale
    held = contact_rows(assembly, move.held, move.held, move.goal).N * scale if move.held else np.zeros((0, 6))
    wanted, *wrong = _modulo(held, np.vstack([wanted, N[reachable] * scale]))
    alike = [float(wanted @ w) / max(float(np.linalg.norm(wanted) * np.linalg.norm(w)), 1e-30) for w in wrong]
    return float(np.clip(max(alike), 0.0, 1.0))


def _likely(errors: ErrorSet) -> tuple[float, float]:
    """How far (m) and by what angle (rad) the errors displace the body origin at most."""
    spread = errors.support(np.eye(6))
    return float(np.linalg.norm(spread[:3])), float(np.linalg.norm(spread[3:]))


def _modulo(held: Array, rows: Array) -> Array:
    if not len(held):
        return rows
    _, s, Vt = np.linalg.svd(held, full_matrices=False)
    basis = Vt[s > 1e-9 * s[0]]
    return np.asarray(rows - rows @ basis.T @ basis)


def search(
    assembly: Assembly,
    rounds: Iterator[Sequence[Entry]],
    goal: Pose,
    start: ErrorSet,
    tolerance: Tolerance,
    costs: Costs,
    max_turn: float,
    deadline: float = math.inf,
    progress: Callable[[str], None] = lambda _: None,
) -> MoveSequence:
    """The cheapest sequence of guarded moves to the goal, from the first round of entries that has one.

    Args:
        assembly: the two parts.
        rounds: ways to begin; a round is tried when those before it led nowhere, the rest stay for another call.
        goal: the seated pose.
        start: error set at the start.
        tolerance: velocity error and metric.
        costs: weights and limits.
        max_turn: greatest turn of a move, rad.
        deadline: `time.monotonic()` at which to stop with what there is.
        progress: told what is being looked at.

    Raises:
        SearchError: no sequence was found.
    """
    most = _final_rank(assembly, goal)
    expanded = 0
    closest: _Node | None = None
    for entries in rounds:
        tries = (_approach(assembly, entry, start, tolerance, costs) for entry in entries)
        nodes = [node for node in tries if node is not None]
        # A part that stands upright in the mouth with room for its errors may go straight down, all freedoms left.
        final = 0 if any(_turned(node.place.pose, goal) == 0.0 for node in nodes) else most
        front = _Frontier(final, costs, nodes)
        while expanded < costs.states and time.monotonic() <= deadline:
            node = front.pop()
            if node is None:
                break
            if _seated(node.place.pose, goal):
                return MoveSequence(node.moves, node.names, node.reached, node.cost, front.bound(node), expanded)
            expanded += 1
            progress(" ".join(node.names))
            for son in _sons(assembly, node, goal, tolerance, costs, max_turn):
                front.push(son, 0 if _seated(son.place.pose, goal) else final)
                closest = son if closest is None else min(son, closest, key=lambda n: (-n.rank, n.cost))
    late = time.monotonic() > deadline
    raise SearchError(
        f"no sequence of contacts to the seated part was found among {expanded} states"
        + (", the time limit is used up" if late else "")
        + (f", the closest came after {' '.join(closest.names)}" if closest else ""),
        advice="raise settings.time_limit" if late else "allow a larger tilt, lower the start errors",
    )


class _Frontier:
    """States still to expand, in the order of what they promise to cost, the cheapest way to each state only."""

    def __init__(self, final: int, costs: Costs, nodes: Sequence[_Node]) -> None:
        self._costs = costs
        self._queue: list[_Open] = []
        self._best: dict[frozenset[str], float] = {}
        self._dropped = math.inf
        self._count = 0
        for node in nodes:
            self.push(node, final)

    def push(self, node: _Node, final: int) -> None:
        """Adds a state from which `final` freedoms are to be taken away in all."""
        left = max(final - node.rank, 0) * (self._costs.transition + self._costs.danger)
        self._count += 1
        heapq.heappush(self._queue, _Open(node.cost + self._costs.greed * left, self._count, node.cost + left, node))

    def pop(self) -> _Node | None:
        """The next state, None when there is none."""
        while self._queue:
            entry = heapq.heappop(self._queue)
            state = frozenset(c.id for c in entry.node.place.held)
            if state and self._best.get(state, math.inf) <= entry.node.cost:
                self._dropped = min(self._dropped, entry.bound)
                continue
            self._best[state] = entry.node.cost
            return entry.node
        return None

    def bound(self, found: _Node) -> float:
        """What any sequence from the same entries costs at least, when this one is found."""
        return min([found.cost, self._dropped, *(entry.bound for entry in self._queue)])


def _final_rank(assembly: Assembly, goal: Pose) -> int:
    near = near_contacts(assembly.moving.polyhedron, assembly.fixed.polyhedron, goal, 1e-6, 1e-3)
    stops = [c for c in near if abs(contact_rows(assembly, [c], (), goal).f[0]) < 1e-9]
    return 5 + (1 if stops else 0)


def _turned(pose: Pose, goal: Pose) -> float:
    return float(np.linalg.norm(goal.local(pose)[3:]))


def _seated(pose: Pose, goal: Pose) -> bool:
    x = goal.local(pose)
    return bool(abs(x[2]) < 1e-9)


def _approach(assembly: Assembly, entry: Entry, start: ErrorSet, tolerance: Tolerance, costs: Costs) -> _Node | None:
    move = Move(entry.start, entry.inside, (), ())
    try:
        reached = unroll(assembly, move, Reached(start, (), ()), tolerance, costs.coarse, thorough=False)
    except InfeasibleError:
        return None
    cost = danger(reached.margin, costs)
    if not math.isfinite(cost):
        return None
    return _Node(Place(entry.inside, (), (), entry.corner), reached, (move,), ("approach",), cost, 0)


def _sons(
    assembly: Assembly, node: _Node, goal: Pose, tolerance: Tolerance, costs: Costs, max_turn: float
) -> list[_Node]:
    found = []
    depth = float(node.place.pose.p[2] - goal.p[2])
    near: dict[tuple[bool, float], tuple[PrimitiveContact, ...]] = {}
    for freedom in freedoms(max_turn, depth, costs.reach):
        kind = bool(freedom.twist[3:].any()), freedom.limit
        if kind not in near:
            near[kind] = neighbourhood(assembly, node.place, freedom, costs.reach)
        move = guarded(assembly, node.place, freedom, near[kind])
        if move is None and freedom.name == "-z":
            move = _straight_down(assembly, node.place, goal, freedom.twist)
        if move is None:
            continue
        son = _son(assembly, node, move, freedom.name, tolerance, costs)
        if son is not None:
            found.append(son)
    return found


def _straight_down(assembly: Assembly, place: Place, goal: Pose, twist: Array) -> Move | None:
    """The last move where nothing stops it: as far as the goal's depth, when the part stands upright.

    It needs contacts on all other freedoms, or none at all: then the errors have to fit into the clearance.
    """
    there = place.pose.moved(twist * float(place.pose.p[2] - goal.p[2]))
    if _turned(there, goal) > 1e-9 or 0 < pinned(assembly, place.pose, place.held) < 5:
        return None
    return Move(place.pose, there, place.held, ())


def _son(assembly: Assembly, node: _Node, move: Move, name: str, tolerance: Tolerance, costs: Costs) -> _Node | None:
    try:
        before = len(node.reached.claims)
        reached = unroll(assembly, move, node.reached, tolerance, costs.coarse, thorough=False)
    except InfeasibleError:
        return None
    margin = min(c.margin for c in reached.claims[before:])
    cost = node.cost + costs.transition + danger(margin, costs)
    if not math.isfinite(cost):
        return None
    cost += costs.signature * signature(assembly, move, tolerance, reached.errors)
    held = described(assembly, (*move.held, *move.making), move.goal, move.goal, reached.errors)
    place = Place(move.goal, held, reached.basis, node.place.pivot)
    rank = pinned(assembly, move.goal, held)
    return _Node(place, reached, (*node.moves, move), (*node.names, name), cost, rank)
