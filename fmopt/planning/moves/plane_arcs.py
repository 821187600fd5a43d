"""Kernels: planes through edges, between the two faces of each, that keep a moving piece at most margin.

A plane's row over a vertex v of the moving piece, N = (n, Rv × n), has N·c = n·(c_t + c_r × Rv): the columns c of the
errors' support are turned into displacements of the vertices once, and each plane costs a product.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fmopt.runtime.compiled import compiled, part
from fmopt.spatial.kernels import Vector, cross, dot, row, size, swung, turned
from fmopt.spatial.values import Array

SHARES = 9  # planes tried through an edge in each pass
_PASSES = 3
_REFINED = 6  # edges of a pair that are looked at more closely
_ROUNDING, _ROOM = 1.0 + 1e-9, 1e-15  # of bounds that leave vertices out: a factor, and m

Places = NDArray[np.intp]
Moving = tuple[Array, Array, Array, Places, Array, Array, Array]
"""Pieces of motion (n), as `fmopt.certificate.row_bounds.Motion` lists them, but for tolerances of form."""


class Edges(NamedTuple):
    """The planes through all edges of the fixed pieces of some pairs (m).

    Args:
        arcs: normals (k, 2, 3) of the two faces of each edge, pair by pair.
        cuts: where the edges of each pair begin, and the last ones end (m + 1,).
        normals: all different normals (q, 3) of the first pass.
        which: which of them each plane (k, shares) has.
        offsets: how far out each plane (k, shares) is, m.
        corners: vertices (m, v, 3) of the fixed pieces, some repeated where others have more, m.
    """

    arcs: Array
    cuts: Places
    normals: Array
    which: Places
    offsets: Array
    corners: Array


class Reached(NamedTuple):
    """How far a moving piece reaches at both ends of pieces of motion (n).

    Args:
        vertices: where they are (2, n, 3, v), m.
        moved: how the columns of the errors' supports displace them (2, n, v, c, 3), m.
        cuts: where generators, slide, swing and shape end among the columns (4,).
        tilted: what errors that turn a plane leave at each vertex (n, v), per their size, m.
        arc: what the nominal turn leaves there (n, v), m.
        linked: what the linear picture leaves there of errors in different frames (n, v), m.
        most: how far below its nominal heights no vertex is taken along any normal (n, v), m.
        angles: half-widths (n, 3) of the box around the angle errors, rad.
        turn: nominal turns (n, 3), rad.
    """

    vertices: Array
    moved: Array
    cuts: Places
    tilted: Array
    arc: Array
    linked: Array
    most: Array
    angles: Array
    turn: Array


@part
def _reached(body: Array, motion: Moving) -> Reached:
    """How far vertices (v, 3) of the moving piece reach."""
    p, R, columns, cuts, twist, half, coupling = motion
    pieces, count = p.shape[1], len(body)
    vertices, moved = np.empty((2, pieces, 3, count)), np.empty((2, pieces, count, columns.shape[2], 3))
    tilted, arc = np.empty((pieces, count)), np.empty((pieces, count))
    angles, turns, linked, most = half[:, 3:], twist[:, 3:], np.empty((pieces, count)), np.empty((pieces, count))
    for n in range(pieces):
        box, turn = row(angles, n), row(turns, n)
        for v in range(count):
            start, goal = turned(R[0, n], row(body, v)), turned(R[1, n], row(body, v))
            farthest = 0.0
            for e in range(2):
                x, far = start if e == 0 else goal, 0.0
                for i in range(3):
                    vertices[e, n, i, v] = x[i] + p[e, n, i]
                for c in range(columns.shape[2]):
                    C = columns[e, n, c]
                    moving = cross((C[3], C[4], C[5]), x)
                    for i in range(3):
                        moved[e, n, v, c, i] = C[i] + moving[i]
                    # Those of the shape are there for a second bound, of which the smaller one counts.
                    far += 0.0 if cuts[2] <= c < cuts[3] else size(row(moved[e, n, v], c))
                farthest = max(farthest, far)
            swept = size(cross(turn, start))
            swing = max(swung(start, box, size(box)), swung(goal, box, size(box))) + 0.5 * size(box) * swept
            tilted[n, v] = 0.5 * (min(swing, size(box) * size(start)) + swept)
            arc[n, v] = 0.125 * swept
            linked[n, v] = coupling[n, 0] + coupling[n, 1] * size(row(body, v))
            turned_most = size(box) * tilted[n, v] + size(turn) * arc[n, v]
            most[n, v] = _ROUNDING * (farthest + turned_most + linked[n, v]) + _ROOM
    return Reached(vertices, moved, cuts, tilted, arc, linked, most, angles, turns)


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
def _nominal(normal: Vector, vertices: Array, n: int) -> tuple[float, Vector]:
    """The least n·v over the vertices of the moving piece without errors, and that vertex."""
    found, end, at, (x, y, z) = np.inf, 0, 0, normal
    for e in range(2):
        for v in range(vertices.shape[3]):
            height = x * vertices[e, n, 0, v] + y * vertices[e, n, 1, v] + z * vertices[e, n, 2, v]
            if height < found:
                found, end, at = height, e, v
    return found, (vertices[end, n, 0, at], vertices[end, n, 1, at], vertices[end, n, 2, at])


@part
def _lower(normal: Vector, reached: Reached, n: int, heights: Array) -> float:
    """The certified lower bound of n·v over all vertices v, m.

    Args:
        normal: unit vector.
        reached: how far the moving piece reaches.
        n: which piece of motion.
        heights: scratch (2, v).
    """
    vertices, count = reached.vertices, reached.vertices.shape[3]
    lowest, first = np.inf, 0
    for v in range(count):
        for e in range(2):
            x, y, z = vertices[e, n, 0, v], vertices[e, n, 1, v], vertices[e, n, 2, v]
            heights[e, v] = normal[0] * x + normal[1] * y + normal[2] * z
        # What errors take of a vertex is bounded for all normals: most vertices are too high to be the lowest.
        least = min(heights[0, v], heights[1, v]) - reached.most[n, v]
        if least < lowest:
            lowest, first = least, v
    box, turn = row(reached.angles, n), row(reached.turn, n)
    lean = swung(normal, box, size(box)), size(cross(turn, normal))
    found = _lowered(normal, reached, n, first, heights, lean)
    for v in range(count):
        if v != first and min(heights[0, v], heights[1, v]) - reached.most[n, v] < found:
            found = min(found, _lowered(normal, reached, n, v, heights, lean))
    return found


@part
def _lowered(normal: Vector, reached: Reached, n: int, v: int, heights: Array, lean: tuple[float, float]) -> float:
    """The certified lower bound of n·v of one vertex, m; `lean` is how much errors and motion turn the plane, rad."""
    moved, cuts, found = reached.moved, reached.cuts, np.inf
    for e in range(2):
        spread, slide, swing, shape, slack = 0.0, 0.0, 0.0, 0.0, 0.0
        for c in range(moved.shape[3]):
            seen = (
                normal[0] * moved[e, n, v, c, 0] + normal[1] * moved[e, n, v, c, 1] + normal[2] * moved[e, n, v, c, 2]
            )
            if c < cuts[0]:
                spread += abs(seen)
            elif c < cuts[1]:
                slide += seen * seen
            elif c < cuts[2]:
                swing += seen * seen
            elif c < cuts[3]:
                shape += seen * seen
            else:
                slack += abs(seen)
        inside = spread + math.sqrt(slide) + math.sqrt(swing)
        found = min(found, heights[e, v] - (min(math.sqrt(shape), inside) + slack))
    return float(found - (lean[0] * reached.tilted[n, v] + lean[1] * reached.arc[n, v]) - reached.linked[n, v])


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
    """The edges of each pair (n, m, e) that are looked at more closely.

    Args:
        edge: which they are.
        share: which plane through each kept most so far.
        low: where the planes through it begin between its two faces.
        high: where they end.
        normal: the best plane's normal (n, m, 3).
        margin: its margin (n, m), m.
    """

    edge: Places
    share: Places
    low: Array
    high: Array
    normal: Array
    margin: Array


@part
def _hopeful(edges: Edges, reached: Reached, heights: Array) -> NDArray[np.bool_]:
    """Which of all normals may have the largest margin of a pair in some piece of motion."""
    found, nominal = np.zeros(len(edges.normals), dtype=np.bool_), np.empty(len(edges.normals))
    which, offsets, cuts = edges.which, edges.offsets, edges.cuts
    for n in range(len(reached.turn)):
        for q in range(len(nominal)):
            nominal[q] = _nominal(row(edges.normals, q), reached.vertices, n)[0]
        for m in range(len(edges.corners)):
            widest, room = 0, -np.inf
            for k in range(cuts[m], cuts[m + 1]):
                for s in range(SHARES):
                    if nominal[which[k, s]] - offsets[k, s] > room:
                        widest, room = which[k, s], nominal[which[k, s]] - offsets[k, s]
            enough = _lower(row(edges.normals, widest), reached, n, heights) - (nominal[widest] - room)
            for k in range(cuts[m], cuts[m + 1]):
                for s in range(SHARES):
                    found[which[k, s]] |= nominal[which[k, s]] - offsets[k, s] >= enough
    return found


@part
def _roomiest(room: Array, first: int, last: int, found: Places) -> None:
    """The edges with the largest rooms, the first ones of equal ones first."""
    left = np.ones(len(room), dtype=np.bool_)
    for j in range(len(found)):
        found[j] = -1
        for k in range(first, last):
            if left[k] and (found[j] < 0 or room[k] > room[found[j]]):
                found[j] = k
        left[found[j]] = False


@part
def _first(edges: Edges, reached: Reached, heights: Array) -> Kept:
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
            lower[q] = _lower(row(edges.normals, q), reached, n, heights) if hopeful[q] else -np.inf
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

    None is put down for those without more room than the pair's best margin in any piece of motion.

    Returns:
        whether any have more.
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
                    nominal, moving = _nominal(normal, vertices, n)
                    offset, fixed = _offset(normal, edges.corners, m)
                    rooms[n, j, s] = nominal - offset
                    found[j, s] |= nominal - offset > margins[n, m]
    for n in range(edge.shape[0]):
        for j in range(_REFINED):
            for s in range(SHARES):
                if not found[j, s]:
                    rooms[n, j, s] = -np.inf
    return bool(found.any())


@part
def _refine(edges: Edges, reached: Reached, kept: Kept, m: int, rooms: Array, last: bool) -> None:
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
                    margin = _lower(normal, reached, n, heights) - _offset(normal, edges.corners, m)[0]
                    if margin > most:
                        most, share[n, m, j] = margin, s
            if most > margins[n, m]:
                margins[n, m] = most
                x, y, z = _between(edges.arcs, k, low, high, share[n, m, j])
                normals[n, m, 0], normals[n, m, 1], normals[n, m, 2] = x, y, z


@part
def _refine_all(edges: Edges, reached: Reached, kept: Kept) -> None:
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
def _refine_tightest(edges: Edges, reached: Reached, kept: Kept, asked: tuple[float, float]) -> NDArray[np.bool_]:
    """Refines the planes of pairs that may be the tightest, those tightest so far first.

    Args:
        edges: of the fixed pieces.
        reached: by the moving piece.
        kept: the planes so far.
        asked: how far nominal distances may be below zero, and a margin above which no pair is the tightest, m.

    Returns:
        which pairs (m) have the best planes now: those of others keep at least as much as the tightest of these.
    """
    (count, pairs), (grazing, enough) = kept.margin.shape, asked
    rooms, margins, clearances = np.empty((count, _REFINED, SHARES)), np.empty(pairs), np.empty(pairs)
    for m in range(pairs):
        margins[m], clearances[m] = kept.margin[:, m].min(), np.inf
        for n in range(count):
            normal = row(kept.normal[n], m)
            room = _nominal(normal, reached.vertices, n)[0] - _offset(normal, edges.corners, m)[0]
            clearances[m] = min(clearances[m], room)
    refined = np.zeros(pairs, dtype=np.bool_)
    for m in np.argsort(margins, kind="mergesort"):
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
) -> tuple[Array, Array, Array, Array, NDArray[np.bool_]]:
    """For each pair (m) the plane with the largest certified margin over pieces of motion (n), or for the tightest.

    No margin exceeds its plane's room, its clearance without errors: only planes with more of that than the best
    margin so far are looked at with errors.

    Args:
        edges: of the fixed pieces.
        body: vertices (v, 3) of the moving piece, m.
        motion: the pieces of motion.
        grazing: how far nominal distances may be below zero, m.
        enough: a margin above which no pair is the tightest, m; not a number where the best planes of all are asked.

    Returns:
        unit normals (n, m, 3), how far out the fixed pieces reach along them, margins and clearances (n, m), m; and
        which pairs (m) have the best planes: others keep at least as much as the tightest of these, or `enough`.
    """
    reached, heights = _reached(body, motion), np.empty((2, len(body)))
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
            clearances[n, m] = _nominal(normal, reached.vertices, n)[0] - offsets[n, m]
    return kept.normal, offsets, kept.margin, clearances, final
