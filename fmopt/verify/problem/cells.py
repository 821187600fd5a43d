"""Convex cells in fixed point, cut by planes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

from fmopt.verify.arithmetic.rational import BITS, ONE, Vector, cross, dot, fixed, length, number, over, sub

DEVIATION = 1e-10  # m: a point so close to a plane lies on it, and a cell no thicker than this is none
_NEAR = fixed(DEVIATION)
_FLAT = ONE >> 60  # 1e-18 m²: what encloses less has no normal


@dataclass(frozen=True)
class Plane:
    """The half-space n·x ≤ o behind a plane, n of unit length."""

    n: Vector
    o: int


@dataclass(frozen=True)
class Cell:
    """A convex polyhedron: its corners, the loop of each face, and the box around it."""

    corners: tuple[Vector, ...]
    faces: tuple[tuple[int, ...], ...]
    low: Vector
    high: Vector


def cell_of(corners: Sequence[Vector], faces: Sequence[Sequence[int]]) -> Cell:
    """A cell of corners and faces; corners of no face are left out.

    Args:
        corners: in fixed point, m.
    """
    used = {index: k for k, index in enumerate(dict.fromkeys(index for face in faces for index in face))}
    points = tuple(corners[index] for index in used)
    columns = tuple(zip(*points, strict=True))
    low, high = (tuple(pick(column) for column in columns) for pick in (min, max))
    loops = tuple(tuple(used[index] for index in face) for face in faces)
    return Cell(points, loops, (low[0], low[1], low[2]), (high[0], high[1], high[2]))


def box_cell(low: Vector, high: Vector) -> Cell:
    """The cell between two corners.

    Args:
        low, high: the least and the greatest coordinates, m.
    """
    corners = [(x, y, z) for z in (low[2], high[2]) for y in (low[1], high[1]) for x in (low[0], high[0])]
    faces = ((0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5))
    return cell_of(corners, faces)


def plane_of(loop: Sequence[Vector], inside: Vector) -> Plane | None:
    """The plane of a loop of points, with a point behind it; None where the loop encloses nothing."""
    a = b = c = 0
    first = loop[0]
    for one, two in pairwise(loop[1:]):
        x, y, z = cross(sub(one, first), sub(two, first))
        a, b, c = a + x, b + y, c + z
    size = length((a, b, c))
    if size < _FLAT:
        return None
    n: Vector = (over(a, size), over(b, size), over(c, size))
    o = sum(dot(n, p) for p in loop) // len(loop)
    if dot(n, inside) > o:
        return Plane((-n[0], -n[1], -n[2]), -o)
    return Plane(n, o)


def heights(cell: Cell, plane: Plane) -> list[int]:
    """How far the corners of a cell lie before a plane."""
    (a, b, c), o = plane.n, plane.o
    whole = o << BITS
    return [(a * x + b * y + c * z - whole) >> BITS for x, y, z in cell.corners]


def is_behind(found: Sequence[int]) -> bool:
    """Whether all of these heights are behind the plane, or on it."""
    return max(found) <= _NEAR


def is_before(found: Sequence[int]) -> bool:
    """Whether all of these heights are before the plane, or on it."""
    return min(found) >= -_NEAR


def cut(cell: Cell, plane: Plane) -> tuple[Cell | None, Cell | None]:
    """What of a cell is behind a plane, and what is before it."""
    found = heights(cell, plane)
    if is_behind(found):
        return cell, None
    if is_before(found):
        return None, cell
    return _kept(cell, found, plane), _kept(cell, [-h for h in found], plane)


def _kept(cell: Cell, found: Sequence[int], plane: Plane) -> Cell:
    """What of a cell has no height above zero."""
    corners, faces = [*cell.corners], list[Sequence[int]]()
    crossings: dict[tuple[int, int], int] = {}
    rim: dict[int, None] = {}
    for face in cell.faces:
        loop = list[int]()
        for a, b in zip(face, face[1:] + face[:1], strict=True):
            if found[a] <= _NEAR:
                loop.append(a)
            if (found[a] < -_NEAR and found[b] > _NEAR) or (found[a] > _NEAR and found[b] < -_NEAR):
                # Both faces at an edge get one corner, computed the same way round: the cell stays closed.
                edge = (a, b) if a < b else (b, a)
                if edge not in crossings:
                    crossings[edge] = len(corners)
                    corners.append(_crossing(cell, found, *edge))
                loop.append(crossings[edge])
        on = [k for k in loop if k >= len(cell.corners) or found[k] >= -_NEAR]
        rim |= dict.fromkeys(on)
        # A face that lies in the plane is left to the rim.
        if len(loop) >= 3 and len(on) < len(loop):
            faces.append(loop)
    if len(rim) >= 3:
        faces.append(_around(corners, list(rim), plane.n))
    return cell_of(corners, faces)


def _crossing(cell: Cell, found: Sequence[int], a: int, b: int) -> Vector:
    p, q = cell.corners[a], cell.corners[b]
    share, whole = found[a], found[a] - found[b]
    x, y, z = sub(q, p)
    return (p[0] + x * share // whole, p[1] + y * share // whole, p[2] + z * share // whole)


def _around(corners: Sequence[Vector], rim: list[int], n: Vector) -> list[int]:
    """Corners of a convex polygon across n, in order around it."""
    across = min(range(3), key=lambda k: abs(n[k]))
    u = cross(n, (ONE if across == 0 else 0, ONE if across == 1 else 0, ONE if across == 2 else 0))
    v = cross(n, u)
    x, y, z = (sum(corners[k][axis] for k in rim) // len(rim) for axis in range(3))
    arms = {k: sub(corners[k], (x, y, z)) for k in rim}
    return sorted(rim, key=lambda k: math.atan2(number(dot(v, arms[k])), number(dot(u, arms[k]))))
