"""The contact states that a motion goes through, each as a node of a contact graph near it, each change as an edge.

The search makes guarded moves; it does not walk enumerated graphs. Here its outcome is held against them: around every
pose in which a contact is made the local contact space is enumerated, and the states before and after have to be two
confirmed states of it, the one a father of the other. Along a move a vertex may also pass the rim of a face, so that
other contacts take over. That is no face of a local space but a common end of two; there all contacts of both touch.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import compress

import numpy as np

from fmopt.certificate.assembly import Assembly
from fmopt.certificate.claim import Claim
from fmopt.certificate.segment_linearisation import Piece
from fmopt.contact.c_surface import Surfaces
from fmopt.contact.facet_bounds import INSIDE, BoundTable, touching
from fmopt.contact.primitive import PrimitiveContact, near_contacts
from fmopt.contact.realisation import Poses
from fmopt.contact.state_graph import Scale
from fmopt.plan import diagnostics
from fmopt.plan.description import CriticalPoint
from fmopt.plan.diagnostics import Graph
from fmopt.planning.moves.moves import onto
from fmopt.planning.robustness.contact_space import Space, space_at
from fmopt.spatial.se3 import Pose

_NEAR, _TURNED = 2e-6, 2e-3  # m, rad; how far off contacts are looked for that touch
_COMMON = 1e-8  # m; how nearly all contacts touch, and end, at the common end of two states
_NARROW = 1e-7  # of a piece
_BACK = (0.1, 0.4)  # shares of the last piece of a move by which a space is taken earlier where its end will not do

_Reached = tuple[float, frozenset[str]]  # a share of a piece, and the contacts that touch there


@dataclass(frozen=True, eq=False)
class StateVisit:
    """A contact state on the way, the claim with which it begins, or −1, and the contact spaces that hold it."""

    contacts: frozenset[str]
    claim: int
    change: str
    spaces: tuple[int, ...] = ()
    states: tuple[int, ...] = ()


@dataclass(frozen=True, eq=False)
class Visited:
    """A motion in its contact graphs: all contact spaces, those of the nominal path first, and the states visited."""

    spaces: tuple[Space, ...]
    visits: tuple[StateVisit, ...]

    def space_of(self, claim: int) -> int:
        """The contact space in which a claim runs: one that holds the state at its start, the last of them if several.

        Where none does, the space of the state before it, or the first one.
        """
        begun = [visit for visit in self.visits if visit.claim < claim and visit.spaces]
        return begun[-1].spaces[-1] if begun else 0

    def critical_points(self) -> tuple[CriticalPoint, ...]:
        """The plan's `critical_points`."""
        return tuple(space.critical_point() for space in self.spaces)

    def graphs(self) -> tuple[Graph, ...]:
        """The plan's graphs, each with the states visited in it: those that are in the order of the motion first."""
        order = dict.fromkeys(at for visit in self.visits for at in visit.spaces)
        order |= dict.fromkeys(range(len(self.spaces)))
        pairs = [pair for visit in self.visits for pair in zip(visit.spaces, visit.states, strict=True)]
        chosen = {at: list(dict.fromkeys(state for space, state in pairs if space == at)) for at in order}
        return tuple(self.spaces[at].graph_near(states) for at, states in chosen.items())

    def sequence(self) -> tuple[diagnostics.Visit, ...]:
        """The plan's sequence of contact states, each with the critical points that hold it and its name there."""
        return tuple(
            diagnostics.Visit(
                contacts=tuple(sorted(visit.contacts)),
                segment=visit.claim,
                change=visit.change,
                held_in=tuple(
                    (at, self.spaces[at].graph.states[state].id)
                    for at, state in zip(visit.spaces, visit.states, strict=True)
                ),
            )
            for visit in self.visits
        )


def visited(assembly: Assembly, claims: Sequence[Claim], nominal: Sequence[Space], scale: Scale) -> Visited:
    """The states of a motion, with contact spaces added wherever those at hand do not hold a change."""
    spaces, visits = list(nominal), _visits(assembly, [claim.piece for claim in claims])
    for i, visit in enumerate(visits):
        piece = claims[max(visit.claim, 0)].piece
        if visit.change == "made":
            before = visits[i - 1]
            at = _holding(spaces, before.contacts, visit.contacts, piece.goal, scale)
            if at is None:
                move = sum(c.piece.progress[0] == 0.0 for c in claims[: visit.claim + 1])  # from 1
                spaces.append(space_at(assembly, f"move {move}", *_arrival(piece), scale))
                at = _holding(spaces[-1:], before.contacts, visit.contacts, piece.goal, scale)
                at = None if at is None else len(spaces) - 1
            visits[i] = replace(visit, change="unexplained") if at is None else _held(visit, at, spaces)
            visits[i - 1] = before if at is None else _held(before, at, spaces)
        elif visit.change == "left":
            before = visits[i - 1]
            at = _holding(spaces, visit.contacts, before.contacts, piece.start, scale)
            visits[i] = replace(visit, change="unexplained") if at is None else _held(visit, at, spaces)
    added: dict[Piece, int] = {}
    for i, visit in enumerate(visits):
        last = i == len(visits) - 1
        piece = claims[-1 if last else max(visit.claim, 0)].piece
        if last:
            for at in (at for at, space in enumerate(spaces) if space.near(piece.goal, scale)):
                visits[i] = _held(visits[i], at, spaces)
        if not visits[i].spaces:
            # Neither made nor left by making a contact: between two rims.
            if piece not in added:
                added[piece] = len(spaces)
                spaces.append(space_at(assembly, f"segment {visit.claim}", *_arrival(piece), scale))
            visits[i] = _held(visit, added[piece], spaces)
    return Visited(tuple(spaces), tuple(visits))


def _holding(
    spaces: Sequence[Space], fewer: frozenset[str], more: frozenset[str], pose: Pose, scale: Scale
) -> int | None:
    """The first space near a pose in which the one state is a father of the other, with fewer contacts."""
    for i, space in enumerate(spaces):
        father, son = space.state(fewer), space.state(more)
        if father is not None and son in space.graph.sons[father] and space.near(pose, scale):
            return i
    return None


def _held(visit: StateVisit, at: int, spaces: Sequence[Space]) -> StateVisit:
    """The visit with a space that holds it, if it does."""
    state = spaces[at].state(visit.contacts)
    if state is None or at in visit.spaces:
        return visit
    return replace(visit, spaces=(*visit.spaces, at), states=(*visit.states, state))


def _arrival(piece: Piece) -> tuple[Pose, list[Pose]]:
    """The pose in which a contact is made, and poses shortly before."""
    x = piece.goal.local(piece.start)
    return piece.goal, [piece.goal.moved(share * x) for share in _BACK]


def _visits(assembly: Assembly, pieces: Sequence[Piece]) -> list[StateVisit]:
    """The states of a motion without their spaces."""
    found = [StateVisit(_touching(assembly, pieces[0].start, pieces[0].start), -1, "start")]
    for k, piece in enumerate(pieces):
        if piece.left and piece.progress[0] == 0.0:
            found.append(StateVisit(found[-1].contacts - {c.id for c in piece.left}, k, "left"))
        after = _touching(assembly, piece.goal, piece.start)
        along = after - frozenset(c.id for c in piece.making if piece.last)
        found += [StateVisit(state, k, change) for change, state in _passed(assembly, piece, found[-1].contacts, along)]
        if after != along:
            found.append(StateVisit(after, k, "made"))
    return found


def _touching(assembly: Assembly, pose: Pose, start: Pose) -> frozenset[str]:
    """The contacts that touch at a pose; on the end of a face or an edge one counts if it did so at the start."""
    body, fixed = assembly.moving.polyhedron, assembly.fixed.polyhedron
    near = near_contacts(body, fixed, pose, _NEAR, _TURNED)
    met = list(compress(near, np.abs(Surfaces.of(near, body, fixed).values(pose)) <= INSIDE))
    inside = BoundTable.of(met, body, fixed, pose).insides(pose)
    doubtful = list(compress(met, np.abs(inside) <= INSIDE))
    found = (*compress(met, inside > INSIDE), *touching(doubtful, body, fixed, start))
    return frozenset(contact.id for contact in found)


def _passed(
    assembly: Assembly, piece: Piece, before: frozenset[str], after: frozenset[str]
) -> list[tuple[str, frozenset[str]]]:
    """The states into which a piece of motion comes by passing rims, and whether each change is one: passed or not."""
    if before == after:
        return []
    middle = _on_the_way(assembly, piece, 0.5)
    x = piece.start.local(piece.goal)
    reach, angle = float(np.linalg.norm(x[:3])) + _NEAR, float(np.linalg.norm(x[3:])) + _TURNED
    near = near_contacts(assembly.moving.polyhedron, assembly.fixed.polyhedron, middle, reach, angle)
    return _between(assembly, piece, near, (0.0, before), (1.0, after))


def _between(
    assembly: Assembly, piece: Piece, near: Sequence[PrimitiveContact], low: _Reached, high: _Reached
) -> list[tuple[str, frozenset[str]]]:
    """The changes of state between two shares of a piece, each narrowed down to a pose."""
    (a, before), (b, after) = low, high
    if before == after:
        return []
    body, fixed = assembly.moving.polyhedron, assembly.fixed.polyhedron
    pose = _on_the_way(assembly, piece, 0.5 * (a + b))
    if b - a < _NARROW:
        exchanged = [contact for contact in near if contact.id in before | after]
        level = np.abs(Surfaces.of(exchanged, body, fixed).values(pose)).max(initial=0.0)
        ends = [contact for contact in exchanged if contact.id in before ^ after]
        ending = np.abs(BoundTable.of(ends, body, fixed, pose).insides(pose)).max(initial=0.0)
        complete = before | after <= {contact.id for contact in near}
        return [("passed" if complete and max(level, ending) <= _COMMON else "unexplained", after)]
    state = frozenset(contact.id for contact in touching(near, body, fixed, pose, 0.0))
    middle = (0.5 * (a + b), state)
    return _between(assembly, piece, near, low, middle) + _between(assembly, piece, near, middle, high)


def _on_the_way(assembly: Assembly, piece: Piece, share: float) -> Pose:
    """The nominal pose after a share of a piece, its contacts held."""
    there = Poses.around(piece.start, share * piece.start.local(piece.goal)[None])
    return (onto(assembly, there, piece.basis, piece.held) if piece.basis else there).pose(0)
