"""The function of a contact as an equality: zero exactly while the contact is held, positive before it is made."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fmopt.certificate.assembly import Assembly, hinge, level
from fmopt.certificate.rows import Forms, Rows, directions_along, edges_apart, faces_above, points_above, stacked
from fmopt.contact.primitive import Kind, PrimitiveContact
from fmopt.memory import remembered
from fmopt.se3 import Pose, length

_MEMORY = 4096


def contact_rows(
    assembly: Assembly, contacts: Sequence[PrimitiveContact], together: Sequence[PrimitiveContact], pose: Pose
) -> Rows:
    """Rows (k) of contacts at a pose.

    Args:
        assembly: the two parts.
        contacts: whose rows.
        together: all contacts under consideration; an edge hinged by one of them in the wall gets its hinge form.
        pose: nominal pose.
    """
    return contact_forms(assembly, tuple(contacts), tuple(together)).at(pose)


@remembered(_MEMORY)
def contact_forms(
    assembly: Assembly, contacts: tuple[PrimitiveContact, ...], together: tuple[PrimitiveContact, ...]
) -> Forms:
    """The functions of contacts, see `contact_rows`."""
    if not contacts:
        return points_above(np.zeros((0, 3)), np.zeros(3), 0.0)
    return stacked(*(_form(assembly, contact, together) for contact in contacts))


@remembered(_MEMORY)
def made_form(assembly: Assembly, made: PrimitiveContact, held: tuple[PrimitiveContact, ...]) -> Forms:
    """The function (1) that tells how far a contact is from being made, positive before.

    A vertex that reaches a wall while its edge is held on a rim of that wall is (0, 1) times the edge's rise over the
    wall high: the edge's direction alone tells when it touches, whatever the part's position is.

    Args:
        assembly: the two parts.
        made: the contact.
        held: all contacts held on the way.
    """
    if made.kind is Kind.VERTEX_FACE:
        body, fixed = assembly.moving.polyhedron.vertices, assembly.fixed.polyhedron
        for contact in held:
            found = hinge(assembly, contact, (made,))
            if found is not None and hinge(assembly, contact, held) is None:
                wall, a, b = found
                return directions_along(fixed.faces[wall].normal, body[[a]] - body[[b]])
    return contact_forms(assembly, (made,), held)


@remembered(_MEMORY)
def made_scale(assembly: Assembly, made: PrimitiveContact, held: tuple[PrimitiveContact, ...], rho: float) -> float:
    """What makes a margin of `made_form`, m: 1 for a distance; a direction's angle counts on an arm of ρ."""
    found = made_form(assembly, made, held).at(Pose(np.zeros(3), np.eye(3)))
    return rho / float(found.forms.lever[0]) if not found.forms.bilinear.any() and not found.N[0, :3].any() else 1.0


def _form(assembly: Assembly, contact: PrimitiveContact, together: Sequence[PrimitiveContact]) -> Forms:
    body, fixed = assembly.moving.polyhedron.vertices, assembly.fixed.polyhedron
    if contact.kind is Kind.VERTEX_FACE:
        face = fixed.faces[contact.fixed_feature]
        return points_above(body[[contact.moving[0]]], face.normal, face.offset)
    if contact.kind is Kind.FACE_VERTEX:
        own = assembly.moving.polyhedron.faces[contact.moving_feature]
        return faces_above(own.normal, own.offset, fixed.vertices[[contact.fixed[0]]])
    found = hinge(assembly, contact, together)
    if found is not None:
        wall, a, b = found
        return directions_along(fixed.faces[wall].normal, body[[b]] - body[[a]])
    flush = level(assembly, contact, together)
    if flush is not None:
        return directions_along(*flush)
    a, b = body[list(contact.moving)]
    c, d = fixed.vertices[list(contact.fixed)]
    return edges_apart((b - a) / length(b - a), (d - c) / length(d - c), c, a[None])
