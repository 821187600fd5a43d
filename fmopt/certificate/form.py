"""Tolerances of form: how thick they make the surfaces of contacts.

The surfaces of the real parts lie within δ_m and δ_f of those planned with, Δ = δ_m + δ_f. Features that touch share a
point; it is within δ_m of a point y of the nominal feature of the moving part, within δ_f of a point z of that of the
fixed one, |y − z| ≤ Δ. On a contact that is held the distance f of the nominal features is within ±Δ, for crossing
edges times the sine of their angle; and so it is on one that has been made. Where a direction tells of a contact, it
is within ±κΔ by a lever κ:

- An edge from a to b, ℓ long, is hinged in a wall with a on it and crosses a rim, from which a is r inside at least.
  The heights of a and of y = a + μ(b − a) over the wall are within Δ, and y is no farther inside than Δ: μ ≥ (r − Δ)/ℓ,
  and that of b over a is within 2Δ/μ; and within 2Δ where b is on the wall itself, and has taken over.
- A face is level with a rim u that two of its edges cross. Over the face z₂ is as high as z₁ up to 2Δ, and they are as
  far apart as y₂ is from the first edge, s, but for 2Δ: the rim leans by 2Δ/(s − 2Δ) at most. Of edges that share a
  corner s is the sine of their angle times how far that is from y₂, which is no less than from the rim, but for Δ.

Of contacts that are made together any may touch first. Its distance is within Δ then, and those held are within κΔ. Of
two corners on one wall, or two edges of a face on one rim, the other differs from it by a direction that those held
have at zero: how high one corner is over the other, how much the rim leans over its length. In general, with Q the rows
of these times compliance, a that of the contact that counts, and W by how much they may differ between poses at the
goal, that one is within Δ (|a Q⁻¹| + W_a |Q⁻¹|) (I − W_Q |Q⁻¹|)⁻¹ κ, where the inverse is not negative; and so is the
direction, with Q the rows of those held alone.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from fmopt.certificate.assembly import Assembly, contact_forms, hinge, level
from fmopt.certificate.contact_implications import facts, held_on
from fmopt.certificate.contact_implications import level as still
from fmopt.certificate.remainder import Curvature, Ends, EndsBatch
from fmopt.certificate.rows import Forms, Rows, directions_along, points_above
from fmopt.certificate.segment_linearisation import Linearisation, Piece
from fmopt.contact.primitive import Kind, PrimitiveContact
from fmopt.errors import InfeasibleError
from fmopt.spatial.se3 import length
from fmopt.spatial.values import Array

_ROUNDS, _ABOVE = 60, 1e-11  # the share by which levers are larger than what follows from them
_ALONGSIDE = 1e-6  # of how much nearer the contact being made comes: what comes no nearer is not made but passed
_STANDING = np.zeros(6)

_Lever = Callable[[Ends | None], float]


def under_form(
    assembly: Assembly, piece: Piece, way: Linearisation, carry: Callable[[Array], tuple[Ends, float]]
) -> tuple[Ends, float]:
    """Errors carried through a piece whose contact surfaces are as thick as tolerances of form make them.

    Levers depend on where the errors take the part. On each execution they hold where the piece starts, by the errors
    there, and nothing that follows from them breaks them. `carry` is told how much form adds to the thickness of each
    contact (r,), m.

    Raises:
        InfeasibleError: it cannot be done, or a direction tells of a contact that nothing else says how far off it is.
    """
    levers = _Levers(assembly, piece, way)
    most = levers.at(None)
    for _ in range(_ROUNDS):
        found = carry(assembly.form * most)
        least = levers.at(found[0])
        if (least <= most).all():
            return found
        most = (1.0 + _ABOVE) * least
    raise InfeasibleError("tolerances of form make the surfaces of contacts too thick for this piece of motion")


class _Edges:
    """The levers of contacts that a direction tells of."""

    def __init__(self, assembly: Assembly, piece: Piece) -> None:
        self._assembly, self._piece = assembly, piece
        self._basis = tuple(c.contact for c in piece.basis)

    def held(self, contact: PrimitiveContact) -> _Lever | None:
        """The lever of a contact that a direction tells of, None for others."""
        found = hinge(self._assembly, contact, self._piece.held)
        if found is not None:
            return self._hinged(contact, found[0], self._basis)
        if level(self._assembly, contact, self._piece.held) is not None:
            return self._levelled(contact)
        return None

    def made(self, made: PrimitiveContact) -> _Lever | None:
        """The same of the contact being made, which may complete the hinge of an edge that is held."""
        if made.kind is not Kind.VERTEX_FACE:
            return self.held(made)
        for contact in self._piece.held:
            found = hinge(self._assembly, contact, (made,))
            if found is not None and hinge(self._assembly, contact, self._piece.held) is None:
                if contact not in self._basis:
                    raise _unknown(contact)
                return self._hinged(contact, found[0], (made,))
        return None

    def _hinged(self, contact: PrimitiveContact, face: int, own: tuple[PrimitiveContact, ...]) -> _Lever:
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
        rows, far = points_above(body[[a]], inward, offset), length(body[b] - body[a])
        return lambda ends: max(2.0, 2.0 * far / _positive(self._room(rows, ends), contact))

    def _levelled(self, contact: PrimitiveContact) -> _Lever:
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
            return lambda _: 2.0 * far / _positive(apart, contact)
        # As far from the first edge as from the corner of both, times the sine of their angle.
        corner, ends = body.vertices[shared.pop()], body.vertices[list(contact.moving)]
        sine = float(np.abs(reach).max()) / length(ends[1] - ends[0])
        q, goal = self._assembly.fixed.polyhedron.vertices[contact.fixed[0]], self._piece.goal
        off = goal.apply(corner) - q
        across = off - found[0] * float(off @ found[0])
        across = across / length(across)
        rows = points_above(corner[None], across, float(across @ q))
        return lambda ends: 2.0 * far / _positive(sine * self._room(rows, ends) - 2.0 * form, contact)

    def _room(self, rows: Forms, ends: Ends | None) -> float:
        """How high a real body point is over a fixed plane, at least, m."""
        if ends is None:
            nominal = rows.over(self._piece.start, self._piece.goal)
            return min(float(row.f[0]) for row in nominal) - self._assembly.form
        begun = replace(ends, slack=np.zeros((6, 0)), core=None)
        before, along = (EndsBatch.of((each,)).over(rows) for each in (begun, ends))
        return min(float(before.bounds[0, 0, 0]), float(along.lower[0, 0]))


class _Levers:
    """How many times Δ the surface of each contact (r,) is thick."""

    def __init__(self, assembly: Assembly, piece: Piece, way: Linearisation) -> None:
        self._way, self._piece, edges = way, piece, _Edges(assembly, piece)
        self._assembly, self._closing = assembly, piece.made is not None and piece.last
        self._each = [edges.held(c.contact) for c in piece.basis]
        if self._closing:
            assert piece.made is not None
            self._each.append(edges.made(piece.made))

    def at(self, ends: Ends | None) -> Array:
        """The levers with errors, or without any.

        Raises:
            InfeasibleError: errors are too large for any.
        """
        found = np.array([1.0 if lever is None else lever(ends) for lever in self._each])
        if self._closing and len(self._piece.making) > 1:
            assert self._piece.made is not None
            half, most = np.zeros(6) if ends is None else ends.extent.half, found[-1]
            for contact in self._piece.making:
                if contact != self._piece.made:
                    most = max(most, self._instead(contact, found, half))
            found[-1] = most
        return found

    def _instead(self, contact: PrimitiveContact, levers: Array, half: Array) -> float:
        """The lever of the contact being made where another one touches first."""
        held, own = levers[:-1], float(levers[-1])
        way, other = self._way, contact_forms(self._assembly, (contact,), ()).at(self._piece.goal)
        assert way.made is not None
        if -float(other.N[0] @ way.motion) <= _ALONGSIDE * way.rate:
            return 1.0
        between = self._between(contact)
        if between is not None:
            seen = _tied(between.at(self._piece.goal), (way.held[1],), way.directions.T, half)
            # A hinge that is completed takes the corner's height and that at the rim, one Δ each, times its lever.
            return own * (1.0 + float(seen @ held) / (2.0 if way.made[1].forms.directed[0] else 1.0))
        C = np.column_stack([way.directions.T, way.motion])
        return float(_tied(way.made[1], (way.held[1], other), C, half) @ np.append(held, 1.0))

    def _between(self, contact: PrimitiveContact) -> Forms | None:
        """By what direction, which the held contacts have at zero, two contacts that are made together differ."""
        made, turns = self._piece.made, facts(self._assembly, self._piece.held).turns
        assert made is not None
        body, fixed = self._assembly.moving.polyhedron, self._assembly.fixed.polyhedron
        if contact.kind is made.kind is Kind.VERTEX_FACE:
            wall, other = fixed.faces[made.fixed_feature], fixed.faces[contact.fixed_feature]
            k = body.vertices[made.moving[0]] - body.vertices[contact.moving[0]]
            if self._assembly.agree(wall.normal, wall.offset, other.normal, other.offset):
                return directions_along(wall.normal, k[None]) if still(turns, wall.normal, k[None])[0] else None
        assert self._way.made is not None
        if self._way.made[1].forms.directed[0]:
            return None
        if contact.kind is made.kind is Kind.EDGE_EDGE and contact.fixed_feature == made.fixed_feature:
            shared = set(body.edges[made.moving_feature].faces) & set(body.edges[contact.moving_feature].faces)
            a, b = fixed.vertices[list(made.fixed)]
            for number in sorted(shared):
                normal = body.faces[number].normal
                if still(turns, (b - a) / length(b - a), normal[None])[0]:
                    return directions_along(b - a, normal[None])
        return None


def _tied(row: Rows, parts: tuple[Rows, ...], C: Array, half: Array) -> Array:
    """By how much of what others are off, one by one (r,), a row is off at most, with errors in a box at the goal."""
    Q, W = _seen(parts, C, half)
    inverse = np.linalg.inv(Q)
    wider = np.linalg.inv(np.eye(len(Q)) - W @ np.abs(inverse))
    if not (wider >= 0.0).all():
        raise InfeasibleError("errors turn contacts too far for tolerances of form")
    a, W = _seen((row,), C, half)
    return np.asarray(((np.abs(a @ inverse) + W @ np.abs(inverse)) @ wider)[0])


def _seen(parts: tuple[Rows, ...], C: Array, half: Array) -> tuple[Array, Array]:
    """Rows times compliance (r, c), and what that may differ by between poses with these errors at the goal."""
    N = np.vstack([rows.N for rows in parts])
    bends = [Curvature.of(rows, rows, _STANDING) for rows in parts]
    W = [np.concatenate([each.variation(half, c) for each in bends]) for c in C.T]
    return N @ C, np.array(W).T.reshape(len(N), -1)


def made_lever(assembly: Assembly, piece: Piece, ends: Ends) -> float:
    """How many times Δ the function of the contact being made may be off zero as it is touched; infinite if unknown."""
    assert piece.made is not None
    try:
        lever = _Edges(assembly, piece).made(piece.made)
        return 1.0 if lever is None else lever(ends)
    except InfeasibleError:
        return np.inf


def _positive(room: float, contact: PrimitiveContact) -> float:
    if room <= 0.0:
        raise InfeasibleError(f"contact {contact.id} may be where tolerances of form tell nothing of it", -room)
    return room


def _unknown(contact: PrimitiveContact) -> InfeasibleError:
    return InfeasibleError(
        f"contact {contact.id} follows from contacts that are not among those that determine the pose, so that "
        "tolerances of form tell nothing of it"
    )
