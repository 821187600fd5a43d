"""Winding numbers of exact curves: signed crossings of a ray with chords, corrected by caps between chord and arc."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from fmopt.plane.conic import ConicArc
from fmopt.plane.curve import Arc, Curve, Segment
from fmopt.values import Array

_END = 1e-9
_BLOCK = 2_000_000


def simple(curve: Curve) -> list[Curve]:
    """The curve in pieces along which x and y both run one way, so that none turns by more than 90°."""
    match curve:
        case Segment():
            return [curve]
        case Arc():
            quarter = 0.5 * math.pi
            low, high = sorted((curve.start, curve.start + curve.sweep))
            turns = range(math.ceil(low / quarter), math.floor(high / quarter) + 1)
            stops = [(k * quarter - curve.start) / curve.sweep for k in turns] if curve.sweep != 0.0 else []
        case ConicArc():
            stops = [*curve.extremum((1.0, 0.0)), *curve.extremum((0.0, 1.0))]
    cuts = [0.0, *sorted(t for t in stops if _END < t < 1.0 - _END), 1.0]
    return [curve] if len(cuts) == 2 else [curve.part(a, b) for a, b in pairwise(cuts) if b > a]


@dataclass(frozen=True, eq=False)
class Table:
    """Simple curves as rational quadratics, one row each: corners (n, 2) in m, weights (n,), no turn for segments."""

    first: Array
    shoulder: Array
    last: Array
    weight: Array
    curved: NDArray[np.bool_]

    @staticmethod
    def of(curves: Sequence[Curve], first: Array | None = None, last: Array | None = None) -> Table:
        """The table of `curves`, with end points (n, 2) that neighbours share when given."""
        rows = [curve.quadratics()[0][2] if not isinstance(curve, Segment) else None for curve in curves]
        if first is None or last is None:
            first = np.array([curve.first for curve in curves]).reshape(-1, 2)
            last = np.array([curve.last for curve in curves]).reshape(-1, 2)
        shoulder = np.array(
            [0.5 * (a + b) if row is None else row.shoulder for row, a, b in zip(rows, first, last, strict=True)]
        ).reshape(-1, 2)
        weight = np.array([1.0 if row is None else row.weight for row in rows])
        return Table(first, shoulder, last, weight, np.array([row is not None for row in rows], dtype=bool))

    def turned(self) -> Table:
        """The table with x and y exchanged, so that a ray along +y becomes one along +x (and turns change sign)."""
        swap = slice(None, None, -1)
        return Table(self.first[:, swap], self.shoulder[:, swap], self.last[:, swap], self.weight, self.curved)

    def crossings(self, points: Array, rows: NDArray[np.intp]) -> NDArray[np.intp]:
        """Signed crossings of the ray from each point along +x with the curve in the row beside it; shape (k,).

        A point on a line counts as a little to the right of it and above it.
        """
        a, b = self.first[rows], self.last[rows]
        side = _turn(a, b, points)
        drop = b[:, 1] - a[:, 1]
        up = (a[:, 1] <= points[:, 1]) & (points[:, 1] < b[:, 1]) & (side > 0.0)
        down = (b[:, 1] <= points[:, 1]) & (points[:, 1] < a[:, 1]) & (side < 0.0)
        count = up.astype(np.intp) - down
        bent = np.flatnonzero(self.curved[rows])
        if bent.size:
            tied = np.where(drop[bent] != 0.0, -drop[bent], b[bent, 0] - a[bent, 0])
            beside = np.where(side[bent] != 0.0, side[bent], tied)
            count[bent] += self._caps(points[bent], rows[bent], side[bent], beside)
        return count

    def _caps(self, points: Array, rows: NDArray[np.intp], side: Array, beside: Array) -> NDArray[np.intp]:
        """1 where the point lies in the cap of a left-turning row, −1 in that of a right-turning one, else 0."""
        p0, p1, p2 = self.first[rows], self.shoulder[rows], self.last[rows]
        turn = np.sign(_turn(p0, p1, p2))
        t0, t2 = turn * _turn(p1, p2, points), turn * _turn(p0, p1, points)
        within = 4.0 * self.weight[rows] ** 2 * t0 * t2 >= side**2
        inside = (t0 >= 0.0) & (turn * beside < 0.0) & (t2 >= 0.0) & within
        return np.where(inside, turn, 0.0).astype(np.intp)

    def winding(self, points: Array) -> NDArray[np.intp]:
        """Winding number of all rows together round each of `points` (n, 2), shape (n,)."""
        n, m = len(points), len(self.weight)
        step = max(1, _BLOCK // max(m, 1))
        rows = np.arange(m)
        total = np.zeros(n, dtype=np.intp)
        for k in range(0, n if m else 0, step):
            block = points[k : k + step]
            crossed = self.crossings(np.repeat(block, m, axis=0), np.tile(rows, len(block)))
            total[k : k + step] = crossed.reshape(len(block), m).sum(axis=1)
        return total


def _turn(a: Array, b: Array, c: Array) -> Array:
    """(b − a) × (c − a), positive when c lies to the left of a→b."""
    return np.asarray((b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0]))
