"""The claims of one segment against what follows from its poses, basis and witnesses.

That a contact being made comes nearer, and one given up gets farther away, all along a piece, on every execution.

The distance of the one then has one zero on each execution's way, at which the execution stops, and progress can be
measured on that way. The distance of the other is zero when its move starts, and positive ever after.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from fmopt.verify.arithmetic.rational import (
    BITS,
    ONE,
    SLACK,
    ArithmeticRefusal,
    Row,
    add,
    cross,
    inverse,
    length,
    number,
    over,
    row,
    row_dot,
    times,
)
from fmopt.verify.certificate.chain import Stage
from fmopt.verify.certificate.edge_planes import Known
from fmopt.verify.certificate.error_set import row_of, seen
from fmopt.verify.certificate.facet_margin import facet_margin
from fmopt.verify.certificate.form import made_lever, varied
from fmopt.verify.certificate.propagation import Motion
from fmopt.verify.certificate.separating_plane import Apart, WitnessError, apart
from fmopt.verify.findings import ALLOWANCE, MARGIN_FLOOR, RELATIVE, Notes
from fmopt.verify.parts.assembly import PartPair
from fmopt.verify.parts.rows import Distance, Function, PointAbove, size

_NORMAL_FLOOR = 1e-14  # of unit normals, and of their torques on arms in m
_TWIST_FLOOR = 1e-15  # m or rad: rounding of a twist between two poses
_RECIPROCAL = 1e-9  # power that rounding may leave a force axis on a position axis


@dataclass(frozen=True)
class SegmentOutcome:
    """What a segment comes to: its least derived margin, fixed point, None when a claim could not be derived.

    Failed are pairs that are not shown to be apart, with the row that is tightest.
    """

    margin: int | None
    failed: tuple[tuple[int, int, tuple[Distance, Distance] | None], ...]


def check_segment(assembly: PartPair, stage: Stage, notes: Notes) -> SegmentOutcome:
    """Compares every stated number of a segment with the derived one."""
    _tube(stage, notes)
    # All margins by name: the least is that of the segment, and what is said to bind has to be as small.
    named: list[tuple[int, str]] = []
    failed = _separations(assembly, stage, named, notes)
    complete = len(named) == len(assembly.moving_pieces) * len(assembly.fixed_pieces)
    _contacts(assembly, stage, named, notes)
    _before(assembly, stage, named, notes)
    _after(assembly, stage, notes)
    _hybrid(stage, notes)
    if not complete:
        return SegmentOutcome(None, failed)
    segment = stage.segment
    margin = min(value for value, _ in named)
    notes.at_most("margin", segment.margin, margin)
    # What ties with the least but for rounding may be named as what binds.
    tied = number(margin) * (1.0 + RELATIVE) + MARGIN_FLOOR
    if not any(name == segment.binding and number(value) <= tied for value, name in named):
        notes.add("binding_contact", f"{segment.binding!r} is not what is tightest")
    return SegmentOutcome(margin, failed)


def _tube(stage: Stage, notes: Notes) -> None:
    tube, half = stage.segment.tube, stage.motion.half
    for axis, stated_width in enumerate(tube.box):
        notes.at_least(f"offset_box[{axis}]", stated_width, half[axis], ALLOWANCE)
    for axis, stated_angle in enumerate(tube.angles):
        notes.at_least(f"angle_box[{axis}]", stated_angle, half[3 + axis], ALLOWANCE)
    notes.at_least("theta_max", tube.theta, length((half[3], half[4], half[5])), ALLOWANCE)


def _separations(
    assembly: PartPair, stage: Stage, named: list[tuple[int, str]], notes: Notes
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


def _contacts(assembly: PartPair, stage: Stage, named: list[tuple[int, str]], notes: Notes) -> None:
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
        lost = motion.rest(function) + motion.loss(function)
        notes.at_least(f"remainder of {touch.id}", stated.remainder, lost, ALLOWANCE)


def _before(assembly: PartPair, stage: Stage, named: list[tuple[int, str]], notes: Notes) -> None:
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
            # Off its form a contact may touch up to its lever times Δ away from zero: that counts in place of the loss.
            room += motion.loss(motion.made) - times(assembly.form, made_lever(motion, motion.room)) - 1
        if not any(first.N[:3]) and first.bend is None:
            # A row that measures an angle: the way on an arm of ρ.
            room = over(times(room, motion.task.rho), first.reach)
        name = f"{stage.made.id} too early"
        named.append((room, name))
        notes.positive(name, room)
    if approach(motion) <= 0:
        notes.add(stage.made.id, "some executions may move away from it before they touch")


def _after(assembly: PartPair, stage: Stage, notes: Notes) -> None:
    """That the contacts given up, touched when the move starts, open all along, and what lies flat with them."""
    motion = stage.motion
    for touch in stage.leaving:
        if departure(motion, assembly.function(touch, ())) <= 0:  # its own distance, as it has no hinge
            notes.add(touch.id, "some executions may stay in touch with it, or touch it again, when it is to be left")
    for wall, v in stage.coming_off:
        if departure(motion, PointAbove(wall, v, length(v))) <= 0:
            notes.add("leaving", "a point that lies flat with the contacts that it gives up may fall again")


def _hybrid(stage: Stage, notes: Notes) -> None:
    """That the control strategy goes along V, and servoes what the held contacts leave free and nothing else."""
    hybrid, motion = stage.segment.hybrid, stage.motion
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
            # Reciprocal: force control does no work along what is servoed in position, neither drives the other.
            if abs(sum(a * b for a, b in zip(twist, wrench, strict=True))) > _RECIPROCAL:
                notes.add("hybrid", "a force axis does work along a position axis")


def approach(motion: Motion) -> int:
    """A lower bound, in fixed point, of how far the made contact comes nearer; positive: on every execution it does."""
    return 0 if motion.made is None else _Growth(motion, motion.made).least(-1)


def departure(motion: Motion, function: Function) -> int:
    """A lower bound, in fixed point, of how much a row grows along the piece; positive: on every execution it does.

    The row is that of a contact given up, 0 at its start.
    """
    return _Growth(motion, function).least(1)


class _Growth:
    """How much a row N grows along a piece at every pose of it and with every error, while the held rows Nᵢ stay.

    An execution goes along v + w + D λ: the motion v inside the held rows where the piece ends, what velocity errors
    add, and what the directions D, dual to the held rows there, give way by so that Nᵢ·(v + w + D λ) = 0 at each pose.
    With aᵢ = N·Dᵢ, r = N − Σ aᵢ Nᵢ feels nothing of D where the piece ends, and N grows by r·(v + w + D λ): what rows
    have in common as they turn cancels in r. Products of rows and motions are interpolated between both ends, and of
    first order in the errors; what is left has closed bounds.
    """

    def __init__(self, motion: Motion, function: Function) -> None:
        self._motion = motion
        self._ends = [*(motion.ends(held) for held in motion.held), motion.ends(function)]
        self._sizes = [size(*ends) for ends in self._ends]
        goal = self._ends[-1][1].N
        self._shares = [*(-row_dot(goal, column) for column in motion.held_dual), ONE]
        self._seen = seen(goal, motion.hold)
        rates = motion.task.rates[0], over(motion.task.rates[1], motion.task.rho)
        drift = times(rates[0], motion.length) + 2, times(rates[1], motion.length) + 2
        self._drift = self._wide = drift
        if motion.linkage is not None:
            # All motion is seen turned by how much the hole is askew; a part swings across its place in the hand.
            _, askew, off, _ = motion.linkage.sizes
            slid, spun = length(motion.motion[:3]), length(motion.motion[3:])
            self._wide = drift[0] + times(askew, slid) + times(off, spun) + 4, drift[1] + times(askew, spun) + 4

    def least(self, sign: int) -> int:
        """A lower bound of how much sign · N grows."""
        motion, own, v = self._motion, self._shares, self._motion.motion
        grows = [sum(times(c, row_dot(ends[e].N, v)) for c, ends in zip(own, self._ends, strict=True)) for e in (0, 1)]
        lost = self._combined(v)[1] + times(motion.cone(self._seen), motion.length)
        lost += sum(times(abs(c), self._loose(i)) + 1 for i, c in enumerate(own))
        given = self._given() if motion.held else []
        if given is None:
            return -ONE
        for column, most in zip(motion.held_dual, given, strict=True):
            along, error = self._combined(column)
            lost += times(abs(along) + error, most) + 1
        return min(sign * x for x in grows) - lost - self._swung(given) - 64 * (1 + len(own)) - SLACK

    def _given(self) -> list[int] | None:
        """Bounds of |λ|: with (1 + Ε)λ = −η at most η + Εη/(1 − q), q the largest row sum of Ε; None from q = 1."""
        motion, held = self._motion, range(len(self._motion.held))
        eta, most, q = [], 0, 0
        for i in held:
            start, goal = (end.N for end in self._ends[i])
            rest = abs(row_dot(start, motion.motion)), abs(row_dot(goal, motion.motion))
            drift = times(self._drift[0], length(goal[:3])) + times(self._drift[1], length(goal[3:])) + self._loose(i)
            eta.append(max(rest) + self._error(i, motion.motion) + drift + 8)
        for i in held:
            start = self._ends[i][0].N
            differs = [
                abs(row_dot(start, column) - (ONE if i == j else 0)) + self._error(i, column) + 8
                for j, column in enumerate(motion.held_dual)
            ]
            q, most = max(q, sum(differs)), max(most, sum(times(x, y) + 1 for x, y in zip(differs, eta, strict=True)))
        return None if q >= ONE else [x + over(most, ONE - q) + 1 for x in eta]

    def _combined(self, mu: Row) -> tuple[int, int]:
        """Of r·μ what it is where the piece starts, and by how much it may differ from its values at both ends."""
        along = sum(times(c, row_dot(ends[0].N, mu)) for c, ends in zip(self._shares, self._ends, strict=True))
        felt = []
        for e in (0, 1):
            slopes = [_power(ends[e], mu) for ends in self._ends]
            felt.append(row_of(sum(map(times, self._shares, column)) for column in zip(*slopes, strict=True)))
        left = sum(times(abs(c), self._left(i, mu)) + 1 for i, c in enumerate(self._shares))
        return along, max(map(self._boxed, felt)) + left

    def _error(self, i: int, mu: Row) -> int:
        """By how much Nᵢ·μ may differ from its values at both ends, interpolated."""
        return max(self._boxed(_power(end, mu)) for end in self._ends[i]) + self._left(i, mu)

    def _boxed(self, slope: Row) -> int:
        """The largest product with errors in the box."""
        half = (*self._motion.extent.box, *self._motion.extent.angles)
        return (sum(abs(x) * y for x, y in zip(slope, half, strict=True)) >> BITS) + 16

    def _left(self, i: int, mu: Row) -> int:
        """What Nᵢ·μ, μ = (x, ξ), differs by from its first order in the errors, interpolated between the ends.

        ½θ²(|ξ| s + |x|) and θ|ξ||d| beyond the first order, s the row's size, and an eighth of the second derivative
        along the nominal path of all that is interpolated; no |x| and |d| in rows that are not bilinear.
        """
        extent, slide, spin = self._motion.extent, length(mu[:3]), length(mu[3:])
        a, t, swing, left, chord = extent.theta, extent.turn, times(spin, self._sizes[i]), 0, 0
        if self._ends[i][0].bend is not None:
            swing += slide
            left = times(times(a, extent.offset), spin)
            chord = times(times(2 * t, length(extent.travel)), spin)
            chord += times(a, chord) + times(times(t, t), times(extent.offset, spin))
        chord += times(times(t, t), swing + times(a, swing))
        return left + (times(times(a, a), swing) >> 1) + (chord >> 3) + 32

    def _loose(self, i: int) -> int:
        """By how much Nᵢ·w may differ between poses, for what is added to the motion in any direction."""
        slide, spin = self._wide
        return varied(*self._ends[i], (slide, 0, 0, spin, 0, 0), self._motion.extent) + 8

    def _swung(self, given: Sequence[int]) -> int:
        """How much the row grows more or less along the piece for errors that are fixed in the hole and in the hand."""
        motion, N = self._motion, self._seen
        if motion.linkage is None:
            return 0
        _, askew, off, _ = motion.linkage.sizes
        slid, spun = length(motion.motion[:3]) + self._drift[0], length(motion.motion[3:]) + self._drift[1]
        for column, most in zip(motion.held_dual, given, strict=True):
            slid, spun = slid + times(most, length(column[:3])), spun + times(most, length(column[3:]))
        moved = times(askew, slid) + times(off, spun)
        return times(length(N[:3]), moved) + times(length(N[3:]), times(askew, spun)) + 8


def _power(distance: Distance, mu: Row) -> Row:
    """How N·μ, μ = (x, ξ), changes with the error, to first order: Mᵀ(ξ × β), and w × (u × ξ) + β × (y × ξ + M x)."""
    spin = mu[3:]
    turning = cross(distance.turned, cross(distance.push, spin))
    if distance.bend is None:
        return (0, 0, 0, *turning)
    beta, y, _ = distance.bend
    pulled = distance.bend.pulled(cross(spin, beta))
    return pulled + add(turning, cross(beta, add(cross(y, spin), distance.bend.moved(mu[:3]))))
