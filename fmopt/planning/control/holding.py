"""How firmly and steadily the pieces of a motion hold their contacts, as rows of the placement of its poses.

The forces x of a balance are where as many of its rows meet as there are forces, K x = r. Where displacements change
these rows, dx = K⁻¹ (dr − dK x): with Kᵀ y = e, what they change of the force e·x is y·(dr − dK x). The rows change
with the wrenches of the contacts, the arms at which these push, and the direction of the motion; with these, too, the
space that held wrenches W span. The projector onto it is Π = W⁺W, of which dΠ = W⁺ dW (1 − Π) + (…)ᵀ (Golub and
Pereyra, SIAM J. Numer. Anal. 10, 1973, eq. 4.12).

What errors take of the push by turning forces counts as it is.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import assert_never

import numpy as np

from fmopt.certificate.assembly import Assembly, contact_rows
from fmopt.certificate.claim import Claim
from fmopt.certificate.remainder import Curvature
from fmopt.certificate.segment_linearisation import Tolerance
from fmopt.contact.primitive import Kind, PrimitiveContact
from fmopt.planning.control.bias_wrench import STILL, SURE, Balance, GuardedMove, held_by, rubbing, slides, turns
from fmopt.planning.control.bias_wrench import Hold as Pressed
from fmopt.planning.control.compliance_frame import twist_scale
from fmopt.planning.control.controlled_motion import bounded, guarded
from fmopt.planning.placement.sequence_rows import HoldMargin
from fmopt.spatial.se3 import Pose, cross, left_jacobian
from fmopt.spatial.values import Array
from fmopt.task.problem import Problem, Specification

_FAR = 4.0  # times what is asked: contacts that are held by more are no row
_MET = 1e-7  # N: rows that are nearer than this to their limits are met
_RANK = 1e-9  # of the largest singular value: smaller ones are zero


def holds(
    problem: Problem, assembly: Assembly, claims: Sequence[Claim], tolerance: Tolerance, least: tuple[float, float]
) -> list[HoldMargin]:
    """How surely the pieces of a motion hold their contacts, of those that hold them by little.

    Slides have to be as firm and turns as steady as `least` says, shares of the contact force; 0 asks for nothing.
    """
    found = list[HoldMargin]()
    for number, (claim, bound) in enumerate(bounded(claims, tolerance.rho)):
        piece = claim.piece
        asked = least[turns(piece.start.local(piece.goal), tolerance.rho)]
        if not (piece.held and piece.making and asked > 0.0):
            continue
        move, held, made = guarded(assembly, problem, claim, bound)
        balance = held_by(move, tolerance.rho, problem.specification)
        if balance is None:
            continue
        share = balance.least / problem.specification.contact_force
        if share < _FAR * asked:
            changing = move_derivatives(assembly, claim, held, made)
            slopes = hold_derivatives(move, balance, changing, tolerance.rho, problem.specification)
            found.append(HoldMargin(number, share, asked, slopes))
    return found


def move_derivatives(
    assembly: Assembly, claim: Claim, held: Sequence[PrimitiveContact], made: Sequence[PrimitiveContact]
) -> "MoveDerivatives":
    """How a guarded move changes with displacements (12) of its start and goal, inside its contacts."""
    turn = claim.piece.start.local(claim.piece.goal)[3:]
    displacement = np.zeros((12, 6))
    displacement[:6, :3], displacement[6:, :3] = -np.eye(6, 3), np.eye(6, 3)
    # log(exp(δ) R) changes by J⁻¹ δ, J the left Jacobian; at the start the right one counts, which is that of −ω.
    displacement[3:6, 3:] = -np.linalg.inv(left_jacobian(-turn)).T
    displacement[9:, 3:] = np.linalg.inv(left_jacobian(turn)).T
    goal = claim.piece.goal
    w, dw = _wrenches(assembly, held, goal)
    dm = _wrenches(assembly, made, goal)[1]
    arms = _arms(assembly, held, goal, w, dw)
    return MoveDerivatives(displacement, _of_goal(dw), _of_goal(arms), _of_goal(dm))


def _of_goal(changes: Array) -> Array:
    """Derivatives (6, …) with respect to the goal as such (12, …) with respect to start and goal."""
    return np.concatenate([np.zeros_like(changes), changes])


def _wrenches(assembly: Assembly, contacts: Sequence[PrimitiveContact], pose: Pose) -> tuple[Array, Array]:
    """Wrenches (m, 6) of contacts for a unit force, and their derivatives (6, m, 6)."""
    rows = contact_rows(assembly, contacts, (), pose)
    dN = np.stack([Curvature.of(rows, rows, axis).power() for axis in np.eye(6)]).transpose(2, 1, 0)
    size = np.linalg.norm(rows.N[:, :3], axis=1)[:, None]
    w, dw = rows.N / size, dN / size
    longer = np.sum(dw[..., :3] * w[:, :3], axis=-1, keepdims=True)
    return w, dw - longer * w


def _arms(assembly: Assembly, contacts: Sequence[PrimitiveContact], pose: Pose, w: Array, dw: Array) -> Array:
    """The derivatives (6, m, 3) of the arms at which contacts push."""
    body, axes, found = assembly.moving.polyhedron.vertices, np.eye(3), np.zeros((6, len(contacts), 3))
    for i, contact in enumerate(contacts):
        corners = body[list(contact.moving)] @ pose.R.T
        match contact.kind:
            case Kind.VERTEX_FACE | Kind.BALL_FACE:
                found[3:, i] = cross(axes, corners[0])
            case Kind.FACE_VERTEX:
                found[:3, i] = -axes  # the corner stays, the reference point moves
            case Kind.EDGE_EDGE:
                found[:, i] = _along_edge(corners, (w[i, :3], w[i, 3:]), (dw[:, i, :3], dw[:, i, 3:]))
            case _:
                assert_never(contact.kind)
    return found


def _along_edge(corners: Array, wrench: tuple[Array, Array], changes: tuple[Array, Array]) -> Array:
    """The derivatives (6, 3) of the arm at which an edge is pushed, from its corners' arms (2, 3) and the wrench."""
    a, along = corners[0], corners[1] - corners[0]
    da, dalong = np.zeros((6, 3)), np.zeros((6, 3))
    da[3:], dalong[3:] = cross(np.eye(3), a), cross(np.eye(3), along)
    (n, torque), (dn, dtorque) = wrench, changes
    # The point a + s·along has the wrench's torque: s (along × n) = τ − a × n.
    across, dacross = cross(along, n), cross(dalong, n) + cross(along, dn)
    beside, dbeside = torque - cross(a, n), dtorque - cross(da, n) - cross(a, dn)
    size = float(across @ across)
    share = float(beside @ across) / size
    dshare = (dbeside @ across + dacross @ beside - 2.0 * share * dacross @ across) / size
    return np.asarray(da + share * dalong + dshare[:, None] * along)


@dataclass(frozen=True, eq=False)
class MoveDerivatives:
    """How a guarded move, V (6,), changes with n displacements."""

    displacement: Array  # of V (n, 6)
    held: Array  # of the wrenches of held contacts (n, m, 6)
    arms: Array  # of their points from the reference point (n, m, 3)
    made: Array  # of the wrenches of new contacts (n, k, 6)


def hold_derivatives(
    move: GuardedMove, found: Balance, changing: MoveDerivatives, rho: float, specification: Specification
) -> Array:
    """The derivatives (n,) of the share of the contact force that presses a move's least pressed contact."""
    return _Change.of(move, changing, rho, specification).of_force(found) / specification.contact_force


@dataclass(frozen=True, eq=False)
class _Change:
    """A guarded move with how it changes, in the terms of its linear programs."""

    move: GuardedMove
    changing: MoveDerivatives
    specification: Specification
    scale: Array  # of twists (6,)
    V: Array  # unit twist (6,)
    dV: Array  # its derivatives (n, 6)
    projector: Array  # Π (6, 6)
    dprojector: Array  # its derivatives (n, 6, 6)
    slid: Array  # how contact points slide (m, 3)
    dslid: Array  # its derivatives (n, m, 3)

    @staticmethod
    def of(move: GuardedMove, changing: MoveDerivatives, rho: float, specification: Specification) -> "_Change":
        """Of a move."""
        scale, V, basis = twist_scale(rho), move.direction(rho), move.space(rho)
        dV = changing.displacement / move.length(rho)
        dV = dV - np.outer(dV @ (V * scale**2), V)  # V stays of length 1 in the metric of ρ
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
        move, changing, spec, x = self.move, self.changing, self.specification, found.x
        m, n = len(move.held), len(move.made)
        f, g, k, r, b = x[:m], x[m : 2 * m], x[2 * m : 2 * m + n], x[2 * m + n : -3], float(x[-2])
        dpush, dpower = self.push
        felt = np.sign(float(move.reaction @ self.V))
        dfelt = felt * (changing.made.mean(axis=1) @ self.V + self.dV @ move.reaction)
        pressed = spec.friction * self.drag @ f - b * dpower + SURE * spec.termination_force * dfelt
        torque = -np.einsum("nmi,m->ni", changing.held[..., 3:], f) + b * dpush[:, 3:]
        first = 3 * m  # the push comes after 3 m rows of forces, torques after two sums
        taken = rows[first] * pressed + torque @ (rows[first + 3 : first + 6] - rows[first + 6 : first + 9])
        if found.push.hold is Pressed.PUSH:
            met = changing.made @ self.V + self.dV @ move.made.T
            taken = taken + float(equations[0]) * (-met @ k - b * dpower)
        rank = len(basis := move.space(float(self.scale[-1])))
        equations = equations[1:]
        if found.push.hold is not Pressed.NONE:
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
    none[-1] = False  # t alone may be negative
    K = np.vstack([A[met], C, np.eye(len(found.x))[none]])
    asked = np.zeros(len(found.x))
    asked[found.which] = 1.0
    # More rows may meet than there are forces: then least squares share the price among them.
    y = np.asarray(np.linalg.lstsq(K.T, asked, rcond=_RANK)[0], dtype=np.float64)
    rows: Array = np.zeros(len(b))
    rows[met] = y[: int(met.sum())]
    return rows, y[int(met.sum()) : int(met.sum()) + len(C)]
