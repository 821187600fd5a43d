"""One hybrid position/force strategy for each segment, after [DakinPopplestone1993] section 3.1.

The frame, and position and force axes in its coordinates; velocity, bias wrench and termination wrench about the moving
part's reference point in axes of the B-frame. The bias is the wrench *applied to* the moving part, the termination
wrench the extra *reaction* on it.

In which directions a segment's applied wrench may turn before friction on the held contacts can balance it.

The part need not move under an applied wrench F where contact forces inside the friction cones balance it, −F ∈ K, the
sum of the cones of the held contacts: it can jam, as the jamming diagrams of [Whitney1982] show in the plane. It
wedges, held by forces of the contacts against each other whatever is applied, where K holds a line. Each range is
stated with twists that prove it, see `friction_cones`.

Cones are taken at the goal of the segment, where its bias is chosen. The certificate of the plan says that nothing but
the held contacts is touched before those that end the move, so that no others have a part in it.
"""

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from fmopt.planning.control.bias_wrench import GuardedMove, Hold, bias_wrench
from fmopt.planning.control.compliance_frame import axes, compliance_frame, free_part, twist_scale, wrenches_in
from fmopt.planning.control.friction_cones import NEARLY, FrictionCones, cone_angle, least_push, plane_angle
from fmopt.spatial.se3 import Pose, hat
from fmopt.spatial.values import Array, Value
from fmopt.task.problem import Specification

_SHOWN = 1e-3  # sine of the least angle that is worth a proof
_WORTH = 1e-3  # rad: a proof of less is left out


@dataclass(frozen=True, eq=False)
class Termination(Value, wrench=(6,), labels={"wrench": "termination wrench"}):
    """When a move ends: the reaction wrench (6,) that reaches the threshold (N), or the travel (m) or time (s) used up.

    The wrench is zero where no contact is expected; then the move ends with its travel.
    """

    wrench: Array
    threshold: float
    max_travel: float
    timeout: float


@dataclass(frozen=True, eq=False)
class HybridStrategy(
    Value, frame=(6,), velocity=(6,), bias_wrench=(6,), position_axes=(None, 6), force_axes=(None, 6),
    normal_forces=(None,), labels={name: name for name in ("bias_wrench", "position_axes", "force_axes")},
):  # fmt: skip
    """The `hybrid` entry of a plan's segment: frame (6,), axes, velocity (6,) and bias wrench (6,)."""

    frame: Array  # compliance frame (6,), a pose in the B-frame
    position_axes: Array  # twists (6 − r, 6) in the frame's coordinates, orthonormal in diag(1, 1, 1, ρ², ρ², ρ²)
    force_axes: Array  # wrenches (r, 6) in its coordinates, orthonormal in the dual metric, reciprocal to the twists
    velocity: Array  # twist (6,), V / ‖V‖_ρ
    speed: float
    bias_wrench: Array  # applied wrench (6,), N and N·m
    push: float  # size of the part of the bias that pushes along the motion, N in the metric of ρ
    stays: Hold
    normal_forces: Array  # (m,), a normal force of each held contact that balances the rest of the bias, N
    termination: Termination

    def document(self, held: Sequence[str], made: Sequence[str]) -> dict[str, Any]:
        """As in the plan file, with the names of the held and of the made contacts in the order of the guarded move."""
        forces = zip(held, self.normal_forces.tolist(), strict=True)
        return {
            **_plain(self),
            "stays": self.stays.value,
            "normal_forces": [{"contact": name, "force": force} for name, force in forces],
            "termination": {"contacts": list(made), **_plain(self.termination)},
        }


def hybrid_strategy(move: GuardedMove, rho: float, specification: Specification) -> HybridStrategy:
    """The strategy of a move.

    Raises:
        ValueError: the move has no length.
        InfeasibleError: the move does not approach its contact, or no bias within the forces holds all contacts.
    """
    V = move.direction(rho)
    points = move.points if move.centres is None else np.vstack([move.points, move.centres])
    frame = compliance_frame(move.held, points, move.reference, rho)
    split = axes(wrenches_in(frame, move.held, move.reference), rho)
    bias = bias_wrench(move, V, rho, specification)
    threshold = specification.termination_force
    travel = move.length(rho) + move.bound
    return HybridStrategy(
        frame.vector(),
        split.position,
        split.force,
        V,
        specification.speed,
        bias.wrench,
        bias.push,
        bias.stays,
        bias.normal_forces,
        Termination(threshold * move.reaction, threshold, travel, 2.0 * travel / specification.speed),
    )


@dataclass(frozen=True, eq=False)
class JamMargin(Value, twists=(None, 6)):
    """The `jam_free` entry of a segment's strategy.

    Args:
        push: along the motion for which angles are stated, N: the plan's own, or the specified contact force where the
            move ends by its travel and the servo pushes as hard as it takes.
        least_push: above which the push along the motion cannot be balanced with the rest of the bias as planned, N;
            None where no push is shown to do.
        angle: by which the applied wrench may turn in any direction without being balanced, at most a right one, rad; 0
            where it may be balanced as it is.
        planes: how far it may turn away from, and towards, the push and each axis of the strategy in the plane with it,
            rad, by the names of these; none where the angle is 0, nor for axes along the wrench itself.
        twists: (k, 6) of the reference point in axes of the B-frame, which prove that: each opens every held contact
            beyond friction. With any the contacts cannot wedge; none are found where they may.
    """

    push: float
    least_push: float | None
    angle: float
    planes: tuple[tuple[str, tuple[float, float]], ...]
    twists: Array

    def document(self) -> dict[str, Any]:
        """As in the plan file."""
        planes = [{"towards": name, "angles": list(angles)} for name, angles in self.planes]
        return {**_plain(self), "planes": planes}


def _plain(value: Termination | HybridStrategy | JamMargin) -> dict[str, Any]:
    """The fields of a value, arrays as lists."""
    return {name: x.tolist() if isinstance(x, np.ndarray) else x for name, x in asdict(value).items()}


def jam_free(move: GuardedMove, strategy: HybridStrategy, rho: float, specification: Specification) -> JamMargin | None:
    """The jam-free range of a strategy's applied wrench; None where nothing is held, or nothing can be pushed.

    Raises:
        SolverError: the forces of the contacts do not settle.
    """
    scale = twist_scale(rho)
    free = free_part(strategy.velocity * scale, move.space(rho))
    if not len(move.held) or free is None:
        return None
    # Scaled, the unit twist is at once the unit wrench that pushes along it.
    along = free / float(np.linalg.norm(free))
    cones = FrictionCones.of(move.held, move.points - move.reference.p, rho, specification.friction)
    push = strategy.push if len(move.made) else specification.contact_force
    inner = cones.inner()
    if inner is None:
        return JamMargin(push, None, 0.0, (), np.zeros((0, 6)))
    proofs = _Proofs(cones, inner)
    held = strategy.bias_wrench / scale - strategy.push * along
    freeing = cones.freeing(held, along)
    if freeing is not None:
        proofs.add(freeing)
    a = (held + push * along) / float(np.linalg.norm(held + push * along))
    steepest = cones.rest(a)
    sides: list[tuple[str, Array]] = []
    if float(np.linalg.norm(steepest)) > _SHOWN:
        proofs.add(steepest)
        sides = _across(a, _directions(strategy, along, move.reference, rho))
        for _, d in sides:
            for side in (-d, d):
                proofs.turn(a, side)
    least = min(least_push(v, held, along) for v in proofs.scaled)
    angle = max(cone_angle(v, a) for v in proofs.scaled) if sides else 0.0
    planes = tuple((name, (proofs.reach(a, -d), proofs.reach(a, d))) for name, d in sides)
    return JamMargin(push, least if math.isfinite(least) else None, angle, planes, np.array(proofs.stated))


class _Proofs:
    """Twists as a plan states them, the innermost first, and what the best of them proves."""

    def __init__(self, cones: FrictionCones, inner: Array) -> None:
        self.cones, self.inner = cones, inner
        self.stated, self.scaled = list[Array](), np.zeros((0, 6))
        self.add(inner)

    def add(self, twist: Array) -> None:
        """States another scaled twist."""
        self.stated.append(self.cones.stated(twist, self.inner))
        self.scaled = np.vstack([self.scaled, self.stated[-1] * twist_scale(self.cones.rho)])

    def reach(self, a: Array, d: Array) -> float:
        """How far the unit wrench a may turn to d, rad."""
        return float(plane_angle(self.scaled, a, d).max())

    def turn(self, a: Array, d: Array) -> None:
        """States what proves more of that, if there is more."""
        reached = self.reach(a, d)
        if reached < math.pi - NEARLY:
            twist = self.cones.turn(a, d)
            if twist is not None and plane_angle(twist, a, d) > reached + _WORTH:
                self.add(twist)


def _across(a: Array, directions: list[tuple[str, Array]]) -> list[tuple[str, Array]]:
    """Unit wrenches across a in the planes that it spans with directions, those along it left out."""
    found = []
    for name, direction in directions:
        d = direction - float(direction @ a) * a
        size = float(np.linalg.norm(d))
        if size > _SHOWN * float(np.linalg.norm(direction)):
            found.append((name, d / size))
    return found


def _directions(strategy: HybridStrategy, along: Array, reference: Pose, rho: float) -> list[tuple[str, Array]]:
    """Scaled wrenches that the applied one is turned to: the push, and both kinds of axes of the compliance frame.

    A position axis is a twist; the wrench along it is the one that does the most power on it.
    """
    frame, scale = Pose.from_vector(strategy.frame), twist_scale(rho)
    arm = hat(frame.p - reference.p)  # from the frame's origin to the reference point
    found = [("push", along)]
    for k, axis in enumerate(strategy.position_axes):
        v, w = frame.R @ axis[:3], frame.R @ axis[3:]
        found.append((f"position_axes[{k}]", np.concatenate([v + arm @ w, w]) * scale))
    for k, axis in enumerate(strategy.force_axes):
        force, torque = frame.R @ axis[:3], frame.R @ axis[3:]
        found.append((f"force_axes[{k}]", np.concatenate([force, torque + arm @ force]) / scale))
    return found
