"""Local contact space: the half-spaces N·X ≥ D of linearised contacts around a pose, and all faces of their polyhedron.

Each face is one contact state: the contacts that are active together, as a closed set.
[DakinPopplestone1993] section 2, Appendix I and II.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from fmopt.contact.bounds import Bound
from fmopt.contact.lattice import Bits
from fmopt.contact.planes import first_equal
from fmopt.contact.polytope import Faces, enumerate_faces, enumerate_vertices
from fmopt.contact.primitive import PrimitiveContact
from fmopt.contact.surface import values_and_rows
from fmopt.errors import InfeasibleError
from fmopt.geometry.polyhedron import Polyhedron
from fmopt.se3 import Pose
from fmopt.values import Array, Value, frozen


@dataclass(frozen=True, eq=False)
class LocalSpace(Value):
    """Half-spaces normals·x ≥ offsets in scaled local coordinates x = X / scale around a pose.

    Attributes:
        pose: where the contacts were linearised.
        contacts: the k contacts.
        normals: unit rows (k, 6).
        offsets: (k,), distances in scaled units (clearances).
        scale: (6,), a clearance in m for lengths, clearance / ρ in rad for angles.
        limits: (l, 7), unit rows and offsets of half-spaces that bound where the contacts hold; no contact is there.
    """

    pose: Pose
    contacts: tuple[PrimitiveContact, ...]
    normals: Array
    offsets: Array
    scale: Array
    limits: Array

    def __post_init__(self) -> None:
        k = len(self.contacts)
        object.__setattr__(self, "normals", frozen(self.normals, k, 6, name="normals"))
        object.__setattr__(self, "offsets", frozen(self.offsets, k, name="offsets"))
        object.__setattr__(self, "scale", frozen(self.scale, 6, name="scale"))
        object.__setattr__(self, "limits", frozen(self.limits, None, 7, name="limits"))

    @property
    def half_spaces(self) -> tuple[Array, Array]:
        """Rows (k + l, 6) and offsets (k + l,) of contacts, and of limits after them."""
        limits = self.limits
        return np.vstack([self.normals, limits[:, :6]]), np.append(self.offsets, limits[:, 6])

    def poses(self, points: ArrayLike) -> tuple[Pose, ...]:
        """The poses of scaled points (n, 6)."""
        return tuple(self.pose.moved(self.scale * x) for x in np.atleast_2d(np.asarray(points, dtype=np.float64)))


def scaling(clearance: float, rho: float) -> Array:
    """Scaled units (6,): lengths in clearances (m), angles in clearance / ρ (rad)."""
    return np.array([clearance] * 3 + [clearance / rho] * 3)


def local_space(
    contacts: Sequence[PrimitiveContact],
    moving: Polyhedron,
    fixed: Polyhedron,
    pose: Pose,
    clearance: float,
    rho: float,
    limits: Sequence[Bound] = (),
    reach: float = np.inf,
    angle: float = np.inf,
) -> LocalSpace:
    """The contacts' half-spaces N·X ≥ D around a pose, in scaled units with unit rows.

    Args:
        contacts: primitive contacts near the pose.
        moving: the moving part in its body frame.
        fixed: the fixed part.
        pose: the reference pose X = 0.
        clearance: m, the unit of length.
        rho: characteristic length in m, for angles.
        limits: bounds of the cell in which exactly these contacts count; see `fmopt.contact.bounds.cell`.
        reach: m; |dx|, |dy| and |dz| stay below it, where the linear picture is to be trusted.
        angle: rad; the same for each rotation coordinate.
    """
    scale = scaling(clearance, rho)
    signs = np.concatenate([np.ones(len(contacts)), [-bound.sign for bound in limits]])
    listed = (*contacts, *(bound.contact for bound in limits))
    f, N = values_and_rows(listed, moving, fixed, pose)
    rows = signs[:, None] * N * scale
    size = np.linalg.norm(rows, axis=1)
    planes = np.column_stack([rows, -signs * f]) / size[:, None]
    k = len(contacts)
    box = np.array([reach] * 3 + [angle] * 3) / scale
    # A limit in the plane of a contact is that contact's own doing.
    own = first_equal(planes)[k:] < k
    walls = [[*-side * axis, -size] for axis, size in zip(np.eye(6), box, strict=True) for side in (1.0, -1.0)]
    walls = [wall for wall in walls if np.isfinite(wall[6])]
    cut = np.concatenate([planes[k:][~own], np.reshape(walls, (-1, 7))])
    return LocalSpace(pose, tuple(contacts), planes[:k, :6], planes[:k, 6], scale, cut)


def faces(space: LocalSpace) -> Faces:
    """All faces of the local contact space in scaled units: free space included, faces on a limit left out.

    Raises:
        InfeasibleError: the contacts violate each other, or every face lies on a limit.
    """
    k = len(space.contacts)
    found = enumerate_faces(*space.half_spaces)
    if not len(space.limits):
        return found
    open_ = ~found.active[:, k:].any(axis=1)
    if not open_.any():
        raise InfeasibleError(
            f"the local contact space at {space.pose.vector()} has no extent between its limits",
            advice="linearise at a pose that is not on the end of a face or an edge",
        )
    return Faces(found.active[open_, :k], found.dimensions[open_], found.points[open_], found.lineality)


def vertices(space: LocalSpace) -> tuple[Array, Bits, Bits]:
    """Vertices of the local contact space in scaled units, also on limits, and the directions in which it has no end.

    Where parts may slide both ways without end, there is one vertex for all of the way.

    Returns:
        vertices and unit directions (m, 6), which contacts are active there (m, k), and which are directions (m,).

    Raises:
        InfeasibleError: the contacts violate each other.
    """
    points, on, endless = enumerate_vertices(*space.half_spaces)
    return points, on[:, : len(space.contacts)], endless
