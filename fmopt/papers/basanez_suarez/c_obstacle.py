"""Cc: all configurations at which any basic contact is possible, the union of the CU of all of them.

Polygons that contain Cc at many orientations, from convex pieces that cover the sets CUl.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fmopt.errors import GeometryError
from fmopt.papers.basanez_suarez.contact import CU, FULL, Kind, basic_contacts, core_gap
from fmopt.papers.basanez_suarez.profile import Profile
from fmopt.papers.basanez_suarez.sources import Deviations
from fmopt.spatial.values import Array, Value, frozen

if TYPE_CHECKING:
    from shapely import MultiPolygon


_BATCH = 20_000  # convex pieces at a time


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
        """The table of the sets of one kind.

        Args:
            kind: of basic contacts; sets of the other kind are left out.
            sets: whose order the rows have.
        """
        mine = [cu for cu in sets if cu.kind is kind]
        return Table(
            kind,
            frozen(np.reshape([cu.edge for cu in mine], (-1, 2, 2))),
            frozen(np.reshape([cu.vertex for cu in mine], (-1, 2))),
            frozen([cu.range.low for cu in mine]),
            frozen([cu.range.high - cu.range.low for cu in mine]),
            frozen([cu.spread for cu in mine]),
            frozen([cu.radius for cu in mine]),
        )

    def allowed(self, phi: Array) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Pairs (index of φ, index of contact) of the contacts that are possible at each φ (k,), rad."""
        # Ahead of the lower end, round the circle: ranges may run through ±π, and ends count with rounding.
        ahead = np.mod(phi[:, None] - self.low + 1e-12, FULL)
        one, other = np.nonzero(ahead <= self.width + 2e-12)
        return one, other

    def gaps(self, poses: Array, one: NDArray[np.intp], other: NDArray[np.intp]) -> Array:
        """Distance (m) of poses from the CU of contacts, pair by pair; see `CU.gap`.

        Args:
            poses: (n, 3), x and y in m, φ in rad.
            one: (k,), indices of poses.
            other: (k,), rows of the table.
        """
        core = core_gap(self.kind, self.edge[other], self.vertex[other], self.spread[other], poses[one])
        return np.asarray(core - self.radius[other])


@dataclass(frozen=True, eq=False)
class PossibleContacts(Value):
    """Cc of a grasped and a static object, eq. (13), (14) over all basic contacts and all deviations.

    Args:
        sets: CU of each basic contact, those of type 1 first.
    """

    sets: tuple[CU, ...]
    tables: tuple[Table, Table]

    @staticmethod
    def between(moving: Profile, static: Profile, deviations: Deviations) -> PossibleContacts:
        """Cc of these objects under these deviations.

        Args:
            moving, static: profiles, each in its own frame.
        """
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
        """Distance (k,) in m of poses from the CU of one contact each, whatever its range.

        Args:
            poses: (k, 3), x and y in m, φ in rad.
            contact: (k,), indices in `sets`.
        """
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
        """For each φ a polygon (m) that contains Cc there and is nowhere farther from it than `tolerance`.

        Each CUl is covered by convex pieces, one for each part of the turn ±ε_φ that is short enough.

        Args:
            phi: (k,), rad.
            tolerance: m.

        Raises:
            GeometryError: the tolerance is not positive.
        """
        if not tolerance > 0.0:
            raise GeometryError(f"polygons of Cc to a tolerance of {tolerance} m", "give a positive one")
        return cover(self.tables, np.atleast_1d(np.asarray(phi, dtype=np.float64)), tolerance)


def cover(tables: Sequence[Table], phi: Array, tolerance: float) -> list[MultiPolygon]:
    """For each φ the union (m) of the pieces of all contacts possible; see `PossibleContacts.polygons`.

    Args:
        phi: (k,), rad.
        tolerance: m.
    """
    from shapely import MultiPolygon, convex_hull, get_parts, linestrings, union_all

    hulls: list[list[Any]] = [[] for _ in phi]
    for table in tables:
        one, other = table.allowed(phi)
        # Edges that swing through their foot are cut there, as the hull of a piece would else be too wide.
        contact, centres, swung = _edges(table, tolerance)
        for i in range(0, len(one), _BATCH):
            batch = slice(i, i + _BATCH)
            pair, row = np.nonzero(other[batch, None] == contact)
            index, corners = _corners(
                phi[one[batch][pair]],
                centres[row],
                swung[row],
                table.spread[contact[row]],
                table.radius[contact[row]],
                tolerance,
            )
            for k, hull in zip(one[batch][pair][index], convex_hull(linestrings(corners)), strict=True):
                hulls[k].append(hull)
    # In turn around their middle: unions of neighbours are simple, and take a fraction of the time.
    unions = [union_all(_in_turn(group)) for group in hulls]
    return [MultiPolygon([part for part in get_parts(union) if part.area > 0.0]) for union in unions]


def _in_turn(hulls: list[Any]) -> NDArray[np.object_]:
    """Hulls in the order in which they surround their middle: neighbours are united first, a third faster."""
    from shapely import centroid, get_coordinates

    group = np.array(hulls, dtype=object)
    to = get_coordinates(centroid(group))
    to = to - to.mean(axis=0) if len(to) else to
    return np.asarray(group[np.argsort(np.arctan2(to[:, 1], to[:, 0]), kind="stable")])


def _edges(table: Table, tolerance: float) -> tuple[NDArray[np.intp], Array, Array]:
    """Contacts as pairs of points c + R(φ) v, the ends of an edge that moves along: index, c and v (m, 2, 2).

    An edge of the grasped object is cut at the foot of the perpendicular from the reference point, as the hull of a
    turning edge is close to what it sweeps only when its distance from there grows along it. With the foot at t₁ and t₂
    from the ends, the hull is farther out by 2 ε_φ t₁ t₂ / (t₁ + t₂) to first order; a quarter of the tolerance lets
    an edge stay whole.
    """
    n = len(table.low)
    if table.kind is Kind.TYPE_1:
        return np.arange(n), table.edge, -np.repeat(table.vertex[:, None], 2, axis=1)
    start, e = table.edge[:, 0], table.edge[:, 1] - table.edge[:, 0]
    along = -np.sum(start * e, axis=1) / np.sum(e * e, axis=1)
    length = np.hypot(e[:, 0], e[:, 1])
    # Only where the bulge over the foot is worth it.
    cut = (along > 0.0) & (along < 1.0) & (2.0 * table.spread * along * (1.0 - along) * length > 0.25 * tolerance)
    foot = start + along[:, None] * e
    first = np.stack([start, np.where(cut[:, None], foot, table.edge[:, 1])], axis=1)
    second = np.stack([foot, table.edge[:, 1]], axis=1)[cut]
    contact = np.concatenate([np.arange(n), np.flatnonzero(cut)])
    return contact, np.repeat(table.vertex[contact, None], 2, axis=1), -np.concatenate([first, second])


def _corners(
    phi: Array, centres: Array, swung: Array, spread: Array, radius: Array, tolerance: float
) -> tuple[NDArray[np.intp], Array]:
    """Points (m, k, 2) whose hulls cover edges c + R(φ + δ) v, |δ| ≤ spread, widened by the disc; the edge of each.

    The arc of each end is within a triangle, the disc within a polygon. Half of the tolerance is for the disc. A part
    of the turn by ±s leaves the hull farther out than the sweep by at most 2 s² times the reach, for which there is a
    quarter.
    """
    n_parts = _parts(float(spread.max(initial=0.0)), float(np.hypot(*swung.T).max(initial=0.0)), tolerance)
    half = spread / n_parts
    index = np.repeat(np.arange(len(phi)), n_parts)
    middle = phi[:, None] + half[:, None] * (2.0 * np.arange(n_parts) + 1.0 - n_parts)
    angle = middle.ravel()[:, None] + half[index, None] * np.array([-1.0, 0.0, 1.0])
    # Tips of the arc, and where tangents at them meet: the hull of these holds the arc.
    scale = np.stack([np.ones(len(index)), 1.0 / np.cos(half[index]), np.ones(len(index))], axis=1)
    c, s = scale * np.cos(angle), scale * np.sin(angle)
    v = swung[index]
    x = c[:, :, None] * v[:, None, :, 0] - s[:, :, None] * v[:, None, :, 1] + centres[index][:, None, :, 0]
    y = s[:, :, None] * v[:, None, :, 0] + c[:, :, None] * v[:, None, :, 1] + centres[index][:, None, :, 1]
    tips = np.stack([x, y], axis=-1).reshape(len(index), 1, 6, 2)
    disc = _disc(radius[index], tolerance)
    return index, (tips + disc[:, :, None, :]).reshape(len(index), -1, 2)


def _parts(spread: float, reach: float, tolerance: float) -> int:
    # The tangents' meeting point is farther out by h (1 / cos − 1), about h x²/2: a small part of the tolerance.
    longest = min(0.5, math.sqrt(0.125 * tolerance / reach)) if reach > 0.0 else 0.5
    return max(math.ceil(min(spread, math.pi) / longest), 1)


def _disc(radius: Array, tolerance: float) -> Array:
    """Corners (m, k, 2) of regular polygons that contain discs, at most half the tolerance farther out."""
    # Half of the tolerance is left for the disc; its polygon has the true circle inside.
    outer = radius + 0.5 * tolerance
    corners = max(math.ceil(math.pi / math.acos(float(np.max(radius / outer, initial=0.0)))), 4)
    theta = 2.0 * math.pi * np.arange(corners) / corners
    return np.asarray(outer[:, None, None] * np.stack([np.cos(theta), np.sin(theta)], axis=-1))
