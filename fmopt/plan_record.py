"""The plan file of a finished synthesis, drawn up from what its stages found."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from fmopt import __version__, plan
from fmopt.certificate.claim import Claim
from fmopt.certificate.curvature import Curvature
from fmopt.certificate.functions import contact_rows
from fmopt.certificate.knowledge import Assembly
from fmopt.certificate.record import contact_record, exact_parts, part_record, segment_record
from fmopt.certificate.segment import Tolerance
from fmopt.contact.bounds import BoundTable
from fmopt.contact.primitive import Kind, PrimitiveContact
from fmopt.contact.surface import Surfaces
from fmopt.contact.wrench import contact_normal, contact_point
from fmopt.control.bias import GuardedMove, firmness, steadiness, turns
from fmopt.control.decomposition import contact_forces, position_force
from fmopt.control.hand import hand_record
from fmopt.control.hybrid import hybrid_strategy
from fmopt.control.impact import Meeting, approach_speed, impact_record, slowed
from fmopt.control.jamming import jam_free
from fmopt.control.recovery import recovery_record
from fmopt.errors import InfeasibleError
from fmopt.geometry.clearance import Clearance
from fmopt.geometry.polyhedron import Polyhedron
from fmopt.knowledge.command import Answer
from fmopt.nominal.critical import CriticalPose
from fmopt.nominal.diagram_record import diagnostics
from fmopt.nominal.intervals import FreedomInterval
from fmopt.nominal.mapping import Mapping
from fmopt.nominal.trajectory import NominalTrajectory
from fmopt.placement.search import Searched
from fmopt.placement.sequence import Placed
from fmopt.placement.tolerated import Motion, Tolerated
from fmopt.placement.visited import Visited
from fmopt.se3 import Pose, cross
from fmopt.task.problem import Problem
from fmopt.uncertainty.error_set import ErrorSet
from fmopt.uncertainty.planar import account as planar
from fmopt.values import Array

_NEAR = 4.0  # bounds of its errors before its goal from where on a move is run as if it might meet its contacts
_CLOSED = 1e-12  # m; contacts nearer than this touch


@dataclass(frozen=True, eq=False)
class Nominal:
    """P(t), S(t) and the critical poses along it; the task, and the T-C mapping on the planes that P(t) comes from."""

    path: NominalTrajectory
    critical: tuple[CriticalPose, ...]
    freedoms: tuple[FreedomInterval, ...]
    task: Answer
    planes: Mapping


@dataclass(frozen=True, eq=False)
class Moved:
    """The motion found for a problem, and what it rests on; the problem's specification plays no part in it."""

    assembly: Assembly
    clearance: Clearance
    errors: ErrorSet
    tolerance: Tolerance
    found: Searched
    placed: Placed

    def under(self, problem: Problem, turn: float) -> Motion:
        """The same moves under the errors of a problem, with pieces that turn so far (rad) at most."""
        rates = problem.velocity_error.translation, problem.velocity_error.rotation
        moves, tolerance = self.placed.moves, Tolerance(rates, self.tolerance.rho)
        return Motion(self.assembly, moves, problem.start_box, tolerance, turn, problem.framing)


def proof_document(problem: Problem, done: Moved) -> dict[str, Any]:
    """What of a plan file its verdict rests on, which is still open: geometry, errors, segments with their control.

    Args:
        problem: the task.
        done: the motion.

    Raises:
        InfeasibleError: no bias force holds the contacts.
    """
    return dict(plan.clean(_proof(problem, done)))


def _proof(problem: Problem, done: Moved, *, ranges: bool = False) -> dict[str, Any]:
    """See `proof_document`; with `ranges` also the jam-free ranges of the applied wrenches."""
    tolerance, found, claims = done.tolerance, done.found, done.placed.reached.claims
    segments = _segments(problem, done.assembly, claims, tolerance, ranges=ranges)
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
        "not_covered": plan.NOT_COVERED,
        "parts": {
            "moving": part_record(problem.moving, declared, clearance, own),
            "fixed": part_record(problem.fixed, declared, clearance, other),
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
        },
    }


def _frames(problem: Problem, errors: ErrorSet) -> dict[str, Any]:
    """In which frames the start errors are fixed, where not all of them are in the world."""
    if errors.linkage is None:
        return {}
    boxes = zip(("hole", "hand", "world"), problem.framing.parts(problem.start_box), strict=True)
    sources = [{"frame": frame, "box": box} for frame, box in boxes if box.any()]
    return {"sources": sources}


def plan_document(
    problem: Problem, nominal: Nominal, states: Visited, done: Moved, measured: Tolerated | None = None
) -> dict[str, Any]:
    """The plan file of a finished placement, its verdict still open; errors as of `proof_document`.

    Args:
        problem: the task.
        nominal: trajectory, S(t) and critical poses.
        states: the contact states on the way.
        done: the motion.
        measured: how much error the motion tolerates, where that is to be in the plan.
    """
    proof, claims = _proof(problem, done, ranges=True), done.placed.reached.claims
    segments = [{**segment, "critical_point": states.space_of(k)} for k, segment in enumerate(proof["segments"])]
    rows = position_force(nominal.path, nominal.freedoms, contact_forces(problem.specification, done.tolerance.rho))
    document = {
        **proof,
        "segments": segments,
        "nominal": {
            "nodes": nominal.path.nodes,
            "times": nominal.path.times,
            "intervals": [{"t0": i.start, "t1": i.end, "s": i.s} for i in nominal.freedoms],
        },
        "critical_points": states.records(),
        "position_force": [row.document() for row in rows],
        "recovery": recovery_record(
            done.assembly, claims, segments, problem.start_box, problem.specification, done.tolerance.rho
        ),
        "diagnostics": {
            "graphs": states.graphs(),
            "sequence": states.sequence(),
            **diagnostics(nominal.planes, problem.peg.length),
            **hand_record(nominal.task, segments),
            "budget": [share.record() for share in problem.budget],
            "clearance": {"measured": [_side(play) for play in done.clearance.play]},
            **(
                {"imported": notes}
                if (notes := [*map(plan.line, (*problem.moving.notes, *problem.fixed.notes))])
                else {}
            ),
            **({} if measured is None else {"tolerated": measured.record()}),
            **_in_the_plane(problem, nominal, claims),
        },
    }
    return dict(plan.clean(document))


def _side(play: float) -> float | None:
    """The clearance on each of two sides with so much play between them, m; None where nothing stops the part."""
    return 0.5 * play if math.isfinite(play) else None


def _in_the_plane(problem: Problem, nominal: Nominal, claims: tuple[Claim, ...]) -> dict[str, Any]:
    """What the planar sets of possible contact say of a planar problem's plan; nothing in space."""
    if problem.plane is None:
        return {}
    path = planar.in_plane(nominal.path.nodes)
    stops = tuple((i.start, i.end, any(i.s[axis] for axis in (0, 2, 4))) for i in nominal.freedoms)
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


def _segments(
    problem: Problem, assembly: Assembly, claims: tuple[Claim, ...], tolerance: Tolerance, *, ranges: bool
) -> list[dict[str, Any]]:
    poses = [claims[0].piece.start.vector(), *(claim.piece.goal.vector() for claim in claims)]
    found: list[dict[str, Any]] = []
    move = -1
    for k, (claim, bound) in enumerate(bounded(claims, tolerance.rho)):
        move += claim.piece.progress[0] == 0.0
        record = segment_record(claim, 0, move, poses[k], poses[k + 1], tolerance.rho)
        try:
            hybrid = strategy(problem, assembly, claim, tolerance, bound, ranges=ranges)
        except InfeasibleError as error:
            raise InfeasibleError(f"move {move + 1}: {error.message}", advice=error.advice) from error
        found.append({**record, "hybrid": hybrid})
    return found


def bounded(claims: Sequence[Claim], rho: float) -> Iterator[tuple[Claim, float]]:
    """With each piece how much longer or shorter than planned the way to its end may be, m in the metric of ρ.

    The certificate follows executions that go farther in each piece of a move alike. A robot goes all pieces as far as
    planned but the last, for which the overtravel of all of them is left.
    """
    late = 0.0
    for claim in claims:
        step = claim.advance
        extent = step.ends.extent
        late = step.overtravel * step.length + (late if claim.piece.progress[0] > 0.0 else 0.0)
        yield claim, max(float(np.linalg.norm(extent.offset)) + rho * extent.theta, late)


def strategy(
    problem: Problem, assembly: Assembly, claim: Claim, tolerance: Tolerance, bound: float, *, ranges: bool = False
) -> dict[str, Any]:
    """The control strategy of a piece as the plan file holds it, from the contacts that touch at its goal.

    Its `bound` is the one of `bounded`. With `ranges` it tells the jam-free range of its applied wrench, where it
    holds contacts.

    Raises:
        InfeasibleError: no bias force holds the contacts.
    """
    move, held, made = _guarded(problem, assembly, claim, bound)
    approach = _approach(problem, claim, move, tolerance)
    specification = problem.specification if approach is None else slowed(problem.specification, approach)
    hybrid = hybrid_strategy(move, tolerance.rho, specification)
    document = hybrid.document([c.id for c in held], [c.id for c in made])
    if approach is not None:
        document["impact"] = impact_record(specification, approach)
    free = jam_free(move, hybrid, tolerance.rho, specification) if ranges else None
    return document if free is None else {**document, "jam_free": free.document()}


def runs_against(problem: Problem, assembly: Assembly, claims: Sequence[Claim], tolerance: Tolerance) -> bool:
    """Whether every piece of a motion runs against the contact that ends its move, so that it can be felt."""
    return all(move.approaches for move in _guarded_moves(problem, assembly, claims, tolerance))


def least_firm(problem: Problem, assembly: Assembly, claims: Sequence[Claim], tolerance: Tolerance) -> float:
    """The firmness of the least firm piece of a motion."""
    slides = _guarded_moves(problem, assembly, claims, tolerance, turning=False)
    return min((firmness(move, tolerance.rho, problem.specification) for move in slides), default=1.0)


def least_steady(problem: Problem, assembly: Assembly, claims: Sequence[Claim], tolerance: Tolerance) -> float:
    """The steadiness of the least steady piece of a motion."""
    turned = _guarded_moves(problem, assembly, claims, tolerance, turning=True)
    return min((steadiness(move, tolerance.rho, problem.specification) for move in turned), default=1.0)


def _guarded_moves(
    problem: Problem,
    assembly: Assembly,
    claims: Sequence[Claim],
    tolerance: Tolerance,
    turning: bool | None = None,
) -> Iterator[GuardedMove]:
    """The guarded moves of pieces that go to a contact; of those alone that hold some and turn, or that do not turn."""
    for claim, bound in bounded(claims, tolerance.rho):
        piece = claim.piece
        asked = turning is None or (piece.held and turns(piece.start.local(piece.goal), tolerance.rho) == turning)
        if piece.making and asked:
            yield _guarded(problem, assembly, claim, bound)[0]


def _guarded(
    problem: Problem, assembly: Assembly, claim: Claim, bound: float
) -> tuple[GuardedMove, list[PrimitiveContact], list[PrimitiveContact]]:
    """The guarded move of a piece, and the contacts that it holds and makes."""
    piece = claim.piece
    touching = _touching(problem, tuple(dict.fromkeys((*piece.held, *piece.making))), piece.goal)
    held, made = ([c for c in contacts if c in touching] for contacts in (piece.held, piece.making))
    begun, done = piece.progress
    rest = (1.0 - done) / (done - begun) * claim.advance.length
    points, wrenches = _pushes(problem, held, piece.goal)
    move = GuardedMove(
        piece.goal,
        piece.start.local(piece.goal),
        wrenches,
        points,
        _pushes(problem, made, piece.goal)[1],
        bound,
        _resisting(assembly, held, claim),
        rest < _NEAR * bound,
    )
    return move, held, made


def _pushes(problem: Problem, contacts: Sequence[PrimitiveContact], pose: Pose) -> tuple[Array, Array]:
    """The points (m, 3) of contacts and their wrenches (m, 6) for a unit normal force, at a pose of the moving part."""
    parts = problem.moving.polyhedron, problem.fixed.polyhedron
    points = np.array([contact_point(c, *parts, pose) for c in contacts]).reshape(-1, 3)
    normals = np.array([contact_normal(c, *parts, pose) for c in contacts]).reshape(-1, 3)
    return points, np.hstack([normals, cross(points - pose.p, normals)])


def _approach(problem: Problem, claim: Claim, move: GuardedMove, tolerance: Tolerance) -> float | None:
    """The normal speed at which a unit twist may meet what ends a piece; None where no impact is limited or comes."""
    piece = claim.piece
    if problem.specification.impact_force is None or not piece.making:
        return None
    body, fixed = problem.moving.polyhedron, problem.fixed.polyhedron
    meetings = [Meeting.of(c, body, fixed, piece.goal) for c in piece.making]
    V = move.direction(tolerance.rho)
    theta = claim.advance.ends.extent.theta + float(np.linalg.norm(move.displacement[3:]))
    return approach_speed(meetings, V, theta, tolerance.velocity_error, tolerance.rho)


def _resisting(assembly: Assembly, held: Sequence[PrimitiveContact], claim: Claim) -> Callable[[Array], float]:
    """How much work (J) normal forces of contacts may take from a piece of motion as errors at its goal turn them."""
    ends = claim.advance.ends

    @cache
    def power() -> Array:
        rows = contact_rows(assembly, held, (), ends.goal)
        turned = Curvature.of(rows, rows, ends.extent.twist).power()
        return np.asarray(turned / np.linalg.norm(rows.N[:, :3], axis=1)[:, None])

    return lambda forces: float(ends.goal_set.support(forces @ power()))


def _touching(problem: Problem, contacts: tuple[PrimitiveContact, ...], pose: Pose) -> set[PrimitiveContact]:
    """The contacts whose point lies on both features; of those listed because either may touch, the one that does.

    One that the part has yet to come to counts as if it touched where it is nearest now.
    """
    body, fixed = problem.moving.polyhedron, problem.fixed.polyhedron
    clear = [c for c in contacts if not _level(c, body, fixed, pose)]
    if not clear:
        return set()
    f, N = Surfaces.of(clear, body, fixed).values_and_rows(pose)
    closed = [([c for c, distance in zip(clear, f, strict=True) if abs(distance) <= _CLOSED], pose)]
    for c, distance, row in zip(clear, f, N, strict=True):
        if abs(distance) > _CLOSED:
            closed.append(([c], Pose(pose.p - distance * row[:3], pose.R)))
    found = set[PrimitiveContact]()
    for together, at in closed:
        inside = BoundTable.of(together, body, fixed, at).insides(at)
        found.update(c for c, depth in zip(together, inside, strict=True) if depth > -1e-9)
    return found


def _level(contact: PrimitiveContact, body: Polyhedron, fixed: Polyhedron, pose: Pose) -> bool:
    """Whether an edge runs level with the edge it is listed with, so that they cross in no one point."""
    if contact.kind is not Kind.EDGE_EDGE:
        return False
    a, b = pose.apply(body.vertices[list(contact.moving)])
    c, d = fixed.vertices[list(contact.fixed)]
    return bool(np.linalg.norm(cross(b - a, d - c)) < 1e-3 * np.linalg.norm(b - a) * np.linalg.norm(d - c))
