"""All faces of a polyhedron of half-spaces, with exact incidences: also flat, unbounded, degenerate, or with lines.

Degenerate vertices are kept as they are; nothing is perturbed.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fmopt.errors import InfeasibleError, SolverError
from fmopt.values import Array, Value

INCIDENCE = 1e-8  # scaled units; a point this close to a unit half-space's plane lies on it
_TABLE = 8  # possible subsets for each that there is, up to which a table is smaller work than sorting
_EXACT = 2**53  # whole numbers below are exact in floating point
_SQUARED = 1e-12  # singular values of unit rows below 1e-6 are zero

Bits = NDArray[np.bool_]
Numbers = NDArray[np.integer[Any]]


@dataclass(frozen=True, eq=False)
class Faces(Value):
    """All faces of {x: normals·x ≥ offsets}, largest dimension first.

    Attributes:
        active: (n, k), the half-spaces whose planes hold the face.
        dimensions: (n,).
        points: (n, 6), a point in the relative interior of each face.
        lineality: dimension of the lines in the polyhedron, part of every face.
    """

    active: Bits
    dimensions: NDArray[np.intp]
    points: Array
    lineality: int

    def __post_init__(self) -> None:
        for array in (self.active, self.dimensions, self.points):
            array.setflags(write=False)

    def count(self) -> dict[int, int]:
        """Number of faces by dimension."""
        values, counts = np.unique(self.dimensions, return_counts=True)
        return {int(d): int(n) for d, n in zip(values, counts, strict=True)}


def enumerate_faces(normals: ArrayLike, offsets: ArrayLike) -> Faces:
    """All faces of {x: normals·x ≥ offsets}, also when it is unbounded, flat, degenerate or holds lines.

    The rows are reduced to a pointed, full-dimensional polyhedron, whose vertices and rays come from the convex hull
    of the dual (Qhull); faces are the closed sets of incidences.

    Args:
        normals: rows (k, n); none may be zero.
        offsets: (k,).

    Raises:
        InfeasibleError: the half-spaces have no common point.
    """
    rows = np.asarray(normals, dtype=np.float64)
    size = np.linalg.norm(rows, axis=1)
    rows, levels = rows / size[:, None], np.asarray(offsets, dtype=np.float64) / size
    interior, equal = _interior(rows, levels)
    flat = _null_space(rows[equal])
    reduced, slack = rows @ flat, levels - rows @ interior
    length = np.linalg.norm(reduced, axis=1)
    real = (length > 1e-7) & ~equal
    basis = _row_space(reduced[real])
    lineality = flat.shape[1] - basis.shape[1]
    inner = reduced[real] @ basis / length[real, None]
    active, dimensions, points = _pointed_faces(inner, slack[real] / length[real])
    if not real.all():
        everywhere = equal | (~real & (np.abs(slack) <= INCIDENCE))
        within, active = active, np.empty((len(active), len(rows)), dtype=bool)
        active[:], active[:, real] = everywhere, within
    return Faces(active, dimensions + lineality, interior + points @ (flat @ basis).T, lineality)


def _keys(bits: Bits) -> NDArray[np.uint64]:
    """Words (w, n) that order bit rows (n, k), the first word and the first bit counting most."""
    packed = np.zeros((len(bits), -(-bits.shape[1] // 64) * 8), dtype=np.uint8)
    packed[:, : -(-bits.shape[1] // 8)] = np.packbits(bits, axis=1)
    return packed.view(">u8").T.astype(np.uint64)


def _order(active: Bits, dimensions: NDArray[np.intp]) -> NDArray[np.intp]:
    """Largest dimension first, then by the active rows."""
    return np.lexsort((*_keys(~active)[::-1], -dimensions))


def _different(bits: Bits) -> NDArray[np.intp]:
    """Where in a list of bit rows (n, k) each different one comes first, in their order."""
    keys = _keys(bits)
    order = np.lexsort(keys[::-1])
    new = (keys[:, order[1:]] != keys[:, order[:-1]]).any(axis=0)
    return np.asarray(order[np.concatenate([[True], new])])


def _interior(rows: Array, levels: Array) -> tuple[Array, Bits]:
    """A point in the relative interior, and which rows hold with equality everywhere."""
    equal = np.zeros(len(rows), dtype=bool)
    origin = np.zeros(rows.shape[1])
    while not equal.all() and np.max(levels[~equal] - rows[~equal] @ origin) > -1e-3:
        origin, depth, multipliers = _deepest(rows, levels, equal)
        if depth < -INCIDENCE:
            raise InfeasibleError(
                f"the half-spaces have no common point: {-depth:.3g} scaled units are short",
                -depth,
                "linearise at a pose free of overlap",
            )
        if depth > INCIDENCE:
            break
        equal[~equal] |= multipliers > 1e-9
    return origin, equal


def _deepest(rows: Array, levels: Array, equal: Bits) -> tuple[Array, float, Array]:
    """max t with rows·x − t ≥ levels, t ≤ 1, |x| bounded, and equality where given: x, t and the multipliers."""
    from scipy.optimize import linprog

    n = rows.shape[1]
    cost = np.zeros(n + 1)
    cost[n] = -1.0
    free = ~equal
    A = np.hstack([-rows[free], np.ones((int(free.sum()), 1))])
    fixed = np.hstack([rows[equal], np.zeros((int(equal.sum()), 1))])
    result = linprog(
        cost,
        A_ub=A,
        b_ub=-levels[free],
        A_eq=fixed if equal.any() else None,
        b_eq=levels[equal] if equal.any() else None,
        bounds=[(None, None)] * n + [(None, 1.0)],
        method="highs",
    )
    if result.status != 0:
        raise InfeasibleError("the half-spaces have no common point", advice="linearise at a pose free of overlap")
    x = np.asarray(result.x, dtype=np.float64)
    return x[:n], float(x[n]), -result.ineqlin.marginals


def _pointed_faces(rows: Array, levels: Array) -> tuple[Bits, NDArray[np.intp], Array]:
    """Faces of a pointed {q: rows·q ≥ levels} with 0 strictly inside (levels < 0) and unit rows (k, r), in order.

    Returns:
        active rows (n, k), dimensions (n,), points (n, r).
    """
    k, r = rows.shape
    if r == 0:
        return np.zeros((1, k), dtype=bool), np.zeros(1, dtype=np.intp), np.zeros((1, 0))
    corners, incidence = _corners(rows, levels)
    first = first_equal(np.column_stack([rows, levels]))
    kinds, group = np.unique(first, return_inverse=True)
    distinct = incidence[:, [*kinds, k]]
    possible = (distinct.shape[1] + 1.0) ** r
    if possible < _EXACT and possible * len(corners) * 2**r < 2.0**62 and bool(np.all(distinct.sum(axis=1) == r)):
        active, dimensions, points = _simple_faces(corners, distinct)
        return active if len(kinds) == k else active[:, group], dimensions, points
    active, points = _closed_faces(corners, incidence)
    outer = np.einsum("ki,kj->kij", rows, rows).reshape(k, r * r)
    gram = (active.astype(np.float64) @ outer).reshape(-1, r, r)
    rank = np.sum(np.linalg.eigvalsh(gram) > _SQUARED, axis=1)
    order = _order(active, r - rank)
    return active[order], (r - rank)[order], points[order]


def _corners(rows: Array, levels: Array) -> tuple[Array, Bits]:
    """Vertices and unit rays (m, r), and which rows hold each (m, k + 1); the last column is the row at infinity.

    With s ≥ 0 homogenising, the polyhedron is the cone {(q, s): rows·q − levels s ≥ 0}; its rays are the facets of
    the convex hull of the rows, cut where (0, 1)·row = 1.
    """
    r = rows.shape[1]
    dual = np.vstack([rows / -levels[:, None], np.zeros(r)])
    if r == 1:
        equations = np.array([[1.0, -dual.max()], [-1.0, dual.min()]])
    else:
        equations = _hull(dual[np.unique(first_equal(dual))])
    # A hull facet n·u + b ≤ 0 is the cone's ray (q, s) = (−n, −b).
    s = -equations[:, r]
    finite = s > 1e-9
    corners = -equations[:, :r] / np.where(finite, s, 1.0)[:, None]
    residual = corners @ rows.T
    residual -= np.where(finite[:, None], levels, 0.0)
    tolerance = INCIDENCE * np.maximum(1.0, np.linalg.norm(corners, axis=1))
    incidence = np.empty((len(corners), len(rows) + 1), dtype=bool)
    np.less_equal(residual, tolerance[:, None], out=incidence[:, :-1])
    incidence[:, -1] = ~finite
    one = _different(incidence)
    return corners[one], incidence[one]


def _hull(points: Array) -> Array:
    """Facets (m, r + 1) of the convex hull of points (k, r); nearly degenerate ones with wide facets."""
    from scipy.spatial import ConvexHull, QhullError

    failure: QhullError | None = None
    for options in (None, "Qt Qx Q12"):
        try:
            return np.asarray(ConvexHull(points, qhull_options=options).equations)
        except QhullError as error:
            failure = failure or error
    reason = str(failure).strip().splitlines()[0]
    raise SolverError(f"the faces of {len(points)} half-spaces could not be enumerated: {reason}")


def first_equal(rows: Array) -> NDArray[np.intp]:
    """For each row (n, k) the index (n,) of the first row equal to it within the incidence tolerance."""
    if not len(rows):
        return np.zeros(0, dtype=np.intp)
    apart = np.max(np.abs(rows[:, None] - rows[None]), axis=2)
    return np.asarray(np.argmax(apart <= INCIDENCE * np.max(np.abs(rows), axis=1), axis=1))


def _simple_faces(corners: Array, incidence: Bits) -> tuple[Bits, NDArray[np.intp], Array]:
    """Faces in order when each corner lies on exactly r rows: every subset of them is one, but those at infinity."""
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
        # One sort of numbers that hold where they come from takes half the time of sorting indices.
        ordered = np.sort(codes << bits | np.arange(count))
        order = ordered & (2**bits - 1)
        ordered >>= bits
        new = np.append(True, ordered[1:] != ordered[:-1])
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


def _closed_faces(corners: Array, incidence: Bits) -> tuple[Bits, Array]:
    """Faces as all intersections of the rows' corner sets, by bit sets."""
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


def _null_space(rows: Array) -> Array:
    """Orthonormal columns spanning the vectors normal to all rows."""
    n = rows.shape[1]
    if len(rows) == 0:
        return np.eye(n)
    _, s, Vt = np.linalg.svd(rows)
    return np.asarray(Vt[int(np.sum(s > 1e-7)) :].T)


def _row_space(rows: Array) -> Array:
    """Orthonormal columns spanning the rows."""
    if len(rows) == 0:
        return np.zeros((rows.shape[1], 0))
    _, s, Vt = np.linalg.svd(rows, full_matrices=False)
    return np.asarray(Vt[: int(np.sum(s > 1e-7))].T)
