"""Kernels: the nearest twist that opens contacts against their friction.

Twists v (6,) that open a contact by some measure against sliding to any side e, vₙ + μ e·vₜ ≥ least, are cut out by the
half-spaces of rays vₙ + μ e·vₜ: a few of each contact to begin with, then those against the sliding of the answer so
far. The nearest twist of so many half-spaces comes by the dual method of Goldfarb and Idnani: the worst broken row
joins those that hold with equality, and rows whose multipliers go to zero on the way leave.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from fmopt.compiled import compiled, part
from fmopt.values import Array

Places = NDArray[np.intp]

_RAYS = 8  # of each cone, to begin with
_ROUNDS = 50
_STEPS = 400
_EXACT = 5e-10  # of the wrench, by which the answer may open contacts too little
_BROKEN = 1e-12  # of it, by which rows may be broken
_ALONG = 1e-10  # of a row: the part that is free of others is none


@compiled
def nearest_opening(wrench: Array, normal: Array, tangent: Array, least: float) -> tuple[Array, bool]:
    """The scaled twist (6,) nearest to a scaled wrench that opens each contact by `least`, and whether it is settled.

    Args:
        wrench: (6,).
        normal: (m, 6), normal velocity at a contact point for a scaled twist, positive where the contact opens.
        tangent: (m, 2, 6), its sliding velocity times the coefficient of friction.
        least: by how much contacts open.
    """
    m, count = len(normal), len(normal) * _RAYS
    rows = np.empty((count + m * _ROUNDS, 6))
    for k in range(count):
        angle = 2.0 * math.pi * (k % _RAYS) / _RAYS
        _ray(normal, tangent, k // _RAYS, math.cos(angle), math.sin(angle), rows, k)
    twist, held, force = wrench.copy(), np.zeros(7, dtype=np.intp), np.zeros(6)
    for _ in range(_ROUNDS):
        settled = nearest(wrench, rows, count, least, twist, held, force)
        short = least - _EXACT * math.sqrt(max(_dot(twist, twist), _dot(wrench, wrench)))
        before = count
        for i in range(m):
            x, y = _dot(tangent[i, 0], twist), _dot(tangent[i, 1], twist)
            sliding = math.sqrt(x * x + y * y)
            if _dot(normal[i], twist) - sliding < short:
                back = -1.0 / sliding if sliding > 0.0 else 0.0
                _ray(normal, tangent, i, back * x, back * y, rows, count)
                count += 1
        if count == before or not settled:
            return twist, settled
    return twist, False


@part
def nearest(point: Array, rows: Array, count: int, least: float, twist: Array, held: Places, force: Array) -> bool:
    """Moves a twist to the nearest one to a point with rows·v ≥ least, from the nearest for rows that are held already.

    Args:
        point: (6,).
        rows: (…, 6), the first `count` of which count.
        count: of rows.
        least: what each comes to.
        twist: (6,), moved.
        held: (7,), up to six rows that hold with equality, updated; the last entry is how many.
        force: (6,), their multipliers, not negative, updated.

    Returns:
        Whether it is settled: not where rows contradict each other, or the steps come to no end.
    """
    free, back, basis, mixed = np.empty(6), np.empty(6), np.empty((6, 6)), np.empty((6, 7))
    for _ in range(_STEPS):
        most, worst = -_BROKEN * math.sqrt(max(_dot(twist, twist), _dot(point, point))), count
        for i in range(count):
            gap = _dot(rows[i], twist) - least
            if gap < most:
                most, worst = gap, i
        if worst == count:
            return True
        push, number = 0.0, held[6]
        while True:
            _split(rows, worst, held, number, basis, mixed, free, back)
            step, leaving, whole, size = math.inf, -1, math.inf, _dot(free, free)
            for j in range(number):
                if back[j] > 0.0 and force[j] < step * back[j]:
                    step, leaving = force[j] / back[j], j
            if number < 6 and size > _ALONG * _ALONG * _dot(rows[worst], rows[worst]):
                whole = max(least - _dot(rows[worst], twist), 0.0) / size
                for x in range(6):
                    twist[x] += min(step, whole) * free[x]
            elif leaving < 0:
                return False
            push += min(step, whole)
            for j in range(number):
                force[j] = max(force[j] - min(step, whole) * back[j], 0.0)
            if whole <= step:
                break
            number -= 1
            for j in range(leaving, number):
                held[j], force[j] = held[j + 1], force[j + 1]
        held[number], force[number], held[6] = worst, push, number + 1
    return False


@part
def _split(
    rows: Array, row: int, held: Places, number: int, basis: Array, mixed: Array, free: Array, back: Array
) -> None:
    """The part `free` (6,) of a row that is free of held rows, and the sum `back` of these that the rest is."""
    for j in range(number + 1):
        k = held[j] if j < number else row
        for x in range(6):
            free[x] = rows[k, x]
        for i in range(number):
            mixed[i, j] = 0.0
        for _ in range(2):  # once leaves too much of rows that are hardly apart
            for i in range(j):
                along = _dot(basis[i], free)
                mixed[i, j] += along
                for x in range(6):
                    free[x] -= along * basis[i, x]
        if j < number:
            mixed[j, j] = math.sqrt(_dot(free, free))
            for x in range(6):
                basis[j, x] = free[x] / mixed[j, j]
    for j in range(number - 1, -1, -1):
        back[j] = mixed[j, number]
        for i in range(j + 1, number):
            back[j] -= mixed[j, i] * back[i]
        back[j] /= mixed[j, j]


@part
def _ray(normal: Array, tangent: Array, contact: int, x: float, y: float, rows: Array, place: int) -> None:
    """What a twist opens a contact by against sliding to a side (x, y), as a row."""
    for k in range(6):
        rows[place, k] = normal[contact, k] + x * tangent[contact, 0, k] + y * tangent[contact, 1, k]


@part
def _dot(a: Array, b: Array) -> float:
    return float(a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3] + a[4] * b[4] + a[5] * b[5])
