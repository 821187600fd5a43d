"""Forward projection of pose errors through one segment: the tube that holds every execution.

The execution of a segment from S to G starts at S + e with e in the start set, travels along V plus a drift inside
the velocity cone, keeps the contacts of its state (in the compliant directions the contacts rule) and stops at the
surface of the new contact. In the linear picture that path is straight, hence inside the convex hull of the start
set at S and the goal set at G, and a linear constraint needs checking at both ends only.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from numpy.typing import ArrayLike

from fmopt import ellipsoid
from fmopt.errors import InfeasibleError
from fmopt.uncertainty import dakin
from fmopt.uncertainty.error_set import ErrorSet
from fmopt.values import Array, Value

Step = Callable[[ErrorSet, Array, Array, Array, Array, tuple[float, float], float], ErrorSet]

_PARALLEL = 1e-6


@dataclass(frozen=True, eq=False)
class Tube(Value):
    """The errors at the start and at the goal of a segment; between, their convex hull along the move."""

    start: ErrorSet
    goal: ErrorSet

    def margins(self, rows: ArrayLike, start_gaps: ArrayLike, goal_gaps: ArrayLike) -> Array:
        """What is left of each gap N·X − D at the worse end, min over both ends of gap − h(N).

        Args:
            rows: N (k, 6).
            start_gaps: N·S − D (k,) of the nominal start, in m when |n| = 1.
            goal_gaps: N·G − D (k,) of the nominal goal.

        Returns:
            (k,), positive where no execution of the linear picture touches.
        """
        start = np.asarray(start_gaps) - self.start.support(rows)
        return np.asarray(np.minimum(start, np.asarray(goal_gaps) - self.goal.support(rows)))

    def angle_bound(self) -> float:
        """Upper bound of |δ| along the segment, in rad."""
        return max(self.start.angle_bound(), self.goal.angle_bound())


def travel_length(move: ArrayLike, rho: float) -> float:
    """Length of a move V = (d, δ), |V′| = √(|d|² + ρ²|δ|²) in m ([DakinPopplestone1993] eq. 7)."""
    return float(np.linalg.norm(np.asarray(move, dtype=np.float64) * ellipsoid.metric(rho)))


def drift_shape(velocity_error: tuple[float, float], rho: float) -> Array:
    """Shape matrix (6, 6) of the drift per metre of travel, diag(λ_t² ×3, (λ_r/ρ)² ×3).

    Args:
        velocity_error: (λ_t, λ_r), m of drift and ρ·rad of drift per m of travel, not negative.
        rho: characteristic length in m.
    """
    return np.diag((np.repeat(velocity_error, 3) / ellipsoid.metric(rho)) ** 2)


def farthest_travel(
    errors: ErrorSet,
    move: Array,
    rows: Array,
    directions: Array,
    thickness: Array,
    velocity_error: tuple[float, float],
    rho: float,
) -> float:
    """The longest way that an execution goes, in m; arguments as for `step`.

    An execution that starts far from the surface of the new contact goes on until it is there, and drifts on the
    way. With g the covector that is 1 along the unit move and 0 along the other directions, its travel ℓ obeys
    ℓ ≤ L + h(g) + Σ|g·c̃ᵢ| tᵢ + ℓ h_drift(g). Without a stop on a contact the travel is the commanded L.

    Raises:
        InfeasibleError: the cone opens so wide that an execution can miss the surface.
    """
    length = travel_length(move, rho)
    M = ellipsoid.metric(rho)
    stops = _stops(move * M, directions * M[:, None])
    if not stops.any():
        return length
    unit_move = move / length
    inverse = ellipsoid.coupling_inverse(rows, directions)[stops][0]
    scale = float(inverse @ rows @ unit_move)
    g = (inverse @ rows) / scale
    slack = float(errors.support(g)) + float(np.abs(inverse / scale) @ thickness)
    rate = float(ellipsoid.support(drift_shape(velocity_error, rho), g))
    if rate >= 1.0:
        raise InfeasibleError(
            f"the velocity error lets an execution miss the new contact (drift {rate:.2f} of the approach)",
            shortfall=(rate - 1.0) * length,
            advice="approach the contact more steeply, or lower the velocity error",
        )
    return (length + slack) / (1.0 - rate)


def _stops(move: Array, directions: Array) -> Array:
    """Which columns of `directions` (6, r) are parallel to the move (6,), both scaled by ρ: booleans (r,)."""
    length = float(np.linalg.norm(move))
    if length == 0.0:
        return np.zeros(directions.shape[1], dtype=bool)
    V = move / length
    aside = np.linalg.norm(directions - np.outer(V, V @ directions), axis=0)
    return np.asarray(aside <= _PARALLEL * np.linalg.norm(directions, axis=0))


def step(
    errors: ErrorSet,
    move: Array,
    rows: Array,
    directions: Array,
    thickness: Array,
    velocity_error: tuple[float, float],
    rho: float,
) -> ErrorSet:
    """Errors at the goal after one segment, Π(errors ⊕ drift) ⊕ {Σ c̃ᵢ uᵢ, |uᵢ| ≤ tᵢ}.

    Π = I − C (N C)⁻¹ N and c̃ᵢ the columns of C (N C)⁻¹. A direction parallel to the move marks the new contact:
    the execution goes on along V until it is on that surface, so drift is counted over `farthest_travel`. Any
    other direction is compliance.

    Args:
        errors: errors at the start.
        move: V = G − S (6,) as (d, δ) in m and rad.
        rows: a basis N (r, 6) of the contacts that hold at the goal.
        directions: C (6, r), for each row the direction in which its contact corrects the pose.
        thickness: t (r,), how far the true surface of each row may lie from its plane, in the unit of N·e.
        velocity_error: (λ_t, λ_r), see `drift_shape`.
        rho: characteristic length in m.

    Raises:
        InfeasibleError: the directions do not reach the contacts, or an execution can miss the new one.
    """
    projector, C_tilde = ellipsoid.oblique_projector(rows, directions)
    travel = farthest_travel(errors, move, rows, directions, thickness, velocity_error, rho)
    drift = ellipsoid.image(travel**2 * drift_shape(velocity_error, rho), projector)
    return errors.image(projector).plus(drift, rho).plus_zonotope((C_tilde * thickness).T, rho)


STEPS: Mapping[str, Step] = MappingProxyType({"shadow": step, "dakin1993": dakin.step})


def linear_segment(
    errors: ErrorSet,
    move: Array,
    held: Array,
    compliant: Array,
    normal: Array,
    thickness: Array,
    velocity_error: tuple[float, float],
    rho: float,
    method: str = "shadow",
) -> Tube:
    """The tube of a segment that keeps its state's contacts and ends on a new one.

    Args:
        errors: errors at the start, N e = 0 for the held rows but for their thickness there.
        move: V = G − S (6,), inside the state: N V = 0 for the held rows.
        held: contact rows of the state (r, 6).
        compliant: directions (6, r) in which those contacts correct the pose.
        normal: row (6,) of the new contact.
        thickness: (r + 1,), of the held rows and then the new one.
        velocity_error: (λ_t, λ_r), see `drift_shape`.
        rho: characteristic length in m.
        method: a key of `STEPS`.
    """
    rows = np.vstack([held, normal])
    directions = np.column_stack([compliant, move / travel_length(move, rho)])
    return Tube(errors, STEPS[method](errors, move, rows, directions, thickness, velocity_error, rho))
