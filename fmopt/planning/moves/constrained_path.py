"""Kernels: poses along a motion that keep contacts by their compliance, and the distances of other contacts there.

Functions of contacts to be kept come as rows of `certificate.rows.Forms` (r,), those of others as records of
`contact.c_surface.Surfaces`. A pose is shifted along the compliant twists until the functions vanish.
"""

import math

import numpy as np

from fmopt.certificate.kernels_rows import Table, value
from fmopt.contact.kernels_generated import Tables, height
from fmopt.runtime.compiled import compiled, part
from fmopt.spatial.kernels import vector
from fmopt.spatial.values import Array, Indices

_ROUNDS = 12  # of Newton's method, which doubles the digits in each once it is near
_ZERO, _KEPT = 1e-16, 1e-12  # m or rad, what is no more than rounding, and what still counts as kept
_ROOT_ROUNDS = 50
KEPT, SINGULAR, LOST = 0, 1, 2


@part
def _turn(w: Array, R: Array, found: Array) -> None:
    """Puts exp([w]×) R, for a rotation vector w (3,), rad, into `found`, which may be R."""
    square = w[0] * w[0] + w[1] * w[1] + w[2] * w[2]
    angle = math.sqrt(square)
    if angle < 1e-4:  # the terms left out, of fourth order, are below rounding
        a, b = 1.0 - square / 6.0, 0.5 - square / 24.0
    else:
        a, b = math.sin(angle) / angle, 2.0 * (math.sin(0.5 * angle) / angle) ** 2  # (1 − cos)/θ², not cancelling
    T = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            T[i, j] = b * w[i] * w[j]
        T[i, i] += 1.0 - b * square
    T[0, 1] -= a * w[2]
    T[1, 0] += a * w[2]
    T[0, 2] += a * w[1]
    T[2, 0] -= a * w[1]
    T[1, 2] -= a * w[0]
    T[2, 1] += a * w[0]
    for j in range(3):
        x, y, z = R[0, j], R[1, j], R[2, j]  # read before written, as `found` may be R
        for i in range(3):
            found[i, j] = T[i, 0] * x + T[i, 1] * y + T[i, 2] * z


@part
def _functions(table: Table, p: Array, R: Array, f: Array, N: Array) -> float:
    """Fills in values f (r,) and gradients N (r, 6) of functions at a pose, and returns the largest |f|."""
    largest = 0.0
    for i in range(len(table)):
        f[i], moving, turning, _ = value(table[i], vector(p), R)
        for j in range(3):
            N[i, j], N[i, 3 + j] = moving[j], turning[j]
        if math.isnan(f[i]):
            return math.inf
        largest = max(largest, abs(f[i]))
    return largest


@part
def _step(N: Array, C: Array, f: Array) -> bool:
    """Puts the solution of (N Cᵀ) x = f, N (r, 6), twists C (r, 6), into f (r,); whether there is one."""
    r = len(f)
    A = np.empty((r, r))
    for i in range(r):
        for j in range(r):
            total = 0.0
            for k in range(6):
                total += N[i, k] * C[j, k]
            A[i, j] = total
    for j in range(r):
        most = j
        for i in range(j + 1, r):
            if abs(A[i, j]) > abs(A[most, j]):
                most = i
        if A[most, j] == 0.0:
            return False
        for k in range(r):
            A[j, k], A[most, k] = A[most, k], A[j, k]
        f[j], f[most] = f[most], f[j]
        for i in range(j + 1, r):
            share = A[i, j] / A[j, j]
            for k in range(j + 1, r):
                A[i, k] -= share * A[j, k]
            f[i] -= share * f[j]
    for j in range(r - 1, -1, -1):
        for k in range(j + 1, r):
            f[j] -= A[j, k] * f[k]
        f[j] /= A[j, j]
    return True


@compiled
def onto(table: Table, C: Array, p: Array, R: Array) -> int:
    """Shifts poses along twists till functions vanish, by Newton's method.

    Args:
        table: rows (r,), the functions.
        C: (r, 6), m and rad.
        p: (n, 3), m, shifted in place.
        R: (n, 3, 3), shifted in place.

    Returns:
        `KEPT`, `SINGULAR` where the functions do not determine the shift, `LOST` where they do not come to vanish.
    """
    r = len(table)
    f, N, X = np.empty(r), np.empty((r, 6)), np.empty(6)
    for n in range(len(p)):
        for _ in range(_ROUNDS):
            if _functions(table, p[n], R[n], f, N) < _ZERO:
                break
            if not _step(N, C, f):
                return SINGULAR
            size = 0.0
            for k in range(6):
                X[k] = 0.0
                for i in range(r):
                    X[k] -= C[i, k] * f[i]
                size = max(size, abs(X[k]))
            if not size < 0.1:  # m or rad: beyond what gradients say anything of, or not a number
                break
            for k in range(3):
                p[n, k] += X[k]
            _turn(X[3:], R[n], R[n])
        if not _functions(table, p[n], R[n], f, N) < _KEPT:
            return LOST
    return KEPT


@compiled
def repeated(held: tuple[Table, Array], twist: Array, gives: Array, fresh: bool, p: Array, R: Array) -> int:
    """Fills in poses p (n + 1, 3), R (n + 1, 3, 3) after the first: a twist each, and compliance that keeps contacts.

    Held are functions of the contacts kept (r,) and their compliant twists (r, 6). The compliance in each (n, r) is a
    guess at first, if not `fresh`, where each piece begins with what the one before has found. The answer is as of
    `onto`.
    """
    table, C = held
    r = len(table)
    f, N, X = np.empty(r), np.empty((r, 6)), np.empty(6)
    for n in range(len(p) - 1):
        give = gives[n]
        if fresh and n > 0:
            for i in range(r):
                give[i] = gives[n - 1, i]
        found = False
        largest = 0.0
        for _ in range(_ROUNDS):
            for k in range(6):
                X[k] = twist[k]
                for i in range(r):
                    X[k] += C[i, k] * give[i]
            for k in range(3):
                p[n + 1, k] = p[n, k] + X[k]
            _turn(X[3:], R[n], R[n + 1])
            largest = _functions(table, p[n + 1], R[n + 1], f, N)
            found = largest < _ZERO
            if found:
                break
            if not _step(N, C, f):
                return SINGULAR
            size = 0.0
            for i in range(r):
                give[i] -= f[i]
                size = max(size, abs(give[i]))
            if not size < 1.0:
                break
        if not found and not largest < _KEPT:
            return LOST
    return KEPT


@compiled
def along(
    held: tuple[Table, Array], motion: tuple[Array, Array, Array, Array], amounts: Array, p: Array, R: Array
) -> int:
    """Fills in poses p (n, 3), R (n, 3, 3) after motions along a twist, contacts kept by their compliance.

    Held are functions of the contacts kept (r,) and their compliant twists (r, 6). The motion is a rotation (3, 3) at
    the beginning, the body point (3,) about which it turns, where that is then (3,), and the twist (6,), of which there
    are amounts (n,). The answer is as of `onto`.
    """
    begin, pivot, at, twist = motion
    X = np.empty(6)
    for n in range(len(amounts)):
        for k in range(6):
            X[k] = amounts[n] * twist[k]
        _turn(X[3:], begin, R[n])
        for j in range(3):
            arm = R[n, j, 0] * pivot[0] + R[n, j, 1] * pivot[1] + R[n, j, 2] * pivot[2]
            p[n, j] = at[j] + X[j] - arm
    return onto(held[0], held[1], p, R) if len(held[0]) else KEPT


@compiled
def roots(
    held: tuple[Table, Array],
    motion: tuple[Array, Array, Array, Array],
    tables: Tables,
    which: Indices,
    bracket: tuple[Array, Array],
    found: Array,
) -> int:
    """Fills in amounts (m,) at which distances vanish or jump, by Anderson and Björck's method of false position.

    In the bracket are two amounts, and the distances (2, m) there, the first positive, the second not. The answer is as
    of `onto`.
    """
    p, R, amount, (between, values) = np.empty((1, 3)), np.empty((1, 3, 3)), np.empty(1), bracket
    for n in range(len(which)):
        a, b, fa, fb = between[0], between[1], values[0, n], values[1, n]
        for _ in range(_ROOT_ROUNDS):
            c = b - fb * (b - a) / (fb - fa)
            amount[0] = c
            state = along(held, motion, amount, p, R)
            if state != KEPT:
                return state
            f = height(tables, which[n], p[0], R[0])
            if math.isnan(f):  # edges that turn level jump from one side to the other: they do so here
                b = c
                break
            short = 1.0 - f / fb if fb != 0.0 else 0.0
            if f * fb < 0.0:
                a, fa = b, fb
            else:
                # An end that stays counts for less: else chords would come near the root from one side only, slowly.
                fa *= short if short > 0.0 else 0.5
            settled = abs(c - b) <= 1e-16 + 1e-14 * abs(c) or f == 0.0
            b, fb = c, f
            if settled:
                break
        found[n] = b
    return KEPT
