"""How firmly and steadily the pieces of a motion hold their contacts, as rows of the placement of its poses."""

from __future__ import annotations

from collections.abc import Sequence
from typing import assert_never

import numpy as np

from fmopt.certificate.assembly import Assembly, contact_rows
from fmopt.certificate.claim import Claim
from fmopt.certificate.remainder import Curvature
from fmopt.certificate.segment_linearisation import Tolerance
from fmopt.contact.primitive import Kind, PrimitiveContact
from fmopt.planning.control.bias_derivatives import MoveDerivatives, hold_derivatives
from fmopt.planning.control.bias_wrench import held_by, turns
from fmopt.planning.control.controlled_motion import bounded, guarded
from fmopt.planning.placement.hold_rows import Hold
from fmopt.spatial.se3 import Pose, cross, left_jacobian
from fmopt.spatial.values import Array
from fmopt.task.problem import Problem

_FAR = 4.0  # times what is asked: contacts that are held by more are no row


def holds(
    problem: Problem, assembly: Assembly, claims: Sequence[Claim], tolerance: Tolerance, least: tuple[float, float]
) -> list[Hold]:
    """How surely the pieces of a motion hold their contacts, of those that hold them by little.

    Args:
        problem: whose specification says with which forces.
        assembly: the two parts.
        claims: of all pieces.
        tolerance: velocity error and metric.
        least: how firm slides and how steady turns have to be, shares of the contact force; 0 where nothing is asked.
    """
    found = list[Hold]()
    for number, (claim, bound) in enumerate(bounded(claims, tolerance.rho)):
        piece = claim.piece
        asked = least[turns(piece.start.local(piece.goal), tolerance.rho)]
        if not (piece.held and piece.making and asked > 0.0):
            continue
        move, held, made = guarded(problem, assembly, claim, bound)
        balance = held_by(move, tolerance.rho, problem.specification)
        if balance is None:
            continue
        share = balance.least / problem.specification.contact_force
        if share < _FAR * asked:
            changing = move_derivatives(assembly, claim, held, made)
            slopes = hold_derivatives(move, balance, changing, tolerance.rho, problem.specification)
            found.append(Hold(number, share, asked, slopes))
    return found


def move_derivatives(
    assembly: Assembly, claim: Claim, held: Sequence[PrimitiveContact], made: Sequence[PrimitiveContact]
) -> MoveDerivatives:
    """How the guarded move of a piece changes with displacements (12) of its start and its goal, inside its contacts.

    Args:
        assembly: the two parts.
        claim: of the piece.
        held, made: the contacts that touch at its goal.
    """
    turn = claim.piece.start.local(claim.piece.goal)[3:]
    displacement = np.zeros((12, 6))
    displacement[:6, :3], displacement[6:, :3] = -np.eye(6, 3), np.eye(6, 3)
    displacement[3:6, 3:], displacement[9:, 3:] = (
        -np.linalg.inv(left_jacobian(-turn)).T,
        np.linalg.inv(left_jacobian(turn)).T,
    )
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
    w = rows.N / size
    dw = dN / size
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
                found[:3, i] = -axes
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
    across, dacross = cross(along, n), cross(dalong, n) + cross(along, dn)
    beside, dbeside = torque - cross(a, n), dtorque - cross(da, n) - cross(a, dn)
    size = float(across @ across)
    share = float(beside @ across) / size
    dshare = (dbeside @ across + dacross @ beside - 2.0 * share * dacross @ across) / size
    return np.asarray(da + share * dalong + dshare[:, None] * along)
