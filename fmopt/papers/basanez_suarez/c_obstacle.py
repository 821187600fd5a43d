"""Cc: all configurations at which any basic contact is possible, the union of the CU of all of them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fmopt.papers.basanez_suarez.contact import CU, FULL, Kind, basic_contacts, core_gap
from fmopt.papers.basanez_suarez.profile import Profile
from fmopt.papers.basanez_suarez.sources import Deviations
from fmopt.spatial.values import Array, Value, frozen

if TYPE_CHECKING:
    from shapely import MultiPolygon


@dataclass(frozen=True, eq=False)
class Table(Value):
    """The CU of one kind, as arrays (n, …) over its n contacts, m and rad; see `CU`."""

    kind: Kind
    edge: Array
    vertex: Array
    low: Array
    width: Array
    spread: Array
    radius: Array

    @staticmethod
    def of(kind: Kind, sets: Sequence[CU]) -> Table:
        """The table of the sets of one kind, in their order."""
        mine = [cu for cu in sets if cu.kind is kind]
        edges, vertices = [cu.edge for cu in mine], [cu.vertex for cu in mine]
        numbers = [(cu.range.low, cu.range.high - cu.range.low, cu.spread, cu.radius) for cu in mine]
        columns = np.reshape(edges, (-1, 2, 2)), np.reshape(vertices, (-1, 2)), *np.reshape(numbers, (-1, 4)).T
        return Table(kind, *map(frozen, columns))

    def allowed(self, phi: Array) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Pairs (index of φ, index of contact) of the contacts that are possible at each φ (k,), rad."""
        # Ahead of the lower end, round the circle: ranges may run through ±π, and ends count with rounding.
        ahead = np.mod(phi[:, None] - self.low + 1e-12, FULL)
        one, other = np.nonzero(ahead <= self.width + 2e-12)
        return one, other

    def gaps(self, poses: Array, one: NDArray[np.intp], other: NDArray[np.intp]) -> Array:
        """Distance (k,), m, of numbered poses (n, 3), m and rad, from the CU of numbered contacts; see `CU.gap`."""
        core = core_gap(self.kind, self.edge[other], self.vertex[other], self.spread[other], poses[one])
        return np.asarray(core - self.radius[other])


@dataclass(frozen=True, eq=False)
class PossibleContacts(Value):
    """Cc of a grasped and a static object, eq. (13), (14) over all deviations: CU of basic contacts, type 1 first."""

    sets: tuple[CU, ...]
    tables: tuple[Table, Table]

    @staticmethod
    def between(moving: Profile, static: Profile, deviations: Deviations) -> PossibleContacts:
        """Cc of these objects, each in its own frame, under these deviations."""
        return PossibleContacts.of(basic_contacts(moving, static, deviations))

    @staticmethod
    def of(sets: Sequence[CU]) -> PossibleContacts:
        """The union of these sets."""
        # By kind, so that the rows of both tables are one list with an offset.
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
        """Distance (k,) in m of poses (k, 3), m and rad, from the CU of one contact each, whatever its range."""
        # Each pose has its own contact: the two tables are asked for theirs alone.
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
        """For each φ (k,), rad, a polygon that contains Cc there and is nowhere farther from it than `tolerance`, m.

        Raises:
            GeometryError: the tolerance is not positive.
        """
        from shapely import MultiPolygon, get_parts, union_all

        found = []
        for at in np.atleast_1d(np.asarray(phi, dtype=np.float64)).tolist():
            sets = [cu.at(at).polygon(tolerance, "outside") for cu in self.sets if cu.range.contains(at)]
            found.append(MultiPolygon([part for part in get_parts(union_all(sets)) if part.area > 0.0]))
        return found
