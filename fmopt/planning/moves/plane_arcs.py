"""Kernels: planes through edges, between the two faces of each, that keep a moving piece at most margin."""

import math
from typing import NamedTuple

import numpy as np

from fmopt.planning.moves.swept_piece import Moving, SweptReach, lower_bound, nominal, reached_by
from fmopt.runtime.compiled import compiled, part
from fmopt.spatial.kernels import Vector, dot, row, size
from fmopt.spatial.values import Array, Bits, Indices

SHARES = 9  # planes tried through an edge in each pass
_PASSES = 3  # after the first each looks between the neighbours of the best plane, four times as finely
_REFINED = 6  # edges of a pair that are looked at more closely


class Edges(NamedTuple):
    """The planes through all edges of the fixed pieces of some pairs (m)."""

    arcs: Array  # normals (k, 2, 3) of the two faces of each edge, pair by pair
    cuts: Indices  # where the edges of each pair begin, and the last ones end (m + 1,)
    normals: Array  # all different normals (q, 3) of the first pass
    which: Indices  # which of them each plane (k, shares) has
    offsets: Array  # how far out each plane (k, shares) is, m
    corners: Array  # vertices (m, v, 3) of the fixed pieces, some repeated where others have more, m


@part
def _offset(normal: Vector, corners: Array, m: int) -> tuple[float, Vector]:
    """The largest n·v over the vertices of a fixed piece, and that vertex."""
    found, at, (x, y, z) = -np.inf, 0, normal
    for v in range(corners.shape[1]):
        height = x * corners[m, v, 0] + y * corners[m, v, 1] + z * corners[m, v, 2]
        if height > found:
            found, at = height, v
    return found, (corners[m, at, 0], corners[m, at, 1], corners[m, at, 2])


@part
def _between(arcs: Array, k: int, low: float, high: float, share: int) -> Vector:
    """The unit normal that parts arc k at a share between two."""
    w = low + (high - low) * (share / (SHARES - 1))
    x = (1.0 - w) * arcs[k, 0, 0] + w * arcs[k, 1, 0]
    y = (1.0 - w) * arcs[k, 0, 1] + w * arcs[k, 1, 1]
    z = (1.0 - w) * arcs[k, 0, 2] + w * arcs[k, 1, 2]
    far = size((x, y, z))
    return x / far, y / far, z / far


class Kept(NamedTuple):
    """The edges of each pair (n, m, e) looked at more closely: best planes' normals (n, m, 3) and margins (n, m), m."""

    edge: Indices
    share: Indices
    low: Array
    high: Array
    normal: Array
    margin: Array


@part
def _hopeful(edges: Edges, reached: SweptReach, heights: Array) -> Bits:
    """Which of all normals may have the largest margin of a pair in some piece of motion."""
    found, rooms = np.zeros(len(edges.normals), dtype=np.bool_), np.empty(len(edges.normals))
    which, offsets, cuts = edges.which, edges.offsets, edges.cuts
    for n in range(len(reached.turn)):
        for q in range(len(rooms)):
            rooms[q] = nominal(row(edges.normals, q), reached.vertices, n)[0]
        for m in range(len(edges.corners)):
            widest, room = 0, -np.inf
            for k in range(cuts[m], cuts[m + 1]):
                for s in range(SHARES):
                    if rooms[which[k, s]] - offsets[k, s] > room:
                        widest, room = which[k, s], rooms[which[k, s]] - offsets[k, s]
            # The margin of the roomiest plane, as rooms[widest] − room is how far out that is: less room is no use.
            enough = lower_bound(row(edges.normals, widest), reached, n, heights) - (rooms[widest] - room)
            for k in range(cuts[m], cuts[m + 1]):
                for s in range(SHARES):
                    found[which[k, s]] |= rooms[which[k, s]] - offsets[k, s] >= enough
    return found


@part
def _roomiest(room: Array, first: int, last: int, found: Indices) -> None:
    """The edges with the largest rooms, the first ones of equal ones first."""
    left = np.ones(len(room), dtype=np.bool_)
    for j in range(len(found)):
        found[j] = -1
        # There is always one left: a convex piece has six edges at least.
        for k in range(first, last):
            if left[k] and (found[j] < 0 or room[k] > room[found[j]]):
                found[j] = k
        left[found[j]] = False


@part
def _first(edges: Edges, reached: SweptReach, heights: Array) -> Kept:
    """The roomiest edges of each pair, by the planes that all edges share."""
    hopeful, count, pairs = _hopeful(edges, reached, heights), len(reached.turn), len(edges.corners)
    shape = (count, pairs, _REFINED)
    kept = Kept(
        np.empty(shape, dtype=np.intp),
        np.empty(shape, dtype=np.intp),
        np.zeros(shape),
        np.ones(shape),
        np.empty((count, pairs, 3)),
        np.empty((count, pairs)),
    )
    lower, room = np.empty(len(hopeful)), np.empty(len(edges.arcs))
    at = np.empty(len(edges.arcs), dtype=np.intp)
    for n in range(count):
        for q in range(len(lower)):
            lower[q] = lower_bound(row(edges.normals, q), reached, n, heights) if hopeful[q] else -np.inf
        for k in range(len(room)):
            at[k], room[k] = 0, -np.inf
            for s in range(SHARES):
                margin = lower[edges.which[k, s]] - edges.offsets[k, s]
                if margin > room[k]:
                    at[k], room[k] = s, margin
        for m in range(pairs):
            _roomiest(room, edges.cuts[m], edges.cuts[m + 1], kept.edge[n, m])
            for j in range(_REFINED):
                kept.share[n, m, j] = at[kept.edge[n, m, j]]
            best = kept.edge[n, m, 0]
            x, y, z = row(edges.normals, edges.which[best, at[best]])
            kept.normal[n, m, 0], kept.normal[n, m, 1], kept.normal[n, m, 2] = x, y, z
            kept.margin[n, m] = room[best]
    return kept


@part
def _narrow(edges: Edges, vertices: Array, kept: Kept, m: int, rooms: Array) -> bool:
    """Looks between the neighbours of the best planes of a pair, and at the room (n, e, shares) of those in between.

    None is put down for those without more room than the pair's best margin in any piece; returns whether any have.
    """
    found = np.zeros((_REFINED, SHARES), dtype=np.bool_)
    edge, share, lows, highs, _, margins = kept
    for n in range(edge.shape[0]):
        for j in range(_REFINED):
            low, high = lows[n, m, j], highs[n, m, j]
            centre, step = low + (high - low) * (share[n, m, j] / (SHARES - 1)), (high - low) / (SHARES - 1)
            low, high = max(centre - step, 0.0), min(centre + step, 1.0)
            lows[n, m, j], highs[n, m, j] = low, high
            moving = (vertices[0, n, 0, 0], vertices[0, n, 1, 0], vertices[0, n, 2, 0])
            fixed = row(edges.corners[m], 0)
            for s in range(SHARES):
                normal = _between(edges.arcs, edge[n, m, j], low, high, s)
                # Two vertices that were too near each other for the last plane are so for most of the others.
                rooms[n, j, s] = dot(normal, moving) - dot(normal, fixed)
                if rooms[n, j, s] > margins[n, m]:
                    height, moving = nominal(normal, vertices, n)
                    offset, fixed = _offset(normal, edges.corners, m)
                    rooms[n, j, s] = height - offset
                    found[j, s] |= height - offset > margins[n, m]
    for n in range(edge.shape[0]):
        for j in range(_REFINED):
            for s in range(SHARES):
                if not found[j, s]:
                    rooms[n, j, s] = -np.inf
    return bool(found.any())


@part
def _refine(edges: Edges, reached: SweptReach, kept: Kept, m: int, rooms: Array, last: bool) -> None:
    """The best of planes with room (n, e, shares) through each edge that is kept of a pair, and of the pair.

    Those of each edge are left out at last. No margin exceeds its plane's room.
    """
    edge, share, lows, highs, normals, margins = kept
    heights = np.empty((2, reached.vertices.shape[3]))
    for n in range(edge.shape[0]):
        for j in range(_REFINED):
            k, low, high = edge[n, m, j], lows[n, m, j], highs[n, m, j]
            most, share[n, m, j] = margins[n, m] if last else -np.inf, 0
            for s in range(SHARES):
                if rooms[n, j, s] > most:
                    normal = _between(edges.arcs, k, low, high, s)
                    margin = lower_bound(normal, reached, n, heights) - _offset(normal, edges.corners, m)[0]
                    if margin > most:
                        most, share[n, m, j] = margin, s
            if most > margins[n, m]:
                margins[n, m] = most
                x, y, z = _between(edges.arcs, k, low, high, share[n, m, j])
                normals[n, m, 0], normals[n, m, 1], normals[n, m, 2] = x, y, z


@part
def _refine_all(edges: Edges, reached: SweptReach, kept: Kept) -> None:
    """Refines the planes of all pairs, pass by pass, as long as there is room for better ones."""
    count, pairs = kept.margin.shape
    rooms = np.empty((pairs, count, _REFINED, SHARES))
    for k in range(1, _PASSES):
        some = False
        for m in range(pairs):
            some |= _narrow(edges, reached.vertices, kept, m, rooms[m])
        if not some:
            break
        for m in range(pairs):
            _refine(edges, reached, kept, m, rooms[m], k == _PASSES - 1)


@part
def _refine_tightest(edges: Edges, reached: SweptReach, kept: Kept, asked: tuple[float, float]) -> Bits:
    """Refines the planes of pairs that may be the tightest, those tightest so far first.

    Returns which pairs (m) have the best planes now: those of others keep at least as much as the tightest of these.
    """
    (count, pairs), (grazing, enough) = kept.margin.shape, asked
    rooms, margins, clearances = np.empty((count, _REFINED, SHARES)), np.empty(pairs), np.empty(pairs)
    for m in range(pairs):
        margins[m], clearances[m] = kept.margin[:, m].min(), np.inf
        for n in range(count):
            normal = row(kept.normal[n], m)
            room = nominal(normal, reached.vertices, n)[0] - _offset(normal, edges.corners, m)[0]
            clearances[m] = min(clearances[m], room)
    refined = np.zeros(pairs, dtype=np.bool_)
    for m in np.argsort(margins, kind="mergesort"):  # stable: equal ones keep their order
        # A pair that the planes so far do not keep apart even nominally may still come to one that does.
        if margins[m] < enough or clearances[m] < -grazing:
            refined[m] = True
            for k in range(1, _PASSES):
                _narrow(edges, reached.vertices, kept, m, rooms)
                _refine(edges, reached, kept, m, rooms, k == _PASSES - 1)
            enough = min(enough, kept.margin[:, m].min())
    return refined


@compiled
def best(
    edges: Edges, body: Array, motion: Moving, grazing: float, enough: float
) -> tuple[Array, Array, Array, Array, Bits]:
    """For each pair (m) the plane with the largest certified margin over pieces of motion (n), or for the tightest.

    No margin exceeds its plane's room, its clearance without errors: only planes with more of that than the best margin
    so far are looked at with errors. The moving piece has vertices (v, 3), m, and nominal distances may be `grazing`
    (m) below zero. No pair with a margin above `enough` (m) is the tightest; it is not a number where the best planes
    of all are asked.

    Returns:
        unit normals (n, m, 3), how far out the fixed pieces reach along them, margins and clearances (n, m), m; and
        which pairs (m) have the best planes: others keep at least as much as the tightest of these, or `enough`.
    """
    reached, heights = reached_by(body, motion), np.empty((2, len(body)))
    kept = _first(edges, reached, heights)
    count, pairs = kept.margin.shape
    final = np.ones(pairs, dtype=np.bool_)
    if math.isnan(enough):
        _refine_all(edges, reached, kept)
    else:
        final = _refine_tightest(edges, reached, kept, (grazing, enough))
    offsets, clearances = np.empty((count, pairs)), np.empty((count, pairs))
    for n in range(count):
        for m in range(pairs):
            normal = row(kept.normal[n], m)
            offsets[n, m] = _offset(normal, edges.corners, m)[0]
            clearances[n, m] = nominal(normal, reached.vertices, n)[0] - offsets[n, m]
    return kept.normal, offsets, kept.margin, clearances, final
