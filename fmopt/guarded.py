"""The guarded moves of a plan file as whoever runs them needs them: what to servo, what to press, when to stop.

Held contacts without friction do no work on the motion that they allow, so the normal force k of the contacts that
end a move shows in the power of the measured reaction w alone: k = h (w·V′) / (w_T·V′), with w_T the termination
wrench at threshold h and V′ the part of the unit twist V that the held contacts allow at the goal. Friction on held
contacts opposes V as well. The plan's push b u was chosen so that b u·V ≥ 1.25 h |r·V| + μ Σ fᵢ sᵢ, r = w_T / h; what
it exceeds its first term by is the friction that it allows for, and a move is to stop when k reaches h above that.
[DakinPopplestone1993] section 3.1.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from fmopt.errors import PlanFormatError
from fmopt.se3 import Pose, hat
from fmopt.values import Array, Value, frozen

_SURE = 1.25  # times the threshold that a plan's push alone can bring about
_HELD = 1e-6  # N, by which a bias may leave the space of its force axes


@dataclass(frozen=True, eq=False)
class Stop(Value):
    """Stop when gain · reaction, the normal force of the contacts to be made, reaches `force`.

    Args:
        gain: (6,), N per N and N per N·m of the reaction about the moving frame's origin in axes of B.
        force: N.
        threshold: N, of which the rest of `force` is the allowance for friction.
        max_travel: m in the metric of ρ.
        timeout: s.
        contacts: those that end the move.
    """

    gain: Array
    force: float
    threshold: float
    max_travel: float
    timeout: float
    contacts: tuple[str, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "gain", frozen(self.gain, 6, name="gain"))


@dataclass(frozen=True, eq=False)
class Move(Value):
    """One segment of a plan.

    Args:
        segment, number: index of the segment, and of the move that it is a piece of.
        last: whether it is the last piece of its move.
        start, goal: poses of the moving part in B.
        duration: s, at the plan's speed from start to goal.
        twist: (6,) of the moving frame's origin, axes of B, m/s and rad/s.
        frame: compliance frame in B.
        position_axes: twists (6 − r, 6) in the frame's coordinates.
        force_axes: wrenches (r, 6) in its coordinates.
        hold: wrench (6,) to apply that presses the held contacts, about the moving frame's origin in axes of B.
        stop: how the move ends before its travel is used up; None where no contact is expected.
        state, goal_state: contacts held on the way, and at the end.
    """

    segment: int
    number: int
    last: bool
    start: Pose
    goal: Pose
    duration: float
    twist: Array
    frame: Pose
    position_axes: Array
    force_axes: Array
    hold: Array
    stop: Stop | None
    state: tuple[str, ...]
    goal_state: tuple[str, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "twist", frozen(self.twist, 6, name="twist"))
        object.__setattr__(self, "hold", frozen(self.hold, 6, name="holding wrench"))
        axes = (("position_axes", "position axes"), ("force_axes", "force axes"))
        for key, name in axes:
            object.__setattr__(self, key, frozen(np.reshape(getattr(self, key), (-1, 6)), None, 6, name=name))


def to_frame(frame: Pose, wrench: Array, origin: Array) -> Array:
    """A wrench (…, 6) about `origin` in axes of B, in the coordinates of `frame`."""
    force, torque = wrench[..., :3], wrench[..., 3:]
    moved = torque - force @ hat(frame.p - origin).T
    return np.concatenate([force @ frame.R, moved @ frame.R], axis=-1)


def from_frame(frame: Pose, wrench: Array, origin: Array) -> Array:
    """A wrench (…, 6) in the coordinates of `frame`, about `origin` in axes of B."""
    force, torque = wrench[..., :3] @ frame.R.T, wrench[..., 3:] @ frame.R.T
    return np.concatenate([force, torque + force @ hat(frame.p - origin).T], axis=-1)


def moves(document: Mapping[str, Any]) -> tuple[Move, ...]:
    """The segments of a plan in their order.

    Raises:
        PlanFormatError: a key is missing or of another kind, or a bias presses where nothing is held.
    """
    try:
        rho = float(document["uncertainty"]["rho"])
        rows = document["segments"]
        numbers = [int(row["move"]) for row in rows] + [-1]
        return tuple(_move(i, row, numbers[i] != numbers[i + 1], rho) for i, row in enumerate(rows))
    except (KeyError, IndexError, TypeError, ValueError) as error:
        raise PlanFormatError(
            f"the plan's segments cannot be run: {type(error).__name__}: {error}",
            "give a plan.json that fmopt solve wrote",
        ) from error


def _move(index: int, row: Mapping[str, Any], last: bool, rho: float) -> Move:
    start, goal = Pose.from_vector(row["start"]), Pose.from_vector(row["goal"])
    hybrid = row["hybrid"]
    frame = Pose.from_vector(hybrid["frame"])
    V, speed = frozen(hybrid["velocity"], 6), float(hybrid["speed"])
    force_axes = np.reshape(np.asarray(hybrid["force_axes"], dtype=np.float64), (-1, 6))
    held = from_frame(frame, force_axes, goal.p)
    bias, push = frozen(hybrid["bias_wrench"], 6), float(hybrid["push"])
    scale = np.array([1.0, 1.0, 1.0, rho, rho, rho])
    free = _free(held, V, rho)
    size = float(np.linalg.norm(free * scale))
    hold = bias - (push / size) * free * scale**2 if push > 0.0 else bias
    _refuse_unheld(index, hold, held, rho)
    length = float(np.linalg.norm(start.local(goal) * scale))
    stop = _stop(hybrid["termination"], V, free, push * size)
    return Move(
        index,
        int(row["move"]),
        last,
        start,
        goal,
        length / speed,
        V * speed,
        frame,
        np.asarray(hybrid["position_axes"], dtype=np.float64),
        force_axes,
        hold,
        stop,
        tuple(row["state"]),
        tuple(row["goal_state"]),
    )


def _free(held: Array, V: Array, rho: float) -> Array:
    """V′: the part (6,) of the twist on which the held wrenches (r, 6) have no power."""
    scale = np.array([1.0, 1.0, 1.0, rho, rho, rho])
    basis, _ = np.linalg.qr((held / scale).T)
    return np.asarray((V * scale - basis @ (basis.T @ (V * scale))) / scale)


def _refuse_unheld(index: int, hold: Array, held: Array, rho: float) -> None:
    scale = np.array([1.0, 1.0, 1.0, rho, rho, rho])
    basis, _ = np.linalg.qr((held / scale).T)
    rest = hold / scale - basis @ (basis.T @ (hold / scale))
    if float(np.linalg.norm(rest)) > _HELD:
        raise PlanFormatError(
            f"segment {index}: {float(np.linalg.norm(rest)):.3g} N of its bias press where its force axes hold nothing",
            "solve the problem with this version",
        )


def _stop(termination: Mapping[str, Any], V: Array, free: Array, pushed: float) -> Stop | None:
    """The rule of this module; `pushed` is b u·V."""
    wrench, h = frozen(termination["wrench"], 6), float(termination["threshold"])
    power = -float(wrench @ free)
    if not np.any(wrench):
        return None
    if not power > 0.0:
        raise ValueError("a move does not approach the contact that is to end it")
    friction = max(pushed - _SURE * abs(float(wrench @ V)), 0.0) * h / power
    travel, timeout = float(termination["max_travel"]), float(termination["timeout"])
    return Stop(free * (-h / power), h + friction, h, travel, timeout, tuple(termination["contacts"]))
