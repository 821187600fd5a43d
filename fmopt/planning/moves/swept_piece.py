"""Kernels: how far a moving piece reaches along the normal of a plane, over pieces of motion with their errors.

A plane's row over a vertex v of the moving piece, N = (n, Rv × n), has N·c = n·(c_t + c_r × Rv): the columns c of the
errors' support are turned into displacements of the vertices once, and each plane costs a product.
"""

from typing import NamedTuple

import numpy as np

from fmopt.runtime.compiled import part
from fmopt.spatial.kernels import Vector, cross, reach_along, row, size, swung, turned
from fmopt.spatial.values import Array, Indices

_ROUNDING, _ROOM = 1.0 + 1e-9, 1e-15  # of bounds that leave vertices out: a factor, and m

Moving = tuple[Array, Array, Array, Indices, Array, Array, Array]
"""Pieces of motion (n), as `fmopt.certificate.row_bounds.PieceMotions` lists them, but for tolerances of form."""


class SweptReach(NamedTuple):
    """How far a moving piece reaches at both ends of pieces of motion (n)."""

    vertices: Array  # where they are (2, n, 3, v), m
    moved: Array  # how the columns of the errors' supports displace them (2, n, v, c, 3), m
    cuts: Indices  # where generators, slide, swing and shape end among the columns (4,)
    tilted: Array  # what errors that turn a plane leave at each vertex (n, v), per their size, m
    arc: Array  # what the nominal turn leaves there (n, v), m
    linked: Array  # what the linear picture leaves there of errors in different frames (n, v), m
    most: Array  # how far below its nominal heights no vertex is taken along any normal (n, v), m
    angles: Array  # half-widths (n, 3) of the box around the angle errors, rad
    turn: Array  # nominal turns (n, 3), rad


@part
def reached_by(body: Array, motion: Moving) -> SweptReach:
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
            # Heights along the turn have the second derivative n·(ω × (ω × x)), and |ω × x| is the same all along it:
            # they miss their chord by an eighth of |ω × n||ω × x| at most.
            arc[n, v] = 0.125 * swept
            linked[n, v] = coupling[n, 0] + coupling[n, 1] * size(row(body, v))
            turned_most = size(box) * tilted[n, v] + size(turn) * arc[n, v]
            most[n, v] = _ROUNDING * (farthest + turned_most + linked[n, v]) + _ROOM
    return SweptReach(vertices, moved, cuts, tilted, arc, linked, most, angles, turns)


@part
def nominal(normal: Vector, vertices: Array, n: int) -> tuple[float, Vector]:
    """The least n·v over the vertices of the moving piece without errors, and that vertex."""
    found, end, at, (x, y, z) = np.inf, 0, 0, normal
    for e in range(2):
        for v in range(vertices.shape[3]):
            height = x * vertices[e, n, 0, v] + y * vertices[e, n, 1, v] + z * vertices[e, n, 2, v]
            if height < found:
                found, end, at = height, e, v
    return found, (vertices[end, n, 0, at], vertices[end, n, 1, at], vertices[end, n, 2, at])


@part
def lower_bound(normal: Vector, reached: SweptReach, n: int, heights: Array) -> float:
    """The certified lower bound of n·v over all vertices v, m, for a unit normal; `heights` is scratch (2, v)."""
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
    found = _of_vertex(normal, reached, n, first, heights, lean)
    for v in range(count):
        if v != first and min(heights[0, v], heights[1, v]) - reached.most[n, v] < found:
            found = min(found, _of_vertex(normal, reached, n, v, heights, lean))
    return found


@part
def _of_vertex(normal: Vector, reached: SweptReach, n: int, v: int, heights: Array, lean: tuple[float, float]) -> float:
    """The certified lower bound of n·v of one vertex, m; `lean` is how much errors and motion turn the plane, rad."""
    found = np.inf
    for e in range(2):
        moved = reached.moved[e, n, v]
        found = min(found, heights[e, v] - reach_along(normal, moved, (0.0, 0.0, 0.0), moved, reached.cuts))
    return float(found - (lean[0] * reached.tilted[n, v] + lean[1] * reached.arc[n, v]) - reached.linked[n, v])
