"""The face lattice of a pointed polyhedron from the planes that hold each of its corners: combinatorics alone."""

import numpy as np

from fmopt.spatial.values import Bits, Indices


def closed_sets(incidence: Bits) -> tuple[Bits, Bits, Indices]:
    """All intersections of the planes' sets of corners, none empty and none at infinity: largest dimension first.

    The dimension of a face is one more than that of its largest smaller intersection with a plane, as faces of a
    polytope come in levels without gaps; of a corner it is 0. The incidence is which planes hold each corner
    (m, k + 1), the last of them that at infinity.

    Returns:
        the corners of each face (n, m), the planes that hold it (n, k), and its dimension (n,).
    """
    m = len(incidence)
    # A set of corners is an integer with a bit for each of them.
    planes = [int.from_bytes(np.packbits(column, bitorder="little").tobytes(), "little") for column in incidence.T]
    sets = {(1 << m) - 1}
    for plane in planes:
        sets |= {corners & plane for corners in sets}
    listed = sorted(sets - {0}, key=int.bit_count)
    packed = np.frombuffer(b"".join(corners.to_bytes(-(-m // 8), "little") for corners in listed), dtype=np.uint8)
    members = np.unpackbits(packed.reshape(len(listed), -1), axis=1, count=m, bitorder="little").astype(np.bool_)
    shared = members.astype(np.float32) @ incidence.astype(np.float32)
    active = shared == members.sum(axis=1)[:, None]
    dimensions = {0: -1}
    for corners, side in zip(listed, np.where(active, 0.0, shared).argmax(axis=1).tolist(), strict=True):
        smaller = corners & planes[side]
        dimensions[corners] = dimensions[0 if smaller == corners else smaller] + 1
    levels = np.array([dimensions[corners] for corners in listed])
    # By dimension, then by planes, the first counting most: `lexsort` takes the last key first.
    order = np.lexsort((*~active.T[::-1], -levels))
    order = order[~active[order, -1]]
    return members[order], active[order, :-1], levels[order]


def covers(active: Bits, dimensions: Indices) -> Bits:
    """Which face (row index) has which face (column index) on its boundary, one dimension lower (n, n).

    `active` (n, k) says which planes hold each face, `dimensions` (n,) are those of the faces.
    """
    planes = active.astype(np.float32)
    contained = planes @ planes.T == active.sum(axis=1)[:, None]
    return np.asarray(contained & (dimensions[:, None] == dimensions + 1))
