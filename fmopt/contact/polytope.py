"""All faces of a polyhedron of half-spaces, with exact incidences: also flat, unbounded, degenerate, or with lines.

Degenerate vertices are kept as they are; nothing is perturbed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fmopt.contact.face_lattice import Bits, closed_faces, distinct, ordered, simple_faces
from fmopt.contact.half_spaces import INCIDENCE, corners_of, pointed
from fmopt.errors import InfeasibleError, SolverError
from fmopt.spatial.values import Array, Value

_COARSER = (INCIDENCE, 10.0 * INCIDENCE, 100.0 * INCIDENCE)  # how close corners are one, where faces do not fit


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
        SolverError: the hull cannot be computed, or corners lie too close together for their planes to be told.
    """
    cut = _Cut.of(normals, offsets)
    corners, incidence, simple = cut.corners()
    if simple:
        active, dimensions, points = simple_faces(corners, incidence)
    else:
        active, dimensions, points = closed_faces(corners, incidence)
        for reach in _COARSER:
            if not _is_one_solid(dimensions, cut.rows.shape[1]):
                active, dimensions, points = closed_faces(*_told_apart(corners, incidence, reach))
        if not _is_one_solid(dimensions, cut.rows.shape[1]):
            raise SolverError(f"the {len(corners)} corners of {len(cut.rows)} half-spaces cannot be told apart")
        order = ordered(active, dimensions)
        active, dimensions, points = active[order], dimensions[order], points[order]
    return Faces(cut.planes(active), dimensions + cut.lineality, points, cut.lineality)


@dataclass(frozen=True, eq=False)
class _Cut(Value):
    """A polyhedron cut down to a pointed, full-dimensional one around 0, orthogonal to its lines.

    Attributes:
        rows: (q, r), unit normals that count there, each of another plane.
        levels: (q,), negative.
        kinds: (k,), which of these each of all rows is equal to; −1 where none.
        everywhere: (k,), which of the others hold all of it.
        interior: (n,), the point that is 0.
        axes: (n, r), orthonormal, of its coordinates.
        lineality: dimension of its lines.
    """

    rows: Array
    levels: Array
    kinds: NDArray[np.intp]
    everywhere: Bits
    interior: Array
    axes: Array
    lineality: int

    @staticmethod
    def of(normals: ArrayLike, offsets: ArrayLike) -> _Cut:
        """That of {x: normals·x ≥ offsets}; errors as of `enumerate_faces`."""
        rows = np.asarray(normals, dtype=np.float64)
        size = np.sqrt((rows * rows).sum(axis=1))
        rows, levels = rows / size[:, None], np.asarray(offsets, dtype=np.float64) / size
        interior, equal = _interior(rows, levels)
        flat = _null_space(rows[equal])
        inner, slack, kinds, everywhere, axes = pointed(rows, levels, equal, interior, flat)
        return _Cut(inner, slack, kinds, everywhere, interior, axes, flat.shape[1] - axes.shape[1])

    def corners(self) -> tuple[Array, Bits, bool]:
        """Vertices and unit rays in the coordinates of the whole polyhedron (m, n), in the order of what holds them.

        Returns:
            these, which rows hold each (m, q + 1), the last column being the row at infinity, and whether each corner
            lies on just r of them.
        """
        if self.rows.shape[1] == 0:
            return self.interior[None], np.zeros((1, 1), dtype=bool), True
        equations = _hull(self.rows / -self.levels[:, None])
        corners, incidence, simple = corners_of(equations, self.rows, self.levels)
        order = distinct(incidence)
        incidence = incidence[order]
        return corners[order] @ self.axes.T + ~incidence[:, -1:] * self.interior, incidence, simple

    def planes(self, on: Bits) -> Bits:
        """Which of all planes hold faces or corners (m, k), by which rows do (m, q)."""
        if len(self.levels) == len(self.kinds):
            return on
        real, found = self.kinds >= 0, np.tile(self.everywhere, (len(on), 1))
        found[:, real] = on[:, self.kinds[real]]
        return found


def _is_one_solid(dimensions: NDArray[np.intp], most: int) -> bool:
    """Whether faces of these dimensions can be those of one polytope: all of it is its one largest face."""
    largest = int(dimensions.max())
    return largest <= most and int(np.count_nonzero(dimensions == largest)) == 1


def _told_apart(corners: Array, incidence: Bits, tolerance: float) -> tuple[Array, Bits]:
    """Corners (m, n), those that rounding alone tells apart made one, with the planes (m, k) of all of them."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    reach = tolerance * np.maximum(1.0, np.linalg.norm(corners, axis=1))
    pairs = cKDTree(corners).query_pairs(float(reach.max()), output_type="ndarray")
    one, other = pairs.T
    near = np.linalg.norm(corners[one] - corners[other], axis=1) <= np.minimum(reach[one], reach[other])
    one, other = pairs[near & (incidence[one, -1] == incidence[other, -1])].T
    links = coo_array((np.ones(len(one)), (one, other)), shape=(len(corners), len(corners)))
    count, group = connected_components(links, directed=False)
    first = np.unique(group, return_index=True)[1]
    held = np.zeros((count, incidence.shape[1]), dtype=bool)
    np.logical_or.at(held, group, incidence)
    order = distinct(held)
    return corners[first][order], held[order]


def _interior(rows: Array, levels: Array) -> tuple[Array, Bits]:
    """A point in the relative interior, and which rows hold with equality everywhere."""
    equal = np.zeros(len(rows), dtype=bool)
    origin = np.zeros(rows.shape[1])
    while not equal.all() and (rows @ origin - levels)[~equal].min() < 1e-3:
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


def _hull(points: Array) -> Array:
    """Facets (m, r + 1) of the convex hull of 0 and points (k, r); nearly degenerate ones with wide facets.

    Qhull is given the half-spaces points·x ≤ 1 that are dual to it: that way it does not cut facets into simplices.
    """
    from scipy.spatial import HalfspaceIntersection, QhullError

    k, r = points.shape
    if r == 1:
        return np.array([[1.0, -points.max(initial=0.0)], [-1.0, points.min(initial=0.0)]])
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


def _null_space(rows: Array) -> Array:
    """Orthonormal columns spanning the vectors normal to all rows."""
    n = rows.shape[1]
    if len(rows) == 0:
        return np.eye(n)
    _, s, Vt = np.linalg.svd(rows)
    return np.asarray(Vt[int(np.sum(s > 1e-7)) :].T)
