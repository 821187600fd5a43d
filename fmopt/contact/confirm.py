"""Contact states of the linear picture confirmed on the true C-surfaces, by Gauss–Newton from a point of the facet."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from fmopt.contact.bounds import BoundTable
from fmopt.contact.graph import ContactGraph, ContactState
from fmopt.contact.space import LocalSpace
from fmopt.contact.surface import Surfaces
from fmopt.geometry.polyhedron import Polyhedron
from fmopt.se3 import Pose
from fmopt.values import Array, Value

RESIDUAL = 1e-9  # clearances; a contact this close to touching touches
APART = 1e-6  # clearances; a contact further than this is apart
STEPS = 12


class Verdict(StrEnum):
    """What the true surfaces say of a state; the value is the advice."""

    CONFIRMED = "the state exists: its contacts touch, the others are apart, all within bounds"
    SPLIT = "its contacts meet in no pose: the curvature of the surfaces parts them by the residual; drop one of them"
    BLOCKED = "another contact is violated where its contacts meet; linearise at a nearer pose"
    OUT_OF_BOUNDS = "its contacts meet beyond the end of a face or an edge; linearise at a nearer pose"


@dataclass(frozen=True, eq=False)
class Confirmation(Value):
    """A state on the true surfaces.

    Attributes:
        state: id of the state.
        verdict: whether it exists.
        pose: the pose found.
        residual: largest |f| of its contacts there, m.
        clearance: least f of the other contacts within their bounds, m; inf when there are none.
        inside: how far the pose is inside the bounds of its contacts, m; inf when there are none.
    """

    state: str
    verdict: Verdict
    pose: Pose
    residual: float
    clearance: float
    inside: float


def confirm(graph: ContactGraph, moving: Polyhedron, fixed: Polyhedron) -> tuple[Confirmation, ...]:
    """Every state of the graph taken to its true C-surfaces.

    A state is tried from its own interior point, then from half way to each of its sons: where two surfaces that
    coincide in the linear picture part, only a slice of the facet is real, and its middle may lead past it.

    Args:
        graph: contact states with a point on each linear facet.
        moving: the moving part in its body frame.
        fixed: the fixed part.
    """
    space = graph.space
    surfaces = Surfaces.of(space.contacts, moving, fixed)
    table = BoundTable.of(space.contacts, moving, fixed, space.pose)
    found = []
    for state, sons in zip(graph.states, graph.sons, strict=True):
        first = tried = confirm_state(state, state.point, space, surfaces, table)
        for son in sons:
            if tried.verdict is Verdict.CONFIRMED:
                break
            tried = confirm_state(state, 0.5 * (state.point + graph.states[son].point), space, surfaces, table)
        found.append(tried if tried.verdict is Verdict.CONFIRMED else first)
    return tuple(found)


def confirm_state(
    state: ContactState, start: Array, space: LocalSpace, surfaces: Surfaces, table: BoundTable
) -> Confirmation:
    """One state taken to its true C-surfaces.

    Args:
        state: the state.
        start: where to start, local coordinates (6,) in the local space.
        space: the local space.
        surfaces: C-surface functions of the space's contacts.
        table: their bounds.
    """
    on = np.isin([contact.id for contact in space.contacts], state.contacts)
    tolerance, apart = RESIDUAL * float(space.scale[0]), APART * float(space.scale[0])
    near = project(space.pose.moved(start), on, surfaces, space.scale, 6 - state.dimension)
    pose = project(near, on, surfaces, space.scale, 6)
    gap = float(np.max(np.abs(surfaces.values(near)[on]), initial=0.0))
    f, inside = surfaces.values(pose), table.insides(pose)
    residual = float(np.max(np.abs(f[on]), initial=0.0))
    clearance = float(np.min(f[~on & (inside > 0.0)], initial=np.inf))
    within = float(np.min(inside[on], initial=np.inf))
    if residual <= tolerance and clearance > apart and within > 0.0:
        return Confirmation(state.id, Verdict.CONFIRMED, pose, residual, clearance, within)
    if gap > tolerance:
        f, inside = surfaces.values(near), table.insides(near)
        clearance = float(np.min(f[~on & (inside > 0.0)], initial=np.inf))
        within = float(np.min(inside[on], initial=np.inf))
        return Confirmation(state.id, Verdict.SPLIT, near, gap, clearance, within)
    verdict = Verdict.BLOCKED if clearance <= apart else Verdict.OUT_OF_BOUNDS
    return Confirmation(state.id, verdict, pose, residual, clearance, within)


def project(pose: Pose, on: NDArray[np.bool_], surfaces: Surfaces, scale: Array, rank: int) -> Pose:
    """The pose where |f| of the contacts `on` (k,) is least, by Gauss–Newton with shortest scaled steps.

    Args:
        pose: where to start.
        on: which contacts.
        surfaces: C-surface functions of all contacts.
        scale: scaled units (6,) in which steps are shortest.
        rank: how many singular directions a step may use. The rank of a state's linear picture stays near its facet;
            6 also uses those that only curvature provides.
    """
    for _ in range(STEPS):
        f, N = surfaces.values_and_rows(pose)
        if np.max(np.abs(f[on]), initial=0.0) <= 1e-2 * RESIDUAL * scale[0]:
            break
        U, s, Vt = np.linalg.svd(N[on] * scale, full_matrices=False)
        used = int(np.sum(s[:rank] > 1e-5 * s[0]))
        step = -Vt[:used].T @ ((U[:, :used].T @ f[on]) / s[:used])
        if np.linalg.norm(step) < 1e-13:
            break
        pose = pose.moved(scale * step)
    return pose
