"""Kernels: what errors and bends leave of rows over pieces of motion, and which witnesses keep most of theirs.

What the formulas mean is told where rows, their curvature and supports of error sets are.
"""

from typing import NamedTuple

import numpy as np

from fmopt.certificate.kernels_rows import End, Row, Table, reach, remainder, value
from fmopt.runtime.compiled import compiled, part
from fmopt.spatial.kernels import Vector, cross, halves, reach_along, size, turned, vector
from fmopt.spatial.values import Array, Bits, Indices


class PieceMotions(NamedTuple):
    """Pieces of motion (n) with their errors."""

    p: Array  # positions (2, n, 3) at both ends, m
    R: Array  # rotations (2, n, 3, 3)
    columns: Array  # of the errors' supports (2, n, c, 6)
    cuts: Indices  # where generators, slide, swing and shape end among them (4,)
    twist: Array  # (n, 6), m and rad
    half: Array  # half-widths (n, 6) of the box around the errors, m and rad
    coupling: Array  # what the linear picture leaves of errors in different frames (n, 2), m and rad
    form: float  # how far the surfaces of both parts may lie from those planned with, together, m


class Sides(NamedTuple):
    """Faces (f) of pieces of the one part against corners (v) of those of the other, for pairs (m) of pieces.

    No contact touches them, so that all rows count.
    """

    normals: Array  # unit normals (f, 3), in the frame of the part that the faces are of
    offsets: Array  # how far out its pieces reach along them (f,), m
    corners: Array  # (v, 3), in the frame of the other part, m
    levers: tuple[Array, Array]  # lengths of the normals (f,), and those of the corners (v,), m
    faces: Indices  # where those of each pair begin and end (m, 2)
    points: Indices  # where the corners of each pair begin and end (m, 2)
    moving: bool  # whether the faces are of the moving part


class Witnesses(NamedTuple):
    """Witnesses (w) that may keep pairs (m) apart, their rows (k) one after the other."""

    begins: Indices  # where the rows of each begin, and the last ones end (w + 1,)
    places: Indices  # witnesses of each pair (m, …), the last repeated where others have more
    always: Indices  # how many rows of each, the first ones, count whatever the errors are (w,), unless they are behind
    surely: Bits  # rows (k,) that count whatever the errors are
    edges: Array  # unit directions (w, 2, 3) of the moving and of the fixed edge; zero without
    onto: Indices  # witness, row `outside` and row `inside` (o, 3) of walls that moving edges turn onto
    behind: Bits  # rows (o, …) of the witness that are then behind the plane


@part
def _value(row: Row, motion: PieceMotions, n: int, e: int) -> tuple[float, Vector, Vector, End]:
    """A row at an end of a piece; see `kernels_rows.value`."""
    return value(row, vector(motion.p[e, n]), motion.R[e, n])


@part
def _reach(moving: Vector, turning: Vector, motion: PieceMotions, n: int, e: int) -> float:
    """How far errors reach along a gradient at an end of a piece."""
    return reach_along(moving, motion.columns[e, n, :, :3], turning, motion.columns[e, n, :, 3:], motion.cuts)


@part
def _left(row: Row, start: End, goal: End, motion: PieceMotions, n: int) -> float:
    """The remainder of a row over a piece of motion, and what tolerances of form take of it.

    A row that measures how far apart two points are along a direction loses those of two places.
    """
    twist, half = halves(motion.twist[n]), halves(motion.half[n])
    # Errors in different frames leave a distance, and an angle that counts on the row's arm.
    coupled = motion.coupling[n, 0] + motion.coupling[n, 1] * reach(row, start, goal)
    places = 1.0 if row["bilinear"] or vector(row["n"]) != (0.0, 0.0, 0.0) else 2.0
    return float(remainder(row, (start, goal), twist, half) + coupled + places * motion.form)


@compiled
def over(table: Table, motion: PieceMotions) -> tuple[Array, Array, Array, Array]:
    """Rows (k) of a table over pieces of motion (n).

    Returns:
        at both ends values (2, n, k) and gradients (2, n, k, 6), how far errors reach along these (2, n, k); and the
        remainders (n, k). In m and m/rad.
    """
    n, k = motion.p.shape[1], len(table)
    f, N, reached, rest = np.empty((2, n, k)), np.empty((2, n, k, 6)), np.empty((2, n, k)), np.empty((n, k))
    for piece in range(n):
        for i in range(k):
            start, goal = _value(table[i], motion, piece, 0), _value(table[i], motion, piece, 1)
            for e, (height, moving, turning, _) in enumerate((start, goal)):
                f[e, piece, i], reached[e, piece, i] = height, _reach(moving, turning, motion, piece, e)
                for j in range(3):
                    N[e, piece, i, j], N[e, piece, i, 3 + j] = moving[j], turning[j]
            rest[piece, i] = _left(table[i], start[3], goal[3], motion, piece)
    return f, N, reached, rest


@part
def _bounds(row: Row, motion: PieceMotions, n: int) -> tuple[float, float]:
    """The least value of a row without errors, and with them."""
    start, moving, turning, begun = _value(row, motion, n, 0)
    goal, moved, turned_by, ended = _value(row, motion, n, 1)
    least = min(start - _reach(moving, turning, motion, n, 0), goal - _reach(moved, turned_by, motion, n, 1))
    return min(start, goal), least - _left(row, begun, ended, motion, n)


@part
def _scales(edges: Array, motion: PieceMotions, n: int, found: Array) -> None:
    """What all margins are divided by: upper bounds, at most 1, of the lengths of the witnesses' normals."""
    # Errors and motion turn the normal of two edges by this much: divided by an upper bound, a margin stays a lower
    # one.
    turning, R = size(vector(motion.half[n, 3:])) + size(vector(motion.twist[n, 3:])), motion.R
    for w in range(len(edges)):
        moving, fixed = vector(edges[w, 0]), vector(edges[w, 1])
        found[w] = 1.0
        if fixed != (0.0, 0.0, 0.0):
            start, goal = cross(turned(R[0, n], moving), fixed), cross(turned(R[1, n], moving), fixed)
            found[w] = min(1.0, max(size(start), size(goal)) + turning)


@part
def _room(table: Table, witnesses: Witnesses, w: int, motion: PieceMotions, n: int, least: float) -> float:
    """The least value without errors among rows of a witness that surely count, or some value below `least`."""
    found = np.inf
    for k in range(witnesses.begins[w], witnesses.begins[w + 1]):
        if witnesses.surely[k]:
            # Without errors first: what is no better nominally cannot be better with them.
            found = min(found, _value(table[k], motion, n, 0)[0], _value(table[k], motion, n, 1)[0])
            if found < least:
                break
    return found


@part
def _count(w: int, table: Table, witnesses: Witnesses, motion: PieceMotions, n: int, which: Bits) -> None:
    """Which rows of a witness count, given their lower bounds."""
    first, count = witnesses.begins[w], witnesses.begins[w + 1] - witnesses.begins[w]
    for k in range(count):
        which[k] = k < witnesses.always[w]
    for o in range(len(witnesses.onto)):
        # The end of the edge is surely outside: rows behind that wall need not hold, and one that replaces them has to.
        if witnesses.onto[o, 0] == w and _bounds(table[first + witnesses.onto[o, 1]], motion, n)[1] > 0.0:
            which[witnesses.onto[o, 2]] = True
            for i in range(count):
                which[i] &= not witnesses.behind[o, i]


@part
def _margin(
    which: Bits, first: int, table: Table, motion: PieceMotions, n: int, asked: tuple[float, float]
) -> tuple[float, float]:
    """Margin and clearance of a witness; of one that cannot have the margin asked for, some margin below that.

    `asked` says what margins are divided by, and the margin asked for, m.
    """
    scale, least = asked
    margin, clearance = np.inf, np.inf
    for k in range(len(which)):
        if which[k]:
            nominal, lower = _bounds(table[first + k], motion, n)
            margin, clearance = min(margin, lower / scale), min(clearance, nominal / scale)
            # Already below what is asked for: the rest cannot raise it.
            if margin < least:
                break
    return margin, clearance


@part
def _widest(rooms: Array) -> int:
    found = 0
    for i in range(1, len(rooms)):
        if rooms[i] > rooms[found]:
            found = i
    return found


@compiled
def best(
    table: Table, witnesses: Witnesses, motion: PieceMotions, least: Array, grazing: float
) -> tuple[Indices, Array, Array]:
    """The first witness of each pair (m) with the largest margin, from `least` (n, m) on, over pieces of motion (n).

    No margin exceeds its witness's room: those with less of that than the best so far are left out. Nominal distances
    may be `grazing` below zero, m.

    Returns:
        witnesses (n, m), −1 where none is good enough, their margins and their clearances, m.
    """
    begins, all_places = witnesses.begins, witnesses.places
    count, pairs = motion.p.shape[1], len(all_places)
    found, margins = np.empty((count, pairs), dtype=np.intp), np.empty((count, pairs))
    clearances, rooms = np.empty((count, pairs)), np.empty(all_places.shape[1])
    scales, which = np.empty(len(begins) - 1), np.empty(len(table), dtype=np.bool_)
    for n in range(count):
        _scales(witnesses.edges, motion, n, scales)
        for m in range(pairs):
            most, at = least[n, m], len(rooms)
            found[n, m], margins[n, m], clearances[n, m] = -1, -np.inf, -np.inf
            for i in range(len(rooms)):
                w = all_places[m, i]
                # Lists are filled up with their last entry, which is not to be tried again.
                if i > 0 and w == all_places[m, i - 1]:
                    rooms[i] = -np.inf
                else:
                    # A margin is at most the clearance, and what grazes by rounding still counts as apart.
                    enough = scales[w] * max(most, -grazing)
                    rooms[i] = _room(table, witnesses, w, motion, n, enough) / scales[w]
            i = _widest(rooms)
            # The widest nominally first: it is likely to be the best, and rules out most of the others.
            while rooms[i] >= max(most, -grazing):
                w, rooms[i] = all_places[m, i], -np.inf
                rows = which[: begins[w + 1] - begins[w]]
                _count(w, table, witnesses, motion, n, rows)
                margin, clear = _margin(rows, begins[w], table, motion, n, (scales[w], most))
                # The first of equals, whatever the order in which they were tried: plans do not hang on rounding.
                if clear >= -grazing and (margin > most or (margin == most and i < at)):
                    at, most, found[n, m], margins[n, m], clearances[n, m] = i, margin, w, margin, clear
                i = _widest(rooms)
    return found, margins, clearances


@part
def _side(sides: Sides, i: int, scratch: Table) -> None:
    """Makes the row of a face, whose point of the other piece is still to be put in."""
    for c in range(3):
        if sides.moving:
            scratch[0]["b"][c] = sides.normals[i, c]
        else:
            scratch[0]["n"][c], scratch[0]["u"][c] = sides.normals[i, c], sides.normals[i, c]
    # The row of `faces_above`, (R n)·(w − p) − a, of which only w is still open, or of `points_above`, n·(p + R v) − a.
    scratch[0]["c"] = sides.offsets[i]
    if sides.moving:
        scratch[0]["sign"], scratch[0]["bilinear"] = -1.0, 1


@part
def _at_corner(sides: Sides, i: int, v: int, scratch: Table) -> Row:
    for c in range(3):
        if sides.moving:
            scratch[0]["s"][c] = sides.corners[v, c]
        else:
            scratch[0]["k"][c] = sides.corners[v, c]
    if not sides.moving:
        scratch[0]["lever"] = sides.levers[0][i] * sides.levers[1][v]
    return scratch[0]


@compiled
def best_sides(
    sides: Sides, scratch: Table, motion: PieceMotions, least: Array, grazing: float
) -> tuple[Indices, Array, Array]:
    """The first face that keeps each pair (m) apart with the largest margin over pieces of motion (n).

    What `best` does with rows that are listed, by the same margins, for so many faces and pieces that their rows would
    fill the memory: a face is given up at the first corner that it does not keep off.

    Returns:
        faces (n, m), −1 where none is good enough, their margins and their clearances, m.
    """
    count, pairs, rooms = motion.p.shape[1], len(sides.points), np.empty(len(sides.normals))
    found, margins = np.empty((count, pairs), dtype=np.intp), np.empty((count, pairs))
    clearances = np.empty((count, pairs))
    for n in range(count):
        for m in range(pairs):
            begun, ended = sides.faces[m, 0], sides.faces[m, 1]
            first, last = sides.points[m, 0], sides.points[m, 1]
            most, at = least[n, m], ended
            found[n, m], margins[n, m], clearances[n, m] = -1, -np.inf, -np.inf
            for i in range(begun, ended):
                _side(sides, i, scratch)
                rooms[i], enough = np.inf, max(most, -grazing)
                for v in range(first, last):
                    corner = _at_corner(sides, i, v, scratch)
                    rooms[i] = min(rooms[i], _value(corner, motion, n, 0)[0], _value(corner, motion, n, 1)[0])
                    if rooms[i] < enough:
                        break
            i = begun + _widest(rooms[begun:ended])
            while rooms[i] >= max(most, -grazing):
                rooms[i], margin, clear = -np.inf, np.inf, np.inf
                _side(sides, i, scratch)
                for v in range(first, last):
                    nominal, lower = _bounds(_at_corner(sides, i, v, scratch), motion, n)
                    margin, clear = min(margin, lower), min(clear, nominal)
                    if margin < most:
                        break
                if clear >= -grazing and (margin > most or (margin == most and i < at)):
                    at, most, found[n, m], margins[n, m], clearances[n, m] = i, margin, i, margin, clear
                i = begun + _widest(rooms[begun:ended])
    return found, margins, clearances
