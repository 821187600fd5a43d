"""The check of a whole plan: CERTIFIED, REFUTED with a collision, or NOT_PROVED with what is short.

A proof that two convex pieces overlap at a pose: a point deeper than the tolerance inside both.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any

from fmopt.verify.arithmetic.rational import (
    ONE,
    ArithmeticRefusal,
    Row,
    Vector,
    add,
    dot,
    exponential,
    fixed,
    length,
    number,
    product,
    row_dot,
    scaled,
    sub,
    transposed,
    turned,
)
from fmopt.verify.certificate.chain import Broken, Chain, Stage
from fmopt.verify.certificate.claims import check_segment
from fmopt.verify.control.recovery import check_recovery
from fmopt.verify.control.strategy import check_strategy
from fmopt.verify.evidence import judge_presses
from fmopt.verify.findings import CERTIFIED, NOT_PROVED, REFUTED, TESTED, Finding, Notes, Verdict, Witness
from fmopt.verify.parts.assembly import PartPair
from fmopt.verify.parts.rows import CheckedPose, Distance, pose
from fmopt.verify.parts.solids import Plane, Shape
from fmopt.verify.reading.document import Segment, StatedPlan
from fmopt.verify.reading.parse import parse
from fmopt.verify.reading.reader import NOT_COVERED, NOT_COVERED_OFF_FORM, NOT_COVERED_PRESSES, PlanError

Failed = tuple[tuple[int, int, tuple[Distance, Distance] | None], ...]
Point = tuple[float, float, float]


def verify(
    document: Mapping[str, Any], expected_sha256: str | None = None, overdue: Callable[[], bool] = lambda: False
) -> Verdict:
    """Checks a plan from its own geometry, poses, bases and witnesses.

    Everything else that the plan states is derived again, in exact arithmetic with stated rounding, and compared. A
    plan of another problem than that of `expected_sha256`, where given, is not proved, nor is one that was not checked
    to its end as it was `overdue`.

    Executions. The controller follows the commanded pieces of a move one after the other, off by the start error and a
    velocity error in the stated bounds, while held contacts are kept by giving way along the compliant directions. It
    stops as the contact that the move makes is touched: the piece in which that happens is cut short, and only the last
    piece is ever lengthened. The error sets stretch all pieces of a move alike instead; `chain` demands that the two
    agree, to first order and up to the small amounts that the verdict's text states as not covered.

    Raises:
        PlanError: the document is no plan.
    """
    return judge(parse(document), expected_sha256, overdue)


def judge(plan: StatedPlan, expected_sha256: str | None = None, overdue: Callable[[], bool] = lambda: False) -> Verdict:
    """Checks a plan that was read, as `verify` does, which has the same arguments.

    Raises:
        PlanError: its parts are no solids that arithmetic can take.
    """
    if plan.presses:
        return judge_presses(plan, _whole(plan, expected_sha256, TESTED, NOT_COVERED_PRESSES))
    try:
        assembly = PartPair(plan)
    # What arithmetic refuses of the parts leaves nothing to judge: the document is at fault, not a claim of it.
    except ArithmeticRefusal as error:
        raise PlanError("parts", str(error)) from error
    leaves_out = NOT_COVERED_OFF_FORM if plan.moving.form or plan.fixed.form else NOT_COVERED
    notes = _whole(plan, expected_sha256, CERTIFIED, leaves_out)
    for flaw in assembly.flaws:
        notes.add("parts", flaw)
    check_recovery(plan, (assembly.moving, assembly.fixed), notes)
    findings, margins, witness = _segments(plan, assembly, overdue)
    found = (*notes.found, *findings)
    verdict = REFUTED if witness is not None else NOT_PROVED if found else CERTIFIED
    # The least margin of some segments only would look like that of the plan.
    least = min(margins) if len(margins) == len(plan.segments) else None
    return Verdict(verdict, found, witness, len(plan.segments), least, plan.not_covered, plan.verdict)


def _whole(plan: StatedPlan, expected_sha256: str | None, claim: str, leaves_out: tuple[str, ...]) -> Notes:
    """What keeps a plan as a whole from what it can claim at most."""
    notes = Notes(None)
    if not plan.digest_holds:
        notes.add("sha256", "the document is not the one that was sealed")
    if expected_sha256 is not None and plan.problem != expected_sha256:
        notes.add("problem", "the plan belongs to another problem")
    if plan.verdict != claim:
        notes.add("verdict", f"the plan itself does not claim to be {claim.lower()}, but says {plan.verdict}")
    if plan.not_covered != leaves_out:
        notes.add("not_covered", "does not say what plans of this kind leave out")
    moving, fixed = plan.moving.measured_clearance, plan.fixed.measured_clearance
    if moving != fixed or not moving > 0.0:
        notes.add("measured_clearance", "must be positive and the same on both parts")
    return notes


def _segments(
    plan: StatedPlan, assembly: PartPair, overdue: Callable[[], bool]
) -> tuple[list[Finding], list[float], Witness | None]:
    chain = Chain(plan, assembly)
    findings: list[Finding] = []
    margins: list[float] = []
    witness: Witness | None = None
    everything = [(i, j, None) for i in range(len(assembly.moving_pieces)) for j in range(len(assembly.fixed_pieces))]
    for k, segment in enumerate(plan.segments):
        notes = Notes(k)
        if overdue():
            notes.add("time", "there was no time left to check this segment and those after it")
            return findings + notes.found, margins, witness
        # Where the chain breaks no pair is known to be apart, so that all are looked at for a collision.
        failed: Failed = tuple(everything)
        try:
            stage = chain.follow(segment, notes)
            outcome = check_segment(assembly, stage, notes)
            check_strategy(assembly, stage, plan.rho, plan.velocity_error, plan.specification, notes)
            failed = outcome.failed
            if outcome.margin is not None:
                margins.append(number(outcome.margin))
            # Corners of the start box are errors that occur; later sets hold those that do, and more.
            errors = _corners(stage, failed) if k == 0 else []
            broken = False
        except (Broken, ArithmeticRefusal) as error:
            notes.add("chain", f"{error}; the segments after it were not looked at")
            errors, broken = [], True
        if failed and witness is None:
            witness = _collision(k, segment, assembly, failed, errors, plan.touch)
        findings += notes.found
        if broken:
            return findings, margins, witness
    notes = Notes(None)
    chain.finish(notes)
    return findings + notes.found, margins, witness


def _corners(stage: Stage, failed: Failed) -> list[Row]:
    """Errors at corners of the start box that press hardest against the rows that failed."""
    corners = []
    for _, _, tightest in failed:
        if tightest is not None:
            total = [0] * 6
            for g in stage.motion.errors.core:
                sign = -1 if row_dot(g, tightest[0].N) > 0 else 1
                total = [t + sign * x for t, x in zip(total, g, strict=True)]
            corners.append((total[0], total[1], total[2], total[3], total[4], total[5]))
    return corners


def _collision(
    k: int, segment: Segment, assembly: PartPair, failed: Failed, errors: Iterable[Row], touch: float
) -> Witness | None:
    """A pose of the segment, nominal or at a corner of the start box, at which a pair that failed overlaps."""
    start, goal = pose(segment.start), pose(segment.goal)
    none: Row = (0, 0, 0, 0, 0, 0)
    tries = [(start, segment.start, none), (goal, segment.goal, none)]
    for e in errors:
        tries.append((CheckedPose(add(start.p, e[:3]), product(exponential(e[3:]), start.R)), segment.start, e))
    for X, stated, error in tries:
        for i, j, _ in failed:
            depth = overlap(assembly.moving_pieces[i], assembly.fixed_pieces[j], X, max(touch, 1e-12))
            if depth > 0.0:
                return Witness(k, stated, tuple(number(x) for x in error), (i, j), depth)
    return None


def overlap(M: Shape, F: Shape, X: CheckedPose, least: float) -> float:
    """A depth (m) to which the pieces certainly overlap, 0 when no overlap deeper than `least` (m) was found.

    Candidates come from floats (corners of the intersection and their mean); the depth of a candidate is exact.
    """
    if M.ball:
        found = _sunk_in(M, F, X)
        return found if found > least else 0.0
    back = transposed(X.R)
    own = [X.apply(v) for v in M.vertices]
    planes = [face.plane for face in F.faces]
    for side in M.faces:
        n = turned(X.R, side.plane.normal)
        planes.append(Plane(n, side.plane.offset + dot(n, X.p)))
    corners = list(_vertices(own, M, F, planes))
    if not corners:
        return 0.0
    count = len(corners)
    mean = (sum(p[0] for p in corners) / count, sum(p[1] for p in corners) / count, sum(p[2] for p in corners) / count)
    best = 0.0
    for candidate in (mean, *corners):
        x: Vector = (fixed(candidate[0]), fixed(candidate[1]), fixed(candidate[2]))
        body = turned(back, sub(x, X.p))
        height = max(max(face.plane.height(x) for face in F.faces), max(face.plane.height(body) for face in M.faces))
        # 2⁻¹⁰⁰ m is more than heights are off by rounding: what is left of the depth is certain.
        best = max(best, -number(height + (ONE >> 100)))
    return best if best > least else 0.0


def _sunk_in(M: Shape, F: Shape, X: CheckedPose) -> float:
    """A depth (m) to which a ball is certainly inside a piece; not positive when none was found."""
    # Radii were rounded up so that a ball stays apart; to be inside of something it must not be larger than it is.
    centre, radius = X.apply(M.vertices[0]), M.radii[0] - (ONE >> 100)
    nearest = max(F.faces, key=lambda face: face.plane.height(centre)).plane
    height = nearest.height(centre)
    # Halfway between the face and the lowest point of the ball.
    x = sub(centre, scaled((height + radius) >> 1, nearest.normal))
    inside = min(-face.plane.height(x) for face in F.faces)
    return number(min(inside, radius - length(sub(x, centre))) - (ONE >> 100))


def _vertices(own: Sequence[Vector], M: Shape, F: Shape, planes: Sequence[Plane]) -> Iterator[Point]:
    """Corners of the intersection, in floats: vertices and edges of one against faces of the other."""
    half = [(number(p.normal[0]), number(p.normal[1]), number(p.normal[2]), number(p.offset)) for p in planes]
    for shape, vertices in ((M, own), (F, F.vertices)):
        points = [(number(v[0]), number(v[1]), number(v[2])) for v in vertices]
        for i, j in shape.edge_faces:
            if i < j:
                yield from _inside(points[i], points[j], half)


def _inside(p: Point, q: Point, half: Sequence[tuple[float, float, float, float]]) -> Iterator[Point]:
    """The ends of the part of a segment behind all planes, with a little room for rounding."""
    low, high = 0.0, 1.0
    for a, b, c, offset in half:
        g = a * p[0] + b * p[1] + c * p[2] - offset - 1e-12
        h = a * q[0] + b * q[1] + c * q[2] - offset - 1e-12
        if g > 0.0 and h > 0.0:
            return
        if g > 0.0:
            low = max(low, g / (g - h))
        elif h > 0.0:
            high = min(high, g / (g - h))
    if low <= high:
        for t in (low, high):
            yield (p[0] + t * (q[0] - p[0]), p[1] + t * (q[1] - p[1]), p[2] + t * (q[2] - p[2]))
