"""The plan file of a controlled motion, drawn up from what the stages found: claims are its segments."""

import math
from collections import abc
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fmopt import __version__, plan
from fmopt.certificate.assembly import Assembly
from fmopt.certificate.claim import Claim, ContactClaim
from fmopt.certificate.error_set import ErrorSet
from fmopt.certificate.segment_linearisation import Tolerance
from fmopt.certificate.separating_plane import Separation
from fmopt.contact.primitive import Kind, PrimitiveContact
from fmopt.geometry.exact_coordinates import Exact, exact_vertices, facing_directions
from fmopt.geometry.part import Part
from fmopt.geometry.polyhedron import Polyhedron
from fmopt.papers.lee_huang import mapping
from fmopt.papers.lee_huang.hand_position_force import hand_motion, position_force
from fmopt.papers.lee_huang.nominal_trajectory import CriticalPose, NominalTrajectory
from fmopt.plan import description
from fmopt.plan.description import Description, Search
from fmopt.plan.diagnostics import Diagnostics, ErrorTolerance, Interval, Planar, SourceContribution
from fmopt.plan.field_types import numbers
from fmopt.plan.position_force import contact_forces
from fmopt.planning.control.controlled_motion import ControlledMotion
from fmopt.planning.control.recovery import recovery_record
from fmopt.planning.robustness.state_trace import Visited
from fmopt.planning.search.symmetry import Searched
from fmopt.task.object_model.command import Answer
from fmopt.task.problem import Problem


@dataclass(frozen=True, eq=False)
class NominalMotion:
    """P(t), S(t) and the critical poses along it; the task, and the T-C mapping on the planes that P(t) comes from."""

    path: NominalTrajectory
    critical: tuple[CriticalPose, ...]
    freedoms: tuple[Interval, ...]
    task: Answer
    planes: mapping.Mapping


@dataclass(frozen=True, eq=False)
class Described:
    """What a plan tells besides its proof; what could not be found is None, and a note says why."""

    task: Answer
    nominal: NominalMotion | None = None
    states: Visited | None = None
    measured: ErrorTolerance | None = None
    notes: tuple[str, ...] = ()


def proof_document(problem: Problem, motion: ControlledMotion) -> dict[str, Any]:
    """What of a plan file its verdict rests on, which is still open: geometry, errors, segments with their control."""
    described = Description(search=_search(motion.motion.found), tcp=numbers(problem.tcp))
    return dict(plan.clean({**_proof(problem, motion), "description": described.record()}))


def _proof(problem: Problem, motion: ControlledMotion) -> dict[str, Any]:
    """See `proof_document`."""
    done = motion.motion
    tolerance, claims, segments = done.tolerance, done.claims, _segments(motion)
    contacts = {c.id: c for claim in claims for c in (*claim.piece.held, *claim.piece.goal_contacts)}
    return {
        **heading(
            problem, tolerance, done.errors, done.clearance.per_side, exact_parts(done.assembly, contacts.values())
        ),
        "goal": segments[-1]["goal"],
        "not_covered": plan.NOT_COVERED_OFF_FORM if done.assembly.form else plan.NOT_COVERED,
        "contacts": [contact_record(contacts[name]) for name in sorted(contacts)],
        "segments": segments,
    }


def heading(
    problem: Problem,
    tolerance: Tolerance,
    errors: ErrorSet,
    clearance: float,
    exact: Sequence[abc.Mapping[int, Exact]] = ({}, {}),
) -> dict[str, Any]:
    """What every plan file states of its problem, its verdict still open, under errors at the start.

    The clearance is as measured, a side, m; exact coordinates are of the moving and of the fixed part, by vertex.
    """
    declared = problem.declared_clearance
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
            **_frames(problem, errors),
        },
        "specification": problem.specification.record(),
        "touch_tolerance": 1e-9,
        "parts": {
            side: {
                **part_record(part, declared, clearance, fractions),
                **({} if mated is None else {"found": mated.record()}),
            }
            for side, part, fractions, mated in zip(
                ("moving", "fixed"), (problem.moving, problem.fixed), exact, problem.mated, strict=True
            )
        },
    }


def _search(found: Searched) -> Search:
    states = [
        description.SearchedState(
            moves=state.names,
            contacts=tuple(sorted(contact.id for contact in state.held)),
            freedoms=state.rank,
            margin=state.margin,
            expanded=state.expanded,
            origin=state.origin,
            cost=state.cost if math.isfinite(state.cost) else None,
        )
        for state in found.states
    ]
    return Search(
        objective="transitions + signature + danger",
        cost=found.cost,
        lower_bound=found.lower_bound,
        states_expanded=found.expanded,
        moves=found.names,
        heading=found.heading,
        states=tuple(states),
        way=found.way if states else (),
    )


def _frames(problem: Problem, errors: ErrorSet) -> dict[str, Any]:
    """In which frames the start errors are fixed, where not all of them are in the world."""
    if errors.linkage is None:
        return {}
    boxes = zip(("hole", "hand", "world"), problem.framing.parts(problem.start_box), strict=True)
    return {"sources": [{"frame": frame, "box": box} for frame, box in boxes if box.any()]}


def plan_document(problem: Problem, told: Described, motion: ControlledMotion) -> dict[str, Any]:
    """The plan file of a finished placement, its verdict still open."""
    proof, done = _proof(problem, motion), motion.motion
    claims, segments, states = done.claims, proof["segments"], told.states
    recovery, unplanned = recovery_record(
        done.assembly, claims, segments, problem.start_box, problem.specification, done.tolerance.rho
    )
    described = Description(
        search=_search(done.found),
        tcp=numbers(problem.tcp),
        **({} if told.nominal is None else _nominal(problem, told.nominal, done.tolerance.rho)),
        critical_points=() if states is None else states.critical_points(),
        places=() if states is None else tuple(states.space_of(k) for k in range(len(segments))),
        diagnostics=replace(_diagnostics(problem, told, motion, segments), unplanned=unplanned),
    )
    return dict(plan.clean({**proof, "recovery": recovery, "description": described.record()}))


def _nominal(problem: Problem, found: NominalMotion, rho: float) -> dict[str, Any]:
    """The nominal trajectory with S(t), Pa and Fa."""
    nodes, times = tuple(map(numbers, found.path.nodes)), numbers(found.path.times)
    rows = position_force(found.path, found.freedoms, contact_forces(problem.specification, rho))
    return {"nominal": description.Nominal(nodes, times, found.freedoms), "position_force": rows}


def _diagnostics(
    problem: Problem, told: Described, motion: ControlledMotion, segments: list[dict[str, Any]]
) -> Diagnostics:
    nominal, states, done = told.nominal, told.states, motion.motion
    # None where nothing stops the part.
    x, y = (0.5 * play if math.isfinite(play) else None for play in done.clearance.play)
    return Diagnostics(
        graphs=() if states is None else states.graphs(),
        sequence=() if states is None else states.sequence(),
        diagrams=() if nominal is None else mapping.diagrams(nominal.planes, problem.peg.length),
        freedom_on_planes=() if nominal is None else nominal.planes.freedoms,
        budget=tuple(
            SourceContribution(share.source, share.symbol, numbers(share.box), share.frame) for share in problem.budget
        ),
        measured_clearance=(x, y),
        imported=tuple(map(plan.line, (*problem.moving.notes, *problem.fixed.notes))),
        notes=tuple(map(plan.line, told.notes)),
        hand=hand_motion(told.task, segments),
        tolerated=told.measured,
        planar=None if nominal is None else _in_the_plane(problem, nominal, done.claims),
    )


def _in_the_plane(problem: Problem, nominal: NominalMotion, claims: tuple[Claim, ...]) -> Planar | None:
    """What the planar sets of possible contact say of a planar problem's plan; nothing in space."""
    if problem.plane is None:
        return None
    from fmopt.papers.basanez_suarez import account as planar

    path = planar.in_plane(nominal.path.nodes)
    stops = tuple((i.start, i.end, any(i.s[axis] for axis in (0, 2, 4))) for i in nominal.freedoms)  # x, z, about y
    run = []
    for claim in claims:
        ends = claim.advance.ends
        supports = [ends.start_set.support(np.eye(6)), ends.goal_set.support(np.eye(6))]
        poses = np.array([claim.piece.start.vector(), claim.piece.goal.vector()])
        run.append(planar.PlanarWay(planar.in_plane(poses), *planar.reach_of(np.maximum(*supports))))
    return planar.account(
        problem.plane.moving, problem.plane.fixed, planar.PlanarPath(path, nominal.path.times, stops), run
    )


def _segments(motion: ControlledMotion) -> list[dict[str, Any]]:
    claims = motion.motion.claims
    # One vector a pose: a segment starts with the very digits with which the one before it ends.
    poses = [claims[0].piece.start.vector(), *(claim.piece.goal.vector() for claim in claims)]
    return [
        {**segment_record(piece.claim, piece.move, poses[k], poses[k + 1]), "hybrid": piece.document()}
        for k, piece in enumerate(motion.pieces)
    ]


def part_record(
    part: Part, declared: tuple[float, float] | None, measured: float, exact: abc.Mapping[int, Exact] | None = None
) -> dict[str, Any]:
    """A part as the plan file holds it, with its clearance a side, m: along x and y if declared, the least as measured.

    Vertices whose exact coordinates are no floats have these beside them, as fractions.
    """
    shapes: dict[str, Any] = {**_shape(part.polyhedron), "pieces": [_shape(piece) for piece in part.pieces]}
    if part.form:
        shapes["form"] = part.form
    if part.polyhedron.balls:
        shapes["balls"] = [{"vertex": n, "radius": radius} for n, radius in part.polyhedron.balls]
    if exact:
        shapes["exact"] = [{"vertex": n, "at": [str(x) for x in exact[n]]} for n in sorted(exact)]
    clearances = {"declared_clearance": declared, "measured_clearance": measured}
    return dict(plan.clean({"name": plan.line(part.name), **shapes, **clearances}))


def exact_parts(
    assembly: Assembly, contacts: abc.Iterable[PrimitiveContact]
) -> tuple[dict[int, Exact], dict[int, Exact]]:
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
    features = {"moving": {"vertices": contact.moving}, "fixed": {"vertices": contact.fixed}}
    return dict(plan.clean({"id": contact.id, "kind": str(contact.kind), **features}))


def segment_record(claim: Claim, move: int, start: Any, goal: Any) -> dict[str, Any]:
    """A claim between poses (6,), as its neighbours have them, as a segment of the plan file without its strategy."""
    piece, extent = claim.piece, claim.advance.ends.extent
    made = piece.made
    found = {
        "kind": "guarded_move",
        "move": move,
        "state": [c.id for c in piece.held],
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
        "tube": {"theta_max": extent.theta, "offset_box": extent.offset, "angle_box": extent.angles},
        "separations": [_separation(*item) for item in claim.separations],
        "contacts": [_contact(c) for c in claim.contacts],
    }
    return dict(plan.clean(found))


def _separation(moving: int, fixed: int, found: Separation) -> dict[str, Any]:
    witness: dict[str, Any] = {"kind": found.witness.kind, "moving": found.witness.moving, "fixed": found.witness.fixed}
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
