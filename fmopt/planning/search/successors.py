"""One step of the search: the guarded moves from a contact state, what they cost, and the states that they lead to."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import chain

import numpy as np

from fmopt.certificate.assembly import Assembly, contact_rows
from fmopt.certificate.error_set import ErrorSet
from fmopt.certificate.segment_linearisation import Tolerance
from fmopt.contact.c_surface import Surfaces
from fmopt.contact.facet_bounds import INSIDE
from fmopt.contact.primitive import Kind, PrimitiveContact, near_contacts
from fmopt.errors import InfeasibleError
from fmopt.geometry.section import corner_walls
from fmopt.planning.moves.contact_transition import described, on_wall
from fmopt.planning.moves.moves import Care, Move, Reached, Tried, fresh, unroll
from fmopt.planning.search.entry import Entry, deeper, turned_axes
from fmopt.planning.search.guarded_move import (
    ContactPose,
    Freedom,
    freedoms,
    guarded,
    implied,
    insides,
    lasts,
    mating_faces,
    meetings,
    modulo,
    neighbourhood,
    pinned,
)
from fmopt.spatial.se3 import Pose, cross
from fmopt.spatial.values import Array

ASKEW = "'"  # ends the name of a freedom along or about an axis of a side that lies askew
_ALIGNED = 1e-6  # rad, by which axes are turned against each other that are the same


@dataclass(frozen=True)
class Costs:
    """Weights of the search, and when a transition is given up."""

    reach: float  # how far a move may go to its contact, turns and the way down apart, m
    asymptote: float  # margin (m, negative) at which danger becomes infinite, the paper's C
    scale: float  # margin (m) that is roomy; more of it is not less dangerous
    transition: float = 1.0
    signature: float = 0.25
    danger: float = 1.0
    coarse: float = 0.03  # greatest turn of one piece while searching, rad
    states: int = 60
    greed: float = 1.8  # weight of the transitions still to come in the order of expansion, at least 1

    @classmethod
    def of(cls, spread: float, clearance: float) -> "Costs":
        """The costs for a start error that displaces the tip by up to `spread` and a clearance a side, both in m."""
        asymptote = -0.15 * spread - 0.5 * clearance
        return cls(reach=7.0 * spread + 10.0 * clearance, asymptote=asymptote, scale=clearance)


@dataclass(frozen=True, eq=False)
class SearchTask:
    """What a search is about.

    Moves turn by at most `max_turn`, rad. If `askew`, they go along sides that lie askew, too; walls far apart then
    hold a part next to round.
    """

    assembly: Assembly
    goal: Pose
    start: ErrorSet
    tolerance: Tolerance
    costs: Costs
    max_turn: float
    askew: bool = False
    care: Care = Care.NONE

    @property
    def pinned_upright(self) -> int:
        """Freedoms that contacts have taken away when the part can only go up and down."""
        return 2 if self.assembly.planar or self.rounded else 5  # of 3 in the plane or of a ball, else of 6

    @cached_property
    def rounded(self) -> bool:
        """Whether the moving part has balls, which contacts do not keep from turning."""
        return bool(self.assembly.moving.polyhedron.balls)

    @property
    def final_rank(self) -> int:
        """How many freedoms the contacts of the seated part take away, at most."""
        near = near_contacts(self.assembly.moving.polyhedron, self.assembly.fixed.polyhedron, self.goal, 1e-6, 1e-3)
        stops = [c for c in near if abs(contact_rows(self.assembly, [c], (), self.goal).f[0]) < 1e-9]
        return self.pinned_upright + (1 if stops else 0)

    @cached_property
    def mates(self) -> frozenset[tuple[int, int]]:
        """Faces of the moving and the fixed part, by number, that face each other in the seat."""
        return mating_faces(self.assembly, self.goal, self.costs.scale)

    def seated(self, pose: Pose) -> bool:
        """Whether a pose is as deep as the goal."""
        return bool(abs(self.goal.local(pose)[2]) < 1e-9)

    def upright(self, pose: Pose) -> bool:
        """Whether a pose is turned like the goal."""
        return bool(np.linalg.norm(self.goal.local(pose)[3:]) <= 1e-9)


@dataclass(frozen=True, eq=False)
class Node:
    """A contact state with its errors, and how it was reached: entry, moves with the names of their freedoms, cost."""

    entry: Entry
    place: ContactPose
    reached: Reached
    moves: tuple[Move, ...]
    names: tuple[str, ...]
    cost: float
    rank: int


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
    body, fixed = assembly.moving.polyhedron, assembly.fixed.polyhedron
    shift, turn = np.split(errors.support(np.eye(6)), 2)  # how far the errors displace the body origin at most, m, rad
    near = near_contacts(body, fixed, move.goal, float(np.linalg.norm(shift)), float(np.linalg.norm(turn)))
    known = (*move.held, *move.making)
    others = [c for c in near if c not in known and not implied(assembly, move.held, move.making[0], c)]
    if not others:
        return 0.0
    f, N = Surfaces.of(others, body, fixed).values_and_rows(move.goal)
    reachable = (f > 1e-9) & (f < errors.support(N)) & np.isfinite(f)
    if not reachable.any():
        return 0.0
    wanted = contact_rows(assembly, [move.making[0]], move.making, move.goal).N[0] * scale
    held = contact_rows(assembly, move.held, move.held, move.goal).N * scale if move.held else np.zeros((0, 6))
    wanted, *wrong = modulo(held, np.vstack([wanted, N[reachable] * scale]))
    alike = [float(wanted @ w) / max(float(np.linalg.norm(wanted) * np.linalg.norm(w)), 1e-30) for w in wrong]
    return float(np.clip(max(alike), 0.0, 1.0))


def successor_by(task: SearchTask, node: Node, move: Move, name: str, care: Care = Care.NONE) -> Node | None:
    """The state after a move, None when it cannot be certified."""
    costs = task.costs
    try:
        before = len(node.reached.claims)
        reached = unroll(task.assembly, move, node.reached, task.tolerance, costs.coarse, care)
    except InfeasibleError:
        return None
    cost = node.cost + costs.transition + danger(min(c.margin for c in reached.claims[before:]), costs)
    if not math.isfinite(cost):
        return None
    cost += costs.signature * signature(task.assembly, move, task.tolerance, reached.errors)
    held = described(task.assembly, (*move.held, *move.making), move.goal, move.goal, reached.errors)
    if _slid_off(task.assembly, held, move.goal):
        return None
    place = ContactPose(move.goal, held, reached.basis, node.place.pivot)
    # Contacts that are given up before the seat take no freedom away for good: with them a search runs into wedges.
    lasting = [contact for contact in held if lasts(task.assembly, contact, task.mates)] if task.care else held
    rank = pinned(task.assembly, move.goal, lasting)
    return Node(node.entry, place, reached, (*node.moves, move), (*node.names, name), cost, rank)


def _slid_off(assembly: Assembly, held: Sequence[PrimitiveContact], pose: Pose) -> bool:
    """Whether a held contact is past the end of its facet.

    Parallel edges have none to be past. Of a vertex and its edge, listed since either may touch, one has to be inside.
    """
    inside = insides(assembly, held, pose)
    past = np.isfinite(inside) & (inside < -INSIDE)
    within = [c for c, gone in zip(held, past.tolist(), strict=True) if not gone]
    outside = (c for c, gone in zip(held, past.tolist(), strict=True) if gone)
    return any(not any(_instead(assembly, c, other) for other in within) for c in outside)


def _instead(assembly: Assembly, one: PrimitiveContact, other: PrimitiveContact) -> bool:
    """Whether two contacts are a vertex on a face and an edge that ends there, across a rim of the face."""
    vertex, edge = (one, other) if one.kind is Kind.VERTEX_FACE else (other, one)
    if vertex.kind is not Kind.VERTEX_FACE or edge.kind is not Kind.EDGE_EDGE:
        return False
    return vertex.moving_feature in edge.moving and on_wall(assembly, edge, vertex.fixed_feature)


def successors(task: SearchTask, node: Node) -> Iterator[Node]:
    """The states that guarded moves from a state lead to."""
    tried: Tried = set()
    for freedom, near in _nearby(task, node):
        after = _along(task, node, freedom, near, tried)
        if after is not None:
            yield after
    yield from _given_up(task, node)


def ways_on(task: SearchTask, node: Node) -> Iterator[tuple[str, Move]]:
    """The first guarded move along each freedom from a state, whether or not it can be certified, with its name."""
    for freedom, near in _nearby(task, node):
        move = guarded(task.assembly, node.place, freedom, near)
        if move is not None:
            yield freedom.name, move


def _nearby(task: SearchTask, node: Node) -> Iterator[tuple[Freedom, Surfaces]]:
    """The freedoms from a state, each with the contacts that a move along it may meet."""
    near: dict[tuple[bool, float], Surfaces] = {}
    for freedom in _freedoms(task, node):
        kind = bool(freedom.twist[3:].any()), freedom.limit
        if kind not in near:
            near[kind] = neighbourhood(task.assembly, node.place, freedom, task.costs.reach)
        yield freedom, near[kind]


def _given_up(task: SearchTask, node: Node) -> Iterator[Node]:
    """The states after all contacts of a corner caught on a slope of the mouth are given up, once on a way."""
    place = node.place
    if not (node.entry.shallow and place.held) or any(move.left for move in node.moves):
        return
    moving, fixed = task.assembly.moving, task.assembly.fixed
    arm = place.pose.R @ place.pivot
    spread = node.reached.errors.support(np.hstack([np.eye(3), cross(arm, np.eye(3))]))
    for inside in deeper(moving, fixed, place.pose, place.pivot, spread):
        after = successor_by(task, node, Move(place.pose, inside, (), (), place.held), "leave")
        if after is not None:
            yield after


def follow(task: SearchTask, node: Node, name: str) -> Node | None:
    """The state that the guarded move along one freedom leads to, None when it cannot be certified."""
    for freedom in _freedoms(task, node):
        if freedom.name == name:
            near = neighbourhood(task.assembly, node.place, freedom, task.costs.reach)
            return _along(task, node, freedom, near, set())
    return None


def _freedoms(task: SearchTask, node: Node) -> tuple[Freedom, ...]:
    """Both ways along and about the axes of the entry, and those of the sides next to its corner that lie askew."""
    depth = float(node.place.pose.p[2] - task.goal.p[2])
    found = list[Freedom]()
    for n, heading in enumerate(_headings(task, node)):
        for freedom in freedoms(task.max_turn, depth, task.costs.reach, task.assembly.planar, turned_axes(heading)):
            if n == 0 or freedom.name[-1] != "z":  # z is the same in all of them
                found.append(replace(freedom, name=freedom.name + ASKEW * n))
    return tuple(found)


def _headings(task: SearchTask, node: Node) -> list[float]:
    """Turns about z of the axes that moves go along and about, rad: the entry's, and by an eighth at most others."""
    found = [node.entry.heading]
    if not task.askew or task.assembly.planar or task.rounded:
        return found
    walls = node.entry.walls
    for normal in walls if walls is not None else (n for n, _ in corner_walls(task.assembly.moving, node.place.pivot)):
        apart = math.atan2(normal[1], normal[0]) - found[0]
        heading = found[0] + math.remainder(apart, 0.5 * math.pi)
        if all(abs(heading - known) > _ALIGNED for known in found):
            found.append(heading)
    return found


def _along(task: SearchTask, node: Node, freedom: Freedom, near: Surfaces, tried: Tried) -> Node | None:
    moves = meetings(task.assembly, node.place, freedom, near)
    first = next(moves, None)
    if first is None and freedom.name == "-z":
        first = _straight_down(task, node.place, freedom.twist)
    ways = moves if first is None else chain([first], moves)
    afters = (successor_by(task, node, move, freedom.name, task.care) for move in fresh(ways, tried))
    return next((after for after in afters if after is not None), None)


def _straight_down(task: SearchTask, place: ContactPose, twist: Array) -> Move | None:
    """The last move where nothing stops it: as far as the goal's depth, when the part stands upright.

    It needs contacts on all other freedoms, or none at all: then the errors have to fit into the clearance.
    """
    there = place.pose.moved(twist * float(place.pose.p[2] - task.goal.p[2]))
    if not task.upright(there) or 0 < pinned(task.assembly, place.pose, place.held) < task.pinned_upright:
        return None
    return Move(place.pose, there, place.held, ())
