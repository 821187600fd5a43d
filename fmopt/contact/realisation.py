"""Poses in which given contacts touch, inside their bounds, and all others are apart: on the true C-surfaces.

They are searched for by Levenberg–Marquardt. What is wanted with equality, f = 0 of the state's own contacts, and what
is wanted with room to spare, the bounds of those, the other contacts' distances and the limits of the local space, is
one vector of shortages r. A contact that is not to touch is out of the way at a distance, or that far outside its
bounds, whichever is nearer. Where the length of r cannot fall any further above zero, Jᵀr = 0: the shortages themselves
are the multipliers that say which demands contradict each other.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fmopt.contact.c_surface import Surfaces
from fmopt.contact.descent import Functions, descended, heights, projected
from fmopt.contact.facet_bounds import BoundTable
from fmopt.contact.primitive import matrices
from fmopt.contact.state_graph import LocalSpace
from fmopt.geometry.polyhedron import Polyhedron
from fmopt.spatial.se3 import Pose, turns
from fmopt.spatial.values import Array, Bits, Indices, Value


@dataclass(frozen=True, eq=False)
class Poses(Value):
    """Poses: positions p (n, 3) in m and rotations R (n, 3, 3)."""

    p: Array
    R: Array

    @staticmethod
    def around(pose: Pose, X: Array) -> Poses:
        """The poses at local coordinates X (n, 6) around one: displacement, m, and rotation vector, rad, axes of B."""
        return Poses(pose.p + X[:, :3], turns(X[:, 3:]) @ pose.R)

    @staticmethod
    def of(matrices: Array) -> Poses:
        """The poses of matrices (n, 3, 4), rotations with positions beside them."""
        return Poses(matrices[:, :, 3], matrices[:, :, :3])

    @property
    def matrices(self) -> Array:
        """Rotations with positions beside them (n, 3, 4), m."""
        return matrices(self.p, self.R)

    def local(self, pose: Pose) -> Array:
        """Local coordinates X (n, 6) of these poses around one, for turns below a right angle."""
        T = self.R @ pose.R.T
        # The antisymmetric part of a rotation is sin(angle) times its axis: no case near 180° has to be told apart
        # below 90°.
        s = 0.5 * np.stack([T[:, 2, 1] - T[:, 1, 2], T[:, 0, 2] - T[:, 2, 0], T[:, 1, 0] - T[:, 0, 1]], axis=-1)
        sine = np.minimum(np.linalg.norm(s, axis=-1), 1.0)
        # The series is 1 to rounding there, and the quotient would be of zeros.
        ratio = np.where(sine > 1e-6, np.arcsin(sine) / np.maximum(sine, 1e-6), 1.0)
        return np.concatenate([self.p - pose.p, ratio[:, None] * s], axis=-1)

    def kept(self, which: Bits | Indices) -> Poses:
        """Some of the poses."""
        return Poses(self.p[which], self.R[which])

    def pose(self, i: int) -> Pose:
        """One of them."""
        return Pose(self.p[i], self.R[i])

    def each(self) -> tuple[Pose, ...]:
        """All of them."""
        return tuple(map(Pose, self.p, self.R))


@dataclass(frozen=True, eq=False)
class Measures(Value):
    """What n states have at n poses, in clearances."""

    own: Array  # (n, k), f of the contacts that are to touch, 0 for the others
    others: Array  # (n, k), of the other contacts the distance, or how far outside their bounds they are; inf for own
    depths: Array  # (n, k, clauses), how far inside each clause of its bounds an own contact is; inf for others
    binding: Indices  # (n, k, clauses), which bound of the table that is
    limits: Array  # (n, l), how far inside the limits of the local space

    @cached_property
    def residual(self) -> Array:
        """Largest |f| of the contacts that are to touch (n,)."""
        return np.asarray(np.max(np.abs(self.own), axis=1, initial=0.0))

    @cached_property
    def clearance(self) -> Array:
        """Least distance of others (n,)."""
        return np.asarray(self.others.min(axis=1, initial=np.inf))

    @cached_property
    def inside(self) -> Array:
        """Least depth of own (n,)."""
        return np.asarray(self.depths.min(axis=(1, 2), initial=np.inf))

    @cached_property
    def slack(self) -> Array:
        """Least distance of others and depth of own (n,)."""
        return np.asarray(np.minimum(self.clearance, self.inside))


@dataclass(frozen=True, eq=False)
class Neighbourhood(Value):
    """A local space with the true functions of its contacts and of their bounds."""

    space: LocalSpace
    table: BoundTable
    parts: tuple[Polyhedron, Polyhedron]

    @staticmethod
    def of(space: LocalSpace, moving: Polyhedron, fixed: Polyhedron) -> Neighbourhood:
        """The functions of a local space's contacts between these parts."""
        return Neighbourhood(space, BoundTable.of(space.contacts, moving, fixed, space.pose), (moving, fixed))

    def measured(self, on: Bits, poses: Poses) -> Measures:
        """What states have at poses, one each, by which contacts each holds (n, k)."""
        unit, values = self.space.scale[0], heights(self.functions, poses.matrices)
        f = values[:, self.functions.own]
        depth, which = self.table.depths(values[:, self.functions.bounds[0]])
        # Apart is who is clear of a contact's surface, or outside of its bounds by as much: the larger of the two
        # counts.
        apart = np.where(on | self._ended(on, which), np.inf, np.maximum(f, -depth.min(axis=2, initial=np.inf)))
        # Infinite where nothing is asked, so that least values over all skip it.
        deep = np.where(on[..., None], depth, np.inf) / unit
        return Measures(np.where(on, f, 0.0) / unit, apart / unit, deep, which, self.inside(poses))

    def inside(self, poses: Poses) -> Array:
        """How far (n, l) poses are inside the limits of the local space, in scaled units."""
        x = poses.local(self.space.pose) / self.space.scale
        return np.asarray(x @ self.space.limits[:, :6].T - self.space.limits[:, 6])

    @cached_property
    def functions(self) -> Functions:
        """What searches evaluate, as arrays."""
        space, number = self.space, {contact: i for i, contact in enumerate(self.space.contacts)}
        # A bound that is a contact of the space, too, has one number for both.
        ends = [number.setdefault(bound.contact, len(number)) for bound in self.table.listed]
        # Those of contacts and of bounds, each once.
        joint = Surfaces.of(tuple(number), *self.parts)
        surfaces = joint.order[np.array(ends, dtype=np.intp)]
        bounds = surfaces, self.table.signs, np.array(self.table.places), np.array(self._ending)
        own, limits = np.array(joint.order[: len(space.contacts)]), np.array(space.limits.T, order="C")
        zero = matrices(space.pose.p, space.pose.R)
        return Functions(joint.tables, own, bounds, limits, np.array(space.scale), zero)

    def _ended(self, on: Bits, which: Indices) -> Bits:
        """Which contacts (n, k) end where one of `on` begins: no pose violates the one without violating the other."""
        # One column more for a bound that is no contact of the space, and for none at all.
        held = np.concatenate([on, np.zeros((len(on), 1), dtype=bool)], axis=1)[:, self._ending]
        found = held[np.arange(len(on))[:, None, None], which]
        return np.asarray(found.any(axis=2))

    @cached_property
    def _ending(self) -> list[int]:
        """Which contact of the space begins at each bound, −1 for none, and where there is no bound."""
        names = {contact.id: i for i, contact in enumerate(self.space.contacts)}
        # Two more entries, for what `BoundTable.places` has where there is no bound.
        return [*(names.get(b.contact.id, -1) if b.sign > 0 else -1 for b in self.table.listed), -1, -1]


@dataclass(frozen=True, eq=False)
class Met(Value):
    """Where n searches ended: the poses, how much is short there in all (scaled units), and whether that is final.

    It is where the shortage cannot fall any further, or falls too slowly ever to be gone.
    """

    poses: Poses
    short: Array
    settled: Bits


def meet(near: Neighbourhood, on: Bits, start: Poses, room: float) -> Met:
    """Searches from each start for a pose where contacts `on` (n, k) touch and all else is at least `room` away."""
    found, short, settled = descended(near.functions, on, start.matrices, room)
    return Met(project(near, on, Poses.of(found), 6), short, settled)


def project(near: Neighbourhood, on: Bits, poses: Poses, rank: int | Indices) -> Poses:
    """The nearest poses where the contacts `on` (n, k) touch, by Gauss–Newton with shortest scaled steps.

    A step uses `rank` singular directions, one number for all or one a pose: the rank of a state's linear picture stays
    near its facet; 6 also uses those that only curvature provides.
    """
    return Poses.of(projected(near.functions, on, poses.matrices, np.full(len(on), rank)))
