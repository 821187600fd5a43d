"""Claims as the segments of a plan file."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from fmopt.certificate.assembly import Assembly
from fmopt.certificate.claim import Claim, ContactClaim
from fmopt.certificate.separation import Ends, Separation
from fmopt.contact.primitive import Kind, PrimitiveContact
from fmopt.geometry.exact import Exact, exact_vertices, facing_directions
from fmopt.geometry.part import Part
from fmopt.geometry.polyhedron import Polyhedron
from fmopt.plan import clean, line, rounded_down


def part_record(
    part: Part, declared: tuple[float, float], measured: float, exact: Mapping[int, Exact] | None = None
) -> dict[str, Any]:
    """A part as the plan file holds it, with the clearance a side that was declared and measured (m).

    Vertices whose exact coordinates are no floats have these beside them, as fractions.
    """
    shapes: dict[str, Any] = {**_shape(part.polyhedron), "pieces": [_shape(piece) for piece in part.pieces]}
    if exact:
        shapes["exact"] = [{"vertex": n, "at": [str(x) for x in exact[n]]} for n in sorted(exact)]
    record: dict[str, Any] = clean(
        {"name": line(part.name), **shapes, "declared_clearance": declared, "measured_clearance": measured}
    )
    return record


def exact_parts(assembly: Assembly, contacts: Iterable[PrimitiveContact]) -> tuple[dict[int, Exact], dict[int, Exact]]:
    """Exact coordinates of vertices of the moving and of the fixed part that are not in their faces' planes in floats.

    Walls that contacts are on are made exactly parallel to the faces that lie flat in them, which they are but for
    rounding: else a part could not lie in two of them at once, as it does.

    Raises:
        GeometryError: there are none next to the floats.
    """
    moving, fixed = assembly.moving.polyhedron, assembly.fixed.polyhedron
    walls = set[int]()
    for contact in contacts:
        if contact.kind is Kind.VERTEX_FACE:
            walls.add(contact.fixed_feature)
        elif contact.kind is Kind.EDGE_EDGE:
            walls.update(fixed.edges[contact.fixed_feature].faces)
    own = exact_vertices(moving)
    return own, exact_vertices(fixed, facing_directions(moving, own, fixed, sorted(walls)))


def _shape(body: Polyhedron) -> dict[str, Any]:
    return {"vertices": body.vertices, "faces": [face.loops for face in body.faces]}


def contact_record(contact: PrimitiveContact) -> dict[str, Any]:
    """A contact as the plan file holds it."""
    record: dict[str, Any] = clean(
        {
            "id": contact.id,
            "kind": str(contact.kind),
            "moving": {"vertices": contact.moving},
            "fixed": {"vertices": contact.fixed},
        }
    )
    return record


def segment_record(claim: Claim, critical_point: int, move: int, start: Any, goal: Any, rho: float) -> dict[str, Any]:
    """A claim as a segment of the plan file, without its control strategy.

    Args:
        claim: what is claimed of the piece.
        critical_point: index of the critical pose in whose contact space the piece runs.
        move: number of the move that the piece belongs to.
        start: pose (6,) at the beginning, exactly as the neighbouring segment has it.
        goal: pose (6,) at the end.
        rho: ρ, m.
    """
    piece, ends = claim.piece, claim.advance.ends
    state = [c.id for c in piece.held]
    made = piece.made
    found = {
        "critical_point": critical_point,
        "move": move,
        "state": state,
        "goal_state": [c.id for c in piece.goal_contacts],
        **({"leaving": [c.id for c in piece.left]} if piece.left else {}),
        "progress": piece.progress,
        "start": start,
        "goal": goal,
        "clearance": rounded_down(claim.clearance),
        "margin": rounded_down(claim.margin),
        "binding_contact": claim.binding,
        "basis": [
            {"contact": c.contact.id, "direction": c.direction, "made": made is not None and c.contact.id == made.id}
            for c in claim.advance.basis
        ],
        "tube": _tube(ends, rho),
        "separations": [_separation(*item) for item in claim.separations],
        "contacts": [_contact(c) for c in claim.contacts],
    }
    record: dict[str, Any] = clean(found)
    return record


def _tube(ends: Ends, rho: float) -> dict[str, Any]:
    start, goal = ends.start_set, ends.goal_set
    return {
        "shape_start": start.shape,
        "shape_goal": goal.shape,
        "generators_start": start.generators,
        "generators_goal": goal.generators,
        "growth_start": start.growth(rho),
        "growth_goal": goal.growth(rho),
        "slide_start": start.slide_root @ start.slide_root.T,
        "slide_goal": goal.slide_root @ goal.slide_root.T,
        "swing_start": start.swing_root @ start.swing_root.T,
        "swing_goal": goal.swing_root @ goal.swing_root.T,
        "theta_max": ends.extent.theta,
        "offset_max": float(np.linalg.norm(ends.extent.offset)) * (1.0 + 1e-12),
        "offset_box": ends.extent.offset,
        "angle_box": ends.extent.angles,
    }


def _separation(moving: int, fixed: int, found: Separation) -> dict[str, Any]:
    witness: dict[str, Any] = {
        "kind": found.witness.kind,
        "moving": found.witness.moving,
        "fixed": found.witness.fixed,
    }
    if found.witness.plane is not None:
        witness |= {"normal": found.witness.plane[:3], "offset": found.witness.plane[3]}
    return {"moving_piece": moving, "fixed_piece": fixed, "witness": witness, "margin": rounded_down(found.margin)}


def _contact(c: ContactClaim) -> dict[str, Any]:
    return {
        "id": c.contact.id,
        "role": c.role,
        "normal": c.normal,
        "offset": c.offset,
        "remainder": c.remainder * (1.0 + 1e-12),
        "margin": rounded_down(c.margin),
    }
