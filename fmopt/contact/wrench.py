"""Frictionless contact wrenches of primitive contacts.

Virtual work makes the wrench of a unit force along the surface's normal equal to ∇f: it does the work ∇f·X.
"""

from __future__ import annotations

from typing import assert_never

import numpy as np

from fmopt.contact.primitive import Kind, PrimitiveContact
from fmopt.contact.surface import Surfaces
from fmopt.errors import InfeasibleError
from fmopt.geometry.polyhedron import Polyhedron
from fmopt.se3 import Pose, cross
from fmopt.values import Array

LEVEL = 1e-4  # sine of the angle between edges below which their wrench is not right to 1e-9


def contact_point(contact: PrimitiveContact, moving: Polyhedron, fixed: Polyhedron, pose: Pose) -> Array:
    """The point (3,) of the moving part's feature, in m, at which the fixed part pushes (at a pose in contact).

    Raises:
        InfeasibleError: edges are parallel.
    """
    match contact.kind:
        case Kind.VERTEX_FACE:
            return pose.apply(moving.vertices[contact.moving[0]])
        case Kind.FACE_VERTEX:
            return np.asarray(fixed.vertices[contact.fixed[0]])
        case Kind.EDGE_EDGE:
            a, b = pose.apply(moving.vertices[list(contact.moving)])
            wrench = contact_wrench(contact, moving, fixed, pose)
            across = cross(b - a, wrench[:3])
            beside = wrench[3:] - cross(a - pose.p, wrench[:3])
            return np.asarray(a + (beside @ across) / (across @ across) * (b - a))
        case _:
            assert_never(contact.kind)


def contact_normal(contact: PrimitiveContact, moving: Polyhedron, fixed: Polyhedron, pose: Pose) -> Array:
    """The unit normal (3,) along which the fixed part pushes the moving part.

    Raises:
        InfeasibleError: edges are parallel.
    """
    return contact_wrench(contact, moving, fixed, pose)[:3]


def contact_wrench(contact: PrimitiveContact, moving: Polyhedron, fixed: Polyhedron, pose: Pose) -> Array:
    """The wrench (f, τ) (6,) on the moving part of a unit contact force, about its body origin, in N and N·m.

    Raises:
        InfeasibleError: edges are parallel.
    """
    surface = Surfaces.of([contact], moving, fixed)
    sine = float(surface.sines(pose)[0])
    if not sine >= LEVEL:
        raise InfeasibleError(f"contact {contact.id} has no wrench: its edges are parallel, to a sine of {sine:.2g}")
    return np.asarray(surface.values_and_rows(pose)[1][0])
