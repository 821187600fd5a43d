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
        moved: how the columns of the errors' supports displace them (2, n, c, 3, v), m.
        cuts: where generators, slide, swing and shape end among the columns (4,).
        tilted: what errors that turn a plane leave at each vertex (n, v), per their size, m.
        arc: what the nominal turn leaves there (n, v), m.
        linked: what the linear picture leaves there of errors in different frames (n, v), m.
        angles: half-widths (n, 3) of the box around the angle errors, rad.
        turn: nominal turns (n, 3), rad.
    """

    vertices: Array
    moved: Array
    cuts: Places
    tilted: Array
    arc: Array
    linked: Array
    angles: Array
    turn: Array


@part
def _reached(body: Array, motion: Moving) -> Reached:
    """How far vertices (v, 3) of the moving piece reach."""
    p, R, columns, cuts, twist, half, coupling = motion
    pieces, count = p.shape[1], len(body)
    vertices, moved = np.empty((2, pieces, 3, count)), np.empty((2, pieces, columns.shape[2], 3, count))
    tilted, arc = np.empty((pieces, count)), np.empty((pieces, count))
    angles, turns, linked = half[:, 3:], twist[:, 3:], np.empty((pieces, count))
    for n in range(pieces):
        box, turn = row(angles, n), row(turns, n)
        for v in range(count):
            start, goal = turned(R[0, n], row(body, v)), turned(R[1, n], row(body, v))
            for e in range(2):
                x = start if e == 0 else goal
                for i in range(3):
                    vertices[e, n, i, v] = x[i] + p[e, n, i]
                for c in range(columns.shape[2]):
                    C = columns[e, n, c]
                    moving = cross((C[3], C[4], C[5]), x)
                    for i in range(3):
                        moved[e, n, c, i, v] = C[i] + moving[i]
            swept = size(cross(turn, start))
            most = max(swung(start, box, size(box)), swung(goal, box, size(box))) + 0.5 * size(box) * swept
            tilted[n, v] = 0.5 * (min(most, size(box) * size(start)) + swept)
            arc[n, v] = 0.125 * swept
            linked[n, v] = coupling[n, 0] + coupling[n, 1] * size(row(body, v))
    return Reached(vertices, moved, cuts, tilted, arc, linked, angles, turns)


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
def _lower(normal: Vector, reached: Reached, n: int, work: Array) -> float:
    """The certified lower bound of n·v over all vertices v, m."""
    vertices, moved, cuts, tilted, arc, linked, angles, turn = reached
    (x, y, z), count = normal, vertices.shape[3]
    for v in range(count):
        work[5, v] = np.inf
    for e in range(2):
        for v in range(count):
            work[0, v], work[1, v], work[2, v], work[3, v], work[4, v] = 0.0, 0.0, 0.0, 0.0, 0.0
        for c in range(moved.shape[2]):
            if c < cuts[0] or c >= cuts[3]:
                part = 0 if c < cuts[0] else 4
                for v in range(count):
                    work[part, v] += abs(x * moved[e, n, c, 0, v] + y * moved[e, n, c, 1, v] + z * moved[e, n, c, 2, v])
            else:
                part = 1 if c < cuts[1] else 2 if c < cuts[2] else 3
                for v in range(count):
                    seen = x * moved[e, n, c, 0, v] + y * moved[e, n, c, 1, v] + z * moved[e, n, c, 2, v]
                    work[part, v] += seen * seen
        for v in range(count):
            height = x * vertices[e, n, 0, v] + y * vertices[e, n, 1, v] + z * vertices[e, n, 2, v]
            inside = work[0, v] + math.sqrt(work[1, v]) + math.sqrt(work[2, v])
            reach = min(math.sqrt(work[3, v]), inside) + work[4, v]
            work[5, v] = min(work[5, v], height - reach)
    box = row(angles, n)
    tilt, lean, found = swung(normal, box, size(box)), size(cross(row(turn, n), normal)), np.inf
    for v in range(count):
        found = min(found, work[5, v] - (tilt * tilted[n, v] + lean * arc[n, v]) - linked[n, v])
    return found


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
def _hopeful(edges: Edges, reached: Reached, work: Array) -> NDArray[np.bool_]:
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
            enough = _lower(row(edges.normals, widest), reached, n, work) - (nominal[widest] - room)
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
def _first(edges: Edges, reached: Reached, work: Array) -> Kept:
    """The roomiest edges of each pair, by the planes that all edges share."""
    hopeful, count, pairs = _hopeful(edges, reached, work), len(reached.turn), len(edges.corners)
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
            lower[q] = _lower(row(edges.normals, q), reached, n, work) if hopeful[q] else -np.inf
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
def _narrow(edges: Edges, vertices: Array, kept: Kept, rooms: Array) -> bool:
    """Looks between the neighbours of the best planes, and at the room (n, m, e, shares) of those in between, or more.

    None is put down for those without more room than their pair's best margin in any piece of motion.

    Returns:
        whether any have more.
    """
    arcs, corners, some = edges.arcs, edges.corners, False
    found = np.zeros((len(corners), _REFINED, SHARES), dtype=np.bool_)
    edge, share, lows, highs, _, margins = kept
    for n in range(edge.shape[0]):
        for m in range(edge.shape[1]):
            for j in range(_REFINED):
                low, high = lows[n, m, j], highs[n, m, j]
                centre, step = low + (high - low) * (share[n, m, j] / (SHARES - 1)), (high - low) / (SHARES - 1)
                low, high = max(centre - step, 0.0), min(centre + step, 1.0)
                lows[n, m, j], highs[n, m, j] = low, high
                moving = (vertices[0, n, 0, 0], vertices[0, n, 1, 0], vertices[0, n, 2, 0])
                fixed = row(corners[m], 0)
                for s in range(SHARES):
                    normal = _between(arcs, edge[n, m, j], low, high, s)
                    # Two vertices that were too near each other for the last plane are so for most of the others.
                    rooms[n, m, j, s] = dot(normal, moving) - dot(normal, fixed)
                    if rooms[n, m, j, s] > margins[n, m]:
                        nominal, moving = _nominal(normal, vertices, n)
                        offset, fixed = _offset(normal, corners, m)
                        rooms[n, m, j, s] = nominal - offset
                        if nominal - offset > margins[n, m]:
                            found[m, j, s] = some = True
    for n in range(edge.shape[0]):
        for m in range(edge.shape[1]):
            for j in range(_REFINED):
                for s in range(SHARES):
                    if not found[m, j, s]:
                        rooms[n, m, j, s] = -np.inf
    return some


@part
def _refine(edges: Edges, reached: Reached, kept: Kept, rooms: Array, last: bool, work: Array) -> None:
    """The best of planes with room through each edge that is kept, and of each pair; without the former at last.

    No margin exceeds its plane's room.
    """
    edge, share, lows, highs, normals, margins = kept
    for n in range(edge.shape[0]):
        for m in range(edge.shape[1]):
            for j in range(_REFINED):
                k, low, high = edge[n, m, j], lows[n, m, j], highs[n, m, j]
                most, share[n, m, j] = margins[n, m] if last else -np.inf, 0
                for s in range(SHARES):
                    if rooms[n, m, j, s] > most:
                        normal = _between(edges.arcs, k, low, high, s)
                        margin = _lower(normal, reached, n, work) - _offset(normal, edges.corners, m)[0]
                        if margin > most:
                            most, share[n, m, j] = margin, s
                if most > margins[n, m]:
                    margins[n, m] = most
                    x, y, z = _between(edges.arcs, k, low, high, share[n, m, j])
                    normals[n, m, 0], normals[n, m, 1], normals[n, m, 2] = x, y, z


@compiled
def best(edges: Edges, body: Array, motion: Moving) -> tuple[Array, Array, Array, Array]:
    """For each pair (m) the plane with the largest certified margin over pieces of motion (n).

    No margin exceeds its plane's room, its clearance without errors: only planes with more of that than the best
    margin so far are looked at with errors.

    Args:
        edges: of the fixed pieces.
        body: vertices (v, 3) of the moving piece, m.
        motion: the pieces of motion.

    Returns:
        unit normals (n, m, 3), how far out the fixed pieces reach along them, margins and clearances (n, m), m.
    """
    reached, work = _reached(body, motion), np.empty((6, len(body)))
    kept = _first(edges, reached, work)
    count, pairs = kept.margin.shape
    rooms = np.empty((count, pairs, _REFINED, SHARES))
    for k in range(1, _PASSES):
        if not _narrow(edges, reached.vertices, kept, rooms):
            break
        _refine(edges, reached, kept, rooms, k == _PASSES - 1, work)
    offsets, clearances = np.empty((count, pairs)), np.empty((count, pairs))
    for n in range(count):
        for m in range(pairs):
            normal = row(kept.normal[n], m)
            offsets[n, m] = _offset(normal, edges.corners, m)[0]
            clearances[n, m] = _nominal(normal, reached.vertices, n)[0] - offsets[n, m]
    return kept.normal, offsets, kept.margin, clearances
