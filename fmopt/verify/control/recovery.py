"""That backing off and trying again touch nothing, as far as the plan says so.

Lifting. On a vertical line the fixed part begins, going up, only at a face that looks down. A point that is outside the
fixed part and above every such face stays outside as it goes up. So from any pose free of collision, whatever the
errors that led there, the moving part can be lifted along z while its lowest point lies above `above`, the highest
point of faces that look down: the underside, where there is no undercut.

Carrying. With its lowest point at `clear` the part is turned back and shifted to the start pose, raised: heights of
points of a turn by θ about a constant axis are off their straight interpolation by r θ²/8 at most, r being how far the
part reaches from its reference point.

Trying again. The plan holds for every start error in its box, wherever the box is: shifted by o it holds for the errors
e with e + o in the box. What the boxes cover together is compared exactly.
"""

import math
from collections.abc import Sequence
from itertools import pairwise

from fmopt.verify.arithmetic.rational import (
    ONE,
    SLACK,
    ArithmeticRefusal,
    Vector,
    cross,
    dot,
    fixed,
    length,
    logarithm,
    number,
    over,
    product,
    sub,
    times,
    transposed,
    vector,
)
from fmopt.verify.findings import Notes, micrometres
from fmopt.verify.parts.rows import pose
from fmopt.verify.parts.solids import DEVIATION, Shape
from fmopt.verify.reading.document import Lift, MoveRecovery, Segment, StatedPlan
from fmopt.verify.reading.reader import Numbers

_UPRIGHT = ONE >> 20  # faces lean over by less than this where they may count as vertical


def check_recovery(plan: StatedPlan, parts: tuple[Shape, Shape], notes: Notes) -> None:
    """Judges the recovery that a plan offers; a plan without any is not judged."""
    recovery = plan.recovery
    if recovery is None:
        return
    lift = recovery.lift
    try:
        _check_moves(recovery.moves, plan, parts[0], lift, notes)
        if lift is not None and (below := underside(parts[1]) - fixed(lift.above)) > 0:
            words = f"a face of the fixed part looks down {micrometres(number(below))} above it"
            notes.add("recovery.lift.above", words, number(below))
        if lift is not None and recovery.retries:
            _check_carrying(lift, plan, parts, notes)
    except ArithmeticRefusal as error:
        notes.add("recovery", str(error))
    if recovery.retries and lift is None:
        notes.add("recovery.retries", "are offered without a lift that brings the part back to the start")
    _check_covering(plan.start_box, recovery.retries, recovery.covers, notes)


def underside(shape: Shape) -> int:
    """The height of the highest point of faces that look down; those that lean over by `DEVIATION` do not.

    Going straight up, a part enters what leans over by no more than that.
    """
    heights = []
    for face in shape.faces:
        levels = [shape.vertices[i][2] for loop in face.loops for i in loop]
        leaning = -face.plane.normal[2]
        vertical = leaning <= _UPRIGHT and times(leaning, max(levels) - min(levels)) <= DEVIATION
        if leaning > 0 and not vertical:
            heights.append(max(levels))
    return max(heights, default=min(v[2] for v in shape.vertices))


def _check_moves(
    entries: Sequence[MoveRecovery], plan: StatedPlan, part: Shape, lift: Lift | None, notes: Notes
) -> None:
    """That each move backs off only where the part stays above what it could be lifted into."""
    pieces: dict[int, list[Segment]] = {}
    for segment in plan.segments:
        pieces.setdefault(segment.move, []).append(segment)
    if [entry.move for entry in entries] != sorted(pieces):
        notes.add("recovery.moves", "must have one entry for each move, in order")
        return
    for entry in entries:
        what = f"recovery.moves[{entry.move}]"
        if lift is None:
            if entry.back_off or entry.room is not None:
                notes.add(what, "backs off although the plan has no lift")
            continue
        if entry.room is None:
            notes.add(what, "does not say how much room it has")
            continue
        room = min(lowest(part, s, plan.rho) for s in pieces[entry.move]) - fixed(lift.above) - SLACK
        if fixed(entry.room) > room:
            notes.add(what, f"{micrometres(entry.room)} of room are stated, only {micrometres(number(room))} follow")
        if entry.back_off != (entry.room > 0.0):
            notes.add(what, "backs off where it has no room, or does not where it has")


def lowest(shape: Shape, segment: Segment, rho: float) -> int:
    """A lower bound of the height of the part's lowest point on a segment, its greatest travel used up; for its errors.

    Heights of points are followed from start to goal, and on from there at the rates that they have there. Travel is in
    the metric of ρ, m.
    """
    start, goal = pose(segment.start), pose(segment.goal)
    shift, turn = sub(goal.p, start.p), logarithm(product(goal.R, transposed(start.R)))
    way = length((length(shift), times(fixed(rho), length(turn)), 0))
    most = fixed(segment.hybrid.max_travel)
    surplus = over(max(0, most - way), max(way, 1))
    further = times(surplus, length(turn))  # rad, beyond the goal
    angle, farther = times(length(turn), length(turn)), times(further, further)
    down, tilts = fixed(segment.tube.box[2]), vector(segment.tube.angles)
    found = []
    for v, reach, radius in zip(shape.vertices, shape.lengths, shape.radii, strict=True):
        bow = times(reach, angle) >> 3
        fall = -(shift[2] + cross(turn, goal.turned(v))[2])
        after = times(surplus, max(0, fall)) + (times(reach, farther) >> 1)
        sunk = max(_sunk(X.turned(v), reach, down, tilts) for X in (start, goal))
        ends = (start.apply(v)[2], goal.apply(v)[2])
        found.append(min(min(ends) - bow, ends[1] - after) - sunk - radius)
    return min(found)


def _sunk(w: Vector, reach: int, down: int, tilts: Vector) -> int:
    """By how much errors of at most so much in height and angle may lower a point of the part, at w = R v.

    Turned by ε, it goes by ε × w and |ε|² |w| / 2 at most beyond.
    """
    return down + times(tilts[0], abs(w[1])) + times(tilts[1], abs(w[0])) + (times(reach, dot(tilts, tilts)) >> 1) + 4


def _check_carrying(lift: Lift, plan: StatedPlan, parts: tuple[Shape, Shape], notes: Notes) -> None:
    """That the part is above the fixed part as it is turned back, shifted and lowered to a start pose."""
    shape, top = parts[0], max(v[2] for v in parts[1].vertices)
    first = pose(plan.segments[0].start)
    angles = plan.start_box[3:]
    least, sums = fixed(math.cos(lift.turn)), []
    for segment in plan.segments:
        for X in (pose(segment.start), pose(segment.goal)):
            sums.append((sum(dot(line, other) for line, other in zip(X.R, first.R, strict=True)) - ONE) >> 1)
    if min(sums) < least:
        notes.add("recovery.lift.turn", "a pose of the plan is turned further from the start")
    theta = fixed(lift.turn)
    bow = times(shape.radius, times(theta, theta)) >> 3
    tilts = vector(angles)
    errors = fixed(plan.start_box[2]) + times(shape.radius, tilts[0] + tilts[1])
    room = fixed(lift.clear) - bow - errors - (times(shape.radius, dot(tilts, tilts)) >> 1) - SLACK - top
    if room <= 0:
        notes.add("recovery.lift.clear", f"is short by {micrometres(number(-room))}", number(-room))
    heights = [first.apply(v)[2] - radius for v, radius in zip(shape.vertices, shape.radii, strict=True)]
    if min(heights) > fixed(lift.clear):
        notes.add("recovery.lift.clear", "is below the start")
    sunk = [
        _sunk(first.turned(v), reach, fixed(plan.start_box[2]), tilts)
        for v, reach in zip(shape.vertices, shape.lengths, strict=True)
    ]
    begun = min(height - loss for height, loss in zip(heights, sunk, strict=True)) - top - SLACK
    if begun <= 0:
        notes.add("recovery.retries", f"the start is {micrometres(number(-begun))} below the top", number(-begun))


def _check_covering(box: Numbers, retries: Sequence[Numbers], covers: Numbers, notes: Notes) -> None:
    """That the boxes of errors that the plan and its retries hold for make up what is said to be covered, exactly."""
    if any(any(offset[2:]) for offset in retries):
        notes.add("recovery.retries", "shift the start otherwise than in x and y")
    if covers[2:] != box[2:]:
        notes.add("recovery.covers", "differs from the start errors otherwise than in x and y")
    widths = [fixed(a) for a in box[:2]]
    centres = [(0, 0), *((-fixed(o[0]), -fixed(o[1])) for o in retries)]
    spans = [_cells([c[k] + sign * widths[k] for c in centres for sign in (-1, 1)], fixed(covers[k])) for k in range(2)]
    for x in spans[0]:
        for y in spans[1]:
            if not any(abs(x - 2 * c[0]) <= 2 * widths[0] and abs(y - 2 * c[1]) <= 2 * widths[1] for c in centres):
                at = micrometres(number(x) / 2.0), micrometres(number(y) / 2.0)
                notes.add("recovery.covers", f"no start covers the error of {at[0]} in x and {at[1]} in y")
                return


def _cells(cuts: Sequence[int], end: int) -> list[int]:
    """Twice the middles of the intervals that cuts divide −end … end into; all of it where that is a point."""
    return [a + b for a, b in pairwise(sorted({-end, end, *(x for x in cuts if -end < x < end)}))] or [0]
