"""Task frames whose axes a selection vector can name.

A robot's force mode takes one frame and says for each of its six axes whether it is compliant. The wrenches of held
contacts span a space W. With T the pure torques in W and Φ the forces that occur in it, W is the span of axes of a
frame exactly if some orthonormal directions span both T and Φ, that is if their projectors commute, and some origin
o makes the wrench along each direction of Φ pass through it, up to T: τᵢ − o × fᵢ ∈ T, a linear system in o.
"""

from dataclasses import dataclass
from itertools import permutations, product

import numpy as np

from fmopt.errors import PlanFormatError
from fmopt.plan.guarded_moves import PlanMove, to_frame
from fmopt.spatial.se3 import Pose, exp, hat, log
from fmopt.spatial.values import Array, Value

_ALIGNED = 1e-6  # sine of the angle, and m of the offset, that still count as none
_PRESSES = 1e-6  # N


@dataclass(frozen=True, eq=False)
class TaskFrame(Value, wrench=(6,)):
    """A frame in B, its selection vector (1 compliant, 0 stiff), and the wrench (6,) to apply in its coordinates."""

    pose: Pose
    selection: tuple[int, ...]
    wrench: Array


def task_frame(move: PlanMove, rho: float) -> TaskFrame:
    """The task frame of a segment: its compliance frame, turned and shifted as little as its force axes ask for.

    It is set where the segment starts, with the wrench that holds the contacts there: at the goal of a long way their
    arms are others, and what is right for a part that is all the way in tips one that is not.

    Raises:
        PlanFormatError: its force axes are not orthogonal in any one frame.
    """
    rows = move.force_axes / np.array([1.0, 1.0, 1.0, rho, rho, rho])
    torques, forces, linked = _split(rows)
    turned = _common_axes(torques, forces)
    shift = None if turned is None else _origin(torques, forces, linked * rho)  # torques per force, m
    if turned is None or shift is None:
        raise PlanFormatError(
            f"segment {move.segment}: its {len(rows)} force axes are not orthogonal in any one frame",
            "no selection vector can say which axes are compliant; run the segment with a controller that takes axes",
        )
    pose = move.frame.compose(Pose(shift, turned))
    held = np.diag(turned.T @ forces.T @ forces @ turned), np.diag(turned.T @ torques.T @ torques @ turned)
    selection = tuple(int(share > 0.5) for share in np.concatenate(held))
    wrench = to_frame(pose, move.hold, move.goal.p)
    stray = np.abs(np.where(np.array(selection) == 1, 0.0, wrench)) / np.array([1.0, 1.0, 1.0, rho, rho, rho])
    if float(stray.max()) > _PRESSES:
        message = f"segment {move.segment}: its bias presses on a stiff axis by {float(stray.max()):.3g} N"
        raise PlanFormatError(message, "run the segment with a controller that takes axes")
    # Shifted as the part is from the goal, where the frame is stated, but not turned.
    begin = Pose(pose.p + move.start.p - move.goal.p, pose.R)
    wrench = to_frame(begin, move.hold_start, move.start.p)
    # With other arms a little may fall on stiff axes here, which are servoed in position, whatever presses.
    return TaskFrame(begin, selection, np.where(np.array(selection) == 1, wrench, 0.0))


def _split(rows: Array) -> tuple[Array, Array, Array]:
    """Orthonormal pure torques T (a, 3) and forces Φ (b, 3), and the torques (b, 3) that go with these; all scaled."""
    if not len(rows):
        return np.zeros((0, 3)), np.zeros((0, 3)), np.zeros((0, 3))
    left, size, right = np.linalg.svd(rows[:, :3])
    # Axes as they are planned are orthonormal once scaled: sizes lie between 0 and 1, and the bound needs no scale.
    b = int(np.sum(size > _ALIGNED))
    _, extent, basis = np.linalg.svd(left[:, b:].T @ rows[:, 3:], full_matrices=False)
    linked = (left[:, :b].T @ rows[:, 3:]) / size[:b, None]
    return np.asarray(basis[extent > _ALIGNED]), np.asarray(right[:b]), np.asarray(linked)


def _common_axes(torques: Array, forces: Array) -> Array | None:
    """A rotation whose columns span both spaces, the nearest one to 1 that is found; None where there is none."""
    P, Q = torques.T @ torques, forces.T @ forces
    if float(np.abs(P @ Q - Q @ P).max()) > _ALIGNED:
        return None
    eye = np.eye(3)
    # Projectors that commute: their products project onto the four intersections, which make up the whole space.
    parts = [A @ B for A in (P, eye - P) for B in (Q, eye - Q)]
    # A frame that fits is kept: eigenvectors of a plane are any pair in it.
    if all(float(np.abs(part - np.diag(np.diag(part))).max()) <= _ALIGNED for part in parts):
        return eye
    columns: list[Array] = []
    for part in parts:
        # The product is symmetric to within `_ALIGNED` only, and `eigh` would read one triangle of it.
        values, vectors = np.linalg.eigh(0.5 * (part + part.T))
        columns += _toward_axes(vectors[:, values > 0.5])
    return _ordered(columns)


def _toward_axes(space: Array) -> list[Array]:
    """Orthonormal vectors of a subspace (3, k), each as near to an axis as what is left of the space allows."""
    found: list[Array] = []
    P = space @ space.T
    for _ in range(space.shape[1]):
        k = int(np.argmax(np.diag(P)))
        axis = P[:, k] / np.sqrt(P[k, k])
        found.append(axis)
        P = P - np.outer(axis, axis)
    return found


def _ordered(columns: list[Array]) -> Array:
    """The columns in the order and with the signs of the rotation of the least angle."""
    best, least = np.eye(3), np.inf
    for (one, other), (a, b) in product(permutations(columns, 2), product((1.0, -1.0), repeat=2)):
        x, y = a * one, b * other
        R = np.column_stack([x, y, np.cross(x, y)])
        angle = float(np.linalg.norm(log(R)))
        if angle < least - 1e-9:  # of equals the first, whatever rounding
            best, least = R, angle
    # Orthonormal to the last bit, which columns of different spaces are only nearly.
    return exp(log(best))


def _origin(torques: Array, forces: Array, linked: Array) -> Array | None:
    """The least shift o (3,), m, with linkedᵢ − o × fᵢ ∈ T for all i; None where there is none."""
    if not len(forces):
        return np.zeros(3)
    free = np.eye(3) - torques.T @ torques
    A = np.vstack([-free @ hat(f) for f in forces])
    b = np.concatenate([free @ t for t in linked])
    o = np.linalg.lstsq(A, b, rcond=1e-9)[0]
    return np.asarray(o) if float(np.abs(A @ o - b).max()) <= _ALIGNED else None
