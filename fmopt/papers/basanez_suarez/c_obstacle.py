"""Cc: all configurations at which any basic contact is possible, the union of the CU of all of them."""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from shapely import MultiPolygon, get_parts, union_all

from fmopt.papers.basanez_suarez.contact import CU, ContactType, basic_contacts, core_gap
from fmopt.papers.basanez_suarez.profile import Profile
from fmopt.papers.basanez_suarez.sources import Deviations
from fmopt.spatial.values import Array, Bits, Indices, Value

_COLUMNS = ("kind", "edge", "vertex", "spread", "radius")


@dataclass(frozen=True, eq=False)
class PossibleContacts(Value):
    """Cc of a grasped and a static object, eq. (13), (14) over all deviations: CU of basic contacts, type 1 first."""

    sets: tuple[CU, ...]

    @staticmethod
    def between(moving: Profile, static: Profile, deviations: Deviations) -> "PossibleContacts":
        """Cc of these objects, each in its own frame, under these deviations."""
        return PossibleContacts(basic_contacts(moving, static, deviations))

    def gap(self, poses: ArrayLike) -> Array:
        """Distance (k,) in m, within the plane of its φ, of poses (k, 3) from Cc; not positive inside; ∞ if no contact
        is possible at that orientation."""
        return np.asarray(self.gaps(poses).min(axis=1))

    def gaps(self, poses: ArrayLike) -> Array:
        """Distances (k, n) in m of poses (k, 3) from the CU of each of the n contacts, in the order of `sets`."""
        x = np.reshape(np.asarray(poses, dtype=np.float64), (-1, 3))
        return np.stack([cu.gap(x) for cu in self.sets], axis=1)

    def pair_gaps(self, poses: Array, contact: Indices) -> Array:
        """Distance (k,) in m of poses (k, 3), m and rad, from the CU of one contact each, whatever its range."""
        kinds, *columns = self._columns
        found = np.empty(len(poses))
        for kind in ContactType:
            mine = np.flatnonzero(kinds[contact] == kind)
            edge, vertex, spread, radius = (column[contact[mine]] for column in columns)
            found[mine] = core_gap(kind, edge, vertex, spread, poses[mine]) - radius
        return found

    @cached_property
    def _columns(self) -> tuple[NDArray[Any], ...]:
        """Kinds, edges, vertices, spreads and radii of the sets, a row each."""
        return tuple(np.array([getattr(cu, name) for cu in self.sets]) for name in _COLUMNS)

    def contains(self, poses: ArrayLike) -> Bits:
        """Whether any contact is possible at poses (k, 3) in m and rad, to 1e-9 of the objects' size."""
        return np.asarray(self.gap(poses) <= 1e-9 * self.size)

    @property
    def size(self) -> float:
        """Greatest reach plus greatest edge, m."""
        return max(cu.reach + math.hypot(*(cu.edge[1] - cu.edge[0])) + cu.radius for cu in self.sets)

    def possible(self, pose: ArrayLike) -> tuple[CU, ...]:
        """The basic contacts that are possible at a pose (3,)."""
        return tuple(cu for cu, yes in zip(self.sets, self.gaps(pose)[0] <= 1e-9 * self.size, strict=True) if yes)

    def polygons(self, phi: ArrayLike, tolerance: float) -> list[MultiPolygon]:
        """For each φ (k,), rad, a polygon that contains Cc there and is nowhere farther from it than `tolerance`, m.

        Raises:
            GeometryError: the tolerance is not positive.
        """
        found = []
        for at in np.atleast_1d(np.asarray(phi, dtype=np.float64)).tolist():
            sets = [cu.at(at).polygon(tolerance, "outside") for cu in self.sets if cu.range.contains(at)]
            found.append(MultiPolygon([part for part in get_parts(union_all(sets)) if part.area > 0.0]))
        return found
