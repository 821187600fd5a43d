"""All intersections of some sets of numbers, as bits in words of 64, and which of them are maximal in which."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from fmopt.runtime.compiled import compiled, part

Words = NDArray[np.uint64]
Numbers = NDArray[np.integer[Any]]

_NONE, _ONE = np.uint64(0), np.uint64(1)  # typed as words: a plain number would turn a product of words into a float
_EVEN, _PAIRS, _NIBBLES = np.uint64(0x5555555555555555), np.uint64(0x3333333333333333), np.uint64(0x0F0F0F0F0F0F0F0F)
# 2⁶⁴ over the golden ratio, which spreads neighbouring words over the table
_BYTES, _GOLDEN = np.uint64(0x0101010101010101), np.uint64(0x9E3779B97F4A7C15)
_TWO, _FOUR, _TOP, _HALF = np.uint64(2), np.uint64(4), np.uint64(56), np.uint64(32)


@part
def _ones(word: np.uint64) -> np.int64:
    """How many bits are set."""
    # Bits are added up in pairs, fours and bytes at once; the product gathers all bytes in the topmost one.
    x = word - ((word >> _ONE) & _EVEN)
    x = (x & _PAIRS) + ((x >> _TWO) & _PAIRS)
    return np.int64((((x + (x >> _FOUR)) & _NIBBLES) * _BYTES) >> _TOP)


@part
def _slot(number: int, sets: Words, slots: Numbers) -> np.int64:
    """Where one of some sets (n, w) is in the table of those before it, or may be put.

    The table `slots` (2^p,) holds their numbers, and −1 where there is none.
    """
    mask, mixed = len(slots) - 1, _NONE
    for i in range(sets.shape[1]):
        mixed = (mixed ^ sets[number, i]) * _GOLDEN
        # High bits are folded into low ones, as a product mixes upward only and the mask takes the low ones.
        mixed ^= mixed >> _HALF
    slot = np.int64(mixed & np.uint64(mask))  # the table's length is a power of two
    while slots[slot] >= 0:
        other, differing = slots[slot], _NONE
        for i in range(sets.shape[1]):
            differing |= sets[other, i] ^ sets[number, i]
        if differing == _NONE:
            break
        slot = (slot + 1) & mask
    return slot


@part
def _crossed(column: Words, sets: Words, slots: Numbers, n: int) -> int:
    """Adds the intersections of the first n sets (…, w) with a set (w,) to these; how many there are then.

    There is room for twice as many and one, and in their table.
    """
    # The column's own set stands behind the last one for the lookup; where it is new it is overwritten by the first
    # one.
    w = len(column)
    for i in range(w):
        sets[n, i] = column[i]
    if slots[_slot(n, sets, slots)] >= 0:
        return n  # it is an intersection of others
    known = n
    for number in range(known):
        some, less = _NONE, _NONE
        for i in range(w):
            both = sets[number, i] & column[i]
            sets[n, i] = both
            some |= both
            less |= both ^ sets[number, i]
        # Empty sets are no faces, and an intersection that takes nothing away is the set itself.
        if some != _NONE and less != _NONE:
            slot = _slot(n, sets, slots)
            if slots[slot] < 0:
                slots[slot] = n
                n += 1
    return n


@part
def _intersections(columns: Words, sizes: Numbers, m: int) -> tuple[Words, Numbers, int]:
    """All intersections of some sets (q, w) of m numbers and so many in each (q,), none empty, first all numbers.

    Returns:
        the sets, at least one more than there are; the table of them; how many there are.
    """
    q, w = columns.shape
    sets, slots, n = np.zeros((512, w), np.uint64), np.full(1024, -1, np.int32), 1
    for number in range(m):
        sets[0, number >> 6] |= _ONE << np.uint64(number & 63)
    slots[_slot(0, sets, slots)] = 0
    left = sizes.copy()
    for _ in range(q):
        largest = 0
        for column in range(q):
            if left[column] > left[largest]:
                largest = column
        left[largest] = -1
        # Room for an intersection with each set known; slots stay twice as many as sets, so that a search soon ends.
        if 2 * n >= len(sets):
            few, sets = sets, np.zeros((2 * len(sets), w), np.uint64)
            slots = np.full(2 * len(sets), -1, np.int32)
            for known in range(n):
                for i in range(w):
                    sets[known, i] = few[known, i]
                slots[_slot(known, sets, slots)] = known
        n = _crossed(columns[largest], sets, slots, n)
    return sets, slots, n


@part
def _below(sets: Words, slots: Numbers, n: int, columns: Words, active: NDArray[np.bool_], sizes: Numbers) -> Numbers:
    """For each of n sets its largest intersection with a column's that is smaller (n,), itself where that is empty.

    Writes which columns' sets hold each (n, q), and its size (n,).
    """
    w, below = sets.shape[1], np.empty(n, np.int64)
    for known in range(n):
        for i in range(w):
            sizes[known] += _ones(sets[known, i])
        largest, side = np.int64(0), -1
        for column in range(len(columns)):
            shared = np.int64(0)
            for i in range(w):
                shared += _ones(sets[known, i] & columns[column, i])
            # A column holds the set if it takes nothing away.
            active[known, column] = shared == sizes[known]
            # The largest proper intersection is one dimension lower: faces of a polytope come in levels without gaps.
            if largest < shared < sizes[known]:
                largest, side = shared, column
        below[known] = known
        if side >= 0:
            for i in range(w):
                sets[n, i] = sets[known, i] & columns[side, i]
            below[known] = slots[_slot(n, sets, slots)]
    return below


@compiled
def closed_sets(incidence: NDArray[np.bool_]) -> tuple[NDArray[np.bool_], NDArray[np.intp], Numbers, Numbers]:
    """All intersections of the columns' sets of rows, in no order: none empty, none within the last column's set.

    Args:
        incidence: which columns hold in which rows (m, q).

    Returns:
        which columns hold in all rows of each (n, q); its dimension (n,), that of the largest of its intersections with
        a column's set that is smaller and one more, or 0 where that is empty; where its rows begin (n + 1,) in a list
        of them, each ascending.
    """
    m, q = incidence.shape
    columns, counts = np.zeros((q, (m + 63) // 64), np.uint64), np.zeros(q, np.int64)
    for row in range(m):
        for column in range(q):
            if incidence[row, column]:
                # A row as one bit: 64 rows are intersected in one operation.
                columns[column, row >> 6] |= _ONE << np.uint64(row & 63)
                counts[column] += 1
    sets, slots, n = _intersections(columns, counts, m)
    active, sizes = np.empty((n, q), np.bool_), np.zeros(n, np.int64)
    below = _below(sets, slots, n, columns, active, sizes)
    dimensions, begins, listed = np.zeros(n, np.intp), np.zeros(n + 1, np.uint32), np.empty(sizes.sum(), np.uint32)
    found, place = 0, 0
    # What lies wholly within the last column, the plane at infinity, is no face of the polyhedron.
    for known in range(n):
        if active[known, q - 1]:
            continue
        at = known
        # The dimension is the length of a chain of ever smaller faces down to a corner.
        while below[at] != at:
            dimensions[found] += 1
            at = below[at]
        for column in range(q):
            active[found, column] = active[known, column]
        for i in range(len(columns[0])):
            left = sets[known, i]
            while left != _NONE:
                # The lowest bit alone, by two's complement; its place is the number of bits below it.
                lowest = left & (~left + _ONE)
                listed[place] = 64 * i + _ones(lowest - _ONE)
                place += 1
                left ^= lowest
        found += 1
        begins[found] = place
    return active[:found], dimensions[:found], begins[: found + 1], listed[:place]
