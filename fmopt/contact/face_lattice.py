"""The face lattice of a pointed polyhedron from its corners and what lies on them: combinatorics alone.

Where each corner lies on no more half-spaces than there are dimensions, every subset of these is a face; else faces
are the closed sets of incidences. Corners and points are in scaled units, like those of the polyhedron.

The subsets of each of many sorted rows of digits, as a tree whose nodes come by length and in order.

A polytope whose corners lie on as many facets as it has dimensions has a face for each of them.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from fmopt.contact.closed_sets import closed_sets
from fmopt.runtime.compiled import compiled, part
from fmopt.spatial.values import Array

_NONE = np.uint64(0)

Bits = NDArray[np.bool_]
Numbers = NDArray[np.integer[Any]]

Places = NDArray[np.uint32]


def _keys(bits: Bits) -> NDArray[np.uint64]:
    """Words (w, n) that order bit rows (n, k), the first word and the first bit counting most."""
    packed = np.zeros((len(bits), -(-bits.shape[1] // 64) * 8), dtype=np.uint8)
    # Packed bits in big-endian words compare as the rows of bits do.
    packed[:, : -(-bits.shape[1] // 8)] = np.packbits(bits, axis=1)
    return packed.view(">u8").T.astype(np.uint64)


def ordered(active: Bits, dimensions: NDArray[np.intp]) -> NDArray[np.intp]:
    """The order (n,) of faces: largest dimension first, then by rows.

    Args:
        active: (n, k), the rows that hold with equality on each face.
        dimensions: (n,).
    """
    # `lexsort` takes the last key first.
    return np.lexsort((*_keys(~active)[::-1], -dimensions))


def distinct(bits: Bits) -> NDArray[np.intp]:
    """Where (l,) in a list of bit rows (n, k) each different one comes first, in their order."""
    keys = _keys(bits)
    order = np.lexsort(keys[::-1])
    new = (keys[:, order[1:]] != keys[:, order[:-1]]).any(axis=0)
    return np.asarray(order[np.concatenate([[True], new])])


def simple_faces(corners: Array, incidence: Bits) -> tuple[Bits, NDArray[np.intp], Array]:
    """Faces in order when each corner lies on equally many rows: every subset of them is one, but those at infinity.

    Args:
        corners: vertices and rays (m, r).
        incidence: which rows hold each (m, k + 1); the last column is the row at infinity.

    Returns:
        active rows (n, k), dimensions (n,), and a point in the relative interior of each face (n, r).
    """
    r = int(np.count_nonzero(incidence[0]))
    parents, columns, begins, listed = subset_tree(incidence, r)
    active, sizes = subset_rows(parents, columns, incidence.shape[1] - 1)
    return active, r - sizes, _means(corners, incidence[:, -1], begins, listed)


def closed_faces(corners: Array, incidence: Bits) -> tuple[Bits, NDArray[np.intp], Array]:
    """Faces as all intersections of the rows' corner sets, by bit sets; arguments as for `simple_faces`.

    Where a face has the most corners of all that lie on it, it is one dimension lower.

    Returns:
        active rows (n, k), dimensions (n,), and a point in the relative interior of each face (n, r), in no order.
    """
    active, dimensions, begins, listed = closed_sets(incidence)
    return active[:, :-1], dimensions, _means(corners, incidence[:, -1], begins, listed)


@compiled
def _means(corners: Array, rays: Bits, begins: Numbers, listed: Numbers) -> Array:
    """For each of n faces the mean of its vertices plus the mean of its rays (n, r).

    Args:
        corners: vertices and rays (m, r).
        rays: which of them are rays (m,).
        begins: where the corners of each face begin (n + 1,) in the list of them.
    """
    m, r = corners.shape
    n, width = len(begins) - 1, (r + 4) // 4 * 4  # with their number, in fours that are summed at once
    points, table, sums = np.zeros((n, r)), np.empty((m, width)), np.empty(width)
    for far in (False, True):
        some = False
        for corner in range(m):
            here = rays[corner] == far
            some |= here
            for i in range(width):
                table[corner, i] = (corners[corner, i] if i < r else 1.0) if here else 0.0
        for face in range(n if some else 0):
            own = listed[begins[face] : begins[face + 1]]
            for i in range(0, width, 4):
                a, b, c, d = 0.0, 0.0, 0.0, 0.0
                for corner in own:
                    a += table[corner, i]
                    b += table[corner, i + 1]
                    c += table[corner, i + 2]
                    d += table[corner, i + 3]
                sums[i], sums[i + 1], sums[i + 2], sums[i + 3] = a, b, c, d
            for i in range(r):
                points[face, i] += sums[i] / max(sums[r], 1.0)
    return points


@compiled
def held(active: Bits) -> tuple[Numbers, Numbers]:
    """Where the active rows of each face begin (n + 1,) in the list of them, and that list; `active` is (n, k)."""
    n, k = active.shape
    begins, listed, place = np.zeros(n + 1, np.int64), np.empty(n * k, np.int64), 0
    for face in range(n):
        for row in range(k):
            if active[face, row]:
                listed[place] = row
                place += 1
        begins[face + 1] = place
    return begins, listed[:place]


@compiled
def covers(active: Bits, dimensions: Numbers) -> tuple[Numbers, Numbers, Numbers, Numbers]:
    """Pairs of faces, one a dimension lower and its active rows containing the other's: the lattice's covers.

    Args:
        active: rows of each face (n, k).
        dimensions: (n,), the largest first.

    Returns:
        where the lower ones of each face begin (n + 1,) in the list of them, that list, and the same of the higher.
    """
    n, k = active.shape
    w = (k + 63) // 64
    words, missing = np.zeros((w, n), np.uint64), np.empty(n, np.uint64)
    for face in range(n):
        for row in range(k):
            if active[face, row]:
                words[row // 64, face] |= np.uint64(1) << np.uint64(row % 64)
    sons, fathers = np.zeros(n + 1, np.int64), np.zeros(n + 1, np.int64)
    son, first, last = np.empty(4 * n, np.int64), 0, 0
    for face in range(n):
        while first < n and dimensions[first] >= dimensions[face]:
            first += 1
        while last < n and dimensions[last] >= dimensions[face] - 1:
            last += 1
        for lower in range(first, last):
            missing[lower] = words[0, face] & ~words[0, lower]
        for i in range(1, w):
            for lower in range(first, last):
                missing[lower] |= words[i, face] & ~words[i, lower]
        found = sons[face]
        if found + last - first > len(son):
            few, son = son, np.empty(2 * (found + last - first), np.int64)
            for i in range(found):
                son[i] = few[i]
        for lower in range(first, last):
            if missing[lower] == _NONE:
                son[found] = lower
                found += 1
                fathers[lower + 1] += 1
        sons[face + 1] = found
    for face in range(n):
        fathers[face + 1] += fathers[face]
    father, place = np.empty(sons[n], np.int64), fathers.copy()
    for face in range(n):
        for lower in son[sons[face] : sons[face + 1]]:
            father[place[lower]] = face
            place[lower] += 1
    return sons, son[: sons[n]], fathers, father


@compiled
def subset_tree(incidence: NDArray[np.bool_], r: int) -> tuple[Places, Places, Places, Places]:
    """All subsets of the columns that hold in each row, those with the last column left out.

    A node's subset is its parent's and one column behind these. First comes the empty one, then all of one column, of
    two and so on, each in the order of its columns.

    Args:
        incidence: (m, k + 1), r columns in each row.

    Returns:
        the parent (n,) and the last column (n,) of each node; where its rows begin (n + 1,) in the list of rows that
        have it, each ascending.
    """
    m, end = len(incidence), incidence.shape[1] - 1
    digits, behind, shift = _digits(incidence, r)
    room = m << r
    parents, columns, begins = np.empty(room, np.uint32), np.empty(room, np.uint32), np.empty(room + 1, np.uint32)
    places, grown = np.empty(room, np.uint32), np.empty((m + 1) * r, np.uint32)
    for row in range(m):
        places[row] = row << shift
    parents[0], columns[0], begins[0], begins[1] = 0, end, 0, m
    count, used = np.zeros(end, np.uint32), np.empty(end, np.uint32)
    first, n = 0, 1
    for size in range(r):
        last = n
        for node in range(first, last):
            many, found = 0, 0
            for place in places[begins[node] : begins[node + 1]]:
                # As many each time as there may be, those too many to be written over: loops of one length are faster.
                for i in range(r - size):
                    grown[many + i] = place + i
                many += behind[place]
            for place in grown[:many]:
                column = digits[place]
                if count[column] == 0:
                    i = found
                    while i > 0 and used[i - 1] > column:
                        used[i] = used[i - 1]
                        i -= 1
                    used[i] = column
                    found += 1
                count[column] += 1
            at = begins[n]
            for column in used[:found]:
                parents[n], columns[n] = node, column
                n += 1
                more, count[column] = count[column], at
                at += more
                begins[n] = at
            for place in grown[:many]:
                column = digits[place]
                places[count[column]] = place + 1
                count[column] += 1
            for column in used[:found]:
                count[column] = 0
        first = last
    rows = places[: begins[n]]
    for i in range(len(rows)):
        rows[i] >>= shift
    return parents[:n], columns[:n], begins[: n + 1], rows


@part
def _digits(incidence: NDArray[np.bool_], r: int) -> tuple[Places, Places, int]:
    """The columns that hold in each row but for the last one, from place row << shift on: r at most.

    Returns:
        the columns, at each place how many are left of its row, and the shift.
    """
    m, end = len(incidence), incidence.shape[1] - 1
    shift = 1
    while (1 << shift) <= r:
        shift += 1
    digits, behind = np.zeros(m << shift, np.uint32), np.zeros(m << shift, np.uint32)
    for row in range(m):
        begin = row << shift
        place = begin
        for column in range(end):
            if incidence[row, column]:
                digits[place] = column
                place += 1
        for own in range(begin, place):
            behind[own] = place - own
    return digits, behind, shift


@compiled
def subset_rows(parents: Places, columns: Places, k: int) -> tuple[NDArray[np.bool_], NDArray[np.intp]]:
    """The subset of each node of such a tree as a row (n, k), and how many columns it has (n,).

    Args:
        parents: index of each node's parent (n,).
        columns: index of its last column (n,).
    """
    n = len(parents)
    rows, sizes = np.empty((n, k), np.bool_), np.zeros(n, np.intp)
    for column in range(k):
        rows[0, column] = False
    for node in range(1, n):
        parent = parents[node]
        for column in range(k):
            rows[node, column] = rows[parent, column]
        rows[node, columns[node]] = True
        sizes[node] = sizes[parent] + 1
    return rows, sizes
