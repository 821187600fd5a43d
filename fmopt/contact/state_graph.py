"""The contact-state graph of a local contact space. [DakinPopplestone1993] sections 2 and 3.

Local contact space: the half-spaces N·X ≥ D of linearised contacts around a pose, and all faces of their polyhedron.

Each face is one contact state: the contacts that are active together, as a closed set.
[DakinPopplestone1993] section 2, Appendix I and II.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import compress

import numpy as np

from fmopt.contact.c_surface import Surfaces
from fmopt.contact.face_lattice import covers
from fmopt.contact.facet_bounds import BoundingFunction
from fmopt.contact.polytope import PolytopeFaces, enumerate_faces, first_equal
from fmopt.contact.primitive import PrimitiveContact
from fmopt.errors import InfeasibleError
from fmopt.geometry.polyhedron import Polyhedron
from fmopt.spatial.se3 import Pose
from fmopt.spatial.values import Array, Value


@dataclass(frozen=True, eq=False)
class ContactState(Value, point=(6,)):
    """The contacts that are active together on one facet, merged.

    Attributes:
        dimension: of the facet, 6 − rank.
        point: (6,), local coordinates X in m and rad of a point in its relative interior.
    """

    id: str
    contacts: tuple[str, ...]
    dimension: int
    point: Array


@dataclass(frozen=True, eq=False)
class ContactGraph(Value):
    """Contact states, largest dimension first, and for each the adjacent ones of lower and of higher dimension.

    For each state `sons` has the indices of those on the boundary of its facet, one dimension lower, and `fathers` of
    those whose facets it bounds, one dimension higher.
    """

    space: "LocalSpace"
    states: tuple[ContactState, ...]
    sons: tuple[tuple[int, ...], ...]
    fathers: tuple[tuple[int, ...], ...]

    def count(self) -> dict[int, int]:
        """Number of states by dimension."""
        dimensions = [state.dimension for state in self.states]
        return {d: dimensions.count(d) for d in sorted(set(dimensions))}


def contact_graph(space: "LocalSpace", faces: PolytopeFaces) -> ContactGraph:
    """The contact-state graph of a local space and its faces."""
    names = [contact.id for contact in space.contacts]
    # Points are made in scaled units, of clearances, in which the program is well conditioned.
    points = space.scale * faces.points
    states = []
    for i, (row, dimension) in enumerate(zip(faces.active.tolist(), faces.dimensions.tolist(), strict=True)):
        contacts = tuple(compress(names, row))
        # Only free space has no contact, and it is the first, being of the largest dimension.
        states.append(ContactState(f"s{i}" if contacts else "free", contacts, dimension, points[i]))
    covered = covers(faces.active, faces.dimensions)
    sons, fathers = (tuple(tuple(np.flatnonzero(row).tolist()) for row in side) for side in (covered, covered.T))
    return ContactGraph(space, tuple(states), sons, fathers)


@dataclass(frozen=True, eq=False)
class LocalSpace(Value, normals=("contacts", 6), offsets=("contacts",), scale=(6,), limits=(None, 7)):
    """Half-spaces normals·x ≥ offsets in scaled local coordinates x = X / scale around a pose.

    Attributes:
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

    @property
    def half_spaces(self) -> tuple[Array, Array]:
        """Rows (k + l, 6) and offsets (k + l,) of contacts, and of limits after them."""
        return np.vstack([self.normals, self.limits[:, :6]]), np.append(self.offsets, self.limits[:, 6])


@dataclass(frozen=True, eq=False)
class Scale:
    """What a local space is measured in: the clearance a side and the characteristic length ρ, both in m."""

    clearance: float
    rho: float

    @property
    def units(self) -> Array:
        """Scaled units (6,): lengths in clearances (m), angles in clearance / ρ (rad)."""
        return np.array([self.clearance] * 3 + [self.clearance / self.rho] * 3)

    @property
    def reach(self) -> float:
        """How far off contacts are looked for, m."""
        return 3.0 * self.clearance

    @property
    def angle(self) -> float:
        """How far turned contacts are looked for, rad."""
        return self.reach / self.rho


@dataclass(frozen=True, eq=False)
class ContactCell:
    """Where contacts make up a local space.

    Attributes:
        limits: bounds of the cell in which exactly these contacts count; see `fmopt.contact.facet_bounds.cell`.
        reach: m; |dx|, |dy| and |dz| stay below it, where the linear picture is to be trusted.
    """

    limits: Sequence[BoundingFunction] = ()
    reach: float = np.inf
    angle: float = np.inf


_EVERYWHERE = ContactCell()


def local_space(
    contacts: Sequence[PrimitiveContact],
    moving: Polyhedron,
    fixed: Polyhedron,
    pose: Pose,
    scale: Scale,
    within: ContactCell = _EVERYWHERE,
) -> LocalSpace:
    """The contacts' half-spaces N·X ≥ D around a pose, X = 0, in scaled units with unit rows."""
    units = scale.units
    signs = np.concatenate([np.ones(len(contacts)), [-bound.sign for bound in within.limits]])
    listed = (*contacts, *(bound.contact for bound in within.limits))
    f, N = Surfaces.of(listed, moving, fixed).values_and_rows(pose)
    # In scaled units gradients are of like size; unit rows make offsets distances in clearances.
    rows = signs[:, None] * N * units
    size = np.linalg.norm(rows, axis=1)
    planes = np.column_stack([rows, -signs * f]) / size[:, None]
    k = len(contacts)
    box = np.array([within.reach] * 3 + [within.angle] * 3) / units
    # A limit in the plane of a contact is that contact's own doing.
    own = first_equal(planes)[k:] < k
    walls = [[*-side * axis, -size] for axis, size in zip(np.eye(6), box, strict=True) for side in (1.0, -1.0)]
    # Infinite sides make no half-space.
    walls = [wall for wall in walls if np.isfinite(wall[6])]
    cut = np.concatenate([planes[k:][~own], np.reshape(walls, (-1, 7))])
    return LocalSpace(pose, tuple(contacts), planes[:k, :6], planes[:k, 6], units, cut)


def faces(space: LocalSpace) -> PolytopeFaces:
    """All faces of the local contact space in scaled units: free space included, faces on a limit left out.

    Raises:
        InfeasibleError: the contacts violate each other, or every face lies on a limit.
    """
    k = len(space.contacts)
    found = enumerate_faces(*space.half_spaces)
    if not len(space.limits):
        return found
    # A face on a limit ends there only because the space was cut off: it is no contact state.
    open_ = ~found.active[:, k:].any(axis=1)
    if not open_.any():
        raise InfeasibleError(
            f"the local contact space at {space.pose.vector()} has no extent between its limits",
            advice="linearise at a pose that is not on the end of a face or an edge",
        )
    return PolytopeFaces(found.active[open_, :k], found.dimensions[open_], found.points[open_], found.lineality)
