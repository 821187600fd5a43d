"""The plan file of a controlled motion, drawn up from what the stages found: claims are its segments."""

from __future__ import annotations

import math
from collections import abc
from dataclasses import dataclass
from typing import Any

import numpy as np

from fmopt import __version__, plan
from fmopt.certificate.assembly import Assembly
from fmopt.certificate.claim import Claim, ContactClaim
from fmopt.certificate.error_set import ErrorSet
from fmopt.certificate.remainder import Ends
from fmopt.certificate.separating_plane import Separation
from fmopt.contact.primitive import Kind, PrimitiveContact
from fmopt.geometry.exact_coordinates import Exact, exact_vertices, facing_directions
from fmopt.geometry.part import Part
from fmopt.geometry.polyhedron import Polyhedron
from fmopt.papers.lee_huang.hand_position_force import hand_record, position_force
from fmopt.papers.lee_huang.mapping import Mapping, diagnostics
from fmopt.papers.lee_huang.nominal_trajectory import CriticalPose, FreedomInterval, NominalTrajectory
from fmopt.plan.position_force import contact_forces
from fmopt.planning.control.controlled_motion import ControlledMotion
from fmopt.planning.control.recovery import recovery_record
from fmopt.planning.robustness.error_tolerance import ErrorTolerance
from fmopt.planning.robustness.state_trace import Visited
from fmopt.planning.search.symmetry import SearchedState
from fmopt.task.object_model.command import Answer
from fmopt.task.problem import Problem


@dataclass(frozen=True, eq=False)
class Nominal:
    """P(t), S(t) and the critical poses along it; the task, and the T-C mapping on the planes that P(t) comes from."""

    path: NominalTrajectory
    critical: tuple[CriticalPose, ...]
    freedoms: tuple[FreedomInterval, ...]
    task: Answer
    planes: Mapping


@dataclass(frozen=True, eq=False)
class Described:
    """What a plan tells besides its proof; what could not be found is None, and a note says why.

    Args:
        task: as the knowledge base answers it.
        nominal: trajectory, S(t) and critical poses.
        states: the contact states on the way.
        measured: how much error the motion tolerates.
        notes: what is left out, and why.
    """

    task: Answer
    nominal: Nominal | None = None
    states: Visited | None = None
    measured: ErrorTolerance | None = None
    notes: tuple[str, ...] = ()


def proof_document(problem: Problem, motion: ControlledMotion) -> dict[str, Any]:
    """What of a plan file its verdict rests on, which is still open: geometry, errors, segments with their control.

    Args:
        problem: checked.
        motion: with its control.
    """
    return dict(plan.clean(_proof(problem, motion)))


def _proof(problem: Problem, motion: ControlledMotion) -> dict[str, Any]:
    """See `proof_document`."""
    done = motion.motion
    tolerance, found, claims, segments = done.tolerance, done.found, done.claims, _segments(motion)
    contacts = {c.id: c for claim in claims for c in (*claim.piece.held, *claim.piece.goal_contacts)}
    declared, clearance = problem.declared_clearance, done.clearance.per_side
    own, other = exact_parts(done.assembly, contacts.values())
    return {
        "format": plan.FORMAT,
        "fmopt_version": __version__,
        "problem": {"title": problem.title, "sha256": problem.sha256},
        "units": plan.UNITS,
        "frames": plan.FRAMES,
        "verdict": "NOT_PROVED",
        "uncertainty": {
            "start_box": problem.start_box,
            "velocity_error": tolerance.velocity_error,
            "rho": tolerance.rho,
            **_frames(problem, done.errors),
        },
        "specification": problem.specification.record(),
        "goal": segments[-1]["goal"],
        "touch_tolerance": 1e-9,
        "not_covered": plan.NOT_COVERED_OFF_FORM if done.assembly.form else plan.NOT_COVERED,
        "parts": {
            "moving": {**part_record(problem.moving, declared, clearance, own), **_found(problem, 0)},
            "fixed": {**part_record(problem.fixed, declared, clearance, other), **_found(problem, 1)},
        },
        "contacts": [contact_record(contacts[name]) for name in sorted(contacts)],
        "segments": segments,
        "search": {
            "objective": "transitions + signature + danger",
            "cost": found.cost,
            "lower_bound": found.lower_bound,
            "gap": found.cost - found.lower_bound,
            "states_expanded": found.expanded,
            "moves": found.names,
            "heading": found.heading,
            **({"states": [_searched(state) for state in found.states], "way": found.way} if found.states else {}),
        },
    }


def _searched(state: SearchedState) -> dict[str, Any]:
    """A state that the search came to, as the plan file holds it."""
    return {
        "from": state.origin,
        "moves": state.names,
        "contacts": sorted(contact.id for contact in state.held),
        "freedoms": state.rank,
        "cost": state.cost if math.isfinite(state.cost) else None,
        "margin": state.margin,
        "expanded": state.expanded,
    }


def _frames(problem: Problem, errors: ErrorSet) -> dict[str, Any]:
    """In which frames the start errors are fixed, where not all of them are in the world."""
    if errors.linkage is None:
        return {}
    boxes = zip(("hole", "hand", "world"), problem.framing.parts(problem.start_box), strict=True)
    sources = [{"frame": frame, "box": box} for frame, box in boxes if box.any()]
    return {"sources": sources}


def plan_document(problem: Problem, told: Described, motion: ControlledMotion) -> dict[str, Any]:
    """The plan file of a finished placement, its verdict still open.

    Args:
        problem: the task.
        told: what it tells besides its proof.
        motion: the motion with its control.
    """
    proof, done = _proof(problem, motion), motion.motion
    claims, segments = done.claims, proof["segments"]
    if told.states is not None:
        segments = [{**item, "critical_point": told.states.space_of(k)} for k, item in enumerate(segments)]
    document = {
        **proof,
        "segments": segments,
        **({} if told.nominal is None else _nominal(problem, told.nominal, done.tolerance.rho)),
        **({} if told.states is None else {"critical_points": told.states.records()}),
        "recovery": recovery_record(
            done.assembly, claims, segments, problem.start_box, problem.specification, done.tolerance.rho
        ),
        "diagnostics": {
            "graphs": [] if told.states is None else told.states.graphs(),
            "sequence": [] if told.states is None else told.states.sequence(),
            **(
                {"diagrams": [], "freedom_on_planes": []}
                if told.nominal is None
                else diagnostics(told.nominal.planes, problem.peg.length)
            ),
            **hand_record(told.task, segments),
            "budget": [share.record() for share in problem.budget],
            "clearance": {"measured": [_side(play) for play in done.clearance.play]},
            **(
                {"imported": notes}
                if (notes := [*map(plan.line, (*problem.moving.notes, *problem.fixed.notes))])
                else {}
            ),
            **({"notes": [*map(plan.line, told.notes)]} if told.notes else {}),
            **({} if told.measured is None else {"tolerated": told.measured.record()}),
            **({} if told.nominal is None else _in_the_plane(problem, told.nominal, claims)),
        },
    }
    return dict(plan.clean(document))


def _nominal(problem: Problem, found: Nominal, rho: float) -> dict[str, Any]:
    """The nominal trajectory with S(t), Pa and Fa."""
    rows = position_force(found.path, found.freedoms, contact_forces(problem.specification, rho))
    return {
        "nominal": {
            "nodes": found.path.nodes,
            "times": found.path.times,
            "intervals": [{"t0": i.start, "t1": i.end, "s": i.s} for i in found.freedoms],
        },
        "position_force": [row.document() for row in rows],
    }


def _side(play: float) -> float | None:
    """The clearance on each of two sides with so much play between them, m; None where nothing stops the part."""
    return 0.5 * play if math.isfinite(play) else None


def _in_the_plane(problem: Problem, nominal: Nominal, claims: tuple[Claim, ...]) -> dict[str, Any]:
    """What the planar sets of possible contact say of a planar problem's plan; nothing in space."""
    if problem.plane is None:
        return {}
    from fmopt.papers.basanez_suarez import account as planar

    path = planar.in_plane(nominal.path.nodes)
    stops = tuple((i.start, i.end, any(i.s[axis] for axis in (0, 2, 4))) for i in nominal.freedoms)  # x, z, about y
    run = []
    for claim in claims:
        ends = claim.advance.ends
        supports = [ends.start_set.support(np.eye(6)), ends.goal_set.support(np.eye(6))]
        poses = np.array([claim.piece.start.vector(), claim.piece.goal.vector()])
        run.append(planar.Stretch(planar.in_plane(poses), *planar.reach_of(np.maximum(*supports))))
    found = planar.account(
        problem.plane.moving, problem.plane.fixed, planar.Nominal(path, nominal.path.times, stops), run
    )
    return {"planar": found}


def _segments(motion: ControlledMotion) -> list[dict[str, Any]]:
    claims = motion.motion.claims
    # One vector a pose: a segment starts with the very digits with which the one before it ends.
    poses = [claims[0].piece.start.vector(), *(claim.piece.goal.vector() for claim in claims)]
    found: list[dict[str, Any]] = []
    for k, piece in enumerate(motion.pieces):
        record = segment_record(piece.claim, 0, piece.move, poses[k], poses[k + 1], motion.motion.tolerance.rho)
        found.append({**record, "hybrid": piece.document()})
    return found


def _found(problem: Problem, number: int) -> dict[str, Any]:
    """How a part mates, where that was found; nothing where the files state it."""
    mated = problem.mated[number]
    return {} if mated is None else {"found": mated.record()}


def part_record(
    part: Part, declared: tuple[float, float] | None, measured: float, exact: abc.Mapping[int, Exact] | None = None
) -> dict[str, Any]:
    """A part as the plan file holds it.

    Vertices whose exact coordinates are no floats have these beside them, as fractions.

    Args:
        part: in its frame.
        declared: clearance a side along x and y, m; None where none was.
        measured: least clearance a side, m.
        exact: by vertex, where coordinates are no floats.
    """
    shapes: dict[str, Any] = {**_shape(part.polyhedron), "pieces": [_shape(piece) for piece in part.pieces]}
    if part.form:
        shapes["form"] = part.form
    if part.polyhedron.balls:
        shapes["balls"] = [{"vertex": n, "radius": radius} for n, radius in part.polyhedron.balls]
    if exact:
        shapes["exact"] = [{"vertex": n, "at": [str(x) for x in exact[n]]} for n in sorted(exact)]
    record: dict[str, Any] = plan.clean(
        {"name": plan.line(part.name), **shapes, "declared_clearance": declared, "measured_clearance": measured}
    )
    return record


def exact_parts(
    assembly: Assembly, contacts: abc.Iterable[PrimitiveContact]
) -> tuple[dict[int, Exact], dict[int, Exact]]:
    """Exact coordinates of vertices of the moving and of the fixed part that are not in their faces' planes in floats.

    Walls that contacts are on are made exactly parallel to the faces that lie flat in them, which they are but for
    rounding: else a part could not lie in two of them at once, as it does.

    Args:
        assembly: the parts.
        contacts: that the plan lists.

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
    record: dict[str, Any] = plan.clean(
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
        "clearance": plan.rounded_down(claim.clearance),
        "margin": plan.rounded_down(claim.margin),
        "binding_contact": claim.binding,
        "basis": [
            {"contact": c.contact.id, "direction": c.direction, "made": made is not None and c.contact.id == made.id}
            for c in claim.advance.basis
        ],
        "tube": _tube(ends, rho),
        "separations": [_separation(*item) for item in claim.separations],
        "contacts": [_contact(c) for c in claim.contacts],
    }
    record: dict[str, Any] = plan.clean(found)
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
        # As matrices, which the check can compare: of roots there are many to one matrix.
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
    return {"moving_piece": moving, "fixed_piece": fixed, "witness": witness, "margin": plan.rounded_down(found.margin)}


def _contact(c: ContactClaim) -> dict[str, Any]:
    return {
        "id": c.contact.id,
        "role": c.role,
        "normal": c.normal,
        "offset": c.offset,
        "remainder": c.remainder * (1.0 + 1e-12),  # upwards: the check wants no less than what it derives
        "margin": plan.rounded_down(c.margin),
    }
