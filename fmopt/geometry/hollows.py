"""Hollows of a part into which the other part never comes, as most holes of a plate: filled, they cost nothing.

A filled part holds the true one: what is clear of it is clear of the true one, but what touches it where it is filled
touches nothing there. Hollows are what the convex hull has more than the part, piece by piece, and what lies below the
holes of plane faces.
"""

from collections.abc import Callable, Iterator
from contextlib import suppress

import numpy as np
from manifold3d import CrossSection, JoinType, Manifold, OpType

from fmopt.errors import GeometryError
from fmopt.geometry.convex_pieces import snapped
from fmopt.geometry.polyhedron import (
    Face,
    Polyhedron,
    manifold_of,
    mesh_of,
    of_manifold,
    plane_basis,
    triangulated,
    with_vertices,
)
from fmopt.spatial.se3 import Pose

_FLAT = 1e-7  # of the diameter: what is thinner is nothing
_WIDER = 100.0  # times that: by how much what fills a hole goes into its walls
_SIDES = 16  # of the round by which a footprint grows


def filled(body: Polyhedron, other: Polyhedron, upright: Pose, aside: float, few: int) -> Polyhedron:
    """A part with its hollows filled into which another part does not come; itself where there are none.

    Args:
        other: the other part, seated, in the frame of `body`.
        upright: takes that frame to one in which the other part leaves along z.
        aside: how far beside its seat and its way the other part may be, m.
        few: reflex edges; a part with no more of them stays as it is.
    """
    if other.balls or body.reflex <= few:
        return body
    matrix, thin = np.column_stack([upright.R, upright.p]), _FLAT * body.diameter
    guest = manifold_of(other.vertices, triangulated(other)).transform(matrix)

    def is_entered(hollow: Manifold) -> bool:
        return _is_entered(hollow.transform(matrix), guest, aside, thin)

    for fill in (_in_hull, _below_faces):
        own = manifold_of(body.vertices, triangulated(body))
        # Slivers between what is filled and what is not may leave no polyhedron: the part stays as it is.
        with suppress(GeometryError):
            found = of_manifold(fill(body, own, is_entered).simplify(thin), thin)
            if len(found.faces) < len(body.faces):
                body = with_vertices(found, snapped(found.vertices, body.vertices))
    return body


def _in_hull(body: Polyhedron, own: Manifold, is_entered: Callable[[Manifold], bool]) -> Manifold:
    """The hull less those pieces of what it has more than the part that are entered."""
    whole = own.hull()
    entered = [hollow for hollow in (whole - own).decompose() if is_entered(hollow)]
    return Manifold.batch_boolean([whole, *entered], OpType.Subtract)


def _below_faces(body: Polyhedron, own: Manifold, is_entered: Callable[[Manifold], bool]) -> Manifold:
    """The part with what is free below holes of plane faces, as far as it is not entered."""
    whole, thin = own.hull(), _FLAT * body.diameter
    prisms = (prism for face in body.faces if face.loops[1:] for prism in _prisms(body, face, own, whole, thin))
    return Manifold.batch_boolean([own, *(prism for prism in prisms if not is_entered(prism))], OpType.Add)


def _prisms(body: Polyhedron, face: Face, own: Manifold, whole: Manifold, thin: float) -> Iterator[Manifold]:
    """Prisms below the holes of a plane face, a little wider, as deep as these are and have walls all around.

    Args:
        own, whole: the part and its hull.
        thin: what is thinner is nothing, m.
    """
    frame = np.column_stack([plane_basis(face.normal), face.normal])

    def below(shape: CrossSection, high: float) -> Manifold:
        turn = np.column_stack([frame, np.zeros(3)])
        return shape.extrude(high).translate((0.0, 0.0, face.offset - high)).transform(turn)

    def free(shape: CrossSection) -> list[tuple[float, float]]:
        """How low and how high what is free below a shape reaches, piece by piece, m."""
        pieces = ((below(shape, body.diameter) ^ whole) - own).decompose()
        sound = [one for one in pieces if one.volume() > thin * one.surface_area()]
        heights = [mesh_of(one)[0] @ face.normal for one in sound]
        return [(float(one.min()), float(one.max())) for one in heights]

    for loop in face.loops[1:]:
        outline = CrossSection([body.vertices[list(loop)][::-1] @ frame[:, :2]])
        wider = outline.offset(_WIDER * thin, JoinType.Miter)
        open_ = max((high for _, high in free(wider - outline)), default=-np.inf)  # below it walls are missing
        for low, high in free(outline):
            if high > face.offset - thin and face.offset - max(low, open_) > thin:
                yield below(wider, face.offset - max(low, open_))


def _is_entered(hollow: Manifold, guest: Manifold, aside: float, thin: float) -> bool:
    """Whether what leaves along z may come into a hollow on its way; what has next to no volume counts as entered."""
    if hollow.volume() <= thin * hollow.surface_area():
        return True
    passing = guest.trim_by_plane((0.0, 0.0, -1.0), thin - hollow.bounding_box()[5])
    footprint = passing.project().offset(aside, JoinType.Round, 2.0, _SIDES)
    return bool((footprint ^ hollow.project()).area() > thin * thin)
