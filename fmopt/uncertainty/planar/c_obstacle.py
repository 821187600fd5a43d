"""Cc: all configurations at which any basic contact is possible, the union of the CU of all of them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fmopt.errors import GeometryError
from fmopt.uncertainty.planar.contact import CU, Kind, basic_contacts
from fmopt.uncertainty.planar.cover import cover
from fmopt.uncertainty.planar.profile import Profile
from fmopt.uncertainty.planar.table import Table
from fmopt.uncertainty.sources import Deviations
from fmopt.values import Array, Value

if TYPE_CHECKING:
    from shapely import MultiPolygon


@dataclass(frozen=True, eq=False)
class PossibleContacts(Value):
    """Cc of a grasped and a static object, eq. (13), (14) over all basic contacts and all deviations.

    Args:
        sets: CU of each basic contact, those of type 1 first.
        tables: the same as arrays, for each type.
    """

    sets: tuple[CU, ...]
    tables: tuple[Table, Table]

    @staticmethod
    def between(moving: Profile, static: Profile, deviations: Deviations) -> PossibleContacts:
        """Cc of these objects under these deviations."""
        return PossibleContacts.of(basic_contacts(moving, static, deviations))

    @staticmethod
    def of(sets: Sequence[CU]) -> PossibleContacts:
        """The union of these sets."""
        ordered = tuple(sorted(sets, key=lambda cu: cu.kind))
        return PossibleContacts(ordered, (Table.of(Kind.TYPE_1, ordered), Table.of(Kind.TYPE_2, ordered)))

    def gap(self, poses: ArrayLike) -> Array:
        """Distance (k,) in m, within the plane of its φ, of poses (k, 3) from Cc; not positive inside; ∞ if no contact
        is possible at that orientation."""
        x = np.reshape(np.asarray(poses, dtype=np.float64), (-1, 3))
        least = np.full(len(x), np.inf)
        for table in self.tables:
            one, other = table.allowed(x[:, 2])
            np.minimum.at(least, one, table.gaps(x, one, other))
        return least

    def gaps(self, poses: ArrayLike) -> Array:
        """Distances (k, n) in m of poses (k, 3) from the CU of each of the n contacts, in the order of `sets`."""
        x = np.reshape(np.asarray(poses, dtype=np.float64), (-1, 3))
        found = []
        for table in self.tables:
            full = np.full((len(x), len(table.low)), np.inf)
            one, other = table.allowed(x[:, 2])
            full[one, other] = table.gaps(x, one, other)
            found.append(full)
        return np.hstack(found)

    def pair_gaps(self, poses: Array, contact: NDArray[np.intp]) -> Array:
        """Distance (k,) in m of poses (k, 3) from the CU of one contact each, its index (k,), whatever its range."""
        one = np.arange(len(poses))
        first = len(self.tables[0].low)
        found = np.empty(len(poses))
        for table, mine, offset in ((self.tables[0], contact < first, 0), (self.tables[1], contact >= first, first)):
            found[mine] = table.gaps(poses, one[mine], contact[mine] - offset)
        return found

    def contains(self, poses: ArrayLike) -> NDArray[np.bool_]:
        """Whether any contact is possible at poses (k, 3) in m and rad, to 1e-9 of the objects' size."""
        return np.asarray(self.gap(poses) <= 1e-9 * self.size)

    @property
    def size(self) -> float:
        """Greatest reach plus greatest edge, m."""
        return max(cu.reach + math.hypot(*(cu.edge[1] - cu.edge[0])) + cu.radius for cu in self.sets)

    def possible(self, pose: ArrayLike) -> tuple[CU, ...]:
        """The basic contacts that are possible at a pose (3,)."""
        inside = self.gaps(pose)[0] <= 1e-9 * self.size
        return tuple(cu for cu, yes in zip(self.sets, inside, strict=True) if yes)

    def polygons(self, phi: ArrayLike, tolerance: float) -> list[MultiPolygon]:
        """For each φ (k,) in rad a polygon (m) that contains Cc there and is nowhere farther from it than `tolerance`.

        Each CUl is covered by convex pieces, one for each part of the turn ±ε_φ that is short enough.

        Raises:
            GeometryError: the tolerance is not positive.
        """
        if not tolerance > 0.0:
            raise GeometryError(f"polygons of Cc to a tolerance of {tolerance} m", "give a positive one")
        return cover(self.tables, np.atleast_1d(np.asarray(phi, dtype=np.float64)), tolerance)
