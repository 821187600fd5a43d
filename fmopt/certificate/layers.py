"""Thickness of contact surfaces: what curvature, nominal poses and rounding leave between a row and its surface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fmopt import ellipsoid
from fmopt.certificate.assembly import Assembly, hinge
from fmopt.certificate.functions import contact_forms
from fmopt.certificate.piece import Piece
from fmopt.certificate.rows import Curvature, lengths
from fmopt.certificate.way import Way
from fmopt.contact.primitive import PrimitiveContact
from fmopt.errors import InfeasibleError
from fmopt.uncertainty.error_set import Support
from fmopt.values import Array

_FEEBLE = 1e-3  # m; an edge contact must feel the contact that makes it a hinge on an arm this long


@dataclass(frozen=True, eq=False)
class Layers:
    """The thickness of contact surfaces at both ends of a piece.

    An edge contact that becomes a hinge as the made contact touches must keep its own row until then. The made
    contact's share of the correction may be chosen freely before the end, so it takes up that row.

    Args:
        held: curvature of the held basis' rows, by the contacts held.
        first: what start set and nominal start leave of them (h,), m.
        second: what the nominal goal leaves of them (h,), m.
        final: curvature of the rows of the basis at the goal, by the contacts held there; None before the last piece.
        rest: what the nominal goal leaves of those (r,), m.
        residue: what rounding leaves of them under the projection (r, 2), per m and per rad.
        goal_dual: T^G (6, r).
        delay: how much farther the execution goes for each thickness (r,), as a share of the piece, 1/m.
        same: basis contacts whose rows are the same at the goal.
        upgraded: basis contacts that become hinges as the move ends.
        taken: how much their own rows feel the contact being made (k,).
        felt: how much they feel the other held ones (k, r − 1).
    """

    held: Curvature
    first: Array
    second: Array
    final: Curvature | None
    rest: Array
    residue: Array
    goal_dual: Array
    delay: Array
    same: tuple[int, ...]
    upgraded: tuple[int, ...]
    taken: Array
    felt: Array

    def thicknesses(self, theta: float, offset: Array, wide: Array) -> tuple[Array, Array]:
        """Thickness at the start (h,) and at the goal (r,), m.

        Args:
            theta: bound of the angle of errors, rad.
            offset: half-widths (3,) of the box around their translation, m.
            wide: bounds (2,) of translation and angle with their drift, before contacts take it up.
        """
        left = self.held.bound(theta, offset)
        own = left + np.maximum(self.first, self.second)
        if self.final is None:
            return own, own
        final = self.final.bound(theta, offset) + self.rest + self.residue @ wide
        for i in self.same:
            final[i] = own[i]
        for n, i in enumerate(self.upgraded):
            seen = float(self.second[i] + self.felt[n] @ final[:-1])
            own[i] = left[i] + max(float(self.first[i]), seen)
            final[-1] = max(final[-1], own[i] / self.taken[n])
        return own, final


def layers_of(assembly: Assembly, piece: Piece, way: Way, start: Support) -> Layers:
    """The thickness of the contact surfaces along a piece.

    Args:
        assembly: the two parts.
        piece: the piece.
        way: its linear picture.
        start: support of the start set without its old thickness.

    Raises:
        InfeasibleError: contacts do not determine their compliant directions.
    """
    first, second = way.held
    held = Curvature.of(first, second, way.turn, way.travel)
    own = np.abs(first.f) + start(first.N), np.abs(second.f)
    none = np.zeros(0)
    if piece.made is None or not piece.last:
        return Layers(held, *own, None, none, none, way.goal_dual, np.zeros(len(first.f)), (), (), none, none)
    contacts = (*(c.contact for c in piece.basis), piece.made)
    begin, end = contact_forms(assembly, contacts, piece.goal_contacts).over(piece.start, piece.goal)
    C = np.vstack([way.directions, way.motion]).T
    inverse = ellipsoid.coupling_inverse(end.N, C)
    upgraded = tuple(i for i, c in enumerate(contacts[:-1]) if _becomes_hinge(assembly, c, piece))
    same = tuple(i for i in range(len(contacts) - 1) if i not in upgraded)
    dual = C @ inverse
    felt = np.abs(second.N[list(upgraded)] @ dual)
    taken = felt[:, -1]
    if (taken < _FEEBLE).any():
        raise InfeasibleError("an edge contact hardly feels the contact that makes it a hinge")
    felt = felt[:, :-1].copy()
    felt[np.arange(len(upgraded)), list(upgraded)] = 0.0
    left = end.N @ way.projector
    residue = np.column_stack([lengths(left[:, :3]), lengths(left[:, 3:])])
    final = Curvature.of(begin, end, way.turn, way.travel)
    return Layers(held, *own, final, np.abs(end.f), residue, dual, np.abs(inverse[-1]), same, upgraded, taken, felt)


def _becomes_hinge(assembly: Assembly, contact: PrimitiveContact, piece: Piece) -> bool:
    before, after = (hinge(assembly, contact, together) for together in (piece.held, piece.goal_contacts))
    return (before is None) != (after is None)
