"""The subsets of each of many sorted rows of digits, as a tree whose nodes come by length and in order.

A polytope whose corners lie on as many facets as it has dimensions has a face for each of them.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fmopt.compiled import compiled, part

Places = NDArray[np.uint32]


@compiled
def subset_tree(incidence: NDArray[np.bool_], r: int) -> tuple[Places, Places, Places, Places]:
    """All subsets of the columns that hold in each row, those with the last column left out.

    A node's subset is its parent's and one column behind these. First comes the empty one, then all of one column, of
    two and so on, each in the order of its columns.

    Args:
        incidence: (m, k + 1), r columns in each row.
        r: how many.

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
        k: how many columns there are.
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
