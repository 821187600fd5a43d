"""What to do when a move fails: back off along the hole's axis, and try again from a start a little aside.

Back off. On a vertical line the fixed part begins, going up, only at a face that looks down. What is outside it and
above every such face stays outside as it goes up: from any pose free of collision, whatever errors led there, the part
can be lifted while its lowest point lies above the highest point of faces that look down. It is lifted until it is
clear of the top, turned back, shifted, and lowered to a start pose.

Try again. The plan holds for every start error e in its box. From a start shifted by o it holds where e + o lies in the
box. Eight shifts by a whole width around, in the plane two, cover with it three times its size in x and y. The order in
which they are tried follows from what was felt: a shift o is for errors about −o, which would bring the contacts of the
move nearer or farther; a contact that was never felt speaks for errors with which it is farther, one that came too
early, or another in its place, for those with which they are nearer. Last comes the same start once more.
"""

import math
from collections.abc import Mapping, Sequence
from fractions import Fraction
from itertools import product
from typing import Any

import numpy as np

from fmopt.certificate.assembly import Assembly, contact_rows
from fmopt.certificate.claim import Claim
from fmopt.geometry.polyhedron import Polyhedron
from fmopt.plan import diagnostics, rounded_down
from fmopt.plan.guarded_moves import NOISE
from fmopt.planning.robustness.unplanned_contacts import UnplannedCandidate, images_of, unplanned_contacts
from fmopt.spatial.se3 import Pose, cross, log
from fmopt.spatial.values import Array
from fmopt.task.problem import Specification

SHARE = 3  # times the start errors in x and y are what a plan and its retries cover
NOT_COVERED = (
    "that a failure is noticed: a wrong contact may feel like the wanted one",
    "that the part stays where it is in the grip as a move fails, and that the robot finds the start again",
    "friction against the lift",
)
_UPRIGHT = 2.0**-20  # faces lean over by less than this where they may count as vertical
_FLAT = 1e-12  # m, by which a vertical face may lean over
_OVERTURN = 0.15  # rad by which a part may be turned further than planned, and still be turned back
_SPARE = 1e-3  # m that the part is lifted higher than it need be
_SLACK = 1e-9  # m and rad by which figures are stated on the safe side
_LONGEST_TURN = 0.5 * math.pi  # rad
_SURE = 3.0  # standard deviations of the force signal


def recovery_record(
    assembly: Assembly,
    claims: Sequence[Claim],
    segments: Sequence[Mapping[str, Any]],
    box: Array,
    specification: Specification,
    rho: float,
) -> tuple[dict[str, Any], tuple[diagnostics.UnplannedContact, ...]]:
    """What a plan says of recovery, as its file holds it, and the contacts that larger errors would make first.

    Start errors have half-widths `box` (6,), m and rad.
    """
    body, fixed = assembly.moving.polyhedron, assembly.fixed.polyhedron
    above = underside(fixed)
    count = int(segments[-1]["move"]) + 1
    runs = [[k for k, segment in enumerate(segments) if segment["move"] == move] for move in range(count)]
    rooms = [min(lowest(body, segments[k], rho) for k in run) - above - _SLACK for run in runs]
    first = Pose.from_vector(segments[0]["start"])
    goals = (Pose.from_vector(segment["goal"]) for segment in segments)
    turn = max(float(np.linalg.norm(log(goal.R @ first.R.T))) for goal in goals) + _OVERTURN
    lift: dict[str, Any] | None = None
    why = ""
    if max(rooms) <= 0.0:
        why = "a face of the fixed part looks down above the part's lowest point in every move: it could not be lifted"
    elif turn > _LONGEST_TURN:
        why = "the part is turned by more than a right angle from its start"
    else:
        # Nothing new is touched while the lowest point is above; from where it is clear the part is turned and carried.
        clear = _clear(body, fixed, first, box, turn)
        lift = {"direction": [0.0, 0.0, 1.0], "above": above, "clear": clear, "turn": turn}
    retries = offsets(box)
    begun = float((first.apply(body.vertices)[:, 2] - body.radii - _sunk(body, first, box)).min())  # at the worst
    if lift is not None and begun <= float(fixed.vertices[:, 2].max()) + _SLACK:
        why, retries = "with some start errors the part begins below the top, where it cannot be carried to", []
    if lift is None:
        retries = []
    moves, unplanned = [], list[diagnostics.UnplannedContact]()
    for number, (run, room) in enumerate(zip(runs, rooms, strict=True)):
        of_move = [claims[k] for k in run]
        found = unplanned_contacts(assembly, of_move, box, specification.friction, rho)
        unplanned += [one.described(number, told_apart(one, specification, rho)) for one in found]
        back = {"back_off": lift is not None and room > 0.0, "room": None if lift is None else rounded_down(room)}
        moves.append({"move": number, **back, "order": order(assembly, of_move, found, box, retries)})
    covers = covered(box) if retries else box
    said = {"lift": lift, "why": why, "retries": retries, "covers": covers, "moves": moves}
    return {**said, "not_covered": list(NOT_COVERED)}, tuple(unplanned)


def underside(fixed: Polyhedron) -> float:
    """The height (m) of the highest point of faces that look down, those that lean over by 1 pm at most apart."""
    heights = [float(fixed.vertices[:, 2].min())]
    for face in fixed.faces:
        levels = fixed.vertices[list(face.vertices), 2]
        leaning = -float(face.normal[2])
        # A hundredth below what the check admits: rounding must not leave out a face that it counts.
        vertical = leaning <= 0.99 * _UPRIGHT and leaning * float(np.ptp(levels)) <= 0.99 * _FLAT
        if leaning > 0.0 and not vertical:
            heights.append(float(levels.max()))
    return max(heights)


def lowest(body: Polyhedron, segment: Mapping[str, Any], rho: float) -> float:
    """A lower bound of the height (m) of the part's lowest point on a segment of a plan, its greatest travel used up.

    Heights are followed from start to goal, and on from there at the rates that they have there; then the segment's
    errors are taken off.
    """
    start, goal = Pose.from_vector(segment["start"]), Pose.from_vector(segment["goal"])
    shift, turn = np.split(start.local(goal), 2)
    angle = float(np.linalg.norm(turn))
    way = float(np.linalg.norm([*shift, rho * angle]))
    surplus = max(0.0, float(segment["hybrid"]["termination"]["max_travel"]) - way) / max(way, 1e-30)
    reach = np.linalg.norm(body.vertices, axis=1)
    ends = np.stack([start.apply(body.vertices)[:, 2], goal.apply(body.vertices)[:, 2]])
    fall = -(shift[2] + cross(turn, body.vertices @ goal.R.T)[:, 2])
    # A turn by θ takes a point off the chord between its ends by r θ²/8 at most, off the tangent beyond by r θ²/2.
    after = surplus * np.maximum(0.0, fall) + 0.5 * reach * (surplus * angle) ** 2
    tube = segment["tube"]
    errors = np.array([0.0, 0.0, tube["offset_box"][2], *tube["angle_box"]])  # errors sideways lower nothing
    sunk = np.maximum(_sunk(body, start, errors), _sunk(body, goal, errors))
    return float((np.minimum(ends.min(axis=0) - reach * angle**2 / 8.0, ends[1] - after) - sunk - body.radii).min())


def _sunk(body: Polyhedron, pose: Pose, errors: Array) -> Array:
    """By how much (n,) errors of at most so much may lower the vertices, m."""
    w = body.vertices @ pose.R.T
    turned = errors[3] * np.abs(w[:, 1]) + errors[4] * np.abs(w[:, 0])
    return np.asarray(errors[2] + turned + 0.5 * np.linalg.norm(w, axis=1) * float(errors[3:] @ errors[3:]))


def _clear(body: Polyhedron, fixed: Polyhedron, first: Pose, box: Array, turn: float) -> float:
    """The height from which the part may be carried: the turn bows ways by r θ²/8, errors lower it."""
    r = float((np.linalg.norm(body.vertices, axis=1) + body.radii).max())
    errors = float(box[2]) + r * float(box[3] + box[4]) + 0.5 * r * float(box[3:] @ box[3:])
    over = float(fixed.vertices[:, 2].max()) + r * turn**2 / 8.0 + errors + _SPARE
    return max(over, float((first.apply(body.vertices)[:, 2] - body.radii).min()) + _SLACK)


def offsets(box: Array) -> list[list[float]]:
    """Shifts (6,) of the start by whole widths of its box in x and y, m, the nearer ones first; none at all last.

    The same start once more is for moves that fail although the errors are those that the plan is for.
    """
    sides = [(0.0, -2.0 * a, 2.0 * a) if a > 0.0 else (0.0,) for a in map(float, box[:2])]
    around = [(x, y) for x, y in product(*sides) if x or y]
    nearest = sorted(around, key=lambda at: bool(at[0]) + bool(at[1]))
    return [[x, y, 0.0, 0.0, 0.0, 0.0] for x, y in (*nearest, (0.0, 0.0))]


def covered(box: Array) -> list[float]:
    """Half-widths (6,) of what the shifts of `offsets` cover: `SHARE` in x and y, rounded down."""
    wider = [SHARE * float(a) for a in box[:2]]
    exact = [SHARE * Fraction(float(a)) for a in box[:2]]
    # The check compares exactly, so that no rounding upwards is let through.
    sure = [math.nextafter(w, 0.0) if Fraction(w) > e else w for w, e in zip(wider, exact, strict=True)]
    return [*sure, *map(float, box[2:])]


def told_apart(found: UnplannedCandidate, specification: Specification, rho: float) -> bool:
    """Whether noise of the force signal leaves a contact apart from the wanted one: by its angle, or without one."""
    if found.angle is None:
        return True
    noise = _SURE * math.hypot(NOISE[0], NOISE[1] / rho) / max(specification.termination_force, 1e-9)
    return math.sin(min(found.angle, 0.5 * math.pi)) > noise


def order(
    assembly: Assembly,
    claims: Sequence[Claim],
    found: Sequence[UnplannedCandidate],
    box: Array,
    retries: Sequence[Sequence[float]],
) -> dict[str, list[int]]:
    """In which order to try again after a move failed: `late`, its contact not felt, or `early`; `box` is (6,)."""
    piece = claims[-1].piece
    images = images_of(claims[-1].advance.ends.start_set, np.flatnonzero(box))
    sure = np.where(box > 0.0, box, 1.0)  # axes without error have no shift
    rows = [one.row / one.gap for one in found]
    made = np.zeros(6)
    if piece.made is not None:
        made = contact_rows(assembly, [piece.made], piece.making, piece.goal).N[0] @ images
        rows.append(made / max(float(np.abs(made).sum()), 1e-30))
    errors = [-np.asarray(offset) / sure for offset in retries]
    # Rounded, so that shifts that say the same keep their order. The same start once more comes last.
    late = [(not e.any(), -round(float(made @ e), 12)) for e in errors]
    early = [(not e.any(), round(min((float(row @ e) for row in rows), default=0.0), 9)) for e in errors]
    return {felt: sorted(range(len(errors)), key=told.__getitem__) for felt, told in (("late", late), ("early", early))}
