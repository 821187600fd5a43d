"""Whether contacts are met as softly as is asked for.

A mass m that meets a stiffness k at the normal speed vₙ does so with F = vₙ √(k m). The speed is bounded for every
error: the contact is met on the moving feature, between whose vertices vₙ is linear, and a turn of the part by up to θ
moves their arms a by up to |a| θ and the normal by up to an angle φ. With u = v + ω × a for the unit twist (v, ω) and
shares (e_t, e_r) of velocity error

    vₙ ≤ min(|u| + |ω| |a| θ,  |n·u| + |ω| |a| θ + φ (|u| + |ω| |a| θ)) + e_t + e_r |a| / ρ,

φ = 0 on a face of the fixed part, arcsin θ on one of the moving part, arcsin(θ / sin α) for edges that cross at α.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from fmopt.verify.assembly import Touch
from fmopt.verify.document import Hybrid, Numbers, Specification
from fmopt.verify.doubles import cross, dot, doubles
from fmopt.verify.findings import RELATIVE, Notes
from fmopt.verify.rational import sub
from fmopt.verify.rows import Pose

_LEVEL = 1e-3  # sine of the angle below which edges fix no normal
_ROUNDING = 1e-9  # relative


def allowed_speed(hybrid: Hybrid, asked: Specification) -> float:
    """The speed (m/s) that a strategy has to state, from the normal speed that it states for a unit twist."""
    if hybrid.impact is None or asked.impact is None:
        return asked.speed
    limit, mass, stiffness = asked.impact
    force = asked.speed * hybrid.impact[0] * math.sqrt(mass * stiffness)
    return asked.speed * min(limit / force, 1.0) if force > 0.0 else asked.speed


def check_impact(
    hybrid: Hybrid,
    touches: Sequence[Touch],
    goal: Pose,
    V: Numbers,
    theta: float,
    error: Numbers,
    rho: float,
    asked: Specification,
    notes: Notes,
) -> None:
    """Judges what a strategy says of the impact that ends its move.

    Args:
        hybrid: the strategy.
        touches: contacts that may end the move.
        goal: pose of the part at the segment's end.
        V: unit twist (6,).
        theta: by how much the part may be turned from there, rad.
        error: shares of velocity error in translation and in rotation.
        rho: characteristic length, m.
        asked: the impact that is allowed.
        notes: takes what is wrong.
    """
    if asked.impact is None or not touches:
        if hybrid.impact is not None:
            notes.add("impact", "is stated although no impact is limited, or none comes")
        return
    if hybrid.impact is None:
        notes.add("impact", "is not stated although it is limited")
        return
    approach, force = hybrid.impact
    limit, mass, stiffness = asked.impact
    met = max(_met(touch, goal, V, theta, error, rho) for touch in touches)
    if not approach >= met * (1.0 - _ROUNDING):
        notes.add("impact.approach", f"is stated as {approach!r}, but up to {met!r} follow")
    follows = hybrid.speed * approach * math.sqrt(mass * stiffness)
    if not abs(force - follows) <= RELATIVE * abs(follows):
        notes.add("impact.force", f"is stated as {force!r}, but follows as {follows!r}")
    if not force <= limit * (1.0 + _ROUNDING):
        notes.add("impact.force", f"{force:.6g} N exceed the {limit:.6g} N that are allowed")


def _met(touch: Touch, goal: Pose, V: Numbers, theta: float, error: Numbers, rho: float) -> float:
    """The greatest normal speed at which a contact can be met, for the unit twist V."""
    arms = [doubles(goal.turned(v)) for v in touch.moving]
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


def _normal(touch: Touch, goal: Pose, arms: Sequence[Numbers], theta: float) -> tuple[Numbers, float]:
    """The unit normal of a contact, and by what angle errors may turn it."""
    if touch.kind == "vertex-face" and touch.plane is not None:
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
