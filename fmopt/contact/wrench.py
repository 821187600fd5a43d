"""Frictionless contact wrenches of primitive contacts, from the contact's own geometry.

Virtual work makes the wrench equal to ∇f: a unit force along the surface normal does the work ∇f·X.
"""

from __future__ import annotations

from typing import assert_never

import numpy as np

from fmopt.contact.primitive import Kind, PrimitiveContact
from fmopt.geometry.polyhedron import Polyhedron
from fmopt.se3 import Pose, cross
from fmopt.values import Array


def contact_point(contact: PrimitiveContact, moving: Polyhedron, fixed: Polyhedron, pose: Pose) -> Array:
    """The point (3,) of the moving part's feature, in m, at which the fixed part pushes (at a pose in contact)."""
    match contact.kind:
        case Kind.VERTEX_FACE:
            return pose.apply(moving.vertices[contact.moving[0]])
        case Kind.FACE_VERTEX:
            return np.asarray(fixed.vertices[contact.fixed[0]])
        case Kind.EDGE_EDGE:
            a, b = pose.apply(moving.vertices[list(contact.moving)])
            q, r = fixed.vertices[list(contact.fixed)]
            # The point where the moving edge meets the plane through the fixed edge and the common normal.
            across = cross(r - q, cross(b - a, r - q))
            return np.asarray(a + (across @ (q - a)) / (across @ (b - a)) * (b - a))
        case _:
            assert_never(contact.kind)


def contact_normal(contact: PrimitiveContact, moving: Polyhedron, fixed: Polyhedron, pose: Pose) -> Array:
    """The unit normal (3,) along which the fixed part pushes the moving part."""
    match contact.kind:
        case Kind.VERTEX_FACE:
            return np.asarray(fixed.faces[contact.fixed_feature].normal)
        case Kind.FACE_VERTEX:
            return np.asarray(-pose.R @ moving.faces[contact.moving_feature].normal)
        case Kind.EDGE_EDGE:
            a, b = pose.apply(moving.vertices[list(contact.moving)])
            q, r = fixed.vertices[list(contact.fixed)]
            m = cross(b - a, r - q)
            return np.asarray(m / np.linalg.norm(m))
        case _:
            assert_never(contact.kind)


def contact_wrench(contact: PrimitiveContact, moving: Polyhedron, fixed: Polyhedron, pose: Pose) -> Array:
    """The wrench (f, τ) (6,) on the moving part of a unit contact force, about its body origin, in N and N·m."""
    n = contact_normal(contact, moving, fixed, pose)
    return np.concatenate([n, cross(contact_point(contact, moving, fixed, pose) - pose.p, n)])
