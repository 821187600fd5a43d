"""Searches on C-surfaces, pose by pose, compiled: where what is short falls no further, and where contacts touch.

What contacts and their bounds ask of a pose is told in `fmopt.contact.realisation`; here is the arithmetic of it.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fmopt.contact.kernels_generated import Tables, height, number_of, regularity, wrench
from fmopt.runtime.compiled import compiled, part
from fmopt.spatial.kernels import Vector, cross, dot
from fmopt.spatial.values import Array, Bits

Numbers = NDArray[np.int64]

_ROUNDS = 90
_NOTHING = 1e-11  # scaled units; a shortage of no more is none
_LEVEL = 1e-7  # slope of the shortage below which it cannot fall any further
_PAUSE = 10  # rounds after which it is compared with what it was
_DAMPING = 1e-2  # before the start, which is better than nothing, takes a tenth of it
_FARTHEST = 8.0  # scaled units that one step may go
_POLISH = 5
_TOUCHING = 1e-12  # scaled units; contacts that are this near to touching are not moved nearer
_FAR = 1.0  # m; how far from each other edges count that are level and cross nowhere
_PARALLEL = 1e-16  # squared sine between edges that are level
_FLAT = 1e-5  # relative size of a singular value that counts as none
_SWEEPS = 16
_SQUARE = 1e-15  # cosine between rows that are perpendicular


class Functions(NamedTuple):
    """The functions of k contacts of a local space, of l bounds that end them, and of the space's limits.

    Attributes:
        tables: records of the C-surfaces of each kind; see `fmopt.contact.c_surface.Surfaces`. All of them together are
            numbered in that order.
        own: (k,), the surface of each contact.
        bounds: the surface of each bound (l,), the signs (l,), where they are in the clauses of each contact
            (k, clauses, alternatives, bounds together), see `contact.facet_bounds.BoundTable`, and the contact that
            begins at each bound (l + 2,), −1 for none.
        limits: (7, w), a column of each limit's unit row and offset.
        scale: (6,), scaled units in m and rad.
        T: (3, 4), the pose at which local coordinates are zero: its rotation, and its position beside it in m.
    """

    tables: Tables
    own: Numbers
    bounds: tuple[Numbers, Numbers, Numbers, Numbers]
    limits: Array
    scale: Array
    T: Array


class _Shortfall(NamedTuple):
    """What is short at a pose: values f of all surfaces, which of them are asked to be elsewhere and how, x, beyond.

    `asked` has a row for each that is: the surface, the sign and the shortage. `beyond` is how far the pose is beyond
    each limit, ≤ 0.
    """

    f: Array
    asked: Array
    x: Array
    beyond: Array


@compiled
def descended(at: Functions, on: Bits, T: Array, room: float) -> tuple[Array, Array, Bits]:
    """Levenberg–Marquardt from each of n starts: poses (n, 3, 4), what is short there (n,), and whether that is final.

    Contacts `on` (n, k) are to touch; starts T (n, 3, 4) are rotations, and positions beside them in m.
    """
    n, k = on.shape
    found, size, final = np.zeros((n, 3, 4)), np.zeros(n), np.zeros(n, np.bool_)
    work = _Shortfall(np.zeros(number_of(at.tables)), np.zeros((2 * k, 3)), np.zeros(6), np.zeros(at.limits.shape[1]))
    slope, square, step, L, trial = np.zeros(6), np.zeros((6, 6)), np.zeros(6), np.zeros((6, 6)), np.zeros((3, 4))
    for i in range(n):
        damping, now, then = _DAMPING, np.inf, np.inf
        trial[:] = T[i]
        for tried in range(_ROUNDS):
            new, count = _short(at, on[i], trial, room, work)
            better = new < now
            damping = min(max((0.1 if better else 10.0) * damping, 1e-14), 1e8)
            if better:
                now = new
                found[i] = trial
                _pull(at, trial, count, work, slope, square)
            final[i] = now <= _NOTHING or _length(slope) <= _LEVEL * now
            if tried % _PAUSE == _PAUSE - 1:
                # What it comes to after more pauses that take as large a share as the last.
                left = now * (now / then) ** ((_ROUNDS - tried) / _PAUSE) if then < np.inf else 0.0
                final[i] = final[i] or left > _NOTHING
                then = now
            if final[i]:
                break
            _solve(square, damping, slope, L, step)
            _move(at.scale, step, found[i], trial)
        size[i] = now
    return found, size, final


@compiled
def projected(at: Functions, on: Bits, T: Array, rank: Numbers) -> Array:
    """The nearest poses (n, 3, 4) to T (n, 3, 4) where contacts `on` (n, k) touch, by Gauss–Newton with shortest steps.

    A step uses at most `rank` (n,) singular directions, and is shortest in scaled units.
    """
    n, k = on.shape
    found = np.zeros((n, 3, 4))
    rows, row, step, trial = np.zeros((6, 7)), np.zeros(7), np.zeros(6), np.zeros((3, 4))
    for i in range(n):
        trial[:] = T[i]
        for tried in range(_POLISH + 1):
            found[i] = trial
            worst = 0.0
            rows[:] = 0.0
            for j in range(k):
                if on[i, j]:
                    row[6] = _surface(at.tables, at.own[j], trial, row)
                    worst = max(worst, abs(row[6]))
                    row[:6] *= at.scale
                    _rotate_in(rows, row)
            if tried == _POLISH or worst <= _TOUCHING * at.scale[0]:
                break
            _shortest(rows, rank[i], step)
            _move(at.scale, step, found[i], trial)
    return found


@compiled
def heights(at: Functions, T: Array) -> Array:
    """Signed distances (n, m) of all C-surfaces at poses (n, 3, 4), m; far where edges are level."""
    found = np.zeros((len(T), number_of(at.tables)))
    for i in range(len(T)):
        _heights(at.tables, T[i], found[i])
    return found


@part
def _short(at: Functions, on: Bits, T: Array, room: float, work: _Shortfall) -> tuple[float, int]:
    """How much is short at a pose for a state with contacts `on` (k,), and how many surfaces are asked to be elsewhere.

    These, and all else that `_pull` needs, are left in `work`.
    """
    f, asked, unit, count = work.f, work.asked, at.scale[0], 0
    ends, signs = at.bounds[0], at.bounds[1]
    _heights(at.tables, T, f)
    total = _exceed(at.limits, at.scale, at.T, T, work.x, work.beyond)
    for i in range(len(on)):
        number, height = at.own[i], f[at.own[i]]
        if on[i]:
            asked[count, 0], asked[count, 1], asked[count, 2] = number, 1.0, height / unit
            total += asked[count, 2] ** 2
            count += 1
        elif height >= unit * room:
            continue
        inside, bound, ended = _innermost(at.bounds, i, f, on)
        short = (inside if on[i] else max(-inside, height)) / unit - room
        if short < 0.0 and (on[i] or not ended):
            asked[count, 0], asked[count, 1], asked[count, 2] = number, 1.0, short
            if on[i] or -inside > height:
                asked[count, 0], asked[count, 1] = ends[bound], -signs[bound] if on[i] else signs[bound]
            total += short**2
            count += 1
    return math.sqrt(total), count


@part
def _innermost(
    bounds: tuple[Numbers, Numbers, Numbers, Numbers], i: int, f: Array, on: Bits
) -> tuple[float, int, bool]:
    """How far inside its bounds contact i is, m, which bound that is, and whether it ends where one of `on` begins."""
    ends, signs, places, beginning = bounds
    inside, bound, ended = np.inf, 0, False
    for c in range(places.shape[1]):
        best, which = -np.inf, 0
        for a in range(places.shape[2]):
            least, tight = np.inf, places[i, c, a, 0]
            for n in range(places.shape[3]):
                b = places[i, c, a, n]
                depth = -signs[b] * f[ends[b]] if b < len(signs) else (np.inf if b == len(signs) else -np.inf)
                if depth < least:
                    least, tight = depth, b
            if a == 0 or least > best:
                best, which = least, tight
        if best < inside:
            inside, bound = best, which
        ended = ended or (beginning[which] >= 0 and on[beginning[which]])
    return inside, bound, ended


@part
def _exceed(limits: Array, scale: Array, T0: Array, T: Array, x: Array, beyond: Array) -> float:
    """How far a pose is beyond each limit (w,) of the local space, ≤ 0, into `beyond`; returns the sum of squares."""
    for i in range(3):
        n, o = (i + 1) % 3, (i + 2) % 3
        x[i] = (T[i, 3] - T0[i, 3]) / scale[i]
        x[3 + i] = 0.0
        for j in range(3):
            x[3 + i] += 0.5 * (T[o, j] * T0[n, j] - T[n, j] * T0[o, j])
    sine = min(_length(x[3:]), 1.0)
    ratio = math.asin(sine) / sine if sine > 1e-6 else 1.0
    for i in range(3, 6):
        x[i] *= ratio / scale[i]
    beyond[:] = -limits[6]
    for i in range(6):
        beyond += limits[i] * x[i]
    beyond[:] = np.minimum(beyond, 0.0)
    return float((beyond * beyond).sum())


@part
def _pull(at: Functions, T: Array, count: int, work: _Shortfall, slope: Array, square: Array) -> None:
    """Jᵀr (6,) into `slope` and the lower half of JᵀJ (6, 6) into `square`, scaled, of what `_short` found."""
    scale, asked, beyond, row = at.scale, work.asked, work.beyond, work.x
    slope[:], square[:] = 0.0, 0.0
    for n in range(count):
        _surface(at.tables, int(asked[n, 0]), T, row)
        row *= asked[n, 1] / scale[0] * scale
        _add(row, asked[n, 2], slope, square)
    for w in range(len(beyond)):
        if beyond[w] < 0.0:
            row[:] = at.limits[:6, w]
            _add(row, beyond[w], slope, square)


@part
def _add(row: Array, r: float, slope: Array, square: Array) -> None:
    for a in range(6):
        slope[a] += row[a] * r
        for b in range(a + 1):
            square[a, b] += row[a] * row[b]


@part
def _solve(square: Array, damping: float, slope: Array, L: Array, step: Array) -> None:
    """The step (6,) with (JᵀJ + damping) step = −Jᵀr, by Cholesky factors, shortened where it goes too far."""
    for i in range(6):
        step[i] = -slope[i]
        for j in range(i):
            L[i, j] = square[i, j]
            for n in range(j):
                L[i, j] -= L[i, n] * L[j, n]
            L[i, j] /= L[j, j]
            step[i] -= L[i, j] * step[j]
        pivot = square[i, i] + damping
        for n in range(i):
            pivot -= L[i, n] ** 2
        L[i, i] = math.sqrt(max(pivot, damping))
        step[i] /= L[i, i]
    for i in range(5, -1, -1):
        for j in range(i + 1, 6):
            step[i] -= L[j, i] * step[j]
        step[i] /= L[i, i]
    step *= min(1.0, _FARTHEST / max(_length(step), _FARTHEST))


@part
def _rotate_in(rows: Array, row: Array) -> None:
    """Adds a row (7,) to an upper triangle (6, 7) by rotations, so that sums of squares stay what they are."""
    for j in range(6):
        size = math.sqrt(rows[j, j] ** 2 + row[j] ** 2)
        if size > 0.0:
            c, s = rows[j, j] / size, row[j] / size
            rows[j, j:], row[j:] = c * rows[j, j:] + s * row[j:], c * row[j:] - s * rows[j, j:]


@part
def _shortest(rows: Array, rank: int, step: Array) -> None:
    """The shortest step (6,) with A step = −f at least squares along the largest singular directions of A.

    Rows of (A, f) (6, 7) are rotated until those of A are perpendicular, by one-sided Jacobi rotations; then they are
    these directions.
    """
    size = np.zeros(6)
    for _ in range(_SWEEPS):
        square = True
        for i in range(6):
            for j in range(i + 1, 6):
                one, other = rows[i, :6], rows[j, :6]
                a, b, c = (one * one).sum(), (other * other).sum(), (one * other).sum()
                if abs(c) > _SQUARE * math.sqrt(a * b):
                    square = False
                    turn = (b - a) / (2.0 * c)
                    tangent = math.copysign(1.0, turn) / (abs(turn) + math.sqrt(1.0 + turn * turn))
                    cosine = 1.0 / math.sqrt(1.0 + tangent * tangent)
                    x, y = rows[i].copy(), rows[j].copy()
                    rows[i], rows[j] = cosine * (x - tangent * y), cosine * (tangent * x + y)
        if square:
            break
    largest = 0.0
    for i in range(6):
        step[i], size[i] = 0.0, _length(rows[i, :6])
        largest = max(largest, size[i])
    for i in range(6):
        larger = 0
        for j in range(6):
            larger += size[j] > size[i] or (size[j] == size[i] and j < i)
        if larger < rank and size[i] > _FLAT * largest:
            step -= rows[i, 6] * rows[i, :6] / size[i] ** 2


@part
def _move(scale: Array, step: Array, T: Array, moved: Array) -> None:
    """The pose at scaled local coordinates (6,) around another; see `fmopt.spatial.se3.turns`."""
    w = (scale[3] * step[3], scale[4] * step[4], scale[5] * step[5])
    square = dot(w, w)
    angle = max(math.sqrt(square), 1e-9)
    a, b = math.sin(angle) / angle, 2.0 * (math.sin(0.5 * angle) / angle) ** 2
    for j in range(3):
        column = T[0, j], T[1, j], T[2, j]
        aside, along = cross(w, column), dot(w, column)
        for i in range(3):
            moved[i, j] = (1.0 - b * square) * column[i] + a * aside[i] + b * along * w[i]
        moved[j, 3] = T[j, 3] + scale[j] * step[j]


@part
def _heights(tables: Tables, T: Array, f: Array) -> None:
    """Signed distances f of all C-surfaces at a pose, m; far where edges are level."""
    p = _position(T)
    for i in range(len(f)):
        f[i] = height(tables, i, p, T) if regularity(tables, i, p, T) > _PARALLEL else _FAR


@part
def _surface(tables: Tables, number: int, T: Array, row: Array) -> float:
    """The signed distance of a C-surface at a pose, m, and its gradient into the row's first six numbers.

    Far, and with no gradient, where edges are level.
    """
    p = _position(T)
    if regularity(tables, number, p, T) > _PARALLEL:
        return wrench(tables, number, p, T, row)
    row[:6] = 0.0
    return _FAR


@part
def _position(T: Array) -> Vector:
    return T[0, 3], T[1, 3], T[2, 3]


@part
def _length(x: Array) -> float:
    return math.sqrt((x * x).sum())
