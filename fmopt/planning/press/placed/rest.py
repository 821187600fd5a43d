"""Where a wrench leads: the contacts that hold the part without friction, and the friction that they hold against."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fmopt.plan.press_rows import FREE_OF_JAMS
from fmopt.planning.optimise.bisection import last_step
from fmopt.planning.optimise.cone_program import ConeProgram, Norm
from fmopt.planning.optimise.solvers import ClarabelSolver, nearest_point
from fmopt.planning.press.placed.touches import PressWrench, Touches
from fmopt.planning.press.task import PressTask
from fmopt.spatial.se3 import Pose
from fmopt.spatial.values import Array

_REACH = 10.0, 2e-4  # clearances, and m, within which the part rests of where it stood with friction
_TOUCHING = 0.02  # of the clearance, within which a contact of a rest touches
_SOFT = 1e-6  # m, within which a contact touches in the engine
_STILL = 0.02  # of the clearance, below which a step counts as none
_RANK = 1e-6  # relative singular value
_FINE = 2.0**-10  # of friction
_MOST = 12  # contacts that a rest is told by
_SLIPPERY = 0.02  # friction for which answers are chosen
_AGAINST = 0.25  # of a wrench, that contacts on which the part seats are against


@dataclass(frozen=True, eq=False)
class Rest:
    """Contacts that hold a part: normal forces (k,) without friction, N, and the rank of their rows.

    A tangential force at contact i changes the normal force at contact j by `response` (k, k) times its size at most.
    """

    touches: Touches
    forces: Array
    response: Array
    rank: int

    @property
    def friction(self) -> float:
        """The largest friction for which no contact lets go."""
        steps = round(FREE_OF_JAMS / _FINE)
        return _FINE * last_step(0, steps, lambda step: self.least_force(_FINE * step) > 0.0)

    def least_force(self, friction: float) -> float:
        """A bound from below on the normal forces for all friction up to one, N; −inf where there is none."""
        left = np.eye(len(self.forces)) - friction * self.response
        if self.forces.min() <= 0.0 or np.linalg.cond(left) > 1.0 / _RANK:
            return -np.inf
        highest = np.linalg.solve(left, self.forces)  # forces f ≤ f₀ + friction·response·f
        if highest.min() < 0.0:
            return -np.inf
        return float((self.forces - friction * self.response @ highest).min())


def rest_of(task: PressTask, push: PressWrench, pose: Pose, seats: bool) -> Rest | None:
    """Where the wrench leads from a pose without friction, or the contacts there; None where there are none.

    A part that `seats` there is held by contacts against the wrench alone.
    """
    clearance = task.clearance.per_side
    reach, parts = _REACH[0] * clearance + _REACH[1], (task.moving.polyhedron, task.fixed.polyhedron)
    towards, moved = push.free / push.size * clearance, 0.0
    touches = Touches.near(*parts, pose, 2.0 * reach, 2.0 * reach / push.rho, clearance)
    stood = touches.some(touches.f < _TOUCHING * clearance + _SOFT)
    held = None
    while moved < reach and (step := nearest_point(towards, push.rows(touches.N), -touches.f)) is not None:
        pose, moved = pose.moved(push.twist(step)), moved + float(np.linalg.norm(step))
        if np.linalg.norm(step) < _STILL * clearance:
            f = touches.f + touches.N @ push.twist(step)
            held = touches.some(np.abs(f) < _TOUCHING * clearance)
            break
        touches = Touches.near(*parts, pose, 2.0 * reach, 2.0 * reach / push.rho, clearance)
    if held is None:  # friction holds the part before it comes to rest without, or held axes keep it inside a wall
        held = stood
    rows = push.rows(held.N)
    size, against = np.linalg.norm(rows, axis=1), -rows @ push.free / push.size
    held = held.some((size > _RANK) & (against > (_AGAINST if seats else -1.0) * size))
    return _held(held.some(_apart(push.rows(held.N))), push) if len(held) else None


def _apart(rows: Array) -> list[int]:
    """Numbers of a few rows (k, n), each the farthest from those before it: contacts of a flush wall are many."""
    chosen, far = list[int](), np.full(len(rows), np.inf)
    while len(chosen) < min(_MOST, len(rows)):
        chosen.append(int(far.argmax()))
        far = np.minimum(far, np.linalg.norm(rows - rows[chosen[-1]], axis=1))
        far[chosen] = -1.0
    return sorted(chosen)


def _held(held: Touches, push: PressWrench) -> Rest:
    """The rest on contacts: their forces, and how they answer to friction, so that the least one is the greatest.

    Where there are more contacts than freedoms, forces f₀ and answers K may be any with Nᵀf₀ = −w and NᵀK = 1: a cone
    program chooses both, f₀ⱼ − friction Σᵢ |Kⱼ Tᵢᵀ| F ≥ m for tangential forces of a mean size F.
    """
    N, T = push.rows(held.N), push.rows(held.T)
    (k, n), mean = N.shape, _SLIPPERY * push.size
    U, singular, V = np.linalg.svd(N)
    rank = int((singular > _RANK * singular[0]).sum())
    answers = U[:, :rank] @ (V[:rank] / singular[:rank, None])
    forces, free = -answers @ push.free, U[:, rank:]
    if q := free.shape[1]:
        count = q + q * n + 1
        rows = np.hstack([free, np.zeros((k, q * n)), -np.ones((k, 1))])
        norms = []
        for j, t in np.ndindex(k, k):
            F = np.zeros((2, count))
            F[:, q:-1] = np.einsum("a,tb->tab", free[j], T[t]).reshape(2, -1)
            norms.append(Norm(mean / rank * F, mean / rank * T[t] @ answers[j]))
        upper = np.append(np.full(count - 1, np.inf), push.size)
        program = ConeProgram(
            np.eye(count)[-1], G=rows, h=forces, W=np.eye(k).repeat(k, axis=1), norms=tuple(norms), upper=upper,
            units=np.append(np.full(q, push.size), np.ones(count - q)),
        )  # fmt: skip
        x = ClarabelSolver().proposed(program)
        forces, answers = forces + free @ x[:q], answers + free @ x[q:-1].reshape(q, n)
    response = np.linalg.norm(np.einsum("jn,itn->jit", answers, T), axis=2)
    return Rest(held, forces, response, rank)
