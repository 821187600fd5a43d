"""How firmly and how steadily a guarded move holds its contacts as its poses are displaced, to first order.

The forces x of a balance are where as many of its rows meet as there are forces, K x = r. Where displacements change
these rows, dx = K⁻¹ (dr − dK x): with Kᵀ y = e, what they change of the force e·x is y·(dr − dK x). The rows change
with the wrenches of the contacts, the arms at which these push, and the direction of the motion; with these, too, the
space that held wrenches W span. The projector onto it is Π = W⁺W, of which dΠ = W⁺ dW (1 − Π) + (…)ᵀ (Golub and
Pereyra, SIAM J. Numer. Anal. 10, 1973, eq. 4.12).

What errors take of the push by turning forces counts as it is.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fmopt.planning.control.bias_wrench import (
    STILL,
    SURE,
    Balance,
    GuardedMove,
    Hold,
    rubbing,
    slides,
)
from fmopt.planning.control.compliance_frame import twist_scale
from fmopt.spatial.se3 import cross
from fmopt.spatial.values import Array
from fmopt.task.problem import Specification

_MET = 1e-7  # N: rows that are nearer than this to their limits are met
_RANK = 1e-9


@dataclass(frozen=True, eq=False)
class MoveDerivatives:
    """How a guarded move changes with n displacements.

    Args:
        displacement: of V (n, 6).
        held: of the wrenches of held contacts (n, m, 6).
        arms: of their points from the reference point (n, m, 3).
        made: of the wrenches of new contacts (n, k, 6).
    """

    displacement: Array
    held: Array
    arms: Array
    made: Array


def hold_derivatives(
    move: GuardedMove, found: Balance, changing: MoveDerivatives, rho: float, specification: Specification
) -> Array:
    """The derivatives (n,) of the share of the contact force that presses a move's least pressed contact.

    Args:
        move: the move, which holds contacts and meets one.
        found: its balance, as `fmopt.planning.control.bias_wrench.held_by` finds it.
        changing: how the move changes.
        rho: characteristic length, m.
        specification: forces and friction.
    """
    slopes = _Change.of(move, changing, rho, specification).of_force(found)
    return slopes / specification.contact_force


@dataclass(frozen=True, eq=False)
class _Change:
    """A guarded move with how it changes, in the terms of its linear programs.

    Args:
        move: the move.
        changing: its derivatives.
        specification: forces and friction.
        scale: of twists (6,).
        V, dV: unit twist (6,) and its derivatives (n, 6).
        projector: Π (6, 6).
        dprojector: its derivatives (n, 6, 6).
        slid, dslid: how contact points slide (m, 3), and its derivatives (n, m, 3).
    """

    move: GuardedMove
    changing: MoveDerivatives
    specification: Specification
    scale: Array
    V: Array
    dV: Array
    projector: Array
    dprojector: Array
    slid: Array
    dslid: Array

    @staticmethod
    def of(move: GuardedMove, changing: MoveDerivatives, rho: float, specification: Specification) -> _Change:
        """Of a move."""
        scale, V, basis = twist_scale(rho), move.direction(rho), move.space(rho)
        dV = changing.displacement / move.length(rho)
        dV = dV - np.outer(dV @ (V * scale**2), V)
        projector = basis.T @ basis
        inverse = np.linalg.pinv(move.held / scale, rcond=_RANK)
        half = inverse @ (changing.held / scale) @ (np.eye(6) - projector)
        arms, normals, dn = move.points - move.reference.p, move.held[:, :3], changing.held[..., :3]
        velocity = V[:3] + cross(V[3:], arms)
        dvelocity = dV[:, None, :3] + cross(dV[:, None, 3:], arms[None]) + cross(V[3:], changing.arms)
        away = np.sum(velocity * normals, axis=-1, keepdims=True)
        daway = np.sum(dvelocity * normals + velocity * dn, axis=-1, keepdims=True)
        dslid = dvelocity - daway * normals - away * dn
        both = half + half.transpose(0, 2, 1)
        return _Change(move, changing, specification, scale, V, dV, projector, both, slides(move.held, arms, V), dslid)

    @property
    def push(self) -> tuple[Array, Array]:
        """The derivatives of the unit push (n, 6), as a wrench, and of its power (n,)."""
        along = self.V * self.scale
        free = along - self.projector @ along
        size = float(np.linalg.norm(free))
        dfree = (self.dV * self.scale) @ (np.eye(6) - self.projector) - self.dprojector @ along
        longer = dfree @ (free / size)
        return (dfree - np.outer(longer, free / size)) / size * self.scale, longer

    @property
    def drag(self) -> Array:
        """The derivatives (n, m) of the speeds at which contacts slide."""
        speeds = np.maximum(np.linalg.norm(self.slid, axis=-1), STILL)
        return np.asarray(np.sum(self.slid * self.dslid, axis=-1) / speeds)

    @property
    def rubbing(self) -> Array:
        """The derivatives (n, m, 6) of the wrenches of friction of coefficient 1."""
        arms = self.move.points - self.move.reference.p
        against = rubbing(self.slid, arms)[:, :3]
        speeds = np.maximum(np.linalg.norm(self.slid, axis=-1, keepdims=True), STILL)
        turned = -(self.dslid - np.sum(self.dslid * against, axis=-1, keepdims=True) * against) / speeds
        turned = np.where(speeds > STILL, turned, 0.0)  # what stands still may rub either way
        return np.concatenate([turned, cross(self.changing.arms, against) + cross(arms, turned)], axis=-1)

    def of_force(self, found: Balance) -> Array:
        """The derivatives (n,) of the least force of a balance."""
        rows, equations = _prices(found)
        m, n, move, changing, spec = (
            len(self.move.held),
            len(self.move.made),
            self.move,
            self.changing,
            self.specification,
        )
        x = found.x
        f, g, k, r, b = x[:m], x[m : 2 * m], x[2 * m : 2 * m + n], x[2 * m + n : -3], float(x[-2])
        dpush, dpower = self.push
        felt = np.sign(float(move.reaction @ self.V))
        dfelt = felt * (changing.made.mean(axis=1) @ self.V + self.dV @ move.reaction)
        pressed = spec.friction * self.drag @ f - b * dpower + SURE * spec.termination_force * dfelt
        torque = -np.einsum("nmi,m->ni", changing.held[..., 3:], f) + b * dpush[:, 3:]
        first = 3 * m
        taken = rows[first] * pressed + torque @ (rows[first + 3 : first + 6] - rows[first + 6 : first + 9])
        if found.push.hold is Hold.PUSH:
            met = changing.made @ self.V + self.dV @ move.made.T
            taken = taken + float(equations[0]) * (-met @ k - b * dpower)
        rank = len(basis := move.space(float(self.scale[-1])))
        equations = equations[1:]
        if found.push.hold is not Hold.NONE:
            total = move.held.T @ (g - f) + move.made.T @ k
            dtotal = np.einsum("nmi,m->ni", changing.held, g - f) + np.einsum("nki,k->ni", changing.made, k)
            taken = taken + self._balanced(basis.T @ equations[:rank], total, dtotal)
            equations = equations[rank:]
        if found.rubbed:
            mu, rubbed = spec.friction, rubbing(self.slid, move.points - move.reference.p)
            total = move.held.T @ (r - f) + mu * rubbed.T @ r
            dtotal = np.einsum("nmi,m->ni", changing.held, r - f) + mu * np.einsum("nmi,m->ni", self.rubbing, r)
            taken = taken + self._balanced(basis.T @ equations, total, dtotal)
        return -np.asarray(taken)

    def _balanced(self, price: Array, total: Array, changed: Array) -> Array:
        """The derivatives (n,) of price·Π (total / scale), a wrench (6,) with derivatives (n, 6)."""
        return np.asarray((changed / self.scale) @ price + self.dprojector @ (total / self.scale) @ price)


def _prices(found: Balance) -> tuple[Array, Array]:
    """What the rows that a balance meets and its equations are worth: by how much each raises the least force, N/N."""
    A, b, C, _ = found.program
    met = b - A @ found.x < _MET
    none = found.x < _MET
    none[-1] = False
    K = np.vstack([A[met], C, np.eye(len(found.x))[none]])
    asked = np.zeros(len(found.x))
    asked[found.which] = 1.0
    y = np.asarray(np.linalg.lstsq(K.T, asked, rcond=_RANK)[0], dtype=np.float64)
    rows: Array = np.zeros(len(b))
    rows[met] = y[: int(met.sum())]
    return rows, y[int(met.sum()) : int(met.sum()) + len(C)]
