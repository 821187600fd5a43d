"""One hybrid position/force strategy for each segment, after [DakinPopplestone1993] section 3.1.

The frame, and position and force axes in its coordinates; velocity, bias wrench and termination wrench about the moving
part's reference point in axes of the B-frame. The bias is the wrench *applied to* the moving part, the termination
wrench the extra *reaction* on it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from fmopt.control.bias import GuardedMove, Hold, bias_wrench
from fmopt.control.compliance import axes, compliance_frame, wrenches_in
from fmopt.task.problem import Specification
from fmopt.values import Array, Value, frozen


@dataclass(frozen=True, eq=False)
class Termination(Value):
    """When a move ends: the reaction wrench (6,) that reaches the threshold (N), or the travel (m) or time (s) used up.

    The wrench is zero where no contact is expected; then the move ends with its travel.
    """

    wrench: Array
    threshold: float
    max_travel: float
    timeout: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "wrench", frozen(self.wrench, 6, name="termination wrench"))


@dataclass(frozen=True, eq=False)
class HybridStrategy(Value):
    """The `hybrid` entry of a plan's segment.

    Args:
        frame: compliance frame (6,), a pose in the B-frame.
        position_axes: twists (6 − r, 6) in the frame's coordinates, orthonormal in diag(1, 1, 1, ρ², ρ², ρ²).
        force_axes: wrenches (r, 6) in its coordinates, orthonormal in the dual metric, reciprocal to the twists.
        velocity: twist (6,), V / ‖V‖_ρ.
        speed: m/s.
        bias_wrench: applied wrench (6,), N and N·m.
        push: size of the part of the bias that pushes along the motion, N in the metric of ρ.
        termination: when the move ends.
        normal_forces: (m,), a normal force of each held contact that balances the rest of the bias, N.
        stays: what the held contacts stay closed under.
    """

    frame: Array
    position_axes: Array
    force_axes: Array
    velocity: Array
    speed: float
    bias_wrench: Array
    push: float
    termination: Termination
    normal_forces: Array
    stays: Hold

    def __post_init__(self) -> None:
        for name in ("frame", "velocity", "bias_wrench"):
            object.__setattr__(self, name, frozen(getattr(self, name), 6, name=name))
        for name in ("position_axes", "force_axes"):
            object.__setattr__(self, name, frozen(getattr(self, name), None, 6, name=name))
        object.__setattr__(self, "normal_forces", frozen(self.normal_forces, None, name="normal forces"))

    def document(self, held: Sequence[str], made: Sequence[str]) -> dict[str, Any]:
        """As in the plan file, with the names of the held and of the made contacts in the order of the guarded move."""
        end = self.termination
        return {
            "frame": self.frame.tolist(),
            "position_axes": self.position_axes.tolist(),
            "force_axes": self.force_axes.tolist(),
            "velocity": self.velocity.tolist(),
            "speed": self.speed,
            "bias_wrench": self.bias_wrench.tolist(),
            "push": self.push,
            "stays": self.stays.value,
            "normal_forces": [
                {"contact": name, "force": force} for name, force in zip(held, self.normal_forces.tolist(), strict=True)
            ],
            "termination": {
                "contacts": list(made),
                "wrench": end.wrench.tolist(),
                "threshold": end.threshold,
                "max_travel": end.max_travel,
                "timeout": end.timeout,
            },
        }


def hybrid_strategy(move: GuardedMove, rho: float, specification: Specification) -> HybridStrategy:
    """The strategy of a move.

    Args:
        move: what is held, where it goes, what ends it.
        rho: characteristic length, m.
        specification: speed, forces and friction.

    Raises:
        ValueError: the move has no length.
        InfeasibleError: the move does not approach its contact, or no bias within the forces holds all contacts.
    """
    V = move.direction(rho)
    frame = compliance_frame(move.held, move.points, move.reference, rho)
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
        Termination(threshold * move.reaction, threshold, travel, 2.0 * travel / specification.speed),
        bias.normal_forces,
        bias.stays,
    )
