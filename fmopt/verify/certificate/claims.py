"""The claims of one segment against what follows from its poses, basis and witnesses.

That a contact being made comes nearer, and one given up gets farther away, all along a piece, on every execution.

The distance of the one then has one zero on each execution's way, at which the execution stops, and progress can be
measured on that way. The distance of the other is zero when its move starts, and positive ever after.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from fmopt.verify.arithmetic.rational import (
    SLACK,
    ArithmeticRefusal,
    Row,
    Square,
    inverse,
    length,
    number,
    over,
    root,
    row,
    row_dot,
    times,
    vector,
)
from fmopt.verify.certificate.chain import Stage
from fmopt.verify.certificate.edge_planes import Known
from fmopt.verify.certificate.error_set import ErrorSet, metric, seen
from fmopt.verify.certificate.facet_margin import facet_margin
from fmopt.verify.certificate.form import made_lever, varied
from fmopt.verify.certificate.propagation import Motion
from fmopt.verify.certificate.separating_plane import Apart, WitnessError, apart
from fmopt.verify.findings import ALLOWANCE, MARGIN_FLOOR, RELATIVE, Notes
from fmopt.verify.parts.assembly import Assembly
from fmopt.verify.parts.rows import Distance, Function, PointAbove
from fmopt.verify.reading.document import Numbers

# What double arithmetic leaves of entries of shape matrices that should be zero, as radii in m and rad, and as a share.
_SHAPE_FLOOR = (3e-10,) * 3 + (2e-8,) * 3
_SHAPE_SKEW = (1e-17,) * 3 + (1e-15,) * 3
_ROUNDING = 2e-12
_GENERATOR_FLOOR = 3e-15
_NORMAL_FLOOR = 1e-14
_TWIST_FLOOR = 1e-15  # m or rad: rounding of a twist between two poses
_RECIPROCAL = 1e-9


@dataclass(frozen=True)
class Outcome:
    """What a segment comes to.

    Attributes:
        margin: the least derived margin, fixed point; None when a claim could not be derived.
        failed: pairs that are not shown to be apart, with the row that is tightest.
    """

    margin: int | None
    failed: tuple[tuple[int, int, tuple[Distance, Distance] | None], ...]


def check_segment(assembly: Assembly, stage: Stage, start: ErrorSet, notes: Notes) -> Outcome:
    """Compares every stated number of a segment with the derived one.

    Args:
        assembly: parts and contacts.
        stage: the segment, derived.
        start: the error set at its start, thickness included.
        notes: takes what does not agree.
    """
    _tube(stage, start, notes)
    # All margins by name: the least is that of the segment, and what is said to bind has to be as small.
    named: list[tuple[int, str]] = []
    failed = _separations(assembly, stage, named, notes)
    complete = len(named) == len(assembly.moving_pieces) * len(assembly.fixed_pieces)
    _contacts(assembly, stage, named, notes)
    _before(assembly, stage, named, notes)
    _after(assembly, stage, notes)
    _hybrid(stage, notes)
    if not complete:
        return Outcome(None, failed)
    segment = stage.segment
    margin = min(value for value, _ in named)
    notes.at_most("margin", segment.margin, margin)
    # What ties with the least but for rounding may be named as what binds.
    tied = number(margin) * (1.0 + RELATIVE) + MARGIN_FLOOR
    if not any(name == segment.binding and number(value) <= tied for value, name in named):
        notes.add("binding_contact", f"{segment.binding!r} is not what is tightest")
    return Outcome(margin, failed)


def _tube(stage: Stage, start: ErrorSet, notes: Notes) -> None:
    tube, motion = stage.segment.tube, stage.motion
    for end, errors in (("start", start), ("goal", motion.goal_errors)):
        _generators(f"generators_{end}", tube.matrices[f"generators_{end}"], errors.generators, notes)
        for kind, Q in errors.ellipsoids(metric(motion.task.rho)):
            _shape(f"{kind}_{end}", tube.matrices[f"{kind}_{end}"], Q, notes)
    half = motion.half
    for axis, stated_width in enumerate(tube.box):
        notes.at_least(f"offset_box[{axis}]", stated_width, half[axis], ALLOWANCE)
    for axis, stated_angle in enumerate(tube.angles):
        notes.at_least(f"angle_box[{axis}]", stated_angle, half[3 + axis], ALLOWANCE)
    notes.at_least("offset_max", tube.offset, length(vector(tube.box)), ALLOWANCE)
    notes.at_least("theta_max", tube.theta, length((half[3], half[4], half[5])), ALLOWANCE)


def _shape(what: str, stated: Sequence[Numbers], Q: Square, notes: Notes) -> None:
    radii = [number(root(Q[a][a])) for a in range(6)]
    for a, (values, derived) in enumerate(zip(stated, Q, strict=True)):
        least, skew, radius = _SHAPE_FLOOR[a], _SHAPE_SKEW[a], radii[a]
        for b, (x, y) in enumerate(zip(values, derived, strict=True)):
            # Entries that should vanish are noise of doubles, in proportion to the radii of both axes.
            floor = least * _SHAPE_FLOOR[b] + _ROUNDING * radius * radii[b]
            floor += skew * radii[b] + _SHAPE_SKEW[b] * radius
            value = number(y)
            if abs(x - value) > RELATIVE * abs(value) + floor:
                notes.add(f"{what}[{a}][{b}]", f"entry 0 is stated as {x!r}, but follows as {value!r}")


def _generators(what: str, stated: tuple[tuple[float, ...], ...], derived: tuple[Row, ...], notes: Notes) -> None:
    if len(stated) != len(derived):
        notes.add(what, f"has {len(stated)} generators where the check derives {len(derived)}")
        return
    for k, (g, h) in enumerate(zip(stated, derived, strict=True)):
        notes.equal(f"{what}[{k}]", g, h, _GENERATOR_FLOOR)


def _separations(
    assembly: Assembly, stage: Stage, named: list[tuple[int, str]], notes: Notes
) -> tuple[tuple[int, int, tuple[Distance, Distance] | None], ...]:
    segment = stage.segment
    pairs = [(i, j) for i in range(len(assembly.moving_pieces)) for j in range(len(assembly.fixed_pieces))]
    # Every pair, in order: one that is left out would not be proved apart.
    if [(s.moving, s.fixed) for s in segment.separations] != pairs:
        notes.add("separations", "must list every pair of pieces once, in order")
        return ()
    hinge = assembly.hinge(stage.made, stage.state) if stage.made is not None else None
    known = Known(stage.facts, stage.made, hinge, stage.leaving, stage.coming_off)
    failed: list[tuple[int, int, tuple[Distance, Distance] | None]] = []
    clearances: list[int] = []
    for stated in segment.separations:
        i, j = stated.moving, stated.fixed
        name = f"pieces {i}/{j}"
        try:
            M, F = assembly.moving_pieces[i], assembly.fixed_pieces[j]
            found: Apart = apart(assembly, M, F, stated.witness, stage.motion, known)
        except (WitnessError, ArithmeticRefusal) as error:
            notes.add(name, f"its witness {error}")
            failed.append((i, j, None))
            continue
        named.append((found.margin, name))
        clearances.append(found.clearance)
        notes.at_most(name, stated.margin, found.margin)
        notes.positive(name, found.margin)
        if found.margin <= 0:
            failed.append((i, j, found.tightest))
    # A clearance is of all pairs; with one missing there is none to compare.
    if len(clearances) == len(pairs):
        notes.about("clearance", segment.clearance, min(clearances))
    return tuple(failed)


def _contacts(assembly: Assembly, stage: Stage, named: list[tuple[int, str]], notes: Notes) -> None:
    segment, motion = stage.segment, stage.motion
    last = motion.task.last
    new = [t for t in stage.goal_state if t.id not in segment.state] if last else []
    expected = [(t, "held") for t in stage.state] + [(t, "made") for t in new]
    if [(c.id, c.role) for c in segment.contacts] != [(t.id, role) for t, role in expected]:
        notes.add("contacts", "must list the contacts of the state, then on a move's last piece the new ones")
        return
    # Roles decide which form a contact has: those made are measured at the goal, where they hold.
    forms = stage.goal_state if last else stage.state
    for stated, (touch, role) in zip(segment.contacts, expected, strict=True):
        held = role == "held"
        margin = facet_margin(assembly, touch, stage.state if held else stage.goal_state, motion, held)
        named.append((margin, touch.id))
        notes.at_most(f"margin of {touch.id}", stated.margin, margin)
        notes.positive(touch.id, margin)
        function = assembly.function(touch, forms)
        goal = motion.ends(function)[1]
        notes.equal(f"normal of {touch.id}", stated.normal, goal.N, _NORMAL_FLOOR)
        notes.equal(f"offset of {touch.id}", [stated.offset], [-goal.f], MARGIN_FLOOR)
        notes.at_least(
            f"remainder of {touch.id}", stated.remainder, motion.rest(function) + motion.loss(function), ALLOWANCE
        )


def _before(assembly: Assembly, stage: Stage, named: list[tuple[int, str]], notes: Notes) -> None:
    """That the contact being made is not there when the move starts, and comes nearer all along.

    Its row then has one zero on every execution's way, at which the execution stops.
    """
    # Without a contact to make there is nothing to touch too early.
    motion = stage.motion
    if stage.made is None or motion.made is None:
        return
    if stage.segment.progress[0] == 0.0:
        first = motion.ends(motion.made)[0]
        room = motion.at_start(motion.made)
        if assembly.form:
            room += motion.loss(motion.made) - times(assembly.form, made_lever(motion, motion.room)) - 1
        if not any(first.N[:3]) and first.bend is None:
            # A row that measures an angle: the way on an arm of ρ.
            room = over(times(room, motion.task.rho), first.reach)
        name = f"{stage.made.id} too early"
        named.append((room, name))
        notes.positive(name, room)
    if approach(motion) <= 0:
        notes.add(stage.made.id, "some executions may move away from it before they touch")


def _after(assembly: Assembly, stage: Stage, notes: Notes) -> None:
    """That the contacts given up, touched when the move starts, open all along, and what lies flat with them."""
    motion = stage.motion
    for touch in stage.leaving:
        if departure(motion, assembly.function(touch, ())) <= 0:
            notes.add(touch.id, "some executions may stay in touch with it, or touch it again, when it is to be left")
    for wall, v in stage.coming_off:
        if departure(motion, PointAbove(wall, v, length(v))) <= 0:
            notes.add("leaving", "a point that lies flat with the contacts that it gives up may fall again")


def _hybrid(stage: Stage, notes: Notes) -> None:
    """That the control strategy goes along V, and servoes what the held contacts leave free and nothing else."""
    hybrid, motion = stage.segment.hybrid, stage.motion
    if hybrid is None:
        return
    floor = _TWIST_FLOOR / number(motion.length)
    # The tolerance is of a twist; divided by its length it is one of the unit twist.
    notes.equal("velocity", hybrid.velocity, [over(x, motion.length) for x in motion.twist], floor)
    counts = len(hybrid.position_axes), len(hybrid.force_axes)
    held = len(motion.held)
    if counts != (6 - held, held):
        notes.add("hybrid", f"has {counts[0]} position and {counts[1]} force axes for {held} independent contacts")
        return
    try:
        # As rows of one matrix, axes are independent where it has an inverse.
        inverse([row(axis) for axis in (*hybrid.position_axes, *hybrid.force_axes)])
    except ArithmeticRefusal:
        notes.add("hybrid", "its axes are not independent")
    for twist in hybrid.position_axes:
        for wrench in hybrid.force_axes:
            # Reciprocal: force control does no work along what is servoed in position, so that neither drives the
            # other.
            if abs(sum(a * b for a, b in zip(twist, wrench, strict=True))) > _RECIPROCAL:
                notes.add("hybrid", "a force axis does work along a position axis")


def approach(motion: Motion) -> int:
    """A lower bound, in fixed point, of how far the made contact comes nearer; positive: on every execution it does."""
    if motion.made is None:
        return 0
    start, goal = motion.ends(motion.made)
    # The gradient turns between the ends: the worse of both, less what it may change in between and with errors.
    nearer = min(-row_dot(goal.N, motion.motion), -row_dot(start.N, motion.motion))
    return nearer - _change(motion, motion.made) - SLACK


def departure(motion: Motion, function: Function) -> int:
    """A lower bound, in fixed point, of how much a row grows along the piece; positive: on every execution it does.

    Args:
        motion: the piece.
        function: of a contact given up, 0 at its start.
    """
    start, goal = motion.ends(function)
    farther = min(row_dot(goal.N, motion.motion), row_dot(start.N, motion.motion))
    return farther - _change(motion, function) - SLACK


def _change(motion: Motion, function: Function) -> int:
    """By how much a row may grow more or less along the piece than at the nominal poses of its ends.

    The row turns along the piece; the velocity error adds to the motion; and the held rows turn as well, so that the
    motion inside them changes (their share counted twice, which covers the second order). In a hole that is askew by h
    all motion is seen turned by it, and a part that is off by g in the hand swings by its turn across g.
    """
    start, goal = motion.ends(function)
    change = _turned(motion, start, goal) + times(motion.cone(seen(goal.N, motion.hold)), motion.length)
    for held, column in zip(motion.held, motion.held_dual, strict=True):
        # Twice: the directions that give way may differ at both ends of the way.
        change += 2 * times(abs(row_dot(goal.N, column)), _turned(motion, *motion.ends(held)))
    return change + _swung(motion, seen(goal.N, motion.hold))


def _swung(motion: Motion, N: Row) -> int:
    """How much a row grows more or less along the piece for errors that are fixed in the hole and in the hand."""
    if motion.linkage is None:
        return 0
    _, askew, off, _ = motion.linkage.sizes
    rate, turning = motion.task.rates
    slid = length(motion.motion[:3]) + times(rate, motion.length)
    spun = length(motion.motion[3:]) + times(over(turning, motion.task.rho), motion.length)
    for held, column in zip(motion.held, motion.held_dual, strict=True):
        given = 2 * _turned(motion, *motion.ends(held))
        slid, spun = slid + times(given, length(column[:3])), spun + times(given, length(column[3:]))
    return times(length(N[:3]), times(askew, slid) + times(off, spun)) + times(length(N[3:]), times(askew, spun)) + 8


def _turned(motion: Motion, start: Distance, goal: Distance) -> int:
    """A bound of how much a row's product with the motion differs between poses of the piece."""
    return varied(start, goal, motion.motion, motion.extent)
