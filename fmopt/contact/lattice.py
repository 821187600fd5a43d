"""The face lattice of a pointed polyhedron from its corners and what lies on them: combinatorics alone.

Where each corner lies on no more half-spaces than there are dimensions, every subset of these is a face; else faces
are the closed sets of incidences. Corners and points are in scaled units, like those of the polyhedron.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fmopt.values import Array, Value

_TABLE = 8  # possible subsets for each that there is, up to which a table is smaller work than sorting
_ALONE = 2**17  # multiplications that BLAS does not share among threads
_EXACT = 2**53  # whole numbers below are exact in floating point

Bits = NDArray[np.bool_]
Numbers = NDArray[np.integer[Any]]


def _keys(bits: Bits) -> NDArray[np.uint64]:
    """Words (w, n) that order bit rows (n, k), the first word and the first bit counting most."""
    packed = np.zeros((len(bits), -(-bits.shape[1] // 64) * 8), dtype=np.uint8)
    packed[:, : -(-bits.shape[1] // 8)] = np.packbits(bits, axis=1)
    return packed.view(">u8").T.astype(np.uint64)


def product(tall: Array, small: Array) -> Array:
    """The matrix product (n, s) of rows (n, r) with (r, s), a few at a time.

    So few that BLAS does not wake its threads, which then wait so busily that the memory given back meanwhile costs
    more than the product.
    """
    rows = max(1, _ALONE // max(1, small.size))
    if len(tall) <= rows:
        return tall @ small
    found = np.empty((len(tall), small.shape[1]))
    for begin in range(0, len(tall), rows):
        np.matmul(tall[begin : begin + rows], small, out=found[begin : begin + rows])
    return found


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
    digits = (np.flatnonzero(incidence) % columns).reshape(m, r)
    subsets = _subsets(r)
    # Short subsets are numbered by a table of all that are possible, long ones by sorting those that there are.
    short = int(np.count_nonzero((columns + 1.0) ** subsets.sizes <= _TABLE * m * len(subsets.sizes)))
    counted = (digits + 1).astype(np.float64)
    parts = [_numbered(counted, part, columns + 1) for part in subsets.cut(short)]
    corner = np.concatenate([on for _, on, _ in parts])
    subset = np.concatenate([which + begin for (_, _, which), begin in zip(parts, (0, short), strict=False)])
    active = _active(digits, subsets.left, corner, subset, columns)
    dimensions = r - subsets.sizes[subset]
    points = np.vstack([_means(corners, incidence[:, -1], which, len(on)) for which, on, _ in parts])
    if not incidence[:, -1].any():
        return active[:, : columns - 1], dimensions, points
    real = ~active[:, columns - 1]
    return active[real, : columns - 1], dimensions[real], points[real]


def _active(digits: Numbers, left: Bits, corner: Numbers, subset: Numbers, columns: int) -> Bits:
    """Rows (n, columns + 1) of faces, each by a corner and which subset of its rows it is; the last column is none."""
    at = digits.take(corner, axis=0)
    np.putmask(at, left.take(subset, axis=0), columns)
    at += np.arange(0, (columns + 1) * len(at), columns + 1)[:, None]
    active = np.zeros((len(at), columns + 1), dtype=bool)
    active.reshape(-1)[at] = True
    return active


def numberable(rows: int, r: int) -> bool:
    """Whether the subsets of up to r of so many rows, the one at infinity among them, have numbers that are exact."""
    return (rows + 1.0) ** r < _EXACT


@dataclass(frozen=True, eq=False)
class _Subsets(Value):
    """Some of the subsets of r things, short ones first.

    Attributes:
        left: (s, r), what each leaves out.
        sizes: (s,), how many each has.
        behind: (r, s), how many of each come behind each thing.
    """

    left: Bits
    sizes: NDArray[np.intp]
    behind: NDArray[np.intp]

    def cut(self, first: int) -> tuple[_Subsets, ...]:
        """The first few and the others, or all where one of these has none."""
        parts = (slice(first), slice(first, None))
        found = [_Subsets(self.left[part], self.sizes[part], self.behind[:, part]) for part in parts]
        return tuple(part for part in found if len(part.sizes))

    def weights(self, base: int) -> Array:
        """What the digits of a corner (r) are multiplied by (r, s) for the numbers that the subsets have to a base."""
        return np.where(self.left.T, 0.0, float(base) ** self.behind)


@lru_cache
def _subsets(r: int) -> _Subsets:
    """All subsets of r things."""
    left = np.array([[j not in some for j in range(r)] for n in range(r + 1) for some in combinations(range(r), n)])
    behind = np.cumsum(~left[:, ::-1], axis=1)[:, ::-1].T + left.T - 1
    return _Subsets(left, r - left.sum(axis=1), behind)


def _numbered(digits: Array, subsets: _Subsets, base: int) -> tuple[Numbers, Numbers, Numbers]:
    """Each subset of the digits of each corner by its number among the different ones, in order.

    Shorter ones come first. Written as numbers of as many digits, subsets have that order.

    Args:
        digits: of each corner (m, r), in order, whole numbers from 1 to less than the base.
        subsets: s of them.
        base: of the numbers.

    Returns:
        the numbers (m, s), and for each number a corner (n,) that has it and by which subset (n,).
    """
    s = len(subsets.sizes)
    count, longest = len(digits) * s, int(subsets.sizes[-1])
    bits = count.bit_length()
    codes = product(digits, subsets.weights(base)).reshape(-1).astype(np.int64)
    if base**longest <= _TABLE * count:
        place = np.full(base**longest, -1, dtype=np.int32)
        place[codes] = np.arange(count, dtype=np.int32)
        found = np.flatnonzero(place >= 0)
        first = place.take(found)
        place[found] = np.arange(len(found), dtype=np.int32)
        which = place.take(codes)
    else:
        if base**longest < 2 ** (63 - bits):
            # One sort of numbers that hold where they come from takes half the time of sorting indices.
            codes <<= bits
            codes |= np.arange(count)
            codes.sort()
            order = codes & (2**bits - 1)
            codes >>= bits
        else:
            order = np.argsort(codes, kind="stable")
            codes = codes[order]
        new = np.append(True, codes[1:] != codes[:-1])
        which, first = np.empty(count, dtype=np.int32), order[new]
        which[order] = np.cumsum(new, dtype=np.int32) - np.int32(1)
    return which.reshape(-1, s), *np.divmod(first, s)


def _means(corners: Array, rays: Bits, which: Numbers, n: int) -> Array:
    """For each of n faces the mean of its vertices plus the mean of its rays (n, r).

    Args:
        corners: vertices and rays (m, r).
        rays: which of them are rays.
        which: the faces (m, s) that each corner is on.
        n: how many faces.
    """
    from scipy.sparse import csc_array

    counted = np.column_stack([corners, np.ones(len(corners))])

    def mean(faces: Numbers, here: Array) -> Array:
        begins = np.arange(0, faces.size + 1, faces.shape[1], dtype=np.int32)
        sums = np.asarray(csc_array((np.ones(faces.size), faces.reshape(-1), begins), shape=(n, len(here))) @ here)
        sums[:, :-1] /= np.maximum(sums[:, -1:], 1.0)
        return sums[:, :-1]

    return mean(which[~rays], counted[~rays]) + mean(which[rays], counted[rays]) if rays.any() else mean(which, counted)


def closed_faces(corners: Array, incidence: Bits) -> tuple[Bits, NDArray[np.intp], Array]:
    """Faces as all intersections of the rows' corner sets, by bit sets; arguments as of `simple_faces`.

    Where a face has the most corners of all that lie on it, it is one dimension lower.

    Returns:
        active rows (n, k), dimensions (n,), and a point in the relative interior of each face (n, r), in no order.
    """
    m = len(corners)
    rows = [int.from_bytes(row.tobytes(), "little") for row in np.packbits(incidence.T, axis=1, bitorder="little")]
    known = {(1 << m) - 1}
    for row in sorted(set(rows), key=int.bit_count, reverse=True):
        if row not in known:  # else it is an intersection of others
            known |= {face & row for face in known}
    known.discard(0)
    listed, width = list(known), (m + 7) // 8
    packed = np.frombuffer(b"".join([face.to_bytes(width, "little") for face in listed]), dtype=np.uint8)
    members = np.unpackbits(packed.reshape(-1, width), axis=1, count=m, bitorder="little").astype(np.float64)
    shared, size = members @ incidence, members.sum(axis=1)[:, None]
    largest = np.where(shared < size, shared, 0.0).argmax(axis=1).tolist()
    place = {face: i for i, face in enumerate(listed)}
    side = np.array([place.get(face & rows[j], i) for i, (face, j) in enumerate(zip(listed, largest, strict=True))])
    at, dimensions = np.arange(len(listed)), np.zeros(len(listed), dtype=np.intp)
    for _ in range(corners.shape[1]):
        dimensions += side[at] != at
        at = side[at]
    r, rays = corners.shape[1], incidence[:, -1:]
    sums = members @ np.hstack([corners * ~rays, corners * rays, ~rays, rays])
    points = sums[:, :r] / np.maximum(sums[:, -2:-1], 1.0) + sums[:, r:-2] / np.maximum(sums[:, -1:], 1.0)
    real = shared[:, -1] < size[:, 0]
    return (shared == size)[real, :-1], dimensions[real], points[real]
