"""The CU of many contacts as arrays, for questions about all of them at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fmopt.papers.basanez_suarez.contact import CU, FULL, Kind, core_gap
from fmopt.spatial.values import Array, Value, frozen


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
