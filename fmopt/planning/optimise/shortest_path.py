"""Shortest paths along arcs whose lengths may be negative, and the cycles that stand in their way."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fmopt.spatial.values import Array

_ROUNDS = 8  # of passing distances on, after which cycles are looked for

Indices = NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class Ends:
    """Arcs in order of one of their ends.

    Args:
        tails: the other end (e,) of each arc.
        order: the arcs (e,).
        ends: the places (h,) that are ends.
        begins: where each begins (h,) in the order.
        groups: for each arc in order (e,) which of the ends it has.
    """

    tails: Indices
    order: Indices
    ends: Indices
    begins: Indices
    groups: Indices
    count: int

    @staticmethod
    def of(tails: Indices, heads: Indices, count: int) -> Ends:
        """Arcs (e,) from tails to heads, in order of these.

        Args:
            tails, heads: (e,), places by number.
        """
        order = np.argsort(heads, kind="stable")
        return Ends(tails, order, *np.unique(heads[order], return_index=True, return_inverse=True), count)

    def distances(self, lengths: Array, source: int) -> tuple[Array, Indices]:
        """How far all places are from a source (n,), and by which arc (n,) or −1.

        Where a cycle weighs less than nothing, these arcs have a cycle as well, and distances are what they may be.
        There has to be an arc.

        Args:
            lengths: (e,), of any sign.
        """
        tails, ordered = self.tails[self.order], lengths[self.order]
        far, arcs = np.full(self.count, np.inf), np.full(self.count, -1, dtype=np.intp)
        far[source] = 0.0
        for done in range(1, self.count + 1):  # after as many rounds only a cycle still brings places nearer
            through = far[tails] + ordered
            least = np.minimum.reduceat(through, self.begins)
            nearer = least < far[self.ends]
            if not nearer.any():
                break
            far[self.ends[nearer]] = least[nearer]
            kept = nearer[self.groups] & (through == least[self.groups])
            # Of several arcs that are as near the last one stays.
            arcs[self.ends[self.groups[kept]]] = self.order[kept]
            if done % _ROUNDS == 0 and self.ring(arcs) is not None:
                break
        return far, arcs

    def ring(self, arcs: Indices) -> int | None:
        """A place on a cycle of the arcs by which places are nearest, None without."""
        back = np.append(np.where(arcs >= 0, self.tails[arcs], self.count), self.count)
        # Each round doubles the steps: after as many as there are places, only those that lead onto a cycle go on, and
        # `back` points into the cycle itself.
        for _ in range(self.count.bit_length()):
            back = back[back]
        rings = back[back < self.count]
        return int(rings[0]) if len(rings) else None


@dataclass(frozen=True, eq=False)
class Path:
    """Arcs in order with their length: a path, or a cycle that weighs less than nothing."""

    arcs: Indices
    length: float
    cycle: bool


def shortest_path(inward: Ends, lengths: Array, start: int, goal: int) -> Path | None:
    """The shortest path for lengths (e,) of any sign, or a cycle in its way; None when there is none.

    Args:
        inward: the arcs in order of the places that they lead to.
    """
    far, last = inward.distances(lengths, start)
    ring = inward.ring(last)
    if ring is None and not np.isfinite(far[goal]):
        return None
    at, until = (goal, start) if ring is None else (ring, ring)
    arcs: list[int] = []
    while not arcs or at != until:  # a cycle ends where it began
        arcs.append(int(last[at]))
        at = int(inward.tails[arcs[-1]])
    found = np.array(arcs[::-1])
    return Path(found, float(lengths[found].sum()), ring is not None)
