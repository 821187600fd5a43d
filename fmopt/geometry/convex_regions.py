"""Convex parts of a polygon in space, each by edges before which it lies."""

from collections.abc import Sequence

import numpy as np

from fmopt.spatial.se3 import lengths
from fmopt.spatial.values import Array

_NEAR = 1e-12  # m: what is nearer to a line than this is on it
_BESIDE = 1e-3  # of the shortest edge, how far from corners and edges points are taken


def convex_regions(ends: Array, inward: Array, offsets: Array) -> tuple[tuple[int, ...], ...]:
    """Convex parts of a polygon (n), each by the edges before which it lies.

    They are taken around a point beside each corner and each edge, with the nearest edges and the farthest ones first.
    A part that is before some edges has nothing of the outline inside it if each edge is behind one of them.

    Ends (2, n, 3), m, are of its edges, one after the other around it, with unit normals (n, 3) in its plane and
    offsets (n,), m, of their lines along these.
    """
    heights = inward @ np.swapaxes(ends, 1, 2) - offsets[:, None]  # (2, n, n), over the first of the last two
    behind = np.asarray((heights <= _NEAR).all(axis=0))
    beside = _BESIDE * float(lengths(ends[1] - ends[0]).min())
    starts = np.concatenate([ends.mean(axis=0) + beside * inward, ends[0] + beside * (inward + np.roll(inward, 1, 0))])
    found: dict[tuple[int, ...], None] = {}
    for start in starts:
        depths = inward @ start - offsets
        if not _inside(start, ends, inward):
            continue
        for order in (np.argsort(depths, kind="stable"), np.argsort(-depths, kind="stable")):
            chosen: list[int] = []
            for i in order.tolist():
                if depths[i] > 0.0 and not behind[chosen, i].any():
                    chosen.append(i)
            if (behind[chosen] | np.eye(len(offsets), dtype=np.bool_)[chosen]).any(axis=0).all():
                found.setdefault(tuple(sorted(chosen)))
    return tuple(found)


def _inside(point: Array, ends: Array, inward: Array) -> bool:
    """Whether a point is inside a polygon: the nearest point of its outline is on an edge that it is before."""
    way = ends[1] - ends[0]
    share = np.clip(np.vecdot(point - ends[0], way) / np.vecdot(way, way), 0.0, 1.0)
    off = point - (ends[0] + share[:, None] * way)
    nearest = lengths(off)
    # At a corner two edges are as near: the one that turns away from the point least tells.
    tied = np.flatnonzero(nearest <= nearest.min() + _NEAR)
    return bool(max(np.vecdot(off, inward)[tied].tolist(), key=abs) > 0.0)


def along_edge(i: int, chosen: Sequence[int], ends: Array, inward: Array, offsets: Array) -> bool:
    """Whether a convex part before some edges goes along the line of one of them no farther than the edge does.

    Ends (2, n, 3), normals (n, 3) and offsets (n,), m, are as for `convex_regions`.
    """
    way = ends[1, i] - ends[0, i]
    low, high = -np.inf, np.inf
    for j in chosen:
        rise, at = float(inward[j] @ way), float(inward[j] @ ends[0, i] - offsets[j])
        if j != i and abs(rise) > _NEAR:
            low, high = (max(low, -at / rise), high) if rise > 0.0 else (low, min(high, -at / rise))
    return low >= -_NEAR and high <= 1.0 + _NEAR
