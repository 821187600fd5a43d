"""Friction cones of contacts as wrenches, and the angle between two: how well a force sensor tells them apart."""

from __future__ import annotations

import math

import numpy as np

from fmopt.geometry.polyhedron import plane_basis
from fmopt.se3 import cross
from fmopt.values import Array

_SIDES = 8
_ROUNDS = 60
_STARTS = 3
_SETTLED = 1e-9
_NOTHING = 1e-9  # length of a wrench that is left of a unit one and counts as none


def friction_cone(normal: Array, arm: Array, friction: float, sides: int = _SIDES) -> Array:
    """Generators (sides, 6) of the wrenches that a contact can put on the part: a pyramid inside its friction cone.

    Args:
        normal: unit vector (3,) along which the contact pushes the part.
        arm: the contact point (3,) from the part's reference point, m.
        friction: coefficient.
        sides: of the pyramid.
    """
    first, second = plane_basis(normal).T
    turns = 2.0 * math.pi * np.arange(sides) / sides
    forces = normal + friction * (np.cos(turns)[:, None] * first + np.sin(turns)[:, None] * second)
    return np.hstack([forces, cross(arm, forces)])


def angle_between(one: Array, other: Array) -> float | None:
    """The least angle (rad) between vectors of two cones, given by generators (k, n) and (m, n); None where one is {0}.

    Each is the cone of sums with weights that are not negative. The greatest cosine is sought by projecting onto the
    cones in turn, from the generators that are nearest to the other cone: each projection brings the two nearer.
    """
    A, B = _directions(one), _directions(other)
    if not len(A) or not len(B):
        return None
    cosines = A @ B.T
    best = float(cosines.max())
    for i in np.argsort(-cosines.max(axis=1), kind="stable")[:_STARTS]:
        best = max(best, _nearest(A[i], A, B))
    return math.acos(min(max(best, -1.0), 1.0))


def _nearest(u: Array, A: Array, B: Array) -> float:
    """The cosine between a unit vector of cone A and the nearest of cone B, both moved until they come no nearer."""
    best = -1.0
    for _ in range(_ROUNDS):
        v = _onto(B, u)
        if v is None:
            return max(best, float((B @ u).max()))
        w = _onto(A, v)
        if w is None:
            return max(best, float(u @ v))
        u, cosine = w, float(w @ v)
        if cosine - best < _SETTLED:
            return max(best, cosine)
        best = cosine
    return best


def _onto(generators: Array, x: Array) -> Array | None:
    """The unit vector along the projection of x onto a cone; None where that is 0."""
    from scipy.optimize import nnls

    y = generators.T @ nnls(generators.T, x)[0]
    size = float(np.linalg.norm(y))
    return y / size if size > _NOTHING else None


def _directions(generators: Array) -> Array:
    size = np.linalg.norm(generators, axis=1)
    return np.asarray(generators[size > _NOTHING] / size[size > _NOTHING, None])
