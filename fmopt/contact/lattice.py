"""The face lattice of a pointed polyhedron from its corners and what lies on them: combinatorics alone.

Where each corner lies on no more half-spaces than there are dimensions, every subset of these is a face; else faces
are the closed sets of incidences. Corners and points are in scaled units, like those of the polyhedron.
"""

from __future__ import annotations

from functools import lru_cache
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fmopt.values import Array

_TABLE = 8  # possible subsets for each that there is, up to which a table is smaller work than sorting
_EXACT = 2**53  # whole numbers below are exact in floating point

Bits = NDArray[np.bool_]
Numbers = NDArray[np.integer[Any]]


def _keys(bits: Bits) -> NDArray[np.uint64]:
    """Words (w, n) that order bit rows (n, k), the first word and the first bit counting most."""
    packed = np.zeros((len(bits), -(-bits.shape[1] // 64) * 8), dtype=np.uint8)
    packed[:, : -(-bits.shape[1] // 8)] = np.packbits(bits, axis=1)
    return packed.view(">u8").T.astype(np.uint64)


def ordered(active: Bits, dimensions: NDArray[np.intp]) -> NDArray[np.intp]:
    """The order (n,) of faces by dimensions (n,) and active rows (n, k): largest dimension first, then by rows."""
    return np.lexsort((*_keys(~active)[::-1], -dimensions))


def different(bits: Bits) -> NDArray[np.intp]:
    """Where (l,) in a list of bit rows (n, k) each different one comes first, in their order."""
    keys = _keys(bits)
    order = np.lexsort(keys[::-1])
    new = (keys[:, order[1:]] != keys[:, order[:-1]]).any(axis=0)
    return np.asarray(order[np.concatenate([[True], new])])


def simple_faces(corners: Array, incidence: Bits) -> tuple[Bits, NDArray[np.intp], Array]:
    """Faces in order when each corner lies on exactly r rows: every subset of them is one, but those at infinity.

    Args:
        corners: vertices and rays (m, r).
        incidence: which rows hold each (m, k + 1); the last column is the row at infinity.

    Returns:
        active rows (n, k), dimensions (n,), and a point in the relative interior of each face (n, r).
    """
    m, r = corners.shape
    columns = incidence.shape[1]
    digits = np.nonzero(incidence)[1].reshape(m, r)
    chosen = _subsets(r)
    sizes = chosen.sum(axis=1)
    # Short subsets are numbered by a table of all that are possible, long ones by sorting those that there are.
    short = int(np.count_nonzero((columns + 1.0) ** sizes <= _TABLE * m * len(chosen)))
    parts = [_numbered(digits + 1, part, columns + 1) for part in (chosen[:short], chosen[short:]) if len(part)]
    one, two = parts[0], parts[-1]
    which, corner, subset = one
    if len(parts) > 1:
        which = np.hstack([one[0], two[0] + np.int32(len(one[1]))])
        corner, subset = np.append(one[1], two[1]), np.append(one[2], two[2] + short)
    # One column more, for what is not chosen.
    at = np.where(chosen[subset], digits[corner], columns)
    at += (columns + 1) * np.arange(len(at))[:, None]
    active = np.zeros((len(at), columns + 1), dtype=bool)
    active.reshape(-1)[at] = True
    dimensions = r - sizes[subset]
    points = _means(corners, incidence[:, -1], which, len(at))
    if not incidence[:, -1].any():
        return active[:, : columns - 1], dimensions, points
    real = ~active[:, columns - 1]
    return active[real, : columns - 1], dimensions[real], points[real]


def numberable(rows: int, r: int) -> bool:
    """Whether the subsets of up to r of so many rows, the one at infinity among them, have numbers that are exact."""
    return (rows + 1.0) ** r < _EXACT


@lru_cache
def _subsets(r: int) -> Bits:
    """All subsets (2^r, r) of r things, short ones first."""
    found = np.array([[j in some for j in range(r)] for n in range(r + 1) for some in combinations(range(r), n)])
    found.setflags(write=False)
    return found


def _numbered(digits: Numbers, chosen: Bits, base: int) -> tuple[Numbers, Numbers, Numbers]:
    """Each subset of the digits of each corner by its number among the different ones, in order.

    Shorter ones come first. Written as numbers of as many digits, subsets have that order.

    Args:
        digits: of each corner (m, r), in order, from 1 to less than the base.
        chosen: the subsets (s, r).
        base: of the numbers.

    Returns:
        the numbers (m, s), and for each number a corner (n,) that has it and by which subset (n,).
    """
    count, longest = len(digits) * len(chosen), int(chosen.sum(axis=1).max())
    bits = count.bit_length()
    behind = np.cumsum(chosen[:, ::-1], axis=1)[:, ::-1] - 1
    weights = np.where(chosen, float(base) ** behind, 0.0)
    codes = (digits.astype(np.float64) @ weights.T).reshape(-1).astype(np.int64)
    if base**longest <= _TABLE * count:
        place = np.full(base**longest, -1, dtype=np.int32)
        place[codes] = np.arange(count, dtype=np.int32)
        found = np.flatnonzero(place >= 0)
        first = place[found].astype(np.intp)
        place[found] = np.arange(len(found), dtype=np.int32)
        which = place[codes]
    else:
        if base**longest < 2 ** (63 - bits):
            # One sort of numbers that hold where they come from takes half the time of sorting indices.
            listed = np.sort(codes << bits | np.arange(count))
            order, listed = listed & (2**bits - 1), listed >> bits
        else:
            order = np.argsort(codes, kind="stable")
            listed = codes[order]
        new = np.append(True, listed[1:] != listed[:-1])
        which, first = np.empty(count, dtype=np.int32), order[new]
        which[order] = np.cumsum(new, dtype=np.int32) - np.int32(1)
    return which.reshape(len(digits), -1), *np.divmod(first, len(chosen))


def _means(corners: Array, rays: Bits, which: Numbers, n: int) -> Array:
    """For each of n faces the mean of its vertices plus the mean of its rays (n, r).

    Args:
        corners: vertices and rays (m, r).
        rays: which of them are rays.
        which: the faces (m, s) that each corner is on.
        n: how many faces.
    """
    from scipy.sparse import csc_array

    total = np.zeros((n, corners.shape[1]))
    counted = np.column_stack([corners, np.ones(len(corners))])
    for part in (~rays, rays) if rays.any() else (slice(None),):
        faces, here = which[part], counted[part]
        begins = np.arange(0, faces.size + 1, faces.shape[1], dtype=np.int32)
        of_faces = csc_array((np.ones(faces.size), faces.reshape(-1), begins), shape=(n, len(here)))
        sums = np.asarray(of_faces @ here)
        total += sums[:, :-1] / np.maximum(sums[:, -1:], 1.0)
    return total


def closed_faces(corners: Array, incidence: Bits) -> tuple[Bits, Array]:
    """Faces as all intersections of the rows' corner sets, by bit sets; arguments as of `simple_faces`.

    Returns:
        active rows (n, k), and a point in the relative interior of each face (n, r), in no particular order.
    """
    m = len(corners)
    facets = {int.from_bytes(np.packbits(row, bitorder="little").tobytes(), "little") for row in incidence.T}
    known = {(1 << m) - 1}
    for facet in facets:
        known |= {face & facet for face in known}
    known.discard(0)
    width = (m + 7) // 8
    packed = np.frombuffer(b"".join(face.to_bytes(width, "little") for face in known), dtype=np.uint8)
    members = np.unpackbits(packed.reshape(-1, width), axis=1, count=m, bitorder="little").astype(np.float64)
    rays = incidence[:, -1]
    members = members[(members[:, ~rays] > 0.0).any(axis=1)]
    active = members @ (~incidence[:, :-1]).astype(np.float64) == 0.0
    points = np.zeros((len(members), corners.shape[1]))
    for part in (~rays, rays):
        weight = members[:, part]
        points += weight @ corners[part] / np.maximum(weight.sum(axis=1, keepdims=True), 1.0)
    return active, points
