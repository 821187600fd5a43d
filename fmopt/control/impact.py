"""Speed at which the contact that ends a move is met, and the speed that keeps its impact under a stated force.

A mass m that meets a spring of stiffness k at the normal speed vₙ compresses it to m vₙ²/2 = F²/(2 k): F = vₙ √(k m).
With m the apparent mass of robot and part where they touch and k the stiffness of contact, robot and sensor in series
that is the greatest force of the impact; the push of the bias comes on top.

Over the errors. The contact is met somewhere on the moving feature, which lies between its vertices: vₙ is linear in
the point, so that the vertices bound it. A turn of the part by up to θ, its error and its way to the goal, moves their
arms a by up to |a| θ, and the normal by an angle φ: none of a face that stands, θ of one that moves, and of crossing
edges at the angle α up to arcsin(θ / sin α). With u = v + ω × a

    vₙ ≤ min(|u| + |ω| |a| θ,  |n·u| + |ω| |a| θ + φ (|u| + |ω| |a| θ)) + e_t + e_r |a| / ρ

for the unit twist (v, ω) and the velocity error (e_t, e_r) as shares of it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, assert_never

import numpy as np

from fmopt.contact.primitive import Kind, PrimitiveContact
from fmopt.contact.wrench import contact_normal
from fmopt.geometry.polyhedron import Polyhedron
from fmopt.se3 import Pose
from fmopt.task.problem import Specification
from fmopt.values import Array, Value, frozen

_LEVEL = 1e-3  # sine of the angle below which edges fix no normal


@dataclass(frozen=True, eq=False)
class Meeting(Value):
    """A contact that a move may make.

    Args:
        normal: unit normal (3,) at the goal; zero where the features fix none.
        arms: vertices (k, 3) of the moving feature from the reference point, axes of B, m.
        leverage: sine of the normal's turn for that of the part; infinite where nothing bounds it.
    """

    normal: Array
    arms: Array
    leverage: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "normal", frozen(self.normal, 3, name="normal"))
        object.__setattr__(self, "arms", frozen(self.arms, None, 3, name="arms"))

    @staticmethod
    def of(contact: PrimitiveContact, moving: Polyhedron, fixed: Polyhedron, pose: Pose) -> Meeting:
        """The meeting of a primitive contact of two parts at a pose."""
        arms = moving.vertices[list(contact.moving)] @ pose.R.T
        match contact.kind:
            case Kind.VERTEX_FACE:
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
    """The greatest normal speed at which any of the contacts can be met, for a unit twist.

    Args:
        meetings: the contacts that may be met.
        V: unit twist (6,) in the metric of ρ.
        theta: by how much the part may be turned from its goal when they are, rad.
        velocity_error: shares of the speed in translation, and in rotation on the arm ρ.
        rho: characteristic length, m.
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
