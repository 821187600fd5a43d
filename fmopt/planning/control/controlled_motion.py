"""How a certified motion is controlled: the guarded move and the strategy of each piece, and how surely contacts hold.

Impact. A mass m that meets a spring of stiffness k at the normal speed vₙ compresses it to m vₙ²/2 = F²/(2 k), so that
F = vₙ √(k m). With m the apparent mass of robot and part where they touch and k the stiffness of contact, robot and
sensor in series that is the greatest force of the impact; the push of the bias comes on top.

Over the errors. The contact is met somewhere on the moving feature, which lies between its vertices: vₙ is linear in
the point, so that the vertices bound it. A turn of the part by up to θ, its error and its way to the goal, moves their
arms a by up to |a| θ, and the normal by an angle φ: none of a face that stands, θ of one that moves, and of crossing
edges at the angle α up to arcsin(θ / sin α). With u = v + ω × a

    vₙ ≤ min(|u| + |ω| |a| θ,  |n·u| + |ω| |a| θ + φ (|u| + |ω| |a| θ)) + e_t + e_r |a| / ρ

for the unit twist (v, ω) and the velocity error (e_t, e_r) as shares of it.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any, assert_never
from weakref import ref

import numpy as np

from fmopt.certificate.assembly import Assembly, contact_rows
from fmopt.certificate.claim import Claim
from fmopt.certificate.remainder import Curvature
from fmopt.certificate.segment_linearisation import Tolerance
from fmopt.contact.c_surface import Surfaces, contact_normal, contact_point, contact_wrench
from fmopt.contact.facet_bounds import BoundTable
from fmopt.contact.primitive import Kind, PrimitiveContact
from fmopt.errors import InfeasibleError
from fmopt.geometry.polyhedron import Polyhedron
from fmopt.planning.control.bias_wrench import GuardedMove, firmness, steadiness, turns
from fmopt.planning.control.hybrid_strategy import HybridStrategy, JamMargin, hybrid_strategy, jam_free
from fmopt.planning.robustness.error_tolerance import CertifiedMotion
from fmopt.spatial.se3 import Pose, cross
from fmopt.spatial.values import Array, Value, remembered, there
from fmopt.task.problem import Problem, Specification

_NEAR = 4.0  # bounds of its errors before its goal from where on a move is run as if it might meet its contacts
_CLOSED = 1e-12  # m; contacts nearer than this touch
_LATEST = 256  # pieces whose guarded moves are kept: those of a few sequences
_LEVEL = 1e-3  # sine of the angle below which edges fix no normal


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


@dataclass(frozen=True, eq=False)
class ControlledPiece:
    """A piece of motion with its strategy."""

    move: int
    claim: Claim
    strategy: HybridStrategy
    held: tuple[PrimitiveContact, ...]
    made: tuple[PrimitiveContact, ...]
    impact: dict[str, Any] | None = None
    jam_free: JamMargin | None = None

    def document(self) -> dict[str, Any]:
        """The strategy as the plan file holds it."""
        found = self.strategy.document([c.id for c in self.held], [c.id for c in self.made])
        if self.impact is not None:
            found["impact"] = self.impact
        return found if self.jam_free is None else {**found, "jam_free": self.jam_free.document()}


@dataclass(frozen=True, eq=False)
class ControlledMotion:
    """A certified motion with the strategies of its pieces, one for each claim, in order."""

    motion: CertifiedMotion
    pieces: tuple[ControlledPiece, ...]


def controlled(problem: Problem, motion: CertifiedMotion, *, ranges: bool = False) -> ControlledMotion:
    """A motion with its control strategies, from the contacts that touch at the goal of each piece.

    Raises:
        InfeasibleError: no bias force holds the contacts of a piece.
    """
    found: list[ControlledPiece] = []
    move = -1
    for claim, bound in bounded(motion.claims, motion.tolerance.rho):
        move += claim.piece.progress[0] == 0.0
        try:
            found.append(_controlled(problem, motion, claim, (move, bound), ranges=ranges))
        except InfeasibleError as error:
            raise InfeasibleError(f"move {move + 1}: {error.message}", advice=error.advice) from error
    return ControlledMotion(motion, tuple(found))


def _controlled(
    problem: Problem, motion: CertifiedMotion, claim: Claim, at: tuple[int, float], *, ranges: bool
) -> ControlledPiece:
    """A piece with its strategy; `at` has the number of its move, and what `bounded` says of it."""
    number, bound = at
    tolerance, specification = motion.tolerance, problem.specification
    move, held, made = guarded(motion.assembly, problem, claim, bound)
    approach = _approach(problem, claim, move, tolerance)
    specification = specification if approach is None else slowed(specification, approach)
    impact = None if approach is None else impact_record(specification, approach)
    strategy = hybrid_strategy(move, tolerance.rho, specification)
    free = jam_free(move, strategy, tolerance.rho, specification) if ranges else None
    return ControlledPiece(number, claim, strategy, held, made, impact, free)


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
    problem: Problem, assembly: Assembly, claims: Sequence[Claim], tolerance: Tolerance, turning: bool | None = None
) -> Iterator[GuardedMove]:
    """The guarded moves of pieces that go to a contact; of those alone that hold some and turn, or that do not turn."""
    for claim, bound in bounded(claims, tolerance.rho):
        piece = claim.piece
        asked = turning is None or (piece.held and turns(piece.start.local(piece.goal), tolerance.rho) == turning)
        if piece.making and asked:
            yield guarded(assembly, problem, claim, bound)[0]


# Firmness, steadiness, whether contacts are felt, and their derivatives all ask for it, of every sequence that is
# tried. It is kept with the parts, as claims do not live as long, and refers to them weakly.
@remembered(_LATEST)
def guarded(
    assembly: Assembly, problem: Problem, claim: Claim, bound: float
) -> tuple[GuardedMove, tuple[PrimitiveContact, ...], tuple[PrimitiveContact, ...]]:
    """The guarded move of a piece, and the contacts that it holds and makes."""
    piece = claim.piece
    touching = _touching(problem, tuple(dict.fromkeys((*piece.held, *piece.making))), piece.goal)
    held, made = (tuple(c for c in contacts if c in touching) for contacts in (piece.held, piece.making))
    begun, done = piece.progress
    rest = (1.0 - done) / (done - begun) * claim.advance.length  # to the goal of the move, m in the metric of ρ
    points, wrenches = _pushes(problem, held, piece.goal)
    balls = dict.fromkeys(c.moving[0] for c in held if c.kind is Kind.BALL_FACE)
    move = GuardedMove(
        piece.goal,
        piece.start.local(piece.goal),
        wrenches,
        points,
        _pushes(problem, made, piece.goal)[1],
        bound,
        _resisting(assembly, held, claim),
        rest < _NEAR * bound,
        piece.goal.apply(problem.moving.polyhedron.vertices[[*balls]]) if balls else None,
    )
    return move, held, made


def _pushes(problem: Problem, contacts: Sequence[PrimitiveContact], pose: Pose) -> tuple[Array, Array]:
    """The points (m, 3) of contacts and their wrenches (m, 6) for a unit normal force, at a pose of the moving part."""
    parts = problem.moving.polyhedron, problem.fixed.polyhedron
    points = np.array([contact_point(c, *parts, pose) for c in contacts]).reshape(-1, 3)
    return points, np.array([contact_wrench(c, *parts, pose) for c in contacts]).reshape(-1, 6)


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
    ends, owner = claim.advance.ends, ref(assembly)

    @cache  # forces are tried in rounds, for all of which it is the same
    def power() -> Array:
        rows = contact_rows(there(owner), held, (), ends.goal)
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
    return bool(np.linalg.norm(cross(b - a, d - c)) < _LEVEL * np.linalg.norm(b - a) * np.linalg.norm(d - c))


@dataclass(frozen=True, eq=False)
class Meeting(Value, normal=(3,), arms=(None, 3)):
    """A contact that a move may make, with arms (k, 3)."""

    normal: Array  # unit normal (3,) at the goal; zero where the features fix none
    arms: Array  # vertices (k, 3) of the moving feature from the reference point, axes of B, m
    leverage: float  # sine of the normal's turn for that of the part; infinite where nothing bounds it

    @staticmethod
    def of(contact: PrimitiveContact, moving: Polyhedron, fixed: Polyhedron, pose: Pose) -> "Meeting":
        """The meeting of a primitive contact of two parts at a pose."""
        arms = moving.vertices[list(contact.moving)] @ pose.R.T
        if contact.kind is Kind.BALL_FACE:
            arms = (contact_point(contact, moving, fixed, pose) - pose.p)[None]
        match contact.kind:
            case Kind.VERTEX_FACE | Kind.BALL_FACE:
                leverage = 0.0
            case Kind.FACE_VERTEX:
                leverage = 1.0
            case Kind.EDGE_EDGE:
                edges = arms[1] - arms[0], np.subtract(*fixed.vertices[list(contact.fixed)])
                sine = float(np.linalg.norm(np.cross(*edges))) / math.prod(float(np.linalg.norm(e)) for e in edges)
                leverage = 1.0 / sine if sine >= _LEVEL else math.inf
            case _:
                assert_never(contact.kind)
        normal = contact_normal(contact, moving, fixed, pose) if math.isfinite(leverage) else np.zeros(3)
        return Meeting(normal, arms, leverage)


def approach_speed(
    meetings: Sequence[Meeting], V: Array, theta: float, velocity_error: tuple[float, float], rho: float
) -> float:
    """The greatest normal speed at which any of the contacts can be met, for a unit twist V (6,) in the metric of ρ.

    The part may be turned from its goal by θ (rad) when they are. Velocity errors are shares of the speed in
    translation, and in rotation on the arm ρ.
    """
    v, w = V[:3], V[3:]
    found = [0.0]
    for meeting in meetings:
        turn = math.asin(min(meeting.leverage * theta, 1.0)) if math.isfinite(meeting.leverage) else math.pi
        for arm in meeting.arms:
            u, size = v + np.cross(w, arm), float(np.linalg.norm(arm))
            shifted = float(np.linalg.norm(w)) * size * theta
            most = float(np.linalg.norm(u)) + shifted
            met = min(most, abs(float(meeting.normal @ u)) + shifted + turn * most)
            found.append(met + velocity_error[0] + velocity_error[1] * size / rho)
    return max(found)


def impact_force(specification: Specification, approach: float) -> float | None:
    """The force (N) with which a contact is met at the specified speed, for its normal speed for a unit twist.

    None where the specification does not say what meets.
    """
    mass, stiffness = specification.apparent_mass, specification.contact_stiffness
    if mass is None or stiffness is None:
        return None
    return specification.speed * approach * math.sqrt(mass * stiffness)


def slowed(specification: Specification, approach: float) -> Specification:
    """The specification with its speed lowered as far as the impact asks for, for the normal speed for a unit twist."""
    force, limit = impact_force(specification, approach), specification.impact_force
    if force is None or limit is None or force <= limit:
        return specification
    return replace(specification, speed=specification.speed * (limit / force))


def impact_record(specification: Specification, approach: float) -> dict[str, Any]:
    """The `impact` entry of a segment's strategy at the specified speed."""
    return {"approach": approach, "force": impact_force(specification, approach)}
