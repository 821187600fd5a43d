"""Vectors of three numbers in kernels."""

import math
from typing import TypeAlias

from fmopt.runtime.compiled import part
from fmopt.spatial.values import Array, Indices

Vector: TypeAlias = tuple[float, float, float]


@part
def vector(x: Array) -> Vector:
    """Three numbers (3,)."""
    return x[0], x[1], x[2]


@part
def halves(x: Array) -> tuple[Vector, Vector]:
    """Six numbers (6,) as two vectors."""
    return (x[0], x[1], x[2]), (x[3], x[4], x[5])


@part
def row(rows: Array, i: int) -> Vector:
    """A row of an array (n, 3) as three numbers, of which a kernel keeps none in memory."""
    return rows[i, 0], rows[i, 1], rows[i, 2]


@part
def cross(a: Vector, b: Vector) -> Vector:
    """a × b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@part
def dot(a: Vector, b: Vector) -> float:
    """a·b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@part
def size(a: Vector) -> float:
    """|a|."""
    return math.sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2])


@part
def plus(a: Vector, share: float, b: Vector) -> Vector:
    """a + share b."""
    return a[0] + share * b[0], a[1] + share * b[1], a[2] + share * b[2]


@part
def turned(R: Array, a: Vector) -> Vector:
    """R a, R (3, 3) or the first columns of more."""
    return (
        R[0, 0] * a[0] + R[0, 1] * a[1] + R[0, 2] * a[2],
        R[1, 0] * a[0] + R[1, 1] * a[1] + R[1, 2] * a[2],
        R[2, 0] * a[0] + R[2, 1] * a[1] + R[2, 2] * a[2],
    )


@part
def reach_along(a: Vector, shifts: Array, b: Vector, turns: Array, cuts: Indices) -> float:
    """How far errors reach along a and b, by columns (c, 3) of both: spread, slide, swing, shape, then slack."""
    spread, slide, swing, shape, slack = 0.0, 0.0, 0.0, 0.0, 0.0
    for c in range(len(shifts)):
        seen = dot(a, row(shifts, c)) + dot(b, row(turns, c))
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
    # Both bounds hold of every error, so that the smaller one does; slack is outside of both.
    return min(math.sqrt(shape), spread + math.sqrt(slide) + math.sqrt(swing)) + slack


@part
def turned_back(R: Array, a: Vector) -> Vector:
    """Rᵀ a."""
    return (
        R[0, 0] * a[0] + R[1, 0] * a[1] + R[2, 0] * a[2],
        R[0, 1] * a[0] + R[1, 1] * a[1] + R[2, 1] * a[2],
        R[0, 2] * a[0] + R[1, 2] * a[1] + R[2, 2] * a[2],
    )


@part
def swung(a: Vector, angles: Vector, theta: float) -> float:
    """Bound of |ε × a| for an arm a, m, and all ε in a box of half-widths `angles`, rad, with |ε| ≤ θ."""
    x, y, z = abs(a[0]), abs(a[1]), abs(a[2])
    # The cross product bounded component by component, and as a whole: either may be the smaller one.
    sides = (y * angles[2] + z * angles[1], z * angles[0] + x * angles[2], x * angles[1] + y * angles[0])
    return min(size(sides), theta * size(a))
