"""Triangles of a mesh as they bound a solid: turned like those around them and outward, and none through another.

Triangles that face the other way than those around them, and shells that are inside out, are turned round. A surface
that passes through itself bounds no solid.
"""

from typing import TypeAlias

import numpy as np
from shapely import STRtree, box

from fmopt.errors import GeometryError
from fmopt.geometry.facets import Indices, normals_of, shells_of
from fmopt.spatial.values import Array, Bits

_MOST_SHELLS = 100  # beyond which they are no bodies

Crossing: TypeAlias = tuple[int, int, Array]
_AT_ONCE = 100_000  # pairs of triangles looked at together
_ROWS = 200  # triangles whose neighbours are looked for together
_LARGE = 50  # triangles of one plane that are held against what crosses it alone
_MOST_PAIRS = 10_000_000  # of triangles whose boxes meet: a mesh that is no heap has some dozens for each triangle


def turned_alike(points: Array, triangles: Indices) -> Indices:
    """Triangles (m, 3) turned so that neighbours run along their common side in opposite directions.

    Of triangles that hang together those of the smaller area are turned. Where more than two share a side nothing
    follows from it; where triangles cannot agree, as in a band with a twist, they stay as they are. They are indices
    (m, 3) of points (n, 3), m.
    """
    turned = _turns(points, triangles)
    return np.where(turned[:, None], triangles[:, [0, 2, 1]], triangles) if turned.any() else triangles


def _turns(points: Array, triangles: Indices) -> Bits:
    """Which triangles (m,) have to be turned."""
    ways = np.vstack([triangles[:, [k, (k + 1) % 3]] for k in range(3)]) @ (len(points), 1)
    if len(np.unique(ways)) == len(ways):  # none run along a side in the same direction
        return np.zeros(len(triangles), dtype=bool)
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    start, end, count = triangles.ravel(), np.roll(triangles, -1, axis=1).ravel(), len(triangles)
    sides = np.minimum(start, end) * len(points) + np.maximum(start, end)
    often = np.unique(sides, return_counts=True)[1]
    shared = np.argsort(sides, kind="stable")[np.repeat(often == 2, often)].reshape(-1, 2)
    one, other = shared.T // 3
    opposed = np.equal(*(start < end)[shared].T)
    # Each triangle as it is, and turned, by a number higher by their count: what has to go together is linked.
    i, j = np.append(one, one + count), np.append(other + count * opposed, other + count * ~opposed)
    links = coo_array((np.ones(len(i)), (i, j)), shape=(2 * count, 2 * count))
    as_is, turned = np.split(connected_components(links, directed=False)[1], 2)
    # Labels rise, so that the first of those that hang together is as it is; where they are one, a band has a twist.
    group, wrong = np.minimum(as_is, turned), as_is > turned
    area = np.linalg.norm(normals_of(points[triangles]), axis=1)
    return np.asarray(wrong ^ (np.bincount(group, area * wrong) > 0.5 * np.bincount(group, area))[group])


def turned_outward(points: Array, triangles: Indices) -> Indices:
    """Closed shells that are inside out, and inside no other one, turned round; shells inside others are cavities.

    Where there are very many, they are no bodies. Triangles are indices (m, 3) of points (n, 3), m.
    """
    shell = shells_of(triangles, len(points))
    names = np.unique(shell)
    if len(names) > _MOST_SHELLS:
        return triangles
    low = np.array([points[triangles[shell == n]].min(axis=(0, 1)) for n in names])
    high = np.array([points[triangles[shell == n]].max(axis=(0, 1)) for n in names])
    turned = np.zeros(len(triangles), dtype=bool)
    for k, name in enumerate(names):
        # Seen from a corner of its own box: far from 0 the volumes that add up would cancel.
        a, b, c = (points[triangles[shell == name][:, i]] - low[k] for i in range(3))
        inside = np.all(low <= low[k], axis=1) & np.all(high >= high[k], axis=1) & (names != name)
        if float(np.einsum("ij,ij->", a, np.cross(b, c))) < 0.0 and not inside.any():
            turned |= shell == name
    return np.where(turned[:, None], triangles[:, [0, 2, 1]], triangles) if turned.any() else triangles


def first_crossing(points: Array, triangles: Indices, tol: float) -> Crossing | None:
    """The first two triangles of which one has an edge that passes through the other, and where; None if none do.

    What touches, shares an edge or a corner, overlaps in one plane, or passes by less than `tol` (m) does not cross.
    Triangles are indices (m, 3) of points (n, 3), m; the answer is the numbers of two, last that of the edge, and the
    place (3,), m.

    Raises:
        GeometryError: the triangles lie in heaps.
    """
    corners = points[triangles]
    normals = normals_of(corners)
    size = np.linalg.norm(normals, axis=1)
    normals /= np.where(size > 0.0, size, 1.0)[:, None]
    one, other = _near(corners, normals, size, tol)
    for start in range(0, len(one), _AT_ONCE):
        i, j = one[start : start + _AT_ONCE], other[start : start + _AT_ONCE]
        heights = np.einsum("ij,ikj->ik", normals[i], corners[j] - corners[i, :1])
        both = (heights.min(axis=1) < -0.5 * tol) & (heights.max(axis=1) > 0.5 * tol)  # others cross no plane
        i, j = i[both], j[both]
        for k in range(3):
            hit, where = _pierced(corners[i], corners[j][:, k], corners[j][:, (k + 1) % 3], tol)
            if len(found := np.flatnonzero(hit)):
                return int(i[found[0]]), int(j[found[0]]), where[found[0]]
    return None


def _near(corners: Array, normals: Array, size: Array, tol: float) -> tuple[Indices, Indices]:
    """Ordered pairs of triangles that may cross: their boxes meet, and one in a large face has the other through it."""
    kinds = np.round(np.column_stack([normals, np.vecdot(normals, corners[:, 0]) / tol * 1e-3]), 3)
    _, kind, count = np.unique(kinds, axis=0, return_inverse=True, return_counts=True)
    left, pairs = np.ones(len(corners), dtype=bool), list[Indices]()
    for number in np.flatnonzero(count > _LARGE):
        widest = int(np.argmax(np.where(kind.ravel() == number, size, 0.0)))
        heights = (corners - corners[widest, 0]) @ normals[widest]
        low, high = heights.min(axis=1), heights.max(axis=1)
        on = left & (low > -0.25 * tol) & (high < 0.25 * tol)
        met = _met(corners, on, (low < -0.25 * tol) & (high > 0.25 * tol))
        pairs += [met, met[::-1]]
        left &= ~on
    one, other = np.hstack([*pairs, _met(corners, left, left)])
    # In the order of the file, so that the same crossing is named whatever the tree does.
    order = np.lexsort((other, one))
    return one[order], other[order]


def _met(corners: Array, some: Bits, others: Bits) -> Indices:
    """Pairs (2, k) of some triangles and others whose boxes meet."""
    low, high = corners.min(axis=1), corners.max(axis=1)
    # The tree knows x and y only; heights are compared for what it finds.
    flat = box(low[:, 0], low[:, 1], high[:, 0], high[:, 1])
    within, asked = np.flatnonzero(others), np.flatnonzero(some)
    tree, pairs, seen = STRtree(flat[within]), [np.zeros((2, 0), dtype=np.int64)], 0
    for start in range(0, len(asked), _ROWS):
        found = tree.query(flat[asked[start : start + _ROWS]])
        one, other = asked[start + found[0]], within[found[1]]
        meet = (one != other) & (low[one, 2] <= high[other, 2]) & (low[other, 2] <= high[one, 2])
        pairs.append(np.array([one[meet], other[meet]]))
        seen += len(one)
        if seen > _MOST_PAIRS:
            raise GeometryError(f"too many of the {len(flat)} triangles lie over each other", "export the mesh coarser")
    return np.hstack(pairs)


def _pierced(triangles: Array, start: Array, end: Array, tol: float) -> tuple[np.ndarray, Array]:
    """Whether segments (n, 3) pass through triangles (n, 3, 3), and where they meet the triangles' planes (n, 3)."""
    (a, b, c), normal = np.moveaxis(triangles, 1, 0), normals_of(triangles)
    size = np.linalg.norm(normal, axis=1)
    normal /= np.where(size > 0.0, size, 1.0)[:, None]
    before, after = (np.einsum("ij,ij->i", normal, end_ - a) for end_ in (start, end))
    through = (size > 0.0) & (np.minimum(before, after) < -tol) & (np.maximum(before, after) > tol)
    share = before / np.where(through, before - after, 1.0)
    where = start + share[:, None] * (end - start)
    for one, two in ((a, b), (b, c), (c, a)):
        side = two - one
        length = np.linalg.norm(side, axis=1)
        through &= np.einsum("ij,ij->i", np.cross(normal, side), where - one) > tol * length
    return through, where
