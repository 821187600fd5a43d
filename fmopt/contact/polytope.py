"""All faces of a polyhedron of half-spaces, with exact incidences: also flat, unbounded, degenerate, or with lines.

Degenerate vertices are kept as they are; nothing is perturbed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fmopt.contact.lattice import Bits, closed_faces, different, numberable, ordered, product, simple_faces
from fmopt.errors import InfeasibleError, SolverError
from fmopt.values import Array, Value

INCIDENCE = 1e-8  # scaled units; a point this close to a unit half-space's plane lies on it


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

    The rows are cut down to a pointed, full-dimensional polyhedron, whose vertices and rays come from the convex hull
    of the dual (Qhull); faces are the closed sets of incidences.

    Args:
        normals: rows (k, n); none may be zero.
        offsets: (k,).

    Raises:
        InfeasibleError: the half-spaces have no common point.
    """
    cut = _Cut.of(normals, offsets)
    active, dimensions, points = _pointed_faces(cut.rows, cut.levels)
    if not cut.real.all():
        within, active = active, np.empty((len(active), len(cut.real)), dtype=bool)
        active[:], active[:, cut.real] = cut.everywhere, within
    return Faces(active, dimensions + cut.lineality, cut.points(points), cut.lineality)


def enumerate_vertices(normals: ArrayLike, offsets: ArrayLike) -> tuple[Array, Bits, Bits]:
    """Vertices of {x: normals·x ≥ offsets}, and the directions of its edges without end; of lines, one point stands.

    Args:
        normals: rows (k, n); none may be zero.
        offsets: (k,).

    Returns:
        vertices and unit directions (m, n), which planes hold each (m, k), and which are directions (m,).

    Raises:
        InfeasibleError: the half-spaces have no common point.
    """
    cut = _Cut.of(normals, offsets)
    if cut.rows.shape[1] == 0:
        return cut.interior[None], cut.everywhere[None], np.zeros(1, dtype=bool)
    corners, incidence, _ = _corners(cut.rows, cut.levels)
    on = np.tile(cut.everywhere, (len(corners), 1))
    on[:, cut.real] = incidence[:, :-1]
    endless = incidence[:, -1]
    return np.where(endless[:, None], corners @ cut.axes.T, cut.points(corners)), on, endless


@dataclass(frozen=True, eq=False)
class _Cut(Value):
    """A polyhedron cut down to a pointed, full-dimensional one around 0, orthogonal to its lines.

    Attributes:
        rows: (q, r), unit normals that count there.
        levels: (q,), negative.
        real: (k,), which of all rows these are.
        everywhere: (k,), which of the others hold all of it.
        interior: (n,), the point that is 0.
        axes: (n, r), orthonormal, of its coordinates.
        lineality: dimension of its lines.
    """

    rows: Array
    levels: Array
    real: Bits
    everywhere: Bits
    interior: Array
    axes: Array
    lineality: int

    @staticmethod
    def of(normals: ArrayLike, offsets: ArrayLike) -> _Cut:
        """That of {x: normals·x ≥ offsets}; errors as of `enumerate_faces`."""
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
        inner, left = reduced[real] @ basis / length[real, None], slack[real] / length[real]
        everywhere = equal | (~real & (np.abs(slack) <= INCIDENCE))
        return _Cut(inner, left, real, everywhere, interior, flat @ basis, lineality)

    def points(self, inner: Array) -> Array:
        """Points (m, r) of the pointed polyhedron in the coordinates of the whole one (m, n)."""
        found = product(inner, self.axes.T)
        found += self.interior
        return found


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
    corners, incidence, first = _corners(rows, levels)
    kinds = np.flatnonzero(first == np.arange(k))
    distinct = incidence if len(kinds) == k else incidence[:, [*kinds, k]]
    if numberable(distinct.shape[1], r) and bool(np.all(distinct.sum(axis=1) == r)):
        active, dimensions, points = simple_faces(corners, distinct)
        return active if len(kinds) == k else active[:, np.searchsorted(kinds, first)], dimensions, points
    active, dimensions, points = closed_faces(corners, incidence)
    order = ordered(active, dimensions)
    return active[order], dimensions[order], points[order]


def _corners(rows: Array, levels: Array) -> tuple[Array, Bits, NDArray[np.intp]]:
    """Vertices and unit rays (m, r), which rows hold each (m, k + 1), and for each row (k,) the first equal to it.

    The last column is the row at infinity.

    With s ≥ 0 homogenising, the polyhedron is the cone {(q, s): rows·q − levels s ≥ 0}; its rays are the facets of
    the convex hull of the rows, cut where (0, 1)·row = 1.
    """
    r = rows.shape[1]
    dual = rows / -levels[:, None]
    first = first_equal(dual)
    if r == 1:
        equations = np.array([[1.0, -dual.max(initial=0.0)], [-1.0, dual.min(initial=0.0)]])
    else:
        equations = _hull(dual[first == np.arange(len(dual))])
    # A hull facet n·u + b ≤ 0 is the cone's ray (q, s) = (−n, −b).
    s = -equations[:, r]
    finite = s > 1e-9
    corners = -equations[:, :r] / np.where(finite, s, 1.0)[:, None]
    residual = product(corners, rows.T)
    residual -= levels
    residual[~finite] += levels
    tolerance = INCIDENCE * np.maximum(1.0, np.linalg.norm(corners, axis=1))
    incidence = np.empty((len(corners), len(rows) + 1), dtype=bool)
    np.less_equal(residual, tolerance[:, None], out=incidence[:, :-1])
    incidence[:, -1] = ~finite
    one = different(incidence)
    return corners[one], incidence[one], first


def _hull(points: Array) -> Array:
    """Facets (m, r + 1) of the convex hull of 0 and points (k, r); nearly degenerate ones with wide facets.

    Qhull is given the half-spaces points·x ≤ 1 that are dual to it: that way it does not cut facets into simplices.
    """
    from scipy.spatial import HalfspaceIntersection, QhullError

    k, r = points.shape
    half_spaces = np.zeros((k + 1, r + 1))
    half_spaces[:k, :r], half_spaces[:, r] = points, -1.0
    failure: QhullError | None = None
    for options in (None, "Qx Q12"):
        try:
            with np.errstate(divide="ignore", invalid="ignore"):  # where it has a ray
                return np.asarray(HalfspaceIntersection(half_spaces, np.zeros(r), qhull_options=options).dual_equations)
        except QhullError as error:
            failure = failure or error
    reason = str(failure).strip().splitlines()[0]
    raise SolverError(f"the faces of {k} half-spaces could not be enumerated: {reason}")


def first_equal(rows: Array) -> NDArray[np.intp]:
    """For each row (n, k) the index (n,) of the first row equal to it within the incidence tolerance."""
    n, k = rows.shape
    size = np.max(np.abs(rows), axis=1, initial=0.0)
    along = np.sort(rows @ np.cos(np.arange(k)))
    if not n or np.min(along[1:] - along[:-1], initial=np.inf) > k * INCIDENCE * size.max():
        return np.arange(n)  # rows that are equal would be next to each other along any direction
    apart = np.max(np.abs(rows[:, None] - rows[None]), axis=2)
    return np.asarray(np.argmax(apart <= INCIDENCE * size, axis=1))


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
