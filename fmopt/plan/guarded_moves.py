"""The guarded moves of a plan as whoever runs them needs them: what to servo, what to press, when to stop.

A move ends when its new contacts press, and the sensor has to tell their normal force k from what the held contacts do
meanwhile: their normal forces change, their friction opposes the sliding or does not, and their places are known no
better than the errors allow. With Σ the second moment of all that and of the sensor's noise, and w the wrench of the
new contacts for a unit force, g = Σ⁻¹w / (wᵀΣ⁻¹w) reads k with the least error: it is as blind as it can be to any
force through the points of held contacts. With e the sum of the measured reaction and the holding wrench, the move
stops when g · (e − e at its start) exceeds the threshold by what friction along the move, at the plan's coefficient,
and three standard deviations of noise can add.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

import numpy as np

from fmopt.errors import PlanFormatError
from fmopt.plan import Hybrid, Plan, Segment
from fmopt.plan.contact_geometry import Contact, contacts
from fmopt.spatial.se3 import Pose, cross, hat
from fmopt.spatial.values import Array, Value, frozen

NOISE = (0.05, 0.001)  # N and N·m, standard deviations of the filtered force signal that stops are made for
_ALIKE = 0.999  # cosine between normals of contacts that hold the same
_ADVICE = "give a plan.json that fmopt solve wrote"
_HELD = 1e-6  # N, by which a bias may leave the space of its force axes


@dataclass(frozen=True, eq=False)
class Stop(Value, gain=(6,), wrench=(6,)):
    """Stop when gain · (e − e at the start of the move), the normal force of the new contacts, reaches `force`.

    e is the sum of the measured reaction and the holding wrench.

    Args:
        gain: (6,), N per N and N per N·m of the reaction about the moving frame's origin in axes of B.
        wrench: (6,) of a unit reaction of the new contacts, likewise.
        force: N.
        threshold: N, what `force` has above it is the allowance for friction and noise.
        max_travel: m in the metric of ρ.
        timeout: s.
        gentle: whether held contacts may be pried open by more than the reaction that ends the move.
    """

    gain: Array
    wrench: Array
    force: float
    threshold: float
    max_travel: float
    timeout: float
    contacts: tuple[str, ...]
    gentle: bool = False


@dataclass(frozen=True, eq=False)
class PlanMove(
    Value, twist=(6,), position_axes=(None, 6), force_axes=(None, 6), hold=(6,), hold_start=(6,), rubbing=(6,)
):
    """One segment of a plan.

    Args:
        last: whether it is the last piece of its move.
        length: m in the metric of ρ, from start to goal.
        duration: s, at the plan's speed.
        twist: (6,) of the moving frame's origin, axes of B, m/s and rad/s.
        frame: compliance frame in B.
        position_axes: twists (6 − r, 6) in the frame's coordinates.
        force_axes: wrenches (r, 6) in its coordinates.
        hold, hold_start: wrenches (6,) to apply at the goal and at the start that press the held contacts with the
            plan's normal forces, about the moving frame's origin in axes of B; on a long way their arms change, and
            edges that do not cross yet bear nothing.
        rubbing: wrench (6,) that friction of coefficient 1 on the held contacts puts on the sliding part, about the
            moving frame's origin in axes of B; points that may as well slide the other way count less.
        stop: how the move ends before its travel is used up; None where no contact is expected.
    """

    segment: int
    number: int
    last: bool
    start: Pose
    goal: Pose
    length: float
    duration: float
    twist: Array
    frame: Pose
    position_axes: Array
    force_axes: Array
    hold: Array
    hold_start: Array
    rubbing: Array
    stop: Stop | None
    state: tuple[str, ...]
    goal_state: tuple[str, ...]


def to_frame(frame: Pose, wrench: Array, origin: Array) -> Array:
    """A wrench (…, 6) about an origin (3,), m, axes of B, N and N·m, in the coordinates of a frame."""
    force, torque = wrench[..., :3], wrench[..., 3:]
    moved = torque - force @ hat(frame.p - origin).T  # by rows: f [r]×ᵀ is r × f
    return np.concatenate([force @ frame.R, moved @ frame.R], axis=-1)


def from_frame(frame: Pose, wrench: Array, origin: Array) -> Array:
    """A wrench (…, 6) in the coordinates of a frame, N and N·m, about an origin (3,) of B, m, in axes of B."""
    force, torque = wrench[..., :3] @ frame.R.T, wrench[..., 3:] @ frame.R.T
    return np.concatenate([force, torque + force @ hat(frame.p - origin).T], axis=-1)


def length(start: Pose, goal: Pose, rho: float) -> float:
    """How far it is from pose to pose, m, in the metric of the lever ρ, m."""
    return float(np.linalg.norm(start.local(goal) * [1.0, 1.0, 1.0, rho, rho, rho]))


def moves(plan: Plan) -> tuple[PlanMove, ...]:
    """The segments of a plan in their order.

    Raises:
        PlanFormatError: a segment cannot be run: it goes nowhere, or a bias presses where nothing is held.
    """
    found: list[PlanMove] = []
    known, rows = contacts(plan), plan.segments
    budget = Budget(NOISE, max(plan.start_box[:3]), plan.specification.friction)
    for i, row in enumerate(rows):
        last = i + 1 == len(rows) or row.move != rows[i + 1].move
        try:
            found.append(_move(i, row, last, plan.rho, known, budget))
        except ValueError as error:
            raise PlanFormatError(f"segment {i} of the plan cannot be run: {error}", _ADVICE) from error
    return tuple(found)


class Budget(NamedTuple):
    """Noise of the sensor (N, N·m), what the places of contacts are uncertain by (m), and the friction coefficient."""

    noise: tuple[float, float]
    place: float
    friction: float


Held: TypeAlias = Sequence[tuple[float, tuple[Array, Array]]]
"""Held contacts: normal force, N, unit normal (3,), and arm (3,) from the moving frame's origin, m."""


def _point(contact: Contact, pose: Pose) -> tuple[Array, Array]:
    point, normal, _ = contact.touch(pose)
    return normal, point - pose.p


def _move(index: int, row: Segment, last: bool, rho: float, known: Mapping[str, Contact], budget: Budget) -> PlanMove:
    start, goal = Pose.from_vector(row.start), Pose.from_vector(row.goal)
    hybrid = row.hybrid
    frame = Pose.from_vector(hybrid.frame)
    V = frozen(hybrid.velocity, 6)
    axes = hybrid.position_axes, hybrid.force_axes
    position_axes, force_axes = (np.array(rows, dtype=np.float64).reshape(-1, 6) for rows in axes)
    held = from_frame(frame, force_axes, goal.p)
    scale = np.array([1.0, 1.0, 1.0, rho, rho, rho])
    # Force axes of a plan are independent: the columns span them, and nothing else.
    basis, _ = np.linalg.qr((held / scale).T)
    hold = frozen(hybrid.bias, 6)
    if hybrid.push > 0.0:
        # V′: the part of the twist on which the held wrenches have no power.
        free = (V * scale - basis @ (basis.T @ (V * scale))) / scale
        size = float(np.linalg.norm(free * scale))
        if not size > 0.0:
            raise ValueError("it pushes along a motion that its held contacts stop")
        # The servo pushes along the motion by itself. Scaled, a twist is its wrench; unscaled that has ρ² on turns.
        hold = hold - (hybrid.push / size) * free * scale**2
    rest = float(np.linalg.norm(hold / scale - basis @ (basis.T @ (hold / scale))))
    if rest > _HELD:
        message = f"segment {index}: {rest:.3g} N of its bias press where its force axes hold nothing"
        raise PlanFormatError(message, "solve the problem with this version")
    forces = [(known[contact], force) for contact, force in hybrid.pressed]
    change = _pressing(_shifted(forces, start), start) - _pressing(forces, goal)
    far = length(start, goal, rho)
    points = [(force, _point(contact, goal)) for contact, force in forces]
    return PlanMove(
        index,
        row.move,
        last,
        start,
        goal,
        far,
        far / hybrid.speed,
        V * hybrid.speed,
        frame,
        position_axes,
        force_axes,
        hold,
        hold + change,
        _friction(points, V, budget.place),
        _stop(hybrid, points, V, budget),
        row.state,
        row.goal_state,
    )


def _pressing(forces: Sequence[tuple[Contact, float]], pose: Pose) -> Array:
    """The wrench (6,) that puts these normal forces on contacts."""
    return -sum((force * contact.wrench(pose) for contact, force in forces), start=np.zeros(6))


def _shifted(forces: Sequence[tuple[Contact, float]], pose: Pose) -> list[tuple[Contact, float]]:
    """The forces with those of edges that do not cross yet shared by the contacts of the same normal that touch."""
    normals = [contact.touch(pose)[1] for contact, _ in forces]
    touching = [contact.within(pose) for contact, _ in forces]
    shifted = [force if here else 0.0 for here, (_, force) in zip(touching, forces, strict=True)]
    for i, (_, force) in enumerate(forces):
        mates = [k for k, n in enumerate(normals) if touching[k] and float(n @ normals[i]) > _ALIKE]
        for k in mates if not touching[i] else ():
            shifted[k] += force / len(mates)
    return [(contact, force) for (contact, _), force in zip(forces, shifted, strict=True)]


def _stop(hybrid: Hybrid, move: Held, V: Array, budget: Budget) -> Stop | None:
    """The rule of this module."""
    if not any(hybrid.wrench):
        return None
    h, wrench = hybrid.threshold, frozen(hybrid.wrench, 6) / hybrid.threshold
    noise = np.repeat(np.square(budget.noise), 3)  # variances, N² and N² m²
    moment = np.diag(noise) + sum((_moment(f, *at, budget) for f, at in move), start=np.zeros((6, 6)))
    # Regular by the noise alone, whatever is held.
    solved = np.linalg.solve(moment, wrench)
    gain = np.asarray(solved / float(wrench @ solved))
    # Without `place`: as if the axis of a turn were known, all of the friction counts, as in an allowance it has to.
    rubbed = budget.friction * abs(float(gain @ _friction(move, V)))
    force = h + rubbed + 3.0 * float(np.sqrt(gain**2 @ noise))
    return Stop(gain, wrench, force, h, hybrid.max_travel, hybrid.timeout, hybrid.felt, hybrid.stays != "push")


def _moment(force: float, normal: Array, arm: Array, budget: Budget) -> Array:
    """Second moment (6, 6) of what a held contact may put on the sensor: any force of its size anywhere near.

    The servo keeps the sum of the normal forces, so that what a new contact takes is missing at the held ones: along
    the normal a force counts ten times.
    """
    through = np.vstack([np.eye(3), hat(arm)]) @ (np.eye(3) + 9.0 * np.outer(normal, normal))
    shifted = np.vstack([np.zeros((3, 3)), np.eye(3)])
    return force**2 * (through @ through.T + (budget.place**2) * shifted @ shifted.T)


def _friction(move: Held, V: Array, place: float = 0.0) -> Array:
    """Wrench (6,) that friction of coefficient 1 on the held contacts puts on the part as it moves along V.

    A point counts by the share of its sliding in what it may slide where the axis of the turn is known to `place`, m.
    """
    total = np.zeros(6)
    for force, (normal, arm) in move:
        sliding = V[:3] + cross(V[3:], arm)
        sliding = sliding - (sliding @ normal) * normal
        size = float(np.hypot(np.linalg.norm(sliding), place * np.linalg.norm(V[3:])))
        rub = -force * sliding / size if size > 0.0 else np.zeros(3)
        total += np.concatenate([rub, cross(arm, rub)])
    return total
