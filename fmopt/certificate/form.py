"""Tolerances of form: how thick they make the surfaces of contacts.

The surfaces of the real parts lie within δ_m and δ_f of those planned with, Δ = δ_m + δ_f. Features that touch share a
point; it is within δ_m of a point y of the nominal feature of the moving part, within δ_f of a point z of that of the
fixed one, |y − z| ≤ Δ. On a contact that is held the distance f of the nominal features is within ±Δ, for crossing
edges times the sine of their angle; and so it is on one that has been made. Where a direction tells of a contact, it
is within ±κΔ by a lever κ:

- An edge from a to b, ℓ long, is hinged in a wall with a on it and crosses a rim, from which a is r inside at least.
  The heights of a and of y = a + μ(b − a) over the wall are within Δ, and y is no farther inside than Δ: μ ≥ (r − Δ)/ℓ,
  and that of b over a is within 2Δ/μ; all the more where b is on the wall itself, and has taken over.
- A face is level with a rim u that two of its edges cross. Over the face z₂ is as high as z₁ up to 2Δ, and they are as
  far apart as y₂ is from the first edge, s, but for 2Δ: the rim leans by 2Δ/(s − 2Δ) at most. Of edges that share a
  corner s is the sine of their angle times how far that is from y₂, which is no less than from the rim, but for Δ.

Of contacts that are made together any may touch first. Its distance is within Δ then, and those held are within κΔ:
with Q the rows of these times compliance, a that of the contact that counts, and W by how much they may differ between
poses at the goal, that one is within Δ (|a Q⁻¹| + W_a |Q⁻¹|) (I − W_Q |Q⁻¹|)⁻¹ κ, where the inverse is not negative.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import numpy as np

from fmopt.certificate.assembly import Assembly, contact_forms, hinge, level
from fmopt.certificate.contact_implications import held_on
from fmopt.certificate.remainder import Curvature, Extent
from fmopt.certificate.rows import Rows, points_above
from fmopt.certificate.segment_linearisation import Linearisation, Piece
from fmopt.certificate.tube import SETTLED
from fmopt.contact.primitive import Kind, PrimitiveContact
from fmopt.errors import InfeasibleError
from fmopt.spatial.se3 import length
from fmopt.spatial.values import Array

Carried: TypeAlias = tuple[int, Array, Array, float, Array, Array, Array, Array]
"""What `tube.carried` returns."""

_ROUNDS, _SETTLED = 40, 1e-13
_ALONGSIDE = 1e-6  # of how much nearer the contact being made comes: what comes no nearer is not made but passed
_STANDING = np.zeros(6)


def under_form(
    assembly: Assembly, piece: Piece, way: Linearisation, carry: Callable[[Array], tuple[Carried, Extent]]
) -> tuple[Carried, Extent]:
    """Errors carried through a piece whose contact surfaces are as thick as tolerances of form make them.

    Args:
        assembly: the two parts.
        piece: the piece.
        way: its linear picture.
        carry: carries the errors where form adds so much to the thickness of each contact (r,), m.

    Raises:
        InfeasibleError: a direction tells of a contact that nothing else says how far off it is.
    """
    levers = _Levers(assembly, piece, way)
    thick = assembly.form * levers.at(Extent(way.twist, np.zeros(6)))
    for _ in range(_ROUNDS):
        found = carry(thick)
        if found[0][0] != SETTLED:
            return found
        before, thick = thick, assembly.form * levers.at(found[1])
        if (np.abs(thick - before) <= _SETTLED * thick).all():
            return found
    raise InfeasibleError("tolerances of form make the surfaces of contacts too thick for this piece of motion")


class _Levers:
    """How many times Δ the surface of each contact (r,) is thick."""

    def __init__(self, assembly: Assembly, piece: Piece, way: Linearisation) -> None:
        self._assembly, self._piece, self._way = assembly, piece, way
        self._closing = piece.made is not None and piece.last
        self._basis = tuple(c.contact for c in piece.basis)
        self._edges = [self._edge(contact) for contact in self._basis]
        if self._closing:
            assert piece.made is not None
            self._edges.append(self._made_edge(piece.made))

    def at(self, extent: Extent) -> Array:
        """The levers where errors reach so far.

        Raises:
            InfeasibleError: they are too large for any.
        """
        found = np.array([1.0 if lever is None else lever(extent) for lever in self._edges])
        if self._closing and len(self._piece.making) > 1:
            assert self._piece.made is not None
            for contact in self._piece.making:
                if contact != self._piece.made:
                    found[-1] = max(found[-1], self._instead(contact, found[:-1], extent))
        return found

    def _edge(self, contact: PrimitiveContact) -> Callable[[Extent], float] | None:
        """The lever of a contact that a direction tells of, None for others."""
        found = hinge(self._assembly, contact, self._piece.held)
        if found is not None:
            return self._hinged(contact, found[0], self._basis)
        if level(self._assembly, contact, self._piece.held) is not None:
            return self._levelled(contact)
        return None

    def _made_edge(self, made: PrimitiveContact) -> Callable[[Extent], float] | None:
        """The same of the contact being made, which may complete the hinge of an edge that is held."""
        if made.kind is not Kind.VERTEX_FACE:
            return self._edge(made)
        for contact in self._piece.held:
            found = hinge(self._assembly, contact, (made,))
            if found is not None and hinge(self._assembly, contact, self._piece.held) is None:
                if contact not in self._basis:
                    raise _unknown(contact)
                return self._hinged(contact, found[0], (made,))
        return None

    def _hinged(
        self, contact: PrimitiveContact, face: int, own: tuple[PrimitiveContact, ...]
    ) -> Callable[[Extent], float]:
        """That of an edge hinged in a wall, on which one of some contacts has an end of it."""
        fixed, body = self._assembly.fixed.polyhedron, self._assembly.moving.polyhedron.vertices
        wall, ends = fixed.faces[face], held_on(self._assembly, face, own)
        if not ends & set(contact.moving):
            raise _unknown(contact)
        a, b = contact.moving if contact.moving[0] in ends else contact.moving[::-1]
        sides = [fixed.faces[n] for n in fixed.edges[contact.fixed_feature].faces]
        over = next(s for s in sides if not self._assembly.agree(s.normal, s.offset, wall.normal, wall.offset))
        inward = wall.normal * float(over.normal @ wall.normal) - over.normal
        inward = inward / length(inward)
        offset = float(inward @ fixed.vertices[contact.fixed[0]])
        least, far, form = self._least(body[a], inward, offset), length(body[b] - body[a]), self._assembly.form
        return lambda extent: 2.0 * far / _positive(least - _blur(extent, length(body[a])) - form, contact)

    def _levelled(self, contact: PrimitiveContact) -> Callable[[Extent], float]:
        """That of an edge on a rim on which another one of the same face is held."""
        body, form = self._assembly.moving.polyhedron, self._assembly.form
        other = next(c for c in self._piece.held if level(self._assembly, contact, (c,)) is not None)
        found = level(self._assembly, contact, (other,))
        if other not in self._basis or found is None:
            raise _unknown(contact)
        far = length(found[1])
        a, b = body.vertices[list(other.moving)]
        away = np.cross((b - a) / length(b - a), found[1] / far)
        reach = (body.vertices[list(contact.moving)] - a) @ away
        shared = set(contact.moving) & set(other.moving)
        if not shared and reach[0] * reach[1] <= 0.0:
            raise InfeasibleError(f"contact {contact.id} is too near to {other.id} for tolerances of form")
        if not shared:
            apart = float(np.abs(reach).min()) - 2.0 * form
            return lambda extent: 2.0 * far / _positive(apart, contact)
        # As far from the first edge as from the corner of both, times the sine of their angle.
        corner, ends = body.vertices[shared.pop()], body.vertices[list(contact.moving)]
        sine = float(np.abs(reach).max()) / length(ends[1] - ends[0])
        q, goal = self._assembly.fixed.polyhedron.vertices[contact.fixed[0]], self._piece.goal
        off = goal.apply(corner) - q
        across = off - found[0] * float(off @ found[0])
        across = across / length(across)
        least = self._least(corner, across, float(across @ q))

        def lever(extent: Extent) -> float:
            room = least - _blur(extent, length(corner)) - form
            return 2.0 * far / _positive(sine * room - 2.0 * form, contact)

        return lever

    def _least(self, v: Array, normal: Array, offset: float) -> float:
        """How high a body point is over a fixed plane nominally, at least, m."""
        rows = points_above(v[None], normal, offset).over(self._piece.start, self._piece.goal)
        return min(float(row.f[0]) for row in rows)

    def _instead(self, contact: PrimitiveContact, held: Array, extent: Extent) -> float:
        """The lever of the contact being made where another one touches first."""
        way, other = self._way, contact_forms(self._assembly, (contact,), ()).at(self._piece.goal)
        assert way.made is not None
        C = np.column_stack([way.directions.T, way.motion])
        if -float(other.N[0] @ way.motion) <= _ALONGSIDE * way.rate:
            return 1.0
        Q, W = _seen((way.held[1], other), C, extent)
        inverse = np.linalg.inv(Q)
        wider = np.linalg.inv(np.eye(len(Q)) - W @ np.abs(inverse))
        if not (wider >= 0.0).all():
            raise InfeasibleError(f"errors turn contact {contact.id} too far for tolerances of form")
        a, W = _seen((way.made[1],), C, extent)
        seen = np.abs(a @ inverse) + W @ np.abs(inverse)
        return float((seen @ wider @ np.append(held, 1.0))[0])


def _seen(parts: tuple[Rows, ...], C: Array, extent: Extent) -> tuple[Array, Array]:
    """Rows times compliance (r, c), and what that may differ by between poses with these errors at the goal."""
    N = np.vstack([rows.N for rows in parts])
    bends = [Curvature.of(rows, rows, _STANDING) for rows in parts]
    W = [np.concatenate([each.variation(extent.half, c) for each in bends]) for c in C.T]
    return N @ C, np.array(W).T


def _blur(extent: Extent, far: float) -> float:
    """How much a height over a fixed plane of a point of the part, so far out, may be off, coarsely, m."""
    theta, turn = extent.theta, extent.turn
    turned = theta + 0.5 * theta**2 + 0.125 * turn**2 + 0.5 * turn * theta + float(extent.coupling[1])
    return length(extent.offset) + float(extent.coupling[0]) + turned * far


def _positive(room: float, contact: PrimitiveContact) -> float:
    if room <= 0.0:
        raise InfeasibleError(f"contact {contact.id} may be where tolerances of form tell nothing of it", -room)
    return room


def _unknown(contact: PrimitiveContact) -> InfeasibleError:
    return InfeasibleError(
        f"contact {contact.id} follows from contacts that are not among those that determine the pose, so that "
        "tolerances of form tell nothing of it"
    )
