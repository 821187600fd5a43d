"""Local contact spaces: around the critical poses of the nominal path, and where a motion makes its contacts.

Each holds the contacts near its pose, their states in the linear picture, and what the true surfaces say of these.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import chain
from typing import Any

import numpy as np

from fmopt.certificate.knowledge import Assembly
from fmopt.contact.bounds import INSIDE, BoundTable, cell, touching
from fmopt.contact.confirm import Confirmation, Verdict, confirm
from fmopt.contact.graph import ContactGraph, contact_graph
from fmopt.contact.polytope import Faces
from fmopt.contact.primitive import PrimitiveContact, near_contacts
from fmopt.contact.space import LocalSpace, faces, local_space
from fmopt.errors import SolverError
from fmopt.nominal.critical import CriticalPose
from fmopt.se3 import Pose
from fmopt.values import Array

_STEP = 1e-3  # m; off the plane in which a face ends: there the part has just entered, or is about to leave
_WIDE = 10.0  # how much farther than its contacts are looked for a space at a critical pose reaches
_CONTACTS = 40  # near a pose; states of more are not enumerated: their number grows like a power of that of contacts
_STATES = 1000  # in one space, which are confirmed one by one; of more only free space is told
_MANY = 300  # states that are written into a plan for one space; of more, those near the motion


@dataclass(frozen=True, eq=False)
class Scale:
    """What a local space is measured in: the clearance a side and the characteristic length ρ, both in m."""

    clearance: float
    rho: float

    @property
    def reach(self) -> float:
        """How far off contacts are looked for, m."""
        return 3.0 * self.clearance

    @property
    def angle(self) -> float:
        """How far turned contacts are looked for, rad."""
        return self.reach / self.rho


@dataclass(frozen=True, eq=False)
class Space:
    """A local contact space: its name, the pose (6,) that it belongs to, its states, and what was found of each.

    Where there are too many contacts or states, or they lie awkwardly, states are not `enumerated`: only free space is.
    """

    name: str
    pose: Array
    graph: ContactGraph
    found: tuple[Confirmation, ...]
    enumerated: bool

    def state(self, contacts: frozenset[str]) -> int | None:
        """The confirmed state with exactly these contacts, None without."""
        index = self._places.get(contacts)
        return index if index is not None and self.found[index].verdict is Verdict.CONFIRMED else None

    @cached_property
    def _places(self) -> dict[frozenset[str], int]:
        """The states by their contacts."""
        return {frozenset(state.contacts): i for i, state in enumerate(self.graph.states)}

    def near(self, pose: Pose, scale: Scale) -> bool:
        """Whether a pose is as near as contacts are to the space's own pose, or to where it was linearised."""
        for own in (Pose.from_vector(self.pose), self.graph.space.pose):
            x = np.abs(own.local(pose))
            if x[:3].max() <= scale.reach and x[3:].max() <= scale.angle:
                return True
        return False

    def record(self) -> dict[str, Any]:
        """The plan's entry among `critical_points`."""
        verdicts = [confirmation.verdict for confirmation in self.found]
        return {
            "name": self.name,
            "pose": self.pose,
            "pcs": [c.id for c in self.graph.space.contacts],
            "enumerated": self.enumerated,
            "states_by_dimension": {str(d): n for d, n in sorted(self.graph.count().items())},
            "states_confirmed": verdicts.count(Verdict.CONFIRMED),
            "states_by_verdict": {verdict.name.lower(): verdicts.count(verdict) for verdict in Verdict},
        }

    def document(self, chosen: Sequence[int]) -> dict[str, Any]:
        """The plan's entry among `graphs`, with states that a motion goes through; large graphs only near those."""
        graph = self.graph
        kept = _near(graph, chosen)
        place = {state: i for i, state in enumerate(kept)}
        return {
            "critical_point": self.name,
            "states": [
                {"id": s.id, "contacts": sorted(s.contacts), "dimension": s.dimension}
                for s in (graph.states[i] for i in kept)
            ],
            "sons": [[place[j] for j in graph.sons[i] if j in place] for i in kept],
            "verdicts": [self.found[i].verdict.name.lower() for i in kept],
            "chosen": [place[i] for i in chosen],
        }


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
    """The contact spaces around the critical poses of the nominal path.

    Args:
        assembly: the two parts.
        critical: the critical poses in the order of the motion, its end the last.
        scale: units of lengths and angles.
    """
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

    Args:
        assembly: the two parts.
        name: of the space.
        pose: the pose that it belongs to.
        aside: poses near it to linearise at instead.
        scale: units of lengths and angles.
        wide: how many times farther than contacts are looked for the space reaches.
    """
    body, fixed = assembly.moving.polyhedron, assembly.fixed.polyhedron
    for reference in (pose, *aside):
        near = near_contacts(body, fixed, reference, scale.reach, scale.angle)
        if _regular(assembly, near, reference):
            break
    kept, limits = cell(near, body, fixed, reference, scale.reach + scale.angle * scale.rho)
    box = wide * scale.reach, wide * scale.angle
    space = local_space(kept, body, fixed, reference, scale.clearance, scale.rho, limits, *box)
    states = _enumerated(space)
    graph = contact_graph(space, _free_alone(len(kept)) if states is None else states)
    return Space(name, pose.vector(), graph, confirm(graph, body, fixed), states is not None)


def _enumerated(space: LocalSpace) -> Faces | None:
    """All faces of a space; None where there are too many of them or of contacts, or Qhull cannot tell them apart."""
    if len(space.contacts) > _CONTACTS:
        return None
    try:
        found = faces(space)
    except SolverError:
        return None
    return found if len(found.points) <= _STATES else None


def _free_alone(contacts: int) -> Faces:
    """Free space as the only face: all that is said of a space whose states are not enumerated."""
    return Faces(np.zeros((1, contacts), dtype=np.bool_), np.full(1, 6), np.zeros((1, 6)), 0)


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
