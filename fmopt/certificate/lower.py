"""Kernels: what errors and bends leave of rows over pieces of motion, and which witnesses keep most of theirs.

What the formulas mean is told where rows, their curvature and supports of error sets are.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fmopt.compiled import compiled, part
from fmopt.values import Array

Mask = NDArray[np.bool_]
Places = NDArray[np.intp]
Vector = tuple[float, float, float]


class Motion(NamedTuple):
    """Pieces of motion (n) with their errors.

    Args:
        p: positions (2, n, 3) at both ends, m.
        R: rotations (2, n, 3, 3).
        columns: of the errors' supports (2, n, c, 6).
        cuts: where generators, slide, swing and shape end among them (4,).
        twist: (n, 6), m and rad.
        half: half-widths (n, 6) of the box around the errors, m and rad.
        coupling: what the linear picture leaves of errors in different frames (n, 2), m and rad.
    """

    p: Array
    R: Array
    columns: Array
    cuts: Places
    twist: Array
    half: Array
    coupling: Array


class Functions(NamedTuple):
    """Rows as functions of the pose: the table (k, 21) of `Forms`, and which rows (k,) are bilinear."""

    table: Array
    bilinear: Mask


class Witnesses(NamedTuple):
    """Witnesses (w) that may keep pairs (m) apart, their rows (k) one after the other.

    Args:
        begins: where the rows of each begin, and the last ones end (w + 1,).
        places: witnesses of each pair (m, …), the last repeated where others have more.
        always: how many rows of each, the first ones, count whatever the errors are (w,), unless they are behind.
        surely: rows (k,) that count whatever the errors are.
        edges: unit directions (w, 2, 3) of the moving and of the fixed edge; zero without.
        onto: witness, row `outside` and row `inside` (o, 3) of walls that moving edges turn onto.
        behind: rows (o, …) of the witness that are then behind the plane.
    """

    begins: Places
    places: Places
    always: Places
    surely: Mask
    edges: Array
    onto: Places
    behind: Mask


@part
def _cross(a: Vector, b: Vector) -> Vector:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@part
def _dot(a: Vector, b: Vector) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@part
def _size(a: Vector) -> float:
    return math.sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2])


@part
def _beside(scale: float, a: Vector, b: Vector) -> Vector:
    """Scale · a + b."""
    return scale * a[0] + b[0], scale * a[1] + b[1], scale * a[2] + b[2]


@part
def _three(array: Array, n: int, first: int) -> Vector:
    return array[n, first], array[n, first + 1], array[n, first + 2]


@part
def _turned(R: Array, e: int, n: int, a: Vector) -> Vector:
    """R a at an end."""
    return (
        R[e, n, 0, 0] * a[0] + R[e, n, 0, 1] * a[1] + R[e, n, 0, 2] * a[2],
        R[e, n, 1, 0] * a[0] + R[e, n, 1, 1] * a[1] + R[e, n, 1, 2] * a[2],
        R[e, n, 2, 0] * a[0] + R[e, n, 2, 1] * a[1] + R[e, n, 2, 2] * a[2],
    )


@part
def _value(table: Array, k: int, bilinear: bool, p: Array, R: Array, e: int, n: int, N: Array, X: Array) -> float:
    """The value of row k at an end; its gradient goes to N[e] (6,), and R k, R b and y to X[e] (9,)."""
    at, u = (p[e, n, 0], p[e, n, 1], p[e, n, 2]), _three(table, k, 3)
    normal, w = _three(table, k, 0), _turned(R, e, n, _three(table, k, 6))
    found, turning = _dot(normal, at) + _dot(u, w) - table[k, 18], _cross(w, u)
    if bilinear:
        a, sign = _three(table, k, 12), table[k, 19]
        y = _beside(sign, at, _beside(1.0, _cross(a, at), _three(table, k, 15)))
        b = _turned(R, e, n, _three(table, k, 9))
        found += _dot(b, y)
        normal, turning = _beside(1.0, normal, _beside(sign, b, _cross(b, a))), _beside(1.0, turning, _cross(b, y))
        X[e, 3], X[e, 4], X[e, 5] = b
        X[e, 6], X[e, 7], X[e, 8] = y
    X[e, 0], X[e, 1], X[e, 2] = w
    N[e, 0], N[e, 1], N[e, 2] = normal
    N[e, 3], N[e, 4], N[e, 5] = turning
    return float(found)


@part
def _reach(N: Array, columns: Array, cuts: Places, e: int, n: int) -> float:
    """How far errors reach along N[e] (6,)."""
    spread, slide, swing, shape, slack = 0.0, 0.0, 0.0, 0.0, 0.0
    for c in range(columns.shape[2]):
        seen = N[e, 0] * columns[e, n, c, 0] + N[e, 1] * columns[e, n, c, 1] + N[e, 2] * columns[e, n, c, 2]
        seen += N[e, 3] * columns[e, n, c, 3] + N[e, 4] * columns[e, n, c, 4] + N[e, 5] * columns[e, n, c, 5]
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
    return min(math.sqrt(shape), spread + math.sqrt(slide) + math.sqrt(swing)) + slack


@part
def _swung(v: Vector, angles: Vector, theta: float) -> float:
    """Bound of |ε × v| for all ε in a box of half-widths `angles`, |ε| ≤ θ."""
    x, y, z = abs(v[0]), abs(v[1]), abs(v[2])
    sides = (y * angles[2] + z * angles[1], z * angles[0] + x * angles[2], x * angles[1] + y * angles[0])
    return min(_size(sides), theta * _size(v))


@part
def _straight(table: Array, k: int, X: Array, twist: Array, half: Array, n: int) -> float:
    """The remainder of a row without b."""
    turn, angles, u = _three(twist, n, 3), _three(half, n, 3), _three(table, k, 3)
    theta, w = _size(angles), _three(X, 0, 0)
    swept = _size(_cross(turn, w))
    most = max(_swung(w, angles, theta), _swung(_three(X, 1, 0), angles, theta)) + 0.5 * theta * swept
    left = 0.5 * (min(most, theta * _size(w)) + swept)
    return _swung(u, angles, theta) * left + _size(_cross(turn, u)) * (0.125 * swept)


@part
def _drawn(u: Vector, a: Vector, sign: float, w: Vector, b: Vector, y: Vector, offset: Vector, angles: Vector) -> float:
    """The most of a bilinear row's Hessian at an end: ½ ε·G ε and ε·[β]× A d over the box of the errors."""
    trace, found = _dot(u, w) + _dot(b, y), 0.0
    for i in range(3):
        found += 0.5 * abs(trace - w[i] * u[i] - b[i] * y[i]) * angles[i] * angles[i]
        for j in range(i):
            found += 0.5 * abs(w[i] * u[j] + b[i] * y[j] + w[j] * u[i] + b[j] * y[i]) * angles[i] * angles[j]
    columns = (sign, a[2], -a[1]), (-a[2], sign, a[0]), (a[1], -a[0], sign)
    for j in range(3):
        mixed = _cross(b, columns[j])
        found += offset[j] * (abs(mixed[0]) * angles[0] + abs(mixed[1]) * angles[1] + abs(mixed[2]) * angles[2])
    return found


@part
def _bent(table: Array, k: int, X: Array, twist: Array, half: Array, n: int) -> float:
    """The remainder of a bilinear row."""
    move, turn, u = _three(twist, n, 0), _three(twist, n, 3), _three(table, k, 3)
    offset, angles, a = _three(half, n, 0), _three(half, n, 3), _three(table, k, 12)
    sign, theta, tau = table[k, 19], _size(angles), _size(turn)
    size = table[k, 20] + max(_size(_three(X, 0, 6)), _size(_three(X, 1, 6)))
    x, y, z = abs(a[0]), abs(a[1]), abs(a[2])
    sides = (z * offset[1] + y * offset[2], z * offset[0] + x * offset[2], y * offset[0] + x * offset[1])
    felt = _size(_beside(abs(sign), offset, sides))
    slid = _beside(sign, move, _cross(a, move))
    seen, second, chord, turning = _size(slid), 0.0, 0.0, 0.0
    for e in range(2):
        w, b, r = _three(X, e, 0), _three(X, e, 3), _three(X, e, 6)
        second = max(second, _drawn(u, a, sign, w, b, r, offset, angles))
        pulled, trace = _cross(turn, b), _dot(u, w) + _dot(b, r)
        spun = _beside(trace, turn, _beside(-_dot(u, turn), w, _beside(-_dot(r, turn), b, (0.0, 0.0, 0.0))))
        moving, spinning = _beside(sign, pulled, _cross(pulled, a)), _beside(-1.0, spun, _cross(b, slid))
        chord = max(chord, abs(_dot(moving, move) + _dot(spinning, turn)))
        for i in range(3):
            turning += abs(moving[i]) * offset[i] + abs(spinning[i]) * angles[i]
    chord = 0.125 * chord + tau**2 * (tau * size + 3.0 * seen) / 16.0
    third = theta**2 * ((theta / 6.0 + 0.25 * tau) * size + 0.5 * felt + 0.25 * seen) + 0.5 * theta * tau * felt
    third += 0.125 * tau * (theta * tau * size + tau * felt + 2.0 * theta * seen)
    coarse = (0.5 * theta**2 + tau**2 / 8.0 + 0.5 * tau * theta) * size
    coarse += (theta + 0.5 * tau) * felt + (0.25 * tau + 0.5 * theta) * seen
    return float(min(second + chord + 0.25 * turning + third, coarse))


@part
def _left(table: Array, k: int, bent: bool, X: Array, motion: Motion, n: int) -> float:
    """The remainder of row k over a piece of motion."""
    twist, half, coupling = motion.twist, motion.half, motion.coupling
    size = table[k, 20]
    if bent:
        size += max(_size(_three(X, 0, 6)), _size(_three(X, 1, 6)))
    found = _bent(table, k, X, twist, half, n) if bent else _straight(table, k, X, twist, half, n)
    return float(found + coupling[n, 0] + coupling[n, 1] * size)


@compiled
def over(rows: Functions, motion: Motion) -> tuple[Array, Array, Array, Array]:
    """Rows (k) over pieces of motion (n).

    Returns:
        at both ends values (2, n, k) and gradients (2, n, k, 6), how far errors reach along these (2, n, k); and the
        remainders (n, k). In m and m/rad.
    """
    p, R, columns, cuts, (table, bilinear) = motion.p, motion.R, motion.columns, motion.cuts, rows
    n, k = p.shape[1], len(table)
    f, N, reach, rest = np.empty((2, n, k)), np.empty((2, n, k, 6)), np.empty((2, n, k)), np.empty((n, k))
    slope, X = np.empty((2, 6)), np.zeros((2, 9))
    for piece in range(n):
        for row in range(k):
            bent = bilinear[row]
            for e in range(2):
                f[e, piece, row] = _value(table, row, bent, p, R, e, piece, slope, X)
                reach[e, piece, row] = _reach(slope, columns, cuts, e, piece)
                for i in range(6):
                    N[e, piece, row, i] = slope[e, i]
            rest[piece, row] = _left(table, row, bent, X, motion, piece)
    return f, N, reach, rest


@part
def _bounds(
    table: Array,
    k: int,
    bent: bool,
    motion: Motion,
    n: int,
    N: Array,
    X: Array,
) -> tuple[float, float]:
    """The least value of row k without errors, and with them."""
    p, R, columns, cuts = motion.p, motion.R, motion.columns, motion.cuts
    start, goal = _value(table, k, bent, p, R, 0, n, N, X), _value(table, k, bent, p, R, 1, n, N, X)
    least = min(start - _reach(N, columns, cuts, 0, n), goal - _reach(N, columns, cuts, 1, n))
    return min(start, goal), least - _left(table, k, bent, X, motion, n)


@part
def _scales(edges: Array, motion: Motion, n: int, found: Array) -> None:
    """What all margins are divided by: upper bounds, at most 1, of the lengths of the witnesses' normals."""
    turning, R = _size(_three(motion.half, n, 3)) + _size(_three(motion.twist, n, 3)), motion.R
    for w in range(len(edges)):
        moving = (edges[w, 0, 0], edges[w, 0, 1], edges[w, 0, 2])
        fixed = (edges[w, 1, 0], edges[w, 1, 1], edges[w, 1, 2])
        found[w] = 1.0
        if fixed != (0.0, 0.0, 0.0):
            start, goal = _cross(_turned(R, 0, n, moving), fixed), _cross(_turned(R, 1, n, moving), fixed)
            found[w] = min(1.0, max(_size(start), _size(goal)) + turning)


@part
def _room(
    table: Array,
    bilinear: Mask,
    surely: Mask,
    first: int,
    last: int,
    p: Array,
    R: Array,
    n: int,
    least: float,
    N: Array,
    X: Array,
) -> float:
    """The least value without errors among rows that surely count, or some value below `least`."""
    found = np.inf
    for k in range(first, last):
        if surely[k]:
            start = _value(table, k, bilinear[k], p, R, 0, n, N, X)
            found = min(found, start, _value(table, k, bilinear[k], p, R, 1, n, N, X))
            if found < least:
                break
    return found


@part
def _count(
    w: int, rows: Functions, witnesses: Witnesses, motion: Motion, n: int, which: Mask, N: Array, X: Array
) -> None:
    """Which rows of a witness count, given their lower bounds."""
    table, bilinear = rows
    first, count = witnesses.begins[w], witnesses.begins[w + 1] - witnesses.begins[w]
    for k in range(count):
        which[k] = k < witnesses.always[w]
    for o in range(len(witnesses.onto)):
        if witnesses.onto[o, 0] == w:
            k = first + witnesses.onto[o, 1]
            if _bounds(table, k, bilinear[k], motion, n, N, X)[1] > 0.0:
                which[witnesses.onto[o, 2]] = True
                for i in range(count):
                    which[i] &= not witnesses.behind[o, i]


@part
def _margin(
    w: int,
    rows: Functions,
    witnesses: Witnesses,
    scale: float,
    motion: Motion,
    n: int,
    least: float,
    which: Mask,
    N: Array,
    X: Array,
) -> tuple[float, float]:
    """Margin and clearance of a witness; of one that cannot have a margin of `least`, some margin below that."""
    _count(w, rows, witnesses, motion, n, which, N, X)
    (table, bilinear), first = rows, witnesses.begins[w]
    margin, clearance = np.inf, np.inf
    for k in range(first, witnesses.begins[w + 1]):
        if which[k - first]:
            nominal, lower = _bounds(table, k, bilinear[k], motion, n, N, X)
            margin, clearance = min(margin, lower / scale), min(clearance, nominal / scale)
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
    rows: Functions, witnesses: Witnesses, motion: Motion, least: Array, grazing: float
) -> tuple[Places, Array, Array]:
    """The first witness of each pair (m) with the largest margin over pieces of motion (n).

    No margin exceeds its witness's room: those with less of that than the best so far are left out.

    Args:
        rows: of all witnesses.
        witnesses: how they are listed.
        motion: the pieces.
        least: margins (n, m) that are asked for, m.
        grazing: how far nominal distances may be below zero, m.

    Returns:
        witnesses (n, m), −1 where none is good enough, their margins and their clearances, m.
    """
    (table, bilinear), p, R = rows, motion.p, motion.R
    begins, all_places, surely = witnesses.begins, witnesses.places, witnesses.surely
    count, pairs = p.shape[1], len(all_places)
    found, margins = np.empty((count, pairs), dtype=np.intp), np.empty((count, pairs))
    clearances, rooms = np.empty((count, pairs)), np.empty(all_places.shape[1])
    scales, which = np.empty(len(begins) - 1), np.empty(len(table), dtype=np.bool_)
    N, X = np.empty((2, 6)), np.empty((2, 9))
    for n in range(count):
        _scales(witnesses.edges, motion, n, scales)
        for m in range(pairs):
            most, at = least[n, m], len(rooms)
            found[n, m], margins[n, m], clearances[n, m] = -1, -np.inf, -np.inf
            for i in range(len(rooms)):
                w = all_places[m, i]
                if i > 0 and w == all_places[m, i - 1]:
                    rooms[i] = -np.inf
                else:
                    enough, last = scales[w] * max(most, -grazing), begins[w + 1]
                    room = _room(table, bilinear, surely, begins[w], last, p, R, n, enough, N, X)
                    rooms[i] = room / scales[w]
            i = _widest(rooms)
            while rooms[i] >= max(most, -grazing):
                w, rooms[i] = all_places[m, i], -np.inf
                margin, clear = _margin(w, rows, witnesses, scales[w], motion, n, most, which, N, X)
                if clear >= -grazing and (margin > most or (margin == most and i < at)):
                    at, most, found[n, m], margins[n, m], clearances[n, m] = i, margin, w, margin, clear
                i = _widest(rooms)
    return found, margins, clearances
