"""All faces of a polyhedron of half-spaces, with exact incidences: also flat, unbounded, degenerate, or with lines.

Degenerate vertices are kept as they are; nothing is perturbed.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fmopt.errors import InfeasibleError, SolverError
from fmopt.values import Array, Value

INCIDENCE = 1e-8  # scaled units; a point this close to a unit half-space's plane lies on it
_TABLE = 16  # possible tuples for each that there is, up to which a table is smaller work than sorting
_SQUARED = 1e-12  # singular values of unit rows below 1e-6 are zero

Bits = NDArray[np.bool_]


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
    if bool(np.all(distinct.sum(axis=1) == r)):
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
    residual = corners @ rows.T - np.where(finite[:, None], levels, 0.0)
    tolerance = INCIDENCE * np.maximum(1.0, np.linalg.norm(corners, axis=1))
    incidence = np.column_stack([residual <= tolerance[:, None], ~finite])
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
    """Faces in order when each corner lies on exactly r rows: every subset of them is one, but those at infinity.

    A subset of j rows has its rows as digits, the first one counting most: their codes have the order of the faces.
    """
    m, r = corners.shape
    columns = incidence.shape[1] - 1
    digits = np.nonzero(incidence)[1].reshape(m, r)
    rays = incidence[:, -1]
    active, points = [], []
    for j in range(r + 1):
        places = np.array(list(combinations(range(r), j)), dtype=np.intp)
        chosen = digits[:, places].reshape(m * len(places), j)
        at = np.repeat(np.arange(m), len(places))
        if rays.any() and j:
            real = chosen[:, -1] < columns
            chosen, at = chosen[real], at[real]
        which, first = _numbered(chosen, columns)
        points.append(_means(corners, rays, which, at, len(first)))
        found = np.zeros((len(first), columns), dtype=bool)
        found[np.arange(len(first))[:, None], chosen[first]] = True
        active.append(found)
    sizes = [len(found) for found in active]
    return np.concatenate(active), r - np.repeat(np.arange(r + 1), sizes), np.concatenate(points)


def _numbered(digits: NDArray[np.intp], base: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """The number of each tuple of digits (n, j) among the different ones in order, and where one of each is.

    Few possible tuples are counted in a table, many are sorted.
    """
    n, j = digits.shape
    if base**j >= 2**63:
        order = np.lexsort(digits.T[::-1])
        new = np.append(True, (digits[order[1:]] != digits[order[:-1]]).any(axis=1))
    else:
        codes = digits @ np.array([base ** (j - 1 - i) for i in range(j)], dtype=np.int64)
        if base**j <= _TABLE * n:
            place = np.full(base**j, -1, dtype=np.intp)
            place[codes] = np.arange(n)
            first = place[place >= 0]
            place[codes[first]] = np.arange(len(first))
            return place[codes], first
        order = np.argsort(codes)
        ordered = codes[order]
        new = np.append(True, ordered[1:] != ordered[:-1])
    which = np.empty(n, dtype=np.intp)
    which[order] = np.cumsum(new) - 1
    return which, order[new]


def _means(corners: Array, rays: Bits, which: NDArray[np.intp], at: NDArray[np.intp], n: int) -> Array:
    """For each of n faces the mean of its vertices plus the mean of its rays (n, r): corner at[i] is on face which[i].

    Args:
        corners: vertices and rays (m, r).
        rays: which of them are rays.
        which: faces (l,).
        at: corners (l,), in order.
        n: how many faces.
    """
    from scipy.sparse import csc_array

    begins = np.searchsorted(at, np.arange(len(corners) + 1))
    total = np.zeros((n, corners.shape[1]))
    for part in (~rays, rays) if rays.any() else (~rays,):
        weight = part.astype(np.float64)
        of_faces = csc_array((weight[at], which, begins), shape=(n, len(corners)))
        count = np.maximum(np.asarray(of_faces @ weight), 1.0)
        total += np.asarray(of_faces @ corners) / count[:, None]
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
