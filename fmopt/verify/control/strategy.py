"""Whether the hybrid strategy of a segment does what the segment's contacts ask for.

Forces rest on no inequality that could be short by a rounding, so they are judged in double arithmetic, to tolerances
far below what a controller can tell. With wrenches wᵢ of the held contacts for unit normal forces, w of what ends the
move, and the unit twist V, all about the part's reference point at the segment's goal:

- every held contact that touches there is pressed, fᵢ > 0, and the bias is −Σ fᵢ wᵢ + b u, where u is the unit wrench
  along the motion without power on what the held contacts stop;
- b u·V ≥ 1.25 h |w·V| + μ Σ fᵢ sᵢ, the push alone makes the contact felt against friction, sᵢ the sliding speeds;
- nothing exceeds the specified forces;
- position axes are the motions that the held contacts leave free, force axes the wrenches that they can take;
- the move ends by the reaction of the contacts that it makes, or by its travel, which covers its errors and the
  overtravel of its pieces;
- held contacts stay closed under what the strategy says they do, see `jamming`;
- contacts are met as softly as is asked for, see below;
- where it is said how far the applied wrench may turn before friction can balance it, that follows, see `jamming`.

Whether contacts are met as softly as is asked for.

A mass m that meets a stiffness k at the normal speed vₙ does so with F = vₙ √(k m). The speed is bounded for every
error: the contact is met on the moving feature, between whose vertices vₙ is linear, and a turn of the part by up to θ
moves their arms a by up to |a| θ and the normal by up to an angle φ. With u = v + ω × a for the unit twist (v, ω) and
shares (e_t, e_r) of velocity error

    vₙ ≤ min(|u| + |ω| |a| θ,  |n·u| + |ω| |a| θ + φ (|u| + |ω| |a| θ)) + e_t + e_r |a| / ρ,

φ = 0 on a face of the fixed part, arcsin θ on one of the moving part, arcsin(θ / sin α) for edges that cross at α.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

from fmopt.verify.arithmetic.rational import doubles, number, sub
from fmopt.verify.certificate.chain import Stage
from fmopt.verify.control.jamming import Drive, check_jam_free, check_stays
from fmopt.verify.findings import RELATIVE, Notes
from fmopt.verify.parts.assembly import PartPair, Touch
from fmopt.verify.parts.reach import PosedContact, cross, dot, touching, unit_wrench
from fmopt.verify.parts.rows import CheckedPose, pose
from fmopt.verify.reading.document import Hybrid, StatedSpecification
from fmopt.verify.reading.reader import Numbers

_SURE = 1.25  # times the threshold that the push alone must bring about
_EXACT = 1e-11  # relative: what double arithmetic may leave of an equality between forces or axes
_RANK = 1e-6
_AT = 1e-8  # m: a contact nearer to its rim than this may be counted as touching or not
_OVER = 1e-9  # relative: by how much a limit of force may be exceeded
_LEVEL = 1e-3  # sine of the angle below which edges fix no normal
_ROUNDING = 1e-9  # relative


def check_strategy(
    assembly: PartPair, stage: Stage, rho: float, error: Numbers, asked: StatedSpecification, notes: Notes
) -> None:
    """Judges the strategy of a segment."""
    hybrid = stage.segment.hybrid
    held = _listed(assembly, stage, "normal_forces", [name for name, _ in hybrid.pressed], stage.state, notes)
    new = [t for t in stage.goal_state if t.id not in stage.segment.state]
    made = _listed(assembly, stage, "termination.contacts", list(hybrid.felt), new, notes)
    if held is None or made is None:
        return
    scale = (1.0, 1.0, 1.0, rho, rho, rho)
    rank = len(stage.motion.held)
    basis = _span([tuple(x / s for x, s in zip(c.wrench, scale, strict=True)) for c in held], rank)
    if len(basis) != rank:
        notes.add("normal_forces", f"the contacts pressed stop {len(basis)} freedoms, those held {rank}")
        return
    V = tuple(number(x) / number(stage.motion.length) for x in stage.motion.twist)
    _axes(hybrid, held, stage, scale, notes)
    drive = Drive(held, made, V, _along(V, basis, scale), basis, scale)
    _bias(hybrid, drive, asked, notes)
    check_stays(hybrid, drive, asked, notes)
    _end(hybrid, drive, stage, asked, notes)
    theta = stage.segment.tube.theta + math.hypot(*(number(x) for x in stage.motion.twist[3:]))
    check_impact(hybrid, new, Arrival(pose(stage.segment.goal), V, theta, error, rho), asked, notes)
    check_jam_free(hybrid, drive, stage.segment.goal, asked, notes)


def _listed(
    assembly: PartPair, stage: Stage, field: str, names: Sequence[str], due: Sequence[Touch], notes: Notes
) -> list[PosedContact] | None:
    """The contacts that a strategy lists, when they are those of the due ones that touch at the goal."""
    goal = pose(stage.segment.goal)
    known = {touch.id: touch for touch in due}
    if len(set(names)) != len(names) or not set(names) <= set(known):
        notes.add(field, "lists a contact twice, or one that the segment does not have")
        return None
    for touch in due:
        depth = touching(assembly, touch, goal)
        if touch.id in names and depth < -_AT:
            notes.add(field, f"{touch.id} does not touch at the goal")
            return None
        if touch.id not in names and depth > _AT:
            notes.add(field, f"{touch.id} touches at the goal and is left out")
            return None
    return [unit_wrench(known[name], goal) for name in names]


def _axes(hybrid: Hybrid, held: Sequence[PosedContact], stage: Stage, scale: Numbers, notes: Notes) -> None:
    """That the position axes do no work on the held contacts, and that both kinds are orthonormal in the metric of ρ.

    How many there are, that they are independent, and that each kind is reciprocal to the other is checked before:
    then the position axes span all that is left free, and the force axes all that the held contacts can take.
    """
    frame, goal = pose(hybrid.frame), pose(stage.segment.goal)
    R, arm = frame.in_doubles[1], doubles(sub(frame.p, goal.p))
    origins = [(0.0, 0.0, 0.0), *(c.arm for c in held), *(c.centre for c in held if c.centre is not None)]
    if min(math.dist(arm, origin) for origin in origins) > _EXACT:
        notes.add("frame", "its origin is neither the part's reference point nor a contact point, nor a ball's centre")
    for contact in held:
        force, torque = contact.wrench[:3], contact.wrench[3:]
        moved = [t - x for t, x in zip(torque, cross(arm, force), strict=True)]
        seen = [sum(R[i][k] * x[i] for i in range(3)) for x in (force, moved) for k in range(3)]
        for axis in hybrid.position_axes:
            if abs(dot(axis, seen)) > _EXACT:
                notes.add("position_axes", "a position axis does work on a held contact")
    for what, rows, sizes in (
        ("position_axes", hybrid.position_axes, scale),
        ("force_axes", hybrid.force_axes, tuple(1.0 / x for x in scale)),
    ):
        scaled = [tuple(x * s for x, s in zip(axis, sizes, strict=True)) for axis in rows]
        for i, one in enumerate(scaled):
            for j, other in enumerate(scaled[: i + 1]):
                if abs(dot(one, other) - (i == j)) > _EXACT:
                    notes.add(what, "are not orthonormal in the metric of rho")
                    return


def _bias(hybrid: Hybrid, drive: Drive, asked: StatedSpecification, notes: Notes) -> None:
    """That the bias presses every held contact, and pushes the part towards the one to be made."""
    held, made, V, u = drive.held, drive.made, drive.twist, drive.wrench
    forces = [force for _, force in hybrid.pressed]
    if any(not force > 0.0 for force in forces):
        notes.add("normal_forces", "a held contact is not pressed")
    if hybrid.push < 0.0 or (hybrid.push > 0.0 and not made):
        notes.add("push", "pushes although no contact is to be made, or backwards")
    for k, stated in enumerate(hybrid.bias):
        value = hybrid.push * u[k] - sum(f * c.wrench[k] for f, c in zip(forces, held, strict=True))
        if not abs(stated - value) <= _EXACT * max(abs(value), 1e-2 * asked.contact_force * drive.scale[k]):
            notes.add("bias_wrench", f"entry {k} is stated as {stated!r}, but follows as {value!r}")
    if sum(forces) + hybrid.push > asked.contact_force * (1.0 + _OVER):
        notes.add("bias_wrench", "exceeds the specified contact force")
    if max(abs(x) for x in hybrid.bias[3:]) > asked.torque_limit * (1.0 + _OVER):
        notes.add("bias_wrench", "exceeds the specified torque limit")
    if made:
        drag = asked.friction * sum(f * c.sliding(V) for f, c in zip(forces, held, strict=True))
        needed = _SURE * asked.termination_force * abs(dot(_mean(made), V)) + drag
        if hybrid.push * dot(u, V) < needed * (1.0 - _OVER) - _OVER:
            notes.add("push", f"does the power {hybrid.push * dot(u, V):.6g} N, the contact takes {needed:.6g} N")


def _along(V: Numbers, basis: Sequence[Numbers], scale: Numbers) -> Numbers:
    """The scaled unit wrench along the motion without power on what the rows of the basis stop; zero without any."""
    free = _rest(tuple(v * s for v, s in zip(V, scale, strict=True)), basis)
    size = math.hypot(*free)
    return tuple(x / size for x in free) if size > _RANK else (0.0,) * 6


def _end(hybrid: Hybrid, drive: Drive, stage: Stage, asked: StatedSpecification, notes: Notes) -> None:
    """When the move ends: wrench, threshold, travel and time."""
    reaction, rho = _mean(drive.made), drive.scale[3]
    if drive.made and not dot(reaction, drive.twist) < 0.0:
        notes.add("termination.wrench", "the motion does not run against the contact that ends it")
    tube = stage.segment.tube
    travel = number(stage.motion.length) + max(math.hypot(*tube.box) + rho * tube.theta, number(stage.late))
    # Entries of the wrench that cancel are known to a share of those that do not.
    force = asked.termination_force
    sizes = (*[force] * 3, *[force * rho] * 3)
    for what, stated, value, size in (
        *((f"termination.wrench[{k}]", hybrid.wrench[k], force * reaction[k], sizes[k]) for k in range(6)),
        ("termination.threshold", hybrid.threshold, force, 0.0),
        ("termination.max_travel", hybrid.max_travel, travel, 0.0),
        ("termination.timeout", hybrid.timeout, 2.0 * hybrid.max_travel / max(hybrid.speed, 1e-9), 0.0),
        ("speed", hybrid.speed, allowed_speed(hybrid, asked), 0.0),
    ):
        if not abs(stated - value) <= RELATIVE * max(abs(value), size) + 1e-15:
            notes.add(what, f"is stated as {stated!r}, but follows as {value!r}")


def _mean(contacts: Sequence[PosedContact]) -> Numbers:
    return tuple(sum(c.wrench[k] for c in contacts) / max(len(contacts), 1) for k in range(6))


def _span(rows: Sequence[Numbers], most: int) -> list[Numbers]:
    """Orthonormal rows that span the given ones, the largest remainder first; one more than `most` where there are."""
    left = [tuple(x / math.hypot(*row) for x in row) for row in rows]
    found: list[Numbers] = []
    # One more than so many, to tell that there are too many.
    while left and len(found) <= most:
        best = max(left, key=lambda row: math.hypot(*row))
        size = math.hypot(*best)
        if size <= _RANK:
            break
        # Once more against what was found: the remainder of a nearly dependent row is not orthogonal to it.
        axis = _rest(tuple(x / size for x in best), found)
        size = math.hypot(*axis)
        axis = tuple(x / size for x in axis)
        found.append(axis)
        left = [_rest(row, [axis]) for row in left]
    return found


def _rest(vector: Numbers, rows: Sequence[Numbers]) -> Numbers:
    """What is left of a vector when its parts along orthonormal rows are taken off, one after the other."""
    for row in rows:
        part = dot(row, vector)
        vector = tuple([x - part * y for x, y in zip(vector, row, strict=True)])
    return vector


def allowed_speed(hybrid: Hybrid, asked: StatedSpecification) -> float:
    """The speed (m/s) that a strategy has to state, from the normal speed that it states for a unit twist."""
    if hybrid.impact is None or asked.impact is None:
        return asked.speed
    limit, mass, stiffness = asked.impact
    force = asked.speed * hybrid.impact[0] * math.sqrt(mass * stiffness)
    return asked.speed * min(limit / force, 1.0) if force > 0.0 else asked.speed


class Arrival(NamedTuple):
    """How a part comes to a segment's end: a unit twist V (6,), and by how much it may be turned from there, rad."""

    goal: CheckedPose
    twist: Numbers
    theta: float
    error: Numbers
    rho: float


def check_impact(
    hybrid: Hybrid, made: Sequence[Touch], arrival: Arrival, asked: StatedSpecification, notes: Notes
) -> None:
    """Judges what a strategy says of the impact that ends its move."""
    if asked.impact is None or not made:
        if hybrid.impact is not None:
            notes.add("impact", "is stated although no impact is limited, or none comes")
        return
    if hybrid.impact is None:
        notes.add("impact", "is not stated although it is limited")
        return
    approach, force = hybrid.impact
    limit, mass, stiffness = asked.impact
    met = max(_met(touch, arrival) for touch in made)
    if not approach >= met * (1.0 - _ROUNDING):
        notes.add("impact.approach", f"is stated as {approach!r}, but up to {met!r} follow")
    follows = hybrid.speed * approach * math.sqrt(mass * stiffness)
    if not abs(force - follows) <= RELATIVE * abs(follows):
        notes.add("impact.force", f"is stated as {force!r}, but follows as {follows!r}")
    if not force <= limit * (1.0 + _ROUNDING):
        notes.add("impact.force", f"{force:.6g} N exceed the {limit:.6g} N that are allowed")


def _met(touch: Touch, arrival: Arrival) -> float:
    """The greatest normal speed at which a contact can be met, for the unit twist V."""
    goal, V, theta, error, rho = arrival
    arms = [doubles(goal.turned(v)) for v in touch.moving]
    if touch.kind == "ball-face":
        arms = [unit_wrench(touch, goal).arm]
    normal, turn = _normal(touch, goal, arms, theta)
    v, w = V[:3], V[3:]
    found = 0.0
    for arm in arms:
        u = tuple(x + y for x, y in zip(v, cross(w, arm), strict=True))
        size = math.hypot(*arm)
        shifted = math.hypot(*w) * size * theta
        most = math.hypot(*u) + shifted
        met = min(most, abs(dot(normal, u)) + shifted + turn * most)
        found = max(found, met + error[0] + error[1] * size / rho)
    return found


def _normal(touch: Touch, goal: CheckedPose, arms: Sequence[Numbers], theta: float) -> tuple[Numbers, float]:
    """The unit normal of a contact, and by what angle errors may turn it."""
    if touch.kind in ("vertex-face", "ball-face") and touch.plane is not None:
        return doubles(touch.plane.normal), 0.0
    if touch.kind == "face-vertex" and touch.plane is not None:
        return doubles(goal.turned(touch.plane.normal)), math.asin(min(theta, 1.0))
    own = tuple(x - y for x, y in zip(arms[1], arms[0], strict=True))
    other = doubles(sub(touch.fixed[1], touch.fixed[0]))
    m = cross(own, other)
    size = math.hypot(*m)
    sine = size / (math.hypot(*own) * math.hypot(*other))
    if sine < _LEVEL:
        return (0.0, 0.0, 0.0), math.pi
    return tuple(x / size for x in m), math.asin(min(theta / sine, 1.0))
