"""Local contact spaces at the critical poses: their contacts, states and graphs, for the plan and its readers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from fmopt.certificate.claim import Claim
from fmopt.certificate.knowledge import Assembly
from fmopt.contact.bounds import cell
from fmopt.contact.confirm import Verdict, confirm
from fmopt.contact.graph import ContactGraph, contact_graph
from fmopt.contact.primitive import near_contacts
from fmopt.contact.space import faces, local_space
from fmopt.nominal.critical import CriticalPose
from fmopt.se3 import Pose

_STEP = 1e-3  # m; the mouth's own plane is no place to linearise at: the tip has just entered


@dataclass(frozen=True, eq=False)
class Spaces:
    """The contact graph at each critical pose, and how many of its states exist on the true surfaces."""

    critical: tuple[CriticalPose, ...]
    found: tuple[ContactGraph, ...]
    confirmed: tuple[int, ...]

    def records(self) -> list[dict[str, Any]]:
        """The plan's `critical_points`."""
        return [
            {
                "name": at.name,
                "pose": at.pose,
                "pcs": [c.id for c in graph.space.contacts],
                "states_by_dimension": {str(d): n for d, n in sorted(graph.count().items())},
                "states_confirmed": sure,
            }
            for at, graph, sure in zip(self.critical, self.found, self.confirmed, strict=True)
        ]

    def graphs(self, claims: Sequence[Claim]) -> list[dict[str, Any]]:
        """The graphs, each with the states that the claims hold near its critical pose."""
        return [
            {
                "critical_point": at.name,
                "states": [
                    {"id": s.id, "contacts": sorted(s.contacts), "dimension": s.dimension} for s in graph.states
                ],
                "sons": graph.sons,
                "chosen": _chosen(graph, [c for c in claims if self._nearest(c) is at]),
            }
            for at, graph in zip(self.critical, self.found, strict=True)
        ]

    def _nearest(self, claim: Claim) -> CriticalPose:
        depth = float(claim.piece.goal.p[2])
        return min(self.critical, key=lambda at: abs(float(at.pose[2]) - depth))


def contact_spaces(assembly: Assembly, critical: tuple[CriticalPose, ...], clearance: float, rho: float) -> Spaces:
    """Enumerates and confirms the contact states around each critical pose.

    Args:
        assembly: the two parts.
        critical: the critical poses.
        clearance: clearance a side, m, the unit of length.
        rho: characteristic length, m.
    """
    graphs, confirmed = [], []
    body, fixed = assembly.moving.polyhedron, assembly.fixed.polyhedron
    for at in critical:
        pose = Pose.from_vector(at.pose)
        if at.name == "mouth":
            pose = pose.moved([0.0, 0.0, -_STEP, 0.0, 0.0, 0.0])
        reach, angle = 3.0 * clearance, 3.0 * clearance / rho
        near = near_contacts(body, fixed, pose, reach, angle)
        kept, limits = cell(near, body, fixed, pose, reach + angle * rho)
        space = local_space(kept, body, fixed, pose, clearance, rho, limits, 10.0 * reach, 10.0 * angle)
        graph = contact_graph(space, faces(space))
        graphs.append(graph)
        confirmed.append(sum(c.verdict is Verdict.CONFIRMED for c in confirm(graph, body, fixed)))
    return Spaces(critical, tuple(graphs), tuple(confirmed))


def _chosen(graph: ContactGraph, claims: Sequence[Claim]) -> list[int]:
    """States of the graph that the claims hold, exactly, in order."""
    states = {frozenset(state.contacts): i for i, state in enumerate(graph.states)}
    chosen: list[int] = []
    for claim in claims:
        for contacts in (claim.piece.held, claim.piece.goal_contacts if claim.piece.last else claim.piece.held):
            found = states.get(frozenset(c.id for c in contacts))
            if found is not None and found not in chosen:
                chosen.append(found)
    return chosen
