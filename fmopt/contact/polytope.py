"""All faces of a polyhedron of half-spaces, with exact incidences: also flat, unbounded, degenerate, or with lines.

Its vertices and rays come from Qhull, its faces from the planes that hold these. Degenerate vertices are kept as they
are; nothing is perturbed.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from fmopt.contact.face_lattice import closed_sets
from fmopt.errors import InfeasibleError, SolverError
from fmopt.spatial.values import Array, Bits, Indices, Value

INCIDENCE = 1e-8  # scaled units; a point this close to a unit half-space's plane lies on it
_MERGE_REACHES = (0.0, INCIDENCE, 10.0 * INCIDENCE, 100.0 * INCIDENCE)  # within which corners are one, until faces fit


@dataclass(frozen=True, eq=False)
class PolytopeFaces(Value):
    """All faces of {x: normals·x ≥ offsets}, each with a point (n, 6) inside, largest dimension first."""

    active: Bits  # (n, k), the half-spaces whose planes hold the face
    dimensions: Indices
    points: Array  # in the relative interior of each face
    lineality: int  # dimension of the lines in the polyhedron, part of every face

    def __post_init__(self) -> None:
        for array in (self.active, self.dimensions, self.points):
            array.setflags(write=False)

    def count(self) -> dict[int, int]:
        """Number of faces by dimension."""
        values, counts = np.unique(self.dimensions, return_counts=True)
        return {int(d): int(n) for d, n in zip(values, counts, strict=True)}


def enumerate_faces(normals: ArrayLike, offsets: ArrayLike) -> PolytopeFaces:
    """All faces of {x: normals·x ≥ offsets}, also when it is unbounded, flat, degenerate or holds lines.

    The rows (k, n), none of them zero, with offsets (k,) are cut down to a pointed, full-dimensional polyhedron, whose
    vertices and rays come from the convex hull of the dual (Qhull); faces are the closed sets of incidences.

    Raises:
        InfeasibleError: the half-spaces have no common point.
        SolverError: the hull cannot be computed, or corners lie too close together for their planes to be told.
    """
    cut = _Cut.of(normals, offsets)
    corners, incidence = cut.corners()
    for reach in _MERGE_REACHES:
        close, held = _merge_corners(corners, incidence, reach) if reach else (corners, incidence)
        members, active, dimensions = closed_sets(held)
        # The polyhedron itself is its one largest face.
        if len(dimensions) and dimensions[0] <= cut.rows.shape[1] and not (dimensions[1:] == dimensions[0]).any():
            points = _means(close, held[:, -1], members)
            return PolytopeFaces(cut.planes(active), dimensions + cut.lineality, points, cut.lineality)
    raise SolverError(f"the {len(corners)} corners of {len(cut.rows)} half-spaces cannot be told apart")


def first_equal(rows: Array) -> Indices:
    """For each row (n, k) the index (n,) of the first row equal to it within the incidence tolerance."""
    tolerance = INCIDENCE * np.abs(rows).max(axis=1, initial=0.0)
    near = (np.abs(rows[:, None] - rows) <= tolerance[:, None]).all(axis=2)
    return np.array([np.flatnonzero(row)[0] for row in near], dtype=np.intp)


@dataclass(frozen=True, eq=False)
class _Cut(Value):
    """A polyhedron cut down to a pointed, full-dimensional one around 0, orthogonal to its lines."""

    rows: Array  # (q, r), unit normals that count there, each of another plane
    levels: Array  # (q,), negative
    kinds: Indices  # (k,), which of these each of all rows is equal to; −1 where none
    everywhere: Bits  # (k,), which of the others hold all of it
    interior: Array  # (n,), the point that is 0
    axes: Array  # (n, r), orthonormal, of its coordinates
    lineality: int

    @staticmethod
    def of(normals: ArrayLike, offsets: ArrayLike) -> "_Cut":
        """That of {x: normals·x ≥ offsets}; errors as of `enumerate_faces`."""
        rows = np.asarray(normals, dtype=np.float64)
        size = np.sqrt((rows * rows).sum(axis=1))
        rows, levels = rows / size[:, None], np.asarray(offsets, dtype=np.float64) / size
        interior, equal = _interior(rows, levels)
        _, flat = _spans(rows[equal])
        # One after the other: the order of the terms decides the last digits.
        slack = np.subtract.reduce(np.column_stack([levels, rows * interior]), axis=1)
        within = rows @ flat
        length = np.sqrt((within * within).sum(axis=1))
        cuts = ~equal & (length > 1e-7)
        everywhere = equal | (~cuts & (np.abs(slack) <= INCIDENCE))
        within, slack, length = within[cuts], slack[cuts], length[cuts]
        basis, _ = _spans(within)
        inner, slack = within @ basis / length[:, None], slack / length
        first = first_equal(inner / -slack[:, None])
        for row, equal_row in enumerate(first):
            first[row] = first[equal_row]
        distinct, kinds = np.unique(first, return_inverse=True)
        kinds_of_all = np.full(len(rows), -1)
        kinds_of_all[cuts] = kinds
        lineality = flat.shape[1] - basis.shape[1]
        return _Cut(inner[distinct], slack[distinct], kinds_of_all, everywhere, interior, flat @ basis, lineality)

    def corners(self) -> tuple[Array, Bits]:
        """Vertices and unit rays in the coordinates of the whole polyhedron (m, n), in the order of what holds them.

        With s ≥ 0 homogenising, the polyhedron is the cone {(q, s): rows·q − levels s ≥ 0}; a facet n·u + b ≤ 0 of the
        dual is its ray (q, s) = (−n, −b), cut where s = 1 or at infinity.

        Returns:
            these, and which rows hold each (m, q + 1), the last column being the row at infinity.
        """
        if self.rows.shape[1] == 0:
            return self.interior[None], np.zeros((1, 1), dtype=bool)
        homogeneous = -_hull(self.rows / -self.levels[:, None])
        finite = homogeneous[:, -1] > 1e-9
        corners = homogeneous[:, :-1] / np.where(finite, homogeneous[:, -1], 1.0)[:, None]
        residual = corners @ self.rows.T - finite[:, None] * self.levels
        tolerance = INCIDENCE * np.maximum(1.0, np.linalg.norm(corners, axis=1))
        incidence = np.column_stack([residual <= tolerance[:, None], ~finite])
        incidence, order = np.unique(incidence, axis=0, return_index=True)
        return corners[order] @ self.axes.T + ~incidence[:, -1:] * self.interior, incidence

    def planes(self, on: Bits) -> Bits:
        """Which of all planes hold faces or corners (m, k), by which rows do (m, q)."""
        cuts, held = self.kinds >= 0, np.tile(self.everywhere, (len(on), 1))
        held[:, cuts] = on[:, self.kinds[cuts]]
        return held


def _means(corners: Array, rays: Bits, members: Bits) -> Array:
    """For each face the mean of its vertices plus the mean of its rays (n, r).

    `corners` (m, r) are vertices and rays, `rays` (m,) marks the rays, `members` (n, m) the corners of each face.
    """
    from scipy.sparse import csr_array

    # A sparse product adds corners one after the other, so that the last digits are the same on all machines.
    sums = csr_array(members)
    points = np.zeros((len(members), corners.shape[1]))
    for side in (~rays, rays):
        points += sums @ (side[:, None] * corners) / np.maximum(sums @ side.astype(np.float64), 1.0)[:, None]
    return points


def _merge_corners(corners: Array, incidence: Bits, tolerance: float) -> tuple[Array, Bits]:
    """Corners (m, n), those that rounding alone tells apart made one, with the planes (m, k) of all of them."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial.distance import cdist

    reach = tolerance * np.maximum(1.0, np.linalg.norm(corners, axis=1))
    near = (cdist(corners, corners) <= np.minimum(reach[:, None], reach)) & (incidence[:, -1:] == incidence[:, -1])
    count, group = connected_components(coo_array(near), directed=False)
    _, first = np.unique(group, return_index=True)
    held = np.zeros((count, incidence.shape[1]), dtype=bool)
    np.logical_or.at(held, group, incidence)
    held, order = np.unique(held, axis=0, return_index=True)
    return corners[first[order]], held


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
    bounds = [(None, None)] * n + [(None, 1.0)]
    result = linprog(cost, A_ub=A, b_ub=-levels[free], A_eq=fixed, b_eq=levels[equal], bounds=bounds)
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


def _spans(rows: Array) -> tuple[Array, Array]:
    """Orthonormal columns: those that span the rows, the axes where rows span everything, and those normal to rows."""
    n = rows.shape[1]
    _, s, Vt = np.linalg.svd(rows)
    rank = int(np.sum(s > 1e-7))
    return np.eye(n) if rank == n else Vt[:rank].T, np.eye(n) if rank == 0 else Vt[rank:].T
